"""Types of one contact, with its sides and laws, and of rigid partners, which are surfaces."""

import math
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

import msgspec
import numpy as np
from msgspec.structs import force_setattr

from ddmpi.scene.motions import Image, Motions
from ddmpi.scene.values import (
    WHERE,
    Formula,
    Misplaced,
    Name,
    NonNegative,
    Number,
    On,
    Point,
    Positive,
    Table,
    joined,
    no_z,
)
from ddmpi.system.numbers import ALIKE, divisor, nearest_in

SQUASHED = 1e-6
"""The search for the nearest point to an axis scales lengths along the axis by this."""

WHOLE = 1.5
"""A rigid circle is drawn as a whole if bodies may touch it over more than this angle (rad)."""


class Profile(Table, frozen=True, kw_only=True):
    """A number that varies along the contact: linear between points, constant beyond the first and the last.

    With { along = "x", points = [0, 1, 1, 3], values = [0.1, 0.1, 0.3, 0.3] } it jumps from 0.1 to 0.3 at x = 1.

    The arc length is measured along the first body's boundary in `on`, from its start, with the body to the left:
    counterclockwise around a body, clockwise around a hole. Separate pieces of a boundary have separate starts. A
    closed boundary starts where its mesh does: at the angle where a ring begins, and in files and geometries where the
    first line of the group begins. Clamps and the choice of the slave make no difference: nodes of the second body have
    the arc length of the point that they face.

    Attributes
    ----------
    along : a coordinate, or in the plane the arc length along the first body's boundary
    points : values of it in ascending order; a repeated point is a jump
    values : the number at each point
    """

    along: Literal["x", "y", "z", "arc"] = "x"
    points: list[Number]
    values: list[NonNegative]

    def __post_init__(self) -> None:
        if len(self.points) != len(self.values) or not self.points:
            raise ValueError(
                f"points and values must be equally many, at least one; "
                f"got {len(self.points)} points and {len(self.values)} values"
            )
        if any(b < a for a, b in zip(self.points, self.points[1:], strict=False)):
            raise ValueError("points must ascend (a repeated point is a jump)")

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        if self.along == "arc":
            yield 2, "along", 'surfaces have no arc length; take a coordinate, such as along = "x"'
        if self.along == "z":
            yield 3, "along", no_z(axisymmetric)

    def position(self, xy: np.ndarray, arc: np.ndarray) -> np.ndarray:
        """Positions (m,) of the contact nodes `xy` (m, d) on the profile, with arc lengths `arc` (m,)."""
        return arc if self.along == "arc" else xy[:, "xyz".index(self.along)]

    def at(self, xy: np.ndarray, arc: np.ndarray) -> np.ndarray:
        """Values (m,) at the contact nodes `xy` (m, d) with arc lengths `arc` (m,)."""
        return np.interp(self.position(xy, arc), self.points, self.values)


class SignedProfile(Profile, frozen=True, kw_only=True):
    """A profile whose values may be negative.

    Attributes
    ----------
    values : the number at each point
    """

    values: list[Number]


class Varying(Profile, frozen=True, kw_only=True):
    """A profile along the contact, or a ``value``, which may follow a history.

    Attributes
    ----------
    points, values : of the profile
    value : a number, a formula or a profile, in place of points and values
    history : [history.NAME] whose factor multiplies the value
    """

    points: list[Number] = []
    values: list[NonNegative] = []
    value: NonNegative | Formula | Profile | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        if self.value is None:
            super().__post_init__()
        elif self.points or self.values:
            raise ValueError(
                "value does not go with points and values; write them into it, as in value = "
                "{ points = […], values = […] }"
            )
        if self.value is None and self.history is not None:
            raise ValueError('what has a history has a value: write { value = …, history = "…" }')


class Gap(Varying, frozen=True, kw_only=True):
    """An initial gap: a profile along the contact, or a ``value``, which may follow a history.

    Attributes
    ----------
    points, values : of the profile
    value : a number, a formula or a profile, in place of points and values
    history : [history.NAME] whose factor multiplies the value
    """

    values: list[Number] = []
    value: Number | Formula | SignedProfile | None = None


