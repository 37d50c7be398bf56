"""Geometries (.geo, .step, .brep): meshed by gmsh, finer towards contacts, or as an estimated error asks for.

A .geo is a program. gmsh gets a copy of it, in a folder of its own, in which nothing starts programs or writes files.
"""

import contextlib
import os
import re
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from msgspec.structs import asdict

from ddmpi.errors import InputError, nearest
from ddmpi.mesh.boundary import (
    OFF,
    box,
    curve_bend,
    extent,
    face_bend,
    keep_part,
    parts_of,
    samples,
)
from ddmpi.mesh.cache import keep, name_of, recall
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.forms import name_sides
from ddmpi.mesh.mesh import PHYSICAL, Faces, Mesh
from ddmpi.mesh.read import MSH, gmsh_session, name_groups, read_mesh
from ddmpi.mesh.refine import GRADE, Sizes
from ddmpi.mesh.shapes import draw_shape
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.meshes import AROUND, MeshSpec
from ddmpi.system.interrupt import apart

T = TypeVar("T")

TRUST = "DDMPI_TRUST_GEOMETRY"
"""The environment variable that allows drawings to start programs and write files, if it is 1."""

HARMFUL = re.compile(
    rb"\b(System|SystemCall|NonBlockingSystemCall|OnelabRun|ExternalProcess|Plugin|SendToServer|Save"
    rb"|CreateDir|(?:Tmp|Session|Options|Error)FileName|S2N|StringToName|Print(?!\s*\.))\b"
)
"""Commands of a .geo that start programs or write files, or that build such a command from strings."""

SKIPPED = re.compile(rb"""("[^"]*"|'[^']*')|//[^\n]*|/\*.*?\*/""", re.S)
"""A string of a .geo, or a comment."""

READS = re.compile(
    rb"""\b(Include|Merge|MergeWithBoundingBox|ShapeFromFile|ListFromFile|FileExists|FileName)\b"""
    rb"""([\s=(\[]*)(?:"([^"\n]{1,999})"|'([^'\n]{1,999})')?"""
)
"""Commands of a .geo that read another file, and its name; gmsh cuts strings at 1023 characters and reads on."""

READ_AS_DATA = (".step", ".stp", ".brep", ".brp", ".iges", ".igs", ".stl")
"""Lower-case endings of files that gmsh never reads as scripts."""

MOST = 200
"""Most elements along a curve or a face because of its curvature."""

ALIKE = 0.1
"""Curves are alike if the logarithms of their sizes differ by less."""

NEAR = 2.0
"""Elements have the size of contacts up to this multiple of the size away from them."""

TOO_MANY = 2e7
"""More cells of a body mean a size in other units than the drawing; gmsh would take minutes and all memory."""

FILLED = 0.01
"""Fraction of its box that a thin solid fills."""

TINY = 1e-6
"""Curves below this fraction of the drawing, as at poles, are straight."""

SHELL = 1e-4
"""A face is in a plane z = … if its box is flatter than this fraction of the drawing; gmsh's boxes are a little wide."""

DRAWN = "drawn.msh"
"""The mesh that gmsh writes."""

_OPTIONS = {
    "General.NumThreads": 1,
    "Mesh.MaxNumThreads1D": 1,
    "Mesh.MaxNumThreads2D": 1,
    "Mesh.MaxNumThreads3D": 1,
    "Mesh.RandomSeed": 1,
    "Mesh.ElementOrder": 1,
    "Mesh.SecondOrderLinear": 0,
    "Mesh.MshFileVersion": 4.1,
    "Mesh.Binary": 1,
    "Mesh.SaveAll": 0,
    "Mesh.SaveParametric": 0,
    "Mesh.MeshOnlyVisible": 0,
    "Mesh.MeshOnlyEmpty": 0,
    "Mesh.RecombineAll": 0,
    "Mesh.SubdivisionAlgorithm": 0,
    "Mesh.ScalingFactor": 1,
}
"""Options that a file cannot change."""


