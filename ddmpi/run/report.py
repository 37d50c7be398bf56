"""What a run logs: its plan, its progress, its end."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.ranks import team_of
from ddmpi.interface.interface import Interface
from ddmpi.mesh.elements import CELLS
from ddmpi.methods.outer import Step
from ddmpi.run.solve import Solution
from ddmpi.scene.method import PRESETS, SettledMethod
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import gathered
from ddmpi.system.provenance import NO_CLARABEL, NO_MATPLOTLIB, has_clarabel, has_matplotlib

log = logging.getLogger("ddmpi")

NAMED = 4
"""Of more names than this that share a line, the first two stand for all."""

LISTED = 12
"""More contacts or bodies than this have one line in all at the end, but for contacts with rigid partners."""

DIRECT = "preonly + cholesky (mumps)"
"""How PETSc calls the solver that bodies have by default."""

PRECISION = 1e-8
"""Components of a force below this part of it are printed as zero: rounding, and what iterations leave."""

UNDETERMINED = 3
"""Of more undetermined motions than this, the first ones stand for all."""


def log_plan(assembly: Assembly, figures: bool) -> None:
    """Log what is solved, how, and what is left out because the scene does not need it. Collective."""
    scene, world = assembly.scene, assembly.world
    ranks = team.comm.size if (team := team_of(world)) else 1
    bodies = gathered(world, {body.spec.name: _describe_body(body, ranks) for body in assembly.bodies})
    owned = gathered(world, {each.name: (each.law.name, describe_gap(each, scene.output.length_unit),
                                         _contact_left_out(each)) for each in assembly.space.interfaces})
    if world.rank:
        return
    contacts = {contact.name: owned[contact.name] for contact in scene.contact}
    log.info("n = %d unknowns (%s), m = %d contact nodes, friction: %s", assembly.n,
             CELLS[scene.dimension, scene.body[0].mesh.order].title, assembly.m,
             ", ".join(dict.fromkeys(law for law, *_ in contacts.values())))
    for gap, names in grouped((gap, name) for name, (_, gap, _) in contacts.items()):
        log.info("%s: %s", some(names, "contacts"), gap)
    for way, names in grouped((bodies[spec.name][0], spec.name) for spec in scene.body):
        log.info("%s: %s", some(names, "bodies"), way)
    if assembly.loose and not has_clarabel():
        log.info("whether contacts can hold the loose bodies is not asked: %s", NO_CLARABEL)
    unloaded = [spec.name for spec in scene.body if not bodies[spec.name][1]]
    left_out = [what % ("" if len(names) == len(contacts) else f" of {some(names, 'contacts')}") for what, names in
                grouped((what, name) for name, (*_, left) in contacts.items() for what in left)]
    if unloaded:
        left_out.append(f"loads of {some(unloaded, 'bodies')} (there are none)")
    unused = [rigid.name for rigid in scene.rigid if all(rigid.name not in each.bodies for each in scene.contact)]
    if unused:
        left_out.append(f"rigid {some(unused, 'partners')} (no contact names {'it' if len(unused) == 1 else 'them'})")
    if not assembly.loose:
        left_out.append("rigid motions (all bodies are held)")
    if world.size < len(scene.body):
        log.info("%d bodies on %s", len(scene.body), _count(world.size, "rank"))
    if not scene.output.stress:
        left_out.append("stress in the files (not asked for)")
    if not figures:
        left_out.append("pictures (not asked for)")
    elif not has_matplotlib():
        left_out.append(f"pictures ({NO_MATPLOTLIB})")
    left_out += _target_left_out(scene)
    log.info("%s; left out: %s", describe_method(scene.method, scene.dimension), ", ".join(left_out) or "nothing")
    log.info("%5s  %10s  %10s  %6s", "k", "update", "residual", "n_A")


def log_warnings(found: Iterable[str], told: list[str]) -> None:
    """Log the warnings that have not been `told`, and note that they are. Not collective."""
    for warning in found:
        if warning not in told:
            log.warning("%s", warning)
            told.append(warning)


def _describe_body(body: Body, ranks: int) -> tuple[str, bool]:
    """How a body is solved, on how many ranks, after how its cells were cut; and whether loads act on it."""
    mesh, motions, compliance = body.mesh, body.member.motions.shape[2], body.member.C
    solver, what = compliance.solver.description, {"triangle": "quadrilaterals"}.get(mesh.cell.name, "other cells")
    way = f"{mesh.cut} {what} cut into {mesh.cell.names}; " if mesh.cut else ""
    way += "" if ranks == 1 else f"on {ranks} ranks; "
    if motions:
        way += f"not held by clamps ({_count(motions, 'rigid motion')}); "
    way += "direct solver" if solver == DIRECT else f"solver {solver}"
    if compliance.solver.refused:
        way += f" through PETSc (MUMPS is not called directly: {compliance.solver.refused})"
    if compliance.kind != "explicit" or compliance.reason == "asked for":
        way += f", compliance {compliance.kind} ({compliance.reason})"
    return way, body.member.elasticity.b.norm() > 0.0


def grouped(pairs: Iterable[tuple[str, str]]) -> Iterator[tuple[str, list[str]]]:
    """The second ones of pairs by the first ones, each of which is there once, in the order of its first mention."""
    found: dict[str, list[str]] = {}
    for first, second in pairs:
        found.setdefault(first, []).append(second)
    yield from found.items()


def some(names: Sequence[str], what: str) -> str:
    """Names in a row; of many the first ones and their number: "a, b, … (12 contacts)"."""
    return ", ".join(names) if len(names) <= NAMED else f"{names[0]}, {names[1]}, … ({len(names)} {what})"


def _contact_left_out(interface: Interface) -> list[str]:
    """What a contact does not need, with %s where the contacts of which it is said are named."""
    found, held = [], interface.m - len(interface.sliding)
    if interface.law.name == "none":
        found.append("tangential unknowns%s (no friction)")
    elif held:
        found.append(f"{_count(held, 'tangential unknown')}%s (held by clamps)")
    if interface.dropped:
        found.append(f"{_count(interface.dropped, 'contact node')}%s (clamped)")
    if not interface.gap.any():
        found.append("initial gap%s (all nodes touch)")
    return found


def _target_left_out(scene: Settled) -> list[str]:
    """That a preset's target is not applied, because meshes are given."""
    target = PRESETS.get(scene.method.preset or "", {}).get("target_error")
    given = [body.name for body in scene.body if not body.mesh.refinable]
    if not (target and given and scene.method.target_error is None):
        return []
    return [f'the target of {scene.method.preset}, {target:g} (the mesh of {" and of ".join(given)} is given, and not '
            'refined unless mesh.refine = "as needed")']


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def describe_gap(interface: Interface, unit: str) -> str:
    """How far the sides are apart at first, and what a load on them means."""
    gap = np.concatenate([interface.gap, interface.fixed.gap])
    if not gap.any():
        return "all nodes touch at first"
    ends = {"gap": gap.max(), "overlap": -gap.min()}
    return ", ".join(f"initial {kind} up to {end:.3g} {unit}" for kind, end in ends.items() if end > 0.0)


