"""The bodies of a deck: elements that hang together, the facets of their boundaries, and their mesh files."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.decks.cards import (
    EXACT,
    KEPT,
    Block,
    Card,
    End,
    are_upright,
    corners,
    shape,
)
from ddmpi.decks.deck import STRIDE, all_faces, are_free, nodes_of_faces

Cut = tuple[Card, set[End], np.ndarray, np.ndarray]
"""A section of a bolt: its keyword, the faces of elements on one side, the nodes there, and those around the layer of
these elements, where that is a body of its own."""


def own_name(text: str, taken: Iterable[str]) -> str:
    """A name of letters, digits, dashes and underscores that is not among the `taken`."""
    base = re.sub(r"[^\w-]+", "_", text).strip("_")[:60] or "x"
    lower = {name.lower() for name in taken}
    names = (f"{base}_{k}" for k in itertools.count(2))
    return next(name for name in itertools.chain([base], names) if name.lower() not in lower)


def split(blocks: Sequence[Block], rows: np.ndarray) -> list[list[Block]]:
    """The elements in pieces of which no `rows` (k, n) have a node in common, in the order of their first elements."""
    piece = connected(rows)
    of_blocks = np.split(piece, np.cumsum([len(block.entries) for block in blocks])[:-1])
    return [
        [
            block._replace(entries=block.entries[of == k])
            for block, of in zip(blocks, of_blocks, strict=True)
            if (of == k).any()
        ]
        for k in range(piece.max() + 1)
    ]


def elements_of(blocks: Sequence[Block]) -> np.ndarray:
    """The numbers (k,) of all elements."""
    return np.concatenate([block.entries[:, 0] for block in blocks])


def rows_of(blocks: Sequence[Block]) -> np.ndarray:
    """The nodes (k, n) of all elements, −1 where there are fewer."""
    widest = max(block.entries.shape[1] for block in blocks)
    return np.concatenate(
        [
            np.pad(
                block.entries[:, 1:],
                ((0, 0), (0, widest - block.entries.shape[1])),
                constant_values=-1,
            )
            for block in blocks
        ]
    )


def connected(rows: np.ndarray) -> np.ndarray:
    """The connected component (k,) of each row (k, n) of nodes, −1 for none; they are numbered by their first rows."""
    if not len(rows):
        return np.empty(0, int)
    row, column = np.nonzero(rows >= 0)
    nodes, place = np.unique(rows[row, column], return_inverse=True)
    links = sparse.coo_matrix(
        (np.ones(len(row), np.int8), (row, len(rows) + place)), (len(rows) + len(nodes),) * 2
    )
    label = csgraph.connected_components(links, directed=False)[1][: len(rows)]
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    return first.argsort().argsort()[number]


def cut(
    blocks: Sequence[Block],
    rows: np.ndarray,
    ends: set[End],
    numbers: np.ndarray,
    points: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elements cut apart at a flat section, faces `ends` (element, number) of those on one side: their `rows` (k, n)
    have nodes of their own there. Where all still hang together, the layer of these elements is taken out.

    The rows, and the nodes at the section and around the layer. The nodes have `numbers` (m,) and `points` (m, d).
    """
    nodes = nodes_of_faces(blocks, ends)
    layer = np.isin(elements_of(blocks), [element for element, _ in ends])
    section = np.unique(nodes[nodes >= 0])
    if not layer.any():
        return rows, section, np.empty(0, int)
    at = points[np.isin(numbers, section)]
    middles = np.concatenate(
        [points[np.searchsorted(numbers, block.entries[:, 1:])].mean(axis=1) for block in blocks]
    )
    heights = (middles - at.mean(axis=0)) @ np.linalg.svd(at - at.mean(axis=0))[2][-1]
    apart = _apart(rows, heights * heights[layer].mean() > 0.0, section)
    piece = connected(apart)
    here = np.isin(apart, section).any(axis=1)
    if not np.intersect1d(piece[here], piece[(apart != rows).any(axis=1)]).size:
        return apart, section, np.empty(0, int)
    around = np.setdiff1d(np.intersect1d(apart[layer], apart[~layer]), [-1])
    return _apart(apart, layer, around), section, np.unique(rows[np.isin(apart, around)])


