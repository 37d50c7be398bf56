"""The mesh of one body: nodes, triangles and named boundary groups, from gmsh or through meshio.

Triangles have straight sides. Those of order 2 have a node on the middle of each side besides, which
`raise_order` puts there; all else is the same for both orders.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ddmpi import interrupt
from ddmpi.errors import InputError
from ddmpi.scene import BodySpec, MeshSpec

TRIANGLES, LINES = ("triangle", "triangle6"), ("line", "line3")
"""The element types of meshio that are read; those of second order must have straight sides."""

STRAIGHT = 1e-6
"""How far the middle node of a straight side may be off its place, as a fraction of the side."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one body. Not distributed; every array is local to the body.

    Attributes
    ----------
    points : (nv, 2) float, metres
    triangles : (nt, 3) int, corners counter-clockwise; of order 2 (nt, 6), then the middles of the sides
        01, 12, 20
    groups : name → (k, 2) int, the boundary edges of each physical group by their ends; of order 2
        (k, 3), then their middles
    """

    points: np.ndarray
    triangles: np.ndarray
    groups: dict[str, np.ndarray]

    @property
    def extent(self) -> float:
        """Diagonal of the bounding box (m)."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def build_mesh(body: BodySpec, folder: Path = Path(".")) -> Mesh:
    """Generate or read the mesh of `body` and check that it has the groups the body names.

    `folder` is where relative mesh files are looked for first (the scene's own folder), before the
    current directory. Not collective. Raises InputError.
    """
    spec = body.mesh
    mesh = generate_rectangle(spec) if spec.file is None else read_mesh(locate_mesh(body, folder), body.name)
    for _ in range(spec.halvings):
        mesh = halve(mesh, f"body.{body.name}.mesh")
    if spec.order == 2:
        mesh = raise_order(mesh, f"body.{body.name}.mesh")
    for key, names in (("clamp", [c.on for c in body.clamps]), ("traction", [t.on for t in body.traction])):
        for name in names:
            boundary_group(mesh, name, f"body.{body.name}.{key}")
    return mesh


def boundary_group(mesh: Mesh, name: str, key: str) -> np.ndarray:
    """Edges (k, 2 or 3) of the group `name`; InputError naming `key` if the mesh has no such group."""
    if name not in mesh.groups:
        raise InputError(f"{key}: the mesh has no boundary group {name!r}; it has {', '.join(sorted(mesh.groups))}")
    if len(mesh.groups[name]) == 0:
        raise InputError(f"{key}: the boundary group {name!r} of the mesh has a name, but no lines")
    return mesh.groups[name]


def turn_outward(mesh: Mesh, edges: np.ndarray, key: str) -> np.ndarray:
    """The edges turned so that the body lies to their left; InputError naming `key` for one inside the body."""
    size = len(mesh.points)
    marked = np.zeros(size, dtype=bool)
    marked[edges] = True
    t = mesh.triangles[np.count_nonzero(marked[mesh.triangles], axis=1) > 1]  # all others are out of the question
    around = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    keys = around[:, 0] * size + around[:, 1]
    forward = np.isin(edges[:, 0] * size + edges[:, 1], keys)
    backward = np.isin(edges[:, 1] * size + edges[:, 0], keys)
    if not (forward ^ backward).all():
        raise InputError(f"{key}: the group has lines that are not on the body's boundary")
    return np.where(forward[:, None], edges, edges[:, [1, 0, *range(2, edges.shape[1])]])


def segments(edges: np.ndarray) -> np.ndarray:
    """Pairs (·, 2) of neighbouring nodes on edges (k, 2 or 3), in the edges' direction."""
    walk = np.column_stack([edges[:, 0], edges[:, 2:], edges[:, 1]])
    return np.concatenate([walk[:, i:i + 2] for i in range(walk.shape[1] - 1)])


