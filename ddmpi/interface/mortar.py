"""Contact of two sides whose nodes do not match: dual mortar.

One side is the slave; its nodes carry the rows. With the dual functions ψ_j of its shape functions φ_j,

    D_j = ∫ φ_j,   P_jl = D_j⁻¹ ∫ ψ_j φ_l of the other side,   ∫ ψ_j φ_k = D_j δ_jk,   Σ_l P_jl = 1,

row j counts how far the slave's node j and the mean Σ_l P_jl u_l of the other side's move together along the contact's
normal (Wohlmuth, SIAM J. Numer. Anal. 38, 2000; Popp, Gitterle, Gee, Wall, Int. J. Numer. Meth. Engng. 83, 2010).
Integrals are over what faces the other side, cut where its corners are projected, and ψ is built there, so that a
constant pressure is exact on any meshes. Gaps are those of the boundaries that are meant: of the arcs over the chords.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.cover import Cover, cover, faced_arc, unit
from ddmpi.interface.interface import Interface, Lines, Places, in_order
from ddmpi.interface.law import law_of
from ddmpi.interface.matching import NO_GAP, initial_gap, is_held, pair
from ddmpi.interface.side import Side
from ddmpi.mesh.boundary import segments
from ddmpi.mesh.elements import shapes_on_side as shapes
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca
from ddmpi.scene.values import Profile

SLIVER = 0.02
"""A side of which a smaller part is covered has a constant dual function, of its nearest corner."""

UNCOVERED = 0.15
"""A node of whose length a smaller part is covered shares the row of its neighbour."""

BARELY = 0.5
"""Rows that clamps let move by less than this, where free nodes move by one, are merged with a neighbour. Alone they
would constrain curvature and carry arbitrary forces."""

UNSEEN = 1e-7
"""A node of whose length no more than this part is covered faces nothing: the other side ends at its neighbour."""

LACKING = 1e-3
"""A facet of which no more than this part is not covered has a mean stress."""

NOTHING = 1e-12
"""Entries of P below this are rounding."""


def join(first: Side, second: Side, friction: Coulomb | Tresca | NoFriction, name: str, refinement: int = 1,
         gap: float | Profile | None = None, kind: str = "unilateral", pairing: str | None = None,
         slave: str | None = None) -> Interface:
    """The interface of two sides: by pairs of nodes where they match, else by mortar; or as `pairing` says.

    Parameters
    ----------
    pairing : "nodes", "mortar" or None

    Otherwise as `pair` and `mortar`.
    """
    if pairing != "mortar":
        try:
            return pair(first, second, friction, name, refinement, gap, kind)
        except InputError:
            if pairing == "nodes":
                raise
    return mortar(first, second, friction, name, gap, kind, slave)


def mortar(first: Side, second: Side, friction: Coulomb | Tresca | NoFriction, name: str,
           gap: float | Profile | None = None, kind: str = "unilateral", slave: str | None = None) -> Interface:
    """The interface of two sides whose nodes need not match.

    Parameters
    ----------
    first, second : the sides; the first gives the directions
    friction, name, gap, kind : as for `pair`
    slave : name of the body whose nodes carry the rows; by default the one with the larger spacing of nodes over
        plane modulus, and not one that clamps hold all along the contact

    Raises
    ------
    InputError
        when the sides do not face each other, or clamps hold all of the slave. Not collective.
    """
    sides = first, second
    covers = [None if slave == sides[1 - own].body else cover(sides[own], sides[1 - own]) for own in (0, 1)]
    if any(each is not None and len(each.link) == 0 for each in covers):
        x, y = first.xy[0]
        raise InputError(f"contact.{name}: the boundaries of {first.body!r} and {second.body!r} do not face each other "
                         f"(the first begins at ({x:.6g}, {y:.6g})). Are the two names of `on` in the order of "
                         "`bodies`?")
    own = _choose_slave(sides, covers, name) if slave is None else (first.body, second.body).index(slave)
    here, over = sides[own], covers[own]
    assert over is not None
    if _is_rigid(here, over):
        raise InputError(f"contact.{name}: clamps hold all of {here.body!r} at this contact; it cannot be the slave")
    return _lay(sides, own, over, friction, name, gap, kind)


def duals(side: Side, over: Cover) -> tuple[np.ndarray, np.ndarray]:
    """The weighted dual functions w ψ (q, 2 or 3) of each point's link, and shape functions φ, for the slave.

    ∫ ψ_j φ_k = δ_jk ∫ φ_j over the covered part of a link. Of a sliver only the nearest corner has a function.
    """
    phi = shapes(over.at, side.links.shape[1])
    covered, part = np.unique(over.link, return_inverse=True)
    share, middle = (np.bincount(part, each, len(covered)) for each in (over.weight, over.weight * over.at))
    lengths = np.zeros((len(covered), phi.shape[1]))
    np.add.at(lengths, part, over.weight[:, None] * phi)
    mass = np.zeros((*lengths.shape, phi.shape[1]))
    np.add.at(mass, part, np.einsum("q,qi,qj->qij", over.weight, phi, phi))
    sliver = share < SLIVER * side.lengths[covered]
    mass[sliver] = np.eye(phi.shape[1])
    psi = np.einsum("qi,qij->qj", phi, np.linalg.inv(mass)[part]) * lengths[part]
    nearest = np.arange(phi.shape[1]) == np.where(middle < 0.5 * share, 0, 1)[:, None]
    weighted = over.weight[:, None] * np.where(sliver[part, None], nearest[part], psi)
    return weighted, phi


def _choose_slave(sides: tuple[Side, Side], covers: list[Cover | None], name: str) -> int:
    """0 or 1: the side with the larger spacing over modulus, where it faces the other."""
    rigid = [over is not None and _is_rigid(side, over) for side, over in zip(sides, covers, strict=True)]
    if all(rigid):
        raise InputError(f"contact.{name}: all nodes of the contact are clamped; there is nothing to solve")
    if any(rigid):
        return rigid.index(False)
    softness = []
    for side, over in zip(sides, covers, strict=True):
        assert over is not None
        length = np.linalg.norm(side.along[np.unique(over.link)], axis=1)
        softness.append(float(length.mean()) / (side.links.shape[1] - 1) / side.modulus)
    return 1 if softness[1] > (1.0 + 1e-6) * softness[0] else 0


def _is_rigid(side: Side, over: Cover) -> bool:
    """Whether clamps hold all nodes that face the other side along their normals."""
    nodes = np.unique(side.links[over.link])
    return bool(is_held(side.normal[nodes], side.free[nodes]).all())


@dataclass(frozen=True)
class _Rows:
    """The rows of the slave's nodes.

    Attributes
    ----------
    place : (k,) the row of each node, or −1
    rooted : (m,) the node that each stands at
    area : (m,) ∫ ψ (m)
    transfers : of the slave and of the other side, (m, ·), rows that sum to one
    normal : (m, 2) the slave's
    """

    place: np.ndarray
    rooted: np.ndarray
    area: np.ndarray
    transfers: tuple[sparse.csr_matrix, sparse.csr_matrix]
    normal: np.ndarray

    @property
    def tangent(self) -> np.ndarray:
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])

    def held(self, sides: tuple[Side, Side], direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether clamps hold all nodes of each side (2, m) that a row moves with along its direction (m, 2); and how
        far it moves where free nodes of a side move by one, the larger of both (m,)."""
        held, most = np.empty((2, len(direction)), bool), np.zeros(len(direction))
        for number, (side, transfer) in enumerate(zip(sides, self.transfers, strict=True)):
            entries = transfer.tocoo()
            moves = ~is_held(direction[entries.row], side.free[entries.col])
            held[number] = np.bincount(entries.row, moves, len(direction)) == 0
            most = np.maximum(most, np.abs(np.bincount(entries.row, entries.data * moves, len(direction))))
        return held, most


