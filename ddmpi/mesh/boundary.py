"""Groups of a mesh, a mesh file and a drawing by name; facets on a boundary: direction, pieces, creases."""

import functools
import re
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError, naming, nearest
from ddmpi.mesh.elements import CELLS, Cell, cell_with, normals
from ddmpi.mesh.mesh import PHYSICAL, Groups, Mesh, boundary_facets
from ddmpi.mesh.refine import KINDS, bricks, distinct, middle_nodes, simplices
from ddmpi.scene.bodies import BodySpec
from ddmpi.system.numbers import SAME, across, in_words

SHARPEST = np.deg2rad(40.0)
"""Where a boundary turns by more than this from one facet to the next, it has a corner; else it may be a curve."""

COARSEST = np.deg2rad(55.0)
"""Up to this turn successive facets may be those of a coarse curve, such as a circle of seven chords; see `curving`."""

ONWARD = 0.45
"""Least part of its turn by which a curve turns on: half of it at an end of an arc, nearly so where chords are uneven."""

SAMPLES = 65
"""Points on a curve of a drawing by which its radius is found."""

ACROSS = np.stack(np.meshgrid(*[np.linspace(0.05, 0.95, 9)] * 2), axis=-1).reshape(-1, 2)
"""Places on a face, as parts of its parameters, by which its radius is found; that of a quarter of them is smaller."""

OFF = 1e22
"""Gmsh's value for no limit."""


def material_numbers(mesh: Mesh, body: BodySpec) -> np.ndarray:
    """Which one of the body's materials each triangle (nt,) has. Raises InputError unless each has exactly one."""
    number = np.full(len(mesh.triangles), -1)
    what = PHYSICAL[mesh.dimension]
    materials = [] if not isinstance(body.material, list) else body.material
    for k, on in (
        (k, material.on) for k, material in enumerate(materials) if material.on is not None
    ):
        key = f"body.{body.name}.material.{k}.on"
        if on not in mesh.surfaces:
            raise InputError(
                f"{key}: the mesh has no {what} {on!r}{nearest(on, list(mesh.surfaces))} "
                f"(it has {', '.join(sorted(mesh.surfaces)) or 'none with a name'})"
            )
        cells = mesh.surfaces[on]
        if len(cells) == 0:
            raise InputError(
                f"{key}: the {what} {on!r} of the mesh has a name, but no {mesh.cell.names}"
            )
        if (number[cells] >= 0).any():
            triangle = cells[number[cells] >= 0][0]
            raise InputError(
                f"{key}: {_place(mesh, triangle)} is in the {what}s {on!r} and "
                f"{materials[number[triangle]].on!r}, which would both give it a material"
            )
        number[cells] = k
    rest = next(
        (k for k, material in enumerate(materials) if material.on is None), None if materials else 0
    )
    if rest is None and (number < 0).any():
        triangle = np.flatnonzero(number < 0)[0]
        around = [name for name, members in mesh.surfaces.items() if triangle in members]
        where = f"in the {what} {around[0]!r}" if around else f"in no {what} with a name"
        raise InputError(
            f"body.{body.name}.material: {_place(mesh, triangle)}, {where}, has no material; add an entry "
            "for it, or one without on for the rest"
        )
    return np.where(number < 0, 0 if rest is None else rest, number)


def _place(mesh: Mesh, triangle: int) -> str:
    return f"the {mesh.cell.name} at {in_words(mesh.points[mesh.corners[triangle]].mean(axis=0))}"


def segments(edges: np.ndarray) -> np.ndarray:
    """Pairs (·, 2) of neighbouring nodes on edges (k, 2 or 3), in the edges' direction."""
    return cell_with(edges.shape[1], 1).split(edges)


def links(facets: np.ndarray, dimension: int) -> np.ndarray:
    """Pairs (·, 2) of neighbouring nodes on the edges of facets (f, l) of a body of this dimension, each once: in the
    plane in the direction of the facets, and in their order; in space the lower node first."""
    if dimension == 2:
        return segments(facets)
    cell = cell_with(facets.shape[1], dimension - 1)
    return np.unique(
        np.sort(segments(facets[:, cell.edges].reshape(-1, cell.edges.shape[1])), axis=1), axis=0
    )


