"""What every peer is given and gives back, and those that read files: ddmpi, CalculiX and FreeFEM.

A scene on a mesh, on plain arrays in one file, and an answer. Nothing but numpy is imported here, because the time of a
peer is that of its whole process.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

FILE, ANSWER = "case.npz", "answer.npz"


@dataclass(frozen=True)
class Case:
    """Elastic bodies of one material in the plane (plane strain) or in space, on simplices, and what may touch.

    Attributes
    ----------
    points : (nv, d) nodes of all bodies (m); bodies share none
    cells : (nt, d + 1) triangles or tetrahedra, or (nt, 10) of order 2 in the order of VTK and of CalculiX
    body : (nt,) number of each cell's body
    young, poisson : of the material (Pa)
    clamped : (k,) dofs that are held; dof d i + c is component c of node i
    load : (d nv,) nodal forces of the tractions (N; in the plane per metre of depth, as all forces)
    pairs : (m, 2) nodes that face each other, of the first and the second body; −1 for the rigid plane through the
        origin, across the last axis. None at order 2, where facets that face each other do not match
    normal : (m, d) outer normals of the first body
    gap : (m,) initial gaps (m)
    area : (m,) nodal lengths or areas on the first body (m, m²)
    contact : (m,) number of each pair's contact
    facets : (f, l) nodes of the facets that may touch
    side : (f, 2) number of each facet's contact, and 0 on the first body, 1 on the second
    friction : Coulomb's coefficient of all contacts
    watched : the node whose displacement is compared
    compared : the force is that of so many contacts, the first ones; all of them act on one body
    """

    points: np.ndarray
    cells: np.ndarray
    body: np.ndarray
    young: float
    poisson: float
    clamped: np.ndarray
    load: np.ndarray
    pairs: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    area: np.ndarray
    contact: np.ndarray
    facets: np.ndarray
    side: np.ndarray
    friction: float
    watched: int
    compared: int

    @property
    def dimension(self) -> int:
        return self.points.shape[1]

    @property
    def frame(self) -> np.ndarray:
        """(m, d, d) the normals, then the tangents: in the plane normals turned counter-clockwise."""
        n = self.normal
        if self.dimension == 2:
            return np.stack([n, np.column_stack([-n[:, 1], n[:, 0]])], axis=1)
        first = np.cross(np.eye(3)[np.abs(n).argmin(axis=1)], n)
        first /= np.linalg.norm(first, axis=1)[:, None]
        return np.stack([n, first, np.cross(n, first)], axis=1)

    @property
    def lame(self) -> tuple[float, float]:
        """λ and μ (Pa)."""
        E, nu = self.young, self.poisson
        return E * nu / (1 + nu) / (1 - 2 * nu), E / 2 / (1 + nu)

    @property
    def scale(self) -> np.ndarray:
        """(m,) half of E/(1 − ν²), in space times a length: times it displacements are compared with forces."""
        return self.young / 2 / (1 - self.poisson**2) * self.area ** ((self.dimension - 2) / (self.dimension - 1))

    @property
    def rigid(self) -> bool:
        """Whether the second body is the rigid plane."""
        return not (self.side[:, 1] == 1).any()

    @property
    def axis(self) -> np.ndarray:
        """(d,) a unit vector normal to the first contact, which is flat."""
        corners = self.points[self.facets[0, :self.dimension]]
        return np.eye(self.dimension)[-1] if self.rigid else np.linalg.svd(corners - corners.mean(axis=0))[2][-1]

    @property
    def spacing(self) -> float:
        """The least edge of the facets (m)."""
        corners = self.points[self.facets[:, :self.dimension]]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min())

    @property
    def apart(self) -> np.ndarray:
        """(nv, d) the nodes with the bodies moved apart, for programs that merge nodes at the same place."""
        moved = self.points.copy()
        number = np.repeat(self.body, self.cells.shape[1])
        moved[self.cells.ravel(), 1] += 2.0 * np.ptp(self.points, axis=0).max() * number
        return moved

    def relative(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns, values of the matrix (d m, d nv) that takes displacements to u_first − u_second in the frames.

        Row a m + i is component a of pair i: the normal components come first.
        """
        d, m, frame, found = self.dimension, len(self.pairs), self.frame, []
        for side, sign in ((0, 1.0), (1, -1.0)):
            i = np.flatnonzero(self.pairs[:, side] >= 0)
            found += [(a * m + i, d * self.pairs[i, side] + c, sign * frame[i, a, c])
                      for a in range(d) for c in range(d)]
        rows, columns, values = (np.concatenate(each) for each in zip(*found, strict=True))
        return rows, columns, values

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
    displacement : (d,) of the watched node (m)
    force : (2,) of the compared contacts (N; in the plane per metre), normal under pressure, and the length of its
        tangential part
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
    """From the displacement (d nv,) of all nodes in m and the forces (d, m) of the pairs in their frames, in N."""
    first = case.contact < case.compared
    pushed = np.einsum("am,mac->c", s[1:, first], case.frame[first, 1:])
    return Answer(u.reshape(case.points.shape)[case.watched], np.array([s[0, first].sum(), np.linalg.norm(pushed)]),
                  float((s[0] / case.area).max()), iterations)


