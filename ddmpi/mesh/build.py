"""The mesh of a body by its scene: generated, read or drawn, refined, and raised to the order."""

import functools
import hashlib
import os
import re
import stat
from collections.abc import Collection
from dataclasses import replace
from math import factorial
from pathlib import Path

import numpy as np

from ddmpi.errors import InputError, naming
from ddmpi.mesh.boundary import combined, material_numbers
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import MEASURE, Mesh, refuse_folded, signed_measures
from ddmpi.mesh.refine import Sizes, halve, raise_order
from ddmpi.mesh.shapes import SHAPES
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.dimension import FileKind
from ddmpi.scene.given import GIVEN
from ddmpi.scene.meshes import MeshSpec
from ddmpi.scene.values import WHERE
from ddmpi.system.memory import free_memory
from ddmpi.system.numbers import ROUNDING, in_words

EACH = 200.0
"""Least memory of a linear cell (bytes): nodes, groups, and its part of the stiffness."""

LITTLE = 2.0**20
"""Memory that there is anyway (bytes)."""

NAMES_OTHERS = {
    ".geo": rb"include|merge|open(?!cascade)|import|shapefromfile",
    ".inp": rb"\*include|input *=",
    ".xdmf": rb"",
    ".xmf": rb"",
}
"""By the end of a file's name, what its text has where it names other files; XDMF keeps its data beside it."""


def build_mesh(
    body: BodySpec,
    folder: Path = Path("."),
    contacts: Collection[str] = (),
    sizes: Sizes | None = None,
    dimension: int | None = None,
    axisymmetric: bool = False,
) -> Mesh:
    """Generate or read the mesh of `body`, and resolve the groups on which something acts.

    >>> from ddmpi.scene.reader import read_scene_file
    >>> mesh = build_mesh(read_scene_file("configs/pinched_blocks.toml").body[0])
    >>> mesh.cell.title, len(mesh.points), sorted(mesh.groups)
    ('linear triangles', 1541, ['bottom', 'left', 'right', 'top'])

    Parameters
    ----------
    folder : of the scene; relative mesh files are looked for there first, then in the current directory
    contacts : names of the groups at contacts, towards which the elements of a geometry become finer
    sizes : of the elements of a geometry, where an accuracy target has led to them
    dimension, axisymmetric : of the scene; the mesh must have this dimension and, around an axis, no x < 0

    Not collective. Raises InputError.
    """
    spec = body.mesh
    key = f"body.{body.name}.mesh"
    mesh = replace(_made(body, folder, contacts, sizes), integration=spec.integration or "")
    _refuse_integration(spec, mesh, f"{key}.integration", axisymmetric)
    if dimension not in (None, mesh.dimension):
        raise InputError(
            f"{key}: the mesh is {WHERE[mesh.dimension]}, and the scene is {WHERE[dimension or 2]}"
        )
    for _ in range(spec.halvings):
        _refuse_huge(2.0**mesh.dimension * len(mesh.triangles), mesh.cell.names, f"{key}.refine")
        mesh = halve(mesh, key)
    mesh = raise_order(mesh, key, spec.order or 1)
    refuse_folded(mesh, key)
    material_numbers(mesh, body)
    acting = [(name, each.on) for name, each in body.acting]
    for name, on in [*(("mesh", on) for on in contacts), *acting]:
        with naming(f"body.{body.name}.{name}"):
            mesh = combined(mesh, on, name == "clamp")
    if axisymmetric:
        mesh = _turned(mesh, key, [*contacts, *(on for name, on in acting if name != "clamp")])
    for name, on in acting:
        with naming(f"body.{body.name}.{name}"):
            # a clamp holds nodes, of points and curves as well; all else acts on facets
            mesh.nodes_of(on) if name == "clamp" else mesh.facets(on)
    return mesh


def _refuse_integration(spec: MeshSpec, mesh: Mesh, key: str, axisymmetric: bool) -> None:
    """Raise InputError where a mesh has another integration than its cells, their order or an axis allow."""
    order = {"modes": 1, "reduced": 2}.get(spec.integration or "")
    words = ""
    if spec.integration and mesh.cell.simplex:
        words = f"belongs to bodies of quadrilaterals or hexahedra alone, all of them convex; this one has {mesh.cell.names}"
    elif order not in (None, spec.order):
        words = f'= "{spec.integration}" belongs to order = {order}; leave it out, or write "full"'
    elif spec.integration == "modes" and axisymmetric:
        words = '= "modes" is not for axisymmetric bodies, in which constant stresses would do work in them; leave it out'
    if words:
        raise InputError(f"{key} {words}")


