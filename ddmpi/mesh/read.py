"""Mesh files: read through meshio; versions of MSH that it cannot read are converted by gmsh first."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from ddmpi.errors import InputError, InterruptionError
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh, signed_measures
from ddmpi.mesh.refine import bend, raise_order
from ddmpi.scene.values import LARGEST
from ddmpi.system import interrupt

MSH = (b"$MeshFormat", b"$Comments", b"$NOD", b"$NOE")
"""How files of meshes by gmsh begin. Only these does it open: what it does not know it runs as a script."""

TRIANGLES, LINES, QUADS = ("triangle", "triangle6"), ("line", "line3"), ("quad", "quad8", "quad9")
"""The element types, in meshio's words, that are read."""

FORMATS = {".inp": "abaqus", ".med": "med", ".vtu": "vtu", ".vtk": "vtk"}
"""What meshio calls the formats of other programs, by the ending of a file. Files of all other endings are gmsh's."""

NUMBERED = ("cell_tags", "gmsh:physical", "CellEntityIds")
"""What numbers the groups of elements in these formats."""

PLANE_ELEMENTS = {f"{kind}{corners}{variant}": name
                  for corners, name in ((3, "triangle"), (4, "quad"), (6, "triangle6"), (8, "quad8"))
                  for kind in ("CPE", "CPS", "CAX", "S") for variant in ("", "R", "H", "I", "M", "RH", "MH")}
"""Abaqus's names of plane elements, of which meshio does not know all."""

HALVES = np.array([[0, 1, 2, 4, 5, -1], [2, 3, 0, 6, 7, -1]])
"""Corners and middles of the triangles that a quadrilateral is cut into, and no middle of the cut."""

EQUAL = 1e-6
"""Diagonals of a quadrilateral whose lengths differ by less than this part of them are equally long."""

STRAIGHT = 1e-6
"""How far the middle node of a straight side may lie from the side's midpoint, as a fraction of the side; it then
becomes the midpoint."""

PLANE = 1e-9
"""How far the z coordinates of a plane mesh may differ, as a fraction of its extent."""

FLAT = 1e-14
"""A triangle has no area if it is smaller than this fraction of the largest one."""


def read_mesh(path: Path, body: str, order: Literal[1, 2] = 1, label: str = "") -> Mesh:
    """Read triangles, boundary lines and points with their groups from a mesh file, as a mesh of the `order`.

    In order 2 the sides of second-order elements are curved as they are in the file; in order 1 only corners are kept.
    Sides of first-order elements are straight. Quadrilaterals are cut into triangles. Groups are physical groups of
    gmsh, sets of elements, and sets of nodes: the sides on the boundary whose ends are in the set, or else the nodes.
    In formats without names of groups (MSH 1.0, VTK) a group is called by its number. Errors begin with `label`. Not
    collective. Raises InputError for a file that neither meshio nor gmsh can read, that has other elements or no named
    boundary groups, or that is degenerate.
    """
    label = label or f"body.{body}.mesh.file: {path}"
    raw = _load(path, label)
    other = sorted({c.type for c in raw.cells} - {*TRIANGLES, *LINES, *QUADS, "vertex"})
    if other:
        raise InputError(f"{label} has elements of type {', '.join(other)}; "
                         "only triangles, quadrilaterals and boundary lines of first or second order are supported")
    whole, quads = (np.concatenate([_elements(raw, kind, corners) for kind in kinds])
                    for kinds, corners in ((TRIANGLES, 3), (QUADS, 4)))
    triangles = np.concatenate([whole, cut_quadrilaterals(raw.points, quads)])
    first, place = _distinct(triangles[:, :3])
    triangles, cut = triangles[first], len(_distinct(quads[:, :4])[0])
    if len(triangles) == 0:
        raise InputError(f"{label} has no triangles; gmsh saves only elements in physical groups: "
                         'Physical Surface("body") = {1};')
    if not (np.abs(raw.points) <= LARGEST).all():
        raise InputError(f"{label} has coordinates that are not numbers, or above {LARGEST:g}")
    if np.ptp(raw.points[:, 2]) > PLANE * np.ptp(raw.points):
        raise InputError(f"{label} is not plane (its z coordinates differ)")
    groups, alone = _line_groups(raw, label, triangles)
    surfaces = {name: np.unique(place[_pieces(members, len(whole))])
                for name, members in _members(raw, 2, (*TRIANGLES, *QUADS)).items()}
    points_of = raw.cells_dict.get("vertex", np.empty((0, 1), int))[:, 0]
    vertices = alone | {name: np.unique(points_of[members]) for name, members in _members(raw, 0, ("vertex",)).items()}

    bends = _bends(raw.points[:, :2], triangles) if order == 2 else None
    used, renumbered = np.unique(triangles[:, :3], return_inverse=True)
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    points, triangles = np.asarray(raw.points[used, :2], float), renumbered.reshape(-1, 3)
    groups = {name: number[lines] for name, lines in groups.items()}
    vertices = {name: number[nodes][number[nodes] >= 0] for name, nodes in vertices.items()}
    if any((lines < 0).any() for lines in groups.values()):
        raise InputError(f"{label} has boundary lines that belong to no triangle")
    area = signed_measures(points, triangles)
    if np.abs(area).min() <= FLAT * np.abs(area).max():
        raise InputError(f"{label} has triangles without area")
    turned = area < 0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    mesh = Mesh(points, triangles, groups, vertices, surfaces, cut)
    if bends is None:
        return mesh
    bends[turned] = bends[turned][:, [2, 1, 0]]
    return replace(bend(raise_order(mesh, f"body.{body}.mesh"), bends), cut=cut)