def along_and_across(case: Case, force: np.ndarray) -> np.ndarray:
    """The lengths (2,) of the parts of a force (d,) along the axis of the first contact and across it."""
    normal = case.axis @ force
    return np.array([abs(normal), np.linalg.norm(force - normal * case.axis)])


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
    contacts = list(summary["contacts"].values())
    force = sum(np.array(each["force"]) for each in contacts[:case.compared])
    with h5py.File(folder / "results" / "result.h5") as file:
        distance = np.linalg.norm(file["points"][:, :case.dimension] - case.points[case.watched], axis=1)
        u = file["displacement"][int(distance.argmin()), :case.dimension]
    return Answer(u, along_and_across(case, force),
                  max(each["pressure_max"] for each in contacts), summary["outer_iterations"])


# CalculiX (calculix-ccx): contact by penalty springs or mortar, SPOOLES

STIFFNESS = STICK = 40.0
"""Of the contact springs, normal and while they stick, in Young's moduli per least edge."""

TENSION = 1e-8
"""Stress that open springs bear, in Young's moduli; only of springs at nodes."""

SMALL = 1e-3
"""The part of the load that solids on solids get, by whose inverse their answers are multiplied: without gaps those of
small strains are proportional to the load, and CalculiX computes with large rotations wherever there is contact."""

ELEMENTS = {(2, 3): "CPE3", (3, 4): "C3D4", (3, 10): "C3D10"}
SIDES = {2: [(0, 1), (1, 2), (2, 0)], 3: [(0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)]}
"""Corners of the sides of CalculiX's elements."""

BASE = {2: ("CPE4", "S3", [[0, 0], [1, 0], [1, 1], [0, 1]]),
        3: ("C3D8", "S2", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])}
"""The element that is the rigid plane, its upper side and its corners."""


def _lines(rows: Iterable) -> str:
    """Lines of CalculiX, whose numbers have at most 20 characters."""
    return "".join(", ".join(f"{each:.13g}" if isinstance(each, float) else str(each) for each in row) + "\n"
                   for row in rows)


def part_of_load(case: Case) -> float:
    return SMALL if case.dimension == 3 and not case.rigid else 1.0