def at_times(given: Any) -> tuple[Any, str | None]:
    """What varies in place, and its history."""
    if isinstance(given, Varying) and given.value is not None:
        return given.value, given.history
    return given, None


class Closure(Table, frozen=True, kw_only=True):
    """How far the sides of a soft joint close under pressure: linear between points, beyond the last as before it.

    Attributes
    ----------
    pressure : (Pa) ascending from 0
    closure : at each (m), ascending from 0; the joint must not get softer under pressure
    """

    pressure: list[NonNegative]
    closure: list[NonNegative]

    def __post_init__(self) -> None:
        p = np.array(self.pressure)
        w = np.array(self.closure)
        if len(p) != len(w) or len(p) < 2 or p[0] or w[0]:
            raise ValueError(
                "pressure and closure are equally many numbers, at least two, from 0 on"
            )
        if (np.diff(p) <= 0.0).any() or (np.diff(w) < 0.0).any():
            raise ValueError("pressure and closure must ascend")
        slopes = np.diff(w) / np.diff(p)
        if softer := np.flatnonzero(slopes[1:] > (1.0 + ALIKE) * slopes[:-1]).tolist():
            raise ValueError(
                f"beyond a pressure of {p[softer[0] + 1]:g} the joint gets softer; Newton's method is "
                "certain only of joints that get stiffer under pressure"
            )

    def tangent(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """a (m, m/Pa) and b (m,) of the closure a p + b near these pressures (m,)."""
        p = np.array(self.pressure)
        w = np.array(self.closure)
        k = np.clip(np.searchsorted(p, pressure, side="right") - 1, 0, len(p) - 2)
        slope = (np.diff(w) / np.diff(p))[k]
        return slope, w[k] - slope * p[k]

    def stored(self, pressure: np.ndarray) -> np.ndarray:
        """The energy ∫ p dw (J/m²) under pressures (m,)."""
        p = np.array(self.pressure)
        w = np.array(self.closure)
        before = np.append(0.0, np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(w)))
        k = np.clip(np.searchsorted(p, pressure, side="right") - 1, 0, len(p) - 2)
        slope, offset = self.tangent(pressure)
        return before[k] + 0.5 * (p[k] + pressure) * (slope * pressure + offset - w[k])


class Pretension(Table, frozen=True, kw_only=True):
    """The force of a bolt: it is given while its history goes on; after that the bond keeps its offset.

    Attributes
    ----------
    force : on the first body, along ``along`` (N, in the plane per unit of depth, around an axis of the whole
        circumference); positive pulls it towards where ``along`` points; left out, nothing but a check can be done
    along : direction of the force and of the offset, of any length
    history : [history.NAME] whose factor multiplies the force until its last time, from which on the offset stays;
        left out, the force is given throughout
    """

    force: Number | None = None
    along: Point
    history: Name | None = None

    def __post_init__(self) -> None:
        if not any(self.along):
            raise ValueError(
                "along must not be zero; it is the direction in which the bond is pulled"
            )


class Coulomb(Table, frozen=True, kw_only=True, tag_field="law", tag="coulomb"):
    """Friction with the slip bound coefficient × contact pressure.

    Attributes
    ----------
    coefficient : of friction, a number, a formula, a profile, or a value with a history
    """

    coefficient: NonNegative | Formula | Varying


class Tresca(Table, frozen=True, kw_only=True, tag_field="law", tag="tresca"):
    """Friction with a given slip bound at every contact node, open or closed (as in the slides).

    Attributes
    ----------
    slip_bound : a stress (Pa), a number, a formula, a profile, or a value with a history
    """

    slip_bound: NonNegative | Formula | Varying


class NoFriction(Table, frozen=True, kw_only=True, tag_field="law", tag="none"):
    """No friction: there are no tangential forces."""


def tag_of(kind: type[Table]) -> str:
    """How scenes name one of several kinds of a table."""
    return str(kind.__struct_config__.tag)


Friction = Coulomb | Tresca | NoFriction

LAWS = {tag_of(law): {"law", *law.__struct_fields__} for law in get_args(Friction)}
"""The keys of each law of friction."""


