"""Finer meshes, sizes of their elements, meshes of order 2, and other cells cut into simplices."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.decks import cards
from ddmpi.decks.cards import FACES, SIDES, are_upright
from ddmpi.errors import InputError
from ddmpi.mesh.elements import BRICKS, CELLS, CUTS, Cell, cell_with
from ddmpi.mesh.mesh import Groups, Mesh, signed_measures
from ddmpi.system.numbers import SAME

KINDS = {
    0: {"vertex": 1},
    1: {"line": 1, "line3": 2},
    2: {"triangle": 1, "triangle6": 2, "quad": 1, "quad8": 2, "quad9": 2},
    3: {
        "tetra": 1,
        "tetra10": 2,
        "hexahedron": 1,
        "hexahedron20": 2,
        "hexahedron27": 2,
        "wedge": 1,
        "wedge15": 2,
        "wedge18": 2,
        "pyramid": 1,
        "pyramid13": 2,
        "pyramid14": 2,
    },
}
"""The orders of the element types that are read, by dimension and meshio's words."""

SIMPLICES = ("vertex", "line", "triangle", "tetra")
"""Simplices by dimension; other elements are cut."""

HALVES = np.array([[[0, 1, 2], [2, 3, 0]], [[1, 2, 3], [3, 0, 1]]])
"""Corners of the triangles that a quadrilateral is cut into, along its first or its second diagonal."""

FIVE = np.array(
    [
        [[0, 2, 5, 7], [1, 0, 2, 5], [3, 0, 7, 2], [4, 0, 5, 7], [6, 2, 7, 5]],
        [[1, 3, 4, 6], [0, 1, 3, 4], [2, 1, 6, 3], [5, 1, 4, 6], [7, 3, 6, 4]],
    ]
)
"""Corners of the tetrahedra that a hexahedron is cut into, by diagonals between its corners 0, 2, 5, 7 or the rest."""

GRADE = 0.3
"""Largest slope of the size of elements over the distance."""


@dataclass(frozen=True)
class Sizes:
    """Prescribed sizes (k,) of the sides of a body's elements (m), linear on cells (t, d + 1) of the last mesh, with
    points (k, d)."""

    points: np.ndarray
    triangles: np.ndarray
    sizes: np.ndarray


def raise_order(mesh: Mesh, key: str, order: int = 2) -> Mesh:
    """The mesh with nodes of the `order` appended to those of a linear one; `mesh` itself if it has at least the order.

    Not collective. Raises InputError, naming `key`, where lines or triangles of a group are not sides of cells.
    """
    if mesh.order >= order:
        return mesh
    size = len(mesh.points)

    def keys(cells: np.ndarray, d: int) -> np.ndarray:
        corners = np.sort(cells[:, cell_with(cells.shape[1], d).of_order(order).between])
        return np.ravel_multi_index(tuple(np.moveaxis(corners, -1, 0)), (size,) * order)

    def of_groups(groups: Groups, d: int) -> Groups:
        result = {}
        for name, facets in groups.items():
            wanted = keys(facets, d)
            place = np.minimum(np.searchsorted(new, wanted), len(new) - 1)
            if not np.array_equal(new[place], wanted):
                raise InputError(
                    f"{key}: the group {name!r} has {cell_with(facets.shape[1], d).names} that are not "
                    f"sides of {mesh.cell.names}"
                )
            result[name] = np.column_stack([facets, size + place])
        return result

    of_cells = keys(mesh.triangles, mesh.dimension)
    new, number = np.unique(of_cells, return_inverse=True)
    between = np.unravel_index(new, (size,) * order)
    points = np.concatenate([mesh.points, sum(mesh.points[corner] for corner in between) / order])
    cells = np.column_stack([mesh.triangles, size + number.reshape(of_cells.shape)])
    groups = of_groups(mesh.groups, mesh.dimension - 1)
    curves = of_groups(mesh.curves, 1)
    return replace(mesh, points=points, triangles=cells, groups=groups, curves=curves)


def bend(mesh: Mesh, bends: np.ndarray) -> Mesh:
    """The straight mesh with its nodes moved off by `bends` (nt, k − c, d) (m), as of `Cell.bends`.

    Cells that share a node have the same bend for it, or zero, which does not count.
    """
    bent = bends.any(axis=2)
    points = mesh.points.copy()
    points[mesh.triangles[:, mesh.cell.corners :][bent]] += bends[bent]
    return replace(mesh, points=points)


