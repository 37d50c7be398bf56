"""Types of the mesh of one body: a shape, a file, or a geometry; and of motions that take bodies far from there."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from ddmpi.scene.values import Count, Group, Name, NonNegative, Number, Point, Positive, Table
from ddmpi.system.numbers import ALIKE, Frame

LARGEST_SIZE = "h, the largest size of an element"
"""What ``size`` is of a drawing."""

SHAPES = {
    "rectangle": {"size": "[width, height]", "divisions": "[nx, ny]"},
    "quadrilateral": {"corners": "[[x, y], …]", "divisions": "[nx, ny]"},
    "annulus": {
        "center": "[x, y]",
        "radii": "[inner, outer]",
        "angles": "[start, end]",
        "divisions": "[around, across]",
    },
    "box": {"size": "[length, depth, height]", "divisions": "[nx, ny, nz]"},
    "hexahedron": {"corners": "[[x, y, z], …]", "divisions": "[nx, ny, nz]"},
    "ball": {"center": "[x, y, z]", "radius": "r", "size": LARGEST_SIZE},
    "cylinder": {
        "center": "[x, y, z] of the lower end",
        "axis": "[0, 0, 1]",
        "radii": "[inner or 0, outer]",
        "height": "h",
        "size": LARGEST_SIZE,
    },
}
"""The keys of the shapes, and how to write them."""

SIZED = {"size": LARGEST_SIZE}
"""The same for a geometry."""

WITH_ORIGIN = ("rectangle", "box")
"""Shapes with an optional ``origin``."""

SOLIDS = ("box", "hexahedron", "ball", "cylinder")
"""The shapes in space; the others are in the plane."""

DRAWN = ("ball", "cylinder")
"""The shapes that gmsh meshes, as it does a geometry."""

CORNER = 1e-8
"""Smallest sine of a corner of a quadrilateral, as triangles at a flatter one have almost no area; of a hexahedron the
smallest volume of unit vectors along the edges of its map."""

UNIT_CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
"""Corners in the order of those of a hexahedron."""

GEOMETRIES = (".geo", ".step", ".stp", ".brep", ".brp")
"""Endings of the files of geometries."""

TOWARDS_CONTACTS = 0.25
"""The default ``contact_size`` of a geometry over its ``size``."""

Sizes = Annotated[tuple[Positive, ...], msgspec.Meta(min_length=2, max_length=3)] | Positive
"""A size in each direction, or one number."""

Angle = Annotated[float, msgspec.Meta(ge=-720, le=720)]


class MeshSpec(Table, frozen=True, kw_only=True):
    """The mesh of one body: a generated ``shape``, a ``file``, or a ``geometry`` that gmsh meshes in the run.

    Paths of files are relative to the scene's folder, else to the current folder.

    Attributes
    ----------
    shape : "rectangle" needs size and divisions and has the boundary groups left, right, bottom and top;
        "quadrilateral", a convex one, needs corners and divisions and has bottom, right, top and left in the order of
        its corners; "annulus" needs center, radii, angles and divisions and has inner, outer, start and end. In space
        "box" needs size and divisions and has left and right along x, front and back along y, bottom and top along z;
        "hexahedron" needs corners and divisions and has the groups of a box, as its corners are those of one;
        "ball" needs center, radius and size and has the group surface; "cylinder" needs center, axis, radii, height and
        size and has bottom, top and outer, and inner if it is a tube
    origin : corner of a rectangle or a box with the least coordinates (m); left out, the origin of coordinates
    size : of a rectangle or a box its extents (m); of a geometry, a ball and a cylinder the largest size of an element
        (m): smaller sizes in a .geo remain, contacts have finer elements, and an accuracy target makes the mesh finer
        where the error is
    corners : of a quadrilateral, counter-clockwise (m); of a hexahedron the four of its bottom, counter-clockwise seen
        from the top, and then the four above them
    center : of an annulus, of a ball, of the lower end of a cylinder (m)
    radius : of a ball (m)
    radii : of an annulus or a cylinder, [inner, outer] (m); the inner one of a cylinder that is no tube is 0
    axis : of a cylinder, from its bottom to its top, of any length
    height : of a cylinder (m)
    angles : of an annulus, [start, end] in degrees; if they are 360 apart, it is closed and has no start and end
    divisions : numbers of cells, each cut into two triangles: [nx, ny], of an annulus [around, across]; in space
        [nx, ny, nz], each cut into six tetrahedra
    file : triangles or tetrahedra with groups: "x.msh" as gmsh writes it, in any version of its format; "x.inp" of
        Abaqus or CalculiX; "x.med"; "x.vtu" and "x.vtk"; other elements are cut into these; see docs/start/drawing.md
    geometry : a drawing (.geo, .step, .brep) with physical groups, or of a solid; see docs/start/drawing.md
    part : of a file or a geometry with several bodies the one of this body: by the name of its set of elements
        (ELSET), part or instance, MED group or gmsh's physical volume (surface in the plane); in a geometry by its name
        in the file or by its number
    contact_size : size of a geometry's elements along contacts (m); left out, a quarter of size
    size_on : sizes of a geometry's elements along groups by name or number (m), in contacts as well, as in
        { bore = 1.5, 27 = 3.0 }
    order : 1 for linear elements, 2 for quadratic ones, whose sides are curved along circles of an annulus, curves of
        a geometry, and as a second-order file has them; the same for all bodies. Left out, it follows another body
        that names it, then the preset, then the files; otherwise it is 1; see docs/use/elements.md
    refine : number of times that the sides of a file's mesh are halved, or "as needed" for method.target_error
    """

    shape: (
        Literal["rectangle", "quadrilateral", "annulus", "box", "hexahedron", "ball", "cylinder"]
        | None
    ) = None
    origin: Point | None = None
    size: Sizes | None = None
    corners: Annotated[tuple[Point, ...], msgspec.Meta(min_length=4, max_length=8)] | None = None
    center: Point | None = None
    radius: Positive | None = None
    radii: tuple[NonNegative, Positive] | None = None
    axis: Point | None = None
    height: Positive | None = None
    angles: tuple[Angle, Angle] | None = None
    divisions: Annotated[tuple[Count, ...], msgspec.Meta(min_length=2, max_length=3)] | None = None
    file: str | None = None
    geometry: str | None = None
    part: Group | Count | None = None
    contact_size: Positive | None = None
    size_on: dict[Group, Positive] = {}
    order: Literal[1, 2] | None = None
    refine: Annotated[int, msgspec.Meta(ge=0, le=8)] | Literal["as needed"] = 0

    @property
    def halvings(self) -> int:
        """Number of times that the sides of the file's mesh are halved."""
        return self.refine if isinstance(self.refine, int) else 0

    @property
    def drawn(self) -> bool:
        """Whether gmsh meshes it in the run."""
        return self.geometry is not None or self.shape in DRAWN

    @property
    def refinable(self) -> bool:
        """Whether an accuracy target may refine the mesh."""
        return self.file is None or self.refine == "as needed"

    @property
    def closed(self) -> bool:
        """Whether an annulus is a whole ring, without start and end."""
        return self.angles is not None and abs(self.angles[1] - self.angles[0] - 360) <= 360 * ALIKE

    def __post_init__(self) -> None:
        if self.file is None and self.refine:
            raise ValueError(
                "refine belongs to a file; for a shape, raise divisions, for a geometry, lower size"
            )
        if sum(source is not None for source in (self.shape, self.file, self.geometry)) != 1:
            raise ValueError(
                'a mesh is either { file = "….msh" } or { geometry = "….geo", size = … } or has a shape, '
                f'one of {", ".join(SHAPES)}, as in {{ shape = "rectangle", size = …, divisions = … }}'
            )
        if str(self.file).lower().endswith(GEOMETRIES):
            raise ValueError(
                f'{self.file} is a drawing; write geometry = "{self.file}", size = h, the largest size of '
                "an element"
            )
        if any(self.origin or ()) and self.shape not in WITH_ORIGIN:
            raise ValueError(f"origin belongs to a rectangle or a box, not to {self._what}")
        if self.geometry is not None and not self.geometry.lower().endswith(GEOMETRIES):
            mesh = "; a mesh is given by file = …" * self.geometry.endswith(".msh")
            raise ValueError(
                f"geometry = {self.geometry!r} must end with one of {', '.join(GEOMETRIES)}{mesh}"
            )
        for key, wrong in (
            ("contact_size", not self.drawn),
            ("size_on", not self.drawn),
            ("part", bool(self.shape)),
        ):
            if getattr(self, key) and wrong:
                raise ValueError(
                    f"{key} belongs to a geometry{' or a file' * (key == 'part')}, not to {self._what}"
                )
        needed = SIZED if self.geometry else SHAPES.get(self.shape or "", {})
        self._check_keys(needed)
        d = self.dimension or 0
        for key, number in (("size", d * (not self.drawn)), ("divisions", d), ("corners", 2**d)):
            value = getattr(self, key)
            if key in needed and (len(value) if isinstance(value, tuple) else 0) != number:
                got = list(value) if isinstance(value, tuple) else value
                raise ValueError(
                    f"{key}: a {self.shape or 'geometry'} has "
                    + (
                        f"{number} corners, got {len(got)}"
                        if key == "corners"
                        else f"{key} = {needed[key]}, got {got}"
                    )
                )
        smaller = {"contact_size": (self.contact_size or 0.0, "contacts")} | {
            f"size_on.{name}": (size, repr(name)) for name, size in self.size_on.items()
        }
        for key, (size, along) in smaller.items():
            if self.drawn and size > self.largest:
                raise ValueError(
                    f"{key} = {size:g}, along {along}, must not exceed size = {self.largest:g}, which is "
                    "the largest"
                )
        if self.corners and all(len(corner) == self.dimension for corner in self.corners):
            _check_corners(self.corners)
        if self.radii and self.radii[0] >= self.radii[1]:
            raise ValueError(
                f"radii = [inner, outer] must ascend, got [{self.radii[0]:g}, {self.radii[1]:g}]"
            )
        if self.axis and not any(self.axis):
            raise ValueError(
                "axis must not be zero; it goes from the bottom of a cylinder to its top"
            )
        if self.radii and self.angles and self.divisions:
            self._check_ring(self.radii, self.angles, self.divisions[0])

    @property
    def dimension(self) -> int | None:
        """Number of coordinates of a shape's points; None where a file or a drawing decides."""
        return None if self.shape is None else 3 if self.shape in SOLIDS else 2

    @property
    def _what(self) -> str:
        return f'shape = "{self.shape}"' if self.shape else "a file" if self.file else "a geometry"

    @property
    def largest(self) -> float:
        """The largest size of an element of a geometry (m)."""
        assert isinstance(self.size, float)
        return self.size

    def _check_keys(self, needed: dict[str, str]) -> None:
        """Raise ValueError unless all the `needed` keys are given, and those of no other shape."""
        for key in dict.fromkeys(key for keys in SHAPES.values() for key in keys):
            if getattr(self, key) is None and key in needed:
                how = ", ".join(f"{key} = {form}" for key, form in needed.items())
                raise ValueError(f"{self._what} needs {how}; {key} is missing")
            if getattr(self, key) is not None and key not in needed:
                owners = [shape for shape, keys in SHAPES.items() if key in keys]
                owners = [shape for shape in owners if shape not in DRAWN] or owners
                owner = (
                    "a shape"
                    if key == "divisions"
                    else f'shape = "{owners[0]}"'
                    + "".join(f' or "{shape}"' for shape in owners[1:])
                )
                raise ValueError(f"{key} belongs to {owner}, not to {self._what}")

    def _check_ring(
        self, radii: tuple[float, float], angles: tuple[float, float], around: int
    ) -> None:
        if not radii[0]:
            raise ValueError("radii.0: expected a number > 0; only a cylinder may have no bore")
        span = angles[1] - angles[0]
        if not 0 < span <= 360 * (1 + ALIKE):
            raise ValueError(
                f"angles = [start, end] must ascend by at most 360 degrees, which make a whole ring; got "
                f"[{angles[0]:g}, {angles[1]:g}]"
            )
        if span / around >= 180:
            raise ValueError(
                f"divisions = [around, across]: {around} around make cells of {span / around:g} degrees; "
                "they must be less than 180"
            )


