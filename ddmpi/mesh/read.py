"""Mesh files: read through meshio; versions of MSH that it cannot read are converted by gmsh first."""

import copy
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from ddmpi.decks.cards import KEPT
from ddmpi.decks.deck import Deck
from ddmpi.errors import DdmpiError, InputError, InterruptionError, nearest
from ddmpi.mesh.boundary import file_groups, file_members, set_nodes
from ddmpi.mesh.elements import BRICKS, CELLS, Cell
from ddmpi.mesh.mesh import MEASURE, PHYSICAL, Mesh, refuse_overlaps, signed_measures
from ddmpi.mesh.nodes import of_elements, refuse_lost_nodes, refuse_lost_numbers, refuse_repeated
from ddmpi.mesh.refine import (
    KINDS,
    SIMPLICES,
    are_bricks,
    bend,
    bricks,
    distinct,
    kinds_among,
    raise_order,
    simplices,
)
from ddmpi.scene.given import GIVEN, Given
from ddmpi.scene.values import LARGEST
from ddmpi.system import interrupt
from ddmpi.system.hdf5 import read_apart
from ddmpi.system.numbers import ALIKE, in_words

MSH = (b"$MeshFormat", b"$Comments", b"$NOD", b"$NOE")
"""First words of mesh files that gmsh may open: it runs unknown files as scripts."""

COMPLETE = {
    "wedge18": [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11],
    "pyramid14": [0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12],
}
"""The order of VTK in elements with middles of faces, which meshio leaves in gmsh's."""

FORMATS = {".med": "med", ".vtu": "vtu", ".vtk": "vtk"}
"""Meshio's names of the formats of other programs, by ending. `Deck` reads .inp; others are gmsh's."""

NUMBERED = ("cell_tags", "gmsh:physical", "CellEntityIds")
"""Names of the data that number the groups of elements in these formats."""

FLAT = 1e-14
"""A triangle has no area if it is smaller than this fraction of the largest one; for volumes its power 3/2."""


def read_mesh(
    path: Path,
    body: str,
    order: int = 1,
    label: str = "",
    part: str | None = None,
    cut: bool = False,
) -> Mesh:
    """Read the cells, the groups of the boundary and points from a mesh file, as a mesh of the `order`.

    In order 2 the edges of second-order elements are curved as they are in the file; in order 1 only corners are kept.
    Edges of first-order elements are straight. A body of quadrilaterals alone keeps them, see `are_bricks`, unless
    they are to be `cut`; others are cut into triangles, and hexahedra, prisms and pyramids into tetrahedra. Groups
    are physical groups of gmsh, sets of elements, and sets of nodes: the facets on the boundary whose corners are in
    the set, or else in space its edges, and the nodes that these do not have. In formats without names of groups (MSH
    1.0, VTK) a group is called by its number. With a `part` only the elements of this group, and the groups on their
    boundary. Errors begin with `label`. Not collective. Raises InputError for a file that cannot be read, that has
    other elements or no named boundary groups, or is degenerate, and for a part that is not there.
    """
    label = label or f"body.{body}.mesh.file: {path}"
    raw = _load(path, label, part)
    d, _ = _kind(raw)
    _refuse_other(raw, part, label)
    some = None if part is None else _members(raw, d, part, label)
    _refuse_nodes(raw, list(of_elements(raw, d, some)), d, label)
    kind, cells, bends, element = _elements(raw, d, order, some, cut)
    if len(cells) == 0:
        raise InputError(
            f"{label} has neither triangles nor tetrahedra; gmsh saves only elements in physical groups: "
            'Physical Surface("body") = {1}; or Physical Volume("body") = {1};'
        )
    first, place = distinct(cells)
    cells = cells[first]
    bends = bends[first]
    groups, curves, vertices = file_groups(raw, label, cells, kind.straight, part is not None)
    surfaces = {
        name: np.unique(place[np.isin(element, members)])
        for name, members in file_members(raw, d).items()
    }
    used, renumbered = np.unique(cells, return_inverse=True)
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(len(used))
    points = np.asarray(raw.points[used, :d], float)
    cells = renumbered.reshape(cells.shape)
    groups = {name: number[facets] for name, facets in groups.items()}
    curves = {name: number[lines] for name, lines in curves.items()}
    curves = {name: lines[(lines >= 0).all(axis=1)] for name, lines in curves.items()}
    if any((facets < 0).any() for facets in groups.values()):
        raise InputError(f"{label} has boundary {kind.facet.names} that belong to no {kind.name}")
    turned = _inverted(points, cells, label)
    swap = kind.shape.mirrored
    cells[turned] = cells[turned][:, swap]
    mesh = Mesh(
        points,
        cells,
        groups,
        surfaces=surfaces,
        cut=_cut(raw, d, element[first]) * kind.simplex,
        curves=curves,
    )
    refuse_overlaps(mesh, label)
    ends = [sorted(swap[k] for k in corners) for corners in kind.between]
    bends[turned] = bends[turned][:, [ends.index(sorted(corners)) for corners in kind.between]]
    mesh = bend(raise_order(mesh, f"body.{body}.mesh", order), bends)
    return replace(mesh, vertices=set_nodes(raw, mesh, number, vertices))


