"""The mesh of a body as its scene asks for it: generated or read, refined, and raised to the order."""

from __future__ import annotations

import functools
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import boundary_group
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import file_order, read_mesh
from ddmpi.mesh.refine import halve, raise_order
from ddmpi.scene.bodies import BodySpec, MeshSpec


def build_mesh(body: BodySpec, folder: Path = Path(".")) -> Mesh:
    """Generate or read the mesh of `body` and check that it has the groups that the body names.

    Relative mesh files are looked for in `folder` (the scene's own) first, then in the current directory.
    Not collective. Raises InputError.
    """
    spec = body.mesh
    mesh = generate_rectangle(spec) if spec.file is None else read_mesh(locate_mesh(body, folder), body.name)
    for _ in range(spec.halvings):
        mesh = halve(mesh, f"body.{body.name}.mesh")
    if spec.order == 2:
        mesh = raise_order(mesh, f"body.{body.name}.mesh")
    for key, names in (("clamp", [c.on for c in body.clamps]), ("traction", [t.on for t in body.traction])):
        for name in names:
            boundary_group(mesh, name, f"body.{body.name}.{key}")
    return mesh


def order_of_files(scene_path: str | Path) -> Callable[[BodySpec], Literal[1, 2]]:
    """The function that `read_scene` asks for the order of a body's mesh file. It reads each file once.

    Not collective. The function raises InputError.
    """
    order = functools.cache(file_order)
    return lambda body: order(locate_mesh(body, Path(scene_path).parent), body.name)


def generate_rectangle(spec: MeshSpec) -> Mesh:
    """A rectangle of structured triangles, diagonals from lower left to upper right.

    Groups ``bottom``, ``right``, ``top``, ``left``. Corners come first, then the other nodes of the sides,
    both counter-clockwise, then the inner nodes by columns: the numbers that gmsh gives a transfinite surface.
    The ordering inside MUMPS depends on them. Not collective.
    """
    assert spec.divisions and spec.size  # of a shape, the scene has seen to it
    nx, ny = spec.divisions
    grid = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    sides = (grid[:, 0], grid[-1], grid[::-1, -1], grid[0, ::-1])
    order = np.concatenate([[s[0] for s in sides], *(s[1:-1] for s in sides), grid[1:-1, 1:-1].ravel()])
    # exact multiples, so that both sides of an interface agree
    points = np.array(spec.origin) + np.column_stack(np.divmod(order, ny + 1)) / (nx, ny) * spec.size
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    a, b, c, d = number[grid[:-1, :-1]], number[grid[1:, :-1]], number[grid[1:, 1:]], number[grid[:-1, 1:]]
    triangles = np.stack([a, b, c, c, d, a], axis=-1).reshape(-1, 3)
    groups = {name: number[np.column_stack([side[:-1], side[1:]])]
              for name, side in zip(("bottom", "right", "top", "left"), sides, strict=True)}
    return Mesh(points, triangles, groups)


def locate_mesh(body: BodySpec, folder: Path) -> Path:
    """The mesh file of `body`, looked for in `folder`, then in the current directory. Raises InputError."""
    name = Path(str(body.mesh.file))
    places = [name] if name.is_absolute() else [folder / name, name]
    tried = []
    for place in places:
        try:
            if stat.S_ISREG(os.stat(place).st_mode):
                return place
            tried.append(str(place))
        except FileNotFoundError:
            tried.append(str(place))
        except (OSError, ValueError) as error:  # a folder without permission, a zero byte in the name
            tried.append(f"{place} ({getattr(error, 'strerror', error)})")
    raise InputError(f"body.{body.name}.mesh.file: there is no file {' nor '.join(tried)}")
