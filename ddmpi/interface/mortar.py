"""Contact of two sides whose nodes do not match: dual mortar.

One side is the slave; its nodes carry the rows. With the dual functions ψ_j of its shape functions φ_j,

    D_j = ∫ φ_j,   P_jl = D_j⁻¹ ∫ ψ_j φ_l of the other side,   ∫ ψ_j φ_k = D_j δ_jk,   Σ_l P_jl = 1,

row j is the approach, along the contact's normal, of the slave's node j and the mean Σ_l P_jl u_l of the other side
(Wohlmuth, SIAM J. Numer. Anal. 38, 2000; Popp, Gitterle, Gee, Wall, Int. J. Numer. Meth. Engng. 83, 2010).
Integrals run over the part that faces the other side, cut at its projected corners, and ψ is dual over this part, so
that constant pressures are exact on any meshes. Gaps are those between the curves over the chords.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import msgspec
import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.interface import Drawing, Geometry, Interface, Lines, Partner, Places
from ddmpi.interface.law import law_of
from ddmpi.interface.matching import face_rigid, faces_rigid, pair
from ddmpi.interface.rows import (
    Rows,
    at_points,
    between,
    build,
    duals,
    holds_along,
    inset,
    is_held,
    rows_of,
)
from ddmpi.interface.trace import placed
from ddmpi.interface.vertices import BARELY, UNCOVERED, rows_at_vertices
from ddmpi.scene.contacts import Rigid, SettledContact
from ddmpi.sets import magnitude
from ddmpi.surface.cover import corners, cover, faced_arc
from ddmpi.surface.curve import Curve
from ddmpi.surface.cut import Cover
from ddmpi.surface.outline import Outline, outlined
from ddmpi.surface.side import Side, nodal, unit
from ddmpi.system.numbers import QUARTER, SAME, Frame, RigidMotion, divisor, in_words

SLIVER = 0.02
"""A facet covered by a smaller fraction has a constant dual function: 1 at the nearest corner, 0 at the others."""

UNSEEN = 1e-7
"""A node faces nothing if at most this fraction of its length is covered: then the other side ends at its neighbour."""


def connect(first: Side, second: Side, contact: SettledContact, refinement: int = 1) -> Interface:
    """The interface of two sides: by `pair` where nodes match, else by `mortar`, unless `contact.pairing` chooses."""
    # on curved surfaces with an overlap, mortar rows of matching meshes differ from pairs by about gap/R: pairs come
    # first where nodes match; triangles and quadrilaterals share a pressure among the same nodes in different ways
    paired = first.cell is second.cell and (first.cell.bears or contact.kind == "bonded")
    if contact.pairing == "nodes" and not paired:
        raise InputError(
            f"contact.{contact.name}.pairing: pairs of nodes are for linear tetrahedra, or linear bricks, or bonds, on "
            "both sides, as corners of quadratic ones carry no pressure; leave it out"
        )
    if contact.pairing != "mortar" and paired:
        try:
            return pair(first, second, contact, refinement)
        except InputError:
            if contact.pairing == "nodes":
                raise
    return mortar(first, second, contact)


def mortar(
    first: Side,
    second: Side,
    contact: SettledContact,
    over: Cover | None = None,
    moved: float = np.inf,
) -> Interface:
    """The interface of two sides whose nodes need not match; the first gives the directions. By default the `slave` is
    the side with the larger spacing of nodes, in space size of facets, over plane modulus, unless clamps constrain all
    of it. If the contact names the slave, `over` may be the part of it that faces the other side; `moved` as for
    `build`. Rows in space are those of `vertices`.

    Not collective. Raises InputError where the sides do not face each other, or the slave is wholly clamped.
    """
    sides, plane, covers = (first, second), isinstance(first, Curve), dict[int, Cover]()
    if over is not None:
        covers = {contact.roles.index(str(contact.slave)): over}
    elif plane:
        covers = {
            k: _cover(sides, k, contact.name)
            for k in (0, 1)
            if contact.slave != contact.roles[1 - k]
        }
    # in the plane the slave is chosen by the parts that face each other, in space by the whole sides
    slave = _choose_slave(
        sides,
        contact,
        [
            np.unique(covers[k].facet if k in covers else covers[1 - k].other)
            if plane
            else slice(None)
            for k in (0, 1)
        ],
    )
    over = covers[slave] if covers else _cover(sides, slave, contact.name)
    side, looked = sides[slave], over if plane else corners(over)
    hats = over.at if not plane and contact.kind == "bonded" else inset(side, over, looked)
    if plane:
        psi = _functions(side, over, hats)
        # Rows are merged twice: nodes that are hardly covered first, then rows that clamps nearly fix. Where two
        # contacts share a facet, its nodes carry rows of both, so coverage is that of the facet's own functions.
        root = _merged(side, over, _functions(side, over, over.at) if side.parted else psi)
        points = between(sides, slave, over)
        rows = _rows(points, sides, slave, over, psi, root)
        free = _unbound(rows, root, holds_along(contact))
        if (free != root).any():
            rows = replace(_rows(points, sides, slave, over, psi, free), bound=free != root)
    else:
        rows = rows_at_vertices(sides, slave, over.only(over.weight > 0.0), looked, contact)
    return build(replace(rows, covered=outlined(side, over, hats)), contact, moved)


def with_slave(first: Side, second: Side, contact: SettledContact) -> SettledContact:
    """The contact with one slave, wherever its bodies go; by default as of `mortar`, from the whole sides."""
    sides = first, second
    slave = contact.roles[_choose_slave(sides, contact, [slice(None)] * 2)]
    return msgspec.structs.replace(contact, slave=slave, pairing="mortar")


def meet(
    contact: SettledContact,
    sides: tuple[Side, Side | None],
    frames: Mapping[str, Frame],
    rigid: Mapping[str, Rigid],
    reach: tuple[float | None, float],
) -> Interface:
    """The interface of a contact where the frames of its bodies are. Not collective.

    Parameters
    ----------
    contact : names its slave
    sides : of both bodies in their frames; None for a rigid partner
    frames, rigid : by the names of bodies and rigid partners
    reach : depth (m) up to which to look for overlaps, None for the bodies' thickness; and `moved` of `build`
    """
    (first, second), (depth, moved) = sides, reach
    one, other = (frames[name] for name in contact.bodies)
    if second is None:  # in the frame of the partner, in which its shape is given
        partner = rigid[contact.bodies[1]]
        seen = first.placed(other.undone.after(one), depth)
        met = (
            face_rigid(seen, partner, contact, moved)
            if faces_rigid(seen, partner)
            else apart(contact, seen)
        )
        return placed(met, other)
    both = first.placed(one, depth), second.placed(other, depth)
    slave = contact.roles.index(str(contact.slave))
    over = cover(both[slave], both[1 - slave])
    return mortar(*both, contact, over, moved) if len(over.facet) else apart(contact, *both)


def apart(contact: SettledContact, first: Side, second: Side | None = None) -> Interface:
    """The interface of sides that do not face each other, or of one and a rigid partner: it has no rows. Not
    collective."""
    d, none, modulus = first.dimension, np.empty(0), second.modulus if second else np.inf
    at, square = np.empty((0, d)), sparse.csr_matrix((0, 0))
    facets, nowhere = np.empty((0, d), int), Places(normal=at)
    return Interface(
        name=contact.name,
        bodies=contact.bodies,
        geometry=Geometry(
            xy=at,
            tangents=np.empty((0, d - 1, d)),
            area=none,
            at=(at, at),
            facets=facets,
            laplacian=square,
            axisymmetric=first.axisymmetric,
        ),
        rows=nowhere,
        law=law_of(
            contact.friction, at, none, none, np.empty(0, int), contact.kind, np.empty(0, bool)
        ),
        modulus=1.0 / (1.0 / first.modulus + 1.0 / modulus),
        slave=contact.slave,
        partner=Partner(RigidMotion(np.zeros(d))),
        fixed=nowhere,
        probes=nowhere,
        drawing=Drawing(
            Lines(np.empty(0, int), at, none, facets), lambda: Outline(at, facets, square)
        ),
    )


def _cover(sides: tuple[Side, Side], slave: int, name: str) -> Cover:
    """The part of one of the sides that faces the other. Raises InputError if there is none."""
    over, (first, second) = cover(sides[slave], sides[1 - slave]), sides
    if len(over.facet) == 0:
        raise InputError(
            f"contact.{name}: the boundaries of {first.body!r} and {second.body!r} do not face each other "
            f"(the first begins at {in_words(first.xy[0])}). Are the two names of `on` in the order of "
            "`bodies`? Where bodies touch along an edge or at a vertex only, their nodes there must "
            'match, in space with linear elements, and pairing must not be "mortar"'
        )
    return over


def _functions(side: Side, over: Cover, at: np.ndarray) -> sparse.csr_matrix:
    """w ψ (q, k) of the slave's nodes at the points, with shape functions by the coordinates `at` (q, 2): `duals`; on a
    sliver 1 at the nearest corner, 0 at the others."""
    phi = side.cell.shapes(at)
    middle = nodal(over.weight[:, None] * over.at, over.facet, len(side.facets))
    nearest = np.arange(phi.shape[1]) == middle.argmax(axis=1)[:, None]
    weighted = duals(side, over, phi, SLIVER, nearest[over.facet])
    return at_points(weighted, side.facets[over.facet], len(side.nodes))


def _choose_slave(
    sides: tuple[Side, Side], contact: SettledContact, faced: Sequence[np.ndarray | slice]
) -> int:
    """0 or 1, the slave: the side that the contact names, else the less clamped one of the facets `faced`, else that of
    larger h/E'. Raises InputError where it is more clamped than the other."""
    clamped, sizes = [], []
    for side, some in zip(sides, faced, strict=True):
        nodes, size = np.unique(side.facets[some]), side.areas[some].mean() / len(side.cell.parts)
        free = side.free[nodes]
        # 0 free, 1 clamped along the normal, 2 clamped throughout (the trace of the projection counts free directions).
        # A clamped, finer slave would make C singular: it has more rows than the other side has nodes.
        clamped.append(
            int(is_held(side.normal[nodes], free).all())
            + int((np.einsum("kii->k", free) < 0.5).all())
        )
        # h/E': a fine and stiff slave against a coarse and soft master has errors of 15 to 150 % on Hertz's problem;
        # this rule never chooses it. A tie, up to rounding, goes to the first side.
        sizes.append(size ** (1.0 / (side.dimension - 1)) / side.modulus)
    if contact.slave is not None:
        slave = contact.roles.index(contact.slave)
    else:
        slave = (
            clamped.index(min(clamped))
            if clamped[0] != clamped[1]
            else int(sizes[1] > (1.0 + 1e-6) * sizes[0])
        )
    if clamped[slave] > clamped[1 - slave]:
        raise InputError(
            f"contact.{contact.name}: clamps constrain all of {sides[slave].body!r} at this contact; it "
            "cannot be the slave"
        )
    return slave


