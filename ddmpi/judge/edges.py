"""Where stresses grow without limit as meshes get finer: at sharp corners in contact, at ends of bonds and of clamps.

Stresses at a point where two elastic wedges meet go as r^(λ − 1). Which λ is below one follows from the angles of both
bodies and Dundurs' α of their moduli; the rules here are simple bounds of these:

* Bodies of a bond are one body. A re-entrant corner of it, angles of more than 180° together, is singular (Williams, J.
  Appl. Mech. 19, 1952). A flush end, 180° together, is singular if α (α − 2β) > 0 (Bogy, J. Appl. Mech. 35, 1968); it
  is told above `BOGY`.
* A corner pressed on a body that goes on beside it, more than 180° together, has an infinite pressure (Dundurs and Lee,
  J. Elasticity 2, 1972). It is the weaker the softer the body with the corner is: a right angle has λ = 0.77 for equal
  moduli, 0.5 where it is rigid, and 1 where the other one is. It is told above `SOFT`.
* Boundaries that curve apart, or turn by less than `SHARPEST` from facet to facet, as rounded corners do, have none.
* Right angles of alike bodies that end flush have none, with any friction: pressure is that of a half-plane, and the
  shear f p on one face of a quarter-plane has finite stresses.
* On a rigid partner, corners up to `BLUNT` have none without friction.
* Where a free facet meets one that cannot move at an angle α, λ is below one if sin² α > 1 − ν, in plane stress
  1/(1 + ν), and at more than a right angle (Williams); it is told above that by `PINNED`. A facet that is held along its
  normal alone is a plane of symmetry: the corner is that of 2 α.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState
from ddmpi.judge.overlap import as_drawn
from ddmpi.mesh.boundary import SHARPEST, Creases, creases, curving
from ddmpi.mesh.elements import normals
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Material
from ddmpi.scene.contacts import SettledContact
from ddmpi.system.agreement import gathered
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import SAME, in_words, place_of_largest

BOGY = (
    0.05  # α (α − 2β) from which a flush bond of unlike bodies is told of; weaker ones hardly show
)
SOFT = -0.8  # Dundurs' α of a body with a corner, from which its pressure is told of: a ninth of the other's modulus
FLUSH = 0.05  # distance of ends along the contact, over that of nodes, up to which they are one on these meshes
BLUNT = np.deg2rad(100.0)  # angle of a body from which its corner on a rigid partner is told of
PINNED = 0.05  # sin² α − (1 − ν), from which the corner of a clamp is told of: λ is below 0.93 at a right angle


class Ends(NamedTuple):
    """Of one body at a contact: where its boundary has a corner, or its group ends.

    Attributes
    ----------
    sides : (k, 2, d) the ends of the sides there, in the plane one node twice (m)
    angles : (k,) of the body's material (rad); nan where the facet beside is held
    rubs : (k,) the same where the facet beside is held by another contact alone, else nan
    modulus, poisson : plane modulus (Pa), and Poisson's ratio, nan of bodies with several or directed materials
    inner : (k,) bool, whether the corner is inside its group
    """

    sides: np.ndarray
    angles: np.ndarray
    rubs: np.ndarray
    modulus: float
    poisson: float
    inner: np.ndarray


class Singular(NamedTuple):
    """Where a contact's stresses are infinite: (k, d) places (m), and what is there, in words; and (j, d) ends of bonds
    where they are finite."""

    places: np.ndarray
    what: list[str]
    finite: np.ndarray


def boundary_of(mesh: Mesh) -> tuple[np.ndarray, Creases]:
    """The straight facets (f, d) of a mesh, and the creases between them; for `Mesh.once`. Not collective."""
    facets = mesh.once(as_drawn).facets
    outward = mesh.points[facets[:, 0]] - mesh.points[facets[:, -1]]
    return facets[:, :-1], creases(mesh.points, facets[:, :-1], outward)


def within(mesh: Mesh, facets: np.ndarray, groups: Sequence[np.ndarray]) -> np.ndarray:
    """(f,) bool, which straight facets belong to one of the groups, of facets as the mesh has them."""
    d = mesh.dimension
    parts = [group[:, mesh.cell.facet.parts].reshape(-1, d) for group in groups]
    both = np.sort(np.concatenate([facets, *parts]), axis=1)
    number = np.unique(both, axis=0, return_inverse=True)[1].ravel()
    grouped = np.zeros(len(number), bool)
    grouped[number[len(facets) :]] = True
    return grouped[number[: len(facets)]]


def ends_of(
    body: Body, contacts: Sequence[tuple[SettledContact, int]]
) -> dict[tuple[str, int], Ends]:
    """The `Ends` of a body at its contacts, given with their sides, by contact and side. Not collective.

    Where the facet beside is clamped or on another contact, as at a plane of symmetry, nothing is known of the stress.
    """
    mesh = body.mesh
    facets, bends = mesh.once(boundary_of)
    clamped = clamps_of(body)
    groups = {
        (contact.name, side): mesh.facets(contact.on[side]).nodes for contact, side in contacts
    }
    found = {}
    for key in groups:
        inside = within(mesh, facets, [groups[key]])
        others = [group for other, group in groups.items() if other != key]
        held = within(mesh, facets, [*clamped, *others]) & ~inside
        number = inside[bends.facets].sum(axis=1)
        chosen = (number == 1) | ((number == 2) & bends.corner)
        unknown = chosen & held[bends.facets].any(axis=1)
        if mesh.axisymmetric:
            unknown |= chosen & mesh.on_axis[bends.nodes].any(axis=1)
        angles = np.pi - np.where(bends.corner, bends.turn, 0.0)
        angles[unknown] = np.nan
        nodes = bends.nodes[chosen]
        clamp = within(mesh, facets, clamped)[bends.facets].any(axis=1)
        rubs = np.where(unknown & ~clamp, np.pi - bends.turn, np.nan)
        found[key] = Ends(
            mesh.points[nodes[:, [0, -1]]],
            angles[chosen],
            rubs[chosen],
            interface_modulus(body),
            poisson_of(body),
            number[chosen] == 2,
        )
    return found


def clamps_of(body: Body) -> list[np.ndarray]:
    """The groups of facets that clamps of a body name."""
    groups = body.mesh.groups
    return [groups[clamp.on] for clamp in body.spec.clamps if clamp.on in groups]


def poisson_of(body: Body) -> float:
    """Poisson's ratio of a body; nan of several or directed materials."""
    material = body.material
    isotropic = isinstance(material, Material) and not isinstance(material.poisson, tuple)
    return float(material.poisson) if isotropic else np.nan  # type: ignore[union-attr, arg-type]


