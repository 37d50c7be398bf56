"""Types of motions that take bodies and rigid partners far from where they are drawn, and checks of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from ddmpi.scene.values import Misplaced, Mistakes, Name, Number, Point, Table, no_z
from ddmpi.system.numbers import SAME, Frame, in_words


class Moved(Table, frozen=True, kw_only=True):
    """A turn about a pivot, and then a shift.

    Attributes
    ----------
    shift : along the axes (m); left out, none
    turn : about the pivot, counterclockwise (degrees); left out, none
    pivot : of a turn, in the coordinates of the drawing (m); left out, the origin
    axis : of a turn in space, by the right-hand rule
    """

    shift: Point | None = None
    turn: Number | None = None
    pivot: Point | None = None
    axis: Point | None = None

    def __post_init__(self) -> None:
        if not self.moves:
            raise ValueError(
                "it leads somewhere by a shift (m), as in shift = [0.2, 0.0], or a turn (degrees), as in "
                "turn = 90.0, or both"
            )
        self._check_turn(self.turn is not None)

    @property
    def moves(self) -> bool:
        """Whether a turn or a shift is given."""
        return self.turn is not None or self.shift is not None

    def _check_turn(self, turns: bool) -> None:
        """Raise ValueError for a pivot or an axis of no turn."""
        for key in ("pivot", "axis"):
            if getattr(self, key) is not None and not turns:
                raise ValueError(
                    f"{key} is that of a turn; leave it out, or write turn = … (degrees)"
                )
        if self.axis is not None and not any(self.axis):
            raise ValueError("axis must not be zero; a turn is about it, by the right-hand rule")

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        if self.axis:
            yield 3, "axis", "in the plane turns are in it"
        elif self.turn:
            yield 2, "turn", "a turn in space has an axis, as in axis = [0.0, 0.0, 1.0]"

    def frame(self, factor: float, dimension: int) -> Frame:
        """Where it leads at a factor of its history; nowhere if it is free."""
        shift = np.zeros(dimension) if self.shift is None else factor * np.array(self.shift)
        return Frame.of(shift, factor * (self.turn or 0.0) * self.about, self.pivot)

    @property
    def about(self) -> np.ndarray:
        """The axis of its turn, a unit vector (3,); in the plane (1,)."""
        return np.ones(1) if self.axis is None else np.array(self.axis) / np.linalg.norm(self.axis)


class Copy(Moved, frozen=True, kw_only=True):
    """A body elsewhere with mesh, material and groups of another one, in place of its own; see docs/use/scenes.md.

    Attributes
    ----------
    of : the body that has mesh and material
    """

    of: Name


class Image(Moved, frozen=True, kw_only=True):
    """The second side of a contact where a turn or a shift takes it: of a sector, or of a periodic cell; see
    docs/use/sectors.md.

    Attributes
    ----------
    turn : about the pivot, counterclockwise (degrees); so many of them are a whole turn
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.turn is not None and self.shift is not None:
            raise ValueError("an image is turned or shifted; leave turn or shift out")
        if self.turn is None and not any(self.shift or ()):
            raise ValueError("an image is elsewhere; shift must not be zero")
        if self.turn is not None and not self.sectors:
            count = 360.0 / abs(self.turn) if self.turn else np.inf
            near = round(count) if 1.5 < count < np.inf else 0
            raise ValueError(
                f"turn = {self.turn:g} does not close: 360/{abs(self.turn):g} = {count:.6g} is no number of sectors from "
                "2 on" + (f"; {near} of them turn by {360.0 / near:.12g}" if near else "")
            )

    @property
    def sectors(self) -> int | None:
        """How many of them are a whole turn; None for a shift, and if none are."""
        count = 360.0 / abs(self.turn) if self.turn else 0.0
        closes = (
            count
            and count > 1.5
            and abs(round(count) * abs(self.turn or 0.0) - 360.0) <= 360 * SAME
        )
        return round(count) if closes else None

    def of_one_wheel(self, other: Image) -> bool:
        """Whether both turn about one axis by one angle, or one of them back."""
        d = 3 if self.axis else 2
        if any(
            len(place) != d for each in (self, other) for place in (each.pivot, each.axis) if place
        ):
            return True  # `dimension` says what is wrong
        one = self.frame(1.0, d)
        two = other.frame(1.0, d)
        size = max(np.abs(frame.shift).max() for frame in (one, two))
        return any(
            np.abs(one.turned - frame.turned).max() <= SAME
            and np.abs(one.shift - frame.shift).max() <= SAME * size
            for frame in (two, two.undone)
        )

    @property
    def words(self) -> str:
        """The motion in words."""
        if self.turn is None:
            return f"shifted by {in_words(np.array(self.shift), 4)}"
        about = f" about {in_words(np.array(self.pivot), 4)}" if self.pivot else ""
        axis = f" along {in_words(np.array(self.axis), 4)}" if self.axis else ""
        return f"turned by {self.turn:g} degrees{about}{axis}"