def _apart(rows: np.ndarray, own: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """The `rows` (k, n), of which the `own` (k,) ones have other numbers for the `nodes`."""
    some = own[:, None] & np.isin(rows, nodes)
    rows = rows.copy()
    rows[some] = rows.max() + 1 + np.unique(rows[some], return_inverse=True)[1].ravel()
    return rows


class Piece:
    """One body: its elements, nodes, and the facets of its boundary.

    Attributes
    ----------
    nodes : (n,) numbers, ascending; points : (n, d) (m)
    facets : (f, 8) places in `nodes` of the corners, in the first four columns, and of the middles of the sides; −1
        where there are fewer; none on the axis of a body that is `around` it
    owners : (f, 2) element and number of the face
    groups, sets : facets and numbers of nodes by name, as the mesh file has them
    materials : elements by name of the set
    """

    def __init__(
        self,
        name: str,
        blocks: list[Block],
        numbers: np.ndarray,
        points: np.ndarray,
        around: bool = False,
    ) -> None:
        self.name = name
        self.blocks = blocks
        self.elements = elements_of(blocks)
        self.nodes = np.unique(np.concatenate([block.entries[:, 1:].ravel() for block in blocks]))
        self.points = points[np.searchsorted(numbers, self.nodes)]
        self.groups: dict[str, np.ndarray] = {}
        self.sets: dict[str, np.ndarray] = {}
        self.materials: dict[str, np.ndarray] = {}
        every, owners = all_faces(blocks)
        alone = are_free(every)
        if around:
            axis = np.abs(self.points[:, 0]) <= EXACT * np.ptp(self.points, axis=0).max()
            alone &= ~np.isin(every, [*self.nodes[axis], -1]).all(axis=1)
        self.facets = np.where(every[alone] < 0, -1, np.searchsorted(self.nodes, every[alone]))
        self.owners = owners[alone]

    @property
    def taken(self) -> set[str]:
        """All names of the mesh file."""
        return {self.name, *self.sets, *self.groups, *self.materials}

    @cached_property
    def place(self) -> dict[int, int]:
        """Places in `nodes` by number."""
        return {node: k for k, node in enumerate(self.nodes.tolist())}

    @cached_property
    def at(self) -> dict[End, int]:
        """Numbers of facets by element and face."""
        return {(element, face): k for k, (element, face) in enumerate(self.owners.tolist())}

    def within(self, nodes: Iterable[int]) -> np.ndarray:
        """(k,) bool of all nodes: whether they are among numbers of `nodes`."""
        return np.isin(self.nodes, np.fromiter(nodes, np.int64))

    def whole(self, marked: np.ndarray) -> np.ndarray:
        """The facets (k,) whose corners are all `marked`."""
        return np.flatnonzero(
            (np.append(marked, True)[self.facets[:, :4]]).all(axis=1)
        )  # −1 is the last, and True

    def group(self, facets: np.ndarray, name: str) -> str:
        """The name of a group of these facets; a new one, like `name`, if there is none yet."""
        return _kept(self.groups, np.unique(facets), name, self.taken)

    def again(self, group: str) -> str:
        """A second name for the facets of a group: of loads under one name `ddmpi check` asks whether both are meant."""
        name = own_name(f"{group}_uneven", self.taken)
        self.groups[name] = self.groups[group]
        return name

    def node_set(self, nodes: np.ndarray, name: str) -> str:
        """The name of a set of these nodes (places); a new one, like `name`, if there is none yet."""
        return _kept(self.sets, np.unique(nodes), name, self.taken)

    def parted(self, nodes: np.ndarray) -> list[np.ndarray]:
        """These nodes (k,) in sets: as a mesh adds the middle of a side to a set that has both of its ends, of those
        whose middle is not among them no two of one element are in one set."""
        if len(nodes) < 2:
            return [nodes]
        marked = np.append(np.isin(np.arange(len(self.nodes)), nodes), True)
        first, middles = np.hsplit(self.facets, 2)
        second = np.roll(first, -1, axis=1)
        second = np.where(second < 0, first[:, :1], second)
        lone = marked[first] & marked[second] & ~marked[middles]
        alone = np.union1d(first[lone], second[lone])
        if not len(alone):
            return [nodes]
        beside = {node: set[int]() for node in self.nodes[alone].tolist()}
        for row in itertools.chain(*(block.entries[:, 1:].tolist() for block in self.blocks)):
            some = beside.keys() & row
            for node in some:
                beside[node] |= some
        number = dict[int, int]()  # of sets
        for node, others in beside.items():
            there = {number.get(other) for other in others}
            number[node] = next(k for k in itertools.count() if k not in there)
        of = np.array([*number.values()])
        parts = [np.setdiff1d(nodes, alone), *(alone[of == k] for k in np.unique(of))]
        return [some for some in parts if len(some)]

    def patches(
        self, loaded: np.ndarray, held: Sequence[int] = ()
    ) -> tuple[list[tuple[np.ndarray, np.ndarray, bool]], np.ndarray]:
        """Facets to carry the forces at places `loaded` (k,), the nodes whose forces they carry, and whether they are
        whole facets: first these that hang together, then those around nodes that hang together and are not `held`; and
        the nodes without a facet."""
        marked = np.zeros(len(self.nodes) + 1, bool)
        marked[loaded] = marked[-1] = True
        ends = marked[self.facets[:, :4]].all(axis=1)
        middles = marked[self.facets[:, 4:]].all(axis=1)
        # consistent loads of quadratic tetrahedra are at the middles of sides alone
        whole = ends | (middles & (self.facets[:, 4] >= 0))
        found: list[tuple[np.ndarray, np.ndarray, bool]] = []
        left = marked[:-1].copy()
        for all_of_it in (True, False):
            some = whole if all_of_it else np.append(left, False)[self.facets].any(axis=1)
            loads = np.flatnonzero(some)
            component = connected(self.facets[loads, :4])
            for facets in (loads[component == k] for k in range(component.max(initial=-1) + 1)):
                nodes = np.unique(self.facets[facets])
                nodes = nodes[(nodes >= 0) & left[nodes]]
                if len(nodes):
                    found.append((facets, nodes, all_of_it))
            left[np.unique(self.facets[some])] = False
            left[[*held]] = False
        return found, np.flatnonzero(left)

    def quadrature(self, facets: np.ndarray, around: bool) -> tuple[np.ndarray, np.ndarray]:
        """Points (q, d) and weights (q,) on straight facets; with the circumference if `around` an axis."""
        corners = self._simplices(facets)
        d = self.points.shape[1]
        inner = (
            1.0 - (d + 1) ** -0.5
        ) / d  # d points in each: exact for squares, in the plane for cubes
        at = ((inner + (1.0 - d * inner) * np.eye(d)) @ corners).reshape(-1, d)
        weights = np.repeat(np.linalg.norm(_vectors(corners), axis=1) / d, d)
        return at, weights * 2.0 * np.pi * at[:, 0] if around else weights

    def _simplices(self, facets: np.ndarray) -> np.ndarray:
        """Corners (k, d, d) of facets, of which quadrilaterals are cut in two."""
        place = self.facets[facets]
        parts = (
            [place[:, :2]]
            if self.points.shape[1] == 2
            else [place[:, :3], place[place[:, 3] >= 0][:, [0, 2, 3]]]
        )
        return self.points[np.concatenate(parts)]

    def normals(self, facets: np.ndarray) -> np.ndarray:
        """Unit normals (f, d) of straight facets, on either side."""
        return _normals(self.points[self.facets[facets][:, : self.points.shape[1]]])

    def outward(self, facets: np.ndarray) -> np.ndarray:
        """The unit normal (d,) of the first of these facets, away from the middle of the body."""
        normal = self.normals(facets[:1])[0]
        at = self.facets[facets[0], : self.points.shape[1]]
        return normal * np.sign((self.points[at].mean(axis=0) - self.points.mean(axis=0)) @ normal)

    def middles(self, facets: np.ndarray) -> np.ndarray:
        """(f, d) the mean of the nodes of each of these facets."""
        places = self.facets[facets]
        there = (places >= 0)[..., None]
        return np.where(there, self.points[places], 0.0).sum(axis=1) / there.sum(axis=1)

    def middle(self, facets: np.ndarray) -> np.ndarray:
        """(d,) the mean of the nodes of these facets."""
        nodes = np.unique(self.facets[facets])
        return self.points[nodes[nodes >= 0]].mean(axis=0)

    def spacing(self, facets: np.ndarray) -> float:
        """The median length of the first sides of these facets."""
        sides = np.diff(self.points[self.facets[facets][:, :2]], axis=1)
        return float(np.median(np.linalg.norm(sides, axis=2)))

    def heights(self, facets: np.ndarray, master: Piece, against: np.ndarray) -> np.ndarray:
        """(k,) distances of the nodes of these facets from the facets `against` of the master below or above them."""
        corners = master._simplices(against)
        edges = corners[:, 1:] - corners[:, :1]
        normals = _normals(corners)
        inverse = np.linalg.pinv(edges)  # by which edges give the coordinates of a place in a facet
        found = []
        for place in set(self.facets[facets].ravel().tolist()) - {-1}:
            off = self.points[place] - corners[:, 0]
            at = np.einsum("fd,fde->fe", off, inverse)
            over = (at >= -EXACT).all(axis=1) & (at.sum(axis=1) <= 1.0 + EXACT)
            if over.any():
                found.append(float(np.abs((off * normals).sum(axis=1))[over].min()))
        return np.array(found)

    @property
    def uniform(self) -> bool:
        """Whether its elements are of one shape that bodies keep."""
        (one, *more) = {shape(block.kind) for block in self.blocks}
        return one in KEPT and not more

    @cached_property
    def kept(self) -> bool:
        """Whether its elements are not cut: such ones, if all of them are convex."""
        if not self.uniform:
            return False
        kind = shape(self.blocks[0].kind)
        nodes = np.concatenate([block.entries[:, 1 : 1 + corners(kind)] for block in self.blocks])
        at = self.points[np.searchsorted(self.nodes, nodes)]
        return bool(are_upright(at[..., : 2 if kind == "quad" else 3], kind).all())

    @property
    def straight(self) -> bool:
        """Whether it stays linear: of linear simplices alone, or of linear elements that are not cut."""
        kinds = {block.kind for block in self.blocks}
        return all(kind == shape(kind) for kind in kinds) and (
            self.kept or kinds <= {"triangle", "tetra"}
        )

    def write(self, path: Path) -> None:
        """Write the mesh as an input of Abaqus with sets of nodes, elements, and surfaces of faces; one of the whole
        boundary where nothing else names a part of it."""
        if not self.groups and not self.sets:
            self.group(np.arange(len(self.facets)), "boundary")
        lines = ["*NODE"]
        lines += [
            f"{number % STRIDE}, {', '.join(map(repr, at))}"
            for number, at in zip(self.nodes.tolist(), self.points.tolist(), strict=True)
        ]
        for block in self.blocks:
            lines.append(f"*ELEMENT, TYPE={block.name}, ELSET={self.name}")
            for entries in (block.entries % STRIDE).tolist():
                lines += _rows(entries)
        for name, elements in self.materials.items():
            lines += [f"*ELSET, ELSET={name}", *_rows((elements % STRIDE).tolist())]
        for name, nodes in self.sets.items():
            lines += [f"*NSET, NSET={name}", *_rows((self.nodes[nodes] % STRIDE).tolist())]
        for name, facets in self.groups.items():
            lines += [
                f"*SURFACE, NAME={name}",
                *(f"{element % STRIDE}, S{face}" for element, face in self.owners[facets].tolist()),
            ]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


Side = tuple[Piece, np.ndarray]
"""A body, and facets of it."""


def _vectors(corners: np.ndarray) -> np.ndarray:
    """Normals (k, d) of plane facets by their corners (k, d, d), as long as their measures (m or m²)."""
    edges = corners[:, 1:] - corners[:, :1]
    return (
        np.cross(edges[:, 0], edges[:, 1]) / 2.0
        if corners.shape[2] > 2
        else edges[:, 0, ::-1] * (1.0, -1.0)
    )


def _normals(corners: np.ndarray) -> np.ndarray:
    """Unit normals (k, d) of plane facets by their corners (k, d, d)."""
    vectors = _vectors(corners)
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _rows(entries: list[int]) -> list[str]:
    """A data line of numbers, continued after every tenth."""
    rows = [", ".join(map(str, entries[k : k + 10])) for k in range(0, len(entries), 10)]
    return [f"{row}," for row in rows[:-1]] + rows[-1:]


def _kept(groups: dict[str, np.ndarray], members: np.ndarray, name: str, taken: set[str]) -> str:
    for other, some in groups.items():
        if np.array_equal(some, members):
            return other
    called = own_name(name, taken)
    groups[called] = members
    return called


def linear(points: np.ndarray, values: np.ndarray, axes: str) -> Any:
    """The formula of the linear function with these `values` (n,) at `points` (n, d); None if there is none."""
    size = np.abs(values).max(initial=0.0)
    middle = points.mean(axis=0)
    columns = np.column_stack([np.ones(len(points)), points - middle])
    found = np.linalg.lstsq(columns, values, rcond=1e-10)[0]
    if np.abs(columns @ found - values).max(initial=0.0) > EXACT * size:
        return None
    slopes = np.where(np.abs(found[1:]) * np.ptp(points, axis=0) > 1e-9 * size, found[1:], 0.0)
    slopes = np.array([float(f"{slope:.13g}") for slope in slopes.tolist()])
    # far from the origin the constant is large: it has the digits that the values need, and makes up for the slopes'
    constant = float(found[0] - slopes @ middle)
    spread = float(np.ptp(values)) or size
    digits = 13 - math.floor(math.log10(spread)) if spread else 0
    return formula(round(constant, digits) if abs(constant) > 1e-9 * size else 0.0, slopes, axes)


def formula(constant: float, slopes: np.ndarray, axes: str) -> Any:
    """A number, or a formula that is linear in the coordinates."""
    terms = [
        f"({slope!r}) * {axis}" for slope, axis in zip(slopes.tolist(), axes, strict=True) if slope
    ]
    return " + ".join([repr(constant), *terms]) if terms else constant