def raise_order(mesh: Mesh, key: str) -> Mesh:
    """The mesh of order 2 that has the corners of `mesh`, of order 1, as its first nodes.

    Not collective. Raises InputError naming `key` where a group has lines that are no sides of triangles.
    """
    size = len(mesh.points)

    def keys(edges: np.ndarray) -> np.ndarray:
        return edges.min(axis=-1) * size + edges.max(axis=-1)

    sides, number = np.unique(keys(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]]), return_inverse=True)
    groups = {}
    for name, edges in mesh.groups.items():
        place = np.minimum(np.searchsorted(sides, keys(edges)), len(sides) - 1)
        if not np.array_equal(sides[place], keys(edges)):
            raise InputError(f"{key}: the boundary group {name!r} has lines that are not sides of triangles")
        groups[name] = np.column_stack([edges, size + place])
    ends = np.divmod(sides, size)
    points = np.concatenate([mesh.points, (mesh.points[ends[0]] + mesh.points[ends[1]]) / 2])
    return Mesh(points, np.column_stack([mesh.triangles, size + number.reshape(-1, 3)]), groups)


def halve(mesh: Mesh, key: str) -> Mesh:
    """The mesh of order 1 with every side halved and every triangle cut in four alike.

    Not collective. Raises what `raise_order` does.
    """
    fine = raise_order(mesh, key)
    a, b, c, ab, bc, ca = fine.triangles.T
    parts = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    triangles = parts.transpose(2, 0, 1).reshape(-1, 3)
    return Mesh(fine.points, triangles, {name: segments(edges) for name, edges in fine.groups.items()})


def generate_rectangle(spec: MeshSpec) -> Mesh:
    """A rectangle of structured triangles, diagonals from lower left to upper right, by gmsh.

    Groups: ``left``, ``right``, ``bottom``, ``top``. Not collective.
    """
    import gmsh

    (x0, y0), (width, height), (nx, ny) = spec.origin, spec.size, spec.divisions
    # gmsh snaps what is closer than its own absolute tolerance, so it meshes the unit square.
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    interrupt.listen_again()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        geometry = gmsh.model.geo
        corners = [geometry.addPoint(x, y, 0.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines = [geometry.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(lines)])
        for line, divisions in zip(lines, (nx, ny, nx, ny), strict=True):
            geometry.mesh.setTransfiniteCurve(line, divisions + 1)
        geometry.mesh.setTransfiniteSurface(surface, "Right")
        geometry.synchronize()
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        number = np.empty(int(tags.max()) + 1, dtype=np.int64)
        number[tags.astype(np.int64)] = np.arange(len(tags))
        points = coordinates.reshape(-1, 3)[:, :2]
        triangles = number[gmsh.model.mesh.getElementsByType(2)[1].astype(np.int64)].reshape(-1, 3)
        groups = {name: number[gmsh.model.mesh.getElementsByType(1, line)[1].astype(np.int64)].reshape(-1, 2)
                  for name, line in zip(("bottom", "right", "top", "left"), lines, strict=True)}
    finally:
        gmsh.finalize()
        interrupt.listen_again()
    grid = np.rint(points * (nx, ny))  # exact multiples, so that both sides of an interface agree
    points = np.array([x0, y0]) + grid / (nx, ny) * (width, height)
    return Mesh(points, triangles, groups)


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


def signed_double_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area (nt,) of each triangle (m²)."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def locate_mesh(body: BodySpec, folder: Path) -> Path:
    """The mesh file of `body`, looked for in `folder`, then in the current one. Raises InputError."""
    name = Path(body.mesh.file)
    places = [name] if name.is_absolute() else [folder / name, name]
    tried = []
    for place in places:
        try:
            if stat.S_ISREG(os.stat(place).st_mode):
                return place
            tried.append(str(place))
        except FileNotFoundError:
            tried.append(str(place))
        except (OSError, ValueError) as error:  # a folder that may not be searched, a zero byte
            tried.append(f"{place} ({getattr(error, 'strerror', error)})")
    raise InputError(f"body.{body.name}.mesh.file: there is no file {' nor '.join(tried)}")
