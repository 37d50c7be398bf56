"""Bolts of an assembly, by their faces: a thread is a cylinder in a hole of its radius, a head, or another nut, a plane
across the axis that is in contact, and between them all holes are wider."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ddmpi.check.nearby import Boundaries, Boundary, Missing
from ddmpi.mesh.forms import WITHIN

ALONG = 0.2
"""A cylinder is in a hole if they have this multiple of the radius of their lengths in common."""

GRIP = 0.25
"""What a bolt clamps is at least this multiple of its radius thick; a fit begins at its shoulder."""


class _Round(NamedTuple):
    """A cylinder of a body: its face's name, its radius (m), the ends of its axis (2, 3) (m), whether it is a hole."""

    body: str
    face: str
    radius: float
    ends: np.ndarray
    hollow: bool

    @property
    def axis(self) -> np.ndarray:
        """The unit vector (3,) along its axis."""
        along: np.ndarray = self.ends[1] - self.ends[0]
        return along / np.linalg.norm(along)

    def span(self, of: _Round) -> tuple[float, float]:
        """From where to where another cylinder is, along the axis of this one (m)."""
        low, high = sorted(((of.ends - self.ends[0]) @ self.axis).tolist())
        return low, high

    def around(self, hole: _Round) -> bool:
        """Whether this one is in a hole of the same axis."""
        low, high = self.span(self)
        first, last = self.span(hole)
        shared = min(high, last) - max(low, first)
        turned = hole.hollow and not self.hollow and hole.body != self.body
        return turned and shared >= ALONG * self.radius and self.is_along(hole)

    def fills(self, hole: _Round) -> bool:
        """Whether this one is in a hole of the same axis and radius."""
        return self.around(hole) and self.is_like(hole)

    def is_along(self, other: _Round) -> bool:
        """Whether both have one axis."""
        off = np.linalg.norm(np.cross(other.ends - self.ends[0], self.axis), axis=1)
        return bool(off.max() <= WITHIN * self.radius)

    def is_like(self, other: _Round) -> bool:
        """Whether both have one radius."""
        return abs(other.radius - self.radius) <= WITHIN * self.radius


class _Bearing(NamedTuple):
    """A plane across an axis that is in contact: of which body, where along it (m), which way it faces, 1 or −1."""

    body: str
    at: float
    way: int


class Bolt(NamedTuple):
    """A bolt: its thread, as the body with the hole and the bolt, the faces of both, and the direction (3,) in which the
    thread pulls that body, towards the head; None where it is the nut at the other end of a rod, and no force is its
    own. All the faces of the shank, which touches nothing else, are those of `shank`."""

    bodies: tuple[str, str]
    on: tuple[tuple[str, ...], tuple[str, ...]]
    along: np.ndarray | None
    shank: frozenset[str]

    @property
    def pretension(self) -> dict | None:
        """The entry of the contact, without its force."""
        return None if self.along is None else {"along": (np.round(self.along, 9) + 0.0).tolist()}


def find_bolts(boundaries: Boundaries, missing: Sequence[Missing]) -> list[Bolt]:
    """The bolts of bodies with these `boundaries` and possible contacts; a rod with two nuts is two of them."""
    rounds = [each for name, body in boundaries.items() for each in _rounds(name, body)]
    found = list[Bolt]()
    for shank in rounds:
        if any(shank.body == bolt.bodies[1] and shank.face in bolt.shank for bolt in found):
            continue
        threaded = _Shank.of(shank, rounds)
        if threaded.holes:
            bearings = _bearings(shank, boundaries, missing)
            found += [*threaded.with_head(bearings)][:1] or threaded.with_nuts(bearings)
    return found