def deck(case: Case, kind: str) -> str:
    """The input of CalculiX; `kind` of contact is what its manual names."""
    d, points = case.dimension, case.points
    at_nodes, mortar = kind == "NODE TO SURFACE", "MORTAR" in kind
    clamped = [(i // d + 1, i % d + 1, i % d + 1) for i in case.clamped.tolist()]
    base = np.intersect1d(case.clamped // d, second_body(case)).tolist()
    rigid = ""
    if case.rigid:  # an element that cannot move
        element, top, corners = BASE[d]
        size = 1.2 * np.ptp(points, axis=0).max()
        low = np.append(points.min(axis=0)[:-1] - 0.1 * size, -size)
        base = list(range(len(points), len(points) + 2**d))
        points = np.vstack([points, low + size * np.array(corners)])
        clamped += [(i + 1, 1, d) for i in base]
        rigid = f"*ELEMENT, TYPE={element}, ELSET=BODIES\n" + _lines([[len(case.cells) + 1, *(i + 1 for i in base)]])
    rows = np.column_stack([points, np.zeros((len(points), 3 - d))]).tolist()
    lines = ["*NODE, NSET=ALL\n", _lines((i + 1, *x) for i, x in enumerate(rows)),
             f"*ELEMENT, TYPE={ELEMENTS[d, case.cells.shape[1]]}, ELSET=BODIES\n",
             _lines((e + 1, *each) for e, each in enumerate((case.cells + 1).tolist())), rigid,
             f"*NSET, NSET=WATCHED\n{case.watched + 1}\n*NSET, NSET=BASE\n", _lines((i + 1,) for i in base),
             f"*MATERIAL, NAME=STEEL\n*ELASTIC\n{case.young!r}, {case.poisson!r}\n",
             "*SOLID SECTION, ELSET=BODIES, MATERIAL=STEEL\n1.0\n*BOUNDARY\n", _lines(clamped)]
    for number in np.unique(case.side[:, 0]).tolist():
        second = f"{len(case.cells) + 1}, {top}\n" if case.rigid else _lines(faces(case, number, 1))
        lines += [f"*SURFACE, NAME=FIRST{number}, TYPE=ELEMENT\n", _lines(faces(case, number, 0)),
                  f"*SURFACE, NAME=SECOND{number}, TYPE=ELEMENT\n", second,
                  f"*CONTACT PAIR, INTERACTION=TOUCH, TYPE={kind}\n", f"FIRST{number}, SECOND{number}\n"]
    spring = case.young / case.spacing
    lines += ["*SURFACE INTERACTION, NAME=TOUCH\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=",
              "HARD\n" if mortar else f"LINEAR\n{STIFFNESS * spring!r}",
              "" if mortar else f", {TENSION * case.young!r}\n" if at_nodes else "\n"]
    if case.friction:
        lines += [f"*FRICTION\n{case.friction!r}, {STICK * spring!r}\n"]
    load = [(i // d + 1, i % d + 1, value) for i, value in enumerate((part_of_load(case) * case.load).tolist())
            if value]
    lines += ["*STEP, INC=1000\n*STATIC\n1., 1.\n*CLOAD\n", _lines(load), "*NODE PRINT, NSET=WATCHED\nU\n",
              "*NODE PRINT, NSET=BASE, TOTALS=ONLY\nRF\n",
              "*CONTACT PRINT\nCSTR\n" if at_nodes else "*NODE FILE\nU\n*CONTACT FILE\nCSTR\n", "*END STEP\n"]
    return "".join(lines)


def second_body(case: Case) -> np.ndarray:
    """The nodes of the second body of the first contact, none of the rigid plane."""
    second = case.facets[(case.side == (0, 1)).all(axis=1)]
    bodies = np.unique(case.body[np.isin(case.cells, second).any(axis=1)])
    return np.unique(case.cells[np.isin(case.body, bodies)])


def faces(case: Case, contact: int, which: int) -> list[tuple[int, str]]:
    """The sides of elements that are the facets of the first (0) or second (1) body of a contact."""
    d = case.dimension
    wanted = case.facets[(case.side == (contact, which)).all(axis=1), :d]
    sides = np.sort(case.cells[:, SIDES[d]], axis=2) @ len(case.points) ** np.arange(d)
    found = np.argwhere(np.isin(sides, np.sort(wanted, axis=1) @ len(case.points) ** np.arange(d)))
    return [(e + 1, f"S{k + 1}") for e, k in found.tolist()]


def write_calculix(kind: str) -> Callable[[Case, Path], None]:
    def write(case: Case, folder: Path) -> None:
        for name in ("contact.dat", "contact.sta", "contact.frd"):
            (folder / name).unlink(missing_ok=True)
        (folder / "contact.inp").write_text(deck(case, kind), encoding="utf-8")
    return write


def calculix_command(folder: Path, count: int) -> list[str]:
    return ["ccx", "contact"]


def _table(text: str, title: str) -> np.ndarray:
    """The last table of that title."""
    blocks = text.split("\n\n")
    last = max(i for i, block in enumerate(blocks) if block.strip().startswith(title))
    return np.array([line.split() for line in blocks[last + 1].strip().splitlines()], float)


def read_calculix(case: Case, folder: Path) -> Answer:
    """The resultant is what the second body's clamps leave of its loads."""
    text, d, part = (folder / "contact.dat").read_text(encoding="utf-8"), case.dimension, part_of_load(case)
    *_, last = increments = (folder / "contact.sta").read_text(encoding="utf-8").splitlines()[2:]
    if "U" in last.split()[2] or float(last.split()[4]) < 1.0:
        raise RuntimeError(f"no convergence beyond {float(last.split()[4]):.3g} of the load")
    load = part * case.load
    load[case.clamped] = 0.0  # not part of what CalculiX calls a reaction
    force = -_table(text, "total force")[0, :d] - load.reshape(-1, d)[second_body(case)].sum(axis=0)
    if "contact stress" in text:
        pressure = _table(text, "contact stress")[:, 1]
    else:  # of faces: what CalculiX makes of it at nodes
        _, found = (folder / "contact.frd").read_text(encoding="utf-8").split("CPRESS")
        pressure = np.array([line[49:61] for line in found.splitlines() if line.startswith(" -1")], float)
    return Answer(_table(text, "displacements")[0, 1:d + 1] / part, along_and_across(case, force) / part,
                  float(pressure.max()) / part,
                  sum(int(row.split()[3]) for row in increments))


# FreeFEM (freefem++, libfreefem++ for MUMPS): it has no contact, so that its script does the active set, too

SCRIPT = Path(__file__).with_name("freefem_contact.edp")


def write_freefem(case: Case, folder: Path) -> None:
    (folder / "answer.txt").unlink(missing_ok=True)
    d, nv, nt = case.dimension, len(case.points), len(case.cells)
    (folder / "dimension.idp").write_text(f"macro dimension() {d} //\n", encoding="utf-8")
    with open(folder / ("bodies.msh" if d == 2 else "bodies.mesh"), "w", encoding="utf-8") as file:
        file.write(f"{nv} {nt} 0\n" if d == 2 else f"MeshVersionFormatted 2\nDimension 3\nVertices\n{nv}\n")
        np.savetxt(file, np.column_stack([case.apart, np.zeros(nv)]), "%.17g " * d + "%d")
        file.write("" if d == 2 else f"Tetrahedra\n{nt}\n")
        np.savetxt(file, np.column_stack([case.cells + 1, case.body]), "%d")
        file.write("" if d == 2 else "End\n")
    rows, columns, values = case.relative()
    with open(folder / "contact.txt", "w", encoding="utf-8") as file:
        file.write(" ".join(map(repr, (*case.lame, float(case.friction)))))
        file.write(f" {len(case.clamped)} {len(case.pairs)} {len(rows)}\n")
        for each in (case.clamped, case.load, case.gap, case.scale):
            np.savetxt(file, each, "%.17g")
        np.savetxt(file, np.column_stack([rows, columns, values]), "%d %d %.17g")


def freefem_command(folder: Path, count: int) -> list[str]:
    return ["FreeFem++", "-nw", "-v", "0", str(SCRIPT)]


def read_freefem(case: Case, folder: Path) -> Answer:
    steps, *x = np.loadtxt(folder / "answer.txt")
    u, s = np.split(np.array(x), [case.points.size])
    return answer_of(case, u, s.reshape(case.dimension, -1), int(steps))