def _rows(sides: tuple[Side, Side], over: Cover, weighted: np.ndarray, D: np.ndarray, root: np.ndarray) -> _Rows:
    """The rows of the slave, the first side, whose nodes share those of their `root`."""
    side, other = sides
    shown = np.flatnonzero(root >= 0)
    rooted, row = np.unique(root[shown], return_inverse=True)
    area, place = np.bincount(row, D[shown]), np.full(len(D), -1)
    place[shown] = row

    def spread(at: np.ndarray, nodes: np.ndarray, size: int) -> sparse.csr_matrix:
        """D⁻¹ ∫ ψ φ as a matrix (m, size), of the shape functions of `nodes` (q, c) of links at points (q,)."""
        entries = np.einsum("qj,qc->qjc", weighted, shapes(at, nodes.shape[1]))
        rows = np.broadcast_to(place[side.links[over.link]][:, :, None], entries.shape)
        columns = np.broadcast_to(nodes[:, None, :], entries.shape)
        found = sparse.csr_matrix((entries.ravel(), (rows.ravel(), columns.ravel())), (len(area), size))
        found.data[np.abs(found.data) <= NOTHING * area.repeat(np.diff(found.indptr))] = 0.0
        found.eliminate_zeros()
        return (sparse.diags(1.0 / np.asarray(found.sum(axis=1)).ravel()) @ found).tocsr()

    S = spread(over.at, side.links[over.link], len(side.nodes))
    P = spread(over.there, other.links[over.other], len(other.nodes))
    seen, met = np.zeros(len(side.links), bool), np.zeros(len(other.links), bool)
    seen[over.link], met[over.other] = True, True
    return _Rows(place, rooted, area, (S, P), unit(S @ _normals(side, seen) - P @ _normals(other, met)))


