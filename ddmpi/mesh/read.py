"""Mesh files: read through meshio; versions of MSH that it cannot read are converted by gmsh first."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np

from ddmpi.errors import InputError, InterruptionError
from ddmpi.mesh.boundary import boundary_facets
from ddmpi.mesh.elements import CELLS, EDGES
from ddmpi.mesh.mesh import MEASURE, PHYSICAL, Mesh, signed_measures
from ddmpi.mesh.refine import bend, raise_order
from ddmpi.scene.values import LARGEST
from ddmpi.system import interrupt

MSH = (b"$MeshFormat", b"$Comments", b"$NOD", b"$NOE")
"""How files of meshes by gmsh begin. Only these does it open: what it does not know it runs as a script."""

KINDS: dict[int, tuple[str, ...]] = {
    0: ("vertex",), 1: ("line", "line3"), 2: ("triangle", "triangle6", "quad", "quad8", "quad9"),
    3: ("tetra", "tetra10", "hexahedron", "hexahedron20", "hexahedron27", "wedge", "wedge15", "wedge18", "pyramid",
        "pyramid13", "pyramid14")}
"""The element types, in meshio's words, that are read, by dimension."""

SIMPLICES = ("vertex", "line", "triangle", "tetra")
"""By dimension; other elements are cut."""

SIDES: dict[str, list[tuple[int, int]]] = {
    **{shape: EDGES[d] for d, shape in enumerate(SIMPLICES) if d}, "quad": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "hexahedron": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
    "wedge": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
    "pyramid": [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)]}
"""Corners at the ends of the edges of an element, whose middles come in this order, which is VTK's."""