def outer_normals(mesh: Mesh, name: str, key: str) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (k,) of a boundary group, ascending, and its outer unit normals (k, d) there.

    Those of the facets between neighbouring nodes, weighted as in `corner_normals`. Raises InputError, naming `key`,
    at a corner inside the group.
    """
    d = mesh.dimension
    with naming(key):
        corners = mesh.facets(name).nodes[:, mesh.cell.facet.parts].reshape(-1, d)
    bends = creases(mesh.points, corners, normals(mesh.points[corners]))
    sharp = np.flatnonzero(bends.corner)
    if len(sharp):
        at = in_words(mesh.points[bends.nodes[sharp[0]]].mean(axis=0))
        raise InputError(
            f"{key}: {name!r} has a corner at {at}, where it has no normal; make groups of what meets "
            "there, and clamp each along its normal"
        )
    normal = corner_normals(mesh.points, corners)
    nodes = np.unique(corners)
    return nodes, normal[nodes]


def corner_normals(points: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Unit normals (n, d) at the `points` (n, d) of facets (f, d); where these turn against each other, of any length.

    Exact where the points lie on a circle or a sphere (Max, J. Graphics Tools 4, 1999)."""
    ends = points[facets]
    squares = ((ends[:, :, None] - ends[:, None]) ** 2).sum(axis=3) + np.eye(facets.shape[1])
    normal = np.zeros_like(points)
    np.add.at(normal, facets, normals(ends)[:, None] / squares.prod(axis=2)[:, :, None])
    length = np.linalg.norm(normal, axis=1)
    return normal / np.maximum(length, np.finfo(float).tiny)[:, None]


class Creases(NamedTuple):
    """Where facets of a boundary meet: at nodes in the plane, on edges in space.

    Attributes
    ----------
    nodes : (c, d − 1) of each crease
    facets : (c, 2) the two that meet there
    turn : (c,) the angle between their normals, negative where the boundary is hollow (rad)
    corner : (c,) bool, whether it is a corner, and of no curve
    rim : (r, d − 1) nodes where a facet meets no other, or more than one
    """

    nodes: np.ndarray
    facets: np.ndarray
    turn: np.ndarray
    corner: np.ndarray
    rim: np.ndarray


