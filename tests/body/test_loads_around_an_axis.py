"""Heat, total forces, clamps along normals and orthotropic materials of turned parts."""

from dataclasses import replace

import numpy as np
import pytest
from by_skfem import solve

from ddmpi.body.elasticity import assemble
from ddmpi.body.estimate import estimate_error
from ddmpi.body.loads import nodal_loads, supports
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import stress
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction

E, NU, ALPHA, T = 2.1e11, 0.3, 1.2e-5, 80.0
STEEL = Material(young=E, poisson=NU, expansion=ALPHA)
both_orders = pytest.mark.parametrize("order", [1, 2])


def cone(order: int, bore: float) -> Mesh:
    """A turned part with a slanting flank, its inner side at the radius `bore`."""
    spec = BodySpec(name="body", material=STEEL, mesh=MeshSpec(
        shape="quadrilateral", corners=((bore, 0.0), (2.0, 0.0), (1.5, 1.0), (bore, 1.0)), divisions=(4, 3),
        order=order))
    return replace(build_mesh(spec), axisymmetric=True)


def body(**more) -> BodySpec:
    return BodySpec(name="body", mesh=MeshSpec(file="unused.msh"), **{"material": STEEL} | more)


@both_orders
@pytest.mark.parametrize("bore", [0.0, 0.5])
def test_free_and_held_expansion(bore, order):
    """A turned part grows by α T in all directions without stress; held all around it bears E α T / (1 − 2 ν)."""
    mesh = cone(order, bore)
    spec = body(clamp=[Clamp(on="bottom", y=0.0)], temperature=T)
    u, heat = solve(mesh, spec), assemble(mesh, spec).acting.heated
    assert np.abs(u - ALPHA * T * mesh.points).max() <= 1e-12 * ALPHA * T * 2.0
    assert np.abs(stress(mesh, STEEL, u, heat)).max() <= 1e-9 * E * ALPHA * T
    spec = body(clamp=list(mesh.groups), temperature=T)
    problem, u = assemble(mesh, spec), solve(mesh, spec)
    pressure = E * ALPHA * T / (1 - 2 * NU)
    sigma = stress(mesh, STEEL, u, problem.acting.heated)
    assert np.abs(sigma - [-pressure, -pressure, -pressure, 0.0]).max() <= 1e-9 * pressure
    error = estimate_error(mesh, STEEL, u, problem.acting.heated)
    assert error.energy == pytest.approx(3 * pressure * ALPHA * T * error.area, rel=1e-9)
    assert problem.acting.stored**2 == pytest.approx(error.energy, rel=1e-9)


@both_orders
def test_a_force_is_that_of_the_whole_circumference(order):
    """It is spread evenly over true areas."""
    mesh = cone(order, 0.5)
    f, g = (nodal_loads(mesh, body(traction=[load])) for load in (
        Traction(on="top", force=(0.0, -1e4)), Traction(on="top", value=(0.0, -1e4 / np.pi / (1.5**2 - 0.5**2)))))
    assert f.sum(axis=0) == pytest.approx([0.0, -1e4], rel=1e-12)
    assert np.abs(f - g).max() <= 1e-12 * np.abs(g).max()


def test_equal_constants_are_isotropic():
    """A turned part of an orthotropic material with equal constants has the isotropic stiffness."""
    mesh, u = cone(2, 0.0), None
    u = np.sin(3 * mesh.points) * [[1.0, 1.0]]
    u[mesh.points[:, 0] == 0.0, 0] = 0.0
    other = Material(young=(E,) * 3, poisson=(NU,) * 3, shear=E / 2 / (1 + NU), angle=20.0)
    one, two = (sum_stiffness(mesh, each).mult(u) for each in (STEEL, other))
    assert np.abs(one - two).max() <= 1e-12 * np.abs(one).max()


@both_orders
def test_a_disc_of_an_orthotropic_material(order):
    """Pressed at its rim, a disc with E₁ = E₃ and ν₁₃ strains by −(1 − ν₁₃) p / E₁ in its plane."""
    mesh = build_mesh(BodySpec(name="body", material=STEEL, mesh=MeshSpec(
        shape="rectangle", size=(2.0, 0.5), divisions=(4, 2), order=order)))
    mesh = replace(mesh, axisymmetric=True)
    laminate = Material(young=(1.4e11, 1.0e10, 1.4e11), poisson=(0.3, 0.2, 0.3 * 1.0e10 / 1.4e11), shear=5e9)
    spec = body(material=laminate, clamp=[Clamp(on="bottom", y=0.0)], traction=[Traction(on="right", pressure=1e6)])
    u = solve(mesh, spec)
    exact = np.column_stack([-0.8e6 / 1.4e11 * mesh.points[:, 0], 2 * 0.3e6 / 1.4e11 * mesh.points[:, 1]])
    assert np.abs(u - exact).max() <= 1e-9 * np.abs(exact).max()


@both_orders
def test_a_cone_slides_on_its_flank(order):
    """A clamp along the normal of a slanting flank leaves nothing loose, and on the axis none but x = 0 is needed."""
    mesh = cone(order, 0.0)
    spec = body(clamp=[Clamp(on="right", normal=0.0)], traction=[Traction(on="top", force=(0.0, -1e6))])
    problem, u = assemble(mesh, spec), solve(mesh, spec)
    assert problem.held
    flank = np.unique(mesh.groups["right"])
    normal = np.array([1.0, 0.5]) / 1.25**0.5
    assert np.abs(u[flank] @ normal).max() <= 1e-14 * np.abs(u).max() < np.abs(u[flank]).max()
    held = supports(mesh, body(clamp=[Clamp(on="bottom", normal=1e-3)]))
    centre = np.flatnonzero((mesh.points == 0.0).all(axis=1))
    assert not held.free[centre].any() and held.moved[None][centre] == pytest.approx(np.array([[0.0, -1e-3]]))
