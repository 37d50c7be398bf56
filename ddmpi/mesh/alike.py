"""The bodies of a drawing, and which of them are others elsewhere: equal up to a rigid motion, and no mirror images."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ddmpi.mesh.boundary import extent
from ddmpi.mesh.forms import inner_points
from ddmpi.mesh.geometry import in_drawing
from ddmpi.scene.motions import Copy
from ddmpi.system.numbers import Frame

EQUAL = 1e-6
"""Volumes, areas and places of equal solids differ by less than this part of them, of places of the extent."""

TRIED = 1000
"""Rotations that are tried for two solids, at most: more are those of a solid with very many equal faces."""

DEGREES = 9
"""Decimals of angles: rounding in a drawing has more."""

DIGITS = 10
"""The same of places over the extent."""


class Drawn(NamedTuple):
    """A body of a drawing: its number, its label, or "", its extent (m), and the motion from an earlier one that it is
    equal to, whose `of` is that one's number."""

    number: int
    label: str
    extent: float
    copy: Copy | None


class _Solid(NamedTuple):
    """A solid: its volume (m³) and centre (3,) (m), and of its faces the numbers, kinds, areas (f,) (m²) and centres
    (f, 3) (m)."""

    tag: int
    volume: float
    centre: np.ndarray
    tags: list[int]
    kinds: np.ndarray
    areas: np.ndarray
    centres: np.ndarray


def list_drawn(path: Path, label: str) -> tuple[int, list[Drawn]]:
    """The dimension of a STEP or BREP file, 3 if it has volumes, else 2, and its bodies. Not collective. Raises
    InputError, which begins with `label`, for a file that gmsh cannot read."""
    return in_drawing(_list_drawn, path, label)


def _list_drawn(gmsh) -> tuple[int, list[Drawn]]:
    """The dimension and the bodies of a drawing that is open."""
    d = max(int(gmsh.model.getDimension()), 2)
    originals = list[_Solid]()
    drawn = list[Drawn]()
    for _, tag in gmsh.model.getEntities(d):
        solid = _solid(gmsh, tag) if d == 3 else None
        found = (_copy(gmsh, of, solid) for of in originals if solid)
        copy = next(filter(None, found), None)
        if solid and not copy:
            originals.append(solid)
        name = gmsh.model.getEntityName(d, tag).split("/")[-1]
        drawn.append(Drawn(tag, name, extent(gmsh, d, tag), copy))
    return d, drawn


def _solid(gmsh, tag: int) -> _Solid:
    occ = gmsh.model.occ
    tags = [abs(face) for _, face in gmsh.model.getBoundary([(3, tag)])]
    return _Solid(
        tag,
        occ.getMass(3, tag),
        np.array(occ.getCenterOfMass(3, tag)),
        tags,
        np.array([gmsh.model.getType(2, face) for face in tags]),
        np.array([occ.getMass(2, face) for face in tags]),
        np.array([occ.getCenterOfMass(2, face) for face in tags]),
    )


def _copy(gmsh, one: _Solid, other: _Solid) -> Copy | None:
    """The motion from `one` to the `other` if they are equal."""
    size = extent(gmsh, 3, one.tag)
    same = len(one.tags) == len(other.tags)
    if not (same and np.isclose(one.volume, other.volume, rtol=EQUAL, atol=0.0)):
        return None
    alike = one.kinds[:, None] == other.kinds
    alike &= np.isclose(one.areas[:, None], other.areas, rtol=EQUAL, atol=0.0)
    if not (alike.any(axis=0).all() and alike.any(axis=1).all()):
        return None
    for turned in _rotations(one, other, alike, EQUAL * size):
        copy = _written(one.tag, turned, other.centre - turned @ one.centre, size)
        if copy and _is_copy(gmsh, one, other, alike, copy.frame(1.0, 3), size):
            return copy
    return None