def mesh_geometry(
    path: Path | None, body: BodySpec, contacts: Collection[str], sizes: Sizes | None = None
) -> Mesh:
    """The mesh of a geometry, or of a shape that gmsh draws, with its physical groups; in order 2 its sides are curved
    along curves and faces.

    Elements have at most the ``size`` of the body's mesh, smaller ones where the file says so, those of ``size_on``
    along its groups and ``contact_size`` along other ones in `contacts`; with `sizes` they have these, and the file's
    are not heeded. The same input gives the same mesh. In STEP and BREP files every curve, or face of a solid, is a
    group by its label and its number; see `name_sides`. Of an assembly the ``part`` alone is meshed.

    Not collective. Raises InputError for a file that gmsh cannot read or mesh, or that is neither plane nor solid.
    """
    label = (
        f"body.{body.name}.mesh.geometry: {path}"
        if path
        else f"body.{body.name}.mesh: the {body.mesh.shape}"
    )
    script = path is None or path.suffix.lower() == ".geo"
    with _opened(path, label) as (folder, source):
        groups = [*contacts], [acting.on for _, acting in body.acting]
        name = name_of(folder, script, asdict(body.mesh), groups, sizes) * (not _trusted())
        faces = recall(name, folder / DRAWN)
        begun = time.monotonic()
        if faces is None:
            doing = f"body.{body.name}: gmsh is meshing {path.name if path else body.mesh.shape}"
            faces = apart(folder, _draw, source, script, body, contacts, sizes, label, doing=doing)
            keep(name, folder / DRAWN, faces, time.monotonic() - begun)
        return replace(
            read_mesh(folder / DRAWN, body.name, body.mesh.order or 1, label), faces=faces
        )


def dimension_of(path: Path, label: str) -> int:
    """The dimension of a drawing, 3 if it has volumes, else 2. Not collective. Raises InputError, which begins with
    `label`, for a file that gmsh cannot read."""
    return in_drawing(_dimension, path, label)


def in_drawing(look: Callable[[Any], T], path: Path, label: str) -> T:
    """What a function of a module finds with gmsh in a drawing that has a body. Not collective. Raises InputError, which
    begins with `label`, for a file that gmsh cannot read."""
    with _opened(path, label) as (folder, source):
        script = path.suffix.lower() == ".geo"
        doing = f"gmsh is reading {path.name}"
        found: T = apart(folder, _look, look, source, script, label, doing=doing)
        return found


def _look(look: Callable[[Any], T], source: Path, script: bool, label: str) -> T:
    with gmsh_session() as gmsh, _gmsh_errors(f"{label} cannot be read"):
        gmsh.open(str(source))
        _refuse_no_body(gmsh, script, label)
        return look(gmsh)


def _dimension(gmsh) -> int:
    return max(int(gmsh.model.getDimension()), 2)


def _refuse_no_body(gmsh, script: bool, label: str) -> None:
    """Raise InputError where a drawing has neither solids nor surfaces."""
    if gmsh.model.getEntities(2):
        return
    has = "nothing but curves and points" if gmsh.model.getEntities(0) else "nothing drawn in it"
    raise InputError(
        f"{label} has no surface: "
        + (
            "Plane Surface(1) = {1};"
            if script
            else f"it has {has}; export the solids, or plane faces"
        )
    )


def _refuse_shell(gmsh, script: bool, label: str) -> None:
    """Raise InputError where a CAD file has faces in space that bound no solid."""
    if script or gmsh.model.getDimension() > 2:
        return
    for _, tag in gmsh.model.getEntities(2):
        if np.diff(box(gmsh, 2, tag), axis=0)[0, 2] > SHELL * extent(gmsh):
            raise InputError(
                f"{label} has no solid: its face {tag} is not in a plane z = …, and bounds none; join the faces to a "
                "solid before exporting them (CAD programs: sew, make solid)"
            )