def halve(mesh: Mesh, key: str) -> Mesh:
    """The mesh of the same order with every edge halved: every cell in the plane cut into four, in space into eight.

    The octahedron within a tetrahedron is cut around its shortest diagonal (Bey 1995). Curved cells are cut along their
    maps. Not collective. Raises InputError as `raise_order` does.
    """
    if not mesh.cell.simplex:
        return _halved_bricks(mesh, key)
    fine = raise_order(mesh, key)
    d = mesh.dimension
    ways = CUTS[d]
    lengths = np.linalg.norm(
        np.diff(fine.points[fine.triangles[:, ways[:, -1, :2]]], axis=2)[:, :, 0], axis=2
    )
    way = (lengths <= (1.0 + SAME) * lengths.min(axis=1, keepdims=True)).argmax(axis=1)
    parts = ways[way]
    number = parts.shape[1]
    halved = replace(
        mesh,
        points=fine.points,
        triangles=np.take_along_axis(fine.triangles[:, None], parts, axis=2).reshape(-1, d + 1),
        groups={name: fine.cell.facet.split(facets) for name, facets in fine.groups.items()},
        curves={name: CELLS[1, fine.order].split(lines) for name, lines in fine.curves.items()},
        surfaces=_of_parts(mesh, number),
    )
    shapes = mesh.cell.shapes(mesh.cell.nodes @ fine.cell.nodes[ways])  # at the nodes of the parts
    shares = mesh.cell.bends(shapes, 0.0)[
        ..., mesh.cell.corners :
    ]  # what bends of a cell give those of its parts
    bends = np.zeros((len(parts), number, len(mesh.cell.between), d))
    for cells in mesh.summed_blocks():
        bends[cells] = (
            shares[way[cells]] @ mesh.cell.bends(mesh.points[mesh.triangles[cells]])[:, None]
        )
    return bend(raise_order(halved, key, mesh.order), bends.reshape(len(halved.triangles), -1, d))


def _lattice(cell: Cell) -> tuple[np.ndarray, np.ndarray]:
    """Hats (3^d, c) of a product of lines at the corners of its halves, and the numbers (2^d, c) of these corners."""
    d = cell.dimension
    corners = np.array(cell.shape.corners)
    at = np.indices((3,) * d).reshape(d, -1, 1) / 2
    parts = np.indices((2,) * d).reshape(d, -1, 1) + corners.T[:, None]
    hats = cell.hats_at(np.concatenate([1.0 - at, at], axis=2).swapaxes(0, 1).reshape(-1, 2 * d))
    return hats, np.ravel_multi_index(tuple(parts), (3,) * d)


def _halved_bricks(mesh: Mesh, key: str) -> Mesh:
    """`halve` of products of lines. A new node is known by the corners whose mean it is, of an edge, a face or a cell."""
    raise_order(mesh, key)  # groups are sides of cells
    cell = mesh.cell
    d = mesh.dimension
    groups = mesh.groups
    curves = mesh.curves
    every = [
        (cell.straight, mesh.triangles),
        *((cell.facet.straight, facets) for facets in groups.values()),
        *((CELLS[1, 1], lines) for lines in curves.values()),
    ]
    rows = list[np.ndarray]()
    for of, cells in every:
        of_corners = np.where(_lattice(of)[0] > 0.0, cells[:, None, : of.corners], -1)
        short = cell.corners - of.corners
        wide = np.pad(of_corners, ((0, 0), (0, 0), (0, short)), constant_values=-1)
        rows.append(np.sort(wide.reshape(-1, cell.corners), axis=1))
    _, first, number = np.unique(
        np.concatenate(rows), axis=0, return_index=True, return_inverse=True
    )
    numbers = np.split(number.ravel(), np.cumsum(list(map(len, rows)))[:-1])
    of_parts = [
        found.reshape(len(cells), -1)[:, _lattice(of)[1]]
        for (of, cells), found in zip(every, numbers, strict=True)
    ]
    sides = [
        each.swapaxes(0, 1).reshape(-1, each.shape[2]) for each in of_parts[1:]
    ]  # first parts first
    nodes = mesh.points[mesh.triangles]
    hats, parts = _lattice(cell)
    same = (cell.nodes[:, None] == hats).all(axis=2).argmax(axis=1)
    renumbered = np.empty(len(mesh.points), int)
    renumbered[mesh.triangles] = numbers[0].reshape(len(nodes), -1)[:, same]
    halved = replace(
        mesh,
        points=(cell.shapes(hats) @ nodes).reshape(-1, d)[first],
        triangles=of_parts[0].reshape(-1, cell.corners),
        groups=dict(zip(groups, sides, strict=False)),
        curves=dict(zip(curves, sides[len(groups) :], strict=True)),
        vertices={name: renumbered[some] for name, some in mesh.vertices.items()},
        surfaces=_of_parts(mesh, len(parts)),
    )
    places = cell.shapes(cell.nodes @ hats[parts]) @ nodes[:, None]
    bends = cell.bends(places).reshape(len(halved.triangles), -1, d)
    return bend(raise_order(halved, key, mesh.order), bends)


