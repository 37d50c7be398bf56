"""A scene meshed, assembled and paired, but not solved, in words and pictures."""

import contextlib
import dataclasses
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from mpi4py import MPI

from ddmpi.body.compliance import SOLVERS, bytes_in_words
from ddmpi.body.loads import VOLUME, loads_by_group
from ddmpi.check.costs import forecast, memory_of_solver
from ddmpi.check.drawing import Bodies, Looked, draw
from ddmpi.check.faces import describe_face
from ddmpi.check.nearby import Boundary, Missing, find_missing
from ddmpi.check.page import write_check
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.ranks import on_working_ranks
from ddmpi.errors import NotConvergedError
from ddmpi.interface.interface import Interface
from ddmpi.judge.equilibrium import describe
from ddmpi.judge.motions import MotionsOfBody, undetermined
from ddmpi.judge.overlap import doubt_overlaps
from ddmpi.judge.plausible import doubt_cells, edge_lengths, locking_of
from ddmpi.mesh.boundary import parts_of
from ddmpi.mesh.forms import UNNAMED
from ddmpi.mesh.mesh import PHYSICAL, Mesh
from ddmpi.results.folder import choose_folder
from ddmpi.run.equilibrium import look_for_mechanism, motions_without_resistance
from ddmpi.run.gather import drawers
from ddmpi.run.held import beyond_meshes, motions_to_hold
from ddmpi.run.report import (
    LISTED,
    describe_gap,
    describe_method,
    grouped,
    sector_in_words,
    some,
    titles,
)
from ddmpi.run.run import prepare_scene
from ddmpi.scene.bodies import Clamp
from ddmpi.scene.contacts import Rigid, SettledContact, both_sides
from ddmpi.scene.scene import Settled
from ddmpi.scene.values import histories
from ddmpi.system.agreement import agreed, merged
from ddmpi.system.clock import Clock
from ddmpi.system.doubts import condensed
from ddmpi.system.numbers import ALIKE, in_words, moment
from ddmpi.system.provenance import NO_CLARABEL, NO_MATPLOTLIB, has_clarabel, has_matplotlib

log = logging.getLogger("ddmpi")


def check(
    world: MPI.Comm, scene: Settled, scene_path: str, output: str | None, figures: bool
) -> None:
    """Log meshes, supports, loads and contacts of `scene`. With `figures` write check.html and, with matplotlib, pictures
    into the folder `output`, or a new one under results/. Collective on `world`.

    Raises the errors of a run, the same on all ranks; NotConvergedError if there is no equilibrium.
    """
    ranks = world.size
    on_working_ranks(
        world, scene, lambda part: _check(part, scene, scene_path, output, figures, ranks)
    )


def _check(
    world: MPI.Comm, scene: Settled, scene_path: str, output: str | None, figures: bool, ranks: int
) -> None:
    """`check` on the ranks with bodies, of all `ranks`."""
    folder = None
    claimed = contextlib.ExitStack()
    with agreed(world):
        if world.rank == 0 and figures:
            folder = claimed.enter_context(
                choose_folder(output, None, f"{Path(scene_path).stem}-check")
            )
    with claimed:
        log.info("%s", scene.title or scene_path)
        clock = Clock()
        assembly = prepare_scene(world, scene, scene_path, clock, factor=False)
        held = motions_to_hold(assembly)
        free = motions_without_resistance(assembly)
        mechanism = beyond_meshes(assembly, held, look_for_mechanism(assembly))
        overlaps = _overlaps(assembly)
        bodies, interfaces = _gather(assembly)
        near = drawers(world)
        folder = world.bcast(folder)
        costs = forecast(assembly, clock.seconds, scene.output.figures and has_matplotlib())
        with agreed(world, asleep=True):
            boundaries = {name: body.boundary for name, body in bodies.items()}
            missing = list(find_missing(boundaries, scene.rigid, scene.contact))
            told = costs.lines(scene_path)
            for line in _page(assembly, bodies, interfaces, missing, free, ranks, told):
                log.info("%s", line)
            of_meshes = [body.doubt for body in bodies.values() if body.doubt]
            doubts = [*assembly.warnings, *locking_of(scene), *overlaps, *of_meshes]
            for warning in condensed(doubts):
                log.warning("%s", warning)
            if folder and world.rank in near:
                shown = (scene, bodies, interfaces, missing)
                number = near.index(world.rank)
                if has_matplotlib():
                    names = draw(folder, *shown, number, len(near))
                    log.info("pictures in %s: %s", folder, ", ".join(names))
                if number == len(near) - 1:
                    costs.write(folder)
                    write_check(folder / "check.html", *shown)
                log.info("to turn, take apart and click: %s", folder / "check.html")
            _tell_what_is_left_out(figures and not has_matplotlib(), assembly)
            if mechanism:
                raise NotConvergedError(describe(mechanism))


