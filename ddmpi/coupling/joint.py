"""The joint compliance of all bodies, an operator on the vectors of the interfaces, with their rigid motions."""

from __future__ import annotations

import contextlib
import copy
import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI

from ddmpi.body.elasticity import Elasticity, LoadCase, apply
from ddmpi.body.loads import nodal_loads
from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.coupling.coarse import CrossPoints, Driven, Motions, gather_motions
from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Point, Space
from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.mortar import meet
from ddmpi.interface.trace import seen
from ddmpi.kept.kept import Kept
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import SettledBody
from ddmpi.scene.contacts import Rigid, SettledContact
from ddmpi.scene.motions import Freed, frames_of, freed_part, parts_of
from ddmpi.scene.scene import Settled
from ddmpi.surface.side import Side
from ddmpi.system.agreement import agreed
from ddmpi.system.numbers import ROUNDING, Frame, norm

STEERING = 0.1
"""With an iterative solver, a product in GMRES needs no more relative precision than this times the ratio by which
GMRES has still to reduce its residual (Bouras and Frayssé, SIAM J. Matrix Anal. Appl. 26, 2005)."""

STEPS, MOST = 100, 4000
"""Bodies that move far have compliances for this many load steps, of at most this many nodes (in space 1.1 GiB)."""


class Stays:
    """The rigid motions that stay as they are: kept offsets of bolts, and motions that nothing determines.

    Nothing is asked of the balance of forces along them. A joint and the models of it share one.

    Attributes
    ----------
    bolts : (j,) bool, the motions that are kept offsets
    held : (j, q) orthonormal columns, zero at kept offsets: the motions that nothing determines
    at : (j,) the amplitudes of both (m), zero for other motions
    share : of a load that normals and gaps of meshes may bear along held motions
    """

    share = 0.0

    def __init__(self, size: int) -> None:
        self.bolts, self.held, self.at = np.zeros(size, bool), np.zeros((size, 0)), np.zeros(size)

    def keep(self, bolts: np.ndarray, alpha: np.ndarray) -> None:
        """Keep the offsets `bolts` (j,) bool that they have in the motions α (j,); hold no others."""
        self.bolts, self.held = bolts, np.zeros((len(bolts), 0))
        self.at = np.where(bolts, alpha, 0.0)

    def hold(self, held: np.ndarray, alpha: np.ndarray) -> None:
        """Hold the motions `held` (j, q) at the amplitudes that they have in α (j,), beside kept offsets."""
        self.held = held
        self.at = np.where(self.bolts, self.at, held @ (held.T @ alpha))

    def moving(self, x: np.ndarray) -> np.ndarray:
        """The part of x (j,) along motions that do not stay."""
        x = np.where(self.bolts, 0.0, x)
        return x - self.held @ (self.held.T @ x) if self.held.size else x

    def drives(self, loads: np.ndarray) -> bool:
        """Whether loads (j,) drive held motions by more than meshes may bear."""
        return bool(self.held.size) and norm(self.held.T @ loads) > self.share * norm(loads)

    def settled(self, alpha: np.ndarray) -> np.ndarray:
        """α (j,) with held motions at their amplitudes."""
        return alpha - self.held @ (self.held.T @ (alpha - self.at)) if self.held.size else alpha

    def leave(self, Z: np.ndarray) -> np.ndarray:
        """Z (·, j) of the motions, without those that stay."""
        Z = Z * (1.0 - self.bolts)
        return Z - (Z @ self.held) @ self.held.T if self.held.size else Z