def _of_parts(mesh: Mesh, number: int) -> Groups:
    """The surfaces of a mesh by the numbers of the parts of its cells, of which each has this number."""
    return {
        name: (number * members[:, None] + np.arange(number)).ravel()
        for name, members in mesh.surfaces.items()
    }


Elements = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Corners of cells (n, c), the bends (n, e, ·) of their edges (m), and the elements (n,) that they are parts of, counted
through all KINDS."""


def simplices(raw, d: int, points: np.ndarray, curved: bool = False) -> Elements:
    """All elements of dimension d, cut into simplices; with bends if `curved`."""
    found = []
    before = 0
    rank = _ranks(raw, len(points))
    for kind in KINDS[d]:
        shape, corners, middles = _of_kind(raw, kind)
        parts = _cuts(points, corners, shape, rank[corners])
        cells = np.take_along_axis(corners[:, None], parts, axis=2).reshape(-1, d + 1)
        bow = np.zeros((*parts.shape[:2], len(CELLS[d, 1].edges) * curved, points.shape[1]))
        if curved and kind != shape and len(corners):
            off = _bows(points, corners[:, np.array(SIDES[shape])], middles)
            bent = np.flatnonzero(off.any(axis=(1, 2)))
            between = np.einsum("ijs,nsc->nijc", _weights(shape, corners.shape[1]), off[bent])
            i, j = np.moveaxis(parts[bent][:, :, CELLS[d, 1].edges], -1, 0)
            bow[bent] = between[np.arange(len(bent))[:, None, None], i, j]
        element = before + np.repeat(np.arange(len(corners)), parts.shape[1])
        found.append((cells, bow.reshape(len(cells), *bow.shape[2:]), element))
        before += len(corners)
    return _joined(found)


def bricks(raw, d: int, points: np.ndarray, curved: bool = False) -> Elements:
    """The same as `simplices` gives, of the quadrilaterals or hexahedra of dimension d, or lines, uncut."""
    cell = BRICKS[d, 2]
    before = 0
    found = []
    for kind in KINDS[d]:
        shape, corners, middles = _of_kind(raw, kind)
        if shape == cell.shape.kind:
            bow = np.zeros((len(corners), len(cell.between) * curved, points.shape[1]))
            if curved and kind != shape:
                bow = _bows(points, corners[:, cell.between], middles)
            found.append((corners, bow, before + np.arange(len(corners))))
        before += len(corners)
    return _joined(found)


def _joined(found: list[Elements]) -> Elements:
    """Those of all kinds."""
    cells, bends, element = map(np.concatenate, zip(*found, strict=True))
    return cells, bends, element


def _bows(points: np.ndarray, ends: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """The bends (n, e, ·) of edges by the nodes at their `ends` (n, e, 2) and in their `middles` (n, e) (m)."""
    nodes = np.concatenate([ends, middles[..., None]], axis=2)
    return CELLS[1, 2].bends(points[nodes], SAME)[:, :, 0]


def kinds_among(raw, d: int, some: np.ndarray | None) -> list[str]:
    """The kinds of all elements of dimension d, or of `some` of them, counted through all KINDS."""
    kinds = list(KINDS[d])
    counts = [len(raw.cells_dict.get(kind, ())) for kind in kinds]
    number = np.repeat(np.arange(len(kinds)), counts)
    return [kinds[k] for k in np.unique(number if some is None else number[some])]


def are_bricks(raw, d: int, some: np.ndarray | None) -> bool:
    """Whether all elements of dimension d, or `some` of them, counted through all KINDS, are quadrilaterals, or
    hexahedra, whose maps by their corners turn nowhere."""
    cell = BRICKS[d, 1]
    own = {cards.shape(kind) for kind in kinds_among(raw, d, some)}
    if own != {cell.shape.kind}:
        return False
    corners, _, element = bricks(raw, d, raw.points)
    if some is not None:
        corners = corners[np.isin(element, some)]
    return bool(are_upright(raw.points[corners][..., :d], cell.shape.kind).all())


def _of_kind(raw, kind: str) -> tuple[str, np.ndarray, np.ndarray]:
    """The shape of a kind of elements, and their nodes at corners and in the middles of edges."""
    nodes = raw.cells_dict.get(kind, np.empty((0, 27), int)).astype(np.int64)
    shape = cards.shape(kind)
    number = cards.corners(kind)
    return shape, nodes[:, :number], nodes[:, number : number + len(SIDES[shape])]


def middle_nodes(raw, d: int) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (k,) of a file in the middle of edges of elements of dimension d, and the ends (k, 2) of the edges."""
    triples = []
    for kind, order in KINDS[d].items():
        if order > 1:
            shape, corners, middles = _of_kind(raw, kind)
            ends = corners[:, np.array(SIDES[shape])]
            triples.append(np.concatenate([middles[..., None], ends], axis=2).reshape(-1, 3))
    entries = np.concatenate(triples)
    middles, first = np.unique(entries[:, 0], return_index=True)
    return middles, entries[first, 1:]


