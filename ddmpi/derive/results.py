"""The derivatives of results by contact forces, motions and displacements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import Composite, stress, von_mises
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.derive.entries import measures
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState
from ddmpi.mesh.mesh import Mesh, bare
from ddmpi.scene.results import Named
from ddmpi.sets import magnitude
from ddmpi.system.numbers import divisor

STEP = 1e-6
"""Of central differences of the von Mises stress, relative to it."""


@dataclass
class Functional:
    """The derivative of a result: dJ = forces · ds + moves · d(closed) + motions · dα + Σ bounds · dg + Σ loads · du and
    what else acts.

    Attributes
    ----------
    forces, moves : (size,) by contact forces, and by relative displacements less gaps
    motions : (rigid.size,) by motions of loose bodies
    bounds : by contact of this rank, (mt,) by the sum of slip bounds now and at first, at given forces
    loads : by body of this rank, (nv, d) by the displacements of its nodes
    body, partner : the body whose reaction it is, or the rigid partner whose displacement; then also the axis
    """

    forces: np.ndarray
    moves: np.ndarray
    motions: np.ndarray
    bounds: dict[str, np.ndarray] = field(default_factory=dict)
    loads: dict[str, np.ndarray] = field(default_factory=dict)
    body: str = ""
    partner: str = ""
    axis: int = 0


def functional(
    assembly: Assembly,
    states: Mapping[str, ContactState],
    displacements: Mapping[str, np.ndarray],
    result: Named,
) -> Functional:
    """The derivative of a result, on this rank's contacts and bodies. Collective where it is a reaction."""
    space, joint = assembly.space, assembly.joint
    kind, name, what, axis, _ = result
    forces, moves, motions = np.zeros(space.size), np.zeros(space.size), np.zeros(joint.rigid.size)
    found = Functional(forces, moves, motions, axis=axis)
    if kind == "contacts":
        for interface, part in space.with_slices():
            if interface.name == name and what == "dissipated":
                _dissipate(found, interface, part, states[name])
            elif interface.name == name:
                forces[part] = np.atleast_2d(measures(states[name])[what])[axis]
    elif kind == "bodies" and what == "reaction":
        # equilibrium: the reaction is what loads and contact forces on a body leave
        found.body, unit = name, np.eye(assembly.scene.dimension)[axis]
        of_bodies = [
            member.trace(np.tile(unit, (len(member.motions), 1))) * (member.name == name)
            for member in joint.members
        ]
        found.forces = joint.exchange.total(of_bodies, "reaction")
    elif kind == "bodies":
        for body in assembly.bodies:
            if body.spec.name == name:
                found.loads[name] = _of_body(body, displacements[name], result)
    else:
        _of_partner(assembly, found, result)
    return found


def _of_partner(assembly: Assembly, found: Functional, result: Named) -> None:
    """Put the derivative of the displacement of a rigid partner, or of the force on it."""
    space, joint, (_, name, what, axis, _) = assembly.space, assembly.joint, result
    if what == "displacement":
        found.partner = name
        for each in joint.driven:
            if each.name == name:  # `shift` is linear in the motions
                shifts = [each.shift(one)[axis] for one in np.eye(len(each.push))]
                found.motions[joint.slices[name]] = shifts
        return
    for interface, part in space.with_slices():
        if interface.bodies[1] == name:
            found.forces[part] = interface.directions[:, axis]


def _of_body(body: Body, u: np.ndarray, result: Named) -> np.ndarray:
    """The derivative (nv, d) of a result of a body by its displacement u (nv, d), but for its energy."""
    mesh, load = body.mesh, np.zeros_like(u)
    if result.point:
        nodes = mesh.vertices[result.point]
        np.add.at(load[:, result.axis], nodes, 1.0 / len(nodes))
    elif result.what == "displacement_max":
        size = magnitude(u)
        node = int(size.argmax())
        load[node] = u[node] / size[node] if size[node] else 0.0
    elif result.what == "von_mises_max":
        sigma = von_mises(stress(mesh, body.material, u, body.member.elasticity.acting.heated))
        load = by_von_mises(body, u, int(sigma.argmax()))
    else:
        load = _by_energy(body, u)
    return load


def by_von_mises(body: Body, u: np.ndarray, number: int) -> np.ndarray:
    """The derivative (nv, d) of the von Mises stress of the mean stress of one cell by the displacement u (nv, d)."""
    mesh, nodes = body.mesh, body.mesh.triangles[number]
    d, material, warm = mesh.dimension, body.material, body.member.elasticity.acting.heated
    uniform = (
        material.materials[material.number[number]] if isinstance(material, Composite) else material
    )
    heat = None if warm is None else warm[nodes]
    alone = _copies(mesh, nodes, 1)
    mean = stress(alone, uniform, u[nodes], heat)[0]
    size = float(von_mises(mean[None])[0])
    load = np.zeros_like(u)
    if not size:
        return load
    steps = STEP * size * np.eye(len(mean))
    slope = (von_mises(mean + steps) - von_mises(mean - steps)) / (2.0 * STEP * size)
    # the stress of each unit displacement of the cell's nodes, in a copy of it of its own
    units = np.eye(d * len(nodes)).reshape(-1, d)
    many = _copies(mesh, nodes, d * len(nodes))
    load[nodes] = (stress(many, uniform, units) @ slope).reshape(-1, d)
    return load


def _copies(mesh: Mesh, nodes: np.ndarray, number: int) -> Mesh:
    """A mesh of copies of one cell that have no node in common."""
    k = len(nodes)
    cells = np.arange(number * k).reshape(number, k)
    return replace(bare(mesh), points=np.tile(mesh.points[nodes], (number, 1)), triangles=cells)


def _by_energy(body: Body, u: np.ndarray) -> np.ndarray:
    """The derivative (nv, d) of the strain energy by the displacement: the forces that hold it, ∫ σ_h : ∇φ (N)."""
    forces = sum_stiffness(body.mesh, body.material).mult(u)
    return forces - body.member.elasticity.acting.heat


def _dissipate(found: Functional, interface: Interface, part: slice, state: ContactState) -> None:
    """Put the derivative of the work of friction on a contact, ½ (g + g_0) |slip| of the nodes that rub."""
    law, m = interface.law, interface.m
    resistance = np.broadcast_to(state.resistance, (m,))[law.sliding]
    slip, s = state.slip[law.sliding], np.append(state.normal_force, np.zeros(law.size - m))
    size = magnitude(slip)
    bounds = 0.5 * size * (resistance > 0.0)
    slopes = law.slope(s[:m]) * (s[:m] > 0.0)[law.sliding]
    along = (resistance / divisor(size))[:, None] * slip
    found.bounds[interface.name] = bounds
    law.split(found.moves[part])[1][:] = along
    np.add.at(found.forces[part], law.sliding, bounds * slopes)