def _rows(
    points: Places,
    sides: tuple[Side, Side],
    slave: int,
    over: Cover,
    psi: sparse.csr_matrix,
    root: np.ndarray,
) -> Rows:
    """The rows of the slave, `sides[slave]`, with the `points` of `over`. A node uses the row of its `root` (k,)."""
    side, other, shown = sides[slave], sides[1 - slave], np.flatnonzero(root >= 0)
    coefficients = sparse.csr_matrix(
        (np.ones(len(shown)), (root[shown], shown)), (len(root), len(root))
    )
    at = points.transfer[:: 1 if slave == 0 else -1]
    # n_j ∝ n_slave − P n_master: opposite sides contribute alike, so that swapping the roles changes little.
    across = at[0] @ _normals(side, over.facet) - at[1] @ _normals(other, over.other)
    rows = rows_of(sides, slave, over, psi, coefficients, across, points)
    place = np.where(root >= 0, rows.place[root], -1)
    row = place[side.facets[over.facet]]
    rows = replace(
        rows,
        place=place,
        arc=side.arc[rows.nodes]
        if slave == 0
        else faced_arc(side.xy[rows.nodes], row, over, other),
    )
    lines = _lines(rows, over, psi)
    # A facet is whole if none of its nodes shares a row with another; bare nodes on the axis always do.
    number = np.bincount(lines.row, minlength=len(rows.nodes))
    number -= np.bincount(place[side.bare & (place >= 0)], minlength=len(rows.nodes))
    return replace(
        rows, lines=lines, whole=rows.whole & (number == 1)[place[side.facets]].all(axis=1)
    )


