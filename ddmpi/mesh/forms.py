"""Curves and faces of drawings, in a session of gmsh: groups by number, by label, and by what they are, as in "cylinder
r=10 at (0, 0, 6)"."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import (
    SAMPLES,
    box,
    curve_bend,
    extent,
    face_bend,
    parameters,
    parts_of,
    samples,
    where,
)
from ddmpi.mesh.mesh import PHYSICAL, Face, Faces
from ddmpi.system.numbers import in_words, nearest_in

KINDS = {
    "plane": "plane",
    "cylinder": "cylinder",
    "cone": "cone",
    "sphere": "sphere",
    "torus": "torus",
    "line": "line",
    "circle": "arc",
}
"""Words for kinds of faces and curves, by gmsh's own; a face or a curve of another kind is a face or a curve."""

WHAT = "point", "curve", "face"
"""Entities by dimension."""

FREE = ("bspline surface", "bezier surface", "surface of extrusion", "surface of revolution")
"""Gmsh's kinds of faces that may be cylinders, as some CAD programs write them."""

ROUND = ("arc", "cylinder", "sphere", "torus")
"""Kinds that have a radius."""

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
PLACE = rf"\(\s*{NUMBER}(?:\s*,\s*{NUMBER}){{1,2}}\s*\)"
FORM = re.compile(
    rf"(plane|cylinder|cone|sphere|torus|face|line|arc|curve)(?:\s+r\s*=\s*({NUMBER}))?"
    rf"(?:\s+n\s*=\s*({PLACE}))?\s+at\s+({PLACE})"
)
"""A face or a curve by what it is: its kind, a radius or a normal, and a point on it, or on its axis."""

UNNAMED = re.compile(rf"((point|curve) )?\d+|{FORM.pattern}")
"""A curve or a face by number or by what it is, or a point or a curve of a solid by number."""

WITHIN = 1e-3
"""A point is on a face up to this part of the extent of the body; radii and normals are as given up to this part."""

SAME_PLACE = 1e-6
"""Faces are equally near if their distances differ by less than this part of the extent of the body."""

GRIDS = 1, 4, 16, 64
"""Points along a parameter of a face among which one inside its boundary is looked for."""


Tagged = dict[tuple[str, int], list[int]]
"""Numbers of points, curves or faces by name and dimension."""


class Form(NamedTuple):
    """A face or a curve by what it is: kind, radius (m) or 0, outer unit normal (3,) or zero, and a point (3,) (m)."""

    kind: str
    radius: float
    normal: np.ndarray
    at: np.ndarray

    @classmethod
    def of(cls, words: str, label: str) -> Form | None:
        """That of `words`; None if they are a name. Raises InputError for numbers that no face has."""
        found = FORM.fullmatch(words)
        if not found:
            return None
        kind, radius, normal, at = found.groups()
        along = _numbers(normal)
        place = _numbers(at)
        longest = np.abs(along).max() if normal else 1.0
        sizes = float(radius or 1.0), longest
        if not np.isfinite([*sizes, *place]).all() or min(sizes) <= 0.0:
            raise InputError(
                f"{label}: {words!r} needs finite numbers, a radius above 0 and a normal that is not 0"
            )
        along = along / longest  # squares of what is left neither vanish nor overflow
        unit = along / np.linalg.norm(along) if normal else along
        return cls(kind, float(radius or 0.0), unit, place)


def _numbers(place: str | None) -> np.ndarray:
    """Three numbers, those that are not written 0."""
    given = [float(each) for each in re.findall(NUMBER, place or "")]
    return np.array([*given, 0.0, 0.0, 0.0])[:3]


