"""Heated bodies: free expansion, parts that expand differently, against closed forms."""

import numpy as np
import pytest
from by_skfem import solve
from msgspec.structs import replace

from ddmpi.body.elasticity import assemble, clamp_forces
from ddmpi.body.estimate import estimate_error
from ddmpi.body.loads import resultants
from ddmpi.body.stress import material_of, stress, von_mises
from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, PartMaterial

E, NU, ALPHA, T = 2.1e11, 0.3, 1.2e-5, 80.0
SHAPES = {
    "quadrilateral": {
        "shape": "quadrilateral",
        "corners": ((0.0, 0.0), (3.0, 0.5), (2.5, 2.0), (0.0, 1.0)),
        "divisions": (5, 4),
    },
    "ring": {
        "shape": "annulus",
        "center": (0.0, 0.0),
        "radii": (1.0, 2.0),
        "angles": (0.0, 90.0),
        "divisions": (6, 3),
    },
    "box": {
        "shape": "hexahedron",
        "divisions": (2, 2, 2),
        "corners": (
            (0.0, 0.0, 0.0),
            (2.0, 0.0, 0.0),
            (2.0, 1.5, 0.0),
            (0.0, 1.0, 0.0),
            (0.0, 0.0, 1.0),
            (2.2, 0.0, 1.0),
            (2.0, 1.0, 1.2),
            (0.0, 1.0, 1.0),
        ),
    },
    "cone": {
        "shape": "quadrilateral",
        "corners": ((0.0, 0.0), (2.0, 0.0), (1.5, 1.0), (0.0, 1.0)),
        "divisions": (4, 3),
    },
}
HELD = {
    "quadrilateral": [Clamp(on="left", x=0.0), Clamp(on="corner", y=0.0)],
    "ring": [Clamp(on="start", y=0.0), Clamp(on="end", x=0.0)],
    "box": [Clamp(on="left", x=0.0), Clamp(on="front", y=0.0), Clamp(on="bottom", z=0.0)],
    "cone": [Clamp(on="bottom", y=0.0)],
}
every_body = pytest.mark.parametrize(
    ("shape", "plane"),
    [
        ("quadrilateral", "strain"),
        ("quadrilateral", "stress"),
        ("ring", "strain"),
        ("box", None),
        ("cone", None),
    ],
)
both_orders = pytest.mark.parametrize("order", [1, 2])


def body(shape: str, order: int, plane: str | None, **more) -> tuple[Mesh, BodySpec]:
    material = Material(young=E, poisson=NU, plane=plane, expansion=ALPHA)
    spec = BodySpec(name="body", mesh=MeshSpec(order=order, **SHAPES[shape]), material=material)
    mesh, spec = build_mesh(spec), replace(spec, **more)
    return Mesh(
        mesh.points,
        mesh.triangles,
        mesh.groups,
        {"corner": np.array([0])},
        axisymmetric=shape == "cone",
    ), spec


@every_body
@both_orders
def test_free_expansion(shape, plane, order):
    """A body that nothing hinders grows by α T, in plane strain by (1 + ν) α T, without stress but that across."""
    mesh, spec = body(shape, order, plane, clamp=HELD[shape], temperature=T)
    problem, u = assemble(mesh, spec), solve(mesh, spec)
    growth = ALPHA * T * (1.0 + NU if plane == "strain" else 1.0)
    assert np.abs(u - growth * mesh.points).max() <= 1e-12 * growth * mesh.extent
    sigma, across = (
        stress(mesh, spec.material, u, problem.acting.heated),
        -E * ALPHA * T * (plane == "strain"),
    )
    expected = np.zeros_like(sigma)
    expected[:, 2] = across
    assert np.abs(sigma - expected).max() <= 1e-10 * E * ALPHA * T
    assert von_mises(sigma) == pytest.approx(abs(across), abs=1e-10 * E * ALPHA * T)
    error = estimate_error(mesh, spec.material, u, problem.acting.heated)
    least = 1e-18 * E * (ALPHA * T) ** 2 * error.area
    assert error.energy == pytest.approx(across**2 / E * error.area, rel=1e-12, abs=least)
    assert error.total <= least


