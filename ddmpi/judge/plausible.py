"""Warnings about a scene and its certified answer; `LIMIT` has the limits of all of them."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from ddmpi.body.elasticity import apply
from ddmpi.body.estimate import DiscretizationError
from ddmpi.body.rigid_motions import rigid_motions
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import Answered, ContactState, ContactTotals
from ddmpi.judge.edges import FLUSH, Singular, boundary_of, ends_of_clamps, known_finite
from ddmpi.judge.overlap import RESOLVED, doubt_overlaps
from ddmpi.judge.rolls import Bearing, bearing, doubt_rolls, mean_turn
from ddmpi.mesh.boundary import creases
from ddmpi.mesh.elements import CELLS, cell_with, invert
from ddmpi.mesh.mesh import Mesh, tangents
from ddmpi.scene.contacts import both_sides
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import gathered
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import ROUNDING, SAME, in_words, place_of_largest, without

LIMIT = {
    # of a mesh
    "thin": 0.05,  # doubt_cells: least measure of a cell, over that of a regular one with edges as long in the mean
    "slender": 50.0,  # doubt_shape: length over thickness; rows of needles of 1 : 100 may fail, of 1 : 30 they do not
    "linear": 0.5,  # doubt_mesh: estimated error of linear elements; they lock then, and the true one is larger
    "quadratic": 0.15,  # the same of quadratic ones: too much force at edges of contacts, as in NAFEMS's punch (0.16)
    # of small-strain theory
    "motion": 0.1,  # _large_motion: displacement over the size of the body
    "gradient": 0.1,  # _large_gradient: strain or rotation of a cell
    "slip": 1.0,  # _far_slip: slip of a closed node over the distance to its neighbours
    "turn": 0.1,  # _far_slip: slip of a closed node over the radius of its rigid partner
    # of forces
    "point": 0.01,  # _points_that_carry: force at a clamped point over all forces on the body
    "light": 1e-8,  # _unresolved: least forces on a loose body, over the loads of another body
    "rounding": 1e-6,  # _lost_in_rounding: contact forces by rounding of the displacements, over the largest
    "undecided": 1e-9,  # the same: largest gap of an open contact, over the displacements; by rounding up to 1e-13
    "skewed": 3.0,  # doubt_cells: largest over least Jacobian of a brick; trapezoids with sides 1.7 and 0.3 have 5.7
    "many": 0.1,  # and the part of such bricks in a body
    "idle": 1e-6,  # doubt_answer: least force of a contact, over that of all, for doubts of its forces; _hidden: energy
    # of contacts; in good answers the first two are up to 0.12
    "between": 0.25,  # _overlap_between: overlap between nodes over the displacement by contact forces
    "air": 0.25,  # _held_through_air: friction of open nodes over all forces of the contact
    "few": 5,  # _few_nodes: closed nodes across a contact of bodies that move far
    "zone": 0.1,  # _unresolved_zone: least force of a zone on few nodes, over that of the contact
    "stress": 0.1,  # doubt_stress: least stress at a singularity, over the largest of all bodies
    "bent": 0.1,  # doubt_mesh: displacement of a body beside its rigid motion, over its largest one
    "means": 0.25,  # _hidden_in_means: mean square of cells' stresses over that at nodes; 0 to 1/6 in a strip that bends
    # with one cell across, 1/2 and more with two
}
"""Limits of all warnings about a scene and its answer, with the functions that warn; but those of `motions` for free
motions of loose bodies, and those of `overlap`."""


Stresses = Mapping[str, tuple[np.ndarray, np.ndarray] | None]
"""Von Mises stresses (Pa) of a rank's bodies, of cells (nt,) and at nodes (nv,); None where they are not wanted."""

ROUNDED = ("uncertain", "undecided")  # the kinds of doubts of forces that rounding decides


def edge_lengths(mesh: Mesh, cells: np.ndarray | slice = slice(None)) -> np.ndarray:
    """(t, k) of the straight edges of t cells, of all without a choice (m). Not collective."""
    ends = mesh.points[mesh.corners[cells][:, mesh.cell.edges[:, :2]]]
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)


def locking_of(scene: Settled) -> list[str]:
    """Warnings of bodies whose linear elements lock. Not collective."""
    return [
        Doubt(body.locking, "locking", body.locking_ratio or 0.0, f"body.{body.name}")
        for body in scene.body
        if body.locking
    ]


def qualities(mesh: Mesh, cells: np.ndarray | slice = slice(None)) -> np.ndarray:
    """(t,) measures of t cells, of bricks by their least Jacobian, over those of regular ones with edges as long in the
    mean: 1 for a regular cell, 0 for a degenerate one. Not collective."""
    mean = np.sqrt((edge_lengths(mesh, cells) ** 2).mean(axis=1))
    return _jacobians(mesh, cells).min(axis=0) / (mesh.cell.regular * mean**mesh.dimension)