PAIR = "first", "second"
"""The sides of a contact of a body with itself; and the bodies of an interface that others have in common."""


class ContactSpec(Table, frozen=True, kw_only=True):
    """Two bodies that may touch, two sides of one body, or a body and a rigid partner. Their meshes need not match;
    either side may be larger.

    Attributes
    ----------
    name : unique among contacts; left out, the names in bodies with a dash between
    bodies : two bodies, a body and then a rigid partner, or one body twice, as that of a crack or of two ears; normals
        and forces of the results are the first one's
    on : a boundary group of each side, so only one if the partner is rigid: ["sole", "top"]; faces of a drawing
        by number, or by what they are, are groups, and so are several of them in a list: [[5, 8], "plane at (0, 0, 2)"]
    kind : "bonded" sides neither separate nor slide; "guided" ones do not separate and slide without friction, as a
        face in a guide: normal forces have both signs
    friction : law of friction; left out, none
    gap : initial gap along the normal (m), positive open, negative an interference, as in -1e-5 or { value = -1e-5,
        history = "fit" }; left out, it is measured, on curved sides between the arcs over their chords
    pairing : "nodes" or "mortar"; left out, by nodes if those of both sides match, else by dual mortar
    pretension : of a bolt that a bond cuts through its shank, or of its thread: the force that pulls the first body
        along a direction, by one offset of the whole bond
    slave : with mortar, the body whose nodes carry the forces, "first" or "second" side of one body; left out, that of
        larger node spacing over E/(1 − ν²)
    softness : of a gasket or of rough faces: closure per pressure (m/Pa), or a table of both; left out, none
    image : where the second side stands that the first one faces, as the other end of a sector or of a periodic cell
    """

    name: Name | None = None
    bodies: tuple[Name, Name]
    on: Annotated[tuple[On, ...], msgspec.Meta(min_length=1, max_length=2)]
    kind: Literal["unilateral", "bonded", "guided"] = "unilateral"
    friction: Friction = NoFriction()
    gap: Number | Formula | Gap | None = None
    pairing: Literal["nodes", "mortar"] | None = None
    slave: Name | None = None
    pretension: Pretension | None = None
    softness: NonNegative | Closure | None = None
    image: Image | None = None

    def __post_init__(self) -> None:
        force_setattr(self, "on", tuple(map(joined, self.on)))
        if self.pretension and self.kind != "bonded":
            raise ValueError(
                f'pretension goes with kind = "bonded", a bond that is pulled as a whole; this contact is '
                f"{self.kind}"
            )
        if self.two_sided and not isinstance(self.friction, NoFriction):
            raise ValueError(
                f'friction does not go with kind = "{self.kind}"; leave one of them out'
            )
        if self.softness and self.two_sided:
            raise ValueError(
                f'softness does not go with kind = "{self.kind}", whose sides do not close; leave one of them out'
            )
        if self.slave is not None and self.pairing == "nodes":
            raise ValueError(
                'slave does not go with pairing = "nodes", which has none; leave one of them out'
            )

    @property
    def two_sided(self) -> bool:
        """Whether normal forces have both signs, so that the sides do not separate."""
        return self.kind != "unilateral"

    @property
    def opening(self) -> tuple[Number | Formula | SignedProfile | None, str | None]:
        """The given gap, or None, and its history."""
        return at_times(self.gap)

    @property
    def rubbing(self) -> tuple[NonNegative | Formula | Profile, str | None]:
        """The coefficient of friction or the slip bound, 0 without friction, and its history."""
        if isinstance(self.friction, NoFriction):
            return 0.0, None
        return at_times(*msgspec.structs.astuple(self.friction))

    @property
    def itself(self) -> bool:
        """Whether both sides are of one body."""
        return self.bodies[0] == self.bodies[1]

    @property
    def roles(self) -> tuple[str, str]:
        """What `slave` calls both sides: their bodies, of one body "first" and "second"."""
        return PAIR if self.itself else self.bodies

    @property
    def layer(self) -> Closure | None:
        """The law of a soft joint; None of a hard one."""
        if isinstance(self.softness, float | int):
            closure = Closure(pressure=[0.0, 1.0], closure=[0.0, self.softness])
            return closure if self.softness else None
        return self.softness

    @property
    def called(self) -> str:
        """The name; by default the bodies' names with a dash."""
        return self.name or default_name(self.bodies)


