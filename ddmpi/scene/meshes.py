"""Types of the mesh of one body: a shape, a file, or a geometry."""

from itertools import product
from typing import Annotated, Literal

import msgspec
import numpy as np

from ddmpi.scene.values import Count, Group, NonNegative, Point, Positive, Table
from ddmpi.system.numbers import ALIKE, divisor

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

AROUND = 24
"""The default ``around``. With less than nine elements, 40 degrees from one side to the next, a contact has a corner."""

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
    elements : of a shape with divisions, "bricks": its cells are quadrilaterals or hexahedra; left out, "simplices"
    file : a mesh with groups: "x.msh" as gmsh writes it, in any version of its format; "x.inp" of Abaqus or CalculiX;
        "x.med"; "x.vtu" and "x.vtk". A body of quadrilaterals or of hexahedra alone keeps them; of all others,
        elements are cut into triangles or tetrahedra; see docs/start/drawing.md
    cut : whether quadrilaterals and hexahedra of a file are cut in any case
    integration : of quadrilaterals and hexahedra, "modes", of order 1 with incompatible modes, which do not lock in
        bending; "full"; or "reduced", of order 2, with a thousandth of the full rule. Left out, order 1 has modes,
        but around an axis, where they fail, and order 2 the full rule; see docs/use/elements.md
    geometry : a drawing (.geo, .step, .brep) with physical groups, or of a solid; see docs/start/drawing.md
    part : of a file or a geometry with several bodies the one of this body: by the name of its set of elements
        (ELSET), part or instance, MED group or gmsh's physical volume (surface in the plane); in a geometry by its name
        in the file or by its number
    contact_size : size of a geometry's elements along contacts (m); left out, a quarter of size
    size_on : sizes of a geometry's elements along groups by name or number (m), in contacts as well, as in
        { bore = 1.5, 27 = 3.0 }
    around : of a geometry, a ball and a cylinder: elements around a full circle, at least; left out, 24
    order : 1 for linear elements, 2 for quadratic ones, whose sides are curved along circles of an annulus, curves of
        a geometry, and as a second-order file has them; the same for all bodies. Left out, it follows another body
        that names it, then the preset; then it is 2 beside
        accuracy targets; then it follows the files; otherwise it is 1; see docs/use/elements.md
    refine : number of times that the sides of a file's mesh are halved, or "as needed" for accuracy targets; left out, with
        method.target as needed, else 0
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
    elements: Literal["simplices", "bricks"] | None = None
    file: str | None = None
    cut: bool = False
    integration: Literal["full", "modes", "reduced"] | None = None
    geometry: str | None = None
    part: Group | Count | None = None
    contact_size: Positive | None = None
    size_on: dict[Group, Positive] = {}
    around: Annotated[int, msgspec.Meta(ge=9, le=10_000)] | None = None
    order: Literal[1, 2] | None = None
    refine: Annotated[int, msgspec.Meta(ge=0, le=8)] | Literal["as needed"] | None = None

    def at_home(self, axisymmetric: bool) -> tuple[dict[str, tuple], tuple[float, ...]]:
        """The key with which the same shape is at the origin of coordinates, and its shift from there (m); around an axis
        it stays at its radius. Both are empty for meshes of other kinds, and the shift for a shape that is there. Not
        collective."""
        key = next((key for key in ("corners", "center") if getattr(self, key)), "origin")
        if not self.divisions:
            return {}, ()
        places = np.atleast_2d(getattr(self, key) or np.zeros(len(self.divisions)))
        shift = places[0] * (np.arange(places.shape[1]) >= axisymmetric)
        at = places - shift
        if (at + shift != places).any():  # nodes at corners are these to the last bit
            return {}, ()
        place = tuple(map(tuple, at.tolist())) if key == "corners" else tuple(at[0].tolist())
        return {key: place}, tuple(shift.tolist()) if shift.any() else ()

    @property
    def halvings(self) -> int:
        """Number of times that the sides of the file's mesh are halved."""
        return self.refine if isinstance(self.refine, int) else 0

    @property
    def drawn(self) -> bool:
        """Whether gmsh meshes it in the run."""
        return self.geometry is not None or self.shape in DRAWN

    @property
    def has_modes(self) -> bool:
        """Whether it says that it has incompatible modes; one of a file may have them without."""
        return self.integration == "modes" or (self.elements == "bricks" and not self.integration)

    @property
    def refinable(self) -> bool:
        """Whether an accuracy target may refine the mesh."""
        return self.file is None or self.refine == "as needed"

    @property
    def closed(self) -> bool:
        """Whether an annulus is a whole ring, without start and end."""
        return self.angles is not None and abs(self.angles[1] - self.angles[0] - 360) <= 360 * ALIKE

    def __post_init__(self) -> None:
        self._check_source()
        self._check_others()
        needed = SIZED if self.geometry else SHAPES.get(self.shape or "", {})
        self._check_keys(needed)
        self._check_numbers(needed)
        if self.drawn:
            self._check_sizes()
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

    def _check_source(self) -> None:
        """Raise ValueError unless the mesh is either a shape, a file of a mesh, or a drawing."""
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
        if self.geometry is not None and not self.geometry.lower().endswith(GEOMETRIES):
            mesh = "; a mesh is given by file = …" * self.geometry.endswith(".msh")
            raise ValueError(
                f"geometry = {self.geometry!r} must end with one of {', '.join(GEOMETRIES)}{mesh}"
            )

    def _check_others(self) -> None:
        """Raise ValueError if a key is given that belongs to other meshes."""
        if any(self.origin or ()) and self.shape not in WITH_ORIGIN:
            raise ValueError(f"origin belongs to a rectangle or a box, not to {self._what}")
        for key in ("contact_size", "size_on", "around"):
            if getattr(self, key) and not self.drawn:
                raise ValueError(f"{key} belongs to a geometry, not to {self._what}")
        self._check_cells()
        if self.part and self.shape:
            raise ValueError(f"part belongs to a geometry or a file, not to {self._what}")

    def _check_cells(self) -> None:
        """Raise ValueError if a key about bricks is given that belongs to other meshes."""
        if self.elements and not self.divisions:
            raise ValueError(f"elements belongs to a shape with divisions, not to {self._what}")
        if self.cut and not self.file:
            raise ValueError(f"cut belongs to a file, not to {self._what}")
        if self.integration and (self.cut or not (self.file or self.elements == "bricks")):
            raise ValueError(
                'integration belongs to a file that is not cut, or to a shape with elements = "bricks"'
            )

    def _check_numbers(self, needed: dict[str, str]) -> None:
        """Raise ValueError unless lists have as many numbers as the shape has directions or corners."""
        d = self.dimension or 0
        what = self.shape or "geometry"
        for key, number in (("size", 0 if self.drawn else d), ("divisions", d), ("corners", 2**d)):
            value = getattr(self, key)
            given = len(value) if isinstance(value, tuple) else 0
            if key not in needed or given == number:
                continue
            if key == "corners":
                raise ValueError(f"{key}: a {what} has {number} corners, got {given}")
            got = list(value) if isinstance(value, tuple) else value
            raise ValueError(f"{key}: a {what} has {key} = {needed[key]}, got {got}")

    def _check_sizes(self) -> None:
        """Raise ValueError if an element may be larger along a contact or a group than elsewhere."""
        smaller = {"contact_size": (self.contact_size or 0.0, "contacts")}
        for name, size in self.size_on.items():
            smaller[f"size_on.{name}"] = size, repr(name)
        for key, (size, along) in smaller.items():
            if size > self.largest:
                raise ValueError(
                    f"{key} = {size:g}, along {along}, must not exceed size = {self.largest:g}, which is "
                    "the largest"
                )

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
    unit = UNIT_CUBE[: len(x), : len(x[0])]
    d = len(x[0])
    along = 1.0 - np.abs(unit - np.array(list(product((0.0, 0.5, 1.0), repeat=d)))[:, None])
    slopes = np.stack(
        [(2 * unit[:, k] - 1) * np.delete(along, k, axis=2).prod(axis=2) for k in range(d)], axis=1
    )
    edges = slopes @ x
    size = np.linalg.norm(edges, axis=2, keepdims=True)
    sines = np.linalg.det(edges / divisor(size))
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