def _made(body: BodySpec, folder: Path, contacts: Collection[str], sizes: Sizes | None) -> Mesh:
    """The mesh as it is generated, read or drawn. Raises InputError."""
    spec = body.mesh
    key = f"body.{body.name}.mesh"
    if spec.drawn:
        from ddmpi.mesh.geometry import mesh_geometry

        path = locate_mesh(body, folder) if spec.geometry else None
        return mesh_geometry(path, body, contacts, sizes)
    if not spec.shape:
        from ddmpi.mesh.read import read_mesh

        part = None if spec.part is None else str(spec.part)
        path = locate_mesh(body, folder)
        return read_mesh(path, body.name, spec.order or 1, part=part, cut=spec.cut)
    assert spec.divisions
    d = len(spec.divisions)
    cells = float(factorial(d) * np.prod(spec.divisions, dtype=float))
    _refuse_huge(cells, CELLS[d, 1].names, f"{key}.divisions")
    mesh = SHAPES[spec.shape](spec)
    if not signed_measures(mesh.points, mesh.triangles).min() > 0.0:
        raise InputError(
            f"{key}: its {mesh.cell.names} have no {MEASURE[mesh.dimension]} in double precision; "
            "sizes, place and units do not fit together"
        )
    return mesh


def content(body: BodySpec, folder: Path = Path(".")) -> bytes | None:
    """A digest of the file of a body's mesh, empty for a shape; None where the file names others, see NAMES_OTHERS. Not
    collective. Raises InputError."""
    if body.mesh.shape:
        return b""
    path = locate_mesh(body, folder)
    if body.mesh.file in GIVEN:
        return str(path).encode()  # it has a digest
    data = path.read_bytes()
    words = NAMES_OTHERS.get(path.suffix.lower())
    return (
        None
        if words is not None and re.search(words, data, re.IGNORECASE)
        else hashlib.blake2b(data).digest()
    )


def _turned(mesh: Mesh, key: str, acted: Collection[str]) -> Mesh:
    """The axisymmetric mesh, with nodes moved onto x = 0 that are on it up to rounding. Raises InputError for x < 0,
    and for facets on the axis of a group that is `acted` on."""
    points = mesh.points.copy()
    points[np.abs(points[:, 0]) <= ROUNDING * np.abs(points).max(), 0] = 0.0
    if points[:, 0].min() < 0.0:
        raise InputError(
            f"{key}: the node at {in_words(points[points[:, 0].argmin()])} lies on the other side of the "
            "axis; an axisymmetric scene has x >= 0, x being the radius and y the axis"
        )
    for name in acted:
        if name in mesh.groups and not points[mesh.groups[name], 0].any(axis=1).all():
            raise InputError(
                f"{key}: {name!r} has sides on the axis, where they have no area: contacts, loads and "
                "foundations are on other sides, and nodes on the axis are fixed radially anyway"
            )
    return replace(mesh, points=points, axisymmetric=True)


def _refuse_huge(cells: float, names: str, key: str) -> None:
    """Raise InputError where free memory cannot hold so many cells and their stiffness."""
    needed = EACH * cells
    if needed > LITTLE and needed > (free := free_memory()):
        raise InputError(
            f"{key}: {cells:.2g} {names} need more than {needed / 2**30:.2g} GiB of memory; "
            f"{free / 2**30:.2g} GiB are free"
        )


def kind_of_files(scene_path: str | Path) -> FileKind:
    """The function that `read_scene` asks for dimension and order of a body's mesh file. It reads each file once.

    Drawings have no order, so 1. Not collective. The function raises InputError.
    """

    @functools.cache
    def of_file(path: Path, name: str, part: str | None) -> tuple[int, int]:
        from ddmpi.mesh.read import file_kind

        return file_kind(path, name, part)

    drawings = dict[Path, int]()  # of which no name tells more

    def kind(body: BodySpec) -> tuple[int, int]:
        path = locate_mesh(body, folder)
        if not body.mesh.geometry:
            part = None if body.mesh.part is None else str(body.mesh.part)
            return of_file(path, body.name, part)
        if path not in drawings:
            from ddmpi.mesh.geometry import dimension_of

            drawings[path] = dimension_of(path, f"body.{body.name}.mesh.geometry: {path}")
        return drawings[path], 1

    folder = Path(scene_path).parent
    return kind


def locate_mesh(body: BodySpec, folder: Path) -> Path:
    """The mesh or geometry of `body`, looked for in `folder`, then in the current directory. Raises InputError."""
    if body.mesh.file in GIVEN:
        return Path(str(body.mesh.file))
    key = "file" if body.mesh.geometry is None else "geometry"
    name = Path(str(getattr(body.mesh, key)))
    places = dict.fromkeys([folder / name, name])  # an absolute one stays what it is
    tried = []
    for place in places:
        try:
            if stat.S_ISREG(os.stat(place).st_mode):
                return place
            reason = ""
        except (
            OSError,
            ValueError,
        ) as error:  # a folder without permission, a zero byte in the name
            reason = f" ({getattr(error, 'strerror', error)})" * (
                not isinstance(error, FileNotFoundError)
            )
        tried.append(f"{place}{reason}")
    raise InputError(f"body.{body.name}.mesh.{key}: there is no file {' nor '.join(tried)}")
