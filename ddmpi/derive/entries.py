"""The derivatives of results: of contacts, bodies and rigid partners, as summary.json and an answer have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ddmpi.body.elasticity import LoadCase, clamp_forces
from ddmpi.body.loads import resultants
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.derive.parameters import Parameter, scaled
from ddmpi.interface.law import direction
from ddmpi.interface.state import ContactState
from ddmpi.methods.linear import PURPOSE
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed, gathered
from ddmpi.system.numbers import moments

ENOUGH = 1e-6
"""Largest relative residual of derivatives that are told."""

CLEAR = 1e-6
"""Sums of forces below this share of their sizes are rounding."""


class Entry(dict[str, Any]):
    """A table whose entries are attributes as well."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"there is no {name!r} (but {', '.join(self)})") from None


def entries_of(
    assembly: Assembly,
    parameters: Sequence[Parameter],
    derived: Mapping[str, np.ndarray],
    factors: Mapping[str | None, float],
    u: Mapping[str, np.ndarray],
    states: Mapping[str, ContactState],
) -> tuple[dict[str, Entry | None], dict[str, Entry]]:
    """By key the derivatives of all results, on the first rank, None where they are not precise enough; and those of
    arrays over this rank's contacts and bodies. What depends on forces that nothing determines is not a number.

    Parameters
    ----------
    derived : as `chain.Derived`
    factors : by history
    u, states : displacements (nv, d) of this rank's bodies (m), and its contacts

    Collective.
    """
    scene, joint = assembly.scene, assembly.joint
    contacts, bodies, told = {}, {}, dict[str, Entry | None]()
    arrays = {one.key: Entry(contacts=Entry(), bodies=Entry()) for one in parameters}
    parts = [joint.exchange.spread(s) for s in derived["s"]]
    unseen = [joint.exchange.spread(s) for s in derived["unseen"]]
    with agreed(assembly.world):
        for k, one in enumerate(parameters):
            here = arrays[one.key]
            for number, ((name, state), part) in enumerate(
                zip(states.items(), assembly.space.parts.values(), strict=True)
            ):
                contacts[k, name], here.contacts[name] = _contact(
                    state,
                    derived["s"][k][part],
                    derived["closed"][k][part],
                    derived["unseen"][k][part],
                )
                vague = derived["vague"][k, number]
                contacts[k, name]["dissipated"] = np.array(
                    [derived["dissipated"][k, number], vague, vague]
                )
            cases = one.load(assembly, u, factors[one.history])
            for body, forces, free in zip(assembly.bodies, parts[k], unseen[k], strict=True):
                name = body.spec.name
                alpha = derived["alpha"][k][joint.slices[name]]
                bodies[k, name], here.bodies[name] = _body(
                    body, cases.get(name), forces, free, alpha
                )
    contacts, bodies = gathered(assembly.world, contacts), gathered(assembly.world, bodies)
    for k, one in enumerate(parameters):
        if derived["residual"][k] > ENOUGH:
            told[one.key] = None
            continue
        motions = derived["alpha"][k]
        pushed = {each.name: each.shift(motions[joint.slices[each.name]]) for each in joint.driven}
        own = {name: entry for (number, name), entry in contacts.items() if number == k}
        told[one.key] = Entry(
            until=one.value + derived["until"][k],
            contacts=Entry({entry.name: _known(own.get(entry.name)) for entry in scene.contact}),
            bodies=Entry({body.name: bodies.get((k, body.name)) for body in scene.body}),
            rigid=_partners(scene, own, pushed, one.moved, factors[one.history]),
        )
    return told, arrays


def _body(
    body: Body, case: LoadCase | None, forces: np.ndarray, unseen: np.ndarray, alpha: np.ndarray
) -> tuple[Entry, Entry]:
    """The derivatives of a body's results, and its displacement (nv, d), from those of its load `case`, of contact
    forces (size,) and motions (j,), and the forces `unseen` (size,). Collective on the body's communicator."""
    # the derivative of a displacement is the displacement under the derivatives of all forces
    mesh, acting = body.mesh, body.member.elasticity.acting
    member = body.member.loaded_by(case or scaled(acting, 0.0))
    du, *_ = member.displacement(forces, alpha, PURPOSE)
    held = resultants(
        mesh, clamp_forces(mesh, body.spec, member.elasticity, du, member.pull(forces))
    )
    # clamps bear what forces that nothing determines do to their nodes
    pull = member.pull(unseen)[member.elasticity.clamped]
    reaction = sum((entry["force"] for entry in held.values()), np.zeros(mesh.dimension))
    told = Entry(
        reaction=known(reaction, pull.sum(axis=0), np.abs(pull).sum(axis=0)),
        points=Entry({point: du[nodes].mean(axis=0) for point, nodes in mesh.vertices.items()}),
    )
    return told, Entry(displacement=du)


