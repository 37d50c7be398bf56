"""Mesh files: read through meshio, and where it cannot read them, converted by gmsh first."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh, signed_double_areas
from ddmpi.system import interrupt

TRIANGLES, LINES, QUADS = ("triangle", "triangle6"), ("line", "line3"), ("quad", "quad8", "quad9")
"""The element types, in meshio's words, that are read; those of second order must have straight sides."""

EQUAL = 1e-6
"""Diagonals of a quadrilateral whose lengths differ by less than this part of them are equally long."""

STRAIGHT = 1e-6
"""How far the middle node of a straight side may lie from the side's midpoint, as a fraction of the side."""

PLANE = 1e-9
"""How far the z coordinates of a plane mesh may differ, as a fraction of its extent."""

FLAT = 1e-14
"""A triangle has no area if it is smaller than this fraction of the largest one."""


def read_mesh(path: Path, body: str, label: str = "") -> Mesh:
    """Read triangles and boundary lines with physical groups from a mesh file, as a mesh of order 1.

    Quadrilaterals are cut into triangles. Second-order elements must have straight sides; only their corners are kept.
    In formats without names of groups (MSH 1.0) a group is called by its number. Errors begin with `label`. Not
    collective. Raises InputError for a file that neither meshio nor gmsh can read, that has other elements or no named
    boundary groups, or that is degenerate.
    """
    label = label or f"body.{body}.mesh.file: {path}"
    raw = _load(path, label)
    other = sorted({c.type for c in raw.cells} - {*TRIANGLES, *LINES, *QUADS, "vertex"})
    if other:
        raise InputError(f"{label} has elements of type {', '.join(other)}; "
                         "only triangles, quadrilaterals and boundary lines of first or second order are supported")
    quads = _distinct(np.concatenate([_corners(raw, kind, 4, label) for kind in QUADS]))
    triangles = _distinct(np.concatenate([*(_corners(raw, kind, 3, label) for kind in TRIANGLES),
                                          cut_quadrilaterals(raw.points, quads)]))
    if len(triangles) == 0:
        raise InputError(f"{label} has no triangles; gmsh saves only elements in physical groups: "
                         'Physical Surface("body") = {1};')
    if not np.isfinite(raw.points).all():
        raise InputError(f"{label} has coordinates that are not numbers")
    if np.ptp(raw.points[:, 2]) > PLANE * np.ptp(raw.points):
        raise InputError(f"{label} is not plane (its z coordinates differ)")
    groups = _line_groups(raw, label)

    used, renumbered = np.unique(triangles, return_inverse=True)
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    points, triangles = np.asarray(raw.points[used, :2], float), renumbered.reshape(-1, 3)
    groups = {name: number[lines] for name, lines in groups.items()}
    if any((lines < 0).any() for lines in groups.values()):
        raise InputError(f"{label} has boundary lines that belong to no triangle")
    doubled = signed_double_areas(points, triangles)
    if np.abs(doubled).min() <= FLAT * np.abs(doubled).max():
        raise InputError(f"{label} has triangles without area")
    triangles[doubled < 0] = triangles[doubled < 0][:, [0, 2, 1]]
    return Mesh(points, triangles, groups, len(quads))


def file_order(path: Path, body: str) -> Literal[1, 2]:
    """The order of the elements in a mesh file: 2 if they have middle nodes. Not collective. Raises InputError."""
    raw = _load(path, f"body.{body}.mesh.file: {path}")
    return 2 if any(cells.type in (TRIANGLES[1], *QUADS[1:]) for cells in raw.cells) else 1


