"""What happens at the contact nodes of an interface: forces, gap, slip, status."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from ddmpi.body.rigid_motions import rigid_motions
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import ON_BOUND, Law
from ddmpi.interface.utilisation import largest_factor
from ddmpi.sets import magnitude
from ddmpi.system.numbers import (
    ALIKE,
    ROUNDING,
    SAME,
    RigidMotion,
    divisor,
    moment,
    place_of_largest,
    without,
)

RESULTANTS = (
    "force",
    "moment",
    "normal_force",
    "tangential_force",
    "open",
    "slip",
    "stick",
    "dissipated",
    "utilisation",
)
"""The entries of `ContactTotals` that are written at every load step."""


RESOLVED = 1e-10
"""Resultants of a contact below this fraction of the sum of its nodes' forces are rounding, and zero."""


class ContactTotals(NamedTuple):
    """Resultants and extremes of a contact, which ranks send each other; they do not grow with the number of nodes.

    Attributes
    ----------
    force, moment, dissipated, utilisation, moment_imbalance : as of a `ContactState`
    normal_force, tangential_force : sums over the nodes along n and t (N); in space the length of the sum of the
        tangential vectors, as nodes have no common t
    open, slip, stick : numbers of nodes
    bodies, m, law, slave : of the interface; the law by its name
    rigid : motion of the rigid partner; None if there is none
    pressure_max : largest normal stress of a node (Pa); NaN where the contact has no area
    pressure_mean : the normal force over the area of all nodes (Pa); NaN where the contact has no area
    pressure_max_at : (d,) where, as `place_of_largest` (m); None where there is no stress
    normal_max, normal_sum : of the sizes of the nodes' normal forces (N)
    acting : sum of the sizes of the components of the nodes' forces (N)
    opening : smallest gap at and between the nodes (m)
    moved : largest change of the gap at a node (m)
    closed : length, in space area, of the nodes that are not open
    pretension : of a bond that has one: force on the first body along its direction (N), and offset (m)
    """

    force: np.ndarray
    moment: np.ndarray
    normal_force: float
    tangential_force: float
    open: int
    slip: int
    stick: int
    dissipated: float
    utilisation: float
    bodies: tuple[str, str]
    m: int
    law: str
    slave: str | None
    rigid: RigidMotion | None
    pressure_max: float
    pressure_max_at: np.ndarray | None
    pressure_mean: float
    normal_max: float
    normal_sum: float
    acting: float
    opening: float
    moved: float
    closed: float
    moment_imbalance: tuple[float, float]
    pretension: dict[str, float] | None

    @property
    def resultants(self) -> dict[str, Any]:
        """The entries that are written at every load step."""
        return {name: getattr(self, name) for name in RESULTANTS} | (
            {"pretension": self.pretension} if self.pretension else {}
        )

    @property
    def deepest(self) -> float:
        """The largest overlap (m); zero if there is none."""
        return max(0.0, -self.opening)


Rows = Mapping[str, Mapping[str, np.ndarray]]
"""By contact the arrays of `rows_of`, or some of them."""


