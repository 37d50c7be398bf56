"""The mesh of one body: nodes, triangles and named boundary groups, from gmsh or through meshio."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ddmpi import interrupt
from ddmpi.errors import InputError
from ddmpi.scene import BodySpec, MeshSpec


@dataclass(frozen=True)
class Mesh:
    """Triangles of one body. Not distributed; every array is local to the body.

    Attributes
    ----------
    points : (nv, 2) float, metres
    triangles : (nt, 3) int, counter-clockwise
    groups : name → (k, 2) int, the boundary edges of each physical group
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
    for key, names in (("clamp", [c.on for c in body.clamps]), ("traction", [t.on for t in body.traction])):
        for name in names:
            boundary_group(mesh, name, f"body.{body.name}.{key}")
    return mesh


def boundary_group(mesh: Mesh, name: str, key: str) -> np.ndarray:
    """Edges (k, 2) of the group `name`; InputError naming `key` if the mesh has no such group."""
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
    return np.where(forward[:, None], edges, edges[:, ::-1])


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
    """Read first-order triangles and boundary lines with physical groups from a gmsh file.

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
    other = sorted({c.type for c in raw.cells} - {"triangle", "line", "vertex"})
    if other:
        raise InputError(f"{key}: {path} has elements of type {', '.join(other)}; "
                         "first-order triangles and boundary lines are what is needed")
    triangles = raw.cells_dict.get("triangle", np.empty((0, 3), int)).astype(np.int64)
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
    lines = raw.cells_dict.get("line", np.empty((0, 2), int)).astype(np.int64)
    physical = raw.cell_data_dict.get("gmsh:physical", {}).get("line", np.empty(0, int))
    sets = raw.cell_sets_dict  # of version 4 files, where an element may be in several groups
    members = {name: sets[name].get("line", []) if name in sets else np.flatnonzero(physical == tag)
               for tag, name in tags.items()}

    used, renumbered = np.unique(triangles, return_inverse=True)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    points, triangles, lines = points[used], renumbered.reshape(-1, 3), number[lines]
    if (lines < 0).any():
        raise InputError(f"{key}: {path} has boundary lines that belong to no triangle")
    doubled = signed_double_areas(points, triangles)
    if np.abs(doubled).min() <= 1e-14 * np.abs(doubled).max():
        raise InputError(f"{key}: {path} has triangles without area")
    triangles[doubled < 0] = triangles[doubled < 0][:, [0, 2, 1]]
    return Mesh(points, triangles, {name: lines[chosen] for name, chosen in members.items()})


def signed_double_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area (nt,) of each triangle (m²)."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def locate_mesh(body: BodySpec, folder: Path) -> Path:
    """The mesh file of `body`, looked for in `folder`, then in the current one. Raises InputError."""
    name = Path(body.mesh.file)
    places = [name] if name.is_absolute() else [folder / name, name]
    for place in places:
        if place.is_file():
            return place
    raise InputError(f"body.{body.name}.mesh.file: there is no file {' nor '.join(str(p) for p in places)}")