def cut_quadrilaterals(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Two triangles (2k, 3) for each quadrilateral (k, 4) by its corners in the plane `points`: cut along the shorter
    diagonal.

    Of equal diagonals it is the one that begins farthest to the left and below. The order in which a file names the
    corners makes no difference. A quadrilateral that is not convex is cut from its inner corner. Not collective.
    """
    corners = points[quads, :2]
    diagonals = np.linalg.norm(corners[:, :2] - corners[:, 2:], axis=2)
    left = (corners @ [1.0, 0.6]).argmin(axis=1) % 2  # ties of both are rare
    size = [signed_double_areas(corners.reshape(-1, 2), 4 * np.arange(len(quads))[:, None] + part)
            for part in np.array([[0, 1, 2], [0, 2, 3], [1, 2, 3], [1, 3, 0]])]
    fits = np.stack([size[0] * size[1] > 0.0, size[2] * size[3] > 0.0], axis=1)
    shorter = np.where(np.abs(np.diff(diagonals)[:, 0]) <= EQUAL * diagonals.max(axis=1), left,
                       diagonals.argmin(axis=1))
    chosen = np.where(fits.all(axis=1) | ~fits.any(axis=1), shorter, fits.argmax(axis=1))
    a, b, c, d = np.where(chosen[:, None] == 0, quads, np.roll(quads, -1, axis=1)).T
    return np.stack([a, b, c, c, d, a], axis=1).reshape(-1, 3)


def _load(path: Path, label: str):
    """The file as a mesh of meshio. Raises InputError where neither meshio nor gmsh can read it."""
    import meshio

    try:
        return meshio.gmsh.read(path)
    except Exception as error:  # meshio raises many kinds, some of them without a message
        refusal = f"meshio: {type(error).__name__} {error}"
    with tempfile.TemporaryDirectory() as folder:
        converted = Path(folder) / "converted.msh"
        try:
            _convert(path, converted)
            return meshio.gmsh.read(converted)
        except Exception as error:  # gmsh raises bare ones; meshio refuses a file without elements
            raise InputError(f"{label} is not a mesh that meshio or gmsh can read "
                             f"({refusal}; gmsh: {error})") from None


def _convert(path: Path, target: Path) -> None:
    """Write any mesh file that gmsh reads (MSH 1.0 and 4.0, among others) in MSH 4.1, binary and thus exact."""
    with gmsh_session() as gmsh:
        gmsh.open(str(path))
        name_groups(gmsh)
        for option, value in (("MshFileVersion", 4.1), ("Binary", 1), ("SaveAll", 1)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(target))


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


def _line_groups(raw, label: str) -> dict[str, np.ndarray]:
    """The lines (k, 2) of each named physical group of lines. Raises InputError where none is named."""
    tags = {int(tag): name for name, (tag, dimension) in raw.field_data.items() if dimension == 1}
    if not tags:
        raise InputError(f"{label} has no named physical groups of lines; "
                         "clamps, tractions and contacts refer to boundaries by such names: "
                         'Physical Curve("left") = {4};')
    sets = raw.cell_sets_dict  # of version 4 files, where an element may be in several groups
    groups: dict[str, list[np.ndarray]] = {name: [] for name in tags.values()}
    for kind in LINES:
        lines = _corners(raw, kind, 2, label)
        physical = raw.cell_data_dict.get("gmsh:physical", {}).get(kind, np.empty(0, int))
        for tag, name in tags.items():
            groups[name].append(lines[sets[name].get(kind, []) if name in sets else np.flatnonzero(physical == tag)])
    return {name: _distinct(np.concatenate(lines)) for name, lines in groups.items()}


def _distinct(elements: np.ndarray) -> np.ndarray:
    """Each element once, in the given order: up to version 2 a file repeats it for each group that it is in."""
    return elements[np.sort(np.unique(np.sort(elements, axis=1), axis=0, return_index=True)[1])]


def _corners(raw, kind: str, corners: int, label: str) -> np.ndarray:
    """The corners (k, 3) or ends (k, 2) of the elements of one type. Raises InputError where sides are curved."""
    nodes = raw.cells_dict.get(kind, np.empty((0, corners), int)).astype(np.int64)
    for i, middle in enumerate(nodes.T[corners:2 * corners]):
        start, end = raw.points[nodes[:, i]], raw.points[nodes[:, (i + 1) % corners]]
        off = np.linalg.norm(raw.points[middle] - (start + end) / 2, axis=1)
        if (off > STRAIGHT * np.linalg.norm(end - start, axis=1)).any():
            x, y = start[np.argmax(off)][:2]
            raise InputError(f"{label} has curved elements, as at ({x:.6g}, {y:.6g}); sides must be straight, with "
                             "the middle nodes on their midpoints: Mesh.SecondOrderLinear = 1; in gmsh")
    return nodes[:, :corners]