@contextlib.contextmanager
def _opened(path: Path | None, label: str) -> Iterator[tuple[Path, Path | None]]:
    """A folder for gmsh, and the copy in it of a drawing, if there is one; messages then name the drawing itself."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        copies: dict[Path, Path] = {}
        source = _copy(path.resolve(), copies, folder, label) if path else None
        try:
            yield folder, source
        except InputError as error:
            for original, copy in copies.items():
                error.args = (str(error).replace(str(copy), str(original)),)
            raise
        except ChildProcessError as error:
            exits = any(re.search(rb"\bExit\b", copy.read_bytes()) for copy in copies.values())
            raise InputError(f"{label} ends gmsh ({error})" + "; leave out Exit" * exits) from None


def _copy(path: Path, copies: dict[Path, Path], folder: Path, label: str) -> Path:
    """A copy in `folder` that gmsh may open, beside which no file of options lies, of a drawing and of all that it
    includes; `copies` has those made so far. Raises InputError for a script that may do more than draw."""
    if path in copies:
        return copies[path]
    suffix = path.suffix.lower()
    content = _content(path, label)
    if suffix not in READ_AS_DATA:
        suffix = ".msh" if content.startswith(MSH) else ".geo"
    copy = copies[path] = folder / f"{len(copies)}{suffix}"
    copy.write_bytes(_tamed(content, path, copies, folder, label) if suffix == ".geo" else content)
    return copy


def _trusted() -> bool:
    """Whether drawings may do what they like, such as read files whose names nobody knows before."""
    return os.environ.get(TRUST) == "1"


def _content(path: Path, label: str) -> bytes:
    if path.exists() and not path.is_file() and not path.is_dir():  # a pipe has no end
        raise InputError(f"{label}: {path} is no file")
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{label}: {path} cannot be read: {error.strerror}") from None


def _tamed(script: bytes, path: Path, copies: dict[Path, Path], folder: Path, label: str) -> bytes:
    """The `script` without comments, and with copies of the files that it names. Raises InputError for a harmful one.
    Comments go because gmsh skips loops and conditions by other rules than those by which it reads them."""
    if _trusted():
        return b'Include "%b";\n' % os.fsencode(path)
    script = SKIPPED.sub(lambda match: match[1] or b" " + b"\n" * match[0].count(b"\n"), script)

    def refuse(word: re.Match[bytes], what: str) -> None:
        line = 1 + script.count(b"\n", 0, word.start())
        raise InputError(
            f"{label} {what} ({word[1].decode()} in line {line} of {path.name}); for a drawing that you "
            f"trust as you would a program, set {TRUST}=1 in the environment"
        )

    def use_copy(read: re.Match[bytes]) -> bytes:
        word, between, *names = read.groups()
        name = names[0] or names[1]
        data = word in (b"ListFromFile", b"FileExists", b"FileName")
        if name is None and not data:
            refuse(read, "reads a file whose name is not written out")
        other = (path.parent / os.fsdecode(name or b"")).resolve()
        if data and not other.is_file():
            return read[0]
        if data:
            copy = folder / f"data{len(os.listdir(folder))}"
            copy.write_bytes(_content(other, label))
        else:
            copy = _copy(other, copies, folder, label)
        return b'%b%b"%b"' % (word, between, os.fsencode(copy))

    if match := HARMFUL.search(script):
        refuse(match, "could start programs or write files")
    printing = re.sub(rb"\bPrintf\b", b"Warning", script)  # Printf may write into a file
    return READS.sub(use_copy, printing) + b"\n"  # without it gmsh 4.15 would lose statements


def _draw(
    source: Path | None,
    script: bool,
    body: BodySpec,
    contacts: Collection[str],
    sizes: Sizes | None,
    label: str,
) -> Faces:
    """Write the mesh of the drawing `source`, or of a shape, as DRAWN, and say what its numbered faces are; for a
    process that does nothing else. Raises InputError."""
    with gmsh_session() as gmsh, _gmsh_errors(f"{label} cannot be meshed"):
        with _gmsh_errors(f"{label} cannot be read"):
            gmsh.open(str(source)) if source else draw_shape(gmsh, body.mesh)
        d = gmsh.model.getDimension()
        _refuse_no_body(gmsh, script, label)
        if body.mesh.part is not None:
            keep_part(gmsh, body.mesh.part, label)
        _refuse_shell(gmsh, script, label)
        faces = _choose_groups(gmsh, script, body, contacts, label)
        for option, value in _OPTIONS.items():
            gmsh.option.setNumber(option, value)
        gmsh.option.setNumber("General.Terminal", 1)  # for who waits
        if sizes:
            _follow(gmsh, sizes, body.mesh, label)
        else:
            _refuse_tiny(gmsh, body, contacts, label)
            _refine_towards(gmsh, body, contacts)
        gmsh.model.mesh.generate(d)
        gmsh.model.mesh.setOrder(body.mesh.order or 1)
        gmsh.write(DRAWN)
        return faces


def _choose_groups(
    gmsh, script: bool, body: BodySpec, contacts: Collection[str], label: str
) -> Faces:
    """Name the groups, and save the cells of the body. Raises InputError."""
    d = gmsh.model.getDimension()
    name_groups(gmsh)
    faces = name_sides(
        gmsh,
        script,
        [*contacts, *(acting.on for _, acting in body.acting), *body.mesh.size_on],
        label,
    )
    bodies = [tag for _, tag in gmsh.model.getEntities(d)]
    if not gmsh.model.getPhysicalGroups(d):
        if len(bodies) > 1 and script:
            raise InputError(
                f"{label} has {len(bodies)} {PHYSICAL[d].split()[1]}s and no physical one; name those of "
                f'the body: {PHYSICAL[d].title()}("body") = {{1}};'
            )
        gmsh.model.addPhysicalGroup(d, bodies)
    return faces


def _refuse_tiny(gmsh, body: BodySpec, contacts: Collection[str], label: str) -> None:
    """Raise InputError where the sizes of the scene would make far too many elements."""
    d = gmsh.model.getDimension()
    largest = body.mesh.largest
    finest = body.mesh.contact_size or largest
    whole = sum(_measure(gmsh, d, tag) for tag in _of_groups(gmsh, d))
    band = (
        NEAR * finest * sum(_measure(gmsh, d - 1, tag) for tag in _of_groups(gmsh, d - 1, contacts))
    )
    for key, size, covered in (
        ("size", largest, whole),
        ("contact_size", finest, min(whole, band)),
    ):
        cells = covered / (CELLS[d, 1].regular * size**d)
        if cells > TOO_MANY:
            extents = " by ".join(f"{length:.3g}" for length in np.diff(box(gmsh), axis=0)[0, :d])
            raise InputError(
                f"{label}: {key} = {size:g} would make {cells:.1g} {CELLS[d, 1].names} of a drawing of "
                f"{extents}; is it in the units of the drawing?"
            )


def _measure(gmsh, dimension: int, tag: int) -> float:
    """The length of a curve, the area of a plane surface; for a face or a volume an estimate by its box."""
    if gmsh.model.getDimension() == 2:
        return _area(gmsh, tag) if dimension == 2 else curve_bend(gmsh, tag)[1]
    return (
        float(np.sort(np.diff(box(gmsh, dimension, tag), axis=0)[0])[-dimension:].prod()) * FILLED
    )


def _of_groups(gmsh, dimension: int, names: Collection[str] | None = None) -> np.ndarray:
    """The numbers of the curves, surfaces or volumes of physical groups, all or those of some names."""
    called = {
        tag: gmsh.model.getPhysicalName(dimension, tag)
        for _, tag in gmsh.model.getPhysicalGroups(dimension)
    }
    wanted = (
        called.values()
        if names is None
        else [part for on in names for part in parts_of(on, called.values())]
    )
    groups = [tag for tag, name in called.items() if name in wanted]
    return np.unique(
        [
            entity
            for tag in groups
            for entity in gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)
        ]
    )


def _area(gmsh, surface: int) -> float:
    """The area of a plane surface, by its boundary: ½ ∮ (x dy − y dx)."""
    total = 0.0
    for _, curve in gmsh.model.getBoundary([(2, surface)], oriented=True):
        x, y, _ = samples(gmsh, abs(curve)).T
        total += np.sign(curve) * float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2
    return abs(total)


def _refine_towards(gmsh, body: BodySpec, contacts: Collection[str]) -> None:
    """Limit the sizes of the file, and make elements finer along the groups in `contacts`."""
    largest = body.mesh.largest
    finest = body.mesh.contact_size or largest
    for option, most in (("Mesh.MeshSizeMax", largest), ("Mesh.MeshSizeMin", finest)):
        gmsh.option.setNumber(option, min(gmsh.option.getNumber(option), most))
    side = gmsh.model.getDimension() - 1
    background = re.search(r"^Background Field = (\d+);", _unrolled(gmsh), re.M)
    fields = _around(gmsh, body.mesh) + ([int(background[1])] if background else [])
    near = _of_groups(gmsh, side, contacts)
    for name, size in body.mesh.size_on.items():
        along = _of_groups(gmsh, side, [name])
        if not len(along):
            names = [
                gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups(side)
            ]
            raise InputError(
                f"body.{body.name}.mesh.size_on: the drawing has no boundary group {name!r}"
                f"{nearest(name, names)} (it has {', '.join(names)})"
            )
        near = np.setdiff1d(near, along)  # it has this size in contacts as well
        if size < largest:
            fields.append(_near(gmsh, side, along, size, largest))
    if len(near) and finest < largest:
        fields.append(_near(gmsh, side, near, finest, largest))
    if fields:
        gmsh.model.mesh.field.setAsBackgroundMesh(_field(gmsh, "Min", FieldsList=fields))


def _follow(gmsh, sizes: Sizes, spec: MeshSpec, label: str) -> None:
    """Prescribe the sizes of elements, overriding those of the file."""
    gmsh.model.mesh.removeConstraints()  # numbers of nodes on curves; but those of gmsh's own kernel remain
    script = _unrolled(gmsh)
    free = re.sub(r"^(Transfinite|Recombine) .*\n", "", script, flags=re.M)
    if free != script:
        gmsh.clear()
        free_of_them = Path("free.geo").resolve()
        again = Path("again").resolve()
        free_of_them.write_text(free, encoding="utf-8")
        again.mkdir()
        gmsh.open(str(_copy(free_of_them, {}, again, label)))  # its names of groups may be anything
    d = sizes.points.shape[1]
    middle = box(gmsh).mean(axis=0)
    xyz = np.column_stack([sizes.points, np.tile(middle[d:], (len(sizes.points), 1))])
    corners = xyz[sizes.triangles].transpose(0, 2, 1).reshape(len(sizes.triangles), -1)
    view = gmsh.view.add("sizes")
    data = np.column_stack([corners, sizes.sizes[sizes.triangles]]).ravel()
    gmsh.view.addListData(view, {2: "ST", 3: "SS"}[d], len(corners), data)
    for option, value in (
        ("SizeMin", 0.0),
        ("SizeMax", spec.largest),
        ("SizeFactor", 1.0),
        ("SizeFromPoints", 0),
        ("SizeExtendFromBoundary", 0),
        ("SizeFromCurvature", 0),
    ):
        gmsh.option.setNumber(f"Mesh.Mesh{option}", value)
    fields = [_field(gmsh, "PostView", ViewTag=view), *_around(gmsh, spec)]
    gmsh.model.mesh.field.setAsBackgroundMesh(_field(gmsh, "Min", FieldsList=fields))


def _around(gmsh, spec: MeshSpec) -> list[int]:
    """Size fields for elements that are small enough for the radii of curves and faces. With
    Mesh.MeshSizeFromCurvature gmsh 4.15 never ends on small arcs."""
    largest = spec.largest
    around = spec.around or AROUND
    alike: dict[tuple[int, int], list[tuple[float, int]]] = {}
    for dimension, tag in [*gmsh.model.getEntities(1), *gmsh.model.getEntities(2)]:
        bend, length = {1: curve_bend, 2: face_bend}[dimension](gmsh, tag)
        size = max(2 * np.pi / around / max(bend, 1 / OFF), length / MOST)
        if size < largest and length > TINY * extent(gmsh):
            alike.setdefault((dimension, round(np.log(size) / ALIKE)), []).append((size, tag))
    return [
        _near(gmsh, dimension, [tag for _, tag in group], min(group)[0], largest)
        for (dimension, _), group in alike.items()
    ]


def _near(gmsh, dimension: int, tags, finest: float, largest: float) -> int:
    """A field of size `finest` along curves or faces, which grows to `largest`."""
    length = max(extent(gmsh, dimension, tag) for tag in tags)
    far = _field(
        gmsh,
        "Distance",
        Sampling=int(np.clip(4 * length / finest, 20, {1: 20_000, 2: 500}[dimension])),
        **{("CurvesList", "SurfacesList")[dimension - 1]: tags},
    )
    return _field(
        gmsh,
        "Threshold",
        InField=far,
        SizeMin=finest,
        SizeMax=largest,
        DistMin=NEAR * finest,
        DistMax=NEAR * finest + (largest - finest) / GRADE,
    )


def _field(gmsh, kind: str, **values) -> int:
    """A new size field of gmsh."""
    field = gmsh.model.mesh.field.add(kind)
    for key, value in values.items():
        put = (
            gmsh.model.mesh.field.setNumber
            if np.isscalar(value)
            else gmsh.model.mesh.field.setNumbers
        )
        put(field, key, value)
    return int(field)


def _unrolled(gmsh) -> str:
    """The model as a script without loops and variables, which has more than the interface tells."""
    gmsh.write("model.geo_unrolled")
    return Path("model.geo_unrolled").read_text(encoding="utf-8", errors="replace")


@contextlib.contextmanager
def _gmsh_errors(what: str) -> Iterator[None]:
    """Errors of gmsh as InputError that says `what`."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # gmsh raises bare ones
        raise InputError(f"{what} (gmsh: {error})") from None
