"""Geometries (.geo, .step, .brep): meshed by gmsh, finer towards contacts, or as an estimated error asks for.

A .geo is a program. gmsh gets a copy of it, in a folder of its own, in which nothing starts programs or writes files.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh, signed_measures
from ddmpi.mesh.read import MSH, gmsh_session, name_groups, read_mesh
from ddmpi.scene.bodies import BodySpec
from ddmpi.system.interrupt import apart

TRUST = "DDMPI_TRUST_GEOMETRY"
"""The variable that allows drawings to start programs and write files, if it is 1. No file can set it."""

HARMFUL = re.compile(rb"\b(System|SystemCall|NonBlockingSystemCall|OnelabRun|ExternalProcess|Plugin|SendToServer|Save"
                     rb"|CreateDir|(?:Tmp|Session|Options|Error)FileName|S2N|StringToName|Print(?!\s*\.))\b")
"""What starts programs or writes files in a .geo, and what makes such a word out of strings."""

SKIPPED = re.compile(rb"""("[^"]*"|'[^']*')|//[^\n]*|/\*.*?\*/""", re.S)
"""A string of a .geo, or a comment."""

READS = re.compile(rb"""\b(Include|Merge|MergeWithBoundingBox|ShapeFromFile|ListFromFile|FileExists|FileName)\b"""
                   rb"""([\s=(\[]*)(?:"([^"\n]{1,999})"|'([^'\n]{1,999})')?""")
"""What reads another file in a .geo, and its name; gmsh cuts strings at 1023 characters and reads on."""

READ_AS_DATA = (".step", ".stp", ".brep", ".brp", ".iges", ".igs", ".stl")
"""Endings, in small letters, of files that gmsh takes for no script whatever they hold."""

AROUND = 24
"""Elements around a full circle, at least: beyond 40 degrees from one side to the next a contact has a corner. Not by
Mesh.MeshSizeFromCurvature: gmsh 4.15 differentiates its own arcs twice by differences, and never ends on small ones."""

SAMPLES, MOST = 65, 200
"""Points on a curve by which its radius is found; most elements along a curve because of its curvature."""

ALIKE = 0.1
"""Curves are alike if the logarithms of their sizes differ by less."""

GRADE = 0.3
"""By how much the size of elements grows with the distance, at most."""

NEAR = 2.0
"""Elements have the size of contacts up to so many times this size away from them."""

TOO_MANY = 2e7
"""So many triangles of a body come from a size in other units than the drawing; gmsh takes minutes and all memory."""

OFF = 1e22
"""What gmsh takes for no limit."""


@dataclass(frozen=True)
class Sizes:
    """The sizes that the elements of a body shall have, linear on the triangles of an earlier mesh.

    Attributes
    ----------
    points, triangles : (k, 2) in metres and (t, 3)
    sizes : (k,) lengths of sides (m)
    """

    points: np.ndarray
    triangles: np.ndarray
    sizes: np.ndarray


def mesh_geometry(path: Path, body: BodySpec, contacts: Collection[str], sizes: Sizes | None = None) -> Mesh:
    """The mesh of a geometry with its physical groups; in order 2 its sides are curved along the curves.

    Elements have at most the ``size`` of the body's mesh, smaller ones where the file says so, and ``contact_size``
    along the groups in `contacts`; with `sizes` they have these, and the file's are not heeded. The same input gives
    the same mesh. In a STEP or BREP file every curve is a group, called by its label and its number.

    Not collective. Raises InputError for a file that gmsh cannot read or mesh, or that is not plane.
    """
    label = f"body.{body.name}.mesh.geometry: {path}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        copies: dict[Path, Path] = {}
        source = _copy(path.resolve(), copies, folder, label)
        try:
            apart(folder, _draw, source, path.suffix.lower() == ".geo", body, contacts, sizes, label)
        except InputError as error:
            for original, copy in copies.items():
                error.args = (str(error).replace(str(copy), str(original)),)
            raise
        except ChildProcessError as error:
            raise InputError(f"{label} ends gmsh ({error}); leave out Exit, if it is there") from None
        return read_mesh(folder / DRAWN, body.name, body.mesh.order or 1, label)


DRAWN = "drawn.msh"

_OPTIONS = {"General.NumThreads": 1, "Mesh.MaxNumThreads1D": 1, "Mesh.MaxNumThreads2D": 1, "Mesh.RandomSeed": 1,
            "Mesh.ElementOrder": 1, "Mesh.SecondOrderLinear": 0, "Mesh.MshFileVersion": 4.1, "Mesh.Binary": 1,
            "Mesh.SaveAll": 0, "Mesh.SaveParametric": 0, "Mesh.MeshOnlyVisible": 0, "Mesh.MeshOnlyEmpty": 0,
            "Mesh.RecombineAll": 0, "Mesh.SubdivisionAlgorithm": 0, "Mesh.ScalingFactor": 1}