def _gather(assembly: Assembly) -> tuple[dict[str, Looked], list[Interface]]:
    """All bodies by name and all interfaces, in the scene's order, on each rank. Collective."""
    world = assembly.world
    scene = assembly.scene
    with agreed(world):
        local = {body.spec.name: _look(body, scene.units["length"]) for body in assembly.bodies}
    looked = merged(world, local)
    owned = merged(world, {interface.name: interface for interface in assembly.space.interfaces})
    bodies = {body.name: looked[body.name] for body in scene.body}
    return bodies, [owned[contact.name] for contact in scene.contact]


def _tell_what_is_left_out(pictures: bool, assembly: Assembly) -> None:
    """Log what packages that are not there would do."""
    if pictures:
        log.info("no pictures: %s", NO_MATPLOTLIB)
    if assembly.loose and not has_clarabel():
        log.info("the search for an equilibrium of loose bodies is skipped: %s", NO_CLARABEL)


def _overlaps(assembly: Assembly) -> list[str]:
    """Warnings of bodies that penetrate each other or rigid partners as they are drawn. Collective."""
    scene = assembly.scene
    here = (0.0,) * scene.dimension
    still = [msgspec.structs.replace(rigid, displacement=here) for rigid in scene.rigid]
    drawn = dataclasses.replace(assembly, scene=msgspec.structs.replace(scene, rigid=still))
    unmoved = {body.spec.name: np.zeros_like(body.mesh.points) for body in assembly.bodies}
    return doubt_overlaps(drawn, unmoved, {})


def _look(body: Body, unit: str) -> Looked:
    """A body's mesh, loads and supports, with the words about them; `unit` of length. Not collective."""
    mesh = body.mesh
    spec = body.spec
    member = body.member
    boundary = Boundary.of(mesh)
    loads = [
        (history, on, f)
        for history in (None, *histories(spec))
        for on, f in loads_by_group(mesh, spec, history)
    ]
    clamps = [
        (_prescribed(clamp, mesh.dimension), clamp.on, clamp.history) for clamp in spec.clamps
    ]
    foundations = [("foundation", foundation.on, None) for foundation in spec.foundation]
    supports = [*clamps, *foundations]
    of_loads = [
        (on, f"load: {_force(mesh, on, f)}{_following(history)}") for history, on, f in loads
    ]
    dense = member.body.kind == "explicit"
    memory = memory_of_solver(body) + dense * 8.0 * member.size**2
    return Looked(
        mesh,
        boundary,
        [load[1:] for load in loads],
        [(how, mesh.nodes_of(on)) for how, on, _ in supports],
        [*((on, f"{how}{_following(history)}") for how, on, history in supports), *of_loads],
        memory,
        [
            _describe_mesh(mesh),
            *_describe_faces(mesh, boundary, unit),
            *(f"{how} on {on}{_following(history)}" for how, on, history in supports),
            *_describe_motions(body),
            *_describe_loads(body, loads),
            f"{member.elasticity.n} unknowns, {member.size} of contact: {SOLVERS[member.body.kind]} "
            f"({member.body.reason})",
        ],
        doubt_cells(mesh, spec.name),
    )