def _unbound(rows: Rows, root: np.ndarray, tangential: bool) -> np.ndarray:
    """The `root` of all nodes of the slave (k,), with rows merged into a neighbour's where clamps nearly fix the normal
    motion (BARELY) or, if the contact is `tangential`, a direction that is oblique to the contact."""
    side = rows.side
    clamped, most = rows.clamped(rows.normal)
    facets, roots = rows.place[side.facets[rows.seen]], root.copy()
    # Rows that both sides clamp carry no unknown: `build` drops them, and no other row may join them.
    most[clamped.all(axis=0)] = 0.0
    if tangential:
        # Unlike a plane of symmetry, a clamp oblique to the contact lets tangential forces pass.
        t = rows.normal @ QUARTER
        free = side.free[rows.nodes]
        slant = magnitude(np.einsum("rij,rj->ri", free, t))
        most[is_held(t, free) & (slant > SAME)] = 0.0
    ends = _tied_ends(rows)
    if np.count_nonzero(np.delete(most, ends) >= BARELY) > 1:  # a single row left would be a hinge
        most[ends] = 0.0
    for number in np.flatnonzero((most < BARELY) & ~clamped.all(axis=0)):
        near = np.unique(facets[(facets == number).any(axis=1)])
        near = rows.nodes[near[most[near] >= BARELY]]
        if len(near):
            node = rows.nodes[number]
            roots[root == node] = near[np.argmin(magnitude(side.xy[near] - side.xy[node]))]
    return roots