"""What the options of a file do not change."""


def _copy(path: Path, copies: dict[Path, Path], folder: Path, label: str) -> Path:
    """A copy in `folder` that gmsh may open, of a drawing and of all that it includes; `copies` has those made so far.

    Its name tells gmsh what it is, and no file of options lies beside it, which gmsh would run. Raises InputError for a
    script that could do more than draw.
    """
    if path in copies:
        return copies[path]
    suffix, content = path.suffix.lower(), _content(path, label)
    if suffix not in READ_AS_DATA:
        suffix = ".msh" if content.startswith(MSH) else ".geo"
    copy = copies[path] = folder / f"{len(copies)}{suffix}"
    copy.write_bytes(_tamed(content, path, copies, folder, label) if suffix == ".geo" else content)
    return copy


def _content(path: Path, label: str) -> bytes:
    if path.exists() and not path.is_file() and not path.is_dir():  # a pipe has no end
        raise InputError(f"{label}: {path} is no file")
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{label}: {path} cannot be read: {error.strerror}") from None


def _tamed(script: bytes, path: Path, copies: dict[Path, Path], folder: Path, label: str) -> bytes:
    """The `script` without comments, and with copies of the files that it names. Raises InputError for a harmful one.

    Comments go because gmsh skips loops and conditions by other rules than those by which it reads them.
    """
    if os.environ.get(TRUST) == "1":
        return b'Include "%b";\n' % os.fsencode(path)
    script = SKIPPED.sub(lambda each: each[1] or b" " + b"\n" * each[0].count(b"\n"), script)

    def refuse(word: re.Match[bytes], what: str) -> None:
        line = 1 + script.count(b"\n", 0, word.start())
        raise InputError(f"{label} {what} ({word[1].decode()} in line {line} of {path.name}); for a drawing that you "
                         f"trust as you would a program, set {TRUST}=1 in the environment")

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

    if found := HARMFUL.search(script):
        refuse(found, "could start programs or write files")
    printing = re.sub(rb"\bPrintf\b", b"Warning", script)  # Printf may write into a file
    return READS.sub(use_copy, printing) + b"\n"  # without it gmsh 4.15 would lose statements


def _draw(source: Path, script: bool, body: BodySpec, contacts: Collection[str], sizes: Sizes | None,
          label: str) -> None:
    """Write the mesh of the drawing `source` as DRAWN into the current folder; for a process that does nothing else.

    Raises InputError.
    """
    with gmsh_session() as gmsh:
        with _gmsh_errors(f"{label} cannot be read"):
            gmsh.open(str(source))
        if gmsh.model.getEntities(3):
            raise InputError(f"{label} holds a solid; the geometry of a plane body is a surface in the plane z = 0")
        if not gmsh.model.getEntities(2):
            raise InputError(f"{label} has no surface: Plane Surface(1) = {{1}};")
        _choose_groups(gmsh, script, body, contacts, label)
        for option, value in _OPTIONS.items():
            gmsh.option.setNumber(option, value)
        if sizes:
            _follow(gmsh, sizes, body.mesh.largest, label)
        else:
            _refuse_tiny(gmsh, body, contacts, label)
            _refine_towards(gmsh, body, contacts)
        with _gmsh_errors(f"{label} cannot be meshed"):
            gmsh.model.mesh.generate(2)
            gmsh.model.mesh.setOrder(body.mesh.order or 1)
            gmsh.write(DRAWN)


def _choose_groups(gmsh, script: bool, body: BodySpec, contacts: Collection[str], label: str) -> None:
    """See to it that the groups have names, and that the surface is saved. Raises InputError."""
    if not script:  # other files have no physical groups
        _name_curves(gmsh, body, contacts, label)
    name_groups(gmsh)
    names = [{gmsh.model.getPhysicalName(d, tag) for _, tag in gmsh.model.getPhysicalGroups(d)} - {""} for d in (1, 2)]
    if not names[0]:
        raise InputError(f"{label} has no physical curves; clamps, tractions and contacts refer to these: "
                         'Physical Curve("left") = {4};')
    for name in sorted(names[0] & names[1]):
        raise InputError(f"{label}: {name!r} is the name of both a physical curve and a physical surface; rename one")
    surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
    if not gmsh.model.getPhysicalGroups(2):
        if len(surfaces) > 1 and script:
            raise InputError(f"{label} has {len(surfaces)} surfaces and no physical one; name those of the body: "
                             'Physical Surface("body") = {1};')
        gmsh.model.addPhysicalGroup(2, surfaces)