def _jacobians(mesh: Mesh, cells: np.ndarray | slice = slice(None)) -> np.ndarray:
    """(q, t) measures of straight cells by their tangents: of simplices once, of bricks at all corners."""
    cell = mesh.cell.straight
    hats = cell.middle if cell.simplex else cell.nodes
    return cell.map(mesh.points[mesh.corners[cells]], hats).measures


def doubt_cells(mesh: Mesh, name: str) -> str:
    """A warning of thin cells of a body's mesh, or else of many bricks that are far from parallelepipeds; empty if there
    are none. Not collective."""
    quality, sizes, words = qualities(mesh), _jacobians(mesh), mesh.cell.names
    worst, poor = int(quality.argmin()), int((quality < LIMIT["thin"]).sum())
    if poor:
        return Doubt(
            f"body.{name}.mesh: {poor} of {len(quality)} {words} are thin: the one at "
            f"{in_words(mesh.points[mesh.corners[worst]].mean(axis=0), 4)} has {quality[worst]:.2g} of the measure of "
            "a regular one; stresses are poor there",
            "thin",
            -quality[worst],
        )
    skewed = int((sizes.max(axis=0) > LIMIT["skewed"] * sizes.min(axis=0)).sum())
    if skewed <= LIMIT["many"] * len(quality):
        return ""
    simplices = CELLS[mesh.dimension, 1].names
    return Doubt(
        f"body.{name}.mesh: {skewed} of {len(quality)} {words} are far from parallelepipeds, and bend too stiffly; with "
        f"cut = true and order = 2 those of a file are {simplices}, which are better there",
        "skewed",
        skewed / len(quality),
    )


def doubt_shape(mesh: Mesh, name: str) -> str:
    """A warning of a body so slender or flat that rounding may hide its answer; empty if not. Not collective."""
    # extents along the principal axes of the nodes
    sizes = np.ptp(mesh.points @ np.linalg.svd(np.cov(mesh.points.T))[0], axis=0)
    ratio = sizes.max() / max(sizes.min(), np.finfo(float).tiny)
    return (
        Doubt(
            f"body.{name}: it is about {ratio:.0f} times as long as it is thick; so slender a body bends far more than "
            "its contacts deform, and its contact forces may be lost in rounding",
            "slender",
            ratio,
        )
        if ratio > LIMIT["slender"]
        else ""
    )


def doubt_answer(assembly: Assembly, answer: Answered, passing: bool = False) -> list[str]:
    """Warnings of an answer, on the first rank; none where it is not even finite. Collective.

    Parameters
    ----------
    answer : with output.only nothing is said of strains and of overlaps of bodies
    passing : whether other load steps follow that are shown; then motions alone are looked at, since a body that is
        unloaded on its way may have next to no forces
    """
    world, here = assembly.world, assembly.in_world()
    contacts = answer.contacts
    finite = all(bool(np.isfinite(u).all()) for u in answer.displacements.values())
    if not world.allreduce(finite, MPI.LAND):
        return []
    by_body = gathered(world, _of_bodies(assembly, answer, passing))
    loads = {name: load for name, (_, load) in by_body.items()}
    doubts, resolved = _of_contacts(assembly, answer, passing)
    by_contact = gathered(world, doubts)
    rolling = assembly.loose and not passing
    bearings = gathered(world, _bearings(assembly, answer, resolved) if rolling else {})
    overlaps = []
    if not assembly.scene.output.only:
        overlaps = doubt_overlaps(here, assembly.along(answer.displacements), contacts)
    if world.rank:
        return []
    told = [warning for name in contacts for warning in by_contact.get(name, ())]
    rounded = subjects(told, *ROUNDED)
    certain = {name: one for name, one in contacts.items() if f"contact.{name}" not in rounded}
    return [
        *(warning for body in assembly.scene.body for warning in by_body[body.name][0]),
        *told,
        *doubt_rolls(
            {name: bearings[name] for name in contacts if name in bearings},
            assembly.joint.rigid.size,
        ),
        *([] if passing else _unresolved(assembly, certain, loads)),
        *overlaps,
    ]


def subjects(doubts: Iterable[str], *kinds: str) -> set[str]:
    """What the doubts of these kinds, or of any, are about, such as "contact.pin-lug"."""
    told = (doubt for doubt in doubts if isinstance(doubt, Doubt))
    return {of for doubt in told if not kinds or doubt.kind in kinds for of in doubt.of}


