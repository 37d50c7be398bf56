"""What a load step leaves for the next one, and for its energies."""

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.coupling.space import Space


@dataclass
class Mark:
    """The end of a load step, from which the next one and its energies count.

    Attributes
    ----------
    time : of the step
    s, alpha : forces (size,) in N and motions of loose bodies in m
    d : (size,) free displacements less gaps, tangentially from the beginning (m)
    moved : (size,) relative displacements (m)
    opening, prescribed : (size,) of a `Space` (m)
    factors : (k,) by history
    work : (2, k), as `Solution.work` (J)
    energy : strain energy (J)
    length : of closed contacts, in space their area (m, m²)
    slid : by contact without friction its slip (m, d − 1) of all load steps (m)
    derived : derivatives, see `ddmpi.derive.chain`
    memory : of bodies that move far, see `ddmpi.run.places`
    """

    time: float
    s: np.ndarray
    alpha: np.ndarray
    d: np.ndarray
    moved: np.ndarray
    opening: np.ndarray
    prescribed: np.ndarray
    factors: np.ndarray
    work: np.ndarray
    energy: float
    length: float
    slid: dict[str, np.ndarray]
    derived: dict[str, np.ndarray] = field(default_factory=dict)
    memory: Any = field(default_factory=dict)

    @property
    def closed(self) -> np.ndarray:
        """(size,) relative displacements less the initial gaps (m)."""
        return self.moved - self.opening

    def work_since(self, before: Self, space: Space) -> tuple[float, float]:
        """External work and interface work (J) of the step from `before` to here. Collective."""
        # forces and displacements are taken as linear in time within the step, so work is by the trapezoidal rule
        opened, gone = self.opening - before.opening, self.prescribed - before.prescribed
        closing, mean = self.moved - before.moved - opened, 0.5 * (self.s + before.s)
        driven, interface_work = space.add(np.array([mean @ (gone - opened), mean @ closing]))
        # loads over displacements, and reactions of clamps over what these prescribe: ΔW = ½ (b_n + b_n−1) Δu
        work = 0.5 * (self.factors + before.factors) @ (self.work[0] - before.work[0])
        work += 0.5 * (self.factors - before.factors) @ (self.work[1] + before.work[1]) + driven
        return float(work), float(interface_work)

    def change_since(self, s: np.ndarray, largest: np.ndarray, space: Space) -> float:
        """The change of the forces since `s` (size,) over the largest of all, or of its tangential part over the
        largest slip bounds if that is more; `largest` (2,) has both (N). Collective."""
        change = self.s - s
        tangential = change.copy()
        for interface, part in space.with_slices():
            tangential[part][: interface.m] = 0.0
        return float((space.norms([change, tangential]) / largest).max())

    def given(self, before: Self, space: Space) -> float:
        """The work (J) of an overlap, of bonds and guides also of a gap: it acts at once, before any load. Collective."""
        sudden = np.concatenate(
            [
                np.empty(0),
                *(
                    before.opening[part]
                    if interface.law.two_sided
                    else np.minimum(before.opening[part], 0.0)
                    for interface, part in space.with_slices()
                ),
            ]
        )
        return float(space.add(np.array([0.5 * (self.s + before.s) @ sudden]))[0])

    @classmethod
    def first(cls, assembly: Assembly, derived: dict[str, np.ndarray]) -> Self:
        """Time 0, free of stress."""
        space, zero = assembly.space, np.zeros(assembly.space.size)
        touching = sum(
            float(interface.area[interface.opening <= 0.0].sum()) for interface in space.interfaces
        )
        still, k = np.zeros(assembly.joint.rigid.size), len(assembly.scene.followed) + 1
        return cls(
            0.0,
            zero,
            still,
            zero,
            zero,
            space.opening,
            zero,
            np.zeros(k),
            np.zeros((2, k)),
            0.0,
            float(space.add(np.array([touching]))[0]),
            {},
            derived,
        )
