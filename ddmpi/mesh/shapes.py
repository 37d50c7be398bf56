"""Meshes of simple shapes: grids of cells, cut into triangles or tetrahedra, and the positions of their nodes; balls
and cylinders, which gmsh meshes."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from ddmpi.mesh.elements import BRICKS
from ddmpi.mesh.mesh import Groups, Mesh, boundary_facets
from ddmpi.mesh.refine import raise_order
from ddmpi.scene.meshes import MeshSpec


def generate_rectangle(spec: MeshSpec) -> Mesh:
    """A rectangle or a box; touching ones of equal divisions match. Not collective."""
    assert spec.divisions and isinstance(spec.size, tuple)  # checked by the scene
    parameters, cells, sides = _grid(spec.divisions, spec.elements)
    # Exact multiples, so that both sides of an interface agree.
    return Mesh(
        np.array(spec.origin or (0.0,) * len(spec.size)) + parameters * spec.size, cells, sides
    )


def generate_quadrilateral(spec: MeshSpec) -> Mesh:
    """A convex quadrilateral or a hexahedron, whose groups and cells are those of a rectangle or a box.

    Nodes lie at equal parameters of the bilinear or trilinear map of the corners; in the plane the groups follow the
    corners in their order. Nodes on a side depend on its corners alone, and those at corners are the corners exactly.
    Where the sides are parallel to the axes, nodes are those of a rectangle. Not collective.
    """
    assert spec.divisions and spec.corners
    parameters, cells, sides = _grid(spec.divisions, spec.elements)
    x, y, *z = parameters.T[:, :, None]
    layers = [
        _between(_between(one, two, x), _between(four, three, x), y)
        for one, two, three, four in np.array(spec.corners).reshape(-1, 4, len(spec.divisions))
    ]
    return Mesh(_between(*layers, *z) if z else layers[0], cells, sides)


def generate_annulus(spec: MeshSpec) -> Mesh:
    """A part of a ring, counter-clockwise from ``start`` to ``end`` between ``inner`` and ``outer``.

    These groups are the four sides of a grid: the radius grows along its first direction, the angle along its second.
    A whole ring has neither start nor end. Sides of triangles are chords of the circles in order 1; in order 2 their
    middles are at the mean radius and angle of their ends: parabolas that nearly are arcs. Not collective.
    """
    assert spec.divisions and spec.center and spec.radii and spec.angles
    around, across = spec.divisions
    parameters, cells, sides = _grid((across, around), spec.elements, spec.closed)
    names = {"left": "inner", "right": "outer", "bottom": "start", "top": "end"}
    mesh = Mesh(
        parameters,
        cells,
        {
            name: sides[side]
            for side, name in names.items()
            if not (spec.closed and side in ("bottom", "top"))
        },
    )
    mesh = raise_order(mesh, "", spec.order or 1)
    if spec.closed:  # sides from the last nodes to the first go on to a whole turn
        angles = parameters[mesh.triangles[:, mesh.cell.between], 1]
        over = np.ptp(angles, axis=2) > 0.5
        mesh.points[mesh.triangles[:, mesh.cell.corners :][over], 1] += (angles[over] == 0.0).mean(
            axis=1
        )
    radius = _between(*spec.radii, mesh.points[:, 0])
    points = np.array(spec.center) + radius[:, None] * _directions(
        _between(*spec.angles, mesh.points[:, 1])
    )
    return replace(mesh, points=points)


def draw_shape(gmsh, spec: MeshSpec) -> None:
    """Draw a ball or a cylinder, with its groups, in a session of gmsh. Not collective."""
    assert spec.center
    cad = gmsh.model.occ
    height = spec.height or 0.0
    if spec.shape == "ball":
        cad.addSphere(*spec.center, spec.radius)
    else:
        assert spec.axis and spec.radii
        axis = np.array(spec.axis) / np.linalg.norm(spec.axis)
        solid, *bore = [
            (3, cad.addCylinder(*spec.center, *(height * axis), r)) for r in spec.radii[::-1] if r
        ]
        cad.cut([solid], bore) if bore else None
    cad.synchronize()
    groups: dict[str, list[int]] = {}
    for _, face in gmsh.model.getEntities(2):
        name = "surface"
        if spec.radii:  # an end, or the larger or smaller of the faces around
            up = np.dot(np.subtract(cad.getCenterOfMass(2, face), spec.center), axis) / height
            inner = cad.getMass(2, face) < np.pi * sum(spec.radii) * height
            name = "bottom" if up < 0.25 else "top" if up > 0.75 else "inner" if inner else "outer"
        groups.setdefault(name, []).append(face)
    for name, faces in groups.items():
        gmsh.model.addPhysicalGroup(2, faces, name=name)


def _solid_grid(
    divisions: Sequence[int], elements: str | None
) -> tuple[np.ndarray, np.ndarray, Groups]:
    """Nodes (·, 3) of a grid on the unit cube, its cells, and the facets of its sides ``left`` and ``right`` (x),
    ``front`` and ``back`` (y), ``bottom`` and ``top`` (z).

    Unless elements are bricks, each cell is cut into the six tetrahedra around its diagonal from the corner of least to
    that of greatest coordinates, one for each order in which a way along edges takes the axes (Kuhn 1960). Neighbours fit.
    """
    number = np.arange(np.prod([n + 1 for n in divisions])).reshape([n + 1 for n in divisions])

    def at(corner: np.ndarray) -> np.ndarray:
        """The nodes at this corner of all cells of the grid."""
        ends = zip(corner, divisions, strict=True)
        return number[tuple(slice(step, n + step) for step, n in ends)].ravel()

    if elements == "bricks":
        cells = np.stack([at(corner) for corner in np.array(BRICKS[3, 1].shape.corners)], axis=1)
    else:
        ways = [np.eye(3, dtype=int)[list(order)] for order in permutations(range(3))]
        paths = [np.cumsum([(0, 0, 0), *way], axis=0) for way in ways]
        cells = np.stack([[at(corner) for corner in path] for path in paths]).transpose(2, 0, 1)
        odd = [np.linalg.det(way) < 0 for way in ways]
        cells[:, odd] = cells[:, odd][:, :, [0, 2, 1, 3]]
        cells = cells.reshape(-1, 4)
    places = np.stack(np.unravel_index(np.arange(number.size), number.shape), axis=1)
    outer = boundary_facets(cells, 3)[0]
    names = ("left", "right", "front", "back", "bottom", "top")
    sides = {}
    for k, name in enumerate(names):
        axis = k // 2
        end = (k % 2) * divisions[k // 2]
        sides[name] = outer[(places[outer][:, :, axis] == end).all(axis=1)]
    return places / np.array(divisions), cells, sides


def _grid(
    divisions: Sequence[int], elements: str | None, closed: bool = False
) -> tuple[np.ndarray, np.ndarray, Groups]:
    """In space `_solid_grid`; in the plane the nodes (·, 2) of a grid on the unit square, its cells, bricks or cut into
    triangles, and the edges of its sides ``bottom``, ``right``, ``top`` and ``left``. Diagonals go from lower left to
    upper right.

    Corners come first, then the other nodes of the sides, both counter-clockwise, then the inner nodes by columns: the
    numbers that gmsh gives a transfinite surface; MUMPS's ordering depends on them. If `closed`, the top is the bottom.
    """
    if len(divisions) > 2:
        return _solid_grid(divisions, elements)
    sizes = np.array(divisions) + 1
    grid = np.arange(sizes.prod()).reshape(sizes)
    if closed:
        grid[:, -1] = grid[:, 0]
    sides = (grid[:, 0], grid[-1], grid[::-1, -1], grid[0, ::-1])
    order = np.concatenate(
        [[s[0] for s in sides], *(s[1:-1] for s in sides), grid[1:-1, 1:-1].ravel()]
    )
    if closed:
        order = order[np.sort(np.unique(order, return_index=True)[1])]
    number = np.empty(sizes.prod(), dtype=order.dtype)
    number[order] = np.arange(len(order))
    corners = [grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]]
    cells = number[np.stack(corners, axis=-1)].reshape(-1, 4)
    if elements != "bricks":
        cells = cells[:, [0, 1, 2, 2, 3, 0]].reshape(-1, 3)
    edges = {
        name: number[np.column_stack([side[:-1], side[1:]])]
        for name, side in zip(("bottom", "right", "top", "left"), sides, strict=True)
    }
    return np.column_stack(np.divmod(order, sizes[1])) / divisions, cells, edges


def _between(start, end, part: np.ndarray) -> np.ndarray:
    """Linear interpolation from `start` to `end`, exact at both."""
    return np.where(part == 1.0, end, start + part * (np.asarray(end) - start))


def _directions(degrees: np.ndarray) -> np.ndarray:
    """Unit vectors (·, 2) at angles in degrees, exact at multiples of 90 and equal in all quadrants."""
    quarters = np.floor(degrees / 90 + 0.5)
    rest = np.radians(degrees - 90 * quarters)
    turned = np.array([1, 1j, -1, -1j])[quarters.astype(int) % 4] * (
        np.cos(rest) + 1j * np.sin(rest)
    )
    return np.column_stack([turned.real, turned.imag])


SHAPES = {
    "rectangle": generate_rectangle,
    "box": generate_rectangle,
    "quadrilateral": generate_quadrilateral,
    "hexahedron": generate_quadrilateral,
    "annulus": generate_annulus,
}
"""The functions that generate the shapes."""