@dataclass(frozen=True)
class ContactState:
    """The state of an interface. Forces and directions are those of its first body.

        >>> contact = ddmpi.solve("configs/punch.toml").contacts["punch-base"]
        >>> contact.count("slip"), round(contact.resultants["normal_force"], 2), contact.pressure.shape
        (5, 1362.52, (41,))

    Attributes
    ----------
    interface : interface.xy (m, d) are the nodes, interface.area (m,) their lengths, in space areas
    normal_force : (m,) positive under pressure, negative under tension, which bonded nodes may bear (N)
    tangential_force : (m, d − 1) along t; zero at nodes without tangential unknowns (N)
    gap : (m,) opening (m)
    slip : (m, d − 1) how far the first body has moved along t past the second, in this load step (m); zero where a
        support of both bodies leaves no tangential unknown
    status : (m,) "open", "slip" or "stick"
    between : (q,) opening at the probes of the interface (m), see `Interface`
    before : (m, d − 1) slip of the load steps before (m)
    yielding : largest displacement of the bodies at their contacts by contact forces (m)
    resistance : (m,) mean of the slip bounds at the beginning and the end of the load step where the node slips and has
        a bound; zero elsewhere (N)
    """

    interface: Interface
    normal_force: np.ndarray
    tangential_force: np.ndarray
    gap: np.ndarray
    slip: np.ndarray
    status: np.ndarray
    between: np.ndarray = field(default_factory=lambda: np.empty(0))
    before: np.ndarray | float = 0.0
    yielding: float = 0.0
    resistance: np.ndarray | float = 0.0

    def __repr__(self) -> str:
        return f"ContactState({self.interface.name}, {len(self.gap)} nodes)"

    @property
    def closure(self) -> np.ndarray:
        """(m,) by how far a soft joint is closed under its forces (m); zero of a hard one."""
        slope, offset = self.interface.softness(self.normal_force)
        return slope * self.normal_force + offset

    @property
    def slip_total(self) -> np.ndarray:
        """(m, d − 1) slip of all load steps (m)."""
        return self.slip + self.before

    @property
    def dissipated(self) -> float:
        """Frictional work of the load step, Σ ½ (g_n + g_n−1) |u_t| over the nodes that slip (J).

        It is exact where slip and slip bound g grow in proportion from zero, and where the bound is constant. The slip
        of sticking nodes is an error of the iteration, and is left out. In the plane per metre of depth.
        """
        return float((self.resistance * magnitude(self.slip)).sum())

    @property
    def slip_bound(self) -> np.ndarray:
        """(m,) the bound on the tangential force under the pressure of the node (N); 0 without friction, as of bonds."""
        law, bound = self.interface.law, np.zeros(len(self.gap))
        if not (law.frictionless or law.two_sided):
            bound[law.sliding] = law.slip_bound(np.maximum(self.normal_force, 0.0))
        return bound

    @property
    def utilised(self) -> np.ndarray:
        """(m,) the tangential force over its bound, from 0 to 1; 0 where there is no bound."""
        bound = self.slip_bound
        return magnitude(self.tangential_force) * (bound > 0.0) / divisor(bound)

    @property
    def utilisation(self) -> float:
        """1/α with the largest α for which friction within the nodes' present bounds has α times the force and moment
        of this one, around an axis the axial force: 1 where the contact slips as a whole, 0 where it is rounding. NaN
        without friction or load, and where friction cannot act along the axis.

        Many nodes may slip while the contact is far from slipping. It says nothing of bounds under other loads.
        """
        interface, bound = self.interface, self.slip_bound
        sliding = interface.sliding[bound[interface.sliding] > 0.0]
        if not len(sliding):
            return np.nan
        bound, places = bound[sliding, None], interface.places[sliding]
        centre = (bound * places).sum(axis=0) / bound.sum()
        far = float(magnitude(places - centre).max())
        motions = rigid_motions(places, centre, far or 1.0)
        if interface.axisymmetric:
            motions = motions[..., 1:2]  # along the axis
        tangents = np.zeros_like(interface.tangents)
        tangents[interface.sliding] = interface.directions[interface.m :].reshape(
            -1, *tangents.shape[1:]
        )
        powers = bound[..., None] / bound.max() * (tangents[sliding] @ motions)
        if np.abs(powers).max() <= SAME:  # around an axis, of a plane across it
            return np.nan
        share = 1.0 / largest_factor(powers, self.tangential_force[sliding] / bound)
        return share if share > SAME else 0.0

    @property
    def pressure(self) -> np.ndarray:
        """(m,) normal stress (Pa); NaN where the contact has no area."""
        return self.normal_force / _areas(self.interface)

    @property
    def shear(self) -> np.ndarray:
        """(m, d − 1) tangential stress (Pa); NaN where the contact has no area."""
        return self.tangential_force / _areas(self.interface)[:, None]

    @property
    def forces(self) -> np.ndarray:
        """(m, d) force on the first body at each node (N): −(s_ν ν + s_t t)."""
        components = np.column_stack([self.normal_force, self.tangential_force])
        return -np.einsum("mc,mcd->md", components, self.interface.frame)

    def along(self, components: np.ndarray) -> np.ndarray:
        """(m, d) vectors of tangential components (m, d − 1)."""
        return np.einsum("mc,mcd->md", components, self.interface.tangents)

    @property
    def force(self) -> np.ndarray:
        """(d,) resultant of the forces on the first body (N)."""
        return self.forces.sum(axis=0)

    @property
    def moment(self) -> np.ndarray:
        """Moment on the first body about the origin (N m): in the plane x F_y − y F_x (), in space (3,)."""
        interface = self.interface
        return moment(interface.places, self.forces, interface.axisymmetric)

    @property
    def moment_imbalance(self) -> tuple[float, float]:
        """Sum of the moments on both bodies, and its bound Σ |arm| |force| (N m).

        Opposite forces act at points that are apart by the gap and, on curved non-matching sides, by the distance of
        the arcs from their chords.
        """
        if self.interface.axisymmetric:
            return 0.0, 0.0
        first, second = self.interface.geometry.at
        arm = without(second - first, ROUNDING * float(np.abs(first).max(initial=0.0)))
        bound = magnitude(arm) @ magnitude(self.forces)
        return float(np.linalg.norm(moment(arm, self.forces))), float(bound)

    def table(self) -> np.ndarray:
        """A structured array (l,) with the columns of contact_NAME.csv, a row for each contact node.

            >>> table = ddmpi.solve("configs/punch.toml").contacts["punch-base"].table()
            >>> table.dtype.names[:5], len(table), round(table["normal_force"].sum(), 2)
            (('x', 'y', 'nx', 'ny', 'length'), 41, 1362.52)

        ``pandas.DataFrame(table)`` takes it. Nodes that share a row share its forces. Not collective.
        """
        interface, lines = self.interface, self.interface.lines
        normal, tangential = self.normal_force, signed(self.tangential_force)
        columns = dict(zip("xyz", lines.acting.T, strict=False))
        columns |= zip(("nx", "ny", "nz"), interface.normal[lines.row].T, strict=False)
        solid = "nz" in columns
        columns["area" if solid or interface.axisymmetric else "length"] = lines.area
        columns |= {
            "normal_force": normal[lines.row] * interface.shares,
            "tangential_force": tangential[lines.row] * interface.shares,
        }
        columns |= {
            name: values[lines.row]
            for name, values in (
                ("normal_stress", self.pressure),
                ("tangential_stress", signed(self.shear)),
                ("gap", self.gap),
                ("slip", signed(self.slip)),
                ("slip_total", signed(self.slip_total)),
                ("status", self.status),
            )
        }
        if solid:
            # Adding 0.0 makes −0.0 a zero.
            forces = self.forces[lines.row].T * interface.shares + 0.0
            slip = self.along(self.slip)[lines.row].T + 0.0
            columns |= zip(
                ("force_x", "force_y", "force_z", "slip_x", "slip_y", "slip_z"),
                (*forces, *slip),
                strict=True,
            )
        columns["utilisation"] = self.utilised[lines.row]
        table = np.empty(len(lines.row), [(name, values.dtype) for name, values in columns.items()])
        for name, values in columns.items():
            table[name] = values
        return table

    @property
    def totals(self) -> ContactTotals:
        """Resultants and extremes of the contact."""
        interface, tangential = self.interface, self.tangential_force
        partner, normal = interface.partner, np.abs(self.normal_force)
        acting = float(np.abs(self.forces).sum())
        arm, least = float(np.abs(interface.places).max(initial=0.0)), RESOLVED * acting
        pressed = float(without(self.normal_force.sum(), least))
        total = (
            tangential.sum()
            if interface.dimension == 2
            else np.linalg.norm(self.along(tangential).sum(axis=0))
        )
        return ContactTotals(
            without(self.force, least),
            without(self.moment, least * arm),
            pressed,
            float(without(np.asarray(total), least)),
            self.count("open"),
            self.count("slip"),
            self.count("stick"),
            self.dissipated,
            self.utilisation,
            interface.bodies,
            interface.m,
            interface.law.name,
            interface.slave,
            partner.motion if interface.on_rigid else None,
            float(self.pressure.max(initial=-np.inf if interface.m else 0.0)),
            place_of_largest(self.pressure[interface.lines.row], interface.lines.acting),
            float(pressed / (_areas(interface).sum() or np.nan)),
            float(normal.max(initial=0.0)),
            float(normal.sum()),
            acting,
            float(self.between.min(initial=self.gap.min(initial=np.inf))),
            float(np.abs(interface.opening - self.gap).max(initial=0.0)),
            float(interface.area[self.status != "open"].sum()),
            self.moment_imbalance,
            {"force": float(self.force @ partner.pull), "offset": partner.offset}
            if len(partner.pull)
            else None,
        )

    @property
    def deepest(self) -> float:
        """The largest overlap at and between the nodes (m); between nodes it is an error of the discretization."""
        return self.totals.deepest

    @property
    def resultants(self) -> dict[str, Any]:
        """By name: force, moment, sums of the nodes' forces (N), numbers of nodes by status, dissipated (J), and
        utilisation."""
        return self.totals.resultants

    def count(self, status: str) -> int:
        return int((self.status == status).sum())