class Motion(Moved, frozen=True, kw_only=True):
    """A motion of any size, prescribed or free; see docs/use/far.md.

    Attributes
    ----------
    pivot : of a turn, also of a free one, in the coordinates of the drawing (m); left out, the origin
    axis : of a turn in space, by the right-hand rule; a free turn without it is one about all axes
    history : [history.NAME] whose factor multiplies shift and turn, or force and moment
    free : instead of shift and turn, components that forces decide, as in ["turn"] or ["x", "y"]
    force : along the free axes, at the pivot (N; in the plane per metre of depth)
    moment : of a free turn, about the pivot (N m; in the plane per metre of depth), in space about the axis or [x, y,
        z]
    """

    history: Name | None = None
    free: Annotated[list[Literal["x", "y", "z", "turn"]], msgspec.Meta(min_length=1)] | None = None
    force: Point | None = None
    moment: Number | Point = 0.0

    def __post_init__(self) -> None:
        free = self.free or ()
        if self.moves == bool(free):
            raise ValueError(
                "a motion has a shift (m), as in shift = [0.0, -20.0], or a turn (degrees), as in turn = "
                '90.0, or both; or it is free, as in free = ["turn"]'
            )
        self._check_turn(self.turn is not None or "turn" in free)
        if len({*free}) < len(free):
            raise ValueError("free names a component twice")
        if self.moment and "turn" not in free:
            raise ValueError('moment: needs a free turn: write free = ["turn"], or leave it out')
        self._check_force()

    def _check_force(self) -> None:
        free = self.free or ()
        for axis, component in zip("xyz", self.force or (), strict=False):
            if component and axis not in free:
                raise ValueError(
                    f'force: acts along {axis}, which is not free; write free = ["{axis}"], or 0 there'
                )

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        if "z" in (self.free or ()):
            yield 3, "free", no_z(axisymmetric)
        if isinstance(self.moment, tuple) and not self.axis:
            yield 3, "moment", "in the plane turns are in it"
        elif self.moment and not self.axis and not self.turn:
            yield 2, "turn", "a turn in space has an axis, as in axis = [0.0, 0.0, 1.0]"
        else:
            yield from super().of_one_dimension(axisymmetric)


Motions = Motion | Annotated[list[Motion], msgspec.Meta(min_length=1)]


def frame_of(motion: Motions | None, factors: Mapping[str | None, float], dimension: int) -> Frame:
    """Where motions lead, one after the other, at factors by history."""
    frame = Frame.of((0.0,) * dimension)
    for part in parts_of(motion):
        frame = part.frame(factors[part.history], dimension).after(frame)
    return frame


Freed = Mapping[str, np.ndarray]
"""How far free frames have gone, by name: a shift along the axes (d,) in m, and the turn about the pivot (1,), in space
a vector (3,), in degrees."""


def parts_of(motion: Motions | None) -> list[Motion]:
    """The parts of a motion, in their order."""
    return [motion] if isinstance(motion, Motion) else motion or []


def freed_part(motion: Motions | None) -> Motion | None:
    """The free part of a motion."""
    return next((part for part in parts_of(motion) if part.free), None)


def frames_of(scene: Any, time: float, freed: Freed | None = None) -> dict[str, Frame]:
    """Where the frames of the bodies and rigid partners of a `Settled` scene are at `time`, by name, if free ones have
    gone as far as in `freed`."""
    factors = scene.factors(time)
    frames = {}
    for each in (*scene.body, *scene.rigid):
        frame = frame_of(each.motion, factors, scene.dimension)
        gone = (freed or {}).get(each.name)
        if gone is not None:
            # a free turn is that of the body, a free shift one along the axes of the world
            free = freed_part(each.motion)
            shift, turn = np.split(gone, [scene.dimension])
            frame = (
                Frame.of(shift)
                .after(frame)
                .after(Frame.of(0.0 * shift, turn, free.pivot if free else None))
            )
        frames[each.name] = frame
    return frames


ONLY_FAR = 'bodies move far with motions = "far" in [time] only; write it there, or leave this out'
"""What is said of keys that mean something for far motions alone."""


