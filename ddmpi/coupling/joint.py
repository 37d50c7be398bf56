"""The joint compliance of all bodies, an operator on the vectors of the interfaces, with their rigid motions."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI

from ddmpi.coupling.coarse import CrossPoints, Driven, Motions, gather_motions
from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.member import Member
from ddmpi.coupling.small import SmallBodies
from ddmpi.coupling.space import Point, Space
from ddmpi.interface.interface import Interface
from ddmpi.system.numbers import ROUNDING, concatenated, norm

STEERING = 0.1
"""With an iterative solver, a product in GMRES needs no more relative precision than this times the ratio by which
GMRES has still to reduce its residual (Bouras and Frayssé, SIAM J. Matrix Anal. Appl. 26, 2005)."""


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

    The gaps under forces s are r = (C + D) s + b − d − Gᵀα with the closures D s + b of soft joints, and G s + K α = e is the
    equilibrium of the loose bodies, with the stiffness K of loads that change as bodies move far. Users of this class
    work on vectors of the `space` and need not know of ranks. All methods that multiply or sum are collective on all
    bodies, and raise the errors of any of them.

        >>> answer = ddmpi.solve("configs/punch.toml", MPI.COMM_WORLD)
        >>> joint, s = answer.solved.assembly.joint, answer.solved.solution.outer.forces
        >>> r = joint.product(s, "example") - joint.d
        >>> law, c = joint.space.laws, 1e5  # N/mm; a c > 0 of any size
        >>> joint.space.norm(s - law.project(s - c * r)) < 1e-6 * joint.space.norm(s)  # the laws hold at the answer
        True

    Parameters
    ----------
    members : the bodies of this rank
    exchange, space : between the bodies, and the layout of the vectors
    histories : of loads, clamps and rigid partners, None for constant ones
    driven : what forces move without compliance, after the loose bodies
    far : whether bodies move far, and the operator is one of many passes

    Attributes
    ----------
    size : length of the vectors on this rank
    bodies : number of bodies of all ranks
    d : (size,) overlap without contact forces (m); its tangential part, from where slip begins, is set by the load step
        after `act`
    rigid : the rigid motions of loose bodies, Gᵀ = rigid.Z; of size 0 where clamps support all bodies
    stays : the motions that stay as they are
    slices : of the motions by body, empty for supported ones, and by driven partner
    e, K : the loads along the motions (rigid.size,) in newtons, and by how much they resist these (N/m), sparse
    soft, stiffens : whether any contact is soft, and one of them the less the more it is pressed
    D, offset : (size,) of the closures D s + b of soft joints (m/N, m), b = 0 unless they stiffen, see `take`
    load : largest sum of the absolute nodal loads of a loose body (N), also where they have no resultant; of loads
        with several histories the sum of these
    neglected : forces (N) that are negligible in products whose result is kept
    steering : relative precision of products in GMRES, over the factor by which GMRES must still reduce its residual
    dear : whether a body's products are by an iterative solver
    """

    def __init__(
        self,
        members: Sequence[Member],
        exchange: Exchange,
        space: Space,
        histories: Sequence[str | None] = (None,),
        driven: Sequence[Driven] = (),
        far: bool = False,
    ) -> None:
        self.members, self.space, self.size = tuple(members), space, space.size
        self.neglected, self.steering = 0.0, STEERING
        self.exchange, self.driven, self.far = exchange, tuple(driven), far
        ours = np.array(
            [
                any(member.dear for member in members),
                any(interface.geometry.waves for interface in space.interfaces),
                len(space.layers) > 0,
                any(len(layer.pressure) > 2 for layer in space.layers),
            ]
        )
        exchange.world.Allreduce(MPI.IN_PLACE, ours, MPI.LOR)
        self.dear, self._waves, self.soft, self.stiffens = ours
        self.D, self.offset = space.softness(np.zeros(space.size))
        self._moved = {
            name: exchange.total(
                [member.response(name)[0] for member in members], "free displacement"
            )
            for name in histories
        }
        self.rigid, self.slices = gather_motions(
            exchange, space, members, [member.G for member in members], self.driven
        )
        self.bodies = len(self.slices) - len(self.driven)
        loose = [member for member in members if len(member.G)]
        loads = [max((each.load_of(name) for each in loose), default=0.0) for name in histories]
        self._loads = np.array(loads)
        exchange.world.Allreduce(MPI.IN_PLACE, self._loads, MPI.MAX)
        self.stays = Stays(self.rigid.size)
        # a driven partner is a body without compliance; its rows of G s = e balance contact forces, force and moment
        self._none = sparse.csr_matrix((self.rigid.size,) * 2)
        self._resisting = self._resistances(histories) if far else {}
        self._pulled = {
            name: self.of_all(
                [member.response(name)[1] for member in members],
                [(partner.history == name) * partner.push for partner in self.driven],
            )
            for name in histories
        }
        self.act(dict.fromkeys(histories, 1.0))

    def _resistances(self, histories: Sequence[str | None]) -> dict[str | None, sparse.spmatrix]:
        """K (rigid.size, rigid.size) of the loads of all bodies and partners by history (N/m)."""
        ours = {member.name: member.resisting for member in self.members}
        blocks = {partner.name: {partner.history: partner.resists} for partner in self.driven}
        for resisting in self.exchange.world.allgather(ours):
            blocks |= resisting
        resistances = {}
        for history in histories:
            if any(history in by_history for by_history in blocks.values()):
                parts = [
                    blocks[name].get(history, np.zeros((at.stop - at.start,) * 2))
                    for name, at in self.slices.items()
                ]
                resistances[history] = sparse.block_diag(parts, "csr")
        return resistances

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
        self.take(s)
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
        present = np.array([factors[name] for name in self._moved])
        self.load = float(np.abs(present) @ self._loads)

    def closed(self, point: Point) -> Point:
        """The point with the gaps of soft joints as they are under its forces, not as near those of D. Not collective."""
        if not self.stiffens:
            return point
        D, offset = self.space.softness(point.s)
        return point._replace(r=point.r + (D - self.D) * point.s + offset - self.offset)

    def take(self, s: np.ndarray) -> None:
        """From here on let soft joints have the D that they have near forces s (size,)."""
        if self.stiffens:
            self.D, self.offset = self.space.softness(s)

    def soften(self, point: Point) -> Point:
        """`closed`, and `take` its forces."""
        closed = self.closed(point)
        self.take(point.s)
        return closed

    def product(self, x: np.ndarray, purpose: str, relative: float | None = None) -> np.ndarray:
        """(C + D) x (size,) as a new vector, precise enough to be kept, or `relative` as for `Compliance.mult`."""
        y = np.empty(self.size)
        if relative is None:
            size = self.space.norm(x)
            # a relative error of neglected/‖x‖ leaves forces of size `neglected` unbalanced in the bodies
            relative = min(self.neglected / size, STEERING) if size else 0.0
        self.mult(x, y, purpose, relative)
        return y + self.D * x if self.soft else y

    def solved(self, x: np.ndarray, purpose: str) -> np.ndarray:
        """(C + D) x (size,) as `product`, by solves with the bodies even where their compliances are dense matrices."""
        with contextlib.ExitStack() as stack:
            for member in self.members:
                stack.enter_context(member.C.by_solves())
            stack.enter_context(self._small.aside())
            return self.product(x, purpose)

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons), both (size,); `relative` as for `Compliance.mult`."""
        vectors = self.exchange.spread(x)
        # the exchange, which all ranks reach, raises an error of one rank on all of them
        with self.exchange.deferred():
            done = set(self._small.mult(vectors, purpose))
            for k, (member, vector) in enumerate(zip(self.members, vectors, strict=True)):
                if k not in done:
                    member.mult(vector.copy(), vector, purpose, relative)
        y[:] = self.exchange.total(vectors, purpose)

    @cached_property
    def _small(self) -> SmallBodies:
        """The bodies of this rank that are multiplied together."""
        return SmallBodies(self.members)

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

    def evened(self, s: np.ndarray) -> np.ndarray:
        """Forces s (size,) with the same effect on all bodies, of which those of bonds are as in `Member.even`. Not
        collective."""
        s = s.copy()
        forces = {name: s[entries] for name, entries in self.space.parts.items()}
        for member in self.members:
            member.even(forces)
        return s

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

    def at_bodies(self, s: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """Forces s (size,) as those that do the same to bodies: where contacts have a `shared` node the mean over the
        bodies of a contact of `Member.at_body`, which is zero of forces around a loop of contacts. Collective."""
        vectors = [
            member.at_body(vector)
            for member, vector in zip(self.members, self.exchange.spread(s), strict=True)
        ]
        bodies = concatenated(
            np.full(each.size, 2.0) - each.alone for each in self.space.interfaces
        )
        return np.where(shared, self.exchange.total(vectors, "forces of shared nodes") / bodies, s)

    @cached_property
    def rigid_moduli(self) -> np.ndarray:
        """`Member.stiffness` (rigid.size,) of each rigid motion's body, for a driven partner of its stiffest body
        (N/m²; in space N/m), times the ratio of the softest foundation to its body, if below 1. Collective at first."""
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
        forces would pull an unloaded body to a distant partner, or that their loads bring to touch beside these; and
        all nodes of a loose body whose load presses it onto no such node, such as a shaft that falls through its
        clearance.
        """
        space = self.space
        # a load on a point of a body of modulus E* moves it by about load / E* (in space: and over its size)
        moduli = self.rigid_moduli if self.rigid.size else self.e
        yields = np.divide(np.abs(self.e), moduli, out=np.zeros_like(moduli), where=moduli > 0.0)
        touches = []
        for interface, entries in space.with_slices():
            bodies = self.slices.keys() & set(interface.bodies)
            approach = max(
                (yields[self.slices[name]].max(initial=0.0) for name in bodies), default=0.0
            )
            # without forces, as drawn and with rigid partners moved
            touches.append(space.gap[entries][: interface.m] <= approach)
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
        return concatenated(touches, bool), concatenated(falls, bool)

    def of_all(
        self, arrays: Sequence[np.ndarray], partners: Sequence[np.ndarray] = ()
    ) -> np.ndarray:
        """Arrays of all bodies and then of driven partners, concatenated in the order of the motions."""
        everyone = self.exchange.world.allgather(arrays)
        return concatenated([*itertools.chain(*everyone), *partners])

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