def _of_bodies(
    assembly: Assembly, answer: Answered, passing: bool
) -> dict[str, tuple[list[str], float]]:
    """The warnings of this rank's bodies by name, and the sums of the sizes of their loads (N). Not collective."""
    units, strains = assembly.scene.units, not assembly.scene.output.only
    found = {}
    for body in assembly.bodies:
        u = answer.displacements[body.spec.name]
        warnings = [*_large_motion(body, u, units, strains)]
        if not passing:
            warnings += _points_that_carry(body, u, answer.contacts, units)
        found[body.spec.name] = warnings, body.member.elasticity.load
    return found


def _of_contacts(
    assembly: Assembly, answer: Answered, passing: bool
) -> tuple[dict[str, list[str]], set[str]]:
    """The warnings of the contacts that this rank owns, by name, and the names of those whose forces are more than rounding
    and noise. Collective."""
    world, here = assembly.world, assembly.in_world()
    most = world.allreduce(
        max((body.member.elasticity.load for body in assembly.bodies), default=0.0), MPI.MAX
    )
    pressed = world.bcast(
        max((contact.normal_max for contact in answer.contacts.values()), default=0.0)
    )
    found, resolved = dict[str, list[str]](), set[str]()
    for name, (slid, largest) in _moved(assembly, answer, answer.displacements).items():
        state = answer.states[name]
        warnings = [] if assembly.frames else [*_far_slip(assembly, state, slid)]
        warnings += _overlap_between(here, state, largest)
        warnings += _left(assembly, state)
        warnings += _held_through_air(state, LIMIT["idle"] * most, assembly.scene.units["length"])
        # What contacts that carry next to nothing say of their forces is noise.
        if not passing and np.abs(state.normal_force).max(initial=0.0) >= LIMIT["idle"] * pressed:
            # a finer mesh resolves no rounding
            rounding = [*_lost_in_rounding(state, largest, assembly.scene.units)]
            few = _few_nodes(state) if assembly.frames else _unresolved_zone(here, state)
            warnings += rounding or few
            if not rounding:
                resolved.add(name)
        if warnings:
            found[name] = warnings
    return found, resolved


def _bearings(
    assembly: Assembly, answer: Answered, resolved: Collection[str]
) -> dict[str, Bearing]:
    """How the contacts of this rank hold loose bodies, by name; of the turns of those that are not `resolved` nothing is to
    be told. Collective."""
    turns, found = _turns(assembly, answer), dict[str, Bearing]()
    blocks = assembly.joint.rigid.blocks
    for interface, (_, numbers, block) in zip(assembly.space.interfaces, blocks, strict=True):
        name = interface.name
        one = bearing(
            answer.states[name], numbers, block, turns[name] if name in resolved else None
        )
        if one:
            found[name] = one
    return found


def _turns(assembly: Assembly, answer: Answered) -> dict[str, np.ndarray]:
    """By contact of this rank how far its first body has turned past its second, (1,) or (3,) (rad): since they were drawn,
    if they move far, or by the motions that clamps leave free. Collective."""
    frames = assembly.frames
    if frames:
        pairs = {each.name: each.bodies for each in assembly.space.interfaces}
        return {
            name: np.radians(frames[one].after(frames[other].undone).turn)
            for name, (one, other) in pairs.items()
        }
    moved = _moved(assembly, answer, _rigid(assembly, answer))
    return {name: mean_turn(answer.states[name], slid) for name, (slid, _) in moved.items()}


def _rigid(assembly: Assembly, answer: Answered) -> dict[str, np.ndarray]:
    """Of this rank's bodies the displacements (nv, d) by the motions that clamps leave free, in the mean (m). Not
    collective."""
    found = {}
    for body in assembly.bodies:
        u = answer.displacements[body.spec.name]
        found[body.spec.name] = 0.0 * u
        if len(body.member.e):
            found[body.spec.name] = _fitted(body.member.motions, u)
    return found


def _moved(
    assembly: Assembly, answer: Answered, displacements: Mapping[str, np.ndarray]
) -> dict[str, tuple[np.ndarray, float]]:
    """By contact of this rank how far `displacements` (nv, d) of bodies move the rows (m, d) of the first side past the
    second (m), and the largest one of both bodies (m). Collective."""
    mine = dict[tuple[str, int], tuple[np.ndarray, float]]()
    for body in assembly.bodies:
        u = displacements[body.spec.name]
        largest = float(np.linalg.norm(u, axis=1).max())
        for interface in body.member.interfaces:
            for side in interface.sides(body.spec.name):
                mine[interface.name, side] = interface.rows.moved(side, u), largest
    both, found = assembly.exchange.swap_objects(mine), {}
    for interface in assembly.space.interfaces:
        first, second = both[interface.name]
        met = answer.states[interface.name].interface
        carried = met.partner.carried(met.places)
        other, largest = second or (0.0, 0.0)
        found[interface.name] = first[0] - other - carried, max(first[1], largest)
    return found


