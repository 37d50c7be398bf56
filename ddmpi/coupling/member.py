"""A body at all its interfaces: what the others see of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.compliance import Compliance
from ddmpi.body.elasticity import Elasticity
from ddmpi.interface.interface import Interface
from ddmpi.interface.trace import displacement_trace, fixed_trace, trace
from ddmpi.petsc.events import event

PRECISE = 1e-12
"""Relative residual of the last solve, which the certificate looks at, where the solver is iterative."""


class Member:
    """One body at its interfaces.

    Parameters
    ----------
    name : of the body
    elasticity : A, b of the body
    interfaces : at which it takes part, in the order of a vector's parts
    compliance, memory : kind of the compliance, and the bytes that it may use, see `Compliance`

    Attributes
    ----------
    C : contact compliance B A⁻¹ Bᵀ
    h : (size,) B A⁻¹ b, the contact displacement without contact forces (m)

    Construction factors A and is collective on the body's communicator. Raises SolverError.
    """

    def __init__(self, name: str, elasticity: Elasticity, interfaces: Sequence[Interface],
                 compliance: str | None = None, memory: float = np.inf) -> None:
        self.name, self.elasticity, self.interfaces = name, elasticity, tuple(interfaces)
        B = sparse.vstack([trace(each, each.side(name), elasticity) for each in self.interfaces], format="csr")
        self.C = Compliance(elasticity.A, B, name, compliance, memory)
        self.h = np.zeros(self.C.size)
        if elasticity.b.norm() > 0.0:
            with event("LoadResponse"):
                self.C.free_response(elasticity.b, self.h, "load")
        self.h += self.trace(elasticity.prescribed)
        self._set_up = self.C.count.copy()

    def restart(self) -> None:
        """Count multiplications from the set-up on, for another iteration on the same factors."""
        self.C.count = self._set_up.copy()

    def need_norm(self) -> None:
        """Estimate ‖C‖ now, as a part of the set-up. Collective on the body's communicator."""
        before = self.C.count["norm"]
        self.C.norm()
        self._set_up["norm"] += self.C.count["norm"] - before

    def trace(self, u: np.ndarray) -> np.ndarray:
        """B u (size,) in metres, of a displacement (nv, d) of all nodes. Not collective."""
        return np.concatenate([displacement_trace(each, each.side(self.name), u) for each in self.interfaces])

    def fixed_trace(self, u: np.ndarray) -> np.ndarray:
        """Normal displacement (k,) in metres at node pairs that clamps hold on both sides. Not collective."""
        return np.concatenate([fixed_trace(each, each.side(self.name), u) for each in self.interfaces])

    def displacement(self, s: np.ndarray) -> tuple[np.ndarray, float]:
        """Displacement (nv, d) in metres under the load and the contact forces s (size,) in newtons.

        Returns
        -------
        u : (nv, d)
        residual : ‖A u + Bᵀ s − b‖ / max(‖b‖, ‖Bᵀ s‖), zero where nothing acts

        Collective on the body's communicator. Raises SolverError.
        """
        with event("Displacement"):
            A, b = self.elasticity.A, self.elasticity.b
            u, f = A.createVecs()
            self.C.spread(s, f)
            size = max(f.norm(), b.norm())
            f.aypx(-1.0, b)
            if f.norm() > 0.0:
                self.C.solve(f, u, "displacement", PRECISE)
            Au = u.duplicate()
            A.mult(u, Au)
            Au.axpy(-1.0, f)
            return self.elasticity.expand(u), (Au.norm() / size if size else 0.0)
