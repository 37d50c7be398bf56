"""How far results are from those of the continuum: the errors of meshes, in the results' own units.

A result J of a discrete answer u_h has the error, with the displacement z of its adjoint problem (Becker and Rannacher,
Acta Numerica 10, 2001),

    J(u) − J(u_h) ≈ Σ_K η_K,    η_K = ∫_K (σ*_u − σ_h,u) : C⁻¹ : (σ*_z − σ_h,z)

with the recovered stresses σ* of `body.estimate` for both. The strain energy of a body is quadratic: its dual at the mean
of u and u_h is ½ (u + u_h) + y there, where no load in the body acts on y, so that z − z_h = ½ e_u + e_y, y_h = z_h − u_h.
Both are recovered from where they are smooth.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.estimate import Moved, differences, relative_error
from ddmpi.body.stress import Composite
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import ActiveSet
from ddmpi.interface.state import ContactState
from ddmpi.mesh.boundary import SHARPEST, Creases, corner_normals, creases
from ddmpi.mesh.elements import curved_facets, facet_measures, normals
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Material
from ddmpi.scene.results import Named
from ddmpi.sets import magnitude
from ddmpi.surface.side import unit

UNSOLVED = "its equations are not solved"
UNDETERMINED = "not determined"
UNCERTIFIED = "the answer is not certified"
LOCKED = "linear cells lock"
COARSE = "the mesh is too coarse"
ENDLESS = "grows with finer meshes, has no limit"
UNRESOLVED = "not resolved"
LONELY = "carried by one node"
PARTIAL = "part of a resultant"
PATCHY = "covers a part of its sides"
STEPPED = "of all load steps"
"""Words in the place of bars."""

FINAL = (UNSOLVED, UNDETERMINED, LOCKED, ENDLESS, STEPPED)
"""Those of them that finer meshes leave."""

FACTORS = {1: 0.8, 2: 1.4}
"""Of |Σ η_K| and the stars in a bar, by the order of the elements: docs/tables/errors.md has how they were found. Those
of linear cells contain a part of the scatter of stresses."""

LARGEST = 0.25
"""The largest estimated error in the energy norm with which bars of any size are told, and the largest bar over the
value that is told above it: 98 % of these cover."""

KINK, AT_END = 0.15, 0.04
"""By how much a largest value may differ from those beside it, and where it is at the end of a contact."""

JUMP = 0.3
"""δ of a resultant from which its dual jumps where a clamp or a contact ends, inside a structure, so that its recovered
stress tells little: then the bar has at least the SHARE of ‖e_u‖ ‖e_z‖."""

SHARE = 0.25

RUBS = 3
"""Fewest nodes of a contact that slip for their work to be told."""

COVERED = 0.01
"""By how much the area of a contact's nodes may differ from that of the smaller side for a bar of any size of the mean
pressure."""

ROUNDED = 60.0
"""Parabolas through circles are off by the gap h φ³/ROUNDED, see `ends_of_contact`. With it bars cover on all fits of
`scripts/study errors` whose overlap is that of the meshes; with 150 they cover 75 % of the numbers of tubes."""

SCATTERED = 6.0
"""How many times as far gaps between curved quadratic sides are off at most as they differ at neighbours: their means over
nodes hide a part. In the plane, where gaps are of arcs, circles of 12 and 15 cells are off by six times that."""

BEYOND = 1.5
"""How far the largest stress may be from that of its cell, over the distance of the recovered one: both fall short of a
stress that is largest at a curved boundary. With 1 bars of linear elements cover 88 % of the new problems, with this 94 %."""

FLOOR = 1e-5
"""Least bar, over the largest number of the same quantity: the certificate promises no more. Where all of these are
rounding, the least bar is that rounding."""


RESULTANTS = ("force", "normal_force", "tangential_force", "pressure_mean", "moment", "reaction")


class Bar(NamedTuple):
    """A result with its bar, or a word in its place.

    Attributes
    ----------
    rough : about what the bar would be without the word; nan if unknown
    excess : how far a largest value differs from those beside it over what is allowed, for the words that say so
    floor : the least bar on any mesh
    """

    value: float | None
    bar: float | None
    word: str
    rough: float = np.nan
    excess: float = 0.0
    floor: float = 0.0

    def told(self) -> dict[str, float | str | None]:
        """Its entry in the summary."""
        return {"value": self.value, "bar": self.bar, "word": self.word}


class Dual(NamedTuple):
    """The adjoint displacement of a body by a result.

    Attributes
    ----------
    z : (nv, d)
    energy : whether the result is the energy of this body
    taken : (d,) what the reaction of this body takes of its loads; zero for other results
    """

    z: np.ndarray
    energy: bool
    taken: np.ndarray


@dataclass(frozen=True)
class Measured:
    """What is known of the error of a result, in its unit.

    Attributes
    ----------
    signed : Σ_K η_K, about the exact value less the computed one
    stars : as of `Parts`
    own, square, size : `squares` of `Parts`
    straight : as of `Parts`
    moved, rubbed, left, rounded, terms : as of `ends_of_contact`
    noise : rounding of the forces in bodies, as a value of this result
    area : of a mean pressure, by how much the area differs from that of the smaller side, over itself
    kink, peak : of a largest value, as of `kink_of_pressure` and `kink_of_stress`
    corner : by how much the corners of halved straight sides raise a largest value, as of `corners_of`
    word : why there is no bar; empty if there is one
    cells : by body of this rank η_K (nt,)
    """

    signed: float = np.nan
    stars: float = np.nan
    own: float = np.nan
    square: float = np.nan
    size: float = np.nan
    straight: float = np.nan
    moved: float = np.nan
    rubbed: float = np.nan
    left: float = np.nan
    rounded: float = 0.0
    terms: float = 0.0
    noise: float = 0.0
    area: float = 0.0
    kink: float = 0.0
    peak: float = 0.0
    corner: float = 0.0
    word: str = ""
    cells: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def schwarz(self) -> float:
        """‖e_u‖ ‖e_z‖ in the energy norm."""
        return float(np.sqrt(self.own * self.square))

    @property
    def delta(self) -> float:
        """‖e_z‖ / ‖z‖ in the energy norm."""
        return relative_error(self.square, self.size)


class Straight(NamedTuple):
    """What straight sides leave out of a smooth boundary.

    Attributes
    ----------
    volume : (f,) by which it stands out over the facets, negative where it is hollow (m³; in the plane per metre of
        depth; around an axis of the whole circumference)
    bent : (nv,) squares of the angle by which it turns along a side
    rims : (nv,) in space, the angle by which a smooth edge of the boundary turns at a node, as the rim of a flat end
    turn : (nv,) this angle, of the sides at a node the largest, negative where the boundary is hollow
    """

    volume: np.ndarray
    bent: np.ndarray
    rims: np.ndarray
    turn: np.ndarray


class Parts(NamedTuple):
    """What a body adds to the errors of k results, in their units.

    Attributes
    ----------
    cells : (k, nt) η_K
    stars : (k,) Σ_v |Σ_K ∫_K φ_v (σ*_u − σ_h,u) : C⁻¹ : (σ*_z − σ_h,z)| with the hat functions φ_v of the vertices
    squares : (k, 3) ∫ e : C⁻¹ : e of the answer's and of the adjoint stresses, and ∫ σ_h : C⁻¹ : σ_h of these
    straight : (k,) what straight sides leave out of, or add to, curved boundaries
    """

    cells: np.ndarray
    stars: np.ndarray
    squares: np.ndarray
    straight: np.ndarray


def parts_of(
    mesh: Mesh,
    material: Material | Composite,
    moved: Moved,
    duals: Sequence[Dual],
    sides: Straight,
    force: np.ndarray,
    loads: np.ndarray,
) -> Parts:
    """What a body adds to the errors of results. Not collective.

    Parameters
    ----------
    moved : the answer's displacement and temperature
    sides : what its straight sides leave out
    force : (f, d) volume force at the facets of the boundary (N/m³)
    loads : (nv, d) nodal loads (N)
    """
    u, heat = moved
    of_duals = [
        (dual.z - u, None if heat is None else -heat) if dual.energy else (dual.z, None)
        for dual in duals
    ]
    k, number = len(duals), int(mesh.corners.max()) + 1
    half = 0.5 * np.array([dual.energy for dual in duals])[:, None, None]
    cells, density = np.zeros((2, k, len(mesh.triangles)))
    stars, squares, hats = np.zeros((k, number)), np.zeros((k, 3)), mesh.cell.rule[0].T
    for part in differences(mesh, material, [moved, *of_duals]):
        mixed, alone, corners = part.products(0), part.products(), mesh.corners[part.cells].T
        own, product, squared = mixed[0], mixed[1:], alone[1:]
        squared = squared + half * (2.0 * product + half * own)
        product = product + half * own
        cells[:, part.cells] = product.sum(axis=1)
        squares += np.column_stack(
            [
                np.full(k, own.sum()),
                squared.sum(axis=(1, 2)),
                part.energies()[1:].sum(axis=(1, 2)),
            ]
        )
        for star, shares in zip(stars, hats @ product, strict=True):
            star += np.bincount(corners.ravel(), shares.ravel(), number)
        if sides.volume.any():
            sigma, tau = part.computed[0], part.computed[1:] + half[..., None] * part.computed[0]
            work = part.share * (sigma * tau).sum(axis=1)
            density[:, part.cells] = work.sum(axis=1) / part.share.sum(axis=0)
    facets, beside = mesh.boundary
    by_loads = [dual.z - dual.taken for dual in duals]
    pushed = [(force * z[facets].mean(axis=1)).sum(axis=1) for z in by_loads]
    straight = (sides.volume * (np.reshape(pushed, (k, -1)) - density[:, beside])).sum(axis=1)
    # a traction that grows with the radius acts by 0.2 θ² more on an arc of the angle θ than on its chord
    works = [(loads * z).sum(axis=1) for z in by_loads]
    straight = straight + [0.125 * float(sides.bent @ work) for work in works]
    # a chord L of a rim, which turns by θ, takes L² θ/12 from a loaded flat face: θ/6 of what the nodes of its cells have
    lost = np.array([abs(float(sides.rims @ work)) / 6.0 for work in works])
    straight = straight + np.copysign(lost.reshape(k), straight)
    return Parts(cells, np.abs(stars).sum(axis=1), squares, straight)


def ends_of_contact(
    interface: Interface,
    active: ActiveSet,
    s: np.ndarray,
    q: np.ndarray,
    by_forces: np.ndarray,
    by_gaps: np.ndarray,
    arms: np.ndarray | float = 0.0,
) -> np.ndarray:
    """(5,) what is unknown of a result at the ends of a contact's states, and its `terms`. Not collective.

    Where nodes change their status the true place is between two of them: the force of closed nodes moved on by a quarter
    of a side to open ones. Slip bounds that do not follow the pressure, as Tresca's: half of them at nodes beside others
    of another status, and what they have more on an arc than on its chord. And the forces of the nodes beside those that
    clamps of both bodies leave without a row, whose part clamps bear. Gaps between curved sides of quadratic elements are
    off: a parabola through three points of a circle, by the angle φ from one to the next one at the distance h, is off by
    h φ³/60 in the mean, and by up to h φ³/32; that of both sides, which need not be alike, counts as h φ³/`ROUNDED`, with
    φ = h over the radius of curvature, but by at most `SCATTERED` times what gaps at neighbours differ: in the plane they
    are those of arcs, and sides whose nodes match are off by as much. Last the sum of the sizes of the products of nodal
    forces of which the result is the sum; of a moment with whole arms, as that of a force along its arm is the difference
    of two products: pressures on a ball have large ones around its centre, and no moment.

    Parameters
    ----------
    s : (size,) forces (N)
    q, by_forces : (size,) what more forces add to the result, and what it takes of the forces themselves, per newton
    by_gaps : (size,) the derivatives of the result by gaps; zero where gaps are right: those of linear elements are of arcs
    arms : (m,) how far the forces of a moment are from the origin (m); zero of other results
    """
    law, m = interface.law, interface.m
    if not m:
        return np.zeros(5)
    beside = sparse.csr_matrix(interface.geometry.laplacian != 0.0)
    row, column = beside.nonzero()
    turns = ((interface.normal[row] - interface.normal[column]) ** 2).sum(axis=1)
    turned = np.zeros(m)
    np.maximum.at(turned, row, turns * (turns < SHARPEST**2))
    apart = ((interface.xy[row] - interface.xy[column]) ** 2).sum(axis=1)
    bent = np.zeros(m)  # squared curvatures
    np.maximum.at(bent, row, turns * (turns < SHARPEST**2) / np.where(apart, apart, np.inf))
    scatter = np.zeros(
        m
    )  # of gaps beside each other, which see arcs at other places of their parabolas
    np.maximum.at(scatter, row, np.abs(interface.gap[row] - interface.gap[column]))
    off = np.minimum(bent**1.5 * interface.spacing**4 / ROUNDED, SCATTERED * scatter)
    rounded = float(np.abs(by_gaps[:m]) @ off)
    left = _beside_clamps(interface, s * by_forces)
    sizes = [np.bincount(law.node, x**2, m) ** 0.5 for x in (s, by_forces)]
    # also of directions in which there is no force
    terms = float(sizes[0] @ np.maximum(sizes[1], arms))
    if law.two_sided:
        return np.array([0.0, 0.0, left, rounded, terms])
    normal, tangential = law.split(np.abs(q))
    slips = np.zeros(m, bool)
    slips[law.sliding] = active.slip.any(axis=1)
    status = active.closed + 2.0 * slips
    gain = beside.multiply((normal * ~active.closed)[None]).max(axis=1).toarray().ravel()
    moved = 0.25 * float(np.abs(s[:m]) @ (gain * active.closed))
    ends = np.zeros(m)
    ends[row[status[row] != status[column]]] = 0.5
    bound = law.bound_at(0.0 * s) * (ends + turned / 12.0)[law.sliding]
    return np.array([moved, float(bound @ magnitude(tangential)), left, rounded, terms])


def _beside_clamps(interface: Interface, parts: np.ndarray) -> float:
    """The parts (size,) of a result at as many nodes at the ends of a contact as clamps leave without a row."""
    fixed, rim = len(interface.fixed.gap), rim_of(interface)
    if not fixed or not len(rim):
        return 0.0
    each = np.zeros(interface.m)
    np.add.at(each, interface.law.node, parts)
    return float(np.abs(each[rim]).sum()) * min(fixed / len(rim), 1.0)


def kink_of_pressure(state: ContactState) -> float:
    """How far the largest pressure of a contact is from the mean at the nearest nodes, over itself and what is allowed;
    infinite where one node carries all, and above one where none does. Not collective."""
    pressure, interface = np.nan_to_num(state.pressure), state.interface
    bears = np.count_nonzero(pressure)
    if bears < 2:
        return np.inf if bears else 2.0
    at, xy = int(pressure.argmax()), interface.xy
    away = np.linalg.norm(xy - xy[at], axis=1)
    near = np.argsort(away, kind="stable")[1 : 2 * interface.dimension - 1]
    allowed = AT_END if at in rim_of(interface) else KINK
    return float(abs(1.0 - pressure[near].mean() / pressure[at])) / allowed


def arcs_of(mesh: Mesh, group: str) -> float:
    """The length or area of a boundary group with the arcs over straight sides. Not collective."""
    facets = mesh.facets(group).nodes
    bent = mesh.once(_sides_with(1)).bent
    arc = 1.0 + bent[facets].mean(axis=1) / 24.0
    return float(facet_measures(mesh.points[facets], mesh.axisymmetric) @ arc)


def rim_of(interface: Interface) -> np.ndarray:
    """The rows at the ends of a contact, in space along its edges, but for those on an axis. Not collective."""
    d, facets = interface.dimension, interface.geometry.facets
    if not len(facets):
        return np.zeros(0, int)
    sides = np.concatenate([np.delete(facets[:, :d], k, axis=1) for k in range(d)])
    found, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    rim = np.unique(found[count == 1])
    return rim[interface.xy[rim, 0] != 0.0] if interface.axisymmetric else rim


def kink_of_stress(mesh: Mesh, sigma: np.ndarray, nodal: np.ndarray) -> tuple[float, float]:
    """How far the largest of the stresses (nt,) of the cells is from the mean of the cells that share its facets, over
    itself and what is allowed; and from the largest of the recovered ones (nv,) at its nodes, over itself. Not
    collective."""
    number = int(sigma.argmax())
    if not sigma[number]:
        return 0.0, 0.0
    shared = np.isin(mesh.corners, mesh.corners[number]).sum(axis=1)
    beside = shared == mesh.cell.facet.corners
    near = sigma[beside].mean() if beside.any() else 0.0
    top = nodal[mesh.triangles[number]].max()
    kink, peak = (float(abs(1.0 - other / sigma[number])) for other in (near, top))
    return max(kink, peak) / KINK, peak


class Facts(NamedTuple):
    """What else the bar of a result depends on.

    Attributes
    ----------
    value, scale : its value, None if there is none, and the largest number of the same quantity
    order : of the elements
    error : estimated, in the energy norm; None where cells lock
    endless : whether it may have no limit on finer meshes
    stepped : whether it is the work of several load steps
    alone : whether there are no contacts
    """

    value: float | None
    scale: float
    order: int
    error: float | None
    endless: bool = False
    stepped: bool = False
    alone: bool = False


def sums_of(result: Named, known: Measured, value: float) -> tuple[float, float, float]:
    """What of a bar has the factor of the order, how large that is at least, and what is added."""
    jumps = result.what in RESULTANTS and known.delta > JUMP
    ends = known.moved + known.rubbed + known.left + known.rounded + 2.0 * abs(known.straight)
    peaks = (BEYOND * known.peak + known.area) * abs(value) + known.corner
    return abs(known.signed) + known.stars, SHARE * known.schwarz * jumps, ends + peaks


def bar_of(result: Named, known: Measured, facts: Facts) -> Bar:
    """The bar of a result, half the width of the interval that is meant to hold the value of the continuum, or a word."""
    if facts.value is None:
        return Bar(None, None, known.word or UNDETERMINED)
    size, least = abs(facts.value), max(FLOOR * max(facts.scale, known.terms), known.noise)
    sums, jump, ends = sums_of(result, known, size)
    sums = max(FACTORS[facts.order] * sums, jump)
    rough = max(sums + ends, least)
    # statics alone gives it, on any mesh: its dual has no strain, and no contact is open altogether
    given = rough <= least and known.kink <= 1.0 and (known.terms > 0.0 or facts.alone)
    word = _instead(known, facts, rough, given, jump > 0.0 and 2.0 * sums > facts.scale)
    excess, about = max(known.kink, known.area / COVERED), size if word == PARTIAL else rough
    return Bar(facts.value, None if word else rough, word, about, excess, least)


def _instead(known: Measured, facts: Facts, rough: float, given: bool, partial: bool) -> str:
    """The word in the place of a `rough` bar, if there is one: not where statics gives the number, nor of an answer that
    elements hold, wherever it could be infinite."""
    error, size = facts.error, abs(facts.value or 0.0)
    if known.word or facts.stepped:
        return known.word or STEPPED
    if given or error is None or error <= FLOOR:
        return LOCKED * (error is None and not given)
    wide = rough > LARGEST * size
    reasons = {
        ENDLESS: facts.endless and size > max(FLOOR * facts.scale, known.noise),
        LONELY: np.isinf(known.kink),
        UNRESOLVED: known.kink > 1.0,
        PARTIAL: partial,
        PATCHY: wide and known.area > COVERED,
        COARSE: wide and error > LARGEST,
    }
    return next((word for word, holds in reasons.items() if holds), "")


def straight_sides(mesh: Mesh, thickness: np.ndarray, parts: int = 1) -> Straight:
    """What straight sides leave out of the smooth boundary of a mesh with cells of this thickness (nt,), in metres, 1 but
    in plane stress, where halvings have left so many `parts` of each side on a line. Found once for a mesh. Not
    collective."""
    sides = mesh.once(_sides_with(parts))
    return sides._replace(volume=sides.volume * thickness[mesh.boundary[1]])


def corners_of(mesh: Mesh, parts: int) -> np.ndarray:
    """(nv,) θ ln k on straight sides of so many `parts` k, for the angle θ from one to the next one, negative where the
    boundary is hollow. Not collective.

    A pressure grows by E* θ/2π ln 1/r to the corner of a polygon (Johnson, Contact Mechanics, 1985, section 5.2), and r is
    not less than a part of its side.
    """
    return np.log(parts) * mesh.once(_sides_with(parts)).turn


def corner_of_pressure(state: ContactState, sides: Sequence[np.ndarray]) -> float:
    """By how much corners of halved straight sides raise the largest pressure (Pa). Not collective.

    Parameters
    ----------
    sides : (k, d + 2) of the contact's bodies, each its nodes (m), `corners_of` them, and plane moduli there (Pa)
    """
    interface, pressure = state.interface, np.nan_to_num(state.pressure)
    if not interface.m or interface.law.name == "bonded":
        return 0.0
    place, d = interface.xy[pressure.argmax()], interface.dimension
    near = [side[np.linalg.norm(side[:, :d] - place, axis=1).argmin()] for side in sides]
    angles, moduli = np.abs([one[d] for one in near]), [one[d + 1] for one in near]
    # where nodes match the corners of a hollow side go round those of the other one
    together = abs(sum(one[d] for one in near))
    angle = angles.max() if interface.slave else together
    return float(angle / (2.0 * np.pi * sum(1.0 / modulus for modulus in moduli)))


@functools.cache
def _sides_with(parts: int) -> Callable[[Mesh], Straight]:
    """`_straight_sides` for so many `parts`."""
    return functools.partial(_straight_sides, parts=parts)


def _straight_sides(mesh: Mesh, parts: int) -> Straight:
    """What straight sides leave out, of the thickness 1.

    Boundaries that turn by less than SHARPEST from facet to facet are taken as smooth. A surface with the curvature κ
    stands κ e²/8 over the middle of an edge e, and normals at its ends differ by κ e.
    """
    d, facets = mesh.dimension, mesh.boundary[0]
    corners = facets[:, : mesh.cell.facet.corners]
    x, normal = mesh.points[corners], unit(normals(mesh.points[corners]))
    bends = creases(mesh.points, corners, normal)
    smooth = np.ones(len(mesh.points), bool)
    smooth[bends.nodes[np.abs(bends.turn) > SHARPEST]] = False
    smooth[bends.rim] = False
    arms = x - x.mean(axis=1, keepdims=True)
    flat = mesh.cell.facet.straight.split(corners)
    turned = corner_normals(mesh.points, flat)[corners] - normal[:, None]
    turns = (turned * arms).sum(axis=2) * smooth[corners]
    # a corner leaves the turn at its facet's other ends to count for it
    c, own = corners.shape[1], mesh.cell.facet.shape.factors[0]
    turn = c * turns.sum(axis=1) / np.maximum(smooth[corners].sum(axis=1), 1)
    squares = (arms**2).sum(axis=(1, 2))
    # of halved sides the facets at corners turn alone: the curvature is spread over the side, and then that of its length
    turn = parts * squares * _spread(turn / squares, corners, smooth, parts**2 // 2)
    turn[curved_facets(mesh.points[facets])] = 0.0
    measures = facet_measures(mesh.points[facets], mesh.axisymmetric)
    angle = turn * np.sqrt(2.0 / (d - 1) / squares)
    angles, last = np.zeros(len(mesh.points)), np.argsort(np.abs(angle), kind="stable")
    angles[facets[last]] = angle[last, None]  # the largest ones stay
    # the mean of |x|² over a facet is 1/(c (f + 2)) of its sum over the c corners, where its factors are of dimension f
    out = 0.5 * turn * (own + 1) / (own + 2) / c
    rims = parts**2 * _rims(mesh, bends)
    return Straight(parts * measures * out, angles**2, rims, angles)


def _spread(values: np.ndarray, corners: np.ndarray, smooth: np.ndarray, passes: int) -> np.ndarray:
    """Values (f,) of facets with these `corners` (f, c) as means over those around, by so many `passes` over the `smooth`
    (nv,) nodes."""
    number, c = len(smooth), corners.shape[1]
    count = np.maximum(np.bincount(corners.ravel(), minlength=number), 1)
    weights = smooth[corners]
    some = weights.any(axis=1)
    for _ in range(passes):
        nodal = np.bincount(corners.ravel(), np.repeat(values, c), number) / count
        means = (nodal[corners] * weights).sum(axis=1) / np.maximum(weights.sum(axis=1), 1)
        values = np.where(some, means, values)
    return values


def _rims(mesh: Mesh, bends: Creases) -> np.ndarray:
    """(nv,) the angles by which smooth edges turn at nodes; zero in the plane, and of quadratic cells, whose edges may
    be curved."""
    turns = np.zeros(len(mesh.points))
    edges = bends.nodes[np.abs(bends.turn) > SHARPEST]
    if edges.shape[1] < 2 or not (mesh.cell.linear and len(edges)):
        return turns
    ends = np.concatenate([edges, edges[:, ::-1]])
    ways = unit(mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]])
    both = np.zeros_like(mesh.points)
    np.add.at(both, ends[:, 0], ways)  # 2 sin θ/2 long where two edges meet
    turns[:] = np.linalg.norm(both, axis=1)
    smooth = np.bincount(ends[:, 0], minlength=len(turns)) == 2
    return np.where(smooth & (turns < SHARPEST), turns, 0.0)