class Answered(Protocol):
    """An answer: displacements (nv, d) of this rank's bodies (m), the states of contacts that it owns, and the totals of
    contacts, on the first rank of all, by name."""

    @property
    def displacements(self) -> dict[str, np.ndarray]: ...

    @property
    def states(self) -> dict[str, ContactState]: ...

    @property
    def contacts(self) -> dict[str, ContactTotals]: ...


def _areas(interface: Interface) -> np.ndarray:
    """(m,) nodal lengths or areas of stresses (m or m²): NaN where bodies meet along edges or at vertices only."""
    return np.full(interface.m, np.nan) if interface.geometry.pointwise else interface.area


def contact_state(
    interface: Interface,
    s: np.ndarray,
    bound: np.ndarray,
    u: np.ndarray,
    between: np.ndarray | None = None,
    since: tuple[np.ndarray, np.ndarray] | None = None,
    yielding: float = 0.0,
    slides: tuple[np.ndarray, np.ndarray | float] | None = None,
) -> ContactState:
    """The state of the contact nodes. Not collective.

    Parameters
    ----------
    s : (size,) contact forces that obey the bounds (N)
    bound : (mt,) their slip bound (N)
    u : (size,) relative displacement, the sum of both bodies' traces (m)
    between : (q,) opening at the interface's probes (m), if any
    since : (size,) displacement from which the slip of this load step counts (m), and forces at its beginning (N);
        zero if left out
    yielding : as of a `ContactState`
    slides : of a contact without friction, whose u has no tangential entries: displacement of the first body along t
        past the second (m, d − 1), now and at the beginning of the load step (m)
    """
    law, m, sliding = interface.law, interface.m, interface.sliding
    none = np.zeros(interface.size)
    start, former = since or (none, none)
    slip, before = law.along(u), law.along(start)
    slip -= before
    if slides:
        before[:] = slides[1]
        slip = slides[0] - before
    # nodes without tangential unknowns stick, or slip if the contact has no friction; open nodes are neither
    status = np.full(m, "slip" if law.frictionless else "stick", dtype="U5")
    resistance = np.zeros(m)
    slips, closed = law.reaches_bound(s, bound), law.closed(s, ON_BOUND)
    status[sliding[slips]] = "slip"
    status[~closed] = "open"
    # trapezoidal rule for ∫ g d|u_t|; an open node dissipates only under a bound that needs no pressure, as Tresca's
    slips &= closed[sliding] | (law.bound_at(none) > 0.0)
    resistance[sliding[slips]] = (
        0.5 * bound[slips] + 0.5 * (interface.former or law).bound_at(former)[slips]
    )
    return ContactState(
        interface,
        s[:m].copy(),
        law.along(s),
        interface.opening - u[:m],
        slip,
        status,
        np.empty(0) if between is None else between,
        before,
        yielding,
        resistance,
    )