def wrong_motions(scene: Any) -> Mistakes:
    """Why the motions of a `Scene` do not go with the rest of it."""
    movers = {
        f"{kind}.{each.name}": each for kind in ("body", "rigid") for each in getattr(scene, kind)
    }
    moving = {key: parts_of(each.motion) for key, each in movers.items() if each.motion}
    if scene.time is None or scene.time.motions != "far":
        yield from _only_far(scene, moving)
        return
    if not moving and all(body.clamp or body.foundation for body in scene.body):
        yield (
            "time.motions: no body and no rigid partner has a motion, and clamps hold all bodies; leave "
            'motions = "far" out'
        )
    yield from _beside_far(scene)
    for key, motions in moving.items():
        yield from _parts(key, motions, scene.axisymmetric)
        if getattr(movers[key], "displacement", None):
            yield (f"{key}: has both a motion and a displacement; leave one of them out")
    yield from _still_pushed(scene.rigid)
    for contact in scene.contact:
        yield from _not_sliding(contact)


def _only_far(scene: Any, moving: Mapping[str, list[Motion]]) -> Mistakes:
    """Keys that mean something for far motions alone."""
    for key in moving:
        yield (f"{key}.motion: {ONLY_FAR}; small motions are those of clamps")
    for body in scene.body:
        for k, load in enumerate(body.traction):
            if load.follows:
                yield (f"body.{body.name}.traction.{k}.follows: {ONLY_FAR}")


def _still_pushed(partners: list[Any]) -> Mistakes:
    """Rigid partners that are pushed or displaced, and do not move as their motion says."""
    for rigid in partners:
        if rigid.yields or any(rigid.displacement or ()):
            yield (
                f'rigid.{rigid.name}: with time.motions = "far" a partner moves as its motion says, not '
                "by a displacement, forces or moments; write motion = { shift = […] }"
            )


def _beside_far(scene: Any) -> Mistakes:
    """Cycles, derivatives, errors or a kind of compliance that do not go with far motions."""
    if scene.time.cycle:
        yield (
            'time.cycle: does not go with motions = "far"; write the times of all turning points'
        )
    if scene.output.derivatives:
        yield (
            'output.derivatives: there are none with time.motions = "far"; leave one of them out'
        )
    if scene.output.errors:
        yield 'output.errors: there are none with time.motions = "far"; leave one of them out'
    if scene.method.compliance not in (None, "explicit"):
        yield (
            f'method.compliance: {scene.method.compliance!r} does not go with time.motions = "far", for '
            "which the compliance of all contact nodes is made once; leave it out"
        )


def _prescribed(motions: list[Motion]) -> set[str]:
    """The components, "x", "y", "z" and "turn", that parts of a motion prescribe."""
    moved = {
        axis for part in motions for axis, way in zip("xyz", part.shift or (), strict=False) if way
    }
    if any(part.turn for part in motions):
        moved.add("turn")
    return moved


def _parts(key: str, motions: list[Motion], axisymmetric: bool) -> Mistakes:
    """Parts of a motion of the body or partner `key` that do not go with one another."""
    free = [part.free for part in motions if part.free]
    first: set[str] = set(*free[:1])
    moved = _prescribed(motions)
    if axisymmetric and not moved | first <= {"y"}:
        yield (f"{key}.motion: axisymmetric bodies shift along y only, as in shift = [0.0, -20.0]")
    if len(free) > 1:
        yield (f'{key}.motion: has {len(free)} free parts; write one, as in free = ["x", "turn"]')
    for axis in sorted(moved & first):
        yield (
            f"{key}.motion: prescribes {axis} in one part and frees it in another; leave one of them "
            "out"
        )
    if key.startswith("rigid") and any(part.free and part.axis for part in motions):
        yield (
            f"{key}.motion.axis: a rigid partner turns freely about all axes through its pivot; leave "
            "axis out"
        )


def _not_sliding(contact: Any) -> Mistakes:
    """What a contact has that bodies which slide far cannot have."""
    profiles = not isinstance(contact.rubbing[0], float | int) or bool(contact.rubbing[1])
    for key, given, why in (
        ("kind", contact.kind != "unilateral", "only unilateral contacts slide far"),
        ("gap", contact.gap is not None, "gaps are measured where the bodies are"),
        ("pairing", contact.pairing == "nodes", "nodes do not stay opposite each other"),
        (
            "friction",
            profiles,
            "profiles along a contact, formulas and histories are not possible yet",
        ),
    ):
        if given:
            yield (f'contact.{contact.called}.{key}: does not go with time.motions = "far": {why}')
