"""Whether a scene is in the plane or in space, and what in it belongs to the other dimension."""

from collections.abc import Callable, Iterator
from typing import Any

from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.formulas import formulas_of, varies
from ddmpi.scene.values import WHERE, Misplaced, no_z, tables

FileKind = Callable[[BodySpec], tuple[int, int]]
"""Gives dimension and order of the elements in the mesh file, or in the drawing, of a body; raises InputError."""

EXTENTS = (
    "size",
    "divisions",
    "radii",
    "angles",
    "bodies",
    "on",
    "young",
    "poisson",
    "shear",
    "expansion",
    "view",
)
"""Keys of lists that are neither places nor vectors."""

Given = tuple[str, Any, int]
"""A key, its value, and the dimension that it has."""


def dimension_of(scene: Any, file_kind: FileKind | None) -> int:
    """Number of coordinates of all places and vectors of a `Scene`. Raises ValueError if it differs within the scene."""
    given = [*_shapes(scene), *_vectors(scene)] or (_files(scene, file_kind) if file_kind else [])
    first, value, dimension = given[0] if given else ("", "", 2)
    where = {d: words + f", as {first} = {value}" * bool(first) for d, words in WHERE.items()}
    if scene.axisymmetric:
        where[2] = "around an axis, as axisymmetric = true"
    for number, key, what in misplaced(scene):
        if number != dimension:
            raise ValueError(f"{key}: {what}; this scene is {where[dimension]}")
    for key, other, number in given:
        if number != dimension:
            raise ValueError(
                f"{key}: {other} is {WHERE[number]}, and {first} = {value} is {WHERE[dimension]}; a "
                "scene has plane shapes and lists [x, y], or solid ones and lists [x, y, z]"
            )
    return dimension


def _shapes(scene: Any) -> Iterator[Given]:
    for body in scene.body:
        if body.mesh.dimension:
            yield f"body.{body.name}.mesh.shape", body.mesh.shape, body.mesh.dimension


def _vectors(scene: Any) -> Iterator[Given]:
    """All places and vectors within a scene."""
    for key, table in tables(scene):
        for name in table.__struct_fields__:
            value = getattr(table, name)
            if isinstance(value, tuple) and name not in EXTENTS:
                for part in value if isinstance(value[0], tuple) else [value]:
                    yield f"{key}.{name}", list(part), len(part)


def _files(scene: Any, file_kind: FileKind) -> list[Given]:
    return [
        (
            f"body.{body.name}.mesh.{'file' if body.mesh.file else 'geometry'}",
            body.mesh.file or body.mesh.geometry,
            file_kind(body)[0],
        )
        for body in scene.body
    ]


def misplaced(scene: Any) -> Misplaced:
    """What belongs to one dimension only: the dimension, the key, and the reason."""
    if scene.axisymmetric:
        yield 2, "axisymmetric", "axisymmetric bodies are drawn in the half-plane x >= 0"
    for key, table in tables(scene):
        for number, name, words in table.of_one_dimension(scene.axisymmetric):
            yield number, f"{key}.{name}", words
        for name, value in formulas_of(table):
            if varies(value, "z"):
                yield 3, f"{key}.{name}", no_z(scene.axisymmetric)
    planes = {body.name: body.plane for body in scene.body}
    for contact in scene.contact:
        one, other = contact.bodies
        if other in planes and planes[one] != planes[other]:
            yield (
                3,
                f"contact.{contact.called}.bodies",
                f"{one!r} is in plane {planes[one]} and {other!r} in plane {planes[other]}; they cannot touch, so give both "
                "the same material.plane",
            )