class Joint:
    """C = Σ C_a over the bodies a, the free gaps d = Σ h_a − gap, and the rigid motions α of loose bodies.

    The gaps under forces s are r = C s − d − Gᵀα, and G s + K α = e is the equilibrium of the loose bodies, with the
    stiffness K of loads that change as bodies move far. Users of this class work on vectors of the `space` and need not
    know of ranks. All methods that multiply or sum are collective on all bodies, and raise the errors of any of them.

    Parameters
    ----------
    members : the bodies of this rank
    exchange, space : between the bodies, and the layout of the vectors
    histories : of loads, clamps and rigid partners, None for constant ones
    pushed, bolts : rigid partners that forces move, and contacts with a pretension: loose bodies without compliance
    freed : rigid partners with free frames; None where bodies do not move far

    Attributes
    ----------
    size : length of the vectors on this rank
    bodies : number of bodies of all ranks
    d : (size,) overlap without contact forces (m); its tangential part, from where slip begins, is set by the load step
        after `act`
    rigid : the rigid motions of loose bodies, Gᵀ = rigid.Z; of size 0 where clamps support all bodies
    driven : `pushed`, `bolts` and `freed`
    stays : the motions that stay as they are
    slices : of the motions by body, empty for supported ones, and by driven partner
    e, K : the loads along the motions (rigid.size,) in newtons, and by how much they resist these (N/m), sparse
    neglected : forces (N) that are negligible in products whose result is kept
    steering : relative precision of products in GMRES, over the factor by which GMRES must still reduce its residual
    dear : whether a body's products are by an iterative solver
    far : whether bodies move far, and the operator is one of many passes
    """

    def __init__(
        self,
        members: Sequence[Member],
        exchange: Exchange,
        space: Space,
        histories: Sequence[str | None] = (None,),
        pushed: Sequence[Rigid] = (),
        bolts: Sequence[SettledContact] = (),
        freed: Sequence[Driven] | None = None,
    ) -> None:
        self.members, self.space, self.size = tuple(members), space, space.size
        self.neglected, self.steering = 0.0, STEERING
        self.exchange, self.far = exchange, freed is not None
        ours = np.array(
            [
                any(member.dear for member in members),
                any(interface.geometry.waves for interface in space.interfaces),
            ]
        )
        exchange.world.Allreduce(MPI.IN_PLACE, ours, MPI.LOR)
        self.dear, self._waves = ours
        self._moved = {
            name: exchange.total(
                [member.response(name)[0] for member in members], "free displacement"
            )
            for name in histories
        }
        self.driven = (
            *(Driven.of(rigid, space) for rigid in pushed),
            *map(Driven.of_bond, bolts),
            *(freed or ()),
        )
        self.rigid, self.slices = gather_motions(
            exchange, space, members, [member.G for member in members], self.driven
        )
        self.bodies = len(self.slices) - len(self.driven)
        self.stays = Stays(self.rigid.size)
        # a driven partner is a body without compliance; its rows of G s = e balance contact forces, force and moment
        self._none, self._resisting = (
            sparse.csr_matrix((self.rigid.size,) * 2),
            dict[str | None, sparse.spmatrix](),
        )
        if freed is not None:
            blocks = {partner.name: {partner.history: partner.resists} for partner in freed}
            for resisting in exchange.world.allgather(
                {
                    member.name: member.resisting
                    for member in members
                    if isinstance(member, FarMember)
                }
            ):
                blocks |= resisting
            self._resisting = {
                history: sparse.block_diag(
                    [
                        blocks.get(name, {}).get(history, np.zeros((at.stop - at.start,) * 2))
                        for name, at in self.slices.items()
                    ],
                    "csr",
                )
                for history in histories
                if any(history in by_history for by_history in blocks.values())
            }
        self._pulled = {
            name: self.of_all(
                [member.response(name)[1] for member in members],
                [(partner.history == name) * partner.push for partner in self.driven],
            )
            for name in histories
        }
        self.act(dict.fromkeys(histories, 1.0))

    def keep(self, bonds: Collection[str], alpha: np.ndarray) -> None:
        """From the next `act` on, keep the offsets that the pretensions of these `bonds`, and of no others, have in the
        motions α (rigid.size,); their forces then follow."""
        bolts = np.zeros(self.rigid.size, bool)
        for partner in self.driven:
            bolts[self.slices[partner.name]] = partner.bond in bonds
        self.stays.keep(bolts, alpha)

    @property
    def still(self) -> np.ndarray:
        """(rigid.size,) the amplitudes of motions that stay as they are (m), zero for others."""
        return self.stays.at

    def at_rest(self) -> Point:
        """No forces, and no motions but those that stay. Collective."""
        s = np.zeros(self.size)
        return Point(
            s,
            -self.d - self.rigid.spread(self.still),
            self.still.copy(),
            self.imbalance(s, self.still),
        )

    def act(self, factors: Mapping[str | None, float]) -> None:
        """Set d and e for these `factors` of loads and clamps by history; `act` of `space` and members goes first."""
        self.d, self.e = (
            sum((factors[name] * value for name, value in by_history.items()), np.zeros(1))
            for by_history in (self._moved, self._pulled)
        )
        # d = Σ B_a A_a⁺ b_a − gap is positive where bodies without contact forces would overlap
        self.d = self.d - self.space.gap
        self.e = np.where(self.stays.bolts, 0.0, self.e)
        self.K = sum((factors[name] * value for name, value in self._resisting.items()), self._none)

    def product(self, x: np.ndarray, purpose: str, relative: float | None = None) -> np.ndarray:
        """C x (size,) as a new vector, precise enough to be kept, or `relative` as for `Compliance.mult`."""
        y = np.empty(self.size)
        if relative is None:
            size = self.space.norm(x)
            # a relative error of neglected/‖x‖ leaves forces of size `neglected` unbalanced in the bodies
            relative = min(self.neglected / size, STEERING) if size else 0.0
        self.mult(x, y, purpose, relative)
        return y

    def solved(self, x: np.ndarray, purpose: str) -> np.ndarray:
        """C x (size,) as `product`, by solves with the bodies even where their compliances are dense matrices."""
        with contextlib.ExitStack() as stack:
            for member in self.members:
                stack.enter_context(member.C.by_solves())
            return self.product(x, purpose)

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons), both (size,); `relative` as for `Compliance.mult`."""
        vectors = self.exchange.spread(x)
        # the exchange, which all ranks reach, raises an error of one rank on all of them
        with self.exchange.deferred():
            for member, vector in zip(self.members, vectors, strict=True):
                member.mult(vector.copy(), vector, purpose, relative)
        y[:] = self.exchange.total(vectors, purpose)

    def dense(self, most: int) -> np.ndarray | None:
        """C (size, size) as a matrix (m/N), if one rank has all compliances explicitly, and of at most `most` rows."""
        if (
            self.exchange.world.size > 1
            or self.size > most
            or not all(member.known for member in self.members)
        ):
            return None
        C = np.zeros((self.size, self.size))
        for member, places in zip(
            self.members, self.exchange.spread(np.arange(self.size)), strict=True
        ):
            at = places.astype(int)
            C[np.ix_(at, at)] += member.dense()
        return C

    def add_motions(
        self, columns: Sequence[np.ndarray], values: Sequence[np.ndarray]
    ) -> tuple[Motions, np.ndarray]:
        """The rigid motions followed by `columns` (j, its size) of all bodies, and the `values` of these for all."""
        more, _ = gather_motions(self.exchange, self.space, self.members, columns)
        return self.rigid.joined(more), self.of_all(values)

    def cross_points(self) -> CrossPoints:
        """The local compliance of nodes at which bodies have several contacts. Collective."""
        return CrossPoints(self.members, self.exchange, self.space)

    def local(self) -> np.ndarray:
        """`Member.local` (size,) of both bodies, where interfaces have waves; else zero. Collective."""
        return (
            self.exchange.total([member.local() for member in self.members], "local compliances")
            if self._waves
            else np.zeros(self.size)
        )

    def shared(self) -> np.ndarray:
        """(size,) bool, unknowns of nodes at which a body has several contacts. Collective."""
        return (
            self.exchange.total(
                [member.shared().astype(float) for member in self.members], "shared nodes"
            )
            > 0.0
        )

    def rigid_moduli(self) -> np.ndarray:
        """`Member.stiffness` (rigid.size,) of each rigid motion's body, for a driven partner of its stiffest body
        (N/m²; in space N/m), times the ratio of the softest foundation to its body, if below 1."""
        world = self.exchange.world
        # springs that steer rigid motions must be soft beside foundations, which resist the same motions
        soft = [
            member.elasticity.softest / member.stiffness
            for member in self.members
            if member.stiffness
        ]
        share = world.allreduce(min([1.0, *soft]), MPI.MIN)
        pushing = [
            world.allreduce(
                max(
                    (
                        member.stiffness
                        for member in self.members
                        if any(map(partner.acts_on, member.interfaces))
                    ),
                    default=0.0,
                ),
                MPI.MAX,
            )
            for partner in self.driven
        ]
        return share * self.of_all(
            [np.full(len(member.e), member.stiffness) for member in self.members],
            [
                np.full(len(partner.push), stiffness)
                for partner, stiffness in zip(self.driven, pushing, strict=True)
            ],
        )

    def first_closed(self) -> tuple[np.ndarray, np.ndarray]:
        """The nodes (m,) bool of all owned interfaces that the first guess closes, and those of them that are open and
        onto which a body falls that may turn. Collective.

        The guess closes all nodes where clamps support all bodies. With loose bodies it closes the nodes that touch, as
        forces would pull an unloaded body to a distant partner, and all nodes of a loose body whose load presses it
        onto no touching node, such as a shaft that falls through its clearance.
        """
        space = self.space
        # gap ≤ 0 without forces: they touch or overlap, as drawn and with rigid partners moved
        touches = [
            space.gap[entries][: interface.m] <= 0.0 for interface, entries in space.with_slices()
        ]
        falls = [np.zeros(len(touch), bool) for touch in touches]
        lonely: list[str] = []
        if self.rigid.size:
            bears = np.zeros(self.rigid.size)
            for interface, block_of, closed in zip(
                space.interfaces, self.rigid.blocks, touches, strict=True
            ):
                _, numbers, block = block_of
                for at in (self.slices[name] for name in interface.bodies if name in self.slices):
                    of_body = (at.start <= numbers) & (numbers < at.stop)
                    # (Gᵀe)_j > 0: a motion along the load closes the gap at touching node j
                    bears[numbers[of_body]] += (
                        block[: interface.m][closed][:, of_body] @ self.e[at] > 0.0
                    ).any()
            bears = space.add(bears)
            lonely = [
                name for name, at in self.slices.items() if self.e[at].any() and not bears[at].any()
            ]
        # for partners that do not turn, the direction of slip after the fall is known
        upright = {partner.name for partner in self.driven if not len(partner.sizes)}
        for k, interface in enumerate(space.interfaces):
            falling = set(interface.bodies) & set(lonely)
            if falling - upright:
                falls[k] = ~touches[k]
            touches[k] |= bool(falling) or not self.rigid.size
        none = np.empty(0, bool)
        return np.concatenate([none, *touches]), np.concatenate([none, *falls])

    def of_all(
        self, arrays: Sequence[np.ndarray], partners: Sequence[np.ndarray] = ()
    ) -> np.ndarray:
        """Arrays of all bodies and then of driven partners, concatenated in the order of the motions."""
        everyone = self.exchange.world.allgather(arrays)
        return np.concatenate([np.zeros(0), *itertools.chain(*everyone), *partners])

    def placed(self, alpha: np.ndarray) -> list[Interface]:
        """The owned interfaces, with rigid partners and offsets where the motions α (rigid.size,) take them."""
        interfaces = list(self.space.interfaces)
        for partner in self.driven:
            interfaces = [
                partner.place(met, alpha[self.slices[partner.name]]) for met in interfaces
            ]
        return interfaces

    def imbalance(self, s: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """e − G s − K α (rigid.size,) in newtons: loads on loose bodies that the forces s do not balance, without those
        along motions that stay."""
        return self.stays.moving(self.e - self.rigid.sums(s) - self.K @ alpha)

    def unheld(self, s: np.ndarray, alpha: np.ndarray) -> np.ndarray | None:
        """`imbalance` where motions are held, else None."""
        return self.imbalance(s, alpha) if self.stays.held.size else None

    def held_back(self, s: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """The part of e − G s − K α (rigid.size,) in newtons along held motions, which is left without balance."""
        held = self.stays.held
        if not held.size:  # the same on all ranks
            return np.zeros(self.rigid.size)
        return held @ (held.T @ (self.e - self.rigid.sums(s) - self.K @ alpha))

    def balances(self, left: np.ndarray, size: float) -> bool:
        """Whether the imbalance `left` of driven partners is rounding beside their forces and those of contacts, whose
        norm is `size` (N)."""
        motions = [self.slices[partner.name] for partner in self.driven]
        return all(norm(left[at]) <= ROUNDING * (norm(self.e[at]) + size) for at in motions)

    def multiplications(self) -> int:
        """Multiplications by A_a⁻¹ so far, of all bodies."""
        return self.exchange.world.allreduce(sum(member.C.count.total() for member in self.members))


class FarMember(Member):
    """A body that moves far, with the compliance of all nodes that contacts may join, in its frame.

    Parameters
    ----------
    mesh, body : its mesh and specification
    faces : its sides on contacts
    Otherwise as of a `Member`. Raises InputError where clamps leave a part of the rigid motions free, or the compliance
    is not worth while.

    Attributes
    ----------
    free : the free components of its frame, or None
    resisting : K (j, j) of its loads by history, see `FreeFrame.resists` (N/m)
    """

    resisting: dict[str | None, np.ndarray]

    def __init__(
        self,
        elasticity: Elasticity,
        scene: Settled,
        mesh: Mesh,
        body: SettledBody,
        faces: Sequence[Side],
        memory: float,
        points: np.ndarray,
    ) -> None:
        nodes = np.unique(np.concatenate([np.empty(0, int), *(side.nodes for side in faces)]))
        super().__init__(
            body.name,
            elasticity,
            [],
            scene.method.compliance,
            memory,
            [None, *scene.followed],
            points,
            STEPS,
            nodes,
        )
        loose, d, freed = not elasticity.supported, mesh.dimension, freed_part(body.motion)
        if loose and (
            body.motion
            or elasticity.motions.shape[2] < (1 if mesh.axisymmetric else d * (d + 1) // 2)
        ):
            raise InputError(
                f'body.{body.name}: clamps leave a rigid motion free; with time.motions = "far" they '
                "must fix a body in its frame; free the motion of the frame, as in motion = { free = "
                '["y"] }, or leave clamps and motion out for a body that moves freely'
            )
        if self.size and (self.kind == "iterative" or len(nodes) > MOST):
            why = self.reason if self.kind == "iterative" else f"at most {MOST} are possible"
            raise InputError(
                f'body.{body.name}: with time.motions = "far" it needs a dense compliance of all '
                f"{len(nodes)} nodes of its contacts, and {why}: name smaller groups, or take a coarser "
                "mesh"
            )
        if (
            self.kind == "direct" and self._B.count_nonzero()
        ):  # columns by solves would take a hundred times as long
            self.kind = self._asked = "explicit"
        self._drawn, self._whole, self._dead = (
            mesh.points,
            np.empty((0, 0)),
            dict[str | None, np.ndarray](),
        )
        # the frame of a loose body is the rigid motion of its contact nodes, by least squares
        self.free = (
            FreeFrame.of(
                freed,
                self._drawn[nodes] if loose and len(nodes) else self._drawn,
                mesh.axisymmetric,
            )
            if loose or freed
            else None
        )
        turns = any(motion.turn for motion in parts_of(body.motion)) or bool(
            self.free and len(self.free.turns)
        )
        self._following = {
            history: nodal_loads(mesh, body, history, np.zeros((d, d))) if turns else case.f
            for history, case in elasticity.cases.items()
        }

    def factor(self, kept: Kept | None = None) -> Member:
        """As of a `Member`; and the response to dead loads in all directions, for a frame that turns."""
        super().factor(kept)
        self._whole = super().dense()
        for history, case in self.elasticity.cases.items():
            dead, free, d = (
                case.f - self._following[history],
                self.elasticity.supports.free,
                case.f.shape[1],
            )
            if dead.any():
                self._dead[history] = np.array(
                    [
                        [
                            self.response_to(
                                replace(
                                    case,
                                    prescribed=0.0 * case.f,
                                    b=apply(free, np.outer(dead[:, i], axis))[
                                        self.elasticity.nodes
                                    ].ravel(),
                                )
                            )[0]
                            for axis in np.eye(d)
                        ]
                        for i in range(d)
                    ]
                )
        return self

    def meet(self, interfaces: Sequence[Interface], frame: Frame) -> FarMember:
        """The same body at interfaces of its candidate nodes, in its frame, on the same factors. Not collective."""
        other, turned = copy.copy(self), frame.turned
        other._join(interfaces)
        other._B = other._rows()
        other.size = other._B.shape[0]
        W, d = (
            other._B[:, self._B.indices],
            len(turned),
        )  # rows of `self._B` are unit vectors: W = B B₀ᵀ
        if self.free:
            other.motions = self.free.motions(self._drawn, turned)
        other.G = np.vstack(
            [
                np.empty((0, other.size)),
                *(other.trace(motion)[None] for motion in np.moveaxis(other.motions, 2, 0)),
            ]
        )
        cases, other._responses, other.resisting = dict[str | None, LoadCase](), {}, {}
        for history, case in self.elasticity.cases.items():
            follow, h = self._following[history], self._responses[history][0]
            dead = (case.f - follow) @ turned  # in a frame that turns they turn back
            change = follow + dead - case.f
            cases[history] = replace(
                case,
                f=case.f + change,
                b=case.b
                + apply(self.elasticity.supports.free, change)[self.elasticity.nodes].ravel(),
            )
            if history in self._dead:
                h = h + np.einsum("ij,ijk->k", turned - np.eye(d), self._dead[history])
            e = np.einsum("nij,ni->j", other.motions, follow + dead)
            if self.free:
                other.resisting[history] = self.free.resists(self._drawn, turned, dead, follow)
            other._responses[history] = W @ h + other.trace(case.prescribed), e
        if self.free and self.free.part:  # its history is one of elasticity.cases
            history = self.free.history
            other._responses[history] = (
                other._responses[history][0],
                other._responses[history][1] + self.free.push,
            )
            other.resisting[history] += self.free.levers
        other.h = sum((h for h, _ in other._responses.values()), np.zeros(1))
        other.e = sum((e for _, e in other._responses.values()), np.zeros(1))
        other.elasticity = replace(self.elasticity, cases=cases)
        if hasattr(self, "C"):
            other.C = self.C.seen(W, self._whole)
            other._set_up = self.C.count.copy()
        return other

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        self.C.mult(x, y, purpose, relative)  # which is centred

    def dense(self) -> np.ndarray:
        return self.C.dense()


@dataclass(frozen=True)
class Far:
    """What bodies that move far keep wherever they go.

    Attributes
    ----------
    contacts : of this rank's bodies, each with its slave
    sides : of both bodies in their frames, by contact; None for a rigid partner
    members : of this rank, with the compliance of all nodes that contacts may join
    free : the free components of the frames of all bodies and rigid partners, by name
    reach : by time and contact, see `mortar.meet`; left out, overlaps are looked for by the bodies' thickness
    freed : how far free frames have gone, by time
    """

    contacts: Sequence[SettledContact]
    sides: Mapping[str, tuple[Side, Side | None]]
    members: Sequence[FarMember]
    free: Mapping[str, FreeFrame]
    reach: dict[float, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    freed: dict[float, Freed] = field(default_factory=dict)

    def driven(self, scene: Settled, frames: Mapping[str, Frame]) -> list[Driven]:
        """The rigid partners with free frames, where their frames are."""
        return [
            Driven.of_frame(rigid.name, self.free[rigid.name], frames[rigid.name])
            for rigid in scene.rigid
            if rigid.name in self.free
        ]

    def frames(self, scene: Settled, time: float) -> dict[str, Frame]:
        """The frames of all bodies and rigid partners at `time`, by name."""
        return frames_of(scene, time, self.freed.get(time))

    def meet(
        self,
        world: MPI.Comm,
        scene: Settled,
        exchange: Exchange,
        frames: Mapping[str, Frame],
        reach: Mapping[str, tuple[float, float]],
    ) -> tuple[list[FarMember], Space]:
        """The bodies with their contacts where their frames are, and the layout of the contacts that this rank owns.
        Collective. Raises InputError."""
        with agreed(world):
            rigid = {partner.name: partner for partner in scene.rigid}
            met = {
                contact.name: meet(
                    contact,
                    self.sides[contact.name],
                    frames,
                    rigid,
                    reach.get(contact.name, (None, np.inf)),
                )
                for contact in self.contacts
            }
        members = [
            member.meet(
                [
                    seen(met[contact.name], frames[member.name])
                    for contact in self.contacts
                    if member.name in contact.bodies
                ],
                frames[member.name],
            )
            for member in self.members
        ]
        space = Space(
            [met[name] for name, first, _ in exchange.ends if first == world.rank],
            world,
            exchange.sent,
        )
        exchange.connect(space, [member.parts for member in members])
        return members, space