def _elements(
    raw, d: int, order: int, some: np.ndarray | None, cut: bool
) -> tuple[Cell, np.ndarray, np.ndarray, np.ndarray]:
    """The reference cell, and what `bricks` or `simplices` give of all elements of dimension d, or of `some`."""
    whole = BRICKS[d, 1].shape.kind in KEPT and not cut and are_bricks(raw, d, some)
    kind, elements = (BRICKS[d, order], bricks) if whole else (CELLS[d, order], simplices)
    cells, bends, element = elements(raw, d, raw.points[:, :d], not kind.linear)
    own = slice(None) if some is None else np.isin(element, some)
    return kind, cells[own], bends[own], element[own]


def _refuse_other(raw, part: str | None, label: str) -> None:
    """Raise InputError where a file, of which no `part` is taken, has elements of other types."""
    known = {kind for kinds in KINDS.values() for kind in kinds}
    other = sorted({block.type for block in raw.cells} - known)
    if other and part is None:
        raise InputError(
            f"{label} has elements of type {', '.join(other)}; only triangles, quadrilaterals, "
            "tetrahedra, hexahedra, prisms, pyramids and lines of first or second order are supported"
        )


def _cut(raw, d: int, element: np.ndarray) -> int:
    """How many of the elements (k,), counted through all KINDS, are cut into simplices, which are counted first."""
    simple = [kind for kind in KINDS[d] if kind.startswith(SIMPLICES[d])]
    count = sum(len(raw.cells_dict.get(kind, ())) for kind in simple)
    return len(np.unique(element[element >= count]))


def _inverted(points: np.ndarray, cells: np.ndarray, label: str) -> np.ndarray:
    """(nt,) bool, which cells are inverted. Raises InputError for those without area or volume."""
    d = points.shape[1]
    measure = signed_measures(points, cells)
    flat = np.abs(measure) <= FLAT ** (d / 2) * np.abs(measure).max()
    if flat.any():
        raise InputError(
            f"{label} has {CELLS[d, 1].names} without {MEASURE[d]}, {int(flat.sum())} of them, as at "
            f"{in_words(points[cells[flat.argmax()]].mean(axis=0), 4)}"
        )
    return measure < 0


def _refuse_nodes(raw, nodes: list[np.ndarray], d: int, label: str) -> None:
    """Raise InputError where the elements of the body, by the `nodes` (k, ·) of those of each kind, have a node twice,
    or nodes that are nowhere, or in the plane not in one plane. Nodes of other elements, and of none, do not count."""
    refuse_repeated(raw, nodes, label)
    used = np.unique(np.concatenate([np.empty(0, int), *(of_kind.ravel() for of_kind in nodes)]))
    nowhere = used[~(np.abs(raw.points[used]) <= LARGEST).all(axis=1)]
    if len(nowhere):
        raise InputError(
            f"{label} has coordinates that are not numbers, or above {LARGEST:g}, at "
            f"{len(nowhere)} of its nodes, such as {in_words(raw.points[nowhere[0]])}"
        )
    at = raw.points[used]
    if len(at) and (np.ptp(at[:, d:], axis=0) > ALIKE * np.ptp(at, axis=0).max()).any():
        raise InputError(
            f"{label} is not plane (its z coordinates differ), and has no tetrahedra; a solid needs its "
            'cells: Physical Volume("body") = {1};'
        )


def file_kind(path: Path, body: str, part: str | None = None) -> tuple[int, int]:
    """Dimension and order of the elements in a mesh file, or in a `part` of it. Not collective. Raises InputError."""
    label = f"body.{body}.mesh.file: {path}"
    raw = _load(path, label, part)
    d, order = _kind(raw)
    if part is not None:
        own = kinds_among(raw, d, _members(raw, d, part, label))
        order = max(KINDS[d][kind] for kind in own)
    return d, order


