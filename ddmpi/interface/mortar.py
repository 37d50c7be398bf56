"""Contact of two sides whose nodes do not match: dual mortar.

One side is the slave; its nodes carry the rows. With the dual functions ψ_j of its shape functions φ_j,

    D_j = ∫ φ_j,   P_jl = D_j⁻¹ ∫ ψ_j φ_l of the other side,   ∫ ψ_j φ_k = D_j δ_jk,   Σ_l P_jl = 1,

row j counts how far the slave's node j and the mean Σ_l P_jl u_l of the other side's move together along the contact's
normal (Wohlmuth, SIAM J. Numer. Anal. 38, 2000; Popp, Gitterle, Gee, Wall, Int. J. Numer. Meth. Engng. 83, 2010).
Integrals are over what faces the other side, cut where its corners are projected, and ψ is built there, so that a
constant pressure is exact on any meshes. Gaps are those of the boundaries that are meant: of the arcs over the chords.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.interface import SAME, Interface, Lines
from ddmpi.interface.matching import pair
from ddmpi.interface.rows import Rows, at_points, between, build, duals, holds_along, inset, is_held, rows_of
from ddmpi.interface.vertices import BARELY, UNCOVERED, rows_at_vertices
from ddmpi.scene.contacts import SettledContact
from ddmpi.surface.cover import corners, cover, faced_arc
from ddmpi.surface.cut import Cover
from ddmpi.surface.patch import Patch
from ddmpi.surface.side import Side, nodal, unit
from ddmpi.system.numbers import in_words

SLIVER = 0.02
"""A side of which a smaller part is covered has a constant dual function, of its nearest corner."""

UNSEEN = 1e-7
"""A node of whose length no more than this part is covered faces nothing: the other side ends at its neighbour."""


def connect(first: Side, second: Side, contact: SettledContact, refinement: int = 1) -> Interface:
    """The interface of two sides, as `pair` or `mortar`: by pairs where nodes match, or as `contact.pairing` says."""
    paired = first.cell.bears and second.cell.bears
    if contact.pairing == "nodes" and not paired:
        raise InputError(f"contact.{contact.name}.pairing: pairs of nodes are for linear tetrahedra, as corners of "
                         "quadratic ones carry no pressure; leave it out")
    if contact.pairing != "mortar" and paired:
        try:
            return pair(first, second, contact, refinement)
        except InputError:
            if contact.pairing == "nodes":
                raise
    return (mortar_in_space if isinstance(first, Patch) else mortar)(first, second, contact)


def mortar_in_space(first: Side, second: Side, contact: SettledContact) -> Interface:
    """`mortar` of two sides in space: rows at the vertices of the slave, see `vertices`.

    By default the slave is the side with the larger facets over plane modulus, and not one that clamps hold wholly.
    """
    sides = (first, second)
    own = _choose_slave(sides, contact, [slice(None)] * 2)
    over = _cover(sides, own, contact.name)
    return build(rows_at_vertices(sides, own, over.only(over.weight > 0.0), corners(over), contact), contact)


def mortar(first: Side, second: Side, contact: SettledContact) -> Interface:
    """The interface of two sides whose nodes need not match; the first gives the directions. By default the `slave` is
    the side with the larger spacing of nodes over plane modulus, and not one that clamps hold all along the contact.

    Not collective. Raises InputError when the sides do not face each other, or clamps hold all of the slave.
    """
    sides = (first, second)
    covers = {own: _cover(sides, own, contact.name) for own in (0, 1) if contact.slave != sides[1 - own].body}
    faced = [np.unique(covers[k].facet if k in covers else covers[1 - k].other) for k in (0, 1)]
    own = _choose_slave(sides, contact, faced)
    side, over = sides[own], covers[own]
    psi = _functions(side, over)
    root = _merged(side, over, psi)
    rows = _rows(sides, own, over, psi, root)
    free = _unbound(rows, root, holds_along(contact))
    if (free != root).any():
        rows = replace(_rows(sides, own, over, psi, free), bound=free != root)
    return build(rows, contact)


def _cover(sides: tuple[Side, Side], own: int, name: str) -> Cover:
    """The part of one of the sides that faces the other. Raises InputError if there is none."""
    over, (first, second) = cover(sides[own], sides[1 - own]), sides
    if len(over.facet) == 0:
        raise InputError(f"contact.{name}: the boundaries of {first.body!r} and {second.body!r} do not face each other "
                         f"(the first begins at {in_words(first.xy[0])}). Are the two names of `on` in the order of "
                         "`bodies`? Where bodies touch along an edge or at a vertex only, their nodes there must "
                         "match, in space with linear elements, and pairing must not be \"mortar\"")
    return over


def _functions(side: Side, over: Cover) -> sparse.csr_matrix:
    """w ψ (q, k) of the slave's nodes at the points: `duals`; on a sliver the nearest corner has one alone."""
    phi = side.cell.shapes(inset(over, over))
    middle = nodal(over.weight[:, None] * over.at, over.facet, len(side.facets))
    nearest = np.arange(phi.shape[1]) == middle.argmax(axis=1)[:, None]
    weighted = duals(side, over, phi, SLIVER, nearest[over.facet])
    return at_points(weighted, side.facets[over.facet], len(side.nodes))


