"""What the scenes of the verification problems are made of: bodies, supports, contacts, meshes drawn by gmsh."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import ddmpi
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import gmsh_session
from ddmpi.mesh.shapes import generate_annulus
from ddmpi.run.answer import Answer
from ddmpi.scene.bodies import MeshSpec
from problems import Order

RADIUS = 1.0
"""Of balls (m)."""

# Scenes


def solved(
    bodies: list[dict],
    contacts: list[dict],
    rigid: Sequence[dict] = (),
    tolerance: float = 1e-8,
    **more: Any,
) -> Answer:
    """The answer of a scene with `more` tables."""
    return answer_of(
        more
        | {
            "rigid": list(rigid),
            "body": bodies,
            "contact": contacts,
            "method": {"tolerance": tolerance},
        }
    )


def answer_of(scene: dict | Path, changes: Mapping[str, Any] | None = None) -> Answer:
    """The answer on this rank alone. Stops with the reason where it is not certified."""
    answer = ddmpi.solve(scene, MPI.COMM_SELF, changes)
    if not answer.certified:
        raise RuntimeError(answer.reason)
    return answer


def body(
    name: str,
    mesh: dict,
    young: float,
    poisson: float,
    clamp: Sequence[dict | str] = (),
    traction: Mapping[str, Sequence[float]] | None = None,
    **more: Any,
) -> dict:
    """A body; tractions by group. Further keys go to the material."""
    return {
        "name": name,
        "mesh": mesh,
        "material": {"young": young, "poisson": poisson} | more,
        "clamp": list(clamp),
        "traction": [{"on": on, "value": list(value)} for on, value in (traction or {}).items()],
    }


def held(**groups: str | dict) -> list[dict]:
    """Clamps by group: the axes along which it does not move, or keys."""
    return [
        {"on": on} | (dict.fromkeys(how, 0.0) if isinstance(how, str) else how)
        for on, how in groups.items()
    ]


QUARTER = held(start="y", end="x")
"""How a quarter is held on its planes of symmetry."""


def contact(first: str, second: str, *on: str, **more: Any) -> dict:
    return {"bodies": [first, second], "on": list(on)} | more


def coulomb(coefficient: float) -> dict:
    return {"law": "coulomb", "coefficient": coefficient}


def tresca(bound: float) -> dict:
    return {"law": "tresca", "slip_bound": bound}


def plane(name: str, point: Sequence[float], normal: Sequence[float], **more: Any) -> dict:
    """A rigid partner."""
    return {"name": name, "shape": "plane", "point": list(point), "normal": list(normal)} | more


FLOOR = plane("floor", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def courses(**pairs: Iterable[tuple[float, float]]) -> dict:
    """Histories by name, as pairs of a time and a factor."""
    return {
        name: dict(zip(("times", "factors"), map(list, zip(*course, strict=True)), strict=True))
        for name, course in pairs.items()
    }


# Meshes


def number(order: Order) -> int:
    return order if isinstance(order, int) else 2


def block(
    x: float, y: float, width: float, height: float, divisions: tuple[int, int], order: Order
) -> dict:
    return {
        "shape": "rectangle",
        "origin": [x, y],
        "size": [width, height],
        "divisions": list(divisions),
        "order": number(order),
    }


def box(x: float, z: float, height: float, divisions: tuple[int, int, int], order: Order) -> dict:
    """One metre square, from (x, 0, z) on."""
    return {
        "shape": "box",
        "origin": [x, 0.0, z],
        "size": [1.0, 1.0, height],
        "divisions": list(divisions),
        "order": number(order),
    }


def between(corners: Sequence[Sequence[float]], divisions: tuple[int, ...], order: Order) -> dict:
    """A quadrilateral or hexahedron."""
    return {
        "shape": "quadrilateral" if len(corners) == 4 else "hexahedron",
        "order": number(order),
        "corners": [list(map(float, each)) for each in corners],
        "divisions": list(divisions),
    }


def annulus(
    radii: tuple[float, float],
    divisions: tuple[int, int],
    order: Order,
    folder: Path,
    angles: tuple[float, float] = (0.0, 90.0),
) -> dict:
    """A part of a ring; of order "2 straight" as a file of linear elements, which the program raises."""
    if order == "2 straight":
        made = ring_of(radii, divisions, angles)
        return write(folder / f"ring_{radii[0]}_{radii[1]}.msh", made, made.groups, order)
    return {
        "shape": "annulus",
        "center": [0.0, 0.0],
        "radii": list(radii),
        "angles": list(angles),
        "divisions": list(divisions),
        "order": number(order),
    }


def ring_of(
    radii: tuple[float, float], divisions: tuple[int, int], angles: tuple[float, float]
) -> Mesh:
    return generate_annulus(
        MeshSpec(
            shape="annulus", center=(0.0, 0.0), radii=radii, angles=angles, divisions=divisions
        )
    )


def write(path: Path, mesh: Mesh, groups: Mapping[str, np.ndarray], order: Order) -> dict:
    """A file of a linear mesh with the edges (k, 2) of its groups."""
    import meshio

    lines = np.concatenate(list(groups.values()))
    physical = np.repeat(np.arange(len(groups)) + 1, [len(each) for each in groups.values()])
    whole = np.full(len(mesh.triangles), len(groups) + 1)
    meshio.write(
        path,
        meshio.Mesh(
            np.column_stack([mesh.points, np.zeros(len(mesh.points))]),
            [("line", lines), ("triangle", mesh.triangles)],
            cell_data={key: [physical, whole] for key in ("gmsh:physical", "gmsh:geometrical")},
            field_data={name: np.array([k + 1, 1]) for k, name in enumerate(groups)},
        ),
        file_format="gmsh22",
        binary=False,
    )
    return {"file": str(path), "order": number(order)}


def only_own_sizes(gmsh: Any) -> None:
    for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


def draw(
    path: Path,
    corners: Mapping[str, tuple[float, float]],
    lines: Mapping[str, str],
    size: str,
    order: Order,
    groups: Mapping[str, Sequence[str]] | None = None,
) -> dict:
    """The mesh of a plane figure by gmsh.

    Parameters
    ----------
    corners : points by name
    lines : around the figure, each a group, by the names of points: straight from one to another, or an arc from the
        first around the second to the third
    size : of the elements, as gmsh reads a formula in x and y; quadratic ones are twice as large
    groups : more groups, of several lines
    """
    with gmsh_session() as gmsh:
        geometry, field = gmsh.model.geo, gmsh.model.mesh.field
        points = {name: geometry.addPoint(x, y, 0.0) for name, (x, y) in corners.items()}
        drawn = {}
        for name, ends in lines.items():
            tags = [points[end] for end in ends.split()]
            drawn[name] = (geometry.addLine if len(tags) == 2 else geometry.addCircleArc)(*tags)
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(list(drawn.values()))])
        geometry.synchronize()
        for name, some in ({name: [name] for name in lines} | dict(groups or {})).items():
            gmsh.model.addPhysicalGroup(1, [drawn[each] for each in some], name=name)
        gmsh.model.addPhysicalGroup(2, [surface], name="body")
        sizes = field.add("MathEval")
        field.setString(sizes, "F", f"{number(order)} * ({size})")
        field.setAsBackgroundMesh(sizes)
        only_own_sizes(gmsh)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    return {"file": str(path), "order": number(order)}