def _check_corners(corners: tuple[Point, ...]) -> None:
    """Raise ValueError unless the corners are those of a convex quadrilateral, counter-clockwise, or of a hexahedron
    with positive volumes of its trilinear map: by the edges of the map at 9 or 27 points."""
    x = np.array(corners)
    unit, d = UNIT_CUBE[: len(x), : len(x[0])], len(x[0])
    along = 1.0 - np.abs(unit - np.array(list(product((0.0, 0.5, 1.0), repeat=d)))[:, None])
    slopes = np.stack(
        [(2 * unit[:, k] - 1) * np.delete(along, k, axis=2).prod(axis=2) for k in range(d)], axis=1
    )
    edges = slopes @ x
    size = np.linalg.norm(edges, axis=2, keepdims=True)
    sines = np.linalg.det(edges / np.where(size > 0.0, size, 1.0))
    base = (
        "the four of the bottom, counter-clockwise seen from the top, and then the four above them"
    )
    if (sines < -CORNER).all():
        turned = ", ".join(f"[{x!r}, {y!r}]" for x, y, *_ in (corners[0], *corners[:0:-1]))
        raise ValueError(
            f"corners make a hexahedron that is turned inside out; write {base}"
            if d > 2
            else f"corners run clockwise; write them counter-clockwise, as in corners = [{turned}]"
        )
    if not (sines > CORNER).all():
        raise ValueError(
            f"corners must be those of a convex hexahedron: {base}"
            if d > 2
            else "corners must be those of a convex quadrilateral in their order along its boundary, without "
            "corners of 0 or 180 degrees"
        )