def _unbound(sides: tuple[Side, Side], over: Cover, rows: _Rows, tangential: bool, root: np.ndarray) -> np.ndarray:
    """The `root` of each of the slave's nodes (k,), where rows nearly fixed by clamps or other contacts are merged with
    a neighbour."""
    held, most = rows.held(sides, rows.normal)
    if tangential:
        both, along = rows.held(sides, rows.tangent)
        most = np.where(both.all(axis=0), most, np.minimum(most, along))
    links, found = rows.place[sides[0].links[np.unique(over.link)]], root.copy()
    most[held.all(axis=0)] = 0.0
    ends = _tied_ends(*sides, over, rows)
    if np.count_nonzero(np.delete(most, ends) >= BARELY) > 1:  # one row would be a hinge
        most[ends] = 0.0
    for number in np.flatnonzero((most < BARELY) & ~held.all(axis=0)):
        near = np.unique(links[(links == number).any(axis=1)])
        near = rows.rooted[near[(near >= 0) & (most[near] >= BARELY)]]
        if len(near):
            here = rows.rooted[number]
            found[root == here] = near[np.argmin(np.linalg.norm(sides[0].xy[near] - sides[0].xy[here], axis=1))]
    return found


def _tied_ends(side: Side, other: Side, over: Cover, rows: _Rows) -> np.ndarray:
    """The last rows at ends of the slave's covered part where both bodies are `tied`, the other at its nearest node."""
    links = side.links[np.unique(over.link)]
    ends = np.flatnonzero(np.bincount(links[:, :2].ravel(), minlength=len(side.nodes)) == 1)
    ends = ends[side.tied[ends] & other.tied[cKDTree(other.xy).query(side.xy[ends])[1]]]
    last = rows.place[links[(links == ends[:, None, None]).any(axis=2).argmax(axis=1)]]
    away = np.linalg.norm(side.xy[rows.rooted[last]] - side.xy[ends][:, None], axis=2)
    return last[np.arange(len(last)), away.argmin(axis=1)]


