"""The contact and friction laws of interfaces, on plain arrays.

A law relates the forces s of an interface to its gaps r. With q = s − c r, for any c > 0, they obey it exactly when

    s_ν = max(0, q_ν),        s_t = P(q_t),  P the projection on |s_t| ≤ g,        g = g(max(0, q_ν))

(Alart and Curnier, Comput. Methods Appl. Mech. Engrg. 92, 1991). A vector of an interface holds m normal
entries and then, for each of the mt nodes that slide, its d − 1 tangential entries. A new friction law is a
subclass of `Law` with a concave `slip_bound` and its `slope`, both node by node, and a line in `law_of`; what it has of
its own are arrays (mt,). Bonded nodes obey r = 0 whatever
the forces, which is the same equation without a projection: s = q. Guided nodes obey it along the normal, and have no
tangential forces.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.loads import values_at
from ddmpi.errors import InputError
from ddmpi.scene.contacts import Coulomb, Friction, Profile, Tresca, at_times
from ddmpi.sets import Box, Discs, magnitude, shorten
from ddmpi.system.numbers import divisor, in_words

ON_BOUND = 1e-8
"""Relative distance to its bound below which a force counts as lying on it: a tangential force on the slip bound, a
normal one, beside the largest, on zero, so that the node is open."""

NO_BOUND = sys.float_info.max
"""The slip bound (N) of bonded nodes: no force reaches it. It is finite, as inf − inf would be NaN."""


@dataclass
class ActiveSet:
    """The state of the nodes by the projection of a point q = s − c r.

    Attributes
    ----------
    pressure : (m,) projected normal forces (N)
    closed : (m,) bool, nodes under pressure
    slip : (mt, d − 1) direction of a tangential force on its bound, also at open nodes; zero where the node sticks
    bound : (mt,) slip bound (N)
    excess : (mt,) κ = |q_t|/g − 1 where the node slips under pressure, zero elsewhere
    """

    pressure: np.ndarray
    closed: np.ndarray
    slip: np.ndarray
    bound: np.ndarray
    excess: np.ndarray


@dataclass(frozen=True)
class Tangent:
    """What active sets imply for the forces of one or several interfaces, in frames turned to the friction.

    Attributes
    ----------
    unknown : (size,) bool, which forces are unknown, in the turned frames
    source, coupling : (size,) friction follows the pressure at entry `source` by the factor `coupling` (0: none does)
    given : (size,) the known part of the forces (N)
    spring : (size,) κ at the tangential entries of nodes that slip and can turn, zero elsewhere
    turn : (size, size) sparse, orthogonal: its columns are the axes of the turned frames; None where none is turned
    """

    unknown: np.ndarray
    source: np.ndarray
    coupling: np.ndarray
    given: np.ndarray
    spring: np.ndarray
    turn: sparse.csr_matrix | None = None


@dataclass(frozen=True)
class Law:
    """Unilateral contact without friction; the base of all laws with friction.

    Attributes
    ----------
    m : contact nodes
    sliding : (mt,) the nodes that carry tangential forces, whether they slip or stick; of a bond too
    components : d − 1, tangential components of a node
    live : (size,) bool, the unknowns along which one of the bodies can move; the others stay zero. All where left out
    """

    name = "none"
    least = 0.0
    """The least normal force of a node (N)."""

    m: int
    sliding: np.ndarray
    components: int
    live: np.ndarray = field(default_factory=lambda: np.array(True), kw_only=True)

    @classmethod
    def joined(cls, laws: Sequence[Law]) -> Law:
        """One law for the nodes of several of this class, with their normal entries before all tangential ones."""
        if len(laws) == 1:
            return laws[0]
        starts = np.cumsum([0, *(law.m for law in laws)])
        sliding = [law.sliding + start for law, start in zip(laws, starts[:-1], strict=True)]
        live = [np.broadcast_to(law.live, law.size) for law in laws]
        normal = [each[: law.m] for law, each in zip(laws, live, strict=True)]
        tangential = [each[law.m :] for law, each in zip(laws, live, strict=True)]
        own = [entry.name for entry in fields(cls) if entry.name not in Law.__dataclass_fields__]
        return cls(
            int(starts[-1]),
            np.concatenate(sliding),
            laws[0].components,
            *(np.concatenate([getattr(law, name) for law in laws]) for name in own),
            live=np.concatenate([*normal, *tangential]),
        )

    @property
    def frictionless(self) -> bool:
        """Whether nodes slide without resistance and have no tangential unknowns: the law defines no slip bound."""
        return type(self).slip_bound is Law.slip_bound

    @property
    def two_sided(self) -> bool:
        """Whether normal forces have any sign, so that nodes do not separate."""
        return self.least < 0.0

    @property
    def size(self) -> int:
        return self.m + len(self.sliding) * self.components

    @cached_property
    def node(self) -> np.ndarray:
        """The node (size,) of each entry of a vector, which is also the entry of its normal force."""
        return np.concatenate([np.arange(self.m), np.repeat(self.sliding, self.components)])

    @property
    def largest_slope(self) -> float:
        """The largest change of a slip bound with the normal force: the friction coefficient."""
        return float(self.slope(np.zeros(self.m)).max(initial=0.0))

    def slip_bound(self, pressure: np.ndarray) -> np.ndarray:
        """g (mt,) in newtons for the normal forces `pressure` (m,), which are not negative."""
        return np.zeros(len(self.sliding))

    def slope(self, pressure: np.ndarray) -> np.ndarray:
        """dg/ds_ν (mt,) at the normal forces (m,)."""
        return np.zeros(len(self.sliding))

    def under(self, factor: float) -> Law:
        """The law with `factor` times its slip bounds."""
        return self

    def split(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Views of the normal (m,) and the tangential part (mt, d − 1) of a vector (size,)."""
        return s[: self.m], s[self.m :].reshape(len(self.sliding), self.components)

    def along(self, s: np.ndarray) -> np.ndarray:
        """The tangential part (m, d − 1) of a vector (size,) at all nodes; zero where it has no such entries."""
        whole = np.zeros((self.m, self.components))
        whole[self.sliding] = self.split(s)[1]
        return whole

    def project(self, q: np.ndarray) -> np.ndarray:
        """The forces (size,) that the law assigns to q = s − c r."""
        normal, tangential = self.split(q)
        pressure = np.maximum(normal, self.least)
        # The bound is that of the projected pressure: Coulomb's law as a fixed point, not a projection onto the cone,
        # which would let slipping bodies separate (associated flow).
        return np.concatenate([pressure, shorten(tangential, self.slip_bound(pressure)).ravel()])

    def active_set(self, q: np.ndarray) -> ActiveSet:
        """Which nodes are closed and which slip at q = s − c r (size,)."""
        normal, tangential = self.split(q)
        pressure = np.maximum(normal, self.least)
        bound = self.slip_bound(pressure)
        size = magnitude(tangential)
        # ≥, not >: where Coulomb's bound is zero, at an open node, s_t = 0 is known
        slips = size >= bound
        # Where |q_t| > g the projection is g q_t/|q_t|. Its (semismooth) derivative across q_t is g/|q_t|: there
        # κ δs + c δr = 0 with κ = |q_t|/g − 1, a spring of compliance κ/c against which friction turns.
        excess = np.where(slips & (bound > 0.0), size / divisor(bound) - 1.0, 0.0)
        slip = np.where(slips[:, None], direction(tangential), 0.0)
        return ActiveSet(pressure, normal > self.least, slip, bound, excess)

    def sticking(self, closed: np.ndarray, falls: np.ndarray) -> ActiveSet:
        """A first guess: the nodes `closed` (m,), and all of a two-sided law, are closed and stick; others are open.

        Nodes that `falls` (m,) marks have no Coulomb friction: before their body has fallen onto its partner, the
        direction of their slip is unknown.
        """
        none, mt, closed = np.zeros(self.m), len(self.sliding), closed | self.two_sided
        active = ActiveSet(
            none, closed, np.zeros((mt, self.components)), self.slip_bound(none), np.zeros(mt)
        )
        # Coulomb friction slips freely where it has no bound: where the contact is open, or falls open.
        free = (~closed | falls)[self.sliding] & (active.bound == 0.0)
        active.slip[free, 0] = 1.0
        return active

    def linearise(self, active: ActiveSet) -> Tangent:
        """The forces that an active set implies: zero where open, free where sticking, on the bound where slipping."""
        slips, turns = active.slip.any(axis=1), active.bound > 0.0
        # In the turned frames the first tangent points along the slip. Its force follows the pressure, s_t = g(p) +
        # g'(p) (s_ν − p) with the last pressure p; the forces across it stay unknown and turn the friction.
        unknown = np.repeat(~slips[:, None], self.components, axis=1)
        unknown[:, 1:] |= turns[:, None]  # a bound of zero has no friction that turns
        slope = self.slope(active.pressure)
        coupling = np.zeros(self.size)
        given = np.zeros(self.size)
        spring = np.zeros(self.size)
        turn = None
        tangential = slice(self.m, self.size)
        coupling[tangential] = (active.slip * slope[:, None]).ravel()
        given[tangential] = (
            active.slip * (active.bound - slope * active.pressure[self.sliding])[:, None]
        ).ravel()
        if self.components > 1 and slips.any():
            spring[tangential] = np.repeat(active.excess, self.components)
            frames = np.where(slips[:, None, None], across(active.slip), np.eye(self.components))
            # the pressures' identity, then a block for each node
            columns = self.m + np.arange(frames[..., 0].size).reshape(-1, self.components)
            turn = sparse.csr_matrix(
                (
                    np.concatenate([np.ones(self.m), frames.ravel()]),
                    np.concatenate(
                        [np.arange(self.m), np.repeat(columns, self.components, axis=0).ravel()]
                    ),
                    np.concatenate(
                        [np.arange(self.m), self.m + np.arange(0, frames.size + 1, self.components)]
                    ),
                )
            )
        return Tangent(
            np.concatenate([active.closed, unknown.ravel()]) & self.live,
            self.node,
            coupling,
            given,
            spring,
            turn,
        )

    def settle(self, s: np.ndarray, active: ActiveSet) -> np.ndarray:
        """The forces (size,) next to s that obey all bounds exactly, given which nodes are closed and slip."""
        normal, tangential = self.split(s)
        normal = np.where(active.closed, np.maximum(normal, self.least), 0.0)
        g = self.slip_bound(normal)
        # A linear solve leaves slipping nodes on the tangent of the bound; the certificate asks for the bound itself.
        tangential = np.where(
            active.slip.any(axis=1)[:, None], active.slip * g[:, None], shorten(tangential, g)
        )
        # Steps by a model also move what is not live, which is left out.
        return np.concatenate([normal, tangential.ravel()]) * self.live

    def bound_at(self, s: np.ndarray) -> np.ndarray:
        """The slip bound (mt,) under the forces s (size,), tension taken as no pressure."""
        return self.slip_bound(np.maximum(s[: self.m], 0.0))

    def cone(self, bound: np.ndarray) -> Box | Discs:
        """The set of allowed forces while the slip bound stays `bound` (mt,): boxes in the plane, discs in space."""
        free, limit = np.full(self.size, np.inf), np.repeat(bound, self.components)
        if self.components == 1:
            return Box(
                np.concatenate([np.zeros(self.m), -limit]), np.concatenate([free[: self.m], limit])
            )
        lower = np.where(np.arange(self.size) < self.m, 0.0, -free)
        return Discs(lower, free, np.arange(self.m, self.size).reshape(-1, self.components), bound)

    def reaches_bound(self, s: np.ndarray, bound: np.ndarray) -> np.ndarray:
        """Nodes (mt,) whose tangential force lies on the slip bound (mt,), up to rounding."""
        return magnitude(self.split(s)[1]) >= (1.0 - ON_BOUND) * bound

    def closed(self, s: np.ndarray, share: float = 0.0) -> np.ndarray:
        """Nodes (m,) under more pressure than this share of the largest, under the forces s (size,); all nodes of a
        two-sided law, those under tension as well."""
        normal = s[: self.m]
        # "not ≤", so that NaN counts as closed
        return ~(normal <= share * normal.max(initial=0.0)) | self.two_sided

    def misfit(self, gap: np.ndarray) -> float:
        """Largest distance (m) of the gaps (k,) from those that the law allows: the largest overlap, or of a two-sided
        law also the largest opening."""
        overlap = np.max(np.abs(gap) if self.two_sided else -gap, initial=0.0)
        return float(overlap) + 0.0  # 0 for -0, which would be told

    def complementarity(self, normal: np.ndarray, gap: np.ndarray) -> tuple[float, float]:
        """Work Σ s_ν |gap| of the pressure at gaps (N m), and the largest tension (N), of normal forces (m,); zero for
        a two-sided law, which allows any normal force."""
        if self.two_sided:
            return 0.0, 0.0
        return (
            float(np.maximum(normal, 0.0) @ np.abs(gap)),
            float(np.maximum(-normal, 0.0).max(initial=0.0)),
        )

    def violation(self, s: np.ndarray, slip: np.ndarray, stiffness: float) -> float:
        """Largest |P(s_t + ρ u_t) − s_t| (N): forces beyond the bound, slip below it, slip in a wrong direction, by the
        forces s (size,), the slip u_t (mt, d − 1) in metres and a stiffness ρ (N/m)."""
        tangential = self.split(s)[1]
        # The law holds exactly when s_t = P(s_t + ρ u_t) for any ρ > 0, as r_t = −u_t.
        return float(
            magnitude(shorten(tangential + stiffness * slip, self.bound_at(s)) - tangential).max(
                initial=0.0
            )
        )


