"""Bodies that move far: each is factored once in its frame, on all nodes that contacts may join."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from mpi4py import MPI

from ddmpi.body.elasticity import Elasticity, LoadCase, apply
from ddmpi.body.loads import nodal_loads
from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.coupling.factored import Factored, Placed
from ddmpi.coupling.sides import Sides
from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.mortar import meet, with_slave
from ddmpi.interface.trace import components
from ddmpi.kept.kept import Kept
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import SettledBody
from ddmpi.scene.contacts import SettledContact
from ddmpi.scene.motions import Freed, freed_part, parts_of
from ddmpi.scene.scene import Settled
from ddmpi.surface.side import Side
from ddmpi.system.agreement import agreed, merged
from ddmpi.system.numbers import Frame, concatenated

BothSides = tuple[Side, Side | None]
"""Of a contact; None for a rigid partner."""

STEPS, MOST = 100, 4000
"""Bodies that move far have compliances for this many load steps, of at most this many nodes (in space 1.1 GiB)."""


@dataclass(frozen=True)
class Placement:
    """Where the bodies and rigid partners are that move far; as drawn, where none does.

    Attributes
    ----------
    time : when they are there
    freed : how far free frames have gone
    frames : of all bodies and rigid partners, by name
    reach : by contact, see `mortar.meet`; left out, overlaps are looked for by the bodies' thickness
    """

    time: float = 0.0
    freed: Freed = field(default_factory=dict)
    frames: Mapping[str, Frame] = field(default_factory=dict)
    reach: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class Framed(Factored):
    """A body that moves far, with the compliance of all nodes that contacts may join, in its frame.

    Parameters
    ----------
    mesh, body : its mesh and specification
    faces : its sides on contacts
    Otherwise as of a `Factored`. Raises InputError where clamps leave a part of the rigid motions free, or the
    compliance is not worth while.

    Attributes
    ----------
    free : of a body whose frame is free
    """

    def __init__(
        self,
        elasticity: Elasticity,
        scene: Settled,
        mesh: Mesh,
        body: SettledBody,
        faces: Sequence[Side],
        memory: float,
    ) -> None:
        nodes = np.unique(concatenated((side.nodes for side in faces), int))
        super().__init__(
            body.name,
            elasticity,
            components(elasticity, nodes),
            scene.method.compliance,
            memory,
            [None, *scene.followed],
            mesh.home.points[elasticity.nodes],
            STEPS,
        )
        self._refuse(mesh, body, len(nodes))
        if self.kind == "direct" and self.B.count_nonzero():
            self.kind = self._asked = "explicit"  # by solves columns would take 100 times as long
        loose, freed = not elasticity.supported, freed_part(body.motion)
        self._drawn, self._whole = mesh.points, np.empty((0, 0))
        self._dead: dict[str | None, np.ndarray] = {}
        if loose or freed:
            # the frame of a loose body is the rigid motion of its contact nodes, by least squares
            at = nodes if loose and len(nodes) else slice(None)
            self.free = FreeFrame.of(freed, mesh.points[at], mesh.axisymmetric)
        turns = any(motion.turn for motion in parts_of(body.motion)) or bool(
            self.free and len(self.free.turns)
        )
        none = np.zeros((mesh.dimension,) * 2)
        self._following = {
            history: nodal_loads(mesh, body, history, none) if turns else case.f
            for history, case in elasticity.cases.items()
        }

    def _refuse(self, mesh: Mesh, body: SettledBody, nodes: int) -> None:
        """InputError where it cannot move far, on so many nodes of its contacts."""
        d = mesh.dimension
        most = 1 if mesh.axisymmetric else d * (d + 1) // 2
        if self.motions.shape[2] > 0 and (body.motion or self.motions.shape[2] < most):
            raise InputError(
                f'body.{body.name}: clamps leave a rigid motion free; with time.motions = "far" they '
                "must fix a body in its frame; free the motion of the frame, as in motion = { free = "
                '["y"] }, or leave clamps and motion out for a body that moves freely'
            )
        if self.B.shape[0] and (self.kind == "iterative" or nodes > MOST):
            why = self.reason if self.kind == "iterative" else f"at most {MOST} are possible"
            raise InputError(
                f'body.{body.name}: with time.motions = "far" it needs a dense compliance of all '
                f"{nodes} nodes of its contacts, and {why}: name smaller groups, or take a coarser "
                "mesh"
            )

    def factor(self, kept: Kept) -> None:
        """As of a `Factored`; and the response to dead loads in all directions, for a frame that turns."""
        super().factor(kept)
        self._whole = self.dense()
        elasticity = self.elasticity
        for history, case in elasticity.cases.items():
            dead = case.f - self._following[history]
            axes = np.eye(dead.shape[1])
            if dead.any():
                self._dead[history] = np.array(
                    [
                        [self.response_to(self._free_part(np.outer(f, axis))) for axis in axes]
                        for f in dead.T
                    ]
                )

    def _free_part(self, f: np.ndarray) -> np.ndarray:
        """Nodal loads (nv, d) on the dofs of A (n,) (N)."""
        nodes = self.elasticity.nodes
        return apply(self.elasticity.supports.free, f)[nodes].ravel()

    def placed(self, sides: Sides, frame: Frame | None) -> Placed:
        """The body at the rows of its sides, seen from its frame, under loads as these are there. Not collective."""
        assert frame
        turned, free = frame.turned, self.free
        motions = free.motions(self._drawn, turned) if free else self.motions
        W = sides.rows(self.elasticity)[
            :, self.B.indices
        ]  # rows of B are unit vectors: W = B_met Bᵀ
        G = [np.empty((0, sides.size))]
        G += [sides.trace(motion)[None] for motion in np.moveaxis(motions, 2, 0)]
        cases, responses, resisting = {}, {}, {}
        for history, case in self.elasticity.cases.items():
            cases[history], h, dead = self._seen(history, case, turned)
            following = self._following[history]
            e = np.einsum("nij,ni->j", motions, following + dead)
            if free:
                resisting[history] = free.resists(self._drawn, turned, dead, following)
            if free and free.part and free.history == history:
                e = e + free.push
                resisting[history] += free.levers
            responses[history] = W @ h, e
        C = self.C.seen(W, self._whole) if hasattr(self, "C") else None
        elasticity = replace(self.elasticity, cases=cases)
        return Placed(elasticity, motions, np.vstack(G), C, responses, resisting)

    def _seen(
        self, history: str | None, case: LoadCase, turned: np.ndarray
    ) -> tuple[LoadCase, np.ndarray, np.ndarray]:
        """A load case in a frame that is `turned`, its h, and its dead loads (nv, d), which turn back there."""
        follow, h = self._following[history], self.responses[history][0]
        dead = (case.f - follow) @ turned
        change = follow + dead - case.f
        if history in self._dead:
            turn = turned - np.eye(len(turned))
            h = h + np.einsum("ij,ijk->k", turn, self._dead[history])
        return replace(case, f=case.f + change, b=case.b + self._free_part(change)), h, dead


def free_frames(
    world: MPI.Comm, scene: Settled, bodies: Sequence[Factored], sides: Mapping[str, BothSides]
) -> dict[str, FreeFrame]:
    """The free components of the frames of all bodies and rigid partners, by name. Collective."""
    free = merged(world, {body.name: body.free for body in bodies if body.free})
    partners = {contact.name: contact.bodies[1] for contact in scene.contact}
    facing = world.allgather(
        {partners[name]: first.xy for name, (first, second) in sides.items() if not second}
    )
    for rigid in scene.rigid:
        if freed := freed_part(rigid.motion):
            at = [xy[rigid.name] for xy in facing if rigid.name in xy]
            free[rigid.name] = FreeFrame.of(freed, np.concatenate(at))
    return free


def with_slaves(
    contacts: Sequence[SettledContact], sides: Mapping[str, BothSides]
) -> list[SettledContact]:
    """Contacts each with one slave, wherever its bodies go. Not collective."""
    chosen = []
    for contact in contacts:
        first, second = sides[contact.name]
        chosen.append(with_slave(first, second, contact) if second else contact)
    return chosen


def meet_far(
    world: MPI.Comm,
    scene: Settled,
    contacts: Sequence[SettledContact],
    sides: Mapping[str, BothSides],
    placement: Placement,
) -> dict[str, Interface]:
    """The interfaces of contacts, which name their slaves, at a placement. Collective. Raises InputError."""
    rigid, met = {partner.name: partner for partner in scene.rigid}, {}
    with agreed(world):
        for contact in contacts:
            reach = placement.reach.get(contact.name, (None, np.inf))
            met[contact.name] = meet(contact, sides[contact.name], placement.frames, rigid, reach)
    return met