def _known(entry: Entry | None) -> Entry | None:
    """The results of a contact that are `known`; None on other ranks than the first."""
    return entry and Entry({what: known(*of) for what, of in entry.items()})


def determined(unseen: np.ndarray) -> bool:
    """Whether a sum of such terms, of forces that no equation determines, vanishes."""
    return bool(abs(unseen.sum()) <= CLEAR * np.abs(unseen).sum())


def known(value: np.ndarray, unseen: np.ndarray, size: np.ndarray) -> np.ndarray:
    """A result, not a number where it depends on forces that no equation determines: where these change it by `unseen`,
    beside terms of this `size`. All of one shape."""
    return np.where(np.abs(unseen) <= CLEAR * np.abs(size), value, np.nan)[()]


def joined(*entries: Mapping[str, Any]) -> Entry:
    """Several nested tables as one."""
    keys = dict.fromkeys(key for entry in entries for key in entry)
    found = {key: [entry[key] for entry in entries if key in entry] for key in keys}
    return Entry(
        {
            key: joined(*values) if isinstance(values[0], Mapping) else values[0]
            for key, values in found.items()
        }
    )


def measures(state: ContactState) -> dict[str, np.ndarray]:
    """By result of a contact the row (size,), of a vector (d or 3, size), whose product with changes of its forces is
    the change of the result: all are linear in the forces, as directions stay."""
    interface, law, m = state.interface, state.interface.law, state.interface.m
    # The force on the first body is −Σ s · directions.
    along = interface.directions
    peak = np.argmax(state.pressure)
    at = interface.places[law.node]
    normal, pressure = np.repeat([1.0, 0.0], [m, law.size - m]), np.zeros(law.size)
    pressure[peak] = replace(state, normal_force=np.ones(m)).pressure[peak]
    tangential = 1.0 - normal
    if state.slip.shape[1] > 1:  # the length of a vector changes with the part along it
        tangential *= along @ direction(state.along(state.tangential_force).sum(axis=0)[None])[0]
    return {
        "force": -along.T,
        "moment": moments(at, -along, interface.axisymmetric).T,
        "normal_force": normal,
        "tangential_force": tangential,
        "pressure_max": pressure,
        "pressure_mean": normal / (interface.area.sum() or np.inf),
    }


def _contact(
    state: ContactState, s: np.ndarray, closed: np.ndarray, unseen: np.ndarray
) -> tuple[Entry, Entry]:
    """The derivatives of a contact's resultants as `known` takes them, and those at its nodes, from those of its forces
    s (size,), relative displacements less gaps `closed` (size,), and the forces `unseen` (size,)."""
    law = state.interface.law
    closing, _ = law.split(closed)
    at_nodes, free = _at_nodes(state, s), _at_nodes(state, unseen)
    largest = {name: np.abs(values).max(initial=0.0) for name, values in free.items()}
    return (
        Entry(
            {
                name: np.array([row @ s, row @ unseen, np.abs(row) @ np.abs(unseen)])
                for name, row in measures(state).items()
            }
        ),
        Entry(
            {name: known(at_nodes[name], free[name], largest[name]) for name in at_nodes},
            gap=-closing,
            slip_total=law.along(closed),
        ),
    )


def _at_nodes(state: ContactState, s: np.ndarray) -> dict[str, np.ndarray]:
    """What changes s (size,) of its forces change at the nodes of a contact."""
    law = state.interface.law
    normal, tangential = s[: law.m], law.along(s)
    change = replace(state, normal_force=normal, tangential_force=tangential)
    return {
        "pressure": change.pressure,
        "shear": change.shear,
        "normal_forces": normal,
        "tangential_forces": tangential,
    }


def _partners(
    scene: Settled,
    contacts: Mapping[str, Entry],
    pushed: Mapping[str, np.ndarray],
    moved: tuple[str, np.ndarray] | None,
    factor: float,
) -> Entry:
    """The derivatives of displacements and forces of the rigid partners that bodies may touch, from those of contacts,
    of motions under given forces, and of the one that is moved (d,) itself, with its factor."""
    partners = Entry()
    for contact in scene.contact:
        name = contact.bodies[1]
        if name in (rigid.name for rigid in scene.rigid) and contact.name in contacts:
            shift = pushed.get(name, 0.0) + (
                factor * moved[1] if moved and moved[0] == name else 0.0
            )
            entry = partners.setdefault(
                name,
                Entry(
                    displacement=np.zeros(scene.dimension) + shift,
                    force=np.zeros((3, scene.dimension)),
                ),
            )
            entry["force"] = entry["force"] - contacts[contact.name].force
    for entry in partners.values():
        entry["force"] = known(*entry["force"])
    return partners
