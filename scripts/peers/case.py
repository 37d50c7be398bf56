"""What every peer is given and gives back: a scene on a mesh, on plain arrays in one file, and an answer.

Nothing but numpy is imported here, because the time of a peer is that of its whole process.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

FILE, ANSWER = "case.npz", "answer.npz"


@dataclass(frozen=True)
class Case:
    """Elastic bodies of one material in plane strain, on linear triangles, and the pairs of nodes that may touch.

    Attributes
    ----------
    points : (nv, 2) nodes of all bodies (m); bodies share none
    triangles : (nt, 3) counter-clockwise
    body : (nt,) number of each triangle's body
    young, poisson : of the material (Pa)
    clamped : (k,) dofs that are held; dof 2i + c is component c of node i
    load : (2 nv,) nodal forces of the tractions (N per metre of depth)
    pairs : (m, 2) nodes that face each other, of the first and the second body; −1 for the rigid plane y = 0
    normal : (m, 2) outer normals of the first body
    gap : (m,) initial gaps (m)
    length : (m,) nodal lengths on the first body (m)
    contact : (m,) number of each pair's contact
    friction : Coulomb's coefficient of all contacts
    watched : the node whose displacement is compared
    """

    points: np.ndarray
    triangles: np.ndarray
    body: np.ndarray
    young: float
    poisson: float
    clamped: np.ndarray
    load: np.ndarray
    pairs: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    length: np.ndarray
    contact: np.ndarray
    friction: float
    watched: int

    @property
    def tangent(self) -> np.ndarray:
        """(m, 2) normals, turned counter-clockwise."""
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])

    @property
    def lame(self) -> tuple[float, float]:
        """λ and μ (Pa)."""
        E, nu = self.young, self.poisson
        return E * nu / (1 + nu) / (1 - 2 * nu), E / 2 / (1 + nu)

    @property
    def rigid(self) -> bool:
        """Whether the second body is the rigid plane."""
        return bool((self.pairs[:, 1] < 0).all())

    @property
    def apart(self) -> np.ndarray:
        """(nv, 2) the nodes with the bodies moved apart, for programs that merge nodes at the same place."""
        moved = self.points.copy()
        moved[self.triangles.ravel(), 1] += 2.0 * np.ptp(self.points, axis=0).max() * np.repeat(self.body, 3)
        return moved

    def relative(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns, values of the matrix (m, 2 nv) that takes displacements to u_first − u_second along it."""
        rows, columns, values = [], [], []
        for side, sign in ((0, 1.0), (1, -1.0)):
            bodily = np.flatnonzero(self.pairs[:, side] >= 0)
            for c in range(2):
                rows.append(bodily)
                columns.append(2 * self.pairs[bodily, side] + c)
                values.append(sign * direction[bodily, c])
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)

    def save(self, folder: Path) -> None:
        np.savez(folder / FILE, **asdict(self))


def read_case(folder: Path) -> Case:
    with np.load(folder / FILE) as file:
        return Case(**{name: file[name] if file[name].ndim else file[name].item() for name in file.files})


@dataclass(frozen=True)
class Answer:
    """What is compared.

    Attributes
    ----------
    displacement : (2,) of the watched node (m)
    force : (2,) of the first contact (N per metre), normal under pressure, tangential as the first body pushes the
        second along the tangent
    pressure : the largest of all nodes (Pa)
    iterations : of what the peer calls so
    """

    displacement: np.ndarray
    force: np.ndarray
    pressure: float
    iterations: int

    def save(self, folder: Path) -> None:
        np.savez(folder / ANSWER, **asdict(self))


def answer_of(case: Case, u: np.ndarray, s: np.ndarray, iterations: int) -> Answer:
    """From the displacement (2 nv,) of all nodes in m and the forces (2, m) of the pairs in N per metre."""
    first = case.contact == 0
    return Answer(u.reshape(-1, 2)[case.watched], s[:, first].sum(axis=1), float((s[0] / case.length).max()),
                  iterations)


def read_answer(folder: Path) -> Answer:
    with np.load(folder / ANSWER) as file:
        return Answer(**{name: file[name] if file[name].ndim else file[name].item() for name in file.files})