def log_step(step: Step) -> None:
    log.info("%5d  %10.3e  %10.3e  %6d%s", step.iteration, step.update, step.residual, step.n_A,
             f"  {step.stage}" if step.stage else "")


def describe_method(method: SettledMethod, dimension: int) -> str:
    """The outer method with its solvers, in words."""
    plan, discs = method.plan, ""
    if dimension > 2:
        plan, discs = plan.replace("half-plane", "half-space"), ", those with friction by python (APG)"
    if not method.by_body:
        return plan

    from ddmpi.qp.tao import QPSolver

    return f"{plan}; subproblems by TAO {QPSolver().type.replace('python', 'python (MPRGP)')}{discs}"


def log_end(summary: dict, solution: Solution) -> None:
    """Log how the run ended, and what a user looks at first. Not collective."""
    log.info("%s (%d outer iterations, n_A = %d)", summary["reason"], summary["outer_iterations"], summary["n_A"])
    if not solution.mechanism:
        _log_contacts(summary, solution)
        _log_bodies(summary)
        _log_partners(summary)
        log.info("certificate (limit %.2g): %s", solution.limit,
                 ", ".join(f"{kind.replace('_', ' ')} {value:.1e}"
                           for kind, (value, _) in solution.certificate.worst().items()))
        _log_between_nodes(summary["contacts"], summary["units"])
        error = summary["discretization_error"]["energy_norm"]
        if error is not None:
            log.info("estimated discretization error: %.2g of the energy norm", error)
    motions = summary["undetermined"]
    for motion in motions[:UNDETERMINED]:
        log.info("%s; how far it has moved is not determined", motion)
    if len(motions) > UNDETERMINED:
        log.info("and %d more such motions, which summary.json lists", len(motions) - UNDETERMINED)
    if summary["options_unused"]:
        log.warning("PETSc options that nothing used: %s (solvers have those with the prefixes body_, newton_ and qp_)",
                    ", ".join(summary["options_unused"]))