def name_sides(gmsh, script: bool, asked: Collection[str], label: str) -> Faces:
    """Make groups of curves and faces by their numbers, and by the last part of their labels: of all that bound the
    body in a file that is no `script`, and in one without groups of which numbers are `asked`; else of those asked for
    that are no groups yet. So are curves of solids and points, as in "curve 5" and "point 3", and faces by what they
    are, if they are asked for. What the drawing says of the numbered ones. Raises InputError for others."""
    side = gmsh.model.getDimension() - 1
    there = {gmsh.model.getPhysicalName(k, tag): k for k, tag in gmsh.model.getPhysicalGroups()}
    wanted = [part for on in asked for part in parts_of(on, there) if part not in there]
    numbers = [part for part in wanted if UNNAMED.fullmatch(part)]
    every = not script or (bool(numbers) and numbers == wanted and side not in there.values())
    tagged = _called(gmsh, side, script, there) | _described(gmsh, wanted, label)
    _refuse_missing(gmsh, numbers if script else wanted, tagged, side, label)
    faces = {}
    for (name, k), tags in tagged.items():
        if (every and k == side) or name in wanted:
            gmsh.model.addPhysicalGroup(k, tags, name=name)
            if k == side and name == str(tags[0]):
                faces[name] = _face(gmsh, k, tags[0])
    return faces


def _called(gmsh, side: int, script: bool, taken: Collection[str]) -> Tagged:
    """The numbers of points, curves and faces up to the dimension `side`, by name and dimension: their own numbers and,
    but for a `script`, the last parts of their labels; names that are `taken` are left out, and faces of other solids."""
    tagged = Tagged()
    for k, tag in gmsh.model.getEntities():
        if k > side or (k == side and _is_apart(gmsh, k, tag)):
            continue
        number = str(tag) if k == side else f"{PHYSICAL[k].split()[1]} {tag}"
        spoken = "" if script else gmsh.model.getEntityName(k, tag).split("/")[-1]
        for name in dict.fromkeys((number, spoken)):
            if name and name not in taken:
                tagged.setdefault((name, k), []).append(tag)
    return tagged


def _described(gmsh, wanted: Collection[str], label: str) -> Tagged:
    """The numbers of the faces, or in the plane curves, that are `wanted` by what they are. Raises InputError."""
    side = gmsh.model.getDimension() - 1
    described = [(part, form) for part in wanted if (form := Form.of(part, label))]
    return {(part, side): _find(gmsh, form, part, label) for part, form in described}


def _refuse_missing(
    gmsh,
    wanted: Collection[str],
    tagged: Tagged,
    side: int,
    label: str,
) -> None:
    """Raise InputError where a name that is `wanted` is none of those of `_called`."""
    names = {name for name, _ in tagged}
    for missing in wanted:
        if missing not in names:
            of = next((k for k in range(side) if missing.startswith(WHAT[k])), side)
            listed = "; ".join(
                f"{name} {where(gmsh, k, tags[0])}" for (name, k), tags in tagged.items() if k == of
            )
            raise InputError(f"{label} has no {WHAT[of]} {missing!r}; it has {listed}")


def _face(gmsh, k: int, tag: int) -> Face:
    """What the drawing says of a curve or a face."""
    try:
        measure = gmsh.model.occ.getMass(k, tag)
        words = _words(gmsh, k, tag)
    except Exception:  # gmsh's own kernel knows neither areas nor distances
        measure = curve_bend(gmsh, tag)[1] if k == 1 else 0.0
        words = ""
    place = _rounded(gmsh, box(gmsh, k, tag).mean(axis=0))
    kind = gmsh.model.getType(k, tag).lower()
    axis = tuple[tuple[float, ...], ...]()
    if _kind(gmsh, k, tag) == "cylinder":
        kind = "cylinder"
        axis = tuple(map(tuple, _axis(gmsh, k, tag).tolist()))
    return Face(kind, _radius(gmsh, k, tag), measure, place, words, axis)


def _kind(gmsh, k: int, tag: int) -> str:
    """One of the words of `FORM`."""
    kind = gmsh.model.getType(k, tag).lower()
    if kind == "ellipse":  # so gmsh draws discs
        steps = np.linalg.norm(np.diff(samples(gmsh, tag), axis=0), axis=1)
        kind = "circle" if np.ptp(steps) < SAME_PLACE * steps.max() else kind
    if kind in FREE and _is_cylinder(gmsh, tag):
        kind = "cylinder"
    return KINDS.get(kind, WHAT[k])