class SettledMesh(MeshSpec, frozen=True, kw_only=True):
    """A mesh of known order."""

    order: Literal[1, 2]


class Motion(Table, frozen=True, kw_only=True):
    """A motion of any size, prescribed or free; see docs/use/far.md.

    Attributes
    ----------
    shift : along the axes (m); left out, none
    turn : about the pivot, counterclockwise (degrees); left out, none
    pivot : of a turn, also of a free one, in the coordinates of the drawing (m); left out, the origin
    axis : of a turn in space, by the right-hand rule; a free turn without it is one about all axes
    history : [history.NAME] whose factor multiplies shift and turn, or force and moment
    free : instead of shift and turn, components that forces decide, as in ["turn"] or ["x", "y"]
    force : along the free axes, at the pivot (N; in the plane per metre of depth)
    moment : of a free turn, about the pivot (N m; in the plane per metre of depth), in space about the axis or [x, y,
        z]
    """

    shift: Point | None = None
    turn: Number | None = None
    pivot: Point | None = None
    axis: Point | None = None
    history: Name | None = None
    free: Annotated[list[Literal["x", "y", "z", "turn"]], msgspec.Meta(min_length=1)] | None = None
    force: Point | None = None
    moment: Number | Point = 0.0

    def __post_init__(self) -> None:
        prescribed, free = self.turn is not None or self.shift is not None, self.free or ()
        if prescribed == bool(free):
            raise ValueError(
                "a motion has a shift (m), as in shift = [0.0, -20.0], or a turn (degrees), as in turn = "
                '90.0, or both; or it is free, as in free = ["turn"]'
            )
        for key in ("pivot", "axis"):
            if getattr(self, key) is not None and self.turn is None and "turn" not in free:
                raise ValueError(
                    f"{key} is that of a turn; leave it out, or write turn = … (degrees)"
                )
        if self.axis is not None and not any(self.axis):
            raise ValueError("axis must not be zero; a turn is about it, by the right-hand rule")
        if len({*free}) < len(free):
            raise ValueError("free names a component twice")
        if self.moment and "turn" not in free:
            raise ValueError('moment: needs a free turn: write free = ["turn"], or leave it out')
        for axis, component in zip("xyz", self.force or (), strict=False):
            if component and axis not in free:
                raise ValueError(
                    f'force: acts along {axis}, which is not free; write free = ["{axis}"], or 0 there'
                )

    def frame(self, factor: float, dimension: int) -> Frame:
        """Where it leads at a factor of its history; nowhere if it is free."""
        shift = np.zeros(dimension) if self.shift is None else factor * np.array(self.shift)
        return Frame.of(shift, factor * (self.turn or 0.0) * self.about, self.pivot)

    @property
    def about(self) -> np.ndarray:
        """The axis of its turn, a unit vector (3,); in the plane (1,)."""
        return np.ones(1) if self.axis is None else np.array(self.axis) / np.linalg.norm(self.axis)


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
    factors, frames = scene.factors(time), {}
    for each in (*scene.body, *scene.rigid):
        frame, gone = frame_of(each.motion, factors, scene.dimension), (freed or {}).get(each.name)
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