def _merged(side: Side, over: Cover, D: np.ndarray) -> np.ndarray:
    """Of each of the slave's nodes (k,) the one whose row it has: its own, a neighbour's, or none (−1)."""
    covered = np.unique(over.link)
    some = np.zeros(len(side.links), bool)
    some[covered] = True
    full = side.lengths_over(some)
    best = np.full(len(D), -1)
    thin = full * UNCOVERED > D
    for link in side.links[covered][thin[side.links[covered]].any(axis=1)]:
        top = link[np.argmax(D[link])]
        for node in link[thin[link]]:
            if top != node and (best[node] < 0 or D[top] > D[best[node]]):
                best[node] = top
    root = np.where(full > 0.0, np.arange(len(D)), -1)
    for node in np.flatnonzero(best >= 0):
        at = int(node)
        while best[at] >= 0 and D[best[at]] > D[at]:
            at = int(best[at])
        root[node] = at
    return root


def _lay(sides: tuple[Side, Side], own: int, over: Cover, friction: Coulomb | Tresca | NoFriction, name: str,
         gap: float | Profile | None, kind: str) -> Interface:
    """The interface whose rows stand at the nodes of the slave, `sides[own]`, that face the other side."""
    side, other = slave = sides[own], sides[1 - own]
    weighted, phi = duals(side, over)
    nodes, share = side.links[over.link], np.bincount(over.link, over.weight, len(side.links))
    D = np.bincount(nodes.ravel(), weighted.ravel(), len(side.nodes))
    bonded = kind == "bonded"
    has_tangents = bonded or not isinstance(friction, NoFriction)
    root = _merged(side, over, D)
    rows = _rows(slave, over, weighted, D, root)
    free = _unbound(slave, over, rows, has_tangents, root)
    if (free != root).any():
        rows = _rows(slave, over, weighted, D, free)
    rooted, area, normal = rows.rooted, rows.area, rows.normal
    m, place = len(rooted), rows.place
    ray = unit(_means(weighted, place[nodes], over.direction, m))
    measured = _means(weighted, place[nodes], over.gap[:, None], m)[:, 0] / area
    measured *= np.einsum("ij,ij->i", ray, normal)
    measured[np.abs(measured) <= NO_GAP * side.spacing[rooted]] = 0.0
    arc = side.arc[rooted] if own == 0 else faced_arc(side.xy[rooted], place[nodes], over, other)
    start = initial_gap(gap, kind, measured, side.xy[rooted], arc)

    (held_normal, _), (held_tangential, _) = (rows.held(slave, each) for each in (normal, rows.tangent))
    dropped = (held_normal & held_tangential if bonded else held_normal).all(axis=0)
    keep = np.flatnonzero(~dropped)
    if len(keep) == 0:
        raise InputError(f"contact.{name}: all nodes of the contact are clamped; there is nothing to solve")
    sliding = np.flatnonzero(~held_tangential[:, keep].all(axis=0)) if has_tangents else np.empty(0, int)

    transfers = rows.transfers if own == 0 else rows.transfers[::-1]
    normal = normal if own == 0 else -normal
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    xy, seen = side.xy[rooted], np.bincount(over.link, minlength=len(side.links)) > 0
    lines, kept = _lines(side, rows, seen), np.full(m + 1, -1)
    kept[keep] = np.arange(len(keep))
    alone, carry = np.bincount(lines.row, minlength=m) == 1, kept[lines.row] >= 0
    at_node = np.full(len(side.nodes), -1)
    at_node[rooted[alone]] = kept[:-1][alone]
    facets = at_node[side.links]
    whole = (facets >= 0).all(axis=1) & (share >= (1.0 - LACKING) * side.lengths)
    forward = over.direction if own == 0 else -over.direction
    probes = [_at(phi, nodes, len(side.nodes)),
              _at(shapes(over.there, other.links.shape[1]), other.links[over.other], len(other.nodes))]
    between = over.gap if gap is None and not bonded else _means_at(phi, place[nodes], start)
    if not bonded:  # what overlaps between clamps stays
        stays = [at @ is_held(each.normal, each.free) for at, each in zip(probes, slave, strict=True)]
        between = between - np.clip(np.min(stays, axis=0), 0.0, 1.0) * np.minimum(between, 0.0)
    used = [_used(each.nodes, transfer[keep]) for each, transfer in zip(sides, transfers, strict=True)]
    return Interface(
        name=name, bodies=(sides[0].body, sides[1].body), xy=xy[keep],
        frame=np.stack([normal[keep], tangent[keep]], axis=1), area=area[keep], gap=start[keep], arc=arc[keep],
        nodes=(used[0][0], used[1][0]), transfer=(used[0][1], used[1][1]),
        law=law_of(friction, xy[keep], arc[keep], area[keep], sliding, kind),
        modulus=1.0 / (1.0 / side.modulus + 1.0 / other.modulus), facets=facets[whole],
        laplacian=side.laplacian(seen, kept[np.where(free == root, place, -1)], len(keep)),
        one_sided=np.concatenate([held_normal.any(axis=0)[keep], held_tangential.any(axis=0)[keep][sliding]]),
        prescribed=np.zeros(len(keep) + len(sliding)),
        fixed=Places((sides[0].nodes, sides[1].nodes), normal[dropped], start[dropped],
                     (transfers[0][dropped], transfers[1][dropped])),
        at=(transfers[0][keep] @ sides[0].xy, transfers[1][keep] @ sides[1].xy), slave=side.body,
        lines=replace(lines, row=kept[lines.row]).only(carry),
        probes=Places((sides[0].nodes, sides[1].nodes), forward, between,
                      (probes[own], probes[1 - own])))