def graded(mesh: Mesh, sizes: np.ndarray) -> Sizes:
    """`sizes` (nt,) of the cells as sizes at the corners, which grow by no more than GRADE. Not collective."""
    measure = signed_measures(mesh.points, mesh.corners)
    n = mesh.cell.corners
    used, corners = np.unique(mesh.corners, return_inverse=True)
    corners = corners.reshape(-1, n)
    points = mesh.points[used]
    k = len(used)
    weight = np.bincount(corners.ravel(), np.repeat(measure, n))
    nodal = np.exp(np.bincount(corners.ravel(), np.repeat(measure * np.log(sizes), n)) / weight)
    links = np.concatenate([corners[:, edge] for edge in mesh.cell.edges[:, :2]])
    far = GRADE * np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    # size(x) = min over y of size(y) + GRADE |x − y|: shortest paths from an outer node k whose links to the corners
    # are as long as their sizes.
    ends = np.concatenate([links.T, [np.full(k, k), np.arange(k)]], axis=1)
    _, first = np.unique(np.sort(ends, axis=0), axis=1, return_index=True)
    graph = sparse.csr_matrix(
        (np.concatenate([far, nodal])[first], ends[:, first]), shape=(k + 1, k + 1)
    )
    return Sizes(points, corners, csgraph.dijkstra(graph, directed=False, indices=k)[:k])


def _ranks(raw, size: int) -> np.ndarray:
    """(size,) the order of the nodes: faces of solid elements are cut from their first node, so that neighbours fit.

    Where the corners of all hexahedra have two colours, different ones at the ends of each edge, those of the colour
    that fewer nodes have come first, below zero: diagonals join nodes of this colour, and hexahedra are cut into
    mirror images of those beside them. Corners of bodies, which bear few elements, then have no diagonals as a rule.
    """
    rank = np.arange(size)
    kinds = [kind for kind in KINDS[3] if kind.startswith("hexahedron")]
    corners = np.concatenate(
        [raw.cells_dict.get(kind, np.empty((0, 8), int))[:, :8] for kind in kinds]
    )
    if not len(corners):
        return rank
    used = np.unique(corners)
    i, j = corners[:, np.array(SIDES["hexahedron"])].reshape(-1, 2).T
    # every node twice, once in each colour: linked are the ends of an edge in different ones
    ends = np.concatenate([i, i + size]), np.concatenate([j + size, j])
    graph = sparse.coo_matrix((np.ones(2 * len(i), np.int8), ends), (2 * size, 2 * size))
    one, other = csgraph.connected_components(graph, directed=False)[1].reshape(2, -1)[:, used]
    if (one == other).any():
        return rank
    part = np.minimum(one, other)
    second = one > other
    more = np.bincount(part, np.where(second, 1, -1))[
        part
    ]  # the second colour has more nodes than the first
    rank[used[second == (more < 0)]] -= size
    return rank