def _is_cylinder(gmsh, tag: int) -> bool:
    """Whether a face of any kind is a circular cylinder: one principal curvature is constant, and the other one zero."""
    at = parameters(gmsh, tag, _grid(5)).ravel()
    bends = np.sort(np.abs(gmsh.model.getPrincipalCurvatures(tag, at)[:2]), axis=0)
    near = SAME_PLACE * bends.max()
    return bool(bends[1].min() > 0.0 and bends[0].max() < near and np.ptp(bends[1]) < near)


def _radius(gmsh, k: int, tag: int) -> float:
    """The radius of a curve or a face (m), of a torus that of its tube; 0 where it has none."""
    if _kind(gmsh, k, tag) not in ROUND:
        return 0.0
    bend = (curve_bend, face_bend)[k - 1](gmsh, tag)[0]
    return 1.0 / bend if bend else 0.0


def _rounded(gmsh, at: np.ndarray) -> tuple[float, ...]:
    """A place (3,) to so many digits as the drawing has, in as many coordinates."""
    digits = 5 - int(np.log10(extent(gmsh)))
    return tuple((np.round(at[: gmsh.model.getDimension()], digits) + 0.0).tolist())


def _words(gmsh, k: int, tag: int) -> str:
    """A curve or a face by what it is, as `FORM` has it."""
    radius = _radius(gmsh, k, tag)
    normal = _normal(gmsh, k, tag)
    words = _kind(gmsh, k, tag) + f" r={radius:.6g}" * bool(radius)
    if normal.any():
        words += f" n={in_words(np.round(normal, 6) + 0.0)}"
    at = in_words(np.array(_rounded(gmsh, _inside(gmsh, k, tag)[1])), 9)
    return f"{words} at {at}".replace("e+", "e")  # a + puts names together


def inner_points(gmsh, tag: int) -> np.ndarray:
    """Points (n, 3) on a face, within it and at its corners, in an order that does not matter."""
    grid = parameters(gmsh, tag, _grid(5))
    within = [at for at in grid if gmsh.model.isInside(2, tag, at, parametric=True)]
    corners = gmsh.model.getBoundary([(2, tag)], recursive=True)
    at = [gmsh.model.getValue(0, corner, []) for _, corner in corners]
    at += [gmsh.model.getValue(2, tag, place) for place in within]
    return np.reshape(at, (-1, 3))


def _grid(count: int) -> np.ndarray:
    """Points (count², 2) between 0 and 1."""
    steps = (np.arange(count) + 0.5) / count
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


def _inside(gmsh, k: int, tag: int) -> tuple[np.ndarray, np.ndarray]:
    """A point within a curve or a face and about in its middle, by its parameters (k,) and its place (3,)."""
    low, high = gmsh.model.getParametrizationBounds(k, tag)
    middle = (low + high) / 2
    for count in GRIDS if k == 2 else ():
        grid = low + _grid(count) * (high - low)
        away = (np.abs(grid - middle) / (high - low)).max(axis=1)
        for at in grid[np.argsort(away, kind="stable")]:
            if gmsh.model.isInside(2, tag, at, parametric=True):
                return at, np.array(gmsh.model.getValue(2, tag, at))
    return middle, np.array(gmsh.model.getValue(k, tag, middle))


def _normal(gmsh, k: int, tag: int) -> np.ndarray:
    """The outer unit normal (3,) of a plane, else zero."""
    if _kind(gmsh, k, tag) != "plane":
        return np.zeros(3)
    place, at = _inside(gmsh, 2, tag)
    normal = np.array(gmsh.model.getNormal(tag, place))
    off = SAME_PLACE * extent(gmsh) * normal
    inward = any(gmsh.model.isInside(3, solid, at + off) for solid in _bounded(gmsh, 2, tag))
    return -normal if inward else normal


def _bounded(gmsh, k: int, tag: int) -> list[int]:
    """The solids of the body that a face bounds, or the surfaces that a curve does: of those that a script names, if it
    names any."""
    beside = gmsh.model.getAdjacencies(k, tag)[0].tolist()
    if not gmsh.model.getPhysicalGroups(k + 1):
        return beside
    return [one for one in beside if len(gmsh.model.getPhysicalGroupsForEntity(k + 1, one))]


def _is_apart(gmsh, k: int, tag: int) -> bool:
    """Whether a face or a curve bounds solids or surfaces, none of which is of the body."""
    return bool(len(gmsh.model.getAdjacencies(k, tag)[0])) and not _bounded(gmsh, k, tag)