def _describe_mesh(mesh: Mesh) -> str:
    """Its nodes, elements and groups, in words."""
    length = edge_lengths(mesh)
    size = _range(length.max(axis=1).min(), length.max())
    named = [name for name in mesh.groups if not all(map(UNNAMED.fullmatch, parts_of(name, ())))]
    pieces = f", in {mesh.pieces} pieces that are not connected" * (mesh.pieces > 1)
    return (
        f"{len(mesh.points)} nodes, {len(mesh.triangles)} {mesh.cell.names} of size {size}{pieces}; "
        f"groups {', '.join(named) or 'by number'}"
    )


def _describe_motions(body: Body) -> Iterator[str]:
    """How a body can move if nothing touches it, in words."""
    name = body.spec.name
    member = body.member
    if not member.elasticity.supported:
        of_body = MotionsOfBody.of(name, body.mesh.points, member.motions)
        said = [
            motion.rpartition(": ")[2]
            .removesuffix(" without any force")
            .replace(f"{name} can", "it can", 1)
            for motion in undetermined(np.zeros((len(member.e), 0)), [of_body])
        ]
        yield f"loose: {'; '.join(said)}"


def _describe_loads(
    body: Body, loads: Sequence[tuple[str | None, str, np.ndarray]]
) -> Iterator[str]:
    """The heat and the `loads` of a body, by history, group and nodal loads (nv, d), in words."""
    heat = body.spec.heat
    if heat.value:
        yield f"temperature {heat.value}{_following(heat.history)}"
    for history, on, f in loads:
        yield f"load on {on}{_following(history)}: {_force(body.mesh, on, f)}"
    if len(loads) > 1:
        yield f"loads in all: {_force(body.mesh, '', np.sum([f for *_, f in loads], axis=0))}"


def _describe_faces(mesh: Mesh, boundary: Boundary, unit: str) -> Iterator[str]:
    """What each numbered face is, by its number: "8: plane, normal +z, 314 mm², about (0, 0, 5)". Not collective."""
    for name in sorted(mesh.faces, key=int):
        face = mesh.faces[name]
        words = describe_face(boundary, boundary.groups[name], face, unit)
        yield f"{name}: {words}" + f", or {face.words!r}" * bool(face.words)


def _prescribed(clamp: Clamp, d: int) -> str:
    """The components that a clamp prescribes, in words."""
    given = dict(zip("xyz"[:d], clamp.components, strict=False)) | {"its normal": clamp.normal}
    given[f"({', '.join(map(str, clamp.along or ()))})"] = clamp.value
    ways = grouped(
        ("fixed" if value == 0.0 else "moved", axis)
        for axis, value in given.items()
        if value is not None
    )
    return ", ".join(f"{how} along {', '.join(axes)}" for how, axes in ways)


def _following(history: str | None) -> str:
    return f" (history {history})" if history else ""


def _range(least: float, most: float) -> str:
    return " to ".join(dict.fromkeys(f"{value:.3g}" for value in (least, most)))


def _force(mesh: Mesh, on: str, f: np.ndarray) -> str:
    """Resultant of nodal loads (nv, d), and their moment unless they are volume forces, in words."""
    moments = f", moment {_vector(moment(mesh.points, f, mesh.axisymmetric), f * np.abs(mesh.points).max())}"
    return f"force {_vector(f.sum(axis=0), f)}{moments * (on != VOLUME)}"


def _vector(value: Sequence[float] | np.ndarray, summands: np.ndarray) -> str:
    """A vector, or one number, in words, with zero for rounding beside its summands."""
    parts = np.where(np.abs(value) <= ALIKE * np.abs(summands).sum(), 0.0, value)
    return in_words(parts, 4) if parts.ndim else f"{parts:.4g}"