def file_kind(path: Path, body: str) -> tuple[int, Literal[1, 2]]:
    """Dimension and order of the elements in a mesh file; the latter is 2 if they have middle nodes.

    Not collective. Raises InputError.
    """
    raw = _load(path, f"body.{body}.mesh.file: {path}")
    return 2, 2 if any(cells.type in (TRIANGLES[1], *QUADS[1:]) for cells in raw.cells) else 1


def cut_quadrilaterals(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Two triangles (2k, 3) for each quadrilateral (k, 4) by its corners in the plane `points`: cut along the shorter
    diagonal. With the middles of its sides (k, 8) those of the triangles, too, (2k, 6); −1 for that of the diagonal.

    Of equal diagonals it is the one that begins farthest to the left and below. The order in which a file names the
    corners makes no difference. A quadrilateral that is not convex is cut from its inner corner. Not collective.
    """
    corners = points[quads[:, :4], :2]
    diagonals = np.linalg.norm(corners[:, :2] - corners[:, 2:], axis=2)
    left = (corners @ [1.0, 0.6]).argmin(axis=1) % 2  # ties of both are rare
    size = [signed_measures(corners.reshape(-1, 2), 4 * np.arange(len(quads))[:, None] + part)
            for part in np.array([[0, 1, 2], [0, 2, 3], [1, 2, 3], [1, 3, 0]])]
    fits = np.stack([size[0] * size[1] > 0.0, size[2] * size[3] > 0.0], axis=1)
    shorter = np.where(np.abs(np.diff(diagonals)[:, 0]) <= EQUAL * diagonals.max(axis=1), left,
                       diagonals.argmin(axis=1))
    chosen = np.where(fits.all(axis=1) | ~fits.any(axis=1), shorter, fits.argmax(axis=1))
    turned = np.roll(quads.reshape(len(quads), quads.shape[1] // 4, 4), -1, axis=2).reshape(quads.shape)
    parts = np.pad(np.where(chosen[:, None] == 0, quads, turned), ((0, 0), (0, 1)), constant_values=-1)
    halves = HALVES[:, :3 * quads.shape[1] // 4]
    return parts[:, halves].reshape(-1, halves.shape[1])


def _pieces(members: np.ndarray, whole: int) -> np.ndarray:
    """Which triangles elements are, of which those from number `whole` on were cut into two."""
    cut = 2 * members[members >= whole] - whole
    return np.concatenate([members[members < whole], cut, cut + 1])


def _load(path: Path, label: str):
    """The file as a mesh of meshio. Raises InputError where neither meshio nor gmsh can read it."""
    import meshio

    kind = FORMATS.get(path.suffix.lower())
    if kind:
        meshio.abaqus._abaqus.abaqus_to_meshio_type.update(PLANE_ELEMENTS)
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
        return meshio.gmsh.read(path)
    except Exception as error:  # meshio raises many kinds, some of them without a message
        refusal = f"meshio: {type(error).__name__} {error}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        shutil.copyfile(path, folder / "old.msh")  # where no file of options lies beside it
        try:
            interrupt.apart(folder, _convert)
            return meshio.gmsh.read(folder / "converted.msh")
        except InterruptionError:
            raise
        except Exception as error:  # meshio refuses a file without elements
            raise InputError(f"{label} is not a mesh that meshio or gmsh can read "
                             f"({refusal}; gmsh: {error})") from None


def _with_sets(raw):
    """The mesh of another program, with sets by name of what it numbers; its points have three coordinates."""
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
    """Call the physical groups of lines that have no name by their numbers."""
    for dimension, tag in gmsh.model.getPhysicalGroups(1):
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


def _line_groups(raw, label: str, triangles: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The lines (k, 2) of each named group of lines or set of nodes, and the nodes of sets that have no sides.

    Raises InputError where no group has lines.
    """
    members = _members(raw, 1, LINES)
    lines = np.concatenate([_elements(raw, kind, 2)[:, :2] for kind in LINES])
    groups = {name: lines[own][_distinct(lines[own])[0]] for name, own in members.items()}
    alone: dict[str, np.ndarray] = {}
    if raw.point_sets and not raw.field_data:
        sides, count = np.unique(np.sort(triangles[:, CELLS[2, 1].edges].reshape(-1, 2), axis=1), axis=0,
                                 return_counts=True)
        for name, nodes in raw.point_sets.items():
            own = sides[(count == 1) & np.isin(sides, nodes).all(axis=1)]
            if name not in raw.cell_sets:
                (groups if len(own) else alone)[name] = own if len(own) else np.asarray(nodes, int)
    if not groups:
        raise InputError(f"{label} has no named physical groups of lines; "
                         "clamps, tractions and contacts refer to boundaries by such names: "
                         'Physical Curve("left") = {4};')
    return groups, alone


def _members(raw, dimension: int, kinds: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Which elements, counted through all `kinds`, each named physical group of a dimension has."""
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


def _elements(raw, kind: str, corners: int) -> np.ndarray:
    """Elements of one type by their corners or ends, and then the middles of their sides, −1 if none."""
    columns = 3 if corners == 2 else 2 * corners
    nodes = raw.cells_dict.get(kind, np.empty((0, corners), int)).astype(np.int64)[:, :columns]
    return np.pad(nodes, ((0, 0), (0, columns - nodes.shape[1])), constant_values=-1)


def _bends(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """How far (k, 3, 2) the middles of triangles (k, 6) are off those of their sides, if by more than STRAIGHT (m)."""
    start, end, middle = (points[triangles[:, each]] for each in CELLS[2, 2].edges.T)
    off = middle - (start + end) / 2
    far = np.linalg.norm(off, axis=2) > STRAIGHT * np.linalg.norm(end - start, axis=2)
    return np.where((far & (triangles[:, 3:] >= 0))[..., None], off, 0.0)