def _axis(gmsh, k: int, tag: int) -> np.ndarray:
    """The ends (2, 3) of the axis of a cylinder, the centre (1, 3) of an arc or a sphere; of others nothing (0, 3)."""
    kind = _kind(gmsh, k, tag)
    radius = _radius(gmsh, k, tag)
    if kind == "arc":
        begin, middle, end = samples(gmsh, tag)[[0, SAMPLES // 2, -1]]
        inward = begin + end - 2.0 * middle
        return (middle + radius * inward / np.linalg.norm(inward))[None]
    if kind not in ("cylinder", "sphere"):
        return np.empty((0, 3))
    grid = parameters(gmsh, tag, np.indices((3, 3)).reshape(2, -1).T / 2).ravel()
    at = np.reshape(gmsh.model.getValue(2, tag, grid), (-1, 3))
    normal = np.reshape(gmsh.model.getNormal(tag, grid), (-1, 3))
    # of a hollow one the outer normals point to it
    centres = min(
        (at + sign * radius * normal for sign in (-1.0, 1.0)),
        key=lambda centre: np.linalg.svd(centre - centre.mean(axis=0))[1][1],
    )
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    ends = np.unravel_index(apart.argmax(), apart.shape)
    return centres[list(ends)] if kind == "cylinder" else centres[:1]


class _Fit(NamedTuple):
    """How well a face is meant: whether it is of another kind, or of another size or direction; its distance (m); the
    distance of its axis (m); its number."""

    unlike: bool
    other: bool
    away: float
    off_axis: float
    tag: int


def _fits(gmsh, form: Form, side: int) -> Iterator[_Fit]:
    """How well each curve or face is meant."""
    at = np.array([*form.at[: side + 1], *box(gmsh)[0, side + 1 :]])  # a plane drawing has any z
    point = gmsh.model.occ.addPoint(*at)
    try:
        for _, tag in gmsh.model.getEntities(side):
            if _is_apart(gmsh, side, tag):
                continue
            unlike = form.kind not in (_kind(gmsh, side, tag), WHAT[side])
            radius = _radius(gmsh, side, tag)
            axis = _axis(gmsh, side, tag)
            other = bool(form.radius) and abs(form.radius - radius) > WITHIN * form.radius
            if form.normal.any():
                other |= bool(np.linalg.norm(_normal(gmsh, side, tag) - form.normal) > WITHIN)
            off = np.inf
            if len(axis):
                off = float(np.linalg.norm(nearest_in(at[None], axis[None])[0] - at))
            away = gmsh.model.occ.getDistance(0, point, side, tag)[0]
            yield _Fit(unlike, other, min(away, off), off, tag)
    finally:
        gmsh.model.occ.remove([(0, point)])


def _find(gmsh, form: Form, name: str, label: str) -> list[int]:
    """The numbers of the curves or faces that are meant: one, or all around the axis of the point. Raises InputError."""
    side = gmsh.model.getDimension() - 1
    what = WHAT[side]
    size = extent(gmsh)
    if not gmsh.model.occ.getEntities(side):
        raise InputError(
            f"{label} has no {what} {name!r}: gmsh finds {what}s by what they are in STEP and BREP files, and after "
            'SetFactory("OpenCASCADE")'
        )
    fits = sorted(_fits(gmsh, form, side))
    best = fits[0]
    if best.unlike or best.other or best.away > WITHIN * size:
        raise InputError(
            f"{label} has no {what} {name!r}; the nearest one is {_words(gmsh, side, best.tag)!r} ({what} {best.tag})"
        )
    near = SAME_PLACE * size
    equal = [fit for fit in fits if fit[:2] == best[:2] and fit.away <= best.away + near]
    if len(equal) > 1 and not all(fit.off_axis <= fit.away + near for fit in equal):
        listed = "; ".join(f"{_words(gmsh, side, fit.tag)!r} ({what} {fit.tag})" for fit in equal)
        raise InputError(f"{label} has {len(equal)} {what}s {name!r}; choose one: {listed}")
    return [fit.tag for fit in equal]