def slip_start(
    law: Law, s: np.ndarray, closed: np.ndarray, rate: np.ndarray, ahead: float
) -> np.ndarray:
    """The displacement from which slip counts in the next load step (size,), tangential entries only (m).

    It is the displacement at the end of the last step, also at open nodes. An open node without a slip bound begins to
    slip where it touches, if its gap goes on closing at the rate of the last step. Not collective.

    Parameters
    ----------
    s : (size,) forces at the end of the last load step (N)
    closed : (size,) relative displacements at that time, less the initial gaps (m)
    rate : (size,) their change in the last load step (m)
    ahead : length of the next load step over that of the last one; zero where the loads change in another way
    """
    start = np.zeros(law.size)
    if law.name == "bonded":  # nothing slides
        return start
    share = touching(law, s, closed, rate, ahead)
    law.split(start)[1][:] = law.split(closed)[1] + share[:, None] * law.split(rate)[1]
    return start


def touching(
    law: Law, s: np.ndarray, closed: np.ndarray, rate: np.ndarray, ahead: float
) -> np.ndarray:
    """The share (mt,) of a load step like the last one after which a sliding node touches, at most `ahead`; zero where
    it does not close, or has friction. Otherwise as `slip_start`."""
    # Touching-time correction: by the time that a node touches, after the share gap / closing of a step, it has moved
    # tangentially by that share. Without this, steps in which the contact grows converge only like n^−½.
    (normal, _), (closing, sliding) = law.split(closed), law.split(rate)
    gap, closing = -normal[law.sliding], closing[law.sliding]
    closes = closing > ALIKE * magnitude(sliding)  # beyond rounding
    touches = (law.bound_at(s) == 0.0) & (gap > 0.0) & closes
    share = np.zeros(len(law.sliding))
    share[touches] = np.minimum(gap[touches] / closing[touches], ahead)
    return share


