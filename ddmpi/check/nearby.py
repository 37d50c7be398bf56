"""Missing contacts: bodies that lie close to each other without a contact in the scene, in any dimension."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.sparse import csgraph

from ddmpi.mesh.boundary import SHARPEST, creases, parts_of
from ddmpi.mesh.elements import cell_with
from ddmpi.mesh.mesh import Face, Mesh
from ddmpi.scene.contacts import Rigid, SettledContact, default_name
from ddmpi.scene.reader import write_toml
from ddmpi.surface.cut import FACING
from ddmpi.surface.near import contained, nearest_of_each
from ddmpi.surface.side import across, unit
from ddmpi.system.numbers import SAME, nearest_in

NEAR = 0.25  # facets may be meant to touch if they are closer than this fraction of the smaller one's size
NUMBERS = re.compile(r"\d+(\+\d+)*")  # a number of a face, or several together

ASIDE = 0.5
"""The nearest point lies before a facet: offset by at most this times its distance, but for rounding."""


@dataclass(frozen=True)
class Boundary:
    """The boundary of a body."""

    facets: np.ndarray  # (f, l) their nodes
    at: np.ndarray  # (f, c, d) their corners (m)
    normal: np.ndarray  # (f, d) outer unit normals
    groups: Mapping[str, np.ndarray]  # by name which facets (f,) bool belong to it
    faces: Mapping[str, Face] = field(
        default_factory=dict
    )  # groups that are numbered faces of a drawing
    smooth: Collection[
        tuple[str, str]
    ] = ()  # pairs of these that meet without a corner, in both orders

    @classmethod
    def of(cls, mesh: Mesh) -> Self:
        """The boundary of a mesh. Not collective."""
        facets = mesh.boundary[0]
        d = mesh.cell.facet.corners
        at = mesh.points[facets[:, :d]]
        keys = [np.sort(part[:, :d], axis=1) for part in (facets, *mesh.groups.values())]
        number = np.split(
            np.unique(np.concatenate(keys), axis=0, return_inverse=True)[1].ravel(),
            np.cumsum([len(key) for key in keys])[:-1],
        )
        normal = unit(across(at)[:, 0])
        groups = {
            name: np.isin(number[0], members)
            for name, members in zip(mesh.groups, number[1:], strict=True)
        }
        smooth = set()
        if mesh.faces:
            bends = creases(mesh.points, facets[:, :d], normal)
            face = np.full(len(facets), "", dtype=object)
            for name in mesh.faces:
                face[groups[name]] = name
            for a, b in face[bends.facets[np.abs(bends.turn) < SHARPEST]]:
                smooth |= {(a, b), (b, a)}
        return cls(facets, at, normal, groups, mesh.faces, smooth)

    @property
    def size(self) -> np.ndarray:
        """(f,) longest edges of the facets (m)."""
        return np.linalg.norm(self.at - np.roll(self.at, 1, axis=1), axis=2).max(axis=1)

    @property
    def cut(self) -> Self:
        """The boundary with quadrilaterals cut into triangles."""
        _, corners, d = self.at.shape
        if corners == d:
            return self
        parts = cell_with(corners, d - 1).parts
        return replace(
            self,
            facets=self.facets[:, parts].reshape(-1, d),
            at=self.at[:, parts].reshape(-1, d, d),
            normal=self.normal.repeat(len(parts), axis=0),
            groups={name: some.repeat(len(parts)) for name, some in self.groups.items()},
        )

    @property
    def simple(self) -> list[str]:
        """The groups of the mesh, without those that a scene combines."""
        return [
            name
            for name in self.groups
            if parts_of(name, ()) == [name] or not self.groups.keys() >= {*parts_of(name, ())}
        ]

    def named(self, some: np.ndarray) -> np.ndarray:
        """Groups of some facets (k,), or "": of a facet's groups the one with the most of these facets, of equal ones
        the smallest."""
        names = np.full(len(some), "", dtype=object)
        for name in sorted(
            self.simple,
            key=lambda name: (
                -self.groups[name][some].sum(),
                self.groups[name].sum(),
                name not in self.faces,
            ),
        ):
            names[(names == "") & self.groups[name][some]] = name
        return names


Boundaries = Mapping[str, Boundary]
"""Those of bodies by name."""


class Missing(NamedTuple):
    """A missing contact."""

    bodies: tuple[str, str]  # the second may be a rigid partner
    on: tuple[str, ...]  # a group of each body; "" where the boundary has no name
    facets: np.ndarray  # (k, d, d) of both bodies (m)
    gap: tuple[float, float]  # the least and the largest distance, negative where they overlap (m)
    faces: Sequence[Mapping[str, Face]] = ({}, {})  # those of each body that have numbers

    @property
    def sides(self) -> list[Any]:
        """The value of ``on``: names, faces by what they are or else by number, and lists of these."""
        called = []
        for on, faces in zip(self.on, self.faces, strict=False):
            parts: list = [on]
            if NUMBERS.fullmatch(on):
                numbers = sorted(map(int, on.split("+")))
                parts = [getattr(faces.get(str(k)), "words", "") or k for k in numbers]
            called.append(parts if len(parts) > 1 else parts[0])
        return called

    def lines(self, taken: set[str], called: str = "", **more: Any) -> str:
        """The TOML of the contact, with a name that is not among those `taken`, which gets this one, and `more` keys."""
        name = free_name(called or default_name(self.bodies), taken)
        named = name if name != default_name(self.bodies) else None
        entry = {"name": named, "bodies": self.bodies, "on": self.sides} | more
        return write_toml({"contact": [entry]}).strip()


def free_name(first: str, taken: set[str]) -> str:
    """A name that is not among those `taken`, which gets it: the first one, or else with a number."""
    k = 1
    name = first
    while name in taken:
        k += 1
        name = f"{first}-{k}"
    taken.add(name)
    return name


class _Nearest:
    """Of each facet (f,) of all bodies the nearest place before it on another body, the same one or a rigid partner.

    Attributes
    ----------
    owner : (f,) the number of its body
    middle, normal, size : (f, d), (f, d), (f,) of it (m)
    least, gap : (f,) the distance of that place (m), and how much of it is along the normal
    partner : (f,) the number of the body, or rigid partner after these, that has it; −1 if there is none
    facing : (f,) the number there of the facet with this place, counted through its body
    """

    def __init__(self, bodies: Sequence[Boundary]) -> None:
        self.bodies = bodies
        counts = [len(body.at) for body in bodies]
        self.starts = np.cumsum([0, *counts])
        self.owner = np.repeat(np.arange(len(bodies)), counts)
        self.middle = np.concatenate([body.at.mean(axis=1) for body in bodies])
        self.normal = np.concatenate([body.normal for body in bodies])
        self.size = np.concatenate([body.size for body in bodies])
        self.least = np.full(len(self.owner), np.inf)
        self.gap = np.zeros(len(self.owner))
        self.partner, self.facing = np.full((2, len(self.owner)), -1)

    def _note(
        self,
        some: np.ndarray,
        k: int,
        away: np.ndarray,
        against: np.ndarray,
        reach: np.ndarray,
        there: np.ndarray | int = 0,
    ) -> None:
        """Note that facets `there` of the k-th, with normals `against`, lie `away` (j, d) from some facets (j,)."""
        normal = self.normal[some]
        distance = np.linalg.norm(away, axis=1)
        ahead = np.einsum("kd,kd->k", away, normal)
        aside = np.linalg.norm(away - ahead[:, None] * normal, axis=1)
        near = (distance <= NEAR * reach) & (distance < self.least[some] - SAME * reach)
        near &= aside <= ASIDE * distance + SAME * reach
        near &= np.einsum("kd,kd->k", normal, against) < FACING
        found = (self.least, distance), (self.gap, ahead), (self.partner, k), (self.facing, there)
        for values, new in found:
            values[some[near]] = np.broadcast_to(new, len(some))[near]

    def _near(self, k: int, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of `some` facets (j,), and facets of the k-th body that may be near their middles."""
        body = self.bodies[k]
        wide = NEAR * body.size[:, None]
        low = body.at.min(axis=1) - wide
        high = body.at.max(axis=1) + wide
        number, there = contained(self.middle[some], low, high)
        return some[number], there

    def _note_nearest(self, k: int, some: np.ndarray, there: np.ndarray, away: np.ndarray) -> None:
        """Note of each facet in `some` (j,) the nearest place, `away` (j, d), on facets `there` of the k-th body."""
        nearest = nearest_of_each(some, np.linalg.norm(away, axis=1))
        some = some[nearest]
        there = there[nearest]
        body = self.bodies[k]
        reach = np.minimum(self.size[some], body.size[there])
        self._note(some, k, away[nearest], body.normal[there], reach, there)

    def look_at(self, k: int) -> None:
        """Look for places on the k-th body before facets of others."""
        some, there = self._near(k, np.flatnonzero(self.owner != k))
        away = nearest_in(self.middle[some], self.bodies[k].at[there]) - self.middle[some]
        self._note_nearest(k, some, there, away)

    def look_at_itself(self, k: int) -> None:
        """Look for places before facets of the k-th body on facets of it that face these and share no corner."""
        body = self.bodies[k]
        some, there = self._near(k, np.flatnonzero(self.owner == k))
        corners = body.facets[:, : body.at.shape[1]]
        own = corners[some - self.starts[k]]
        facing = np.einsum("kd,kd->k", self.normal[some], body.normal[there]) < FACING
        facing &= ~(own[:, :, None] == corners[there][:, None]).any(axis=(1, 2))
        some = some[facing]
        there = there[facing]
        away = nearest_in(self.middle[some], body.at[there]) - self.middle[some]
        # what lies behind is the other side of a thin body
        reach = np.minimum(self.size[some], body.size[there])
        ahead = np.einsum("kd,kd->k", away, self.normal[some]) >= -SAME * reach
        self._note_nearest(k, some[ahead], there[ahead], away[ahead])

    def look_at_rigid(self, k: int, surface: Rigid, some: np.ndarray | None = None) -> None:
        """Look for places on a rigid partner, the k-th of all, before some facets (j,), or all."""
        some = np.arange(len(self.owner)) if some is None else some
        against, distance = surface.facing(self.middle[some])
        reach = np.minimum(self.size[some], surface.bend)
        self._note(some, k, -distance[:, None] * against, against, reach)

    def pairs(self) -> Iterator[tuple[int, int, np.ndarray, np.ndarray, np.ndarray]]:
        """Two numbers, the smaller one or the same first, the gaps (k,) between them, and the facets (k,) of both."""
        local = np.arange(len(self.owner)) - self.starts[self.owner]
        both = np.sort([self.owner, self.partner], axis=0)
        mine = self.owner < self.partner
        first = np.where(mine, local, self.facing)
        second = np.where(mine, self.facing, local)
        for a, b in np.unique(both[:, self.partner >= 0].T, axis=0):
            some = (both == [[a], [b]]).all(axis=0)
            yield a, b, self.gap[some], first[some], second[some]