FACES: dict[str, list[tuple[int, ...]]] = {
    "hexahedron": [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
    "wedge": [(0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
    "pyramid": [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]}
"""Corners around the faces of an element."""

COMPLETE = {"wedge18": [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11],
            "pyramid14": [0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12]}
"""The order of VTK in elements with middles of faces, which meshio leaves in gmsh's."""

FORMATS = {".inp": "abaqus", ".med": "med", ".vtu": "vtu", ".vtk": "vtk"}
"""What meshio calls the formats of other programs, by the ending of a file. Files of all other endings are gmsh's."""

NUMBERED = ("cell_tags", "gmsh:physical", "CellEntityIds")
"""What numbers the groups of elements in these formats."""

ELEMENTS = {f"{family}{corners}{variant}": name
            for families, kinds in (
                (("CPE", "CPS", "CAX", "S"), {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"}),
                (("C3D",), {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15",
                            20: "hexahedron20"}))
            for corners, name in kinds.items() for family in families
            for variant in ("", "R", "H", "I", "M", "S", "RH", "IH", "MH", "HS")}
"""Abaqus's names of elements, of which meshio does not know all."""

HALVES = np.array([[[0, 1, 2], [2, 3, 0]], [[1, 2, 3], [3, 0, 1]]])
"""Corners of the triangles that a quadrilateral is cut into, along its first or its second diagonal."""

EQUAL = 1e-6
"""Diagonals of a quadrilateral whose lengths differ by less than this part of them are equally long."""

STRAIGHT = 1e-6
"""How far the middle node of a straight side may lie from the side's midpoint, as a fraction of the side; it then
becomes the midpoint."""

PLANE = 1e-9
"""How far the z coordinates of a plane mesh may differ, as a fraction of its extent."""

FLAT = 1e-14
"""A triangle has no area if it is smaller than this fraction of the largest one; for volumes its power 3/2."""


def read_mesh(path: Path, body: str, order: Literal[1, 2] = 1, label: str = "") -> Mesh:
    """Read triangles or tetrahedra, the groups of the boundary and points from a mesh file, as a mesh of the `order`.

    In order 2 the edges of second-order elements are curved as they are in the file; in order 1 only corners are kept.
    Edges of first-order elements are straight. Quadrilaterals are cut into triangles; hexahedra, prisms and pyramids
    into tetrahedra. Groups are physical groups of gmsh, sets of elements, and sets of nodes: the facets on the boundary
    whose corners are in the set, or else in space its edges, or else the nodes. In formats without names of groups
    (MSH 1.0, VTK) a group is called by its number. Errors begin with `label`. Not collective. Raises InputError for a
    file that cannot be read, that has other elements or no named boundary groups, or that is degenerate.
    """
    label = label or f"body.{body}.mesh.file: {path}"
    raw = _load(path, label)
    d, _ = _kind(raw)
    other = sorted({c.type for c in raw.cells} - {kind for kinds in KINDS.values() for kind in kinds})
    if other:
        raise InputError(f"{label} has elements of type {', '.join(other)}; only triangles, quadrilaterals, "
                         "tetrahedra, hexahedra, prisms, pyramids and lines of first or second order are supported")
    if not (np.abs(raw.points) <= LARGEST).all():
        raise InputError(f"{label} has coordinates that are not numbers, or above {LARGEST:g}")
    cells, bends, element, cut = _simplices(raw, d, raw.points[:, :d], order == 2)
    first, place = _distinct(cells)
    cells, bends = cells[first], bends[first]
    if len(cells) == 0:
        raise InputError(f"{label} has neither triangles nor tetrahedra; gmsh saves only elements in physical groups: "
                         'Physical Surface("body") = {1}; or Physical Volume("body") = {1};')
    if (np.ptp(raw.points[:, d:], axis=0) > PLANE * np.ptp(raw.points)).any():
        raise InputError(f"{label} is not plane (its z coordinates differ), and has no tetrahedra; a solid needs its "
                         'cells: Physical Volume("body") = {1};')
    groups, curves, vertices = _groups(raw, label, cells)
    surfaces = {name: np.unique(place[np.isin(element, members)]) for name, members in _members(raw, d).items()}

    used, renumbered = np.unique(cells, return_inverse=True)
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    points, cells = np.asarray(raw.points[used, :d], float), renumbered.reshape(-1, d + 1)
    groups = {name: number[facets] for name, facets in groups.items()}
    curves = {name: number[lines][(number[lines] >= 0).all(axis=1)] for name, lines in curves.items()}
    vertices = {name: number[nodes][number[nodes] >= 0] for name, nodes in vertices.items()}
    if any((facets < 0).any() for facets in groups.values()):
        raise InputError(f"{label} has boundary {CELLS[d, 1].facet_names} that belong to no {CELLS[d, 1].name}")
    measure = signed_measures(points, cells)
    if np.abs(measure).min() <= FLAT ** (d / 2) * np.abs(measure).max():
        raise InputError(f"{label} has {CELLS[d, 1].names} without {MEASURE[d]}")
    turned, swap = measure < 0, [*range(d - 1), d, d - 1]
    cells[turned] = cells[turned][:, swap]
    mesh = Mesh(points, cells, groups, vertices, surfaces, cut, curves)
    if order == 1:
        return mesh
    ends = [{swap[a], swap[b]} for a, b in EDGES[d]]
    bends[turned] = bends[turned][:, [ends.index(set(edge)) for edge in EDGES[d]]]
    return bend(raise_order(mesh, f"body.{body}.mesh"), bends)


def file_kind(path: Path, body: str) -> tuple[int, Literal[1, 2]]:
    """Dimension and order of the elements in a mesh file. Not collective. Raises InputError."""
    return _kind(_load(path, f"body.{body}.mesh.file: {path}"))


def _kind(raw) -> tuple[int, Literal[1, 2]]:
    """Dimension, 3 if there are solid elements, and order, 2 if those of this dimension have middle nodes."""
    types = {cells.type for cells in raw.cells}
    d = 3 if types & set(KINDS[3]) else 2
    return d, 2 if types & set(KINDS[d]) - SIDES.keys() else 1


def _simplices(raw, d: int, points: np.ndarray, curved: bool = False
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """All elements of dimension d, cut into simplices.

    Corners (n, d + 1), if `curved` the bends (n, e, ·) of their edges (m), of which element each is a part, counted
    through all KINDS, and how many different elements were cut.
    """
    cells, bends, element, before, cut = [], [], [], 0, 0
    for kind in KINDS[d]:
        nodes = raw.cells_dict.get(kind, np.empty((0, 27), int)).astype(np.int64)
        shape = kind.rstrip("0123456789")
        number = 1 + max(map(max, SIDES[shape]))
        corners, middles = nodes[:, :number], nodes[:, number:number + len(SIDES[shape])]
        parts = _parts(points, corners, shape)
        cells.append(np.take_along_axis(corners[:, None], parts, axis=2).reshape(-1, d + 1))
        found = np.zeros((*parts.shape[:2], len(EDGES[d]) * curved, points.shape[1]))
        if curved and kind != shape and len(nodes):
            off = _bends(points, corners, middles, np.array(SIDES[shape]))
            bent = np.flatnonzero(off.any(axis=(1, 2)))
            between = np.einsum("ijs,nsc->nijc", _weights(shape, number), off[bent])
            i, j = np.moveaxis(parts[bent][:, :, EDGES[d]], -1, 0)
            found[bent] = between[np.arange(len(bent))[:, None, None], i, j]
        bends.append(found.reshape(parts.shape[0] * parts.shape[1], *found.shape[2:]))
        element.append(before + np.repeat(np.arange(len(nodes)), parts.shape[1]))
        before += len(nodes)
        cut += len(_distinct(corners)[0]) if shape not in SIMPLICES else 0
    return np.concatenate(cells), np.concatenate(bends), np.concatenate(element), cut


def _parts(points: np.ndarray, corners: np.ndarray, shape: str) -> np.ndarray:
    """(n, parts, d + 1) which of its corners (n, k) the parts of each element have.

    In space every quadrilateral has its diagonal from its smallest node, so that neighbours fit, and an element is the
    pyramids over its other faces from its smallest node.
    """
    n, k = corners.shape
    if shape in SIMPLICES:
        return np.broadcast_to(np.arange(k), (n, 1, k))
    if shape == "quad":
        return HALVES[corners.argmin(axis=1) % 2 if points.shape[1] > 2 else shorter_diagonals(points, corners)]
    parts = np.empty((n, {"hexahedron": 6, "wedge": 3, "pyramid": 2}[shape], 4), int)
    smallest = corners.argmin(axis=1)
    for apex in range(k):
        own, faces = corners[smallest == apex], [np.array(face) for face in FACES[shape] if apex not in face]
        over = [face[HALVES[own[:, face].argmin(axis=1) % 2]] if len(face) == 4
                else np.broadcast_to(face, (len(own), 1, 3)) for face in faces]
        parts[smallest == apex] = np.pad(np.concatenate(over, axis=1), ((0, 0), (0, 0), (1, 0)), constant_values=apex)
    return parts


def _weights(shape: str, number: int) -> np.ndarray:
    """(k, k, s) the bend in the middle between two corners of a curved element, as a sum of those of its edges.

    As in serendipity elements a face's diagonal has half of the sum of its edges, a hexahedron's a quarter of the sum
    of all. Diagonals in the plane stay straight.
    """
    sides, weights = [set(side) for side in SIDES[shape]], np.zeros((number, number, len(SIDES[shape])))
    if shape == "hexahedron":
        weights += 0.25
    for face in FACES.get(shape, ()):
        weights[np.ix_(face, face)] = [0.5 * (side <= set(face)) for side in sides]
    for s, (i, j) in enumerate(SIDES[shape]):
        weights[[i, j], [j, i]] = np.eye(len(sides))[s]
    return weights


def shorter_diagonals(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Which diagonal (k,), 0 or 1, cuts each quadrilateral (k, 4) by its corners in the plane `points`: the shorter.

    Of equal diagonals it is the one that begins farthest to the left and below. The order in which a file names the
    corners makes no difference. A quadrilateral that is not convex is cut from its inner corner. Not collective.
    """
    corners = points[quads]
    diagonals = np.linalg.norm(corners[:, :2] - corners[:, 2:], axis=2)
    left = (corners @ [1.0, 0.6]).argmin(axis=1) % 2  # ties of both are rare
    size = [signed_measures(corners.reshape(-1, 2), 4 * np.arange(len(quads))[:, None] + part)
            for part in np.array([[0, 1, 2], [0, 2, 3], [1, 2, 3], [1, 3, 0]])]
    fits = np.stack([size[0] * size[1] > 0.0, size[2] * size[3] > 0.0], axis=1)
    shorter = np.where(np.abs(np.diff(diagonals)[:, 0]) <= EQUAL * diagonals.max(axis=1), left,
                       diagonals.argmin(axis=1))
    return np.where(fits.all(axis=1) | ~fits.any(axis=1), shorter, fits.argmax(axis=1))


def _load(path: Path, label: str):
    """The file as a mesh of meshio. Raises InputError where neither meshio nor gmsh can read it."""
    import meshio

    meshio._mesh.topological_dimension.update(dict.fromkeys(KINDS[3], 3))  # it does not know all
    kind = FORMATS.get(path.suffix.lower())
    if kind:
        meshio.abaqus._abaqus.abaqus_to_meshio_type.update(ELEMENTS)
        try:
            return _with_sets(getattr(meshio, kind).read(path))
        except Exception as error:
            raise InputError(f"{label} is not a mesh that meshio can read ({type(error).__name__} {error})") from None
    with open(path, "rb") as file:
        begin = file.read(len(MSH[0]))
    if not begin.startswith(MSH):
        raise InputError(f"{label} is not a mesh that meshio or gmsh can read: it does not begin with $MeshFormat; a "
                         "drawing is given by geometry = …")
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


def _read_msh(path: Path):
    """A file of gmsh as a mesh of meshio, nodes of all elements in the order of VTK."""
    import meshio

    raw = meshio.gmsh.read(path)
    for block in raw.cells:
        if block.type in COMPLETE:
            block.data = block.data[:, COMPLETE[block.type]]
    return raw


def _with_sets(raw):
    """A mesh of another program, with sets by name of what it numbers, and three coordinates."""
    numbers: list = next((raw.cell_data[kind] for kind in NUMBERED if kind in raw.cell_data), [])
    raw.cell_sets |= _sets(numbers, getattr(raw, "cell_tags", None))
    nodes = [raw.point_data["point_tags"]] if "point_tags" in raw.point_data else []
    raw.point_sets |= {name: own[0] for name, own in _sets(nodes, getattr(raw, "point_tags", None)).items()}
    raw.points, raw.field_data = np.pad(raw.points, ((0, 0), (0, 3 - raw.points.shape[1]))), {}
    if max((block.data.max(initial=0) for block in raw.cells), default=0) >= len(raw.points):
        raise ValueError("elements of nodes that are not there")
    return raw


def _sets(blocks: list, names: dict[int, list[str]] | None) -> dict[str, list[np.ndarray]]:
    """The entries of each of the `blocks` of numbers that a group has, by the names of the numbers, or by these."""
    found: dict[str, list[np.ndarray]] = {}
    for number in np.unique(np.concatenate(blocks)) if blocks else ():
        for name in names.get(number, ()) if names else [str(int(number))] * bool(number):
            own = [np.flatnonzero(np.asarray(block) == number) for block in blocks]
            before = found.get(name.strip(" \0"), own)
            found[name.strip(" \0")] = [np.union1d(*each) for each in zip(own, before, strict=True)]
    return found


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


def _groups(raw, label: str, cells: np.ndarray) -> tuple[dict[str, np.ndarray], ...]:
    """By name the facets (·, d) of each group of the boundary, in space the lines (·, 2) of curves, and nodes.

    Of a set of nodes the facets, or else the lines, or else the nodes. Raises InputError where no group has facets.
    """
    d, found = cells.shape[1] - 1, list[dict[str, np.ndarray]]()
    for dimension in range(d - 1, 0, -1):
        parts, _, element, _ = _simplices(raw, dimension, raw.points)
        own = {name: parts[np.isin(element, members)] for name, members in _members(raw, dimension).items()}
        found.append({name: facets[_distinct(facets)[0]] for name, facets in own.items()})
    alone: dict[str, np.ndarray] = {}
    if raw.point_sets and not raw.field_data:
        facets = boundary_facets(cells)[0]
        sides = [facets, facets[:, CELLS[d - 1, 1].edges].reshape(-1, 2)][:len(found)]
        sides = [np.unique(np.sort(each, axis=1), axis=0) for each in sides]
        for name, nodes in raw.point_sets.items():
            inside = [each[np.isin(each, nodes).all(axis=1)] for each in sides]
            first = next((k for k, each in enumerate(inside) if len(each)), len(found))
            if name not in raw.cell_sets:
                [*found, alone][first][name] = [*inside, np.asarray(nodes, int)][first]
    if not found[0]:
        raise InputError(f"{label} has no named physical groups of {CELLS[d - 1, 1].names}; clamps, tractions and "
                         'contacts refer to boundaries by such names: '
                         f'{PHYSICAL[d - 1].title()}("left") = {{4}};')
    points_of = raw.cells_dict.get("vertex", np.empty((0, 1), int))[:, 0]
    alone |= {name: np.unique(points_of[members]) for name, members in _members(raw, 0).items()}
    return found[0], {} if d == 2 else found[1], alone


def _members(raw, dimension: int) -> dict[str, np.ndarray]:
    """Which elements, counted through all KINDS, each named physical group of a dimension has."""
    kinds = KINDS[dimension]
    tags = {int(tag): name for name, (tag, of) in raw.field_data.items() if of == dimension}
    sets = raw.cell_sets_dict  # of version 4 files, where an element may be in several groups
    if not raw.field_data:
        tags |= {-k: name for k, name in enumerate(sets, 1) if not name.startswith("gmsh:")  # meshio's own
                 and any(len(sets[name].get(kind, ())) for kind in kinds)}
    members: dict[str, list[np.ndarray]] = {name: [] for name in tags.values()}
    before = 0
    for kind in kinds:
        physical = raw.cell_data_dict.get("gmsh:physical", {}).get(kind, np.empty(0, int))
        for tag, name in tags.items():
            own = sets[name].get(kind, ()) if name in sets else np.flatnonzero(physical == tag)
            members[name].append(before + np.asarray(own, int))
        before += len(raw.cells_dict.get(kind, ()))
    return {name: np.concatenate(own) for name, own in members.items()}


def _distinct(elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The places of different elements (k,), in the given order, and which of these each element is.

    Up to version 2 a file repeats an element for each group that it is in.
    """
    _, first, same = np.unique(np.sort(elements, axis=1), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return first[order], np.argsort(order)[same.ravel()]


def _bends(points: np.ndarray, corners: np.ndarray, middles: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """How far (n, s, ·) the middles (n, s) of edges are off those of their chords, if by more than STRAIGHT (m)."""
    start, end = (points[corners[:, each]] for each in sides.T)
    off = points[middles] - (start + end) / 2
    far = np.linalg.norm(off, axis=2) > STRAIGHT * np.linalg.norm(end - start, axis=2)
    return np.where(far[..., None], off, 0.0)