def _log_contacts(summary: dict, solution: Solution) -> None:
    contacts, totals = summary["contacts"], solution.contacts
    listed = list(contacts)
    if len(contacts) > LISTED:
        highest = max(contacts, key=lambda name: contacts[name]["pressure_max"] or -np.inf)
        log.info("%d contacts: %d open, %d slip, %d stick nodes; largest pressure %.4g %s, of %s", len(contacts),
                 *(sum(contact[status] for contact in contacts.values()) for status in ("open", "slip", "stick")),
                 _number(contacts[highest]["pressure_max"]), summary["units"]["stress"], highest)
        listed = [name for name in contacts if totals[name].rigid is not None][:LISTED]
    for name in listed:
        log.info("%s", describe_contact(summary, name, totals[name].bodies[0]))
    closed = {name for step in summary["steps"] for name, each in step["contacts"].items()
              if each["slip"] + each["stick"]}
    apart = [f"{name} (at least {max(each.opening, 0.0):.3g} apart)" for name, each in totals.items()
             if name not in closed]
    if apart:
        log.info("closed nowhere%s: %s", " at any time" * (len(summary["steps"]) > 1), some(apart, "contacts"))


def describe_contact(summary: dict, name: str, body: str) -> str:
    """The state of a contact in one line; `body` is its first one. Not collective."""
    contact, units = summary["contacts"][name], summary["units"]
    return (f"{name}: {contact['open']} open, {contact['slip']} slip, {contact['stick']} stick nodes; "
            f"force {_vector(contact['force'])} {units['force']} on {body}, "
            + ("no area" if contact["pressure_max"] is None and None not in contact["force"] else
               f"largest pressure {_number(contact['pressure_max']):.4g} {units['stress']}"))


def _log_between_nodes(contacts: dict, units: dict) -> None:
    """What the certificate cannot promise where nodes do not match: the worst of all such contacts."""
    some = {name: contact for name, contact in contacts.items() if contact["slave"]}
    if not some:
        return
    deepest, turned = (max(some, key=lambda name: _number(some[name][key]))
                       for key in ("pointwise_penetration", "moment_imbalance"))
    for name, words in grouped([
            (deepest, f"overlap between nodes {_number(some[deepest]['pointwise_penetration']):.2g} {units['length']}"),
            (turned, f"moments out of balance by {_number(some[turned]['moment_imbalance']):.2g}, at most "
                     f"{_number(some[turned]['moment_imbalance_bound']):.2g} {units['moment']}")]):
        log.info("mesh error at the non-matching contact %s (small is good): %s", name, "; ".join(words))


def _log_bodies(summary: dict) -> None:
    bodies, units = summary["bodies"], summary["units"]
    held = {each["name"] for each in summary["scene"]["body"] if each["clamp"] or each["foundation"]}
    listed = list(bodies)
    if len(bodies) > LISTED:
        moved, stressed = (max(bodies, key=lambda name: _number(bodies[name][key]))
                           for key in ("displacement_max", "von_mises_max"))
        stress = bodies[stressed]["von_mises_max"]
        log.info("%d bodies: largest displacement %.4g %s, of %s%s", len(bodies),
                 _number(bodies[moved]["displacement_max"]), units["length"], moved,
                 "" if stress is None else f"; largest von Mises stress {stress:.4g} {units['stress']}, of {stressed}")
        listed = [name for name in bodies if name in held][:LISTED]
    for name in listed:
        body, stress = bodies[name], bodies[name]["von_mises_max"]
        log.info("%s: %slargest displacement %.4g %s%s", name,
                 f"reaction {_vector(body['reaction'])} {units['force']}, " if name in held else "",
                 _number(body["displacement_max"]), units["length"],
                 "" if stress is None else f", von Mises stress {stress:.4g} {units['stress']}")


def _log_partners(summary: dict) -> None:
    """Where forces have pushed rigid partners."""
    for rigid in summary["scene"]["rigid"]:
        if rigid["force"] and rigid["name"] in summary["rigid"]:
            found, units = summary["rigid"][rigid["name"]], summary["units"]
            log.info("%s: force of bodies %s %s, displacement %s %s", rigid["name"], _vector(found["force"]),
                     units["force"], _vector(found["displacement"]), units["length"])


def describe_files(names: Sequence[str]) -> str:
    """The files of the results; many tables of contacts as one."""
    tables = [name for name in names if name.startswith("contact_") and name.endswith((".csv", ".vtu"))]
    if len(tables) <= NAMED:
        return ", ".join(names)
    return ", ".join(dict.fromkeys(f"contact_NAME ({len(tables)} files)" if name in tables else name
                                   for name in names))


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _vector(components: list[float | None]) -> str:
    """In words, as zero what is below the precision of forces."""
    parts = np.array([_number(component) for component in components])
    parts[np.abs(parts) < PRECISION * np.linalg.norm(parts)] = 0.0
    return "(" + ", ".join(f"{part:.4g}" for part in parts) + ")"