def _left(assembly: Assembly, state: ContactState) -> Iterator[str]:
    """That bodies that move far have left each other, where they do not face each other any more."""
    interface = state.interface
    if assembly.frames and not interface.m:
        yield Doubt(
            f"contact.{interface.name}: {both_sides(interface.bodies)} do not face each other; the contact "
            "carries no forces",
            "apart",
            0.0,
        )


def _few_nodes(state: ContactState) -> Iterator[str]:
    """A warning where few nodes of bodies that move far are closed: as nodes open and close forces ripple, too."""
    closed = int((state.status != "open").sum())
    if 0 < closed < LIMIT["few"]:
        yield Doubt(
            f"contact.{state.interface.name}: only {closed} closed node{'s' * (closed != 1)}, too few to resolve "
            "the pressure; forces ripple as nodes open and close; refine the mesh there",
            "few",
            -closed,
        )


def _large_motion(
    body: Body, u: np.ndarray, units: Mapping[str, str], strains: bool
) -> Iterator[str]:
    """A warning where a body moves far, or, where `strains` are looked at, is strained or turned much."""
    moved, extent = float(np.linalg.norm(u, axis=1).max()), body.mesh.extent
    if moved > LIMIT["motion"] * extent:
        unit = units["length"]
        yield Doubt(
            f"body.{body.spec.name}: its largest displacement of {moved:.3g} {unit} is {moved / extent:.2g} times "
            f"its size ({extent:.3g} {unit}); small-strain theory requires small displacements",
            "motion",
            moved / extent,
        )
    elif strains:
        yield from _large_gradient(body, u)


def _unresolved(
    assembly: Assembly, contacts: Mapping[str, ContactTotals], loads: Mapping[str, float]
) -> Iterator[str]:
    """Warnings of loose bodies whose loads and contact forces are rounding beside the loads of others."""
    most, pressed, unit = (
        max(loads.values()),
        dict.fromkeys(assembly.loose, 0.0),
        assembly.scene.units["force"],
    )
    for contact in contacts.values():
        for name in pressed.keys() & set(contact.bodies):
            pressed[name] = max(pressed[name], contact.acting)
    for name, acting in pressed.items():
        acting = max(loads.get(name, 0.0), acting)
        if 0.0 < acting < LIMIT["light"] * most:
            yield Doubt(
                f"body.{name}: the forces on it, {acting:.3g} {unit} in all, are negligible beside those on another "
                f"body, {most:.3g} {unit}, so that the answer does not show whether anything supports it; solve it "
                "without the other body",
                "light",
                -acting,
            )


def _points_that_carry(
    body: Body, u: np.ndarray, contacts: Mapping[str, ContactTotals], units: Mapping[str, str]
) -> Iterator[str]:
    """Warnings where the displacement u (nv, d) means forces at clamped points outside clamped groups and contacts."""
    mesh, name = body.mesh, body.spec.name
    points = {
        clamp.on: mesh.vertices[clamp.on] for clamp in body.spec.clamps if clamp.on in mesh.vertices
    }
    if not points:
        return
    supported = [interface.touched(name) for interface in body.member.interfaces]
    supported += [
        np.unique(mesh.groups[clamp.on]) for clamp in body.spec.clamps if clamp.on in mesh.groups
    ]
    elasticity = body.member.elasticity
    acting, pulled = elasticity.acting, elasticity.forces(u)
    held = np.eye(mesh.dimension) - elasticity.supports.free
    carried, loads = (
        np.linalg.norm(apply(held, forces), axis=1) for forces in (pulled - acting.heat, acting.f)
    )
    pressed = sum(contacts[interface.name].normal_sum for interface in body.member.interfaces)
    least = LIMIT["point"] * max(elasticity.load, pressed)
    for on, nodes in points.items():
        force = carried[nodes]
        alone = not any(np.isin(nodes, others).any() for others in supported)
        if (
            alone and (force > np.maximum(least, 2.0 * loads[nodes])).any()
        ):  # loads at the point itself do not count
            yield Doubt(
                f"body.{name}.clamp: the point {on!r} carries a force of {force.max():.3g} {units['force']}; its "
                "displacement grows without limit as the mesh is refined, so clamp a boundary group instead",
                "point",
                force.max(),
                of=f"body.{name}.clamp {on!r}",
            )


