"""The log of a run: its plan, its progress, its end."""

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.ranks import team_of
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactTotals
from ddmpi.methods.outer import Step
from ddmpi.results.converge import table_of
from ddmpi.results.summary import (
    as_float,
    count,
    friction_in_words,
    half_in_words,
    held_in_words,
    largest,
    loose_in_words,
    tell,
    with_bar,
)
from ddmpi.run.solve import Solution
from ddmpi.scene.method import PRESETS, SettledMethod
from ddmpi.scene.motions import Image
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import gathered
from ddmpi.system.numbers import ALIKE, counted
from ddmpi.system.provenance import NO_CLARABEL, NO_MATPLOTLIB, has_clarabel, has_matplotlib

log = logging.getLogger("ddmpi")

NAMED = 4  # most names in a line, of more the first two and the number; most undetermined motions, and pictures
LISTED = 12  # most contacts or bodies with own lines at the end; of more, those with rigid partners or supports
DIRECT = "preonly + cholesky (mumps)"  # PETSc's name for the default solver of bodies


def log_plan(assembly: Assembly, figures: bool) -> None:
    """Log what is solved, how, and what is left out because the scene does not need it. Collective."""
    scene, world = assembly.scene, assembly.world
    ranks = team.comm.size if (team := team_of(world)) else 1
    bodies = gathered(
        world, {body.spec.name: _describe_body(body, ranks) for body in assembly.bodies}
    )
    owned = gathered(
        world,
        {
            interface.name: (interface.law.name, _plan_of(interface, scene.output.length_unit))
            for interface in assembly.space.interfaces
        },
    )
    if world.rank:
        return
    contacts = {contact.name: owned[contact.name] for contact in scene.contact}
    laws = ", ".join(dict.fromkeys(law for law, _ in contacts.values()))
    log.info(
        "n = %d unknowns (%s)%s",
        assembly.n,
        titles(title for *_, title in bodies.values()),
        f", m = {assembly.m} contact nodes, friction: {laws}" * bool(contacts),
    )
    for plan, names in grouped((plan, name) for name, (_, plan) in contacts.items()):
        log.info("%s: %s", some(names, "contacts"), plan)
    if scene.wheel:
        log.info("%s", sector_in_words(scene.wheel))
    for line in _plan_of_bodies(assembly, bodies):
        log.info("%s", line)
    method = describe_method(scene.method, scene.dimension)
    left_out = ", ".join(_left_out(assembly, figures)) or "nothing"
    log.info("%s; left out: %s", method, left_out)
    log.info("%5s  %10s  %10s  %6s", "k", "update", "residual", "n_A")


def titles(each: Iterable[str]) -> str:
    """Kinds of cells, each once, in words."""
    return " and ".join(dict.fromkeys(each))


def _plan_of_bodies(
    assembly: Assembly, bodies: Mapping[str, tuple[str, bool, str]]
) -> Iterator[str]:
    """How the `bodies` are solved, by the results of `_describe_body`. Not collective."""
    names = [spec.name for spec in assembly.scene.body]
    for way, alike in grouped((bodies[name][0], name) for name in names):
        yield f"{some(alike, 'bodies')}: {way}"
    if assembly.loose and not has_clarabel():
        yield f"the search for an equilibrium of loose bodies is skipped: {NO_CLARABEL}"
    unloaded = [name for name in names if not bodies[name][1]]
    if unloaded:
        yield f"{some(unloaded, 'bodies')}: no loads"
    if assembly.world.size < len(names):
        yield f"{len(names)} bodies on {counted(assembly.world.size, 'rank')}"


def sector_in_words(image: Image) -> str:
    """What a scene with a turned image is one sector of."""
    return (
        f"one of {image.sectors} sectors, the next one {image.words}: loads, clamps and partners turn with each, and "
        "forces, energy and volume are those of one"
    )


