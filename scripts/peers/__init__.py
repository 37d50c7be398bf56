"""What every peer is given and gives back, and those that read files: ddmpi and CalculiX.

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
    """Elastic solids of one material, on tetrahedra, and what may touch.

    Attributes
    ----------
    points : (nv, 3) nodes of all bodies (m); bodies share none
    cells : (nt, 4), or (nt, 10) of order 2 in the order of VTK and of CalculiX
    body : (nt,) number of each cell's body
    young, poisson : of the material (Pa)
    clamped : (k,) clamped dofs; dof 3 i + c is component c of node i
    load : (3 nv,) nodal forces of the tractions (N)
    pairs : (m, 2) nodes that face each other, of the first and the second body; −1 for the rigid plane through the
        origin, across the last axis. None at order 2, where facets that face each other do not match
    normal : (m, 3) outer normals of the first body
    gap : (m,) initial gaps (m)
    area : (m,) nodal areas on the first body (m²)
    contact : (m,) number of each pair's contact
    facets : (f, k) nodes of the facets that may touch
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
    def frame(self) -> np.ndarray:
        """(m, 3, 3) the normals, then two tangents."""
        n = self.normal
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
        """(m,) half of E/(1 − ν²) times a length: times it displacements are compared with forces (N/m)."""
        return self.young / 2 / (1 - self.poisson**2) * np.sqrt(self.area)

    @property
    def rigid(self) -> bool:
        """Whether the second body is the rigid plane."""
        return not (self.side[:, 1] == 1).any()

    @property
    def axis(self) -> np.ndarray:
        """(3,) a unit vector normal to the first contact, which is flat."""
        corners = self.points[self.facets[0, :3]]
        return np.eye(3)[-1] if self.rigid else np.linalg.svd(corners - corners.mean(axis=0))[2][-1]

    @property
    def spacing(self) -> float:
        """The least edge of the facets (m)."""
        corners = self.points[self.facets[:, :3]]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min())

    @property
    def apart(self) -> np.ndarray:
        """(nv, 3) the nodes with the bodies moved apart, for programs that merge nodes at the same place."""
        moved = self.points.copy()
        number = np.repeat(self.body, self.cells.shape[1])
        moved[self.cells.ravel(), 1] += 2.0 * np.ptp(self.points, axis=0).max() * number
        return moved

    def relative(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns, values of the matrix (3 m, 3 nv) that takes displacements to u_first − u_second in the frames.

        Row a m + i is component a of pair i: the normal components come first.
        """
        m, frame, found = len(self.pairs), self.frame, []
        for side, sign in ((0, 1.0), (1, -1.0)):
            i = np.flatnonzero(self.pairs[:, side] >= 0)
            found += [
                (a * m + i, 3 * self.pairs[i, side] + c, sign * frame[i, a, c])
                for a in range(3)
                for c in range(3)
            ]
        rows, columns, values = (np.concatenate(each) for each in zip(*found, strict=True))
        return rows, columns, values

    def save(self, folder: Path) -> None:
        np.savez(folder / FILE, **asdict(self))


def read_case(folder: Path) -> Case:
    with np.load(folder / FILE) as file:
        return Case(
            **{name: file[name] if file[name].ndim else file[name].item() for name in file.files}
        )


@dataclass(frozen=True)
class Answer:
    """What is compared.

    Attributes
    ----------
    displacement : (nv, 3) of all nodes (m)
    force : (2,) of the compared contacts (N): normal, positive under pressure, and the length of its tangential part
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
    """From the displacement (3 nv,) of all nodes in m and the forces (3, m) of the pairs in their frames, in N."""
    first = case.contact < case.compared
    pushed = np.einsum("am,mac->c", s[1:, first], case.frame[first, 1:])
    return Answer(
        u.reshape(case.points.shape),
        np.array([s[0, first].sum(), np.linalg.norm(pushed)]),
        float((s[0] / case.area).max()),
        iterations,
    )


def along_and_across(case: Case, force: np.ndarray) -> np.ndarray:
    """The lengths (2,) of the parts of a force (3,) along the axis of the first contact and across it."""
    normal = case.axis @ force
    return np.array([abs(normal), np.linalg.norm(force - normal * case.axis)])


def read_answer(folder: Path) -> Answer:
    with np.load(folder / ANSWER) as file:
        return Answer(
            **{name: file[name] if file[name].ndim else file[name].item() for name in file.files}
        )


# ddmpi itself, the whole command as a user types it


def ddmpi_command(folder: Path) -> list[str]:
    return [
        "mpirun",
        "-n",
        "1",
        sys.executable,
        "-m",
        "ddmpi",
        "run",
        "scene.toml",
        "--no-figures",
        "--output",
        "results",
    ]


def clear_ddmpi(case: Case, folder: Path) -> None:
    shutil.rmtree(folder / "results", ignore_errors=True)


def read_ddmpi(case: Case, folder: Path) -> Answer:
    import h5py
    import msgspec

    summary = msgspec.json.decode((folder / "results" / "summary.json").read_bytes())
    contacts = list(summary["contacts"].values())
    force = sum(np.array(each["force"]) for each in contacts[: case.compared])
    with h5py.File(folder / "results" / "result.h5") as file:
        if np.abs(file["points"][:] - case.points).max() > 1e-9 * np.ptp(case.points):
            raise RuntimeError("ddmpi's nodes are in another order")
        u = file["displacement"][:]
    return Answer(
        u,
        along_and_across(case, force),
        max(each["pressure_max"] for each in contacts),
        summary["outer_iterations"],
    )


# CalculiX (calculix-ccx): contact by penalty springs or mortar, SPOOLES

STIFFNESS = STICK = 40.0
"""Of the contact springs, normal and while they stick, in Young's moduli per least edge."""

SMALL = 1e-3
"""The part of the load that solids on solids get, by whose inverse their answers are multiplied: without gaps those of
small strains are proportional to the load, and CalculiX computes with large rotations wherever there is contact."""

ELEMENTS = {4: "C3D4", 10: "C3D10"}
SIDES = [(0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)]
"""Corners of the sides of CalculiX's elements."""

CUBE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
"""The corners of the element that is the rigid plane; its upper side is the second one."""


def _lines(rows: Iterable) -> str:
    """Lines of CalculiX, whose numbers have at most 20 characters."""
    return "".join(
        ", ".join(f"{each:.13g}" if isinstance(each, float) else str(each) for each in row) + "\n"
        for row in rows
    )


def part_of_load(case: Case) -> float:
    return 1.0 if case.rigid else SMALL


def deck(case: Case, kind: str) -> str:
    """The input of CalculiX; `kind` of contact is what its manual names."""
    points, mortar = case.points, "MORTAR" in kind
    clamped = [(i // 3 + 1, i % 3 + 1, i % 3 + 1) for i in case.clamped.tolist()]
    base = np.intersect1d(case.clamped // 3, second_body(case)).tolist()
    rigid = ""
    if case.rigid:  # an element that cannot move
        size = 1.2 * np.ptp(points, axis=0).max()
        low = np.append(points.min(axis=0)[:-1] - 0.1 * size, -size)
        base = list(range(len(points), len(points) + len(CUBE)))
        points = np.vstack([points, low + size * np.array(CUBE)])
        clamped += [(i + 1, 1, 3) for i in base]
        rigid = "*ELEMENT, TYPE=C3D8, ELSET=BODIES\n" + _lines(
            [[len(case.cells) + 1, *(i + 1 for i in base)]]
        )
    lines = [
        "*NODE, NSET=ALL\n",
        _lines((i + 1, *x) for i, x in enumerate(points.tolist())),
        f"*ELEMENT, TYPE={ELEMENTS[case.cells.shape[1]]}, ELSET=BODIES\n",
        _lines((e + 1, *each) for e, each in enumerate((case.cells + 1).tolist())),
        rigid,
        "*NSET, NSET=BASE\n",
        _lines((i + 1,) for i in base),
        f"*MATERIAL, NAME=STEEL\n*ELASTIC\n{case.young!r}, {case.poisson!r}\n",
        "*SOLID SECTION, ELSET=BODIES, MATERIAL=STEEL\n1.0\n*BOUNDARY\n",
        _lines(clamped),
    ]
    for number in np.unique(case.side[:, 0]).tolist():
        second = f"{len(case.cells) + 1}, S2\n" if case.rigid else _lines(faces(case, number, 1))
        lines += [
            f"*SURFACE, NAME=FIRST{number}, TYPE=ELEMENT\n",
            _lines(faces(case, number, 0)),
            f"*SURFACE, NAME=SECOND{number}, TYPE=ELEMENT\n",
            second,
            f"*CONTACT PAIR, INTERACTION=TOUCH, TYPE={kind}\n",
            f"FIRST{number}, SECOND{number}\n",
        ]
    spring = case.young / case.spacing
    lines += [
        "*SURFACE INTERACTION, NAME=TOUCH\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=",
        "HARD\n" if mortar else f"LINEAR\n{STIFFNESS * spring!r}",
        "" if mortar else "\n",
    ]
    if case.friction:
        lines += [f"*FRICTION\n{case.friction!r}, {STICK * spring!r}\n"]
    load = [
        (i // 3 + 1, i % 3 + 1, value)
        for i, value in enumerate((part_of_load(case) * case.load).tolist())
        if value
    ]
    lines += [
        "*STEP, INC=1000\n*STATIC\n1., 1.\n*CLOAD\n",
        _lines(load),
        "*NODE PRINT, NSET=BASE, TOTALS=ONLY\nRF\n",
        "*NODE FILE\nU\n*CONTACT FILE\nCSTR\n*END STEP\n",
    ]
    return "".join(lines)


def second_body(case: Case) -> np.ndarray:
    """The nodes of the second body of the first contact, none of the rigid plane."""
    second = case.facets[(case.side == (0, 1)).all(axis=1)]
    bodies = np.unique(case.body[np.isin(case.cells, second).any(axis=1)])
    return np.unique(case.cells[np.isin(case.body, bodies)])


def faces(case: Case, contact: int, which: int) -> list[tuple[int, str]]:
    """The sides of elements that are the facets of the first (0) or second (1) body of a contact."""
    wanted, digits = (
        case.facets[(case.side == (contact, which)).all(axis=1), :3],
        len(case.points) ** np.arange(3),
    )
    sides = np.sort(case.cells[:, SIDES], axis=2) @ digits
    found = np.argwhere(np.isin(sides, np.sort(wanted, axis=1) @ digits))
    return [(e + 1, f"S{k + 1}") for e, k in found.tolist()]


def write_calculix(kind: str) -> Callable[[Case, Path], None]:
    def write(case: Case, folder: Path) -> None:
        for name in ("contact.dat", "contact.sta", "contact.frd"):
            (folder / name).unlink(missing_ok=True)
        (folder / "contact.inp").write_text(deck(case, kind), encoding="utf-8")

    return write


def calculix_command(folder: Path) -> list[str]:
    return ["ccx", "contact"]


def _table(text: str, title: str) -> np.ndarray:
    """The last table of that title."""
    blocks = text.split("\n\n")
    last = max(i for i, block in enumerate(blocks) if block.strip().startswith(title))
    return np.array([line.split() for line in blocks[last + 1].strip().splitlines()], float)


def nodal(text: str, name: str) -> tuple[list[int], np.ndarray]:
    """Nodes and values of the last results of that name in a .frd file of CalculiX; none where it has none."""
    lines = (
        [
            line
            for line in text.rpartition(f" -4  {name}")[2].split("\n -3", 1)[0].splitlines()
            if line.startswith(" -1")
        ]
        if f" -4  {name}" in text
        else []
    )
    return [int(line[3:13]) for line in lines], np.array(
        [[float(line[k : k + 12]) for k in range(13, len(line.rstrip()), 12)] for line in lines]
    )


def read_calculix(case: Case, folder: Path) -> Answer:
    """The resultant is what the second body's clamps leave of its loads."""
    text, part = (folder / "contact.dat").read_text(encoding="utf-8"), part_of_load(case)
    *_, last = increments = (folder / "contact.sta").read_text(encoding="utf-8").splitlines()[2:]
    if "U" in last.split()[2] or float(last.split()[4]) < 1.0:
        raise RuntimeError(f"no convergence beyond {float(last.split()[4]):.3g} of the load")
    load = part * case.load
    load[case.clamped] = 0.0  # not part of what CalculiX calls a reaction
    force = -_table(text, "total force")[0, :3] - load.reshape(-1, 3)[second_body(case)].sum(axis=0)
    results = (folder / "contact.frd").read_text(encoding="utf-8")
    pressure = nodal(results, "CONTACT")[1][:, 3]  # of faces, extrapolated to nodes
    u = nodal(results, "DISP")[1][: len(case.points)]
    return Answer(
        u / part,
        along_and_across(case, force) / part,
        float(pressure.max()) / part,
        sum(int(row.split()[3]) for row in increments),
    )