def _name_curves(gmsh, body: BodySpec, contacts: Collection[str], label: str) -> None:
    """Make every curve a group by its number, and by the last part of its label. Raises InputError."""
    curves: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getEntities(1):
        for name in {str(tag), gmsh.model.getEntityName(1, tag).split("/")[-1]} - {""}:
            curves.setdefault(name, []).append(tag)
    asked = [*contacts, *(clamp.on for clamp in body.clamps), *(load.on for load in body.traction)]
    missing = next((name for name in asked if name not in curves), None)
    if missing is not None:
        each = []
        for name, tags in curves.items():
            low, high = gmsh.model.getParametrizationBounds(1, tags[0])
            ends = gmsh.model.getValue(1, tags[0], [low[0], (low[0] + high[0]) / 2, high[0]])
            start, middle, end = (f"({x:.6g}, {y:.6g})" for x, y in np.reshape(ends, (3, 3))[:, :2] + 0.0)
            each.append(f"{name} from {start} by {middle} to {end}")
        raise InputError(f"{label} has no curve {missing!r}; it has {'; '.join(each)}")
    for name, tags in curves.items():
        gmsh.model.addPhysicalGroup(1, tags, name=name)


def _refuse_tiny(gmsh, body: BodySpec, contacts: Collection[str], label: str) -> None:
    """Raise InputError where the sizes of the scene would make far too many elements."""
    largest, finest = body.mesh.largest, body.mesh.contact_size or body.mesh.largest
    area = sum(_area(gmsh, surface) for surface in _of_groups(gmsh, 2))
    band = NEAR * finest * sum(np.linalg.norm(np.diff(_samples(gmsh, curve), axis=0), axis=1).sum()
                               for curve in _of_groups(gmsh, 1, contacts))
    for key, size, covered in (("size", largest, area), ("contact_size", finest, min(area, band))):
        triangles = covered / (np.sqrt(3) / 4 * size**2)
        if triangles > TOO_MANY:
            low, high = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
            width, height = (high - low)[:2]
            raise InputError(f"{label}: {key} = {size:g} would make {triangles:.1g} triangles of a drawing of "
                             f"{width:.3g} by {height:.3g}; is it in the units of the drawing?")


def _of_groups(gmsh, dimension: int, names: Collection[str] | None = None) -> np.ndarray:
    """The numbers of the curves (1) or surfaces (2) of physical groups, all or those of some names."""
    groups = [tag for _, tag in gmsh.model.getPhysicalGroups(dimension)
              if names is None or gmsh.model.getPhysicalName(dimension, tag) in names]
    return np.unique([each for tag in groups for each in gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)])


def _samples(gmsh, curve: int) -> np.ndarray:
    """Points (SAMPLES, 3) on a curve."""
    (low,), (high,) = gmsh.model.getParametrizationBounds(1, curve)
    return np.reshape(gmsh.model.getValue(1, curve, np.linspace(low, high, SAMPLES)), (-1, 3))


def _area(gmsh, surface: int) -> float:
    """The area of a plane surface, by its boundary: ½ ∮ (x dy − y dx)."""
    total = 0.0
    for _, curve in gmsh.model.getBoundary([(2, surface)], oriented=True):
        x, y, _ = _samples(gmsh, abs(curve)).T
        total += np.sign(curve) * float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2
    return abs(total)


def _refine_towards(gmsh, body: BodySpec, contacts: Collection[str]) -> None:
    """Limit the sizes of the file, and make elements finer along the curves of the groups in `contacts`."""
    largest, finest = body.mesh.largest, body.mesh.contact_size or body.mesh.largest
    number = gmsh.option.getNumber
    gmsh.option.setNumber("Mesh.MeshSizeMax", min(number("Mesh.MeshSizeMax"), largest))
    gmsh.option.setNumber("Mesh.MeshSizeMin", min(number("Mesh.MeshSizeMin"), finest))
    curves = _of_groups(gmsh, 1, contacts)
    own = _background(gmsh)
    fields = _around(gmsh, largest) + [own] * bool(own)
    if len(curves) and finest < largest:
        fields.append(_near(gmsh, curves, finest, largest))
    if fields:
        gmsh.model.mesh.field.setAsBackgroundMesh(_field(gmsh, "Min", FieldsList=fields))