def _lines(side: Side, rows: _Rows, seen: np.ndarray) -> Lines:
    """The nodes on which the rows act, each with its part of its row's length.

    So the forces on the nodes have the rows' resultant and moment. A node whose part is no more than UNSEEN of what the
    links `seen` (ns,) give it faces nothing and is left out.
    """
    entries, length = rows.transfers[0].tocoo(), np.zeros(len(rows.place))
    own = rows.place[entries.col] == entries.row
    length[entries.col[own]] = (rows.area[entries.row] * entries.data)[own]
    faces = np.abs(length) > UNSEEN * side.lengths_over(seen)
    faces[rows.rooted] = True
    length[rows.rooted] += rows.area - np.bincount(rows.place[faces], length[faces])  # what is left out
    return Lines(rows.place, side.xy, length, in_order(segments(side.links[seen]))).only(faces)


def _normals(side: Side, some: np.ndarray) -> np.ndarray:
    """Unit normals (k, 2) of the arcs over some of the links (ns,) bool, averaged with their lengths; else zero."""
    fans = side.fans[some]
    if side.links.shape[1] == 3:
        fans = np.concatenate([fans, unit(fans.sum(axis=1))[:, None]], axis=1)
    total, length = np.zeros_like(side.xy), side.lengths[some]
    np.add.at(total, side.links[some], length[:, None, None] * fans)
    return unit(total)


def _means(weighted: np.ndarray, rows: np.ndarray, values: np.ndarray, m: int) -> np.ndarray:
    """∫ ψ f (m, c) of values (q, c) of f."""
    return np.column_stack([np.bincount(rows.ravel(), (weighted * each[:, None]).ravel(), m) for each in values.T])


def _means_at(phi: np.ndarray, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The function (q,) whose values (m,) at the nodes are given, at the points."""
    return np.einsum("qj,qj->q", phi, values[rows])


def _at(phi: np.ndarray, nodes: np.ndarray, size: int) -> sparse.csr_matrix:
    """The matrix (q, size) of the shape functions (q, j) of `nodes` (q, j) at points."""
    rows = np.repeat(np.arange(len(phi)), phi.shape[1])
    return sparse.csr_matrix((phi.ravel(), (rows, nodes.ravel())), (len(phi), size))


def _used(nodes: np.ndarray, transfer: sparse.csr_matrix) -> tuple[np.ndarray, sparse.csr_matrix]:
    """The nodes that a transfer has entries of, and the transfer to these."""
    columns = np.unique(transfer.indices)
    return nodes[columns], transfer[:, columns]