def slip_start_change(
    law: Law, s: np.ndarray, closed: np.ndarray, rate: np.ndarray, ahead: float
) -> np.ndarray:
    """The derivative (size,) of `slip_start`, from `closed` and `rate` (2, size), each with its derivative. Not
    collective."""
    change = np.zeros(law.size)
    if law.name == "bonded":
        return change
    share = touching(law, s, closed[0], rate[0], ahead)
    (dn, dt), (dclosing, dsliding) = law.split(closed[1]), law.split(rate[1])
    closing, sliding = law.split(rate[0])
    # share = gap / closing with gap = −closed; a node that does not touch before the next step ends has share = ahead
    inner = (share > 0.0) & (share < ahead)
    rates = np.where(inner, closing[law.sliding], 1.0)
    dshare = np.where(inner, -(dn[law.sliding] + share * dclosing[law.sliding]) / rates, 0.0)
    law.split(change)[1][:] = dt + dshare[:, None] * sliding + share[:, None] * dsliding
    return change


def signed(components: np.ndarray) -> np.ndarray:
    """(m,) the tangential component of (m, 1) in the plane; in space the length of the vector (m, 2)."""
    return components[:, 0] if components.shape[1] == 1 else magnitude(components)


def rows_of(state: ContactState) -> dict[str, np.ndarray]:
    """The rows of a contact for the next step: slave nodes; forces along normal and tangents (N); the slip so far (m);
    the forces on the first body (N), and the places where they act on both (m); the sum of slip bounds (N)."""
    one, other = state.interface.geometry.at
    law = state.interface.law
    s = np.concatenate([state.normal_force, state.tangential_force[law.sliding].ravel()])
    return forces_by_node(state.interface, s) | {
        "slip": state.slip_total,
        "forces": state.forces,
        "first": one,
        "second": other,
        "bound": np.array([law.bound_at(s).sum()]),
    }


def forces_by_node(interface: Interface, s: np.ndarray) -> dict[str, np.ndarray]:
    """The forces s (size,) of the rows of a contact, in the form of `rows_of`."""
    return {
        "node": interface.geometry.stands,
        "normal": s[: interface.m, None],
        "tangential": interface.law.along(s),
    }


def values_by_node(interface: Interface, contacts: Rows, what: str) -> np.ndarray:
    """Values (m, ·) of earlier rows at the slave's nodes of the rows of `interface`; zero where there was none."""
    number, rows = interface.geometry.stands, contacts.get(interface.name)
    if rows is None or not len(rows["node"]):
        return np.zeros((interface.m, 1 if what == "normal" else interface.dimension - 1))
    whole = np.zeros((max(number.max(initial=0), rows["node"].max()) + 1, rows[what].shape[1]))
    whole[rows["node"]] = rows[what]
    return whole[number]