def _left_out(assembly: Assembly, figures: bool) -> Iterator[str]:
    """What the run does not do, and why. Not collective."""
    scene = assembly.scene
    only = scene.output.only
    if not assembly.loose:
        yield "rigid motions (all bodies are supported)"
    if only:
        yield (
            "fields, stresses, pictures, the estimated error and warnings of strains, stresses and overlaps of bodies "
            f'(output.only = "{only}")'
        )
    elif not scene.output.stress:
        yield "stress in the files (not asked for)"
    if not only and not figures:
        yield "pictures (not asked for)"
    if figures and not only and not has_matplotlib():
        yield f"pictures ({NO_MATPLOTLIB})"
    yield from _target_left_out(scene)


def log_warnings(warnings: Iterable[str], told: list[str]) -> None:
    """Log the warnings that have not been `told`, and note that they are. Not collective."""
    for warning in warnings:
        if warning not in told:
            log.warning("%s", warning)
            told.append(warning)


def _describe_body(body: Body, ranks: int) -> tuple[str, bool, str]:
    """How the cells of a body were cut, and how it is solved, on how many ranks; whether loads act on it; its cells."""
    mesh, motions, compliance = body.mesh, body.member.motions.shape[2], body.member.C
    solver = compliance.solver.description
    what = {"triangle": "quadrilaterals"}.get(mesh.cell.name, "other cells")
    way = f"{mesh.cut} {what} cut into {mesh.cell.names}; " if mesh.cut else ""
    way += "" if ranks == 1 else f"on {ranks} ranks; "
    if motions:
        held = (
            "its frame is free" if body.member.elasticity.supported else "not supported by clamps"
        )
        way += f"{held} ({counted(motions, 'rigid motion')}); "
    way += "direct solver" if solver == DIRECT else f"solver {solver}"
    if compliance.solver.refused:
        way += f" through PETSc (MUMPS is not called directly: {compliance.solver.refused})"
    if compliance.kind != "explicit" or compliance.reason == "asked for":
        way += f", compliance {compliance.kind} ({compliance.reason})"
    loaded = body.member.elasticity.b.norm() > 0.0 or bool(body.member.e.any())
    return way, loaded, mesh.cell.title


def grouped(pairs: Iterable[tuple[str, str]]) -> Iterator[tuple[str, list[str]]]:
    """The second entries of pairs by the first ones, in the order of their first mention."""
    groups: dict[str, list[str]] = {}
    for first, second in pairs:
        groups.setdefault(first, []).append(second)
    yield from groups.items()


def some(names: Sequence[str], what: str) -> str:
    """All names, or of many the first ones and the number: "a, b, … (12 contacts)"."""
    return (
        ", ".join(names)
        if len(names) <= NAMED
        else f"{names[0]}, {names[1]}, … ({len(names)} {what})"
    )


def _plan_of(interface: Interface, unit: str) -> str:
    """The initial gap of a contact, and which unknowns it does not need."""
    facts, constrained = [describe_gap(interface, unit)], interface.m - len(interface.sliding)
    if interface.law.frictionless:
        facts.append("no friction")
    elif constrained:
        facts.append(f"clamps constrain {counted(constrained, 'tangential unknown')}")
    if clamped := len(interface.fixed.gap):
        facts.append(f"clamps constrain {counted(clamped, 'contact node')}")
    return "; ".join(facts)


def _target_left_out(scene: Settled) -> list[str]:
    """That a preset's target is not applied, because meshes are not refined."""
    target = PRESETS.get(scene.method.preset or "", {}).get("target_error")
    given = [body.name for body in scene.body if not body.mesh.refinable]
    if not (target and given and scene.method.target_error is None):
        return []
    return [
        f"the target of {scene.method.preset}, {target:g} (the mesh of {' and of '.join(given)} is given, and not "
        'refined unless mesh.refine = "as needed")'
    ]


def describe_gap(interface: Interface, unit: str) -> str:
    """The initial gap or overlap of a contact."""
    gap = np.concatenate([interface.gap, interface.fixed.gap])
    if not gap.any():
        return "all nodes touch at first"
    ends = {"gap": gap.max(), "overlap": -gap.min()}
    return ", ".join(
        f"initial {kind} up to {end:.3g} {unit}" for kind, end in ends.items() if end > 0.0
    )