def _rotations(one: _Solid, other: _Solid, alike: np.ndarray, near: float) -> Iterator[np.ndarray]:
    """Rotations (3, 3) that take the centres of two faces of one solid to those of the other, about the solids' own;
    first none at all. `alike` (f, f) tells which faces may be equal, and `near` is a distance (m) that does not count."""
    yield np.eye(3)
    here = one.centres - one.centre
    there = other.centres - other.centre
    far = np.linalg.norm(here, axis=1)
    off = np.linalg.norm(there, axis=1)
    alike = alike & (np.abs(far[:, None] - off) < near)
    rare = alike.sum(axis=1)
    aside = np.linalg.norm(np.cross(here[:, None], here), axis=2) > near * far.max()
    pairs = np.argwhere(aside) if aside.any() else np.argwhere(np.diag(far > near))
    if not len(pairs):
        return
    first, second = min(pairs.tolist(), key=lambda pair: (rare[pair[0]] * rare[pair[1]], pair))
    left = TRIED
    for a in np.flatnonzero(alike[first]):
        for b in np.flatnonzero(alike[second]) if first != second else [a]:
            fits = abs(here[first] @ here[second] - there[a] @ there[b]) < near * far.max()
            if fits and left:
                left -= 1
                asides = np.cross(here[first], here[second]), np.cross(there[a], there[b])
                if first == second:  # the smallest turn will do
                    asides = (_across(here[first], there[a]),) * 2
                yield _basis(there[a], asides[1]) @ _basis(here[first], asides[0]).T


def _across(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """A vector (3,) that is orthogonal to two, which may be parallel."""
    aside = np.cross(one, other)
    if np.linalg.norm(aside) > EQUAL * np.linalg.norm(one) * np.linalg.norm(other):
        return aside
    return np.cross(one, np.eye(3)[np.abs(one).argmin()])


def _basis(along: np.ndarray, aside: np.ndarray) -> np.ndarray:
    """A right-handed orthonormal basis (3, 3), in columns, with two orthogonal vectors as its first and its last."""
    along = along / np.linalg.norm(along)
    aside = aside / np.linalg.norm(aside)
    return np.column_stack([along, np.cross(aside, along), aside])


def _rounded(vector: np.ndarray, digits: int) -> tuple[float, ...]:
    """A vector to so many decimals, without a sign of zeros."""
    return tuple((np.round(vector, digits) + 0.0).tolist())


def _written(number: int, turned: np.ndarray, shift: np.ndarray, size: float) -> Copy | None:
    """The motion x ↦ turned x + shift as a scene has it, of `number`, with numbers without rounding; None if it is none.
    Its pivot is the place of its axis next to the origin."""
    rotation = Frame(shift, turned).turn
    angle = float(np.linalg.norm(rotation))
    digits = DIGITS - int(np.ceil(np.log10(size)))
    if round(angle, DEGREES) == 0.0:
        move = _rounded(shift, digits)
        return Copy(of=str(number), shift=move) if any(move) else None
    axis = rotation / angle
    if axis[np.abs(axis).argmax()] < 0.0:
        axis = -axis
        angle = -angle
    along = shift @ axis * axis
    across = shift - along
    pivot = (across + np.cross(axis, across) / np.tan(np.radians(angle) / 2)) / 2
    move = _rounded(along, digits)
    return Copy(
        of=str(number),
        turn=round(angle, DEGREES),
        axis=_rounded(axis, 12),
        pivot=_rounded(pivot, digits),
        shift=move if any(move) else None,
    )


def _is_copy(
    gmsh, one: _Solid, other: _Solid, alike: np.ndarray, frame: Frame, size: float
) -> bool:
    """Whether the motion takes each face of one solid onto a face of the other, as points of it show."""
    near = EQUAL * size
    apart = np.linalg.norm(frame.at(one.centres)[:, None] - other.centres, axis=2)
    there = np.where(alike, apart, np.inf).argmin(axis=1)
    if len({*there}) < len(there) or apart[range(len(there)), there].max() > near:
        return False
    return all(
        _lie_on(gmsh, frame.at(inner_points(gmsh, face)), other.tags[k], near)
        for face, k in zip(one.tags, there, strict=True)
    )


def _lie_on(gmsh, points: np.ndarray, face: int, near: float) -> bool:
    """Whether points (n, 3) are on a face."""
    occ = gmsh.model.occ
    for at in points:
        point = occ.addPoint(*at)
        away = occ.getDistance(0, point, 2, face)[0]
        occ.remove([(0, point)])
        if away > near:
            return False
    return True
