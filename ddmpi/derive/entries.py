"""The derivatives of results: of contacts, bodies and rigid partners, as summary.json and an answer have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ddmpi.body.elasticity import clamp_forces
from ddmpi.body.loads import resultants
from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.parameters import Parameter, scaled
from ddmpi.interface.law import direction
from ddmpi.interface.state import ContactState
from ddmpi.methods.linear import PURPOSE
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed, gathered
from ddmpi.system.numbers import moment

ENOUGH = 1e-6
"""Largest relative residual of derivatives that are told."""


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
    arrays over this rank's contacts and bodies.

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
    with agreed(assembly.world):
        for k, one in enumerate(parameters):
            here = arrays[one.key]
            for (name, state), part, work in zip(
                states.items(),
                assembly.space.parts.values(),
                derived["dissipated"][k].tolist(),
                strict=True,
            ):
                contacts[k, name], here.contacts[name] = _contact(
                    state, derived["s"][k][part], derived["closed"][k][part], work
                )
            cases = one.load(assembly, u, factors[one.history])
            for body, forces in zip(assembly.bodies, parts[k], strict=True):
                # the derivative of a displacement is the displacement under the derivatives of all forces
                name, mesh = body.spec.name, body.mesh
                case = cases.get(name) or scaled(body.member.elasticity.acting, 0.0)
                member, alpha = body.member.loaded_by(case), derived["alpha"][k]
                du, *_ = member.displacement(forces, alpha[joint.slices[name]], PURPOSE)
                held = clamp_forces(mesh, body.spec, member.elasticity, du, member.pull(forces))
                reactions = [entry["force"] for entry in resultants(mesh, held).values()]
                points = {point: du[at].mean(axis=0) for point, at in mesh.vertices.items()}
                reaction = sum(reactions, np.zeros(mesh.dimension))
                bodies[k, name] = Entry(reaction=reaction, points=Entry(points))
                here.bodies[name] = Entry(displacement=du)
    contacts, bodies = gathered(assembly.world, contacts), gathered(assembly.world, bodies)
    for k, one in enumerate(parameters):
        told[one.key] = None
        if derived["residual"][k] > ENOUGH:
            continue
        alpha = derived["alpha"][k]
        own = {name: entry for (number, name), entry in contacts.items() if number == k}
        shifts = {each.name: each.shift(alpha[joint.slices[each.name]]) for each in joint.driven}
        told[one.key] = Entry(
            until=one.value + derived["until"][k],
            contacts=Entry({contact.name: own.get(contact.name) for contact in scene.contact}),
            bodies=Entry({body.name: bodies.get((k, body.name)) for body in scene.body}),
            rigid=_partners(scene, own, shifts, one.moved, factors[one.history]),
        )
    return told, arrays


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
    along, peak = (
        interface.directions,
        np.argmax(state.pressure),
    )  # the force on the first body is −Σ s · directions
    at = (interface.xy if interface.at is None else interface.at[0])[law.node]
    normal, pressure = np.repeat([1.0, 0.0], [m, law.size - m]), np.zeros(law.size)
    pressure[peak] = replace(state, normal_force=np.ones(m)).pressure[peak]
    tangential = 1.0 - normal
    if state.slip.shape[1] > 1:  # the length of a vector changes with the part along it
        tangential *= along @ direction(state.along(state.tangential_force).sum(axis=0)[None])[0]
    return {
        "force": -along.T,
        "moment": np.array(
            [
                moment(place[None], -way[None], interface.axisymmetric)
                for place, way in zip(at, along, strict=True)
            ]
        ).T,
        "normal_force": normal,
        "tangential_force": tangential,
        "pressure_max": pressure,
    }


def _contact(
    state: ContactState, s: np.ndarray, closed: np.ndarray, work: float
) -> tuple[Entry, Entry]:
    """The derivatives of a contact's resultants, and those at its nodes, from those of its forces s (size,), relative
    displacements less gaps `closed` (size,), and dissipation."""
    law = state.interface.law
    (normal, along), (closing, slid) = law.split(s), law.split(closed)
    tangential, slip = np.zeros((2, *state.slip.shape))
    tangential[law.sliding], slip[law.sliding] = along, slid
    change = replace(state, normal_force=normal, tangential_force=tangential)
    return Entry({name: row @ s for name, row in measures(state).items()}, dissipated=work), Entry(
        pressure=change.pressure,
        shear=change.shear,
        normal_forces=normal,
        tangential_forces=tangential,
        gap=-closing,
        slip_total=slip,
    )


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
                    displacement=np.zeros(scene.dimension) + shift, force=np.zeros(scene.dimension)
                ),
            )
            entry["force"] = entry["force"] - contacts[contact.name].force
    return partners
