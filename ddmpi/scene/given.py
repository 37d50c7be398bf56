"""Meshes that a program gives as arrays, or of meshio: a scene names them in the place of files."""

import copy
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from ddmpi.errors import InputError
from ddmpi.scene.values import LARGEST
from ddmpi.system.numbers import in_words

CELLS: dict[int, dict[int, str]] = {
    1: {2: "line", 3: "line3"},
    2: {3: "triangle", 6: "triangle6", 4: "quad", 8: "quad8"},
    3: {4: "tetra", 10: "tetra10", 8: "hexahedron", 20: "hexahedron20"},
}
"""meshio's words for cells, by their dimension and number of nodes, which are in its order."""


@dataclass(frozen=True, eq=False)
class Given:
    """A mesh of a program.

    Attributes
    ----------
    name : that stands in the scene in the place of a file's, with a digest of the mesh
    mesh : of meshio
    """

    name: str
    mesh: Any


GIVEN: WeakValueDictionary[str, Given] = WeakValueDictionary()
"""The meshes of programs by name, as long as a model has them."""


def with_names(data: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[Given]]:
    """The data of a scene with the names of meshes that bodies have as arrays, and these meshes; the names last as long
    as they do. Not collective. Raises InputError for arrays that are no mesh."""
    bodies = data.get("body")
    given = list[Given]()
    if not isinstance(bodies, Sequence):
        return data, given
    named = []
    for k, body in enumerate(bodies):
        mesh = body.get("mesh") if isinstance(body, Mapping) else None
        if _is_mesh(mesh):
            named_mesh, raw = _with_name(mesh, f"body.{body.get('name', k)}.mesh")
            given.append(raw)
            body = {**body, "mesh": named_mesh}
        named.append(body)
    return {**data, "body": named}, given


def values_with_names(overrides: Mapping[str, Any]) -> tuple[dict[str, Any], list[Given]]:
    """`with_names` of values by key, of which some may be meshes as arrays."""
    meshes = {key: overrides[key] for key in overrides if str(key).endswith(".mesh")}
    meshes = {key: mesh for key, mesh in meshes.items() if _is_mesh(mesh)}
    named = {key: _with_name(mesh, f"overrides: {key}") for key, mesh in meshes.items()}
    values = {key: named[key][0] if key in named else overrides[key] for key in overrides}
    return values, [raw for _, raw in named.values()]


def _with_name(mesh: Any, key: str) -> tuple[dict[str, Any], Given]:
    """The keys of a mesh as arrays, or of meshio, with its name in the place of a file's; and this mesh. Raises
    InputError."""
    arrays = mesh if isinstance(mesh, Mapping) else {}
    given = _registered(_of_arrays(arrays, key) if arrays else copy.deepcopy(mesh))
    others = {name: arrays[name] for name in arrays if name not in ARRAYS}
    return {**others, "file": given.name}, given


ARRAYS = ("points", "cells", "groups")
"""The keys of a mesh as arrays."""


def _is_mesh(mesh: Any) -> bool:
    """Whether this is a mesh as arrays, or one of meshio."""
    if isinstance(mesh, Mapping):
        return "points" in mesh or "cells" in mesh
    return hasattr(mesh, "points") and hasattr(mesh, "cells_dict")


def _registered(raw: Any) -> Given:
    """A mesh of meshio by the name that it gets."""
    total = hashlib.blake2b(digest_size=8)
    numbers = [*raw.point_sets.values()]
    for blocks in (*raw.cell_sets.values(), *raw.cell_data.values()):
        numbers += blocks
    words = (
        [block.type for block in raw.cells],
        *map(list, (raw.point_sets, raw.cell_sets, raw.cell_data)),
    )
    total.update(repr((words, raw.field_data)).encode())
    for array in (raw.points, *(block.data for block in raw.cells), *numbers):
        array = np.ascontiguousarray(np.empty(0) if array is None else array)
        total.update(repr((array.shape, array.dtype.str)).encode() + array.tobytes())
    cells = sum(len(block.data) for block in raw.cells)
    name = f"arrays of {len(raw.points)} nodes and {cells} cells, {total.hexdigest()}"
    return GIVEN.setdefault(name, Given(name, raw))