def doubt_mesh(
    assembly: Assembly,
    error: DiscretizationError,
    displacements: Mapping[str, np.ndarray],
    stresses: Stresses,
) -> list[str]:
    """A warning, on the first rank, of elements that make the estimated discretization error large, of linear ones also
    that of a body whose energy is little beside that of others. `displacements` (nv, d) are of this rank's bodies (m),
    `stresses` as in `doubt_stress`. Collective."""
    of_rank = {
        body.spec.name: (
            _bent(body, displacements[body.spec.name]),
            0.0 if both is None else float(both[0].max()),
        )
        for body in assembly.bodies
        for both in [stresses[body.spec.name]]
    }
    of_all = gathered(assembly.world, of_rank)
    if assembly.world.rank:
        return []
    bodies = assembly.scene.body
    k = int(np.argmax([error.by_body[body.name] for body in bodies]))
    what, cure, limit = {
        1: (
            "linear elements make it too stiff",
            "quadratic elements (mesh.order = 2) or a finer mesh",
            "linear",
        ),
        2: (
            "its mesh is coarse",
            "a finer mesh",
            "quadratic",
        ),
    }[bodies[k].mesh.order]
    if not error.relative > LIMIT[limit]:
        least = LIMIT["stress"] * max((stress for _, stress in of_all.values()), default=0.0)
        seen = [
            name
            for name, (bent, stress) in of_all.items()
            if bent > LIMIT["bent"] or stress > least
        ]
        return [] if limit == "quadratic" else _hidden(error, seen)
    return [
        f"body.{bodies[k].name}: {what}: the estimated discretization error is {error.relative:.2g}, "
        f"of which this body has {error.by_body[bodies[k].name]:.2g}; use {cure}"
    ]


def _bent(body: Body, u: np.ndarray) -> float:
    """The largest displacement of a body beside its rigid motion in the mean, over its largest one; `u` is (nv, d)."""
    points = body.mesh.points
    motions = rigid_motions(points, points.mean(axis=0), body.mesh.extent)
    M = motions[:, :, 1:2] if body.mesh.axisymmetric else motions  # around an axis along it alone
    largest = np.linalg.norm(u, axis=1).max()
    return float(np.linalg.norm(u - _fitted(M, u), axis=1).max() / largest) if largest else 0.0


