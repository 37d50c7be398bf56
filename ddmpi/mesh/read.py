"""Mesh files: read through meshio, and where it cannot read them, converted by gmsh first."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import SIDES, Mesh, signed_double_areas
from ddmpi.mesh.refine import bend, raise_order
from ddmpi.system import interrupt

TRIANGLES, LINES = ("triangle", "triangle6"), ("line", "line3")
"""The element types, in meshio's words, that are read."""

STRAIGHT = 1e-6
"""How far the middle node of a straight side may lie from the side's midpoint, as a fraction of the side; it then
becomes the midpoint."""

PLANE = 1e-9
"""How far the z coordinates of a plane mesh may differ, as a fraction of its extent."""

FLAT = 1e-14
"""A triangle has no area if it is smaller than this fraction of the largest one."""


def read_mesh(path: Path, body: str, order: Literal[1, 2] = 1) -> Mesh:
    """Read triangles and boundary lines with physical groups from a mesh file, as a mesh of the `order`.

    In order 2 the sides of second-order elements are curved as they are in the file; in order 1 only corners are kept.
    Sides of first-order elements are straight. In formats without names of groups (MSH 1.0) a group is called by its
    number. Not collective. Raises InputError for a file that neither meshio nor gmsh can read, that has other elements
    or no named boundary groups, or that is degenerate.
    """
    label = f"body.{body}.mesh.file: {path}"
    raw = _load(path, label)
    other = sorted({c.type for c in raw.cells} - {*TRIANGLES, *LINES, "vertex"})
    if other:
        raise InputError(f"{label} has elements of type {', '.join(other)}; "
                         "only triangles and boundary lines of first or second order are supported (gmsh makes "
                         "triangles where neither Recombine nor Mesh.RecombineAll asks for others)")
    triangles = np.concatenate([_elements(raw, kind, 3) for kind in TRIANGLES])
    triangles = triangles[_distinct(triangles[:, :3])]
    if len(triangles) == 0:
        raise InputError(f"{label} has no triangles; gmsh saves only elements in physical groups: "
                         'Physical Surface("body") = {1};')
    if not np.isfinite(raw.points).all():
        raise InputError(f"{label} has coordinates that are not numbers")
    if np.ptp(raw.points[:, 2]) > PLANE * np.ptp(raw.points):
        raise InputError(f"{label} is not plane (its z coordinates differ)")
    groups = _line_groups(raw, label)

    bends = _bends(raw.points[:, :2], triangles) if order == 2 else None
    used, renumbered = np.unique(triangles[:, :3], return_inverse=True)
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    points, triangles = np.asarray(raw.points[used, :2], float), renumbered.reshape(-1, 3)
    groups = {name: number[lines] for name, lines in groups.items()}
    if any((lines < 0).any() for lines in groups.values()):
        raise InputError(f"{label} has boundary lines that belong to no triangle")
    doubled = signed_double_areas(points, triangles)
    if np.abs(doubled).min() <= FLAT * np.abs(doubled).max():
        raise InputError(f"{label} has triangles without area")
    turned = doubled < 0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    mesh = Mesh(points, triangles, groups)
    if bends is None:
        return mesh
    bends[turned] = bends[turned][:, [2, 1, 0]]
    return bend(raise_order(mesh, f"body.{body}.mesh"), bends)


def file_order(path: Path, body: str) -> Literal[1, 2]:
    """The order of the triangles in a mesh file: 2 if they have middle nodes. Not collective. Raises InputError."""
    raw = _load(path, f"body.{body}.mesh.file: {path}")
    return 2 if any(cells.type == TRIANGLES[1] for cells in raw.cells) else 1


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
        for dimension, tag in gmsh.model.getPhysicalGroups(1):
            if not gmsh.model.getPhysicalName(dimension, tag):
                gmsh.model.setPhysicalName(dimension, tag, str(tag))
        for option, value in (("MshFileVersion", 4.1), ("Binary", 1), ("SaveAll", 1)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(target))


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
        lines = _elements(raw, kind, 2)[:, :2]
        physical = raw.cell_data_dict.get("gmsh:physical", {}).get(kind, np.empty(0, int))
        for tag, name in tags.items():
            groups[name].append(lines[sets[name].get(kind, []) if name in sets else np.flatnonzero(physical == tag)])
    joined = {name: np.concatenate(lines) for name, lines in groups.items()}
    return {name: lines[_distinct(lines)] for name, lines in joined.items()}


def _distinct(elements: np.ndarray) -> np.ndarray:
    """The places of different elements: up to version 2 a file repeats one for each group that it is in."""
    return np.sort(np.unique(np.sort(elements, axis=1), axis=0, return_index=True)[1])


def _elements(raw, kind: str, corners: int) -> np.ndarray:
    """Elements (k, 6) or (k, 3) of one type: their corners or ends, and the middles of their sides, −1 if none."""
    nodes = raw.cells_dict.get(kind, np.empty((0, corners), int)).astype(np.int64)
    missing = (6 if corners == 3 else 3) - nodes.shape[1]
    return np.pad(nodes, ((0, 0), (0, missing)), constant_values=-1)


def _bends(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """How far (k, 3, 2) the middles of triangles (k, 6) are off those of their sides, if by more than STRAIGHT (m)."""
    start, end, middle = (points[triangles[:, each]] for each in SIDES.T)
    off = middle - (start + end) / 2
    far = np.linalg.norm(off, axis=2) > STRAIGHT * np.linalg.norm(end - start, axis=2)
    return np.where((far & (triangles[:, 3:] >= 0))[..., None], off, 0.0)