def _choose_slave(sides: tuple[Side, Side], contact: SettledContact, faced: Sequence[np.ndarray | slice]) -> int:
    """0 or 1, the slave: the side that is named, else the one that clamps hold less all along the facets `faced` of
    each side, else that of larger facets over modulus. Raises InputError where clamps hold it more than the other."""
    held, sizes = [], []
    for side, some in zip(sides, faced, strict=True):
        nodes, size = np.unique(side.facets[some]), side.areas[some].mean() / len(side.cell.parts)
        free = side.free[nodes]
        held.append(int(is_held(side.normal[nodes], free).all()) + int((np.einsum("kii->k", free) < 0.5).all()))
        sizes.append(size ** (1.0 / (side.dimension - 1)) / side.modulus)
    if contact.slave is not None:
        own = [side.body for side in sides].index(contact.slave)
    else:
        own = held.index(min(held)) if held[0] != held[1] else int(sizes[1] > (1.0 + 1e-6) * sizes[0])
    if held[own] > held[1 - own]:
        raise InputError(f"contact.{contact.name}: clamps hold all of {sides[own].body!r} at this contact; it cannot "
                         "be the slave")
    return own


def _rows(sides: tuple[Side, Side], own: int, over: Cover, psi: sparse.csr_matrix, root: np.ndarray) -> Rows:
    """The rows of the slave, `sides[own]`, whose nodes share those of their `root` (k,)."""
    side, other, shown = sides[own], sides[1 - own], np.flatnonzero(root >= 0)
    parts = sparse.csr_matrix((np.ones(len(shown)), (root[shown], shown)), (len(root), len(root)))
    at = between(sides, own, over).transfer[::1 if own == 0 else -1]
    across = at[0] @ _normals(side, over.facet) - at[1] @ _normals(other, over.other)
    rows = rows_of(sides, own, over, psi, parts, across)
    place = np.where(root >= 0, rows.place[root], -1)
    row = place[side.facets[over.facet]]
    rows = replace(rows, place=place, arc=side.arc[rows.nodes] if own == 0 else
                   faced_arc(side.xy[rows.nodes], row, over, other))
    lines = _lines(rows, over, psi)
    number = np.bincount(lines.row, minlength=len(rows.nodes))
    number -= np.bincount(place[side.bare & (place >= 0)], minlength=len(rows.nodes))
    return replace(rows, lines=lines, whole=rows.whole & (number == 1)[place[side.facets]].all(axis=1))