def _tied_ends(rows: Rows) -> np.ndarray:
    """The last rows at those ends of the slave's covered part where it and the nearest node of the other are `tied`."""
    side, other = rows.side, rows.other
    facets = side.facets[rows.seen]
    ends = np.flatnonzero(
        np.bincount(side.corners[rows.seen].ravel(), minlength=len(side.nodes)) == 1
    )
    ends = ends[side.tied[ends] & other.tied[cKDTree(other.xy).query(side.xy[ends])[1]]]
    last = rows.place[facets[(facets == ends[:, None, None]).any(axis=2).argmax(axis=1)]]
    away = magnitude(side.xy[rows.nodes[last]] - side.xy[ends][:, None])
    return last[np.arange(len(last)), away.argmin(axis=1)]


def _merged(side: Side, over: Cover, psi: sparse.csr_matrix) -> np.ndarray:
    """The node (k,) whose row a node of the slave uses: itself, a neighbour, or none (−1)."""
    D = np.asarray(psi.sum(axis=0)).ravel()
    some = side.among(over.facet)
    full = side.lengths_over(some)
    best = np.full(len(D), -1)
    # On a quadratic side of which less than 3/4 is covered, D of the far corner is negative; with small D of any sign a
    # pressure would be rounding. The same pressure as at the neighbour of the largest D keeps constants exact.
    thin = (full * UNCOVERED > D) | side.bare
    for facet in side.facets[some & thin[side.facets].any(axis=1)]:
        # At an axis the row of a middle counts; D of both ends may be the same.
        top = facet[2 if side.bare[facet].any() else np.argmax(D[facet])]
        for node in facet[thin[facet]]:
            if top != node and (best[node] < 0 or D[top] > D[best[node]]):
                best[node] = top
    root = np.where(full > 0.0, np.arange(len(D)), -1)
    # a thin node may lead to another one: follow them while D grows
    for node in np.flatnonzero(best >= 0):
        at = int(node)
        while best[at] >= 0 and D[best[at]] > D[at]:
            at = int(best[at])
        root[node] = at
    return root


def _lines(rows: Rows, over: Cover, psi: sparse.csr_matrix) -> Lines:
    """The nodes that carry the forces of the rows. A node has the length of its function, and its force acts at the
    function's centre, so that forces have the rows' resultant and moment. Nodes that face nothing are left out.
    """
    side, nodes, place = rows.side, rows.nodes, rows.place
    length = np.where(place >= 0, np.asarray(psi.sum(axis=0)).ravel(), 0.0)
    points = np.einsum("qc,qcd->qd", side.cell.shapes(over.at), side.xy[side.facets[over.facet]])
    faces = (length > UNSEEN * side.lengths_over(rows.seen)) | (side.bare & (place >= 0))
    faces[nodes] = True
    # The remainder of a row is the length of nodes that are left out.
    length[nodes] += rows.area - np.bincount(place[faces], length[faces])
    some = length > 0.0
    centre = np.where(some[:, None], psi.T @ points / divisor(length)[:, None], side.xy)
    # Centres that are the nodes but for rounding are the nodes.
    centre = np.where(np.abs(centre - side.xy) <= SAME * side.spacing[:, None], side.xy, centre)
    return Lines(place, side.xy, length, side.pieces(rows.seen), centre).only(faces)


def _normals(side: Side, facets: np.ndarray) -> np.ndarray:
    """Unit normals (k, 2) of the curves over some facets, averaged with the facets' lengths; zero at other nodes."""
    some = np.unique(facets)
    fans = unit(side.cell.nodes @ side.fans[some])
    return unit(nodal(side.lengths[some, None, None] * fans, side.facets[some], len(side.nodes)))