def _cuts(points: np.ndarray, corners: np.ndarray, shape: str, rank: np.ndarray) -> np.ndarray:
    """(n, parts, d + 1) the corners of the parts of elements, as numbers of their corners (n, k) with ranks (n, k): in
    space faces are cut from their first node, elements into pyramids from theirs, and hexahedra of two colours into
    five tetrahedra."""
    n, k = corners.shape
    if shape in SIMPLICES:
        return np.broadcast_to(np.arange(k), (n, 1, k))
    first = rank.argmin(axis=1)
    if shape == "quad":
        return HALVES[first % 2 if points.shape[1] > 2 else shorter_diagonals(points, corners)]
    if shape == "hexahedron" and (rank < 0).any():
        return FIVE[1 * (rank[:, 0] >= 0)]
    parts = np.empty((n, {"hexahedron": 6, "wedge": 3, "pyramid": 2}[shape], 4), int)
    for apex in range(k):
        elements = rank[first == apex]
        faces = [np.array(face) for face in FACES[shape] if apex not in face]
        over = [
            face[HALVES[elements[:, face].argmin(axis=1) % 2]]
            if len(face) == 4
            else np.broadcast_to(face, (len(elements), 1, 3))
            for face in faces
        ]
        parts[first == apex] = np.pad(
            np.concatenate(over, axis=1), ((0, 0), (0, 0), (1, 0)), constant_values=apex
        )
    return parts


def _weights(shape: str, number: int) -> np.ndarray:
    """(k, k, s) weights of the bends of edges in the bend between two corners of a curved element: on a face's diagonal
    half of each of its edges, on a hexahedron's a quarter of all. In the plane diagonals are straight."""
    sides = [set(side) for side in SIDES[shape]]
    weights = np.zeros((number, number, len(SIDES[shape])))
    if shape == "hexahedron":
        weights += 0.25
    for face in FACES.get(shape, ()):
        weights[np.ix_(face, face)] = [0.5 * (side <= set(face)) for side in sides]
    for s, (i, j) in enumerate(SIDES[shape]):
        weights[[i, j], [j, i]] = np.eye(len(sides))[s]
    return weights


def shorter_diagonals(points: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """The diagonal (k,), 0 or 1, that cuts a quadrilateral (k, 4) with corners in the plane `points`: the shorter one.

    Of equal diagonals it is the one that begins farthest to the left and below, whatever the order of the corners in a
    file. A quadrilateral that is not convex is cut from its inner corner. Not collective.
    """
    corners = points[quads]
    diagonals = np.linalg.norm(corners[:, :2] - corners[:, 2:], axis=2)
    left = (corners @ [1.0, 0.6]).argmin(axis=1) % 2  # ties of both are rare
    size = [
        signed_measures(corners.reshape(-1, 2), 4 * np.arange(len(quads))[:, None] + part)
        for part in np.array([[0, 1, 2], [0, 2, 3], [1, 2, 3], [1, 3, 0]])
    ]
    fits = np.stack([size[0] * size[1] > 0.0, size[2] * size[3] > 0.0], axis=1)
    shorter = np.where(
        np.abs(np.diff(diagonals)[:, 0]) <= SAME * diagonals.max(axis=1),
        left,
        diagonals.argmin(axis=1),
    )
    return np.where(fits.all(axis=1) | ~fits.any(axis=1), shorter, fits.argmax(axis=1))


def distinct(elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The places of different elements (k,), in the given order, and the number of every element among them: up to
    version 2 a file repeats an element for each of its groups."""
    _, first, same = np.unique(
        np.sort(elements, axis=1), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    return first[order], np.argsort(order)[same.ravel()]