class SettledContact(ContactSpec, frozen=True, kw_only=True):
    """A contact without optional keys, but for those that are not given."""

    name: Name


def default_name(bodies: tuple[str, ...] | list[str]) -> str:
    """The default name of a contact between `bodies`."""
    return "-".join(bodies)


def both_sides(bodies: tuple[str, str]) -> str:
    """What faces each other at a contact, in words."""
    return " and ".join(bodies) if bodies[0] != bodies[1] else f"two sides of {bodies[0]}"


Axis = Literal["x", "y", "z"]


Facing = tuple[np.ndarray, np.ndarray]
"""Unit normals (…, d) of a surface, and distances (…) along them (m)."""


class RigidSurface(Table, frozen=True, kw_only=True, tag_field="shape"):
    """A rigid surface, which bodies touch from one side. Subclasses are shapes; other rooms use their methods only.

    Attributes
    ----------
    name : unique among bodies and rigid partners
    displacement : prescribed displacement (m); left out, zero
    force : force (N) along the axes on which it is not 0; along the others the displacement is prescribed
    free : axes along which it moves freely if no force acts on it, as in ["x"]; left out, none. But a partner with a
        bonded contact that turns under a moment or a force, and has no displacement, is free along all axes: forces and
        moment are then all that acts on the bonded face from outside
    moment : moment (N m) that turns it about the pivot, in space [x, y, z]
    turns : whether it turns, also without a moment; otherwise only with one
    pivot : the point about which it turns by small angles; displacement and force are those of this point (m)
    history : [history.NAME] whose factor multiplies displacement, force and moment
    motion : with time.motions = "far", a motion of any size, or several one after the other, instead of displacement
    """

    name: Name
    displacement: Point | None = None
    force: Point | None = None
    free: list[Axis] | None = None
    moment: Number | Point | None = None
    turns: bool = False
    pivot: Point | None = None
    history: Name | None = None
    motion: Motions | None = None

    only_in: ClassVar[int | None] = None
    """The dimension of a shape that only one dimension has, or None."""

    surface: ClassVar[bool] = True
    """Whether bodies can touch it; without a surface they can be bonded to it alone, along their own normals."""

    turned: ClassVar[str] = ""
    """Advice where the boundary of a body does not face it."""

    crossed: ClassVar[str] = ""
    """End of the advice where a body penetrates it."""

    def __post_init__(self) -> None:
        if self.force is not None and not any(self.force):
            raise ValueError(
                "force must not be zero; leave it out, or the partner moves as displacement says"
            )
        if self.moment is not None and not np.any(self.moment):
            raise ValueError(
                "moment must not be zero; leave it out, or write turns = true: it then turns freely"
            )
        if self.turning and self.pivot is None:
            raise ValueError(
                f"{'turns' if self.moment is None else 'moment'} needs pivot = […], the point about which "
                "the partner turns"
            )
        if self.pivot is not None and not self.turning:
            raise ValueError(
                "pivot goes with a moment, or with turns = true; leave it out where the partner does not "
                "turn"
            )
        self._check_axes()

    def _check_axes(self) -> None:
        """ValueError if it is pushed and moved along the same axis."""
        for axis, moved in enumerate(self.displacement or ()):
            if moved and axis in self.pushed:
                what = "a force" if (self.force or (0.0,) * 3)[axis] else "freedom to move"
                raise ValueError(
                    f"along {'xyz'[axis]} it has both {what} and a displacement; it is pushed or moved, "
                    "so set one of them to 0"
                )

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        if self.only_in:
            shapes = [kind for kind in get_args(Rigid) if kind.surface]
            others = ", ".join(tag_of(kind) for kind in shapes if kind.only_in != self.only_in)
            here = WHERE[self.only_in]
            there = WHERE[5 - self.only_in]
            yield (
                self.only_in,
                "shape",
                f"a {tag_of(type(self))} is a shape {here}; {there} there are {others}",
            )
        if "z" in (self.free or ()):
            yield 3, "free", "there is no z in the plane"
        if isinstance(self.moment, float | int):
            yield 2, "moment", "a moment in space has three components, [x, y, z]"

    @property
    def pushed(self) -> list[int]:
        """The axes along which a force acts on it, or nothing resists it."""
        force = self.force or (0.0,) * 3
        return [
            axis for axis, value in enumerate(force) if value or "xyz"[axis] in (self.free or ())
        ]

    @property
    def turning(self) -> bool:
        """Whether it turns."""
        return self.turns or self.moment is not None

    @property
    def turns_by(self) -> int:
        """The number of its turns: 1 in the plane, 3 in space, 0 if it does not turn."""
        return 2 * len(self.pivot or ()) - 3 if self.turning else 0

    @property
    def yields(self) -> bool:
        """Whether it moves as the forces on it want, along an axis or about the pivot."""
        return bool(self.pushed) or self.turning

    def settled(self, dimension: int, bonded: bool) -> Self:
        """The partner with all defaults; `bonded` if a body is bonded to it."""
        free = self.free
        if (
            free is None
            and bonded
            and self.turning
            and (self.moment or self.force)
            and self.displacement is None
        ):
            # It brings forces to a face, and does not hold it.
            free = list(get_args(Axis)[:dimension])
        return msgspec.structs.replace(
            self, displacement=self.displacement or (0.0,) * dimension, free=free
        )

    def facing(self, points: np.ndarray) -> Facing:
        """Unit normals (…, d), towards the bodies, at the nearest places to points (…, d), and the distances (…) along
        them (m), negative in the solid. A normal is zero where no place is nearest.

            >>> Circle(name="disc", center=(0.0, 1.0), radius=1.0).facing(np.array([[0.0, -0.5]]))
            (array([[ 0., -1.]]), array([0.5]))
        """
        raise NotImplementedError

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Depth (…) of points (…, d) in the solid (m)."""
        return -self.facing(points)[1]

    def deepest(self, simplices: np.ndarray) -> np.ndarray:
        """The deepest places (k, d) of simplices (k, j, d) in the solid: corners, unless the surface is convex."""
        return simplices[np.arange(len(simplices)), np.argmax(self.depth(simplices), axis=1)]

    @property
    def bend(self) -> float:
        """The smallest radius of curvature (m)."""
        return math.inf

    def may_end(self, touched: bool) -> bool:
        """Whether the surface may end before a body that penetrates it, with a contact between both if `touched`."""
        return False

    def outline(self, touched: np.ndarray, bodies: np.ndarray, margin: float) -> np.ndarray:
        """Points (k, 2) of the surface in the plane, for pictures: along nodes (m, 2) that may touch it or those (n, 2)
        of their bodies, which are on the left, and beyond both ends by a margin (m)."""
        raise NotImplementedError


class Plane(RigidSurface, frozen=True, kw_only=True, tag="plane"):
    """A straight rigid surface.

    Attributes
    ----------
    point : any of its points (m)
    normal : points towards the bodies and has any length
    """

    point: Point
    normal: Point

    turned = "a plane's normal points towards the bodies"
    crossed = "; a plane has no end"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.normal):
            raise ValueError("normal must not be zero; it points towards the bodies")

    def facing(self, points: np.ndarray) -> Facing:
        normal = np.array(self.normal) / np.linalg.norm(self.normal)
        return np.zeros_like(points) + normal, (points - self.point) @ normal

    def may_end(self, touched: bool) -> bool:
        return not touched

    def outline(self, touched: np.ndarray, bodies: np.ndarray, margin: float) -> np.ndarray:
        along = np.array([self.normal[1], -self.normal[0]]) / np.linalg.norm(self.normal)
        ends = (bodies - self.point) @ along
        return (
            self.point + np.linspace(ends.min() - margin, ends.max() + margin, 200)[:, None] * along
        )


class Round(RigidSurface, frozen=True, kw_only=True):
    """A rigid surface at a radius around a point or an axis.

    Attributes
    ----------
    radius : its radius (m)
    inside : whether it is hollow, with bodies touching it from inside
    """

    radius: Positive
    inside: bool = False

    turned = "bodies touch what is round from outside, unless inside = true"

    def away(self, points: np.ndarray) -> np.ndarray:
        """Vectors (…, d) to points (…, d) from the centre, or from the nearest places on the axis (m)."""
        raise NotImplementedError

    def across(self, vectors: np.ndarray) -> np.ndarray:
        """The part of vectors (…, d) orthogonal to the axis; without an axis the vectors."""
        return vectors

    def facing(self, points: np.ndarray) -> Facing:
        away = self.away(points)
        sign = -1.0 if self.inside else 1.0
        distance = np.linalg.norm(away, axis=-1)
        return sign * away / divisor(distance)[..., None], sign * (distance - self.radius)

    def deepest(self, simplices: np.ndarray) -> np.ndarray:
        if self.inside:
            return super().deepest(simplices)
        away = self.away(simplices)
        axis = simplices - away  # places nearest to corners on it, or the centre
        middle = axis.mean(axis=1)
        # With lengths along the axis scaled to nearly nothing, the nearest point to the origin is the one nearest to
        # the axis; the scaling is then undone.
        place = nearest_in(np.zeros(away.shape[2]), away + SQUASHED * (axis - middle[:, None]))
        return middle + self.across(place) + (place - self.across(place)) / SQUASHED

    @property
    def bend(self) -> float:
        return self.radius

    def may_end(self, touched: bool) -> bool:
        return self.inside


class Centred(Round, frozen=True, kw_only=True):
    """A rigid surface at a radius around a point.

    Attributes
    ----------
    center : its centre (m)
    """

    center: Point

    def away(self, points: np.ndarray) -> np.ndarray:
        return points - np.array(self.center)


class Circle(Centred, frozen=True, kw_only=True, tag="circle"):
    """A rigid disc that bodies touch from outside, or a bore that they touch from inside; in the plane."""

    only_in = 2

    def outline(self, touched: np.ndarray, bodies: np.ndarray, margin: float) -> np.ndarray:
        angle = np.sort(np.arctan2(*(touched - self.center).T[::-1]))
        holes = np.diff(angle, append=angle[0] + 2 * np.pi)  # the largest one is not touched
        k = int(np.argmax(holes))
        margin = margin / self.radius
        begin = angle[(k + 1) % len(angle)]
        length = 2 * np.pi - holes[k]
        if length + 2 * margin >= WHOLE:
            margin = 0.0
            begin = 0.0
            length = 2 * np.pi
        t = np.linspace(begin - margin, begin + length + margin, 400)[:: 1 if self.inside else -1]
        return self.center + self.radius * np.column_stack([np.cos(t), np.sin(t)])


class Sphere(Centred, frozen=True, kw_only=True, tag="sphere"):
    """A rigid ball that bodies touch from outside, or a hollow that they touch from inside; in space."""

    only_in = 3


class Cylinder(Round, frozen=True, kw_only=True, tag="cylinder"):
    """A rigid shaft that bodies touch from outside, or a bore that they touch from inside; in space, without ends.

    Attributes
    ----------
    point : any point of its axis (m)
    axis : along it, of any length
    """

    point: Point
    axis: Point

    only_in = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.axis):
            raise ValueError("axis must not be zero")

    def away(self, points: np.ndarray) -> np.ndarray:
        return self.across(points - np.array(self.point))

    def across(self, vectors: np.ndarray) -> np.ndarray:
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        return vectors - (vectors @ axis)[..., None] * axis


class Node(RigidSurface, frozen=True, kw_only=True, tag="node"):
    """A reference node: a rigid partner without a surface. All faces of bodies that are bonded to it, whichever way
    they look, move with it as one rigid body; it must have bonds alone."""

    surface = False

    def facing(self, points: np.ndarray) -> Facing:
        return np.zeros_like(points), np.zeros(points.shape[:-1])


Rigid = Plane | Circle | Sphere | Cylinder | Node