def _unbound(rows: Rows, root: np.ndarray, tangential: bool) -> np.ndarray:
    """The `root` of each of the slave's nodes (k,), where rows that are nearly fixed along the normal (BARELY), or by a
    clamp aslant if the contact is `tangential`, are merged with a neighbour."""
    side = rows.sides[rows.own]
    held, most = rows.held(rows.normal)
    facets, found = rows.place[side.facets[rows.seen]], root.copy()
    most[held.all(axis=0)] = 0.0
    if tangential:  # a clamp aslant to the contact is no plane of symmetry: forces along the contact go through there
        t = np.column_stack([-rows.normal[:, 1], rows.normal[:, 0]])
        free = side.free[rows.nodes]
        slant = np.linalg.norm(np.einsum("rij,rj->ri", free, t), axis=1)
        most[is_held(t, free) & (slant > SAME)] = 0.0
    ends = _tied_ends(rows)
    if np.count_nonzero(np.delete(most, ends) >= BARELY) > 1:  # one row would be a hinge
        most[ends] = 0.0
    for number in np.flatnonzero((most < BARELY) & ~held.all(axis=0)):
        near = np.unique(facets[(facets == number).any(axis=1)])
        near = rows.nodes[near[most[near] >= BARELY]]
        if len(near):
            here = rows.nodes[number]
            found[root == here] = near[np.argmin(np.linalg.norm(side.xy[near] - side.xy[here], axis=1))]
    return found


def _tied_ends(rows: Rows) -> np.ndarray:
    """The last rows at ends of the slave's covered part where both bodies are `tied`, the other at its nearest node."""
    side, other = rows.sides[rows.own], rows.sides[1 - rows.own]
    facets = side.facets[rows.seen]
    ends = np.flatnonzero(np.bincount(side.corners[rows.seen].ravel(), minlength=len(side.nodes)) == 1)
    ends = ends[side.tied[ends] & other.tied[cKDTree(other.xy).query(side.xy[ends])[1]]]
    last = rows.place[facets[(facets == ends[:, None, None]).any(axis=2).argmax(axis=1)]]
    away = np.linalg.norm(side.xy[rows.nodes[last]] - side.xy[ends][:, None], axis=2)
    return last[np.arange(len(last)), away.argmin(axis=1)]


def _merged(side: Side, over: Cover, psi: sparse.csr_matrix) -> np.ndarray:
    """Of each of the slave's nodes (k,) the one whose row it has: its own, a neighbour's, or none (−1)."""
    D = np.asarray(psi.sum(axis=0)).ravel()
    some = np.isin(np.arange(len(side.facets)), over.facet)
    full = side.lengths_over(some)
    best = np.full(len(D), -1)
    thin = (full * UNCOVERED > D) | side.bare
    for facet in side.facets[some & thin[side.facets].any(axis=1)]:
        top = facet[2 if side.bare[facet].any() else np.argmax(D[facet])]  # D of the other end may be the same
        for node in facet[thin[facet]]:
            if top != node and (best[node] < 0 or D[top] > D[best[node]]):
                best[node] = top
    root = np.where(full > 0.0, np.arange(len(D)), -1)
    for node in np.flatnonzero(best >= 0):
        at = int(node)
        while best[at] >= 0 and D[best[at]] > D[at]:
            at = int(best[at])
        root[node] = at
    return root


def _lines(rows: Rows, over: Cover, psi: sparse.csr_matrix) -> Lines:
    """The nodes for which the rows stand, each with the length and the centre of its own function, where the forces
    have the rows' resultant and moment. A node of whose facets no more than the part UNSEEN is covered faces nothing."""
    side, nodes, place = rows.sides[rows.own], rows.nodes, rows.place
    length = np.where(place >= 0, np.asarray(psi.sum(axis=0)).ravel(), 0.0)
    points = np.einsum("qc,qcd->qd", side.cell.shapes(over.at), side.xy[side.facets[over.facet]])
    faces = (length > UNSEEN * side.lengths_over(rows.seen)) | (side.bare & (place >= 0))
    faces[nodes] = True
    length[nodes] += rows.area - np.bincount(place[faces], length[faces])  # what is left out
    some = length > 0.0
    centre = np.where(some[:, None], psi.T @ points / np.where(some, length, 1.0)[:, None], side.xy)
    return Lines(place, side.xy, length, side.pieces(rows.seen), centre).only(faces)


def _normals(side: Side, facets: np.ndarray) -> np.ndarray:
    """Unit normals (k, 2) of the arcs over some of the facets, averaged with their lengths; else zero."""
    some = np.unique(facets)
    fans = unit(side.cell.nodes @ side.fans[some])
    return unit(nodal(side.lengths[some, None, None] * fans, side.facets[some], len(side.nodes)))
