"""The coarse problem: a few motions of each body, which couple all its contact forces.

The rigid motions R_a that clamps leave free are unknowns α_a, with an equation each: the contact forces must balance
the loads, G s = e with G = RᵀBᵀ and e = Rᵀb. This is the coarse problem of FETI (Farhat and Roux, Int. J. Numer. Meth.
Engng. 32, 1991). Smooth deformations of a body serve the preconditioner in the same form. A motion is given by its
contact displacements, a column of Z = Gᵀ; ranks exchange only these, and one small system for all bodies.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Space
from ddmpi.errors import SolverError
from ddmpi.interface.interface import Interface
from ddmpi.petsc.events import event
from ddmpi.scene.contacts import Rigid, SettledContact
from ddmpi.system.agreement import agreed
from ddmpi.system.matrices import scaled
from ddmpi.system.numbers import ALIKE, Frame, RigidMotion, crossed, divisor


@dataclass(frozen=True)
class Driven:
    """A partner without compliance that forces move: a rigid partner under a force or a moment, or the second side of a
    bond with a pretension, which its offset moves past the body.

    Its motions are unknowns as those of loose bodies are, and the balance of its forces their equations. They are
    translations along `axes`, and turns about the pivot, in metres of the node that moves farthest. With a turn goes
    the translation along the axes that moves the middle of the nodes back, as a turn about a remote pivot would be
    nearly a translation.

    Attributes
    ----------
    name : of the partner, or of the pretension in words
    history : of its force and moment
    axes : (a, d) unit vectors
    push : (a + t,) force and moment along the motions, at the factor 1 of the history (N)
    pivot : (d,) (m)
    turns : (t, 1 or 3) unit vectors about which it turns, in the plane [1]
    shifts, sizes : (t, d) and (t,) translation that goes with a turn, and motion of the farthest node (m/rad)
    bond : the contact with a pretension, else None
    resists : (a + t, a + t) stiffness with which its force resists motions, at the factor 1, see `FreeFrame` (N/m)
    """

    name: str
    history: str | None
    axes: np.ndarray
    push: np.ndarray
    pivot: np.ndarray
    turns: np.ndarray
    shifts: np.ndarray
    sizes: np.ndarray
    bond: str | None = None
    resists: np.ndarray | float = 0.0

    @classmethod
    def of(cls, rigid: Rigid, space: Space) -> Driven:
        """A rigid partner that may touch the owned interfaces of `space`. Collective."""
        nodes = [
            interface.places for interface in space.interfaces if interface.bodies[1] == rigid.name
        ]
        d, turns = len(rigid.displacement or ()), np.eye(rigid.turns_by)
        axes, pivot = np.eye(d)[rigid.pushed], np.array(rigid.pivot or np.zeros(d))
        *total, number = space.add(
            np.append(sum((at.sum(axis=0) for at in nodes), np.zeros(d)), sum(map(len, nodes)))
        )
        arm = np.array(total)[None] / number - pivot
        shifts = np.concatenate(
            [np.zeros((0, d)), *(-crossed(turn[None], arm) @ axes.T @ axes for turn in turns)]
        )
        sizes = np.array(
            [
                space.largest(
                    np.array(
                        [
                            np.linalg.norm(crossed(turn[None], at - pivot) + shift, axis=1).max()
                            for at in nodes
                        ]
                    )
                )
                for turn, shift in zip(turns, shifts, strict=True)
            ]
        )
        # if all nodes lie on the axis of a turn, it moves none beside other turns; nothing resists it, any size will do
        most = sizes.max(initial=0.0) or np.linalg.norm(arm) or 1.0
        sizes = np.where(sizes > ALIKE * most, sizes, most)
        driven = cls(rigid.name, rigid.history, axes, np.empty(0), pivot, turns, shifts, sizes)
        return replace(
            driven,
            push=driven.along(np.array(rigid.force or np.zeros(d)), np.array(rigid.moment or 0.0)),
        )

    def along(self, force: np.ndarray, moment: np.ndarray | float = 0.0) -> np.ndarray:
        """A force (d,) and a moment (t,) along the motions (a + t,) (N)."""
        # their work is F·(U + θ shift) + M θ, of which the motions' coordinates are U and θ size
        return np.append(self.axes @ force, (moment + self.shifts @ force) / self.sizes)

    @classmethod
    def of_bond(cls, contact: SettledContact) -> Driven:
        """The pretension of a contact."""
        bolt = contact.pretension
        assert bolt
        along = np.array([bolt.along]) / np.linalg.norm(bolt.along)
        return cls(
            f"pretension of {contact.name}",
            bolt.history,
            along,
            np.array([bolt.force or 0.0]),  # a check does without
            0.0 * along[0],
            np.eye(0),
            along[:0],
            np.empty(0),
            contact.name,
        )

    @classmethod
    def of_frame(cls, name: str, free: FreeFrame, frame: Frame) -> Driven:
        """A rigid partner that moves far, where its frame is."""
        d, t = len(frame.shift), len(free.turns)
        return cls(
            name,
            free.history,
            np.eye(d)[free.axes],
            free.push,
            frame.at(free.pivot),
            free.turns,
            np.zeros((t, d)),
            np.full(t, free.size),
            resists=free.levers,
        )

    def motions(self, points: np.ndarray) -> np.ndarray:
        """The displacements (k, d, j) of points (k, d) by the motions."""
        turned = [
            (crossed(turn[None], points - self.pivot) + shift) / size
            for turn, shift, size in zip(self.turns, self.shifts, self.sizes, strict=True)
        ]
        return np.stack([*(np.zeros_like(points) + axis for axis in self.axes), *turned], axis=2)

    def place(self, interface: Interface, alpha: np.ndarray) -> Interface:
        """An interface with its second side where amplitudes α (j,) take it."""
        if not self.acts_on(interface):
            return interface
        partner = interface.partner
        if self.bond:
            return replace(interface, partner=replace(partner, offset=float(alpha[0])))
        motion = RigidMotion(
            partner.motion.displacement + self.shift(alpha),
            alpha[len(self.axes) :] / self.sizes @ self.turns,
            self.pivot,
        )
        return replace(interface, partner=replace(partner, motion=motion))

    def shift(self, alpha: np.ndarray) -> np.ndarray:
        """The displacement (d,) of the pivot by amplitudes α (j,) (m)."""
        along, turn = np.split(alpha, [len(self.axes)])
        return along @ self.axes + (turn / self.sizes) @ self.shifts

    def acts_on(self, interface: Interface) -> bool:
        """Whether the motions move the second side of an interface."""
        return interface.name == self.bond if self.bond else interface.bodies[1] == self.name


class Motions:
    """Motions of bodies, by their contact displacements at the owned interfaces.

        >>> answer = ddmpi.solve("configs/wall.toml", MPI.COMM_WORLD)  # of fourteen loose bricks
        >>> joint, s = answer.solved.assembly.joint, answer.solved.solution.outer.forces
        >>> joint.rigid.size
        42
        >>> bool(np.allclose(joint.rigid.sums(s), joint.e, atol=1e-6 * joint.load))  # the forces bear the loads
        True

    Parameters
    ----------
    space : of the interfaces
    size : number of motions of all bodies
    blocks : for each owned interface the slice of its entries, the numbers (c,) of the motions of its bodies, and their
        contact displacements (its size, c); together they are Z (owned size, size), sparse (m)

    Attributes
    ----------
    columns : (owned size, k) the blocks one below the other, k the largest c, with zeros beside narrower ones
    """

    def __init__(
        self, space: Space, size: int, blocks: Sequence[tuple[slice, np.ndarray, np.ndarray]]
    ) -> None:
        self.space, self.size, self.blocks = space, size, tuple(blocks)
        widest = max((len(numbers) for _, numbers, _ in self.blocks), default=0)
        self.columns = np.zeros((space.size, widest))
        self._numbers = np.full((space.size, widest), -1)  # of the motions; −1 where there is none
        for entries, numbers, block in self.blocks:
            self.columns[entries, : len(numbers)] = block
            self._numbers[entries, : len(numbers)] = numbers
        self.Z = self.assemble(self.columns)
        self._G = self.Z.T

    def joined(self, other: Motions) -> Motions:
        """These motions and then the `other` ones."""
        if not other.size:
            return self
        if not self.size:
            return other
        return Motions(
            self.space,
            self.size + other.size,
            [
                (entries, np.append(ours, self.size + theirs), np.hstack([block, more]))
                for (entries, ours, block), (_, theirs, more) in zip(
                    self.blocks, other.blocks, strict=True
                )
            ],
        )

    def assemble(
        self, columns: np.ndarray, entries: np.ndarray | slice = slice(None)
    ) -> sparse.csr_matrix:
        """A matrix like Z from `columns` like its own, of all its rows or of those `entries`."""
        numbers = self._numbers[entries]
        known = numbers >= 0
        ends = np.append(0, np.cumsum(known.sum(axis=1)))
        return sparse.csr_matrix((columns[known], numbers[known], ends), (len(known), self.size))

    def spread(self, alpha: np.ndarray) -> np.ndarray:
        """Zα = Gᵀα (owned size,) in metres: the contact displacements of motions with amplitudes α (size,)."""
        return self.Z @ alpha if self.size else np.zeros(self.space.size)

    def sums(self, s: np.ndarray) -> np.ndarray:
        """Zᵀs = G s (size,) in newtons, the same on all ranks: forces s along the motions. Collective."""
        return self.space.add(self._G @ s) if self.size else np.zeros(0)


def gather_motions(
    exchange: Exchange,
    space: Space,
    members: Sequence[Member],
    columns: Sequence[np.ndarray],
    driven: Sequence[Driven] = (),
) -> tuple[Motions, dict[str, slice]]:
    """The motions of all bodies, and their numbers by body: in the order of ranks, then of the bodies on a rank.

    `columns` has the contact displacements of the motions of every local body (j, size of its vector) in metres. The
    motions of what is `driven` come last. Collective.
    """
    # All ranks learn how many motions each body has, hence the same numbers; the motions themselves go to neighbours.
    counts = exchange.world.allgather(
        [(member.name, len(rows)) for member, rows in zip(members, columns, strict=True)]
    )
    slices, size = {}, 0
    for name, count in itertools.chain(
        *counts, ((partner.name, len(partner.push)) for partner in driven)
    ):
        slices[name] = slice(size, size + count)
        size += count
    if not size:
        return Motions(space, 0, ()), slices
    both = exchange.swap_objects(
        {
            (contact, side): motions[:, entries].T
            for member, motions in zip(members, columns, strict=True)
            for contact, (entries, side) in member.parts.items()
        }
    )
    blocks = []
    for interface, entries in space.with_slices():
        # what a body does at a contact with itself is that of its first side
        both_sides = zip(interface.bodies, both[interface.name], strict=True)
        sides = {name: block for name, block in both_sides if block is not None}
        for partner in driven:
            if partner.acts_on(
                interface
            ):  # a second side that moves by e_x closes the contact by −n·e_x
                sides[partner.name] = -np.einsum(
                    "id,idj->ij",
                    interface.directions,
                    partner.motions(interface.places)[interface.law.node],
                )
        seen = [
            (np.arange(slices[name].start, slices[name].stop), block)
            for name, block in sides.items()
        ]
        numbers, columns = zip(*seen, strict=True)
        blocks.append((entries, np.concatenate(numbers), np.hstack(columns)))
    return Motions(space, size, blocks), slices


class CoarseSystem:
    """S = Ẑ M Z̃ᵀ + K for one set of unknown forces, Ẑ = Zᵀ E, Z̃ = Zᵀ I, factored and solved on the first rank.

    Factors on every rank would take memory on each, and keep all cores of a host busy with the same work; distributed
    over several ranks they do not solve faster (docs/studies/scaling.md).

    Parameters
    ----------
    basis, E : I and E (owned size, k) sparse: directions of the unknown forces, and all forces from the unknown ones;
        each is of one interface
    weights : W (k,) along the unknown forces; W Iᵀ M I W replaces Iᵀ M I
    stiffness : M times columns (owned size, c), without coupling between interfaces
    resists : K (size, size), sparse, the same on all ranks
    kept : (k,) bool, which of the first motions stay where they are
    held : (k, q) orthonormal columns, combinations of these motions that stay as well
    columns : (owned size, k) sparse, of Z̃ = Zᵀ columns: I if left out; E for the transposed system, whose `E` is I

    Construction is collective.
    """

    def __init__(
        self,
        motions: Motions,
        basis: sparse.csr_matrix,
        E: sparse.csr_matrix,
        weights: np.ndarray,
        stiffness: Callable[[np.ndarray], np.ndarray],
        resists: sparse.spmatrix,
        kept: np.ndarray,
        held: np.ndarray,
        columns: sparse.csr_matrix | None = None,
    ) -> None:
        self._space = motions.space
        moves = np.append(1.0 - kept, np.ones(motions.size - len(kept)))
        self._held = np.vstack([held, np.zeros((motions.size - len(held), held.shape[1]))])
        of_columns = basis.tocsc()
        entries = of_columns.indices[of_columns.indptr[:-1]]  # the first of each unknown force

        def moving(columns: np.ndarray) -> sparse.csr_matrix:
            """Rows (k, size) from `columns` like those of the motions, without what stays."""
            rows = scaled(motions.assemble(columns, entries), columns=moves)
            if not held.size:
                return rows
            return rows - sparse.csr_matrix(rows @ self._held) @ sparse.csr_matrix(self._held.T)

        with event("CoarseSystem"):
            along = basis if columns is None else columns
            w = weights[:, None]
            smooth = stiffness(basis @ (w * (along.T @ motions.columns)))
            # Elimination of y from [M⁻¹ −Z̃ᵀ; Ẑ K] leaves S. The friction of slipping nodes follows the pressure, so E
            # differs from I, S is not symmetric, and the projector is oblique, unlike FETI's.
            self._MZ = moving(w * (of_columns.T @ smooth))
            self._ZE = moving(E.T @ motions.columns).T
            local = (self._ZE @ self._MZ).tocoo()
            triplets = self._space.gather((local.row, local.col, local.data))
            self.size = motions.size
            with agreed(self._space.comm):
                if triplets is not None:
                    row, column, value = (
                        np.concatenate(arrays) for arrays in zip(*triplets, strict=True)
                    )
                    S = sparse.csc_matrix((value, (row, column)), (self.size, self.size))
                    try:
                        self._factor((S + resists).tocsc())
                    except (RuntimeError, ValueError) as cause:
                        raise SolverError(
                            f"the coarse problem of rigid motions cannot be solved: {cause}"
                        ) from None

    def _factor(self, S: sparse.csc_matrix) -> None:
        """Factors of S (size, size), scaled to a diagonal of ones: rigid motions (N/m) and modes have unlike units."""
        diagonal = np.abs(S.diagonal())
        self._scale = 1.0 / np.sqrt(divisor(diagonal))
        S.data *= self._scale[S.indices] * np.repeat(self._scale, np.diff(S.indptr))
        # S is nearly symmetric. Without the scaling pivots would leave the diagonal, and with it the order that keeps
        # the factors sparse: those of a wall of 1,008 bricks would have fifteen times the entries
        self._factors = splu(S, permc_spec="MMD_AT_PLUS_A")

    def _solve(self, right: np.ndarray) -> np.ndarray:
        """S⁻¹ times `right` (size,), on the first rank."""
        return self._scale * self._factors.solve(self._scale * right)

    def correct(self, Mf: np.ndarray, h: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """y = M f + M Z̃ᵀ a (k,) in newtons and a = S⁻¹(h − Ẑ M f) (size,) in metres, from M f; `h` is zero if left out.

        Collective.
        """
        # the right-hand side is summed over ranks in one reduction, and a sent back: a few numbers a body
        a = self._space.solve_first(
            self._ZE @ Mf, lambda total: self._solve(-total if h is None else h - total)
        )
        return Mf + self._MZ @ a, a - self._held @ (self._held.T @ a) if self._held.size else a


class CrossPoints:
    """The local compliance R = Σ B_a B_aᵀ / c_a of nodes at which bodies have several contacts, with their rows B_a.

    The half-spaces of the preconditioner do not couple contacts. Around an edge where several bodies meet, forces of
    different contacts act on the same node and may cancel. R is on the first rank. Construction is collective.
    """

    def __init__(self, members: Sequence[Member], exchange: Exchange, space: Space) -> None:
        points = [member.at_cross_points() for member in members]
        rest = exchange.total([rest for _, rest in points], "cross points")
        blocks = [
            (
                [
                    (name, entries.stop - entries.start)
                    for name, (entries, _) in member.parts.items()
                ],
                block,
            )
            for member, (block, _) in zip(members, points, strict=True)
        ]
        self._space, everyone = space, space.gather((space.parts, rest, blocks))
        if everyone is not None:
            layouts, rests, by_rank = zip(*everyone, strict=True)
            before = np.cumsum([0, *(len(values) for values in rests)])
            # Where the vector of each interface begins among those of all ranks.
            starts = {
                name: start + entries.start
                for start, layout in zip(before, layouts, strict=False)
                for name, entries in layout.items()
            }
            placed = [sparse.csr_matrix((before[-1], 0))]
            for sizes, block in itertools.chain(*by_rank):
                rows = np.concatenate(
                    [np.zeros(0, int), *(starts[name] + np.arange(size) for name, size in sizes)]
                )
                placed.append(
                    sparse.csr_matrix(
                        (np.ones(len(rows)), (rows, np.arange(len(rows)))), (before[-1], len(rows))
                    )
                    @ block
                )
            B = sparse.hstack(placed, "csr")
            # the diagonal `rest` is the compliance that nodes with one contact only add to these rows
            self._R = B @ B.T + sparse.diags(np.concatenate(rests))

    def corrector(
        self,
        basis: sparse.csr_matrix,
        D: np.ndarray,
        rows: np.ndarray,
    ) -> Callable[[np.ndarray], np.ndarray] | None:
        """w ↦ diag(K) K⁻¹ w for displacements (k,) along the unknown forces, K = Iᵀ R I + D. Its calls are collective.

        `basis` is I (owned size, k), sparse, D (k,) are positive compliances (m/N), and `rows` (owned size,) bool marks
        entries of this rank's vectors at cross points. None where all their forces are known.
        """
        space, columns = self._space, np.unique(basis[rows].indices)
        if not space.any(np.array([len(columns)])):
            return None
        unknown = sparse.diags(rows.astype(float)) @ basis[:, columns]
        everyone = space.gather((unknown, D[columns]))
        with agreed(space.comm):
            if everyone is not None:
                parts, layers = zip(*everyone, strict=True)
                along = sparse.block_diag(parts, "csr")
                # Forces that cancel in R are redundant multipliers; D > 0 makes K regular. diag(K) K⁻¹ is 1 where
                # nothing couples.
                K = (along.T @ self._R @ along + sparse.diags(np.concatenate(layers))).tocsc()
                diagonal = K.diagonal()
                factors = splu(K, permc_spec="MMD_AT_PLUS_A")

        def correct(w: np.ndarray) -> np.ndarray:
            corrected = w.copy()
            corrected[columns] = space.solve_joined(
                w[columns], lambda right: diagonal * factors.solve(right)
            )
            return corrected

        return correct