def _follow(gmsh, sizes: Sizes, largest: float, label: str) -> None:
    """Have elements of the given sizes, whatever the file says of its own."""
    gmsh.model.mesh.removeConstraints()  # numbers of nodes on curves; but those of gmsh's own kernel remain
    script = _unrolled(gmsh)
    free = re.sub(r"^(Transfinite|Recombine) .*\n", "", script, flags=re.M)
    if free != script:
        gmsh.clear()
        free_of_them, again = Path("free.geo").resolve(), Path("again").resolve()
        free_of_them.write_text(free, encoding="utf-8")
        again.mkdir()
        gmsh.open(str(_copy(free_of_them, {}, again, label)))  # its names of groups may be anything
    plane = gmsh.model.getBoundingBox(-1, -1)[2::3]
    xyz = np.column_stack([sizes.points, np.full(len(sizes.points), sum(plane) / 2)])
    corners = xyz[sizes.triangles].transpose(0, 2, 1).reshape(-1, 9)
    view = gmsh.view.add("sizes")
    gmsh.view.addListData(view, "ST", len(corners), np.column_stack([corners, sizes.sizes[sizes.triangles]]).ravel())
    for option, value in (("SizeMin", 0.0), ("SizeMax", largest), ("SizeFactor", 1.0), ("SizeFromPoints", 0),
                          ("SizeExtendFromBoundary", 0), ("SizeFromCurvature", 0)):
        gmsh.option.setNumber(f"Mesh.Mesh{option}", value)
    fields = [_field(gmsh, "PostView", ViewTag=view), *_around(gmsh, largest)]
    gmsh.model.mesh.field.setAsBackgroundMesh(_field(gmsh, "Min", FieldsList=fields))


def _around(gmsh, largest: float) -> list[int]:
    """Fields that make elements along curved curves small enough for their radii."""
    alike: dict[int, list[tuple[float, int]]] = {}
    for _, tag in gmsh.model.getEntities(1):
        steps = np.diff(_samples(gmsh, tag), axis=0)
        length = np.linalg.norm(steps, axis=1)
        bend = np.linalg.norm(np.diff(steps / length[:, None], axis=0), axis=1).max() / length.mean()  # 1 / radius
        size = max(2 * np.pi / AROUND / max(bend, 1 / OFF), length.sum() / MOST)
        if size < largest:
            alike.setdefault(round(np.log(size) / ALIKE), []).append((size, tag))
    return [_near(gmsh, [tag for _, tag in curves], min(curves)[0], largest) for curves in alike.values()]


def _near(gmsh, curves, finest: float, largest: float) -> int:
    """A field of size `finest` along curves, which grows to `largest`."""
    boxes = [np.reshape(gmsh.model.getBoundingBox(1, curve), (2, 3)) for curve in curves]
    extent = max(np.linalg.norm(high - low) for low, high in boxes)
    far = _field(gmsh, "Distance", CurvesList=curves, Sampling=int(np.clip(4 * extent / finest, 20, 20_000)))
    return _field(gmsh, "Threshold", InField=far, SizeMin=finest, SizeMax=largest, DistMin=NEAR * finest,
                  DistMax=NEAR * finest + (largest - finest) / GRADE)


def _field(gmsh, kind: str, **values) -> int:
    """A new size field of gmsh."""
    field = gmsh.model.mesh.field.add(kind)
    for key, value in values.items():
        put = gmsh.model.mesh.field.setNumber if np.isscalar(value) else gmsh.model.mesh.field.setNumbers
        put(field, key, value)
    return int(field)


def _background(gmsh) -> int:
    """The number of the file's own background field; 0 if it has none."""
    found = re.search(r"^Background Field = (\d+);", _unrolled(gmsh), re.M)
    return int(found[1]) if found else 0


def _unrolled(gmsh) -> str:
    """The model as a script without loops and variables, which has more than the interface tells."""
    gmsh.write("model.geo_unrolled")
    return Path("model.geo_unrolled").read_text(encoding="utf-8", errors="replace")


@contextlib.contextmanager
def _gmsh_errors(what: str) -> Iterator[None]:
    """Errors of gmsh as InputError that says `what`."""
    try:
        yield
    except Exception as error:  # gmsh raises bare ones
        raise InputError(f"{what} (gmsh: {error})") from None


def graded(mesh: Mesh, sizes: np.ndarray) -> Sizes:
    """`sizes` (nt,) of the triangles as sizes at the corners, which grow by no more than GRADE with the distance.

    Not collective.
    """
    corners, area = mesh.triangles[:, :3], signed_measures(mesh.points, mesh.triangles)
    used, corners = np.unique(corners, return_inverse=True)
    corners, points, k = corners.reshape(-1, 3), mesh.points[used], len(used)
    weight = np.bincount(corners.ravel(), np.repeat(area, 3))
    nodal = np.exp(np.bincount(corners.ravel(), np.repeat(area * np.log(sizes), 3)) / weight)
    links = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    far = GRADE * np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    ends = np.concatenate([links.T, [np.full(k, k), np.arange(k)]], axis=1)  # the shortest way from an outer node
    _, first = np.unique(np.sort(ends, axis=0), axis=1, return_index=True)
    graph = sparse.csr_matrix((np.concatenate([far, nodal])[first], ends[:, first]), shape=(k + 1, k + 1))
    return Sizes(points, corners, csgraph.dijkstra(graph, directed=False, indices=k)[:k])
