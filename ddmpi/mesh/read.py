"""Mesh files: read through meshio; versions of MSH that it cannot read are converted by gmsh first."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from ddmpi.errors import InputError, InterruptionError
from ddmpi.mesh.boundary import file_groups, file_members, set_nodes
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import MEASURE, PHYSICAL, Mesh, refuse_overlaps, signed_measures
from ddmpi.mesh.refine import FACES, KINDS, SIDES, bend, distinct, raise_order, simplices
from ddmpi.scene.values import LARGEST
from ddmpi.system import interrupt

MSH = (b"$MeshFormat", b"$Comments", b"$NOD", b"$NOE")
"""First words of mesh files that gmsh may open: it runs unknown files as scripts."""

COMPLETE = {"wedge18": [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11],
            "pyramid14": [0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12]}
"""The order of VTK in elements with middles of faces, which meshio leaves in gmsh's."""

FORMATS = {".med": "med", ".vtu": "vtu", ".vtk": "vtk"}
"""Meshio's names of the formats of other programs, by ending. `Input` reads .inp; others are gmsh's."""

NUMBERED = ("cell_tags", "gmsh:physical", "CellEntityIds")
"""Names of the data that number the groups of elements in these formats."""

ELEMENTS: dict[str, dict[int, str]] = {
    "CPE|CPS|CPEG|CAX|CGAX|S|STRI|M3D|SFM3D|R3D": {3: "triangle", 4: "quad", 6: "triangle6", 65: "triangle6",
                                                   8: "quad8", 9: "quad9"},
    "C3D": {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20"},
    "T2D|T3D": {2: "line", 3: "line3"}, "B2|B3": {1: "line", 2: "line3", 3: "line"}}
"""Abaqus's names of elements: letters and a number; further letters are ignored."""

SHAPELESS = ("MASS", "ROTARYI", "SPRING", "DASHPOT", "CONN", "GAP", "DCOUP")
"""Prefixes of the names of elements that are skipped."""

GENERATING = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
"""Keywords that make nodes or elements from others, or move them; they are not read."""

MOST = 10**8
"""Largest number of members of a generated set."""

PLANE = 1e-9
"""Largest difference of the z coordinates of a plane mesh over its extent."""

FLAT = 1e-14
"""A triangle has no area if it is smaller than this fraction of the largest one; for volumes its power 3/2."""


def read_mesh(path: Path, body: str, order: int = 1, label: str = "") -> Mesh:
    """Read triangles or tetrahedra, the groups of the boundary and points from a mesh file, as a mesh of the `order`.

    In order 2 the edges of second-order elements are curved as they are in the file; in order 1 only corners are kept.
    Edges of first-order elements are straight. Quadrilaterals are cut into triangles; hexahedra, prisms and pyramids
    into tetrahedra. Groups are physical groups of gmsh, sets of elements, and sets of nodes: the facets on the boundary
    whose corners are in the set, or else in space its edges, and the nodes that these do not have. In formats without
    names of groups (MSH 1.0, VTK) a group is called by its number. Errors begin with `label`. Not collective. Raises
    InputError for a file that cannot be read, that has other elements or no named boundary groups, or is degenerate.
    """
    label = label or f"body.{body}.mesh.file: {path}"
    raw = _load(path, label)
    d, _ = _kind(raw)
    kind = CELLS[d, order]
    other = sorted({c.type for c in raw.cells} - {kind for kinds in KINDS.values() for kind in kinds})
    if other:
        raise InputError(f"{label} has elements of type {', '.join(other)}; only triangles, quadrilaterals, "
                         "tetrahedra, hexahedra, prisms, pyramids and lines of first or second order are supported")
    if not (np.abs(raw.points) <= LARGEST).all():
        raise InputError(f"{label} has coordinates that are not numbers, or above {LARGEST:g}")
    cells, bends, element, cut = simplices(raw, d, raw.points[:, :d], not kind.linear)
    first, place = distinct(cells)
    cells, bends = cells[first], bends[first]
    if len(cells) == 0:
        raise InputError(f"{label} has neither triangles nor tetrahedra; gmsh saves only elements in physical groups: "
                         'Physical Surface("body") = {1}; or Physical Volume("body") = {1};')
    if (np.ptp(raw.points[:, d:], axis=0) > PLANE * np.ptp(raw.points)).any():
        raise InputError(f"{label} is not plane (its z coordinates differ), and has no tetrahedra; a solid needs its "
                         'cells: Physical Volume("body") = {1};')
    groups, curves, vertices = file_groups(raw, label, cells)
    surfaces = {name: np.unique(place[np.isin(element, members)]) for name, members in file_members(raw, d).items()}

    used, renumbered = np.unique(cells, return_inverse=True)
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    points, cells = np.asarray(raw.points[used, :d], float), renumbered.reshape(-1, d + 1)
    groups = {name: number[facets] for name, facets in groups.items()}
    curves = {name: number[lines][(number[lines] >= 0).all(axis=1)] for name, lines in curves.items()}
    if any((facets < 0).any() for facets in groups.values()):
        raise InputError(f"{label} has boundary {kind.facet.names} that belong to no {kind.name}")
    measure = signed_measures(points, cells)
    if np.abs(measure).min() <= FLAT ** (d / 2) * np.abs(measure).max():
        raise InputError(f"{label} has {kind.names} without {MEASURE[d]}")
    turned, swap = measure < 0, [*range(d - 1), d, d - 1]
    cells[turned] = cells[turned][:, swap]
    mesh = Mesh(points, cells, groups, surfaces=surfaces, cut=cut, curves=curves)
    refuse_overlaps(mesh, label)
    ends = [sorted(swap[k] for k in corners) for corners in kind.between]
    bends[turned] = bends[turned][:, [ends.index(sorted(corners)) for corners in kind.between]]
    mesh = bend(raise_order(mesh, f"body.{body}.mesh", order), bends)
    return replace(mesh, vertices=set_nodes(raw, mesh, number, vertices))


def file_kind(path: Path, body: str) -> tuple[int, int]:
    """Dimension and order of the elements in a mesh file. Not collective. Raises InputError."""
    return _kind(_load(path, f"body.{body}.mesh.file: {path}"))


def _kind(raw) -> tuple[int, int]:
    """Dimension, 3 if there are solid elements, and the highest order of those of this dimension."""
    types = {cells.type for cells in raw.cells}
    d = 3 if types & KINDS[3].keys() else 2
    return d, max((KINDS[d][kind] for kind in types & KINDS[d].keys()), default=1)


def _load(path: Path, label: str):
    """The file as a mesh of meshio. Raises InputError where neither meshio nor gmsh can read it."""
    import meshio

    meshio._mesh.topological_dimension.update(dict.fromkeys(KINDS[3], 3))  # it does not know all
    kind = path.suffix.lower()
    if kind == ".inp":
        try:
            return Input(path).mesh()
        except (ValueError, OSError) as error:
            raise InputError(f"{label} is not a mesh that can be read: {error}") from None
        except (KeyError, IndexError, OverflowError, RecursionError) as error:
            raise InputError(f"{label} is not a mesh that can be read ({type(error).__name__} {error})") from None
    if kind in FORMATS:
        try:
            return _with_sets(getattr(meshio, FORMATS[kind]).read(path))
        except Exception as error:
            raise InputError(f"{label} is not a mesh that meshio can read ({type(error).__name__} {error})") from None
    with open(path, "rb") as file:
        begin = file.read(len(MSH[0]))
    if not begin.startswith(MSH):
        raise InputError(f"{label} is not a mesh that meshio or gmsh can read: it does not begin with $MeshFormat; a "
                         "drawing is given by geometry = …")
    _refuse_double_names(path, label)
    try:
        return _read_msh(path)
    except Exception as error:  # meshio raises many kinds, some of them without a message
        refusal = f"meshio: {type(error).__name__} {error}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        shutil.copyfile(path, folder / "old.msh")  # where no file of options lies beside it
        try:
            interrupt.apart(folder, _convert)
            return _read_msh(folder / "converted.msh")
        except InterruptionError:
            raise
        except Exception as error:  # meshio refuses a file without elements
            raise InputError(f"{label} is not a mesh that meshio or gmsh can read "
                             f"({refusal}; gmsh: {error})") from None


def _refuse_double_names(path: Path, label: str) -> None:
    """Raise InputError where groups of two dimensions have one name: meshio would forget one of them."""
    with open(path, encoding="utf-8", errors="replace") as file:
        head = "".join(takewhile(lambda line: not line.startswith(("$EndPhysicalNames", "$Nodes", "$NOD")), file))
    dimensions: dict[str, str] = {}
    for dimension, name in re.findall(r'^([0-3])\s+\d+\s+"(.*)"', head, re.MULTILINE):
        kinds = dimensions.setdefault(name, dimension), dimension
        if len(set(kinds)) > 1:
            one, other = (PHYSICAL[int(kind)] for kind in kinds)
            raise InputError(f"{label}: {name!r} is the name of both a {one} and a {other}; rename one")


def _read_msh(path: Path):
    """A file of gmsh as a mesh of meshio, nodes of all elements in the order of VTK."""
    import meshio

    raw = meshio.gmsh.read(path)
    _check_nodes(raw)
    for block in raw.cells:
        if block.type in COMPLETE:
            block.data = block.data[:, COMPLETE[block.type]]
    return raw


def _with_sets(raw):
    """A mesh of another program, with sets by name of what it numbers, and three coordinates."""
    numbers: list = next((raw.cell_data[kind] for kind in NUMBERED if kind in raw.cell_data), [])
    raw.cell_sets |= _sets(numbers, getattr(raw, "cell_tags", None))
    nodes = [raw.point_data["point_tags"]] if "point_tags" in raw.point_data else []
    raw.point_sets |= {name: blocks[0] for name, blocks in _sets(nodes, getattr(raw, "point_tags", None)).items()}
    raw.points, raw.field_data = np.pad(raw.points, ((0, 0), (0, 3 - raw.points.shape[1]))), {}
    _check_nodes(raw)
    return raw


def _check_nodes(raw) -> None:
    """Raise ValueError where elements have nodes that are not there."""
    if max((block.data.max(initial=0) for block in raw.cells), default=0) >= len(raw.points):
        raise ValueError("elements of nodes that are not there")


def _sets(blocks: list, names: dict[int, list[str]] | None) -> dict[str, list[np.ndarray]]:
    """The entries of each of the `blocks` of numbers that a group has, by the names of the numbers, or by these."""
    sets: dict[str, list[np.ndarray]] = {}
    for number in np.unique(np.concatenate(blocks)) if blocks else ():
        for name in names.get(number, ()) if names else [str(int(number))] * bool(number):
            members = [np.flatnonzero(np.asarray(block) == number) for block in blocks]
            before = sets.get(name.strip(" \0"), members)
            sets[name.strip(" \0")] = [np.union1d(*pair) for pair in zip(members, before, strict=True)]
    return sets


class Input:
    """What an input of Abaqus or CalculiX says of a mesh: nodes, elements, sets and surfaces.

    A part may stand in an assembly, once, moved or turned. Nodes and sets of the assembly itself, such as reference
    points, are left out, and so are internal sets. Names are alike whatever their case. Construction and `mesh` raise
    ValueError with the reason, OSError, and KeyError, IndexError or OverflowError where parameters or numbers are none.
    """

    def __init__(self, path: Path) -> None:
        self.points: dict[int, list[float]] = {}
        self.blocks: list[tuple[str, np.ndarray]] = []  # meshio's names of elements; their numbers and nodes
        self.sets: dict[str, dict[str, list]] = {"NSET": {}, "ELSET": {}, "SURFACE": {}}
        self.names: dict[tuple[str, str], str] = {}  # of sets that are not internal, as they are written
        self.place: list[list[float]] = []
        scopes = ["PART"]
        for word, given, rows in _keywords(path):
            if word in GENERATING:
                raise ValueError(f"*{word} is not supported; write all nodes and elements")
            if word in ("PART", "INSTANCE", "ASSEMBLY", "END INSTANCE"):
                if word in ("PART", "INSTANCE") and word in scopes[1:]:
                    raise ValueError(f"it has several {word.lower()}s; each body needs a file of its own")
                scopes.append("ASSEMBLY" if word == "END INSTANCE" else word)
                self.place += [[float(number) for number in row] for row in rows]
            elif scopes[-1] != "ASSEMBLY" or word == "SURFACE" or "INSTANCE" in given:
                self._take(word, given, rows)

    def _take(self, word: str, given: dict[str, str], rows: list[list[str]]) -> None:
        """Note what one keyword says."""
        if word == "NODE":
            self.points |= {int(row[0]): [float(word or 0.0) for word in [*row[1:], "", ""][:3]] for row in rows}
        elif word == "ELEMENT" and not given["TYPE"].upper().startswith(SHAPELESS):
            kind, number = _element(given["TYPE"])
            entries = [int(word) for row in rows for word in row if word]
            self.blocks.append((kind, np.array(entries).reshape(-1, 1 + number)))
            if "ELSET" in given:
                self._set("ELSET", given["ELSET"], self.blocks[-1][1][:, 0].tolist())
        elif word in ("NSET", "ELSET"):
            if "GENERATE" in given:
                runs = [range(int(row[0]), int(row[1]) + 1, int([*row, "1"][2])) for row in rows]
                if max(map(len, runs), default=0) > MOST:
                    raise ValueError(f"the set {given[word]} has more than {MOST} members")
                rows = [list(map(str, run)) for run in runs]
            self._set(word, given[word], [entry for row in rows for entry in row if entry], "INTERNAL" in given)
        elif word == "SURFACE" and given.get("TYPE", "").upper() == "NODE":
            self._set("NSET", given["NAME"], [row[0] for row in rows])
        elif word == "SURFACE":
            self._set(word, given["NAME"], rows)

    def _set(self, kind: str, name: str, entries: list, internal: bool = False) -> None:
        self.sets[kind].setdefault(name.lower(), []).extend(entries)
        if not internal:
            self.names.setdefault((kind, name.lower()), name)

    def _members(self, kind: str, what: str | int, within: tuple[str, ...] = ()) -> set[int]:
        """The numbers in a set and in the sets that it names, or the number itself."""
        if str(what).isdigit():
            return {int(what)}
        name = str(what).rpartition(".")[2].lower()
        if name in within or name not in self.sets[kind]:
            raise ValueError(f"the set {what} contains itself" if name in within else f"there is no set {what}")
        return set().union(*(self._members(kind, member, (*within, name)) for member in self.sets[kind][name]))

    def mesh(self):
        """All of it as a mesh of meshio; surfaces are elements between corners."""
        import meshio

        numbers = np.array(sorted(self.points), int)
        points = np.array([self.points[number] for number in numbers]).reshape(-1, 3)
        cells, groups, nothing = [], dict[str, list[np.ndarray]](), np.empty(0, int)
        for kind, entries in self.blocks:
            lost = np.setdiff1d(entries[:, 1:], numbers)
            if len(lost):
                raise ValueError(f"an element has node {lost[0]}, which is not there")
            cells.append((kind, np.searchsorted(numbers, entries[:, 1:])))

        def chosen(kind: str, what: str | int, among: np.ndarray) -> np.ndarray:
            return np.flatnonzero(np.isin(among, list(self._members(kind, what))))

        for key, name in self.names.items():
            if key[0] == "ELSET":
                groups[name] = [chosen(*key, entries[:, 0]) for _, entries in self.blocks]
        for key, name in self.names.items():
            for what, face in ([*row, ""][:2] for row in self.sets["SURFACE"].get(key[1] * (key[0] == "SURFACE"), [])):
                for (kind, entries), (_, nodes) in list(zip(self.blocks, cells, strict=False)):
                    elements = nodes[chosen("ELSET", what, entries[:, 0])]
                    if len(elements):
                        facets, before = elements[:, _face(kind, face.upper(), name)], groups.get(name, [])
                        groups[name] = [*before, *[nothing] * (len(cells) - len(before)), np.arange(len(facets))]
                        cells.append((("line", "triangle", "quad")[len(facets.T) - 2], facets))
        groups = {name: [*blocks, *[nothing] * (len(cells) - len(blocks))] for name, blocks in groups.items()}
        return meshio.Mesh(self._placed(points), cells, cell_sets=groups, point_sets={
            name: chosen(*key, numbers) for key, name in self.names.items() if key[0] == "NSET"})

    def _placed(self, points: np.ndarray) -> np.ndarray:
        """The points (n, 3) where the instance has them: shifted, then turned about an axis through two points."""
        from scipy.spatial.transform import Rotation

        for row in self.place[:1]:
            points = points + [*row, 0.0, 0.0][:3]  # of a plane part two coordinates will do
        for row in self.place[1:2]:
            start, axis = np.array(row[:3]), np.subtract(row[3:6], row[:3])
            turn = Rotation.from_rotvec(np.radians(row[6]) * axis / np.linalg.norm(axis))
            points = start + turn.apply(points - start)
        return points


def _keywords(path: Path, within: tuple[Path, ...] = ()) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Each keyword of an input and of those that it includes, its parameters, and the entries of its data lines."""
    if path in within:
        raise ValueError(f"{path} includes itself")
    lines = [line.strip() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()]
    lines = [line for line in lines if line and not line.startswith("**")]
    starts = [k for k, line in enumerate(lines) if line.startswith("*")]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        head, first = lines[start], start + 1
        while head.endswith(",") and first < end:
            head, first = head + lines[first], first + 1
        word, *rest = head[1:].split(",")
        word, parts = " ".join(word.split()).upper(), [entry.partition("=") for entry in rest]
        given = {name.strip().upper(): value.strip().strip('"') for name, _, value in parts}
        if word == "INCLUDE":
            yield from _keywords(path.parent / given["INPUT"], (*within, path))
        else:
            yield word, given, [[entry.strip() for entry in line.rstrip(", ").split(",")] for line in lines[first:end]]


def _element(name: str) -> tuple[str, int]:
    """What meshio calls an element of Abaqus, and the number of its nodes."""
    for families, kinds in ELEMENTS.items():
        found = re.match(rf"({families})(\d+)", name.upper())
        if found and int(found[2]) in kinds:
            kind = kinds[int(found[2])]
            return kind, int(re.sub(r"\D", "", kind) or 1 + max(map(max, SIDES[kind])))
    raise ValueError(f"the element type {name} is not known")


def _face(kind: str, face: str, surface: str) -> list[int]:
    """The corners of the face S1, S2, … of an element, or of the whole of a shell (SPOS, SNEG)."""
    shape = re.sub(r"\d", "", kind)
    faces = FACES.get(shape) or ([(0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3)] if shape == "tetra" else SIDES[shape])
    if face in ("SPOS", "SNEG") and shape in ("triangle", "quad"):
        return list(range(len(faces)))
    if not re.fullmatch(r"[SE]\d", face) or not 1 <= int(face[1]) <= len(faces):
        raise ValueError(f"the surface {surface} has {face or 'no'} face of a {shape}; these are S1 to S{len(faces)}")
    return list(faces[int(face[1]) - 1])


def _convert() -> None:
    """Write "old.msh", of any version, in MSH 4.1, binary and thus exact; for a process that does nothing else."""
    with gmsh_session() as gmsh:
        try:
            gmsh.open("old.msh")
        except Exception as error:  # gmsh raises bare ones
            raise InputError(str(error)) from None
        name_groups(gmsh)
        for option, value in (("MshFileVersion", 4.1), ("Binary", 1), ("SaveAll", 1)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write("converted.msh")


def name_groups(gmsh) -> None:
    """Call the physical groups of a boundary that have no name by their numbers."""
    for dimension, tag in gmsh.model.getPhysicalGroups(2 if gmsh.model.getEntities(3) else 1):
        if not gmsh.model.getPhysicalName(dimension, tag):
            gmsh.model.setPhysicalName(dimension, tag, str(tag))


@contextmanager
def gmsh_session() -> Iterator:
    """The module gmsh, initialized and silent, for a ``with`` statement; then it is finalized. Not collective.

    The PETSc within gmsh takes the signals for itself; our handlers are put back.
    """
    import gmsh

    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    interrupt.listen_again()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh
    finally:
        gmsh.finalize()
        interrupt.listen_again()
