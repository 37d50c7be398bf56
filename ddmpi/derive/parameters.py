"""What an answer is differentiated by: how the equations change with a number of the scene, or with a factor on a load,
a clamp or a motion, while the contact forces stay."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import msgspec.structs
import numpy as np

from ddmpi.body.elasticity import Elasticity, LoadCase, apply, load_cases
from ddmpi.body.loads import supports, thermal_loads
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.interface.law import CoulombLaw, Law, TrescaLaw
from ddmpi.mesh.boundary import material_numbers
from ddmpi.scene.bodies import PRESCRIBED, Heat, SettledBody, VolumeForce
from ddmpi.scene.contacts import Rigid, SettledContact


@dataclass(frozen=True)
class Parameter:
    """A key by which an answer is differentiated, as one rank has it.

    Attributes
    ----------
    key : as in the scene's ``output.derivatives``
    value : the number; 1 for a factor
    history : whose factor multiplies `case`, `opening`, `driven` and `force`, or None
    body : whose load, clamp or modulus, with that of its copies, it is; empty for others
    case : what is added to the loads of the body, on its rank
    young : the number of the material of the body whose modulus it is; None for others
    law : by contact of this rank, the law whose slip bounds are the changes (N)
    opening, driven : (size,) changes of gaps, and of displacements of rigid partners along the contacts (m)
    moved : the rigid partner that it moves, and by how much (d,) (m); None if it is none
    force : (rigid.size,) changes of the loads along rigid motions by the force on a partner (N)
    """

    key: str
    value: float
    history: str | None
    opening: np.ndarray
    driven: np.ndarray
    force: np.ndarray
    body: str = ""
    case: LoadCase | None = None
    young: int | None = None
    law: Mapping[str, Law] = field(default_factory=dict)
    moved: tuple[str, np.ndarray] | None = None

    def bounds(self, assembly: Assembly, s: np.ndarray) -> list[np.ndarray]:
        """The changes (mt,) of the slip bounds of each interface under the forces s (size,) (N). Not collective."""
        return [
            self.law[interface.name].bound_at(s[part])
            if interface.name in self.law
            else np.zeros(len(interface.sliding))
            for interface, part in assembly.space.with_slices()
        ]

    def load(
        self, assembly: Assembly, u: Mapping[str, np.ndarray], factor: float
    ) -> dict[str, LoadCase]:
        """The changes of the load cases of this rank's bodies, at displacements u (nv, d) by body (m), and at this
        factor of its history. Not collective."""
        return {
            body.spec.name: self._case(body, u[body.spec.name])
            if self.young is not None
            else scaled(self.case, factor)
            for body in assembly.bodies
            if (self.case and body.spec.name == self.body)
            or (self.young is not None and body.spec.original == self.body)
        }

    def _case(self, body: Body, u: np.ndarray) -> LoadCase:
        """The load that a change of a modulus E is equivalent to: with K = E K_1 + …, that of −(K_1 u − heat_1)."""
        mesh, entry = body.mesh, body.spec.materials[self.young or 0]
        if len(body.spec.materials) > 1:
            mesh = replace(
                mesh, triangles=mesh.triangles[material_numbers(mesh, body.spec) == self.young]
            )
        elasticity = body.member.elasticity
        acting = elasticity.acting
        f = -sum_stiffness(mesh, entry).mult(u)
        if acting.heated is not None:
            f += thermal_loads(mesh, entry, acting.warm)[0]
        return loaded(elasticity, f / self.value)


def loaded(elasticity: Elasticity, f: np.ndarray) -> LoadCase:
    """The load case of nodal loads f (nv, d) alone (N)."""
    zero, nodes = np.zeros_like(f), elasticity.nodes
    freely = apply(elasticity.supports.free[nodes], f[nodes]).ravel()
    return LoadCase(f, 0.0 * elasticity.acting.warm, zero, 0.0, zero, zero, freely)


def scaled(case: LoadCase | None, factor: float) -> LoadCase:
    """A load case times a factor."""
    assert case is not None
    return LoadCase(*(factor * getattr(case, entry.name) for entry in fields(case)))


def parameter(assembly: Assembly, key: str) -> Parameter:
    """The parameter of a valid key. Not collective. Raises InputError."""
    kind, name, *rest = key.split(".")
    spec = next(each for each in getattr(assembly.scene, kind) if each.name == name)
    zero = np.zeros(assembly.space.size)
    blank = Parameter(key, 1.0, None, zero, zero, np.zeros(assembly.joint.rigid.size))
    made: dict[str, Callable[..., Parameter]] = {
        "body": _of_body,
        "rigid": _of_rigid,
        "contact": _of_contact,
    }
    return made[kind](assembly, blank, spec, rest)


def _of_body(
    assembly: Assembly, blank: Parameter, spec: SettledBody, key: Sequence[str]
) -> Parameter:
    """A modulus, or a load or a clamp."""
    if key[0] == "material":
        number = int(key[1]) if len(key) > 2 else 0
        young = spec.materials[number].young
        assert not isinstance(young, tuple)
        return replace(blank, body=spec.name, young=number, value=young)
    alone, value, history = _alone(spec, key, assembly.scene.dimension)
    case = None
    for body in assembly.bodies:
        if body.spec.name == spec.name:
            held = supports(body.mesh, alone)
            case = load_cases(body.mesh, alone, held, body.member.elasticity).cases[history]
    return replace(blank, body=spec.name, value=value, history=history, case=case)


def _of_rigid(assembly: Assembly, blank: Parameter, rigid: Rigid, key: Sequence[str]) -> Parameter:
    """The displacement of a rigid partner, or the force or the moment on it."""
    vector, value = _unit(getattr(rigid, key[0]), key[1:])
    along, moving = np.array(vector), replace(blank, value=value, history=rigid.history)
    if key[0] == "displacement":
        driven = blank.driven.copy()
        for interface, part in assembly.space.with_slices():
            if interface.bodies[1] == rigid.name:
                driven[part] = -(interface.directions @ along)
        return replace(moving, driven=driven, moved=(rigid.name, along))
    push = (along,) if key[0] == "force" else (np.zeros(assembly.scene.dimension), along)
    force = blank.force.copy()
    for each in assembly.joint.driven:
        if each.name == rigid.name:
            force[assembly.joint.slices[each.name]] = each.along(*push)
    return replace(moving, force=force)


def _of_contact(
    assembly: Assembly, blank: Parameter, contact: SettledContact, key: Sequence[str]
) -> Parameter:
    """A pretension, a coefficient or bound of friction, or a gap."""
    pretension = contact.pretension
    if pretension and pretension.force is not None and key[0] == "pretension":
        force = blank.force.copy()
        for each in assembly.joint.driven:
            if each.bond == contact.name:
                force[assembly.joint.slices[each.name]] = each.push / pretension.force
        return replace(blank, value=pretension.force, history=pretension.history, force=force)
    own = [both for both in assembly.space.with_slices() if both[0].name == contact.name]
    if key[0] == "friction":
        given = getattr(contact.friction, key[1])
        number, law = isinstance(given, float | int), dict[str, Law]()
        for interface, _ in own:
            same = interface.law  # of a profile, a factor changes all of it
            law[interface.name] = _bound_of(same, interface.area) if number else same
        return replace(blank, value=float(given) if number else 1.0, law=law)
    gap, history = contact.opening
    value, opening = float(gap) if isinstance(gap, float | int) else 1.0, blank.opening.copy()
    for interface, part in own:
        # every row has the number, but for those of bonds that are held open or together
        opening[part][: interface.m] = interface.gap / value if value else 1.0
    return replace(blank, value=value, history=history, opening=opening)


def _alone(
    spec: SettledBody, key: Sequence[str], dimension: int
) -> tuple[SettledBody, float, str | None]:
    """A body on which nothing acts but the load or clamp at `key`, with 1 for a number there and 0 for those beside it;
    the number, or 1 for a factor; and its history."""
    change = msgspec.structs.replace
    clamps = [
        change(clamp, **{name: 0.0 for name in PRESCRIBED if getattr(clamp, name) is not None})
        for clamp in spec.clamps
    ]
    bare = change(
        spec, traction=[], clamp=clamps, volume_force=(0.0,) * dimension, temperature=None
    )
    if key[0] == "volume_force":
        weight, history = spec.weight
        given, value = _unit(weight, key[1:])
        return change(bare, volume_force=VolumeForce(value=given, history=history)), value, history
    if key[0] == "temperature":
        history = spec.heat.history
        given, value = _unit(spec.heat.value, ())
        return change(bare, temperature=Heat(value=given, history=history)), value, history
    number, value = int(key[1]), 1.0
    entry: Any = (spec.traction if key[0] == "traction" else spec.clamps)[number]
    if len(key) > 2:
        given, value = _unit(getattr(entry, key[2]), key[3:])
        entry = change(entry if key[0] == "traction" else clamps[number], **{key[2]: given})
    if key[0] == "traction":
        return change(bare, traction=[entry]), value, entry.history
    clamps[number] = entry
    return change(bare, clamp=clamps), value, entry.history


def _unit(given: Any, at: Sequence[str]) -> tuple[Any, float]:
    """By what a derivative is taken, and its value: 1 for a number; a unit vector for the entry `at` of a vector; else
    all of what is given, of which it is a factor."""
    if isinstance(given, float | int):
        return 1.0, float(given)
    if not at:
        return given, 1.0
    return tuple(float(k == int(at[0])) for k in range(len(given))), float(given[int(at[0])])


def _bound_of(law: Law, area: np.ndarray) -> Law:
    """The law whose slip bounds are the changes of those of `law` with its coefficient, or its bound as a stress."""
    if isinstance(law, CoulombLaw):
        return replace(law, coefficient=np.ones(len(law.sliding)))
    assert isinstance(law, TrescaLaw)
    return replace(law, bound=area[law.sliding])
