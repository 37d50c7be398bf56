"""The mesh of a body as its scene asks for it: generated or read, refined, and raised to the order."""

from __future__ import annotations

import functools
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import boundary_group, group_nodes, material_numbers
from ddmpi.mesh.mesh import Mesh, refuse_folded
from ddmpi.mesh.read import file_order, read_mesh
from ddmpi.mesh.refine import halve, raise_order
from ddmpi.mesh.shapes import generate_annulus, generate_quadrilateral, generate_rectangle
from ddmpi.scene.bodies import BodySpec

SHAPES = {"rectangle": generate_rectangle, "quadrilateral": generate_quadrilateral, "annulus": generate_annulus}
"""What generates the mesh of a shape."""


def build_mesh(body: BodySpec, folder: Path = Path(".")) -> Mesh:
    """Generate or read the mesh of `body` and check that it has the groups that the body names.

    Relative mesh files are looked for in `folder` (the scene's own) first, then in the current directory.
    Not collective. Raises InputError.
    """
    spec = body.mesh
    key = f"body.{body.name}.mesh"
    mesh = SHAPES[spec.shape](spec) if spec.shape else read_mesh(locate_mesh(body, folder), body.name, spec.order or 1)
    for _ in range(spec.halvings):
        mesh = halve(mesh, key)
    if spec.order == 2 and mesh.order == 1:
        mesh = raise_order(mesh, key)
    refuse_folded(mesh, key)
    material_numbers(mesh, body)
    for clamp in body.clamps:
        group_nodes(mesh, clamp.on, f"body.{body.name}.clamp")
    for traction in body.traction:
        boundary_group(mesh, traction.on, f"body.{body.name}.traction")
    return mesh


def order_of_files(scene_path: str | Path) -> Callable[[BodySpec], Literal[1, 2]]:
    """The function that `read_scene` asks for the order of a body's mesh file. It reads each file once.

    Not collective. The function raises InputError.
    """
    order = functools.cache(file_order)
    return lambda body: order(locate_mesh(body, Path(scene_path).parent), body.name)


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