def _rounds(name: str, body: Boundary) -> Iterator[_Round]:
    """The cylinders of a body of a drawing."""
    for face, drawn in body.faces.items():
        some = body.groups[face]
        if len(drawn.axis) == 2 and some.any():
            ends = np.array(drawn.axis)
            out = np.einsum("kd,kd->k", body.at[some].mean(axis=1) - ends[0], body.normal[some])
            yield _Round(name, face, drawn.radius, ends, bool(out.sum() < 0.0))


def _bearings(shank: _Round, boundaries: Boundaries, missing: Sequence[Missing]) -> list[_Bearing]:
    """The planes across an axis that are in contact."""
    bearings = list[_Bearing]()
    for lack in missing:
        for name, on in zip(lack.bodies, lack.on, strict=True):
            body = boundaries[name]
            for face in on.split("+"):
                if face in body.faces and body.faces[face].kind == "plane":
                    some = body.groups[face]
                    faces = float(body.normal[some].mean(axis=0) @ shank.axis)
                    at = float((body.at[some][0, 0] - shank.ends[0]) @ shank.axis)
                    if abs(faces) > 1.0 - WITHIN:
                        bearings.append(_Bearing(name, at, round(faces)))
    return bearings


class _Shank(NamedTuple):
    """A cylinder in `holes` that it fills, with the places of these along it (m); the faces of its radius, and all those
    around its axis that fill no other hole."""

    round: _Round
    holes: list[_Round]
    spans: list[tuple[float, float]]
    own: tuple[str, ...]
    faces: frozenset[str]

    @classmethod
    def of(cls, shank: _Round, rounds: Sequence[_Round]) -> _Shank:
        """That of one of all cylinders."""
        same = [each for each in rounds if each.body == shank.body and not each.hollow]
        same = [each for each in same if shank.is_along(each)]
        own = tuple(each.face for each in same if shank.is_like(each))
        fits = {each.face for each in same for hole in rounds if each.fills(hole)} - {*own}
        faces = frozenset(each.face for each in same) - fits
        holes = [hole for hole in rounds if shank.fills(hole)]
        return cls(shank, holes, [shank.span(hole) for hole in holes], own, faces)

    def thread(self, hole: _Round, along: np.ndarray | None) -> Bolt:
        """That in a hole, and in all others of its body."""
        of = tuple(each.face for each in self.holes if each.body == hole.body)
        return Bolt((hole.body, self.round.body), (of, self.own), along, self.faces)

    def with_head(self, bearings: Sequence[_Bearing]) -> Iterator[Bolt]:
        """Its threads in the first hole before a head, away from it."""
        for _, at, way in (each for each in bearings if each.body == self.round.body):
            ahead = [(way * (sum(span) / 2 - at), k) for k, span in enumerate(self.spans)]
            far, k = min((each for each in ahead if each[0] > 0.0), default=(0.0, 0))
            if far and min(way * (end - at) for end in self.spans[k]) >= GRIP * self.round.radius:
                yield self.thread(self.holes[k], -way * self.round.axis)

    def with_nuts(self, bearings: Sequence[_Bearing]) -> Iterator[Bolt]:
        """Its threads in two nuts that face each other, away from each other."""
        nuts = sorted(zip(self.spans, self.holes, strict=True))
        first, one = nuts[0]
        last, other = nuts[-1]
        two = {hole.body for hole in self.holes} == {
            one.body,
            other.body,
        } and one.body != other.body
        clamped = last[0] - first[1] >= GRIP * self.round.radius
        if (
            two
            and clamped
            and {(one.body, 1), (other.body, -1)} <= {each[::2] for each in bearings}
        ):
            yield self.thread(one, self.round.axis)
            yield self.thread(other, None)


def is_of_shank(lack: Missing, bolts: Sequence[Bolt]) -> bool:
    """Whether a possible contact is that of a bolt's shank in a hole: its thread, or a hole with clearance."""
    for name, on in zip(lack.bodies, lack.on, strict=True):
        shank = {face for bolt in bolts if bolt.bodies[1] == name for face in bolt.shank}
        if {*on.split("+")} <= shank:
            return True
    return False
