"""A preconditioner of your own: springs at the contact nodes in place of the half-spaces of Newton's method.

    python docs/examples/springs.py

A half-space couples all nodes of a contact: long waves of displacement meet little resistance, short ones much. A spring
at each node resists all of them like the shortest. So finer meshes take more products with springs, and about as many
with half-spaces. The answers are the same: a preconditioner only steers.
"""

from unittest import mock

import numpy as np

import ddmpi
from ddmpi.methods import krylov
from ddmpi.methods.half_space import HalfSpace


class Springs(HalfSpace):
    """c ≈ C⁻¹ (N/m), `Interface.stiffness`: what half-spaces have against waves of the nodes' spacing."""

    def __init__(self, space, local=None):
        self.c = np.concatenate([np.empty(0), *(each.stiffness for each in space.interfaces)])

    def softened(self, deltas):
        """(1 + δ) (1/c + δ/c)⁻¹ = c: springs behind a layer, by δ of each interface."""
        return self

    def mult(self, x, inverse=False):
        """Of a vector, or of the columns of a matrix."""
        c = self.c.reshape(-1, *(1,) * (x.ndim - 1))
        return x / c if inverse else c * x


def main() -> None:
    for N in (18, 54):
        mesh = {f"body.{name}.mesh.divisions": [3 * N, N] for name in ("upper", "lower")}
        forces = []
        for kind in (HalfSpace, Springs):
            with mock.patch.object(krylov, "HalfSpace", kind):
                answer = ddmpi.solve("configs/pinched_blocks.toml", overrides=mesh, only="contacts")
            assert answer.certified, answer.reason
            forces.append(answer.contacts["upper-lower"].forces)
            print(f"N = {N}, {kind.__name__}: {answer.summary['n_A']} products")
        assert np.allclose(*forces, atol=1e-6 * np.abs(forces[0]).max())


if __name__ == "__main__":
    main()