def find_missing(
    boundaries: Boundaries, rigid: Sequence[Rigid], contacts: Sequence[SettledContact]
) -> Iterator[Missing]:
    """Groups of bodies, of one or two, and rigid partners, that face each other closer than NEAR, but not in a contact
    of both. Facets are compared with the nearest point to their middle. Not collective."""
    boundaries = {name: body.cut for name, body in boundaries.items()}
    bodies = list(boundaries.values())
    names = [*boundaries, *(surface.name for surface in rigid)]
    nearest = _Nearest(bodies)
    for k in range(len(bodies)):
        nearest.look_at(k)
    for contact in contacts:  # of planes in line that comes first which a contact names
        body, on = contact.bodies
        if on not in boundaries:
            own = np.flatnonzero(boundaries[body].groups[contact.on[0]])
            some = nearest.starts[names.index(body)] + own
            k = names.index(on)
            nearest.look_at_rigid(k, rigid[k - len(bodies)], some)
    for k, surface in enumerate(rigid, len(bodies)):
        nearest.look_at_rigid(k, surface)
    for k in range(len(bodies)):
        nearest.look_at_itself(k)
    for a, b, gap, first, second in nearest.pairs():
        pair = names[a], names[b]
        both = first, second
        free = np.ones(len(gap), bool)
        for contact in contacts:
            for order in ((0, 1), (1, 0)):
                if contact.bodies == (pair[order[0]], pair[order[1]]):
                    named = [
                        boundaries[name].groups[on][both[k]]
                        for name, on, k in zip(contact.bodies, contact.on, order, strict=False)
                    ]
                    free &= ~np.logical_and.reduce(named)
        if free.any():
            sides = [
                (boundaries[name], facets[free])
                for name, facets in zip(pair, both, strict=True)
                if name in boundaries
            ]
            yield from _missing(pair, sides, gap[free])