def _fitted(motions: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The combination of `motions` (nv, d, j) that is nearest to the displacements u (nv, d)."""
    M = motions.reshape(u.size, -1)
    return (M @ np.linalg.solve(M.T @ M, M.T @ u.ravel())).reshape(u.shape)


def _hidden(error: DiscretizationError, seen: Collection[str]) -> list[str]:
    """A warning of the body whose linear elements are the stiffest, where other bodies have most of the energy: of those
    that are `seen`, whose displacements or stresses depend on it."""
    least = np.sqrt(LIMIT["idle"])
    own = {
        name: own for name, own in error.own.items() if name in seen and error.by_body[name] > least
    }
    name = max(own, key=lambda name: own[name], default="")
    if not (name and own[name] > LIMIT["linear"]):
        return []
    return [
        f"body.{name}: linear elements make it too stiff: its estimated discretization error is {own[name]:.2g} of its "
        f"own energy norm, and {error.by_body[name]:.2g} of that of all bodies; use quadratic elements (mesh.order = 2) "
        "or a finer mesh"
    ]


def doubt_stress(
    assembly: Assembly,
    stresses: Stresses,
    edges: Mapping[str, list[Singular]],
) -> list[str]:
    """Warnings, on the first rank, of bodies whose largest stress stands where that of the continuum is infinite, in a
    thin cell, or is that of means. Collective.

    Parameters
    ----------
    stresses : von Mises stresses (Pa) of this rank's bodies, of cells (nt,) and at nodes (nv,); None where they are not
        wanted
    edges : by body where those of its contacts are infinite, as of `doubt_edges`
    """
    unit = assembly.scene.units["stress"]
    of_rank = {
        body.spec.name: (
            float(max(sigma.max(), nodal.max())) if means else float(sigma.max()),
            means
            or [
                *_singular(body, sigma, unit, edges[body.spec.name]),
                *_in_thin_cell(body, sigma, unit),
            ],
        )
        for body in assembly.bodies
        for both in [stresses[body.spec.name]]
        if both is not None
        for sigma, nodal in [both]
        for means in [[*_hidden_in_means(body, sigma, nodal, unit)]]
    }
    of_all = gathered(assembly.world, of_rank)
    least = LIMIT["stress"] * max((largest for largest, _ in of_all.values()), default=0.0)
    return [
        warning
        for body in assembly.scene.body
        if body.name in of_all and of_all[body.name][0] > least
        for warning in of_all[body.name][1]
    ]


def _in_thin_cell(body: Body, stress: np.ndarray, unit: str) -> Iterator[str]:
    """A warning where the largest of the stresses (nt,) of a body is that of a thin cell among good ones, and of no
    other one. In a layer whose cells are all thin, in the same way, stresses are not poor."""
    mesh, k = body.mesh, int(stress.argmax())
    largest = stress >= (1.0 - SAME) * stress[k]
    if not (qualities(mesh, largest) < LIMIT["thin"]).all():
        return
    around = np.isin(mesh.corners, np.unique(mesh.corners[largest])).any(axis=1)
    if np.median(qualities(mesh, around)) > 2.0 * LIMIT["thin"]:
        place = in_words(mesh.points[mesh.corners[k]].mean(axis=0), 4)
        quality = float(qualities(mesh, np.array([k]))[0])
        yield Doubt(
            f"body.{body.spec.name}.mesh: the largest von Mises stress, {stress[k]:.4g} {unit}, is in a thin cell at "
            f"{place} with {quality:.2g} of the measure of a regular one; stresses are poor there",
            "stress in a thin cell",
            stress[k],
        )


def _hidden_in_means(body: Body, stress: np.ndarray, nodal: np.ndarray, unit: str) -> Iterator[str]:
    """A warning where stresses change so much within cells that these, (nt,) of their means, show less than half of
    those (nv,) at nodes, as in a plate that bends with one cell across. Linear simplices have but one stress."""
    mesh = body.mesh
    place = place_of_largest(nodal, mesh.points)
    if place is None or (mesh.cell.linear and mesh.cell.simplex):
        return
    weights = mesh.measures()
    of_nodes = weights @ (nodal[mesh.corners] ** 2).mean(axis=1)
    if weights @ stress**2 < LIMIT["means"] * of_nodes:
        yield Doubt(
            f"body.{body.spec.name}: the largest von Mises stress, {stress.max():.4g} {unit}, is a mean over a cell, and "
            f"within cells stresses change their sign, as where a plate bends with one cell across; at nodes they are up "
            f"to {nodal.max():.4g} {unit}, at {in_words(place, 4)}; take these, or more cells across",
            "stress of means",
            nodal.max(),
        )


def _singular(
    body: Body, stress: np.ndarray, unit: str, edges: Sequence[Singular] = ()
) -> list[str]:
    """A warning where the largest of the stresses (nt,) of a body is at a re-entrant corner (in space an edge), at one
    of the `edges` of its contacts, or where a clamp ends."""
    mesh = body.mesh
    points, (_, bends) = mesh.points, mesh.once(boundary_of)
    largest = stress >= (1.0 - SAME) * stress.max()
    if largest.all():  # a constant stress grows nowhere
        return []
    top, hollow = np.unique(mesh.triangles[largest]), bends.corner & (bends.turn < 0.0)
    corner = {2: "corner", 3: "edge"}[mesh.dimension]
    beside = "take the stress beside it"
    drawn = "round it in the drawing, or " if body.spec.mesh.drawn else ""
    where = [
        (points[np.intersect1d(bends.nodes[chosen], top)], what, cure)
        for chosen, what, cure in (
            (hollow & ~known_finite(mesh, edges), f"a re-entrant {corner}", drawn + beside),
            (ends_of_clamps(body), "the end of a clamp", beside),
        )
    ]
    for known in edges:
        reach = edge_lengths(mesh, largest).max()
        for place, what in zip(known.places, known.what, strict=True):
            near = bool(np.linalg.norm(points[top] - place, axis=1).min() <= reach)
            where.append((place[None][: int(near)], what, beside))
    for places, what, cure in where:
        if len(places):
            place = places[np.lexsort(places.T[::-1])[0]]
            return [
                Doubt(
                    f"body.{body.spec.name}: the largest von Mises stress, {stress.max():.4g} {unit}, is at {what} "
                    f"at {in_words(place, 4)}, where it grows without limit as the mesh is refined; {cure}",
                    "infinite stress",
                    stress.max(),
                )
            ]
    return []


def _lost_in_rounding(state: ContactState, moved: float, units: Mapping[str, str]) -> Iterator[str]:
    """A warning where rounding of displacements up to `moved` (m) decides on the forces or the status of a contact."""
    name, length, force = state.interface.name, units["length"], units["force"]
    widest = float(np.abs(state.gap).max(initial=0.0))
    largest = float(np.abs(state.normal_force).max(initial=0.0))
    if (
        state.interface.m
        and (state.status == "open").all()
        and moved
        and widest <= LIMIT["undecided"] * moved
    ):
        yield Doubt(
            f"contact.{name}: rounding decides that it is open: its gaps, up to {widest:.3g} {length}, are "
            f"negligible beside the displacements of up to {moved:.3g} {length}",
            "undecided",
            moved,
        )
        return
    # rounding of the displacements of both bodies, times the stiffness of a node against a gap
    noise = (
        2.0 * float(state.interface.stiffness.max(initial=0.0)) * float(np.finfo(float).eps) * moved
    )
    if largest and not noise <= LIMIT["rounding"] * largest:
        part, most = noise / largest, f"{largest:.3g} {force} at a node"
        yield Doubt(
            f"contact.{name}: its forces are "
            + ("rounding" if part > 1.0 else f"uncertain by about {part:.1g} of the largest")
            + f" ({most}): the bodies move by {moved:.3g} {length}, and rounding of this motion causes forces of "
            f"{noise:.1g} {force}",
            "uncertain",
            part,
        )


def _held_through_air(state: ContactState, least: float, unit: str) -> Iterator[str]:
    """A warning where friction of open nodes is more than `least` (N) and a large fraction of a contact's forces, as
    Tresca's law allows."""
    sizes, name, law = (
        np.linalg.norm(state.forces, axis=1),
        state.interface.name,
        state.interface.law.name,
    )
    air = np.where(state.status == "open", sizes, 0.0)
    if air.sum() > max(LIMIT["air"] * sizes.sum(), least):
        k = int(
            np.argmax(np.where(air > 0.0, air * state.gap, -np.inf))
        )  # of many that all bear their bound
        yield Doubt(
            f"contact.{name}: friction of open nodes bears {air.sum() / sizes.sum():.0%} of its forces, as at "
            f"{in_words(state.interface.xy[k], 4)}, where the gap is {state.gap[k]:.3g} {unit}: the bound of law = "
            f'"{law}" asks for no pressure; with law = "coulomb" open nodes have no friction',
            "air",
            air.sum(),
        )


def _overlap_between(assembly: Assembly, state: ContactState, moved: float) -> Iterator[str]:
    """A warning where bodies that move by up to `moved` (m) overlap much between the nodes of a contact."""
    interface, unit = state.interface, assembly.scene.units["length"]
    overlap = -state.between - state.closure.max(initial=0.0)
    k = int(np.argmax(overlap)) if len(overlap) else 0
    body = next(body for body in assembly.bodies if body.spec.name == interface.bodies[0])
    if not len(overlap):
        return
    # arcs through the nodes of two round sides overlap by next to nothing as drawn, also without any load
    drawn = -interface.probes.opening(interface.scale)[k]
    arcs = min(max(drawn, 1e-12 * body.mesh.extent), SAME * body.mesh.extent)
    least = max(LIMIT["between"] * state.yielding, RESOLVED * moved, (1.0 + SAME) * arcs)
    if not overlap[k] > least:
        return
    place = in_words(interface.probes.moved(0, body.mesh.points)[k], 4)
    other = ""
    if interface.slave:
        slave = interface.roles.index(interface.slave)
        if len(interface.rows.nodes[1 - slave]) > len(interface.rows.nodes[slave]):
            other = f" or write slave = {interface.roles[1 - slave]!r}"
    yield Doubt(
        f"contact.{interface.name}: the bodies overlap by {overlap[k]:.3g} {unit} between nodes that bear forces, "
        f"as at {place}, while contact forces move them by at most {state.yielding:.3g} {unit}; refine the "
        f"mesh{other}",
        "between",
        overlap[k],
    )


def _on_mirrors(assembly: Assembly, interface: Interface) -> np.ndarray:
    """(m,) bool, rows where clamps hold the first body across the normal alone, as at a plane of symmetry."""
    body = next(each for each in assembly.bodies if each.spec.name == interface.bodies[0])
    across, blocked = np.zeros((2, interface.m), bool)
    for _, nodes, direction in body.member.elasticity.supports.constrained:
        apart, at = cKDTree(body.mesh.points[nodes]).query(interface.xy)
        here = apart <= FLUSH * interface.spacing + np.abs(interface.opening)
        level = np.abs((interface.normal * direction[at]).sum(axis=1)) <= SAME
        across |= here & level
        blocked |= here & ~level
    return across & ~blocked


def _unresolved_zone(assembly: Assembly, state: ContactState) -> Iterator[str]:
    """A warning where a contact zone between boundaries that curve apart has too few nodes to resolve its pressure.

    Not at corners and ends of a boundary, where no mesh resolves it, nor between flat boundaries: there, few closed
    nodes are what is left of a contact that opens. Of all of these, where a single node has the largest pressure.
    """
    interface, number = state.interface, len(state.status)
    if interface.law.two_sided or number < 3:
        return
    pairs = interface.geometry.neighbours
    d, closed = interface.dimension, state.status != "open"
    both = closed[pairs].all(axis=1)
    links = sparse.csr_matrix((np.ones(both.sum()), pairs[both].T), (number, number))
    zone = csgraph.connected_components(links, directed=False)[1]
    parting = pairs[closed[pairs[:, 0]] != closed[pairs[:, 1]]]
    inner, outer = np.where(closed[parting[:, :1]], parting, parting[:, ::-1]).T
    apart = interface.opening[outer] > interface.opening[inner] + SAME * interface.spacing[inner]
    curving = np.bincount(
        zone[inner[apart]], minlength=number
    )  # where it ends because the boundaries curve apart
    axis = interface.axisymmetric & (interface.xy[:, 0] < 0.75 * interface.spacing)
    axis = axis | _on_mirrors(assembly, interface)
    twice = 1 + (np.bincount(zone[axis], minlength=number) > 0)  # a zone goes on beyond it
    enclosed = (twice * curving >= 2) & (curving == np.bincount(zone[inner], minlength=number))
    size, force = (
        np.bincount(zone, closed, number) * twice,
        np.bincount(zone, state.normal_force, number),
    )
    least = (2 * cell_with(interface.geometry.facets.shape[1], d - 1).order + 1) ** (
        d - 1
    )  # nodes; fewer say little of it
    poor = (size > 0) & (size < least) & enclosed & (force > LIMIT["zone"] * force.sum())
    if poor.any():
        facets = interface.geometry.facets[:, :d]
        bent = creases(interface.xy, facets, interface.normal[facets].sum(axis=1))
        sharp = np.append(bent.nodes[bent.corner], bent.rim)
        sharp = sharp[~axis[sharp]]
        poor &= np.bincount(zone[sharp], minlength=number) == 0  # not at corners
    if poor.any():
        k = int(np.argmax(np.where(poor, force, -np.inf)))
        least = ROUNDING * float(np.abs(interface.xy).max())
        middle = without(interface.xy[zone == k].mean(axis=0), least)
        yield Doubt(
            f"contact.{interface.name}: the pressure at {in_words(middle, 4)} is on "
            f"too few nodes to resolve it, {size[k] / twice[k]:.0f}: the total force is right, the largest pressure and the "
            "approach of the bodies are not; refine the mesh there",
            "zone",
            force[k],
        )
        return
    largest = int(np.argmax(np.nan_to_num(state.pressure)))
    k = zone[largest]
    if force[k] > LIMIT["zone"] * force.sum() and (zone == k).sum() == 1:
        yield Doubt(
            f"contact.{interface.name}: at {in_words(interface.xy[largest], 4)} it is closed at a single node, so that "
            "the largest pressure is the force over the size of an element, and grows as the mesh is refined; take "
            "the force",
            "alone",
            force[k],
        )


def _large_gradient(body: Body, u: np.ndarray) -> Iterator[str]:
    """A warning where a cell is strained or turned much, by its corners alone."""
    corners = body.mesh.corners
    # ∇u by the tangents of the cell as drawn and of its displacement
    gradients = np.einsum(
        "art,act->trc", invert(tangents(body.mesh.points, corners))[0], tangents(u, corners)
    )
    large = np.flatnonzero(
        (gradients**2).sum(axis=(1, 2)) > LIMIT["gradient"] ** 2
    )  # ‖∇u‖_F ≥ ‖∇u‖₂
    size = np.linalg.norm(gradients[large], ord=2, axis=(1, 2))
    if size.max(initial=0.0) > LIMIT["gradient"]:
        k = int(np.argmax(size))
        place = in_words(body.mesh.points[corners[large[k]]].mean(axis=0), 4)
        yield Doubt(
            f"body.{body.spec.name}: strains and rotations reach {size[k]:.2g}, as at {place}; small-strain theory "
            "requires small ones",
            "gradient",
            size[k],
        )


def _far_slip(assembly: Assembly, state: ContactState, moved: np.ndarray) -> Iterator[str]:
    """A warning where closed nodes have `moved` (m, d) far past their partners, or far around a rigid one. Distances of
    nodes count as at least the mean of the closed ones, as they are smaller at corners."""
    interface, closed = state.interface, state.status != "open"
    rigid = next(
        (partner for partner in assembly.scene.rigid if partner.name == interface.bodies[1]), None
    )
    spacing = np.maximum(
        interface.spacing, interface.spacing[closed].mean() if closed.any() else 0.0
    )
    far, limit = (
        (spacing, LIMIT["slip"])
        if rigid is None
        else (np.full_like(spacing, rigid.bend), LIMIT["turn"])
    )
    along = np.linalg.norm(np.einsum("mcd,md->mc", interface.tangents, moved), axis=1)
    slid = np.where(closed, along, 0.0) / far
    k = int(np.argmax(slid))
    if slid[k] > limit:
        place = in_words(interface.xy[k], 4)
        said = f"contact.{interface.name}: " + (
            f"node pairs slid up to {slid[k]:.3g} times the distance of their neighbours, as at {place}; they are no "
            "longer opposite each other"
            if rigid is None
            else f"nodes slid around {rigid.name!r} by up to {slid[k]:.2g} times its radius, as at {place}; normals are "
            "those before the motion"
        )
        yield Doubt(said, "slid" if rigid is None else "turned", slid[k])