def pinned_angle(poisson: float, stress: bool) -> float:
    """The angle (rad) between a clamped and a free facet above which the stress is told to be infinite, with Poisson's
    ratio in plane strain or plane `stress`."""
    # λ = 1 in Williams' sin² λα = (κ + 1)²/(4 κ) − λ² sin² α / κ is sin² α = (κ + 1)/4, with κ = 3 − 4 ν in plane
    # strain, (3 − ν)/(1 + ν) in plane stress
    if np.isnan(poisson):
        return np.pi - SHARPEST
    square = 1.0 / (1.0 + poisson) if stress else 1.0 - poisson
    return float(np.arcsin(np.sqrt(min(square + PINNED, 1.0))))


def _held(body: Body) -> np.ndarray:
    """(3, c) bool, at which creases of the boundary one of both facets is clamped, clamped in all directions, and along
    its normal, as a plane of symmetry. A facet is clamped if it belongs to a clamp's group: clamps of the faces around a
    free one may constrain all its nodes. Not collective."""
    clamps, (facets, bends) = clamps_of(body), body.mesh.once(boundary_of)
    if not clamps:
        return np.zeros((3, len(bends.turn)), bool)
    clamped = within(body.mesh, facets, clamps)[bends.facets]
    held = np.where(clamped[:, 0], *bends.facets.T)
    free = body.member.elasticity.supports.free[facets[held]]
    fixed = np.abs(free).max(axis=(1, 2, 3), initial=0.0) <= SAME
    normal = normals(body.mesh.points[facets[held]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    along = np.einsum("ckij,cj->cki", free, normal)
    mirror = np.abs(along).max(axis=(1, 2), initial=0.0) <= SAME
    one = clamped.sum(axis=1) == 1
    return np.array([one, one & fixed, one & mirror])


def _rounded(body: Body, mirror: np.ndarray) -> np.ndarray:
    """(c,) bool, which creases at planes of symmetry, `mirror` (c,), may be those of a coarse curve of the whole."""
    mesh = body.mesh
    facets, bends = mesh.once(boundary_of)
    cut = within(mesh, facets, clamps_of(body)) | mesh.on_axis[facets].all(axis=1)
    free = np.where(cut[bends.facets[:, 0]], bends.facets[:, 1], bends.facets[:, 0])
    both = np.where(mirror[:, None], free[:, None], bends.facets)
    return mirror & curving(mesh.points, bends, 2.0 * bends.turn - np.pi, both)


def known_finite(mesh: Mesh, edges: Sequence[Singular]) -> np.ndarray:
    """(c,) bool, at which creases of a boundary stresses are finite, as its contacts tell: what is one body there has no
    corner. Not collective."""
    nodes = mesh.once(boundary_of)[1].nodes
    finite = {tuple(place) for each in edges for place in each.finite}
    known, ends = np.zeros(len(mesh.points), bool), np.unique(nodes)
    known[ends] = [tuple(place) in finite for place in mesh.points[ends]]
    return known[nodes].all(axis=1)


def ends_of_clamps(body: Body) -> np.ndarray:
    """(c,) bool, at which creases of the boundary a clamp ends so that stresses are infinite. Not collective."""
    one, fixed, mirror = _held(body)
    if not one.any():
        return one
    (facets, bends), material = body.mesh.once(boundary_of), body.material
    stress = isinstance(material, Material) and material.plane == "stress"
    least = np.full(len(one), np.pi - SHARPEST)
    least[mirror] = 0.5 * (np.pi + SHARPEST)
    least[fixed] = pinned_angle(poisson_of(body), stress)

    # What a contact does at a corner is not known.
    touching = np.zeros(len(body.mesh.points), bool)
    for interface in body.member.interfaces:
        touching[interface.touched(body.spec.name)] = True
    met = touching[facets[bends.facets]].all(axis=2).any(axis=1)
    least[met] = np.pi - SHARPEST
    return one & (np.pi - bends.turn > least + SAME) & ~_rounded(body, mirror)


def interface_modulus(body: Body) -> float:
    """The plane modulus of a body, of several materials their mean (Pa)."""
    material = body.material
    several = [material] if isinstance(material, Material) else material.materials
    return float(np.mean([each.plane_modulus for each in several]))


def singular_places(interface: Interface, bears: np.ndarray, both: Sequence[Any]) -> Singular:
    """Where the stresses of a contact whose rows `bear` (m,) forces are infinite. Not collective.

    Parameters
    ----------
    both : `Ends` of its two bodies; None for a rigid partner
    """
    bonded, ends = interface.law.name == "bonded", [one for one in both if one is not None]
    bearing = bears[interface.lines.row]
    rows, acting = interface.lines.row[bearing], interface.lines.acting[bearing]
    reach = reaches(interface)[rows]
    at, finite = [], list[np.ndarray]()
    sides = np.concatenate([one.sides[np.isfinite(one.angles)] for one in ends])
    for side in np.unique(sides, axis=0):
        place = side.mean(axis=0)
        distance = np.linalg.norm(acting - place, axis=1) / reach
        if not distance.min(initial=np.inf) <= 1.0 + SAME:
            continue  # nothing bears there
        k = int(distance.argmin())
        normal, near = interface.normal[rows[k]], FLUSH * reach[k]
        angles, inner = np.array([_angle(one, place, normal, near) for one in ends]).T
        if not np.isfinite(angles).all():
            continue
        if what := _what(bonded, angles, inner, ends, interface):
            at += [(end, what) for end in np.unique(side, axis=0)]
        elif _known_to_be_finite(bonded, angles, inner, ends):
            finite += [*side]
    finite += _cuts(ends, FLUSH * float(reach.max(initial=0.0))) if bonded else []
    return Singular(
        np.array([place for place, _ in at]).reshape(-1, interface.dimension),
        [what for _, what in at],
        np.array(finite).reshape(-1, interface.dimension),
    )


def _known_to_be_finite(
    bonded: bool, angles: np.ndarray, inner: np.ndarray, ends: Sequence[Ends]
) -> bool:
    """Whether the stress at an end that is not told is finite in both bodies: of a bond of isotropic bodies, alike ones
    where a corner of both is inside it; and where right angles of alike ones end flush, also with friction."""
    if len(ends) < 2 or not np.isfinite(mismatch(ends)):
        return False
    if bonded and inner.all():
        return _alike(ends)
    right = (np.abs(angles - 0.5 * np.pi) <= SHARPEST).all()
    return bonded or bool(right and _alike(ends))


def _alike(ends: Sequence[Ends]) -> bool:
    """Whether two bodies have one isotropic material."""
    (one, nu), (other, its) = ((each.modulus, each.poisson) for each in ends)
    return bool(abs(one - other) <= SAME * one and abs(nu - its) <= SAME)


def _cuts(ends: Sequence[Ends], near: float) -> list[np.ndarray]:
    """The ends of a bond at which it cuts one body in two, both of which touch others beside it: what is one body there
    has no corner."""
    if len(ends) < 2 or not (_alike(ends) and all(len(one.rubs) for one in ends)):
        return []
    one, other = ends
    apart, at = cKDTree(other.sides.mean(axis=1)).query(one.sides.mean(axis=1))
    # a comparison with nan is false
    flush = np.abs(one.rubs + other.rubs[at] - np.pi) <= SHARPEST
    return [place for side in one.sides[flush & (apart <= near)] for place in side]


def reaches(interface: Interface) -> np.ndarray:
    """(m,) the distance of each row to its neighbours, in space along the diagonal (m)."""
    return np.sqrt(interface.dimension - 1.0) * interface.spacing


def _angle(ends: Ends, place: np.ndarray, normal: np.ndarray, near: float) -> tuple[float, bool]:
    """The angle of a body at a place of its contact (rad), and whether its corner there is inside the contact: that of an
    end beside which gaps and overlaps, which are along the normal, put the place; 180° where it has none."""
    start, way = ends.sides[:, 0], ends.sides[:, 1] - ends.sides[:, 0]
    length = np.maximum((way**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(((place - start) * way).sum(axis=1) / length, 0.0, 1.0)
    apart = start + share[:, None] * way - place
    along = apart - (apart @ normal)[:, None] * normal
    here = (np.linalg.norm(along, axis=1) <= near) & (np.linalg.norm(apart, axis=1) <= near / FLUSH)
    known = np.flatnonzero(here & np.isfinite(ends.angles))
    if len(known):  # where a held side ends, another one may go on
        k = known[ends.angles[known].argmin()]
        return float(ends.angles[k]), bool(ends.inner[k])
    return np.nan if here.any() else np.pi, False


def _what(
    bonded: bool,
    angles: np.ndarray,
    inner: np.ndarray,
    ends: Sequence[Ends],
    interface: Interface,
) -> str:
    """What makes the stresses at a place infinite, in words; empty if they are finite, as in a soft joint."""
    if interface.layer or (bonded and inner.all()):  # nothing ends inside a bond
        return ""
    sharper = int(np.argmin(angles))
    body = interface.bodies[sharper]
    corner = {2: "corner", 3: "edge"}[interface.dimension]
    if len(ends) == 1:
        blunt = BLUNT <= angles[0] < np.pi - SHARPEST and not bonded
        return f"a sharp {corner} of {body} in contact" * bool(blunt)
    moduli = np.array([one.modulus for one in ends])
    if bonded:
        reentrant = angles.sum() > np.pi + SHARPEST
        flush = abs(angles.sum() - np.pi) <= SHARPEST and mismatch(ends) > BOGY
        return "the end of the bond" * bool(reentrant or flush)
    alpha = (moduli[sharper] - moduli[1 - sharper]) / moduli.sum()
    sharp = angles[sharper] < np.pi - SHARPEST and angles.sum() > np.pi + SHARPEST
    return f"a sharp {corner} of {body} in contact" * bool(sharp and alpha > SOFT)


def mismatch(ends: Sequence[Ends]) -> float:
    """α (α − 2β) of two isotropic bodies in plane strain, nan of others; Dundurs' numbers."""
    nu = np.array([one.poisson for one in ends])
    mu = np.array([one.modulus for one in ends]) * (1.0 - nu) / 2.0  # E / (1 − ν²) = 2 μ / (1 − ν)
    (m1, m2), (n1, n2) = mu, nu
    both = m1 * (1.0 - n2) + m2 * (1.0 - n1)
    alpha = (m1 * (1.0 - n2) - m2 * (1.0 - n1)) / both
    beta = 0.5 * (m1 * (1.0 - 2.0 * n2) - m2 * (1.0 - 2.0 * n1)) / both
    return float(alpha * (alpha - 2.0 * beta))


class Edges(NamedTuple):
    """Where stresses are infinite at the contacts that a rank owns, and at those of each of its bodies."""

    by_contact: dict[str, Singular]
    by_body: dict[str, list[Singular]]


def edges_of(assembly: Assembly, states: Mapping[str, ContactState]) -> Edges:
    """The `Edges` of an answer, by the `states` of the contacts that this rank owns. Collective."""
    contacts = dict[str, list[tuple[SettledContact, int]]]()
    for contact in assembly.scene.contact:
        for side, name in enumerate(contact.bodies):
            contacts.setdefault(name, []).append((contact, side))
    mine = dict[tuple[str, int], Ends]()
    for body in assembly.bodies:
        mine |= ends_of(body, contacts.get(body.spec.name, ()))
    both, places = assembly.exchange.swap_objects(mine), {}
    for met in assembly.space.interfaces:
        one, other = both[met.name]
        if met.image:
            other = other._replace(sides=met.image.at(other.sides))
        places[met.name] = singular_places(met, states[met.name].status != "open", (one, other))
    return Edges(places, _by_body(assembly, places))


def doubt_edges(assembly: Assembly, states: Mapping[str, ContactState], edges: Edges) -> list[str]:
    """Warnings of largest pressures that are infinite in the continuum, on the first rank. Collective.

    Parameters
    ----------
    states : of the contacts that this rank owns
    """
    unit = assembly.scene.units["stress"]
    warnings = {
        name: words
        for name, found in edges.by_contact.items()
        if (words := _pressure(states[name], found, unit))
    }
    by_contact = gathered(assembly.world, warnings)
    if assembly.world.rank:
        return []
    named = [contact.name for contact in assembly.scene.contact]
    return [by_contact[name] for name in named if name in by_contact]


def unbounded(assembly: Assembly, edges: Edges) -> set[str]:
    """The largest pressures and stresses that may have no limit on finer meshes, by the names of the results, on the
    first rank: also where the largest value does not stand at such a place yet. Collective.

    In a body also corners in contacts with friction count, and in bonds where the other body's angle is not known.
    """
    found = dict[str, bool]()
    for name, singular in edges.by_contact.items():
        found[f"contacts.{name}.pressure_max"] = len(singular.places) > 0
    for body in assembly.bodies:
        name, mesh = body.spec.name, body.mesh
        _, bends = mesh.once(boundary_of)
        touching = np.zeros(len(mesh.points), bool)
        for interface in body.member.interfaces:
            rubs = not interface.law.frictionless
            touching[interface.touched(name)] |= rubs
        mirror = _held(body)[2]
        if mesh.axisymmetric:  # the axis mirrors, too
            mirror |= mesh.on_axis[bends.nodes].all(axis=1)
        turn = np.where(mirror, 2.0 * bends.turn - np.pi, bends.turn)
        sharp = (turn > SHARPEST) & (bends.corner | mirror) & ~_rounded(body, mirror)
        sharp &= touching[bends.nodes].all(axis=1)
        sharp |= bends.corner & (bends.turn < 0.0)
        sharp &= ~known_finite(mesh, edges.by_body[name])
        found[f"bodies.{name}.von_mises_max"] = bool(
            sharp.any()
            or ends_of_clamps(body).any()
            or any(len(each.places) for each in edges.by_body[name])
        )
    return {result for result, infinite in gathered(assembly.world, found).items() if infinite}


def _by_body(assembly: Assembly, places: Mapping[str, Singular]) -> dict[str, list[Singular]]:
    """By body of this rank what the owners of its contacts have found. Collective."""
    told = assembly.exchange.told(places)
    by_body: dict[str, list[Singular]] = {}
    for body in assembly.bodies:
        known = list[Singular]()
        for met in body.member.interfaces:
            found = told[met.name]
            for side in met.sides(body.spec.name) if found else ():
                known.append(_turned_back(found, met, side, body.mesh.points))
        by_body[body.spec.name] = known
    return by_body


def _turned_back(singular: Singular, met: Interface, side: int, points: np.ndarray) -> Singular:
    """The places of a contact on a side, from those on the first: an image is where its body is drawn, at some of its
    `points` (nv, d)."""
    if not (side and met.image):
        return singular
    tree, back = cKDTree(points), met.image.undone
    places, finite = (
        points[tree.query(back.at(each))[1]] for each in (singular.places, singular.finite)
    )
    return singular._replace(places=places, finite=finite)


def _pressure(state: ContactState, singular: Singular, unit: str) -> str:
    """A warning where the largest pressure of a contact is at one of the places."""
    interface, pressure = state.interface, np.nan_to_num(state.pressure)
    largest = pressure.max(initial=0.0)
    if not largest > 0.0 or not len(singular.places):
        return ""
    top = pressure >= (1.0 - SAME) * largest
    if top.all():  # a constant pressure grows nowhere
        return ""
    rows = interface.lines.row
    at = place_of_largest(pressure[rows], interface.lines.acting)
    assert at is not None
    for place, what in zip(singular.places, singular.what, strict=True):
        distance = np.linalg.norm(interface.lines.acting - place, axis=1)
        near = distance <= (1.0 + SAME) * reaches(interface)[rows]
        if (top[rows] & near).any():
            return Doubt(
                f"contact.{interface.name}: the largest pressure, {largest:.4g} {unit}, is at {what} at "
                f"{in_words(at, 4)}, where it grows without limit as the mesh is refined; take the force, or "
                "the pressure beside it",
                "infinite pressure",
                largest,
            )
    return ""