@pytest.mark.parametrize("shape", ["quadrilateral", "box"])
def test_linear_temperature_strains_freely(shape):
    """A temperature that is linear in place bends a free body without stress: elements of order 2 are exact."""
    mesh, spec = body(
        shape, 2, "stress" if shape != "box" else None, temperature="30 + 20*x - 10*y"
    )
    supports = [
        Clamp(on="a", x=0.0, y=0.0, z=0.0),
        Clamp(on="b", y=0.0, z=0.0),
        Clamp(on="c", z=0.0),
    ]
    points = (
        {"a": (0.0, 0.0), "b": (3.0, 0.5)}
        if shape != "box"
        else {"a": (0.0, 0.0, 0.0), "b": (2.0, 0.0, 0.0), "c": (0.0, 1.0, 0.0)}
    )
    vertices = {
        name: np.flatnonzero(np.linalg.norm(mesh.points - place, axis=1) < 1e-9)
        for name, place in points.items()
    }
    mesh = Mesh(mesh.points, mesh.triangles, mesh.groups, vertices)
    spec = BodySpec(
        name="body",
        mesh=spec.mesh,
        material=spec.material,
        temperature=spec.temperature,
        clamp=supports[: len(points)],
    )
    sigma = stress(mesh, spec.material, solve(mesh, spec), assemble(mesh, spec).acting.heated)
    assert np.abs(sigma).max() <= 1e-9 * E * ALPHA * 100.0


@both_orders
def test_bars_of_two_materials_between_walls(order):
    """Two bars in a row between walls on all sides: along them σ = −T (α₁ L₁ + α₂ L₂) / (L₁/E₁ + L₂/E₂) for ν = 0."""
    mesh = build_mesh(
        BodySpec(
            name="body",
            material=Material(young=1.0, poisson=0.0),
            mesh=MeshSpec(shape="rectangle", size=(3.0, 1.0), divisions=(6, 2), order=order),
        )
    )
    left = mesh.points[mesh.corners].mean(axis=1)[:, 0] < 1.0
    mesh = Mesh(mesh.points, mesh.triangles, mesh.groups, {}, {"one": np.flatnonzero(left)})
    spec = BodySpec(
        name="body",
        mesh=MeshSpec(file="unused.msh"),
        temperature=T,
        material=[
            PartMaterial(on="one", young=E, poisson=0.0, plane="stress", expansion=ALPHA),
            PartMaterial(young=E / 3, poisson=0.0, plane="stress", expansion=2 * ALPHA),
        ],
        clamp=[
            Clamp(on="left", x=0.0),
            Clamp(on="right", x=0.0),
            Clamp(on="bottom", y=0.0),
            Clamp(on="top", y=0.0),
        ],
    )
    u, problem = solve(mesh, spec), assemble(mesh, spec)
    pressure = T * ALPHA * (1.0 + 2 * 2.0) / (1.0 / E + 3 * 2.0 / E)
    assert stress(mesh, material_of(mesh, spec), u, problem.acting.heated)[:, 0] == pytest.approx(
        -pressure, rel=1e-10
    )
    reactions = resultants(mesh, clamp_forces(mesh, spec, problem, u, np.zeros_like(u)))
    assert reactions["left"]["force"] == pytest.approx(
        [pressure, 0.0], rel=1e-10, abs=1e-10 * pressure
    )
    assert reactions["right"]["force"] == pytest.approx(
        [-pressure, 0.0], rel=1e-10, abs=1e-10 * pressure
    )


def test_a_temperature_that_is_not_finite_is_refused():
    """A formula that is not finite somewhere in the body is one clear error with its place."""
    mesh, spec = body("quadrilateral", 1, "strain", clamp=["left"], temperature="1 / x")
    with pytest.raises(
        InputError, match=r'body.body.temperature: the formula "1 / x" is inf at \(0, '
    ):
        assemble(mesh, spec)
