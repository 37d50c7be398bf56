"""What every peer is given and gives back, and those that read files: ddmpi, CalculiX and FreeFEM.

A scene on a mesh, on plain arrays in one file, and an answer. Nothing but numpy is imported here, because the time of a
peer is that of its whole process.
"""

from __future__ import annotations

import csv
import shutil
import sys
from collections.abc import Iterable
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


# ddmpi itself, the whole command as a user types it; one or two processes

def ddmpi_command(folder: Path, count: int) -> list[str]:
    return ["mpirun", "-n", str(count), sys.executable, "-m", "ddmpi", "run", "scene.toml", "--no-figures",
            "--output", "results"]


def clear_ddmpi(case: Case, folder: Path) -> None:
    shutil.rmtree(folder / "results", ignore_errors=True)


def read_ddmpi(case: Case, folder: Path) -> Answer:
    import h5py
    import msgspec

    summary = msgspec.json.decode((folder / "results" / "summary.json").read_bytes())
    s = np.zeros((2, len(case.pairs)))  # ddmpi leaves nodes out that face away from the plane
    for number, name in enumerate(summary["contacts"]):
        pairs = np.flatnonzero(case.contact == number)
        with open(folder / "results" / f"contact_{name}.csv", newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                nearest = np.abs(case.points[case.pairs[pairs, 0], 0] - float(row["x"])).argmin()
                s[:, pairs[nearest]] = float(row["normal_force"]), float(row["tangential_force"])
    with h5py.File(folder / "results" / "result.h5") as file:
        distance = np.linalg.norm(file["points"][:, :2] - case.points[case.watched], axis=1)
        u = np.zeros_like(case.points)
        u[case.watched] = file["displacement"][int(distance.argmin()), :2]
    return answer_of(case, u.ravel(), s, summary["outer_iterations"])


# CalculiX (calculix-ccx): node-to-face contact by penalty springs, linear triangles CPE3, SPOOLES

STIFFNESS = STICK = 20.0
"""Of the contact springs, normal and while they stick, in Young's moduli per least nodal length."""

TENSION = 1e-8
"""Stress that open springs bear, in Young's moduli."""


def _lines(rows: Iterable) -> str:
    return "".join(", ".join(map(str, row)) + "\n" for row in rows)


def deck(case: Case) -> str:
    points, triangles = case.points, case.triangles
    clamped = [(i // 2 + 1, i % 2 + 1, i % 2 + 1) for i in case.clamped.tolist()]
    base = np.intersect1d(case.clamped // 2, second_body(case)).tolist()
    if case.rigid:  # two elements that cannot move
        start, low, high = len(points), points[:, 0].min() - 1.0, points[:, 0].max() + 1.0
        points = np.vstack([points, [[low, low - high], [high, low - high], [high, 0.0], [low, 0.0]]])
        triangles = np.vstack([triangles, start + np.array([[0, 1, 2], [0, 2, 3]])])
        base = list(range(start, start + 4))
        clamped += [(i + 1, 1, 2) for i in base]
    lines = ["*NODE, NSET=ALL\n", _lines((i + 1, repr(x), repr(y), 0.0) for i, (x, y) in enumerate(points.tolist())),
             "*ELEMENT, TYPE=CPE3, ELSET=BODIES\n",
             _lines((e + 1, *each) for e, each in enumerate((triangles + 1).tolist())),
             f"*NSET, NSET=WATCHED\n{case.watched + 1}\n*NSET, NSET=BASE\n", _lines((i + 1,) for i in base),
             f"*MATERIAL, NAME=STEEL\n*ELASTIC\n{case.young!r}, {case.poisson!r}\n",
             "*SOLID SECTION, ELSET=BODIES, MATERIAL=STEEL\n1.0\n*BOUNDARY\n", _lines(clamped)]
    for number in np.unique(case.contact):
        first, second = case.pairs[case.contact == number].T
        lines += [f"*SURFACE, NAME=FIRST{number}, TYPE=ELEMENT\n", _lines(faces(case, first)),
                  f"*SURFACE, NAME=SECOND{number}, TYPE=ELEMENT\n",
                  f"{len(triangles)}, S2\n" if case.rigid else _lines(faces(case, second)),
                  "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE\n", f"FIRST{number}, SECOND{number}\n"]
    spring = case.young / case.length.min()
    lines += ["*SURFACE INTERACTION, NAME=TOUCH\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n",
              f"{STIFFNESS * spring!r}, {TENSION * case.young!r}\n"]
    if case.friction:
        lines += [f"*FRICTION\n{case.friction!r}, {STICK * spring!r}\n"]
    load = [(i // 2 + 1, i % 2 + 1, repr(value)) for i, value in enumerate(case.load.tolist()) if value]
    lines += ["*STEP, INC=1000\n*STATIC\n1., 1.\n*CLOAD\n", _lines(load), "*NODE PRINT, NSET=WATCHED\nU\n",
              "*NODE PRINT, NSET=BASE, TOTALS=ONLY\nRF\n*CONTACT PRINT\nCSTR\n*END STEP\n"]
    return "".join(lines)


def second_body(case: Case) -> np.ndarray:
    """The nodes of the second body of the first contact, none of the rigid plane."""
    second = case.pairs[case.contact == 0, 1]
    bodies = np.unique(case.body[np.isin(case.triangles, second).any(axis=1)])
    return np.unique(case.triangles[np.isin(case.body, bodies)])


def faces(case: Case, nodes: np.ndarray) -> list[tuple[int, str]]:
    """The boundary sides of elements along some nodes.

    A node that no pair has, because a clamp holds it, may end them.
    """
    sides = np.stack([case.triangles, np.roll(case.triangles, -1, axis=1)], axis=2)
    each, counts = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    inner = set(map(tuple, each[counts > 1].tolist()))
    paired = np.isin(sides, nodes)
    ends = np.isin(2 * sides, case.clamped) & np.isin(case.points[sides, 1], case.points[nodes, 1])
    along = (paired | ends).all(axis=2) & paired.any(axis=2)
    return [(e + 1, f"S{k + 1}") for e, k in np.argwhere(along).tolist()
            if tuple(sorted(sides[e, k].tolist())) not in inner]


def write_calculix(case: Case, folder: Path) -> None:
    for name in ("contact.dat", "contact.sta"):
        (folder / name).unlink(missing_ok=True)
    (folder / "contact.inp").write_text(deck(case), encoding="utf-8")


def calculix_command(folder: Path, count: int) -> list[str]:
    return ["ccx", "contact"]


def _table(text: str, title: str) -> np.ndarray:
    """The last table of that title."""
    blocks = text.split("\n\n")
    last = max(i for i, block in enumerate(blocks) if block.strip().startswith(title))
    return np.array([line.split() for line in blocks[last + 1].strip().splitlines()], float)


def read_calculix(case: Case, folder: Path) -> Answer:
    """The resultant is what the second body's clamps leave of its loads."""
    text = (folder / "contact.dat").read_text(encoding="utf-8")
    *_, last = increments = (folder / "contact.sta").read_text(encoding="utf-8").splitlines()[2:]
    if "U" in last.split()[2] or float(last.split()[4]) < 1.0:
        raise RuntimeError(f"no convergence beyond {float(last.split()[4]):.3g} of the load")
    load = case.load.copy()
    load[case.clamped] = 0.0  # not part of what CalculiX calls a reaction
    force = -_table(text, "total force")[0, :2] - load.reshape(-1, 2)[second_body(case)].sum(axis=0)
    along = np.array([case.normal[0] @ force, case.tangent[0] @ force])
    return Answer(_table(text, "displacements")[0, 1:3], along, float(_table(text, "contact stress")[:, 1].max()),
                  sum(int(row.split()[3]) for row in increments))


# FreeFEM (freefem++, libfreefem++ for MUMPS): it has no contact, so that its script does the active set, too

SCRIPT = Path(__file__).with_name("freefem_contact.edp")


def write_freefem(case: Case, folder: Path) -> None:
    (folder / "answer.txt").unlink(missing_ok=True)
    nv, nt = len(case.points), len(case.triangles)
    with open(folder / "bodies.msh", "w", encoding="utf-8") as file:
        file.write(f"{nv} {nt} 0\n")
        np.savetxt(file, np.column_stack([case.apart, np.zeros(nv)]), "%.17g %.17g %d")
        np.savetxt(file, np.column_stack([case.triangles + 1, case.body]), "%d")
    (rows, columns, normal), (_, _, tangential) = map(case.relative, (case.normal, case.tangent))
    scale = case.young / 2 / (1 - case.poisson**2)
    with open(folder / "contact.txt", "w", encoding="utf-8") as file:
        file.write(" ".join(map(repr, (*case.lame, float(case.friction), scale))))
        file.write(f" {len(case.clamped)} {len(case.pairs)} {len(rows)}\n")
        for each in (case.clamped, case.load, case.gap):
            np.savetxt(file, each, "%.17g")
        np.savetxt(file, np.column_stack([rows, columns, normal, tangential]), "%d %d %.17g %.17g")


def freefem_command(folder: Path, count: int) -> list[str]:
    return ["FreeFem++", "-nw", "-v", "0", str(SCRIPT)]


def read_freefem(case: Case, folder: Path) -> Answer:
    steps, *x = np.loadtxt(folder / "answer.txt")
    u, s = np.split(np.array(x), [2 * len(case.points)])
    return answer_of(case, u, s.reshape(2, -1), int(steps))