def _kind(raw) -> tuple[int, int]:
    """Dimension, 3 if there are solid elements, and the highest order of those of this dimension."""
    types = {cells.type for cells in raw.cells}
    d = 3 if types & KINDS[3].keys() else 2
    return d, max((KINDS[d][kind] for kind in types & KINDS[d].keys()), default=1)


def _members(raw, d: int, part: str, label: str) -> np.ndarray:
    """The elements (k,) of a part, counted through all KINDS. Raises InputError where it is not there."""
    named = {name: members for name, members in file_members(raw, d).items() if len(members)}
    if part not in named:
        raise InputError(
            f"{label} has no part {part!r}{nearest(part, list(named))} (parts with {CELLS[d, 1].names} or "
            f"what is cut into them: {', '.join(sorted(named)) or 'none with a name'})"
        )
    return named[part]


def _load(path: Path, label: str, part: str | None = None):
    """The file as a mesh of meshio. Raises InputError where neither meshio nor gmsh can read it."""
    import meshio

    meshio._mesh.topological_dimension.update(dict.fromkeys(KINDS[3], 3))  # it does not know all
    if given := GIVEN.get(str(path)):
        return _given(given, label)
    kind = path.suffix.lower()
    if kind == ".inp" or kind in FORMATS:
        try:
            if kind == ".inp":
                return Deck(path).mesh(part)
            if kind == ".med":  # in HDF5, which may crash on a damaged file
                return read_apart(path, _read_other, "", kind)
            return _read_other(path, kind)
        except InterruptionError:
            raise
        except Exception as error:  # meshio raises many kinds, some of them without a message
            what = (
                ""
                if isinstance(error, DdmpiError | ValueError | OSError)
                else f"{type(error).__name__} "
            )
            raise InputError(f"{label} is not a mesh that can be read: {what}{error}") from None
    with open(path, "rb") as file:
        begin = file.read(len(MSH[0]))
    if not begin.startswith(MSH):
        raise InputError(
            f"{label} is not a mesh that meshio or gmsh can read: it does not begin with $MeshFormat, as "
            f"{'.msh' if kind == '.msh' else 'files of other endings'} should; mesh files are .msh (gmsh), "
            ".med (Salome), .vtu and .vtk (VTK), and .inp (Abaqus, CalculiX); a drawing is given by "
            "geometry = …"
        )
    _refuse_double_names(path, label)
    refuse_lost_numbers(path, label)
    try:
        return _read_msh(path)
    except Exception as error:
        refusal = f"meshio: {type(error).__name__} {error}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        shutil.copyfile(path, folder / "old.msh")  # where no file of options lies beside it
        try:
            interrupt.apart(folder, _convert)
            return _read_msh(folder / "converted.msh")
        except InterruptionError:
            raise
        except Exception as error:  # meshio refuses a file without elements
            raise InputError(
                f"{label} is not a mesh that meshio or gmsh can read ({refusal}; gmsh: {error})"
            ) from None


def _given(given: Given, label: str):
    """The mesh of a program, with three coordinates. Raises InputError."""
    raw = copy.copy(given.mesh)
    try:
        refuse_lost_nodes(raw, 0)
    except ValueError as error:
        raise InputError(f"{label}: {error}") from None
    raw.points = np.pad(raw.points, ((0, 0), (0, 3 - raw.points.shape[1])))
    return raw


def _read_other(path: Path, kind: str):
    """A file of another program as a mesh of meshio. Raises InputError, and what meshio raises in this process."""
    import meshio

    if kind != ".med":
        return _by_meshio(path, FORMATS[kind])
    meshio._mesh.topological_dimension.update(dict.fromkeys(KINDS[3], 3))
    try:
        return _by_meshio(path, FORMATS[kind])
    except Exception as error:  # in a process of its own, which has no other way to say it
        what = "" if isinstance(error, ValueError | OSError) else f"{type(error).__name__} "
        raise InputError(f"{what}{error}") from None