def creases(points: np.ndarray, facets: np.ndarray, outward: np.ndarray) -> Creases:
    """The creases between straight facets (f, c) of `points` (n, d), of which vectors (f, d) point to their outer sides."""
    of_facet = cell_with(facets.shape[1], points.shape[1] - 1).facets
    sides = np.sort(np.concatenate([facets[:, side] for side in of_facet]), axis=1)
    nodes, number, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(number.ravel(), kind="stable")
    first = np.cumsum(count) - count
    first = first[count == 2]
    a = order[first] % len(facets)
    b = order[first + 1] % len(facets)
    ends = points[facets]
    normal = across(outward, ends[:, : points.shape[1]])[0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    turn = np.arccos(np.clip(np.einsum("cd,cd->c", normal[a], normal[b]), -1.0, 1.0))
    hollow = np.einsum("cd,cd->c", ends[b].mean(axis=1) - ends[a].mean(axis=1), normal[a]) > 0.0
    turn = np.where(hollow, -turn, turn)
    nodes, facets, rim = nodes[count == 2], np.column_stack([a, b]), nodes[count != 2]
    found = Creases(nodes, facets, turn, np.zeros(len(turn), bool), rim)
    return found._replace(corner=(np.abs(turn) > SHARPEST) & ~curving(points, found, turn, facets))


def curving(points: np.ndarray, bends: Creases, turn: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """(c,) bool, at which creases sharper than SHARPEST the boundary may be a coarse curve: beyond both facets it turns on,
    the same way and by at least ONWARD of its turn, or to an end above COARSEST.

    Parameters
    ----------
    turn, facets : (c,) and (c, 2) as in `bends`; at a plane of symmetry those of the whole, twice the one facet there is
    """
    found = np.zeros(len(turn), bool)
    sharp = np.flatnonzero((np.abs(turn) > SHARPEST) & (np.abs(turn) <= COARSEST))
    if not len(sharp):
        return found
    number = np.tile(np.arange(len(turn)), 2)
    of = sparse.csr_matrix((np.ones(len(number)), (bends.facets.T.ravel(), number)))
    flat = sparse.diags((np.abs(bends.turn) <= SAME).astype(float))
    reached = of + of @ flat @ of.T @ of  # also over the diagonal of a quadrilateral
    way = points[bends.nodes[:, -1]] - points[bends.nodes[:, 0]]
    length = np.linalg.norm(way, axis=1)
    way /= np.where(length, length, 1.0)[:, None]
    onward = np.full((2, len(sharp)), 0.0)
    for side, total in enumerate(onward):
        k, j = reached[facets[sharp, side]].nonzero()
        i = sharp[k]
        own = (bends.facets[j] == facets[i, side, None]).any(axis=1)
        met = (bends.nodes[i][:, :, None] == bends.nodes[j][:, None]).any(axis=(1, 2))
        along = np.where(length[i], np.abs((way[i] * way[j]).sum(axis=1)), 1.0)  # nodes have no way
        on = np.where(np.abs(bends.turn[j]) > COARSEST, np.pi, bends.turn[j] * np.sign(turn[i]))
        np.add.at(total, k, np.where((i != j) & (own | ~met), along * on, 0.0))
    found[sharp] = (onward >= ONWARD * np.abs(turn[sharp])).all(axis=0)
    return found


def parts_of(on: str, known: Collection[str]) -> list[str]:
    """The groups of which a name is made that is not `known` itself: "8" and "27" of "8+27" or "8 & 27"; signs in
    parentheses are those of numbers."""
    return [on] if on in known else re.split(r" *[+&](?![^(]*\)) *", on)


def combined(mesh: Mesh, name: str, clamp: bool = False) -> Mesh:
    """The mesh with the group of this name, if it is made of others: "8+27" are both together, "left & bottom" is what
    they have in common, an edge or a corner. Raises InputError where one of the others is missing, or, unless it is
    for a `clamp`, is no group of facets."""
    kinds = groups, curves, vertices = dict(mesh.groups), dict(mesh.curves), dict(mesh.vertices)
    known = {*groups, *curves, *vertices, *mesh.surfaces}
    parts = list(dict.fromkeys(parts_of(name, known)))
    if name in known or not any(sign in name for sign in "+&"):
        return mesh
    nodes = [mesh.nodes_of(part) if clamp else np.unique(mesh.facets(part).nodes) for part in parts]
    if "&" in name:
        common = functools.reduce(np.intersect1d, nodes)
        if not len(common):
            raise InputError(f"{' and '.join(map(repr, parts))} have no node in common")
        facets = mesh.boundary[0]
        lines = links(facets[np.isin(facets, common).sum(axis=1) > 1], mesh.dimension)
        lines = lines[np.isin(lines, common).all(axis=1)]
        rest = np.setdiff1d(common, lines)
        if len(lines):
            curves[name] = lines
        if len(rest):
            vertices[name] = rest
    for kind in kinds if "&" not in name else ():
        members = [kind[part] for part in parts if part in kind]
        if members:
            kind[name] = np.concatenate(members)
    if name in groups:
        groups[name] = groups[name][distinct(groups[name])[0]]
    return mesh.regrouped(groups, curves, vertices)


# Drawings, in a session of gmsh


def box(gmsh, dimension: int = -1, tag: int = -1) -> np.ndarray:
    """The least and the greatest coordinates (2, 3) of an entity of the drawing, or of all of it."""
    return np.reshape(gmsh.model.getBoundingBox(dimension, tag), (2, 3))


def extent(gmsh, *entity: int) -> float:
    """The diagonal of the box of an entity of the drawing, or of all of it."""
    return float(np.linalg.norm(np.diff(box(gmsh, *entity), axis=0)))


def samples(gmsh, curve: int) -> np.ndarray:
    """Points (SAMPLES, 3) on a curve."""
    (low,), (high,) = gmsh.model.getParametrizationBounds(1, curve)
    return np.reshape(gmsh.model.getValue(1, curve, np.linspace(low, high, SAMPLES)), (-1, 3))


def curve_bend(gmsh, tag: int) -> tuple[float, float]:
    """The largest curvature of a curve (1/m), and its length (m)."""
    steps = np.diff(samples(gmsh, tag), axis=0)
    length = np.maximum(np.linalg.norm(steps, axis=1), 1 / OFF)
    return np.linalg.norm(
        np.diff(steps / length[:, None], axis=0), axis=1
    ).max() / length.mean(), length.sum()


def parameters(gmsh, tag: int, parts: np.ndarray) -> np.ndarray:
    """The parameters (n, 2) of places on a face, as `parts` (n, 2) from 0 to 1 of their ranges."""
    low, high = gmsh.model.getParametrizationBounds(2, tag)
    return np.array(low + parts * (high - low))


def face_bend(gmsh, tag: int) -> tuple[float, float]:
    """The curvature of a face (1/m), which at the tip of a cone has no bound, and the face's extent (m)."""
    if gmsh.model.getType(2, tag) == "Plane":
        return 0.0, 0.0
    bends = gmsh.model.getCurvature(2, tag, parameters(gmsh, tag, ACROSS).ravel())
    return float(np.percentile(np.abs(bends), 75)), extent(gmsh, 2, tag)


def keep_part(gmsh, part: str | int, label: str) -> None:
    """Remove all bodies but one from the drawing: a number, a physical group, or a label of a CAD program or of one of
    its assemblies. What is left keeps its numbers. Raises InputError unless exactly one body is meant."""
    model = gmsh.model
    d = model.getDimension()
    groups = [
        (k, model.getEntitiesForPhysicalGroup(k, group), group, model.getPhysicalName(k, group))
        for k, group in model.getPhysicalGroups()
    ]
    names = {tag: model.getEntityName(d, tag).split("/")[::-1] for _, tag in model.getEntities(d)}
    for k, tags, _, name in groups:
        for tag in tags if k == d else ():
            names[tag].insert(0, name)
    kept = _meant(gmsh, part, names, label)
    model.removeEntities([(d, tag) for tag in names if tag != kept], recursive=True)
    left = set(model.getEntities())
    model.removePhysicalGroups()
    for k, tags, group, name in groups:  # gmsh forgets some of them with what was removed
        model.removePhysicalName(name)
        if tags := [tag for tag in tags if (k, tag) in left]:
            model.addPhysicalGroup(k, tags, group, name)


def _meant(gmsh, part: str | int, names: dict[int, list[str]], label: str) -> int:
    """The body that `part` means, by the words that name each, the most telling one first. Raises InputError."""
    # a label is as "Shapes/assembly/1/bolt": its last word says most, and then a number in quotation marks
    deep = [
        [tag for tag, words in names.items() if words[k : k + 1] == [part]]
        for k in range(max(map(len, names.values())))
    ]
    deep.insert(1, [tag for tag in names if str(tag) == part])
    meant = [part] if part in names else next(filter(None, deep), [])
    if len(meant) == 1:
        return int(meant[0])
    d = gmsh.model.getDimension()
    listed = "; ".join(
        f"{tag} {names[tag][0]!r} {where(gmsh, d, tag)}"
        for tag in names
        if tag in meant or not meant
    )
    if meant:
        raise InputError(
            f"{label} has {len(meant)} parts {part!r}; take one by its number: {listed}"
        )
    raise InputError(f"{label} has no part {part!r}; it has {listed}")


def where(gmsh, k: int, tag: int) -> str:
    """Where an entity of the drawing lies, in words."""
    if k == 1:
        places = samples(gmsh, tag)[[0, SAMPLES // 2, -1], : gmsh.model.getDimension()]
        start, middle, end = (in_words(at + 0.0) for at in places)
        return f"from {start} by {middle} to {end}"
    corners = np.round(box(gmsh, k, tag), 5 - int(np.log10(extent(gmsh)))) + 0.0
    return " to ".join(dict.fromkeys(map(in_words, corners)))


def file_groups(
    raw, label: str, cells: np.ndarray, cell: Cell, part: bool = False
) -> tuple[Groups, ...]:
    """By name the facets (·, l) of each group of the boundary, in space the lines (·, 2) of curves, and nodes, of a body
    with these straight `cells` (nt, c).

    Of a set of nodes the facets, or else the lines, and in any case its nodes. If the `cells` are a `part` of the file,
    only what belongs to them. Raises InputError where there is no group.
    """
    d = cell.dimension
    kinds = list[Groups]()
    for dimension in range(d - 1, 0, -1):
        parts, _, element = (simplices if cell.simplex else bricks)(raw, dimension, raw.points)
        if part:
            own = _sides_of(cells, cell, parts)
            parts = parts[own]
            element = element[own]
        groups = {}
        for name, members in file_members(raw, dimension).items():
            facets = parts[np.isin(element, members)]
            groups[name] = facets[distinct(facets)[0]]
        kinds.append(groups)
    alone = {} if raw.field_data else _add_sets(raw, cells, cell, kinds)
    points_of = raw.cells_dict.get("vertex", np.empty((0, 1), int))[:, 0]
    alone |= {name: np.unique(points_of[members]) for name, members in file_members(raw, 0).items()}
    if not any((*kinds, alone)):
        raise _without_groups(label, d)
    if part:  # groups of other parts are not of this one
        kinds = [{name: own for name, own in kind.items() if len(own)} for kind in kinds]
        named = set().union(*kinds)
        alone = {
            name: own for name, own in alone.items() if name in named or np.isin(own, cells).any()
        }
    return kinds[0], {} if d == 2 else kinds[1], alone


def _sides_of(cells: np.ndarray, cell: Cell, parts: np.ndarray) -> np.ndarray:
    """(k,) bool, which lines or facets (k, l) are sides or edges of `cells` (nt, c)."""
    size = parts.shape[1]
    of_cells = cells[:, cell.edges if size == 2 else cell.facets].reshape(-1, size)
    _, number = distinct(np.concatenate([of_cells, parts]))
    return np.isin(number[len(of_cells) :], number[: len(of_cells)])


def _add_sets(raw, cells: np.ndarray, cell: Cell, kinds: Sequence[Groups]) -> Groups:
    """The sets of nodes of a file by name; to the facets, and lines, of groups those of each set that has some."""
    if not raw.point_sets:
        return {}
    facets = boundary_facets(cells, cell.dimension)[0]
    sides = [facets, facets[:, cell.facet.edges].reshape(-1, 2)][: len(kinds)]
    sides = [
        pieces if pieces.shape[1] > 3 else np.unique(np.sort(pieces, axis=1), axis=0)
        for pieces in sides
    ]
    alone: Groups = {}
    for name, nodes in raw.point_sets.items():
        if name in raw.cell_sets:
            continue
        alone[name] = np.asarray(nodes, int)
        inside = [pieces[np.isin(pieces, nodes).all(axis=1)] for pieces in sides]
        for kind, parts in zip(kinds, inside, strict=True):
            if len(parts):
                kind[name] = parts
                break
    return alone


def _without_groups(label: str, d: int) -> InputError:
    """The error of a file without names, in the words of its format."""
    what = f"no named physical groups of {CELLS[d - 1, 1].names}"
    names = f'{PHYSICAL[d - 1].title()}("left") = {{4}};'
    if label.lower().endswith(".inp"):
        what = "no sets of nodes and no surfaces"
        names = "*NSET, NSET=LEFT or *SURFACE, NAME=LEFT"
    words = "clamps, tractions and contacts refer to boundaries by such names"
    return InputError(f"{label} has {what}; {words}: {names}")


def set_nodes(raw, mesh: Mesh, number: np.ndarray, sets: Groups) -> Groups:
    """By name the nodes of the mesh in `sets` of the file's nodes that no facet or line of the set has. `number` (nr,)
    is that of the file's nodes at corners, else −1; −1 also stands for middles of edges that a linear mesh lacks."""
    middles, ends = middle_nodes(raw, mesh.dimension)
    asked = np.isin(middles, np.concatenate([np.empty(0, int), *sets.values()]))
    alone = {}
    middles = middles[asked]
    ends = ends[asked]
    if mesh.order > 1 and len(middles):  # those of the mesh are where the file has them
        first = int(mesh.corners.max()) + 1
        number = number.copy()
        number[middles] = (
            first + cKDTree(mesh.points[first:]).query(raw.points[middles, : mesh.dimension])[1]
        )
    for name, nodes in sets.items():
        lone = np.isin(middles, nodes) & (number[middles] < 0) & ~np.isin(ends, nodes).all(axis=1)
        members = number[nodes][number[nodes] >= 0]
        taken = [groups[name].ravel() for groups in (mesh.groups, mesh.curves) if name in groups]
        members = np.setdiff1d(members, np.concatenate([np.empty(0, int), *taken]))
        members = np.append(np.full(int(lone.any()), -1), members)
        if len(members) or not taken:
            alone[name] = members
    return alone


def file_members(raw, dimension: int) -> Groups:
    """Which elements, counted through all KINDS, each named physical group of a dimension has."""
    kinds = KINDS[dimension]
    tags = {int(tag): name for name, (tag, of) in raw.field_data.items() if of == dimension}
    sets = raw.cell_sets_dict  # of version 4 files, where an element may be in several groups
    if not raw.field_data:
        tags |= {
            -k: name
            for k, name in enumerate(sets, 1)
            if not name.startswith("gmsh:")  # meshio's own
            and any(len(sets[name].get(kind, ())) for kind in kinds)
        }
    members: dict[str, list[np.ndarray]] = {name: [] for name in tags.values()}
    before = 0
    for kind in kinds:
        physical = raw.cell_data_dict.get("gmsh:physical", {}).get(kind, np.empty(0, int))
        for tag, name in tags.items():
            numbers = sets[name].get(kind, ()) if name in sets else np.flatnonzero(physical == tag)
            members[name].append(before + np.asarray(numbers, int))
        before += len(raw.cells_dict.get(kind, ()))
    return {name: np.concatenate(numbers) for name, numbers in members.items()}