@dataclass(frozen=True)
class CoulombLaw(Law):
    """g = 𝓕 s_ν, with the coefficient 𝓕 (mt,) at the nodes that slide."""

    name = "coulomb"

    coefficient: np.ndarray

    def slip_bound(self, pressure: np.ndarray) -> np.ndarray:
        return self.coefficient * pressure[self.sliding]

    def under(self, factor: float) -> Law:
        return replace(self, coefficient=factor * self.coefficient)

    def slope(self, pressure: np.ndarray) -> np.ndarray:
        return self.coefficient


@dataclass(frozen=True)
class TrescaLaw(Law):
    """A given bound (mt,) in newtons, also at open nodes, as in the paper."""

    name = "tresca"

    bound: np.ndarray

    def slip_bound(self, pressure: np.ndarray) -> np.ndarray:
        return self.bound

    def under(self, factor: float) -> Law:
        return replace(self, bound=factor * self.bound)


@dataclass(frozen=True)
class BondedLaw(Law):
    """r = 0 whatever the forces, tension included: nodes neither separate nor slide. All stick."""

    name = "bonded"
    least = -np.inf

    def slip_bound(self, pressure: np.ndarray) -> np.ndarray:
        return np.full(len(self.sliding), NO_BOUND)

    def cone(self, bound: np.ndarray) -> Box:
        return Box(np.full(self.size, -np.inf), np.full(self.size, np.inf))