def log_step(step: Step) -> None:
    log.info(
        "%5d  %10.3e  %10.3e  %6d%s",
        step.iteration,
        step.update,
        step.residual,
        step.n_A,
        f"  {step.stage}" if step.stage else "",
    )


def describe_method(method: SettledMethod, dimension: int) -> str:
    """The outer method with its solvers, in words."""
    plan, discs = method.plan, ""
    if dimension > 2:
        plan = plan.replace("half-plane", "half-space")
        discs = ", those with friction by python (APG)"
    if not method.by_body:
        return plan

    from ddmpi.published.tao import QPSolver

    return (
        f"{plan}; subproblems by TAO {QPSolver().type.replace('python', 'python (MPRGP)')}{discs}"
    )


def log_end(summary: dict, solution: Solution) -> None:
    """Log how the run ended, and what a user looks at first. Not collective."""
    lines = [
        f"{summary['reason']} ({counted(summary['outer_iterations'], 'outer iteration')}, n_A = {summary['n_A']})"
    ]
    if not solution.mechanism:  # its forces and displacements would mean nothing
        residuals = ", ".join(
            f"{kind.replace('_', ' ')} {as_float(value):.1e}"
            for kind, value in summary["certificate"].items()
        )
        lines += [
            *_contacts(summary, solution.contacts),
            *_bodies(summary),
            *_partners(summary),
            f"certificate (limit {summary['certificate_limit']:.2g}): {residuals}",
            *_between_nodes(summary),
        ]
        error = summary["discretization_error"]["energy_norm"]
        if error is not None:
            lines.append(f"estimated discretization error: {error:.2g} of the energy norm")
        if quadratic := summary["discretization_error"]["quadratic_n"]:
            lines[-1] += (
                f"; with mesh.order = 2 it is smaller, and these cells have about {quadratic} "
                f"unknowns ({summary['n']} now)"
            )
    lines += [f"{result}: {with_bar(summary, result)}" for result in summary.get("errors", {})]
    lines += [half] if (half := half_in_words(summary)) else []
    lines += _meshes(summary) if len(summary["scene"]["method"]["target"]) == 1 else []
    lines += _some_motions(held_in_words(summary) if not solution.mechanism else [])
    lines += _some_motions(loose_in_words(summary))
    for line in lines:
        log.info("%s", line)


def _meshes(summary: dict) -> Iterator[str]:
    """The meshes of a single target, with its values and bars."""
    ((result, told),) = table_of(summary).items()
    yield f"{'unknowns':>10}  {'seconds':>8}  {result}"
    for mesh in told["meshes"]:
        words = with_bar(summary, result, mesh)
        yield f"{mesh['unknowns']:>10}  {mesh['seconds']:>8.2f}  {words}"


def _some_motions(lines: list[str]) -> list[str]:
    """The first lines, and how many more there are."""
    more = len(lines) - NAMED
    return lines[:NAMED] + [f"and {more} more such motions, which summary.json lists"] * (more > 0)


def _contacts(summary: dict, totals: Mapping[str, ContactTotals]) -> Iterator[str]:
    contacts = summary["contacts"]
    listed = list(contacts)
    if len(contacts) > LISTED:
        pressure = _largest(summary, "contacts", "pressure_max")
        yield f"{len(contacts)} contacts: {count(contacts.values())} nodes; {pressure}"
        listed = [name for name in contacts if totals[name].rigid is not None][:LISTED]
    for name in listed:
        yield from describe_contact(summary, name, totals[name].bodies[0])
    closed = {
        name
        for step in summary["steps"]
        for name, contact in step["contacts"].items()
        if contact["slip"] + contact["stick"]
    }
    unit, rounding = summary["units"]["length"], ALIKE * as_float(summary["displacement_max"])
    apart = [
        f"{name} (at least {contact.opening if contact.opening > rounding else 0.0:.3g} {unit} apart)"
        for name, contact in totals.items()
        if name not in closed
    ]
    if apart:
        yield f"closed nowhere{' at any time' * (len(summary['steps']) > 1)}: {some(apart, 'contacts')}"