def _missing(
    pair: tuple[str, str], sides: Sequence[tuple[Boundary, np.ndarray]], gap: np.ndarray
) -> Iterator[Missing]:
    """The missing contacts of two that face each other, by the facets (k,) of those that are bodies, and the gaps (k,)
    between them."""
    groups = list(zip(*(body.named(facets) for body, facets in sides), strict=True))
    if (
        pair[0] == pair[1]
    ):  # each pair of facets is found from both; one group is no side and its partner
        groups = [tuple(sorted(two)) if two[0] != two[1] else ("", "") for two in groups]
    for alike in _together(list(dict.fromkeys(groups)), [body for body, _ in sides]):
        chosen = np.array([group in alike for group in groups])
        on = tuple("+".join(dict.fromkeys(parts)) for parts in zip(*alike, strict=True))
        at = np.concatenate([body.at[np.unique(facets[chosen])] for body, facets in sides])
        apart = float(gap[chosen].min()), float(gap[chosen].max())
        yield Missing(pair, on, at, apart, [body.faces for body, _ in sides])


def _together(
    pairs: Sequence[tuple[str, ...]], bodies: Sequence[Boundary]
) -> Iterator[list[tuple[str, ...]]]:
    """The `pairs` of groups that face each other, those of one contact together: numbered faces of which one is the
    same, as two soles on a floor, or of which all meet without a corner, as the halves of a bore and of its pin."""

    def joined(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
        same = [a == b for a, b in zip(one, other, strict=True)]
        numbered = [{a, b} <= {*body.faces} for a, b, body in zip(one, other, bodies, strict=True)]
        smooth = [(a, b) in body.smooth for a, b, body in zip(one, other, bodies, strict=True)]
        return all(np.logical_or(same, numbered)) and (any(same) or all(smooth))

    number, label = csgraph.connected_components(
        np.array([[joined(one, other) for other in pairs] for one in pairs])
    )
    for k in range(number):
        yield [pair for pair, of in zip(pairs, label, strict=True) if of == k]
