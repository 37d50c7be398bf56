"""Mesh files, through meshio."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh, signed_double_areas

TRIANGLES, LINES = ("triangle", "triangle6"), ("line", "line3")
"""The element types of meshio that are read; those of second order must have straight sides."""

STRAIGHT = 1e-6
"""How far the middle node of a straight side may be off its place, as a fraction of the side."""


def read_mesh(path: Path, body: str) -> Mesh:
    """Read triangles and boundary lines with physical groups from a gmsh file, as a mesh of order 1.

    Of second-order elements, which must have straight sides, the corners are taken.
    Not collective. Raises InputError for a file that cannot be read, has other elements, has no
    named boundary groups, or is degenerate.
    """
    import meshio

    key = f"body.{body}.mesh.file"
    try:
        raw = meshio.gmsh.read(path)
    except Exception as error:  # meshio raises many kinds, some of them bare
        raise InputError(f"{key}: {path} is not a gmsh mesh that meshio can read "
                         f"({type(error).__name__}: {error})") from None
    other = sorted({c.type for c in raw.cells} - {*TRIANGLES, *LINES, "vertex"})
    if other:
        raise InputError(f"{key}: {path} has elements of type {', '.join(other)}; "
                         "triangles and boundary lines of first or second order are what is needed")
    triangles = np.concatenate([_corners(raw, kind, 3, f"{key}: {path}") for kind in TRIANGLES])
    # version 2 files repeat an element for each physical group that it is in
    triangles = triangles[np.sort(np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)[1])]
    if len(triangles) == 0:
        raise InputError(f"{key}: {path} has no triangles (gmsh saves only elements in physical groups)")
    if not np.isfinite(raw.points).all():
        raise InputError(f"{key}: {path} has coordinates that are not numbers")
    if np.ptp(raw.points[:, 2]) > 1e-9 * np.ptp(raw.points):
        raise InputError(f"{key}: {path} is not plane (its z coordinates differ)")
    points = np.asarray(raw.points[:, :2], float)
    tags = {int(tag): name for name, (tag, dimension) in raw.field_data.items() if dimension == 1}
    if not tags:
        raise InputError(f"{key}: {path} has no named physical groups of lines; "
                         "clamps, tractions and contact refer to boundaries by such names")
    sets = raw.cell_sets_dict  # of version 4 files, where an element may be in several groups
    groups = {name: [] for name in tags.values()}
    for kind in LINES:
        lines = _corners(raw, kind, 2, f"{key}: {path}")
        physical = raw.cell_data_dict.get("gmsh:physical", {}).get(kind, np.empty(0, int))
        for tag, name in tags.items():
            chosen = sets[name].get(kind, []) if name in sets else np.flatnonzero(physical == tag)
            groups[name].append(lines[chosen])

    used, renumbered = np.unique(triangles, return_inverse=True)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    points, triangles = points[used], renumbered.reshape(-1, 3)
    groups = {name: number[np.concatenate(lines)] for name, lines in groups.items()}
    if any((lines < 0).any() for lines in groups.values()):
        raise InputError(f"{key}: {path} has boundary lines that belong to no triangle")
    doubled = signed_double_areas(points, triangles)
    if np.abs(doubled).min() <= 1e-14 * np.abs(doubled).max():
        raise InputError(f"{key}: {path} has triangles without area")
    triangles[doubled < 0] = triangles[doubled < 0][:, [0, 2, 1]]
    return Mesh(points, triangles, groups)


def _corners(raw, kind: str, corners: int, label: str) -> np.ndarray:
    """The corners (k, 3) or ends (k, 2) of the elements of a kind; InputError where their sides are curved."""
    nodes = raw.cells_dict.get(kind, np.empty((0, corners), int)).astype(np.int64)
    for i, middle in enumerate(nodes.T[corners:]):
        start, end = raw.points[nodes[:, i]], raw.points[nodes[:, (i + 1) % corners]]
        off = np.linalg.norm(raw.points[middle] - (start + end) / 2, axis=1)
        if (off > STRAIGHT * np.linalg.norm(end - start, axis=1)).any():
            x, y = start[np.argmax(off)][:2]
            raise InputError(f"{label} has curved elements, as at ({x:.6g}, {y:.6g}); sides must be straight, with "
                             "the further nodes on their middles")
    return nodes[:, :corners]