@dataclass(frozen=True)
class GuidedLaw(BondedLaw):
    """r_ν = 0 whatever the normal forces, as in a guide: nodes slide without friction and do not separate."""

    name = "guided"
    frictionless = True  # though bonds have a bound


def law_of(
    friction: Friction,
    xy: np.ndarray,
    arc: np.ndarray,
    area: np.ndarray,
    sliding: np.ndarray,
    kind: str = "unilateral",
    live: np.ndarray | bool = True,
    contact: str = "",
) -> Law:
    """The law of a scene at its contact nodes. Not collective.

        >>> law = law_of(Coulomb(coefficient=0.3), np.zeros((2, 2)), np.zeros(2), np.ones(2), np.arange(2))
        >>> law.project(np.array([100.0, -5.0, 50.0, 8.0])).tolist()  # of q: two normal, two tangential entries (N)
        [100.0, 0.0, 30.0, 0.0]

    Parameters
    ----------
    xy, arc : (m, d) positions, and (m,) arc lengths along the first body (m)
    area : (m,) nodal lengths or areas, with which a slip-bound stress becomes a force
    sliding : (mt,) the nodes that carry tangential forces
    kind : "unilateral", or "bonded" or "guided", which ignore `friction`
    live : of a `Law`
    contact : the name, for messages

    Raises InputError where a formula is negative or not finite.
    """

    def values(value: Any) -> np.ndarray:
        given, _ = at_times(value)
        if isinstance(given, Profile):
            return given.at(xy, arc)[sliding].astype(float)
        at_nodes = values_at(given, xy, f"contact.{contact}.friction")
        if (at_nodes < 0.0).any():
            k = int(np.argmin(at_nodes))
            raise InputError(
                f'contact.{contact}.friction: the formula "{given}" is {at_nodes[k]:.3g} at {in_words(xy[k])}; '
                "friction is not negative"
            )
        return at_nodes[sliding]

    shape, moves = (len(area), sliding, xy.shape[1] - 1), np.asarray(live)
    if kind != "unilateral":
        return (BondedLaw if kind == "bonded" else GuidedLaw)(*shape, live=moves)
    if isinstance(friction, Coulomb):
        return CoulombLaw(*shape, values(friction.coefficient), live=moves)
    if isinstance(friction, Tresca):
        return TrescaLaw(*shape, values(friction.slip_bound) * area[sliding], live=moves)
    return Law(*shape, live=moves)


def direction(vectors: np.ndarray) -> np.ndarray:
    """v / |v| (k, c); the first axis where v is zero."""
    size = magnitude(vectors)[:, None]
    return np.where(size > 0.0, vectors / divisor(size), np.eye(1, vectors.shape[1]))


def across(directions: np.ndarray) -> np.ndarray:
    """Orthogonal matrices (k, c, c) whose first columns are unit vectors (k, c), up to the sign: Householder's."""
    u = directions.copy()
    u[:, 0] += np.where(u[:, 0] < 0.0, -1.0, 1.0)
    size = 1.0 + np.abs(directions[:, :1, None])
    return np.eye(u.shape[1]) - u[:, :, None] * u[:, None, :] / size