def _refuse_double_names(path: Path, label: str) -> None:
    """Raise InputError where groups of two dimensions have one name: meshio would forget one of them."""
    with open(path, encoding="utf-8", errors="replace") as file:
        head = "".join(
            takewhile(
                lambda line: not line.startswith(("$EndPhysicalNames", "$Nodes", "$NOD")), file
            )
        )
    dimensions: dict[str, str] = {}
    for dimension, name in re.findall(r'^([0-3])\s+\d+\s+"(.*)"', head, re.MULTILINE):
        kinds = dimensions.setdefault(name, dimension), dimension
        if len(set(kinds)) > 1:
            one, other = (PHYSICAL[int(kind)] for kind in kinds)
            raise InputError(
                f"{label}: {name!r} is the name of both a {one} and a {other}; rename one"
            )


def _read_msh(path: Path):
    """A file of gmsh as a mesh of meshio, nodes of all elements in the order of VTK."""
    import meshio

    raw = meshio.gmsh.read(path)
    refuse_lost_nodes(raw, 1)
    for block in raw.cells:
        if block.type in COMPLETE:
            block.data = block.data[:, COMPLETE[block.type]]
    return raw


def _by_meshio(path: Path, kind: str):
    """A file of another program as a mesh of meshio. Raises ValueError, and what meshio raises."""
    import meshio

    if kind == "vtu" and (pieces := len(re.findall(rb"<Piece\b", path.read_bytes()))) > 1:
        raise ValueError(f"it has {pieces} pieces, of which meshio reads one; save it as one piece")
    try:
        raw = getattr(meshio, kind).read(path)
    except meshio.ReadError as error:
        if "exactly 1 mesh" in str(error):
            raise ValueError(
                "it has several meshes; save that of the body in a file of its own"
            ) from None
        raise
    except KeyError as error:
        if kind != "med":
            raise
        raise ValueError(
            f"it lacks nodes (NOE), cells (MAI) or families (FAS), which are its groups: {error.args[0]}; "
            "clamps, tractions and contacts refer to boundaries by groups"
        ) from None
    refuse_lost_nodes(raw, int(kind == "med"))
    return _with_sets(raw)


def _with_sets(raw):
    """A mesh of another program, with sets by name of what it numbers, and three coordinates."""
    numbers: list = next((raw.cell_data[kind] for kind in NUMBERED if kind in raw.cell_data), [])
    raw.cell_sets |= _sets(numbers, getattr(raw, "cell_tags", None))
    nodes = [raw.point_data["point_tags"]] if "point_tags" in raw.point_data else []
    raw.point_sets |= {
        name: blocks[0] for name, blocks in _sets(nodes, getattr(raw, "point_tags", None)).items()
    }
    raw.points = np.pad(raw.points, ((0, 0), (0, 3 - raw.points.shape[1])))
    raw.field_data = {}
    return raw


def _sets(blocks: list, names: dict[int, list[str]] | None) -> dict[str, list[np.ndarray]]:
    """The entries of each of the `blocks` of numbers that a group has, by the names of the numbers, or by these."""
    sets: dict[str, list[np.ndarray]] = {}
    for number in np.unique(np.concatenate(blocks)) if blocks else ():
        for name in names.get(number, ()) if names else [str(int(number))] * bool(number):
            members = [np.flatnonzero(np.asarray(block) == number) for block in blocks]
            before = sets.get(name.strip(" \0"), members)
            sets[name.strip(" \0")] = [
                np.union1d(*pair) for pair in zip(members, before, strict=True)
            ]
    return sets


def _convert() -> None:
    """Write "old.msh", of any version, in MSH 4.1, binary and thus exact; for a process that does nothing else."""
    with gmsh_session() as gmsh:
        try:
            gmsh.open("old.msh")
        except Exception as error:  # gmsh raises bare ones
            raise InputError(str(error)) from None
        name_groups(gmsh)
        for option, value in (("MshFileVersion", 4.1), ("Binary", 1), ("SaveAll", 1)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write("converted.msh")


def name_groups(gmsh) -> None:
    """Call the physical groups of a boundary that have no name by their numbers."""
    for dimension, tag in gmsh.model.getPhysicalGroups(2 if gmsh.model.getEntities(3) else 1):
        if not gmsh.model.getPhysicalName(dimension, tag):
            gmsh.model.setPhysicalName(dimension, tag, str(tag))


@contextmanager
def gmsh_session() -> Iterator:
    """The module gmsh, initialized and silent, for a ``with`` statement; then it is finalized. Not collective.

    The PETSc within gmsh takes the signals for itself; our handlers are put back.
    """
    import gmsh

    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    interrupt.listen_again()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh
    finally:
        gmsh.finalize()
        interrupt.listen_again()