def describe_contact(summary: dict, name: str, body: str) -> list[str]:
    """The state of a contact in a line, and how much of its friction it bears; `body` is its first one. Not collective."""
    contact = summary["contacts"][name]
    # bodies that meet along an edge only have forces but no area, so no pressure
    pressure = (
        "no area"
        if contact["pressure_max"] is None and None not in contact["force"]
        else tell(summary, "contacts", name, "pressure_max")
    )
    bolt, units = contact.get("pretension"), summary["units"]
    pulled = (
        (
            f"; pretension {as_float(bolt['force']):.4g} {units['force']} at the offset "
            f"{as_float(bolt['offset']):.4g} {units['length']}"
        )
        if bolt
        else ""
    )
    words = f"{name}: {count([contact])} nodes; {tell(summary, 'contacts', name, 'force')} on {body}, {pressure}{pulled}"
    bears = friction_in_words(contact)
    return [words, f"{name}: {bears}"] if bears else [words]


def _largest(summary: dict, table: str, key: str) -> str:
    """The largest value of all bodies or contacts, and its name."""
    _, name = largest(summary[table], key)
    return f"{tell(summary, table, name, key)}, of {name}"


def _between_nodes(summary: dict) -> Iterator[str]:
    """Errors of contacts whose nodes do not match, of which the certificate says nothing: the worst of all."""
    unmatched = {name: contact for name, contact in summary["contacts"].items() if contact["slave"]}
    if not unmatched:
        return
    _, deepest = largest(unmatched, "pointwise_penetration")
    _, turned = largest(unmatched, "moment_imbalance")
    bound = as_float(unmatched[turned]["moment_imbalance_bound"])
    told = []
    # less than the certificate allows at nodes is rounding
    rounding = summary["certificate_limit"] * as_float(summary["displacement_max"])
    if as_float(unmatched[deepest]["pointwise_penetration"]) > rounding:
        told += [(deepest, tell(summary, "contacts", deepest, "pointwise_penetration", 2))]
    if bound:
        imbalance = tell(summary, "contacts", turned, "moment_imbalance", 3)
        told += [(turned, f"{imbalance} (bound {bound:.3g})")]
    for name, words in grouped(told):
        yield f"non-matching meshes at {name}: {'; '.join(words)}"


def _bodies(summary: dict) -> Iterator[str]:
    bodies = summary["bodies"]
    supported = {
        body["name"] for body in summary["scene"]["body"] if body["clamp"] or body["foundation"]
    }
    listed = list(bodies)
    if len(bodies) > LISTED:
        keys = ["displacement_max"] + ["von_mises_max"] * (
            largest(bodies, "von_mises_max")[0] is not None
        )
        yield f"{len(bodies)} bodies: {'; '.join(_largest(summary, 'bodies', key) for key in keys)}"
        listed = [name for name in bodies if name in supported][:LISTED]
    for name in listed:
        keys = [
            *["reaction"] * (name in supported),
            "displacement_max",
            *["von_mises_max"] * (bodies[name]["von_mises_max"] is not None),
        ]
        yield f"{name}: {', '.join(tell(summary, 'bodies', name, key) for key in keys)}"


def _partners(summary: dict) -> Iterator[str]:
    """Forces on rigid partners that move as these want, and their displacements and turns."""
    for rigid in summary["scene"]["rigid"]:
        name = rigid["name"]
        if (rigid["force"] or rigid["free"] or rigid["pivot"]) and name in summary["rigid"]:
            turns = ["moment", "turn"] * bool(rigid["pivot"])
            yield f"{name}: {', '.join(tell(summary, 'rigid', name, key) for key in ['force', 'displacement', *turns])}"


def describe_files(names: Sequence[str]) -> str:
    """The names of the result files; many tables of contacts as one."""
    tables = [
        name for name in names if name.startswith("contact_") and name.endswith((".csv", ".vtu"))
    ]
    if len(tables) <= NAMED:
        return ", ".join(names)
    return ", ".join(
        dict.fromkeys(
            f"contact_NAME ({len(tables)} files)" if name in tables else name for name in names
        )
    )