def _of_arrays(arrays: Mapping[str, Any], key: str) -> Any:
    """A mesh of meshio of points (n, d), cells (nt, k), and by name groups: facets, in space also edges, (nf, kf), or
    nodes (j,). Raises InputError."""
    import meshio

    missing = [name for name in ARRAYS if arrays.get(name) is None]
    if missing:
        raise InputError(
            f"{key}: a mesh as arrays has points (n, d), cells (nt, k) and groups, by name facets (nf, kf) or nodes "
            f"(j,); {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        )
    points = _array(arrays["points"], f"{key}.points", "f")
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InputError(
            f"{key}.points: expected numbers of size (n, 2) or (n, 3), got {points.shape}"
        )
    if not (near := (np.abs(points) <= LARGEST).all(axis=1)).all():
        k = int(near.argmin())
        raise InputError(
            f"{key}.points: expected finite numbers up to {LARGEST:g}, point {k} is at {in_words(points[k])}"
        )
    if not points[:, 2:].any():  # as meshio has points of the plane
        points = points[:, :2]
    number, d = points.shape
    if not isinstance(arrays["groups"], Mapping):
        raise InputError(f"{key}.groups: expected facets or nodes by name")
    cells = _numbered(arrays["cells"], f"{key}.cells", number)
    blocks = [(_kind(cells, f"{key}.cells", d), cells)]
    nodes = dict[str, np.ndarray]()
    named = list[str]()
    for name, group in arrays["groups"].items():
        members = _numbered(group, f"{key}.groups.{name}", number)
        if members.ndim == 1:
            nodes[str(name)] = members
        else:
            kind = _kind(members, f"{key}.groups.{name}", *range(d - 1, 0, -1))
            blocks.append((kind, members))
            named.append(str(name))
    none = np.empty(0, int)
    sets = {
        name: [np.arange(len(block)) if j == k else none for j, (_, block) in enumerate(blocks)]
        for k, name in enumerate(named, 1)
    }
    points = np.pad(points, ((0, 0), (0, 3 - d)))
    return meshio.Mesh(points, blocks, point_sets=nodes, cell_sets=sets)


def _array(value: Any, key: str, kind: str) -> np.ndarray:
    """A copy of numbers, of whole ones for the `kind` "i". Raises InputError."""
    try:
        array = np.array(value)
    except ValueError:
        raise InputError(f"{key}: expected rows of numbers of one length") from None
    if not array.size or np.ma.is_masked(value):
        raise InputError(f"{key}: {'is empty' if not array.size else 'has masked numbers'}")
    if array.dtype.kind not in {"f": "fiu", "i": "iu"}[kind]:
        what = "whole numbers, those of nodes, from 0 on" if kind == "i" else "numbers"
        raise InputError(f"{key}: expected {what}, got an array of {array.dtype}")
    return array.astype(float if kind == "f" else np.int64)


def _numbered(value: Any, key: str, number: int) -> np.ndarray:
    """An array of numbers of nodes, of which there are so many. Raises InputError."""
    nodes = _array(value, key, "i")
    if nodes.ndim not in (1, 2):
        raise InputError(f"{key}: expected numbers of nodes, (nt, k) or (j,), got {nodes.shape}")
    if nodes.min() < 0 or nodes.max() >= number:
        raise InputError(
            f"{key}: there are {number} points, counted from 0; {nodes.min()} to {nodes.max()} are named"
        )
    return nodes


def _kind(nodes: np.ndarray, key: str, *dimensions: int) -> str:
    """meshio's word for cells with these nodes, of one of some dimensions. Raises InputError."""
    known = {k: word for d in reversed(dimensions) for k, word in CELLS[d].items()}
    if nodes.ndim != 2 or nodes.shape[1] not in known:
        listed = ", ".join(f"{k} ({word})" for k, word in known.items())
        raise InputError(
            f"{key}: expected rows of nodes, of as many as {listed}; got {nodes.shape}"
        )
    return known[nodes.shape[1]]