def _page(
    assembly: Assembly,
    bodies: Bodies,
    interfaces: Sequence[Interface],
    missing: Sequence[Missing],
    free: Sequence[str],
    ranks: int,
    costs: Iterator[str],
) -> Iterator[str]:
    """The lines of the page, those that can be pasted at its end. Not collective."""
    scene = assembly.scene
    unit = scene.units
    yield (
        f"{assembly.n} unknowns ({titles(body.mesh.cell.title for body in bodies.values())}), {assembly.m} "
        f"contact nodes, bodies: {len(bodies)}, ranks: {ranks}; solvers take about "
        f"{bytes_in_words(sum(body.memory for body in bodies.values()))}"
    )
    yield describe_method(scene.method, scene.dimension)
    yield f"lengths in {unit['length']}, forces in {unit['force']}, moments about the origin in {unit['moment']}"
    for words, names in grouped(("\n    ".join(body.words), name) for name, body in bodies.items()):
        yield f"body {some(names, 'bodies')}: {words}"
    if scene.wheel:
        yield sector_in_words(scene.wheel)
    for rigid in scene.rigid:
        yield from (f"rigid {rigid.name}: {words}" for words in _describe_rigid(rigid))
    contacts = [
        (words, contact.name)
        for contact, interface in zip(scene.contact, interfaces, strict=True)
        for words in _describe_contact(contact, interface, unit["length"], len(interfaces))
    ]
    yield from (f"contact {some(names, 'contacts')}: {words}" for words, names in grouped(contacts))
    yield from (f"{motion}, whatever touches" for motion in free)
    yield from costs
    taken = {contact.name for contact in scene.contact}
    for lack in missing:
        yield from _describe_missing(lack, scene, taken)


def _describe_rigid(rigid: Rigid) -> Iterator[str]:
    """How a rigid partner moves, in words."""
    follows = _following(rigid.history)
    plain = np.zeros(1)
    for how, value in ("moved", rigid.displacement), ("pushed", rigid.force):
        if value and any(value):
            yield f"{how} by {_vector(value, plain)}{follows}"
    pushed = zip("xyz", rigid.force or (0.0,) * 3, strict=False)
    unpushed = [axis for axis, force in pushed if axis in (rigid.free or ()) and not force]
    if unpushed:
        yield f"moves freely along {', '.join(unpushed)}"
    if rigid.turning:
        about = in_words(np.array(rigid.pivot), 4)
        under = "freely"
        if rigid.moment is not None:
            under = f"by a moment {_vector(np.array(rigid.moment), plain)}"
        yield f"turned {under} about {about}{follows * (rigid.moment is not None)}"


def _describe_contact(
    contact: SettledContact, interface: Interface, unit: str, count: int
) -> Iterator[str]:
    """The sides, pairing, law and gap of a contact, one of `count`, and its pretension, in words."""
    sides = " and ".join(".".join(side) for side in zip(contact.bodies, contact.on, strict=False))
    sides += f", {contact.image.words}" if contact.image else ""
    pairing = f"mortar, slave {interface.slave}" if interface.slave else "paired"
    law = interface.law.name + ", a soft joint" * bool(contact.layer)
    yield (
        f"{sides}: " * (count <= LISTED)
        + f"{interface.m} nodes, {pairing}, law {law}; {describe_gap(interface, unit)}"
    )
    if bolt := contact.pretension:
        along = in_words(np.array(bolt.along), 4)
        force = "a force that is to be given" if bolt.force is None else f"{bolt.force:g}"
        yield f"pulled by {force} along {along}{_following(bolt.history)}"


def _describe_missing(lack: Missing, scene: Settled, taken: set[str]) -> Iterator[str]:
    """A missing contact in words, and its lines in a scene, with a name that is not among those `taken`."""
    without = (name for name, on in zip(lack.bodies, lack.on, strict=False) if not on)
    nameless = " and ".join(dict.fromkeys(without))
    what = "where they may touch, add"
    if nameless:
        kind = PHYSICAL[scene.dimension - 1]
        what = f"to name one, give the boundary of {nameless} a name there (a {kind})"
    # words are a comment, so that all of the lines can be pasted together
    yield (
        "# "
        * (not nameless)
        + f"{both_sides(lack.bodies)} are {_range(*lack.gap)} {scene.units['length']} apart at "
        f"{in_words(lack.facets[0].mean(axis=0), 4)} and near it, where no contact names both; {what}"
    )
    if not nameless:
        yield lack.lines(taken)