def check_motions(scene: Any) -> None:
    """ValueError where a `Scene` has motions that do not go with the rest of it."""
    far = scene.time is not None and scene.time.motions == "far"
    movers = [
        (f"{kind}.{each.name}", each) for kind in ("body", "rigid") for each in getattr(scene, kind)
    ]
    moving = [(key, each, parts_of(each.motion)) for key, each in movers if each.motion]
    following = [
        f"body.{body.name}.traction.{k}.follows"
        for body in scene.body
        for k, load in enumerate(body.traction)
        if load.follows
    ]
    if not far:
        for key in [*(f"{key}.motion" for key, *_ in moving), *following]:
            raise ValueError(
                f'{key}: bodies move far with motions = "far" in [time] only; write it there, or leave '
                "this out" + "; small motions are those of clamps" * key.endswith("motion")
            )
        return
    if not moving and all(body.clamp or body.foundation for body in scene.body):
        raise ValueError(
            "time.motions: no body and no rigid partner has a motion, and clamps hold all bodies; leave "
            'motions = "far" out'
        )
    if scene.time.cycle:
        raise ValueError(
            'time.cycle: does not go with motions = "far"; write the times of all turning points'
        )
    if scene.output.derivatives:
        raise ValueError(
            'output.derivatives: there are none with time.motions = "far"; leave one of them out'
        )
    if scene.method.compliance not in (None, "explicit"):
        raise ValueError(
            f'method.compliance: {scene.method.compliance!r} does not go with time.motions = "far", for '
            "which the compliance of all contact nodes is made once; leave it out"
        )
    for key, mover, motions in moving:
        free = [part.free for part in motions if part.free]
        moved = {"turn"} & {"turn" * bool(part.turn) for part in motions} | {
            axis
            for part in motions
            for axis, way in zip("xyz", part.shift or (), strict=False)
            if way
        }
        if scene.axisymmetric and not moved | set(*free[:1]) <= {"y"}:
            raise ValueError(
                f"{key}.motion: axisymmetric bodies shift along y only, as in shift = [0.0, -20.0]"
            )
        if len(free) > 1:
            raise ValueError(
                f'{key}.motion: has {len(free)} free parts; write one, as in free = ["x", "turn"]'
            )
        for axis in sorted(moved & set(*free)):
            raise ValueError(
                f"{key}.motion: prescribes {axis} in one part and frees it in another; leave one of them "
                "out"
            )
        if key.startswith("rigid") and any(part.free and part.axis for part in motions):
            raise ValueError(
                f"{key}.motion.axis: a rigid partner turns freely about all axes through its pivot; leave "
                "axis out"
            )
        if getattr(mover, "displacement", None):
            raise ValueError(f"{key}: has both a motion and a displacement; leave one of them out")
    for rigid in scene.rigid:
        if rigid.yields or any(rigid.displacement or ()):
            raise ValueError(
                f'rigid.{rigid.name}: with time.motions = "far" a partner moves as its motion says, not '
                "by a displacement, forces or moments; write motion = { shift = […] }"
            )
    for contact in scene.contact:
        name, law = f"contact.{contact.called}", contact.friction
        for key, given, why in (
            ("kind", contact.kind != "unilateral", "only unilateral contacts slide far"),
            ("gap", contact.gap is not None, "gaps are measured where the bodies are"),
            ("pairing", contact.pairing == "nodes", "nodes do not stay opposite each other"),
            (
                "friction",
                not all(isinstance(value, float | int) for value in msgspec.structs.astuple(law)),
                "profiles along a contact are not possible yet",
            ),
        ):
            if given:
                raise ValueError(f'{name}.{key}: does not go with time.motions = "far": {why}')
