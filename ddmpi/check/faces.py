"""The pieces of a boundary that are in the same groups: which they are, what they are, in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ddmpi.check.nearby import NUMBERS, Boundary
from ddmpi.mesh.boundary import SHARPEST, creases, parts_of
from ddmpi.mesh.elements import facet_measures
from ddmpi.mesh.mesh import Face, connected
from ddmpi.system.numbers import in_words

SQUARE = ("", "", "²")
"""The powers of the unit of length of lengths and areas, by the dimension of what has them."""

FLAT = 1e-6
"""Normals of a plane differ by at most this."""

ROUND = 2e-3
"""Points of a round face are off by at most this part of its radius."""


@dataclass(frozen=True)
class Piece:
    """What one click chooses: the part of a boundary that is in the same groups.

    Attributes
    ----------
    body, names : its body, and its groups, the smallest first; none where the boundary has no name
    some : (k,) its facets
    on : the value of ``on``, of a face of a drawing what it is; None where there is no name
    """

    body: str
    names: Sequence[str]
    some: np.ndarray
    on: str | int | None

    def is_of(self, on: str) -> bool:
        """Whether it is of one of the groups of which the name `on` is made."""
        return not set(self.names).isdisjoint(parts_of(on, self.names))


def pieces_of(body: str, boundary: Boundary) -> list[Piece]:
    """The pieces of a body's boundary, in the order of its groups; first those without a name, which end at corners."""
    simple = boundary.simple
    member = np.array([boundary.groups[name] for name in simple], bool)
    member = member.reshape(len(simple), len(boundary.facets))
    size = dict(zip(simple, member.sum(axis=1), strict=True))
    bits = np.packbits(member, axis=0).T
    if not member.any(axis=0).all():
        smooth = _smooth(boundary, ~member.any(axis=0))
        bits = np.column_stack([bits, smooth.astype(">u4").view(np.uint8).reshape(-1, 4)])
    _, first, number = np.unique(
        np.ascontiguousarray(bits), axis=0, return_index=True, return_inverse=True
    )
    pieces = []
    # facets piece by piece: a mask for each would take pieces × facets of memory
    order = np.argsort(number.ravel(), kind="stable")
    starts = np.searchsorted(number.ravel()[order], np.arange(1, len(first)))
    for facet, some in zip(first, np.split(order, starts), strict=True):
        names = [simple[j] for j in np.flatnonzero(member[:, facet])]
        names.sort(key=lambda name: (size[name], name not in boundary.faces))
        name = names[0] if names else None
        face = boundary.faces.get(name or "")
        on = int(name) if name and NUMBERS.fullmatch(name) else name
        pieces.append(Piece(body, names, some, (face and face.words) or on))
    return sorted(pieces, key=lambda piece: simple.index(piece.names[0]) if piece.names else -1)


def _smooth(boundary: Boundary, some: np.ndarray) -> np.ndarray:
    """The number (f,) from 1 on of the part without corners that each of `some` facets (f,) bool is of; of others 0."""
    corners = boundary.facets[:, : boundary.at.shape[1]]
    number = np.zeros(len(some), int)
    points = np.zeros((corners.max() + 1, boundary.at.shape[2]))
    points[corners] = boundary.at
    bends = creases(points, corners[some], boundary.normal[some])
    links = bends.facets[np.abs(bends.turn) < SHARPEST]
    number[some] = 1 + connected(links, int(some.sum()))
    return number


def face_of(boundary: Boundary, some: np.ndarray) -> Face:
    """What some facets, a mask or numbers, are of which no drawing says it: plane, or around a centre or an axis."""
    at = boundary.at[some]
    normal = boundary.normal[some]
    points = at.reshape(-1, at.shape[-1])
    d = at.shape[-1]
    low = points.min(axis=0)
    high = points.max(axis=0)
    kind = ("line", "plane")[d - 2]
    radius = 0.0
    if np.ptp(normal, axis=0).max() > FLAT:
        across = np.linalg.eigh(np.einsum("ki,kj->ij", normal, normal))[1][:, 1:]
        ways = [np.eye(d), across][: d - 1]  # a sphere, or a circle; else a cylinder
        radii = [_radius(points @ way) for way in ways]
        names = ("circle", "sphere", "cylinder")[d - 2 :]
        found = [(name, r) for name, r in zip(names, radii, strict=False) if r]
        kind, radius = found[0] if found else ("curved", 0.0)
    measure = float(facet_measures(at).sum())
    return Face(kind, radius, measure, tuple(((low + high) / 2).tolist()))


def _radius(points: np.ndarray) -> float:
    """The radius of the circle or sphere through points (k, d), 0 if they are on none."""
    middle = points.mean(axis=0)
    away = points - middle
    rows = np.column_stack([2.0 * away, np.ones(len(away))])
    *centre, rest = np.linalg.lstsq(rows, (away**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(rest + np.dot(centre, centre), 0.0)))
    off = np.abs(np.linalg.norm(away - centre, axis=1) - radius).max()
    return radius if off <= ROUND * radius and len(points) > points.shape[1] + 1 else 0.0


def describe_face(boundary: Boundary, some: np.ndarray, face: Face, unit: str) -> str:
    """What a face is: "plane, normal +z, 314 mm², about (0, 0, 5)". Not collective."""
    d = boundary.at.shape[-1]
    at = boundary.at[some].mean(axis=1)
    normal = boundary.normal[some]
    measures = facet_measures(boundary.at[some])
    middle, mean = (measures @ values / measures.sum() for values in (at, normal))
    words = [face.kind]
    if face.radius:  # normals of a hollow one point to each other
        hollow = np.einsum("kd,kd->k", normal, at - middle) @ measures < 0.0
        words.append(f"r {face.radius:.3g}")
        if hollow:
            words.append("hollow")
    elif np.ptp(normal, axis=0).max() < FLAT:
        axis = int(np.abs(mean).argmax())
        words.append(
            "normal " + ("+" if mean[axis] > 0.0 else "-") + "xyz"[axis]
            if abs(mean[axis]) > 1 - 1e-9
            else f"normal {in_words(np.round(mean, 4) + 0.0, 3)}"
        )
    return (
        f"{', '.join(words)}, {face.measure or measures.sum():.4g} {unit}{SQUARE[d - 1]}, about "
        f"{in_words(np.array(face.place), 4)}"
    )
