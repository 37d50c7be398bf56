"""The mesh of a body as its scene asks for it: generated or read, refined, of the order that is wanted."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh, boundary_group
from ddmpi.mesh.read import read_mesh
from ddmpi.mesh.refine import halve, raise_order
from ddmpi.scene.bodies import BodySpec, MeshSpec
from ddmpi.system import interrupt


def build_mesh(body: BodySpec, folder: Path = Path(".")) -> Mesh:
    """Generate or read the mesh of `body` and check that it has the groups the body names.

    `folder` is where relative mesh files are looked for first (the scene's own folder), before the
    current directory. Not collective. Raises InputError.
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


def generate_rectangle(spec: MeshSpec) -> Mesh:
    """A rectangle of structured triangles, diagonals from lower left to upper right, by gmsh.

    Groups: ``left``, ``right``, ``bottom``, ``top``. Not collective.
    """
    import gmsh

    (x0, y0), (width, height), (nx, ny) = spec.origin, spec.size, spec.divisions
    # gmsh snaps what is closer than its own absolute tolerance, so it meshes the unit square.
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    interrupt.listen_again()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        geometry = gmsh.model.geo
        corners = [geometry.addPoint(x, y, 0.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines = [geometry.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(lines)])
        for line, divisions in zip(lines, (nx, ny, nx, ny), strict=True):
            geometry.mesh.setTransfiniteCurve(line, divisions + 1)
        geometry.mesh.setTransfiniteSurface(surface, "Right")
        geometry.synchronize()
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        number = np.empty(int(tags.max()) + 1, dtype=np.int64)
        number[tags.astype(np.int64)] = np.arange(len(tags))
        points = coordinates.reshape(-1, 3)[:, :2]
        triangles = number[gmsh.model.mesh.getElementsByType(2)[1].astype(np.int64)].reshape(-1, 3)
        groups = {name: number[gmsh.model.mesh.getElementsByType(1, line)[1].astype(np.int64)].reshape(-1, 2)
                  for name, line in zip(("bottom", "right", "top", "left"), lines, strict=True)}
    finally:
        gmsh.finalize()
        interrupt.listen_again()
    grid = np.rint(points * (nx, ny))  # exact multiples, so that both sides of an interface agree
    points = np.array([x0, y0]) + grid / (nx, ny) * (width, height)
    return Mesh(points, triangles, groups)


def locate_mesh(body: BodySpec, folder: Path) -> Path:
    """The mesh file of `body`, looked for in `folder`, then in the current one. Raises InputError."""
    name = Path(body.mesh.file)
    places = [name] if name.is_absolute() else [folder / name, name]
    tried = []
    for place in places:
        try:
            if stat.S_ISREG(os.stat(place).st_mode):
                return place
            tried.append(str(place))
        except FileNotFoundError:
            tried.append(str(place))
        except (OSError, ValueError) as error:  # a folder that may not be searched, a zero byte
            tried.append(f"{place} ({getattr(error, 'strerror', error)})")
    raise InputError(f"body.{body.name}.mesh.file: there is no file {' nor '.join(tried)}")
