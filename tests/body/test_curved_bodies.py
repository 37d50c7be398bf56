"""A body of curved quadratic triangles: constant stresses are exact, thick rings converge as the elements do."""

import numpy as np
import pytest
from petsc4py import PETSc

from ddmpi.body.elasticity import assemble
from ddmpi.body.estimate import estimate_error
from ddmpi.body.loads import nodal_loads
from ddmpi.body.rigid_motions import body_motions
from ddmpi.body.stiffness import Stiffness, sum_stiffness
from ddmpi.body.stress import Composite, stress, stress_at
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import RULES
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import bend, halve
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction
from ddmpi.scene.values import AffineScalar, AffineVector

POINTS, WEIGHTS = RULES[2]
STEEL = Material(young=2.1e11, poisson=0.3)
INNER, OUTER = 0.5, 1.0
LINEAR = np.array([[1e-3, 2e-4], [-3e-4, 5e-4]])


def annulus(divisions, angles=(0.0, 90.0), order=2) -> Mesh:
    return build_mesh(spec(mesh=MeshSpec(shape="annulus", center=(0.0, 0.0), radii=(INNER, OUTER), angles=angles,
                                         divisions=divisions, order=order)))


def spec(**keys) -> BodySpec:
    return BodySpec(**({"name": "ring", "mesh": MeshSpec(file="unused.msh"), "material": STEEL} | keys))


def wavy(straight: bool = False) -> Mesh:
    """A square of which some sides, at the boundary and inside, are bent in all directions."""
    mesh = build_mesh(spec(mesh=MeshSpec(shape="rectangle", size=(1.0, 1.0), divisions=(4, 4), order=2)))
    if straight:
        return mesh
    at, number = mesh.points[mesh.triangles[:, 3:]], len(mesh.triangles)
    bends = 0.02 * np.sin([[11.0, 7.0], [5.0, 13.0]] @ at[..., None] + [[0.3], [1.1]])[..., 0]
    bends[np.arange(number) % 3 == 0] = 0.0  # whose other triangles bend them, or none
    return bend(mesh, np.where((at[..., :1] > 0.4), bends, 0.0))


def dense(K: Stiffness) -> np.ndarray:
    full = np.zeros((len(K.diagonal), 2, len(K.diagonal), 2))
    full[np.arange(len(K.diagonal)), :, np.arange(len(K.diagonal))] = K.diagonal
    full[K.first, :, K.second] = K.upper
    full[K.second, :, K.first] = K.upper.transpose(0, 2, 1)
    return full.reshape(2 * len(K.diagonal), -1)


def test_quadrature_agrees_with_the_tables():
    """On straight triangles the path of curved ones gives the same stiffness, loads, stresses and estimates."""
    mesh, other = wavy(straight=True), wavy(straight=True)
    other.__dict__["curved"] = np.arange(1, len(mesh.triangles), 2)
    u = np.sin(3.0 * mesh.points @ [[1.0, 2.0], [-2.0, 1.0]])
    body = spec(volume_force=(3.0, -5.0))
    for of in (lambda m: dense(sum_stiffness(m, STEEL)), lambda m: nodal_loads(m, body), lambda m: m.measures(),
               lambda m: stress(m, STEEL, u), lambda m: stress_at(m, STEEL, u, POINTS),
               lambda m: estimate_error(m, STEEL, u).squares, lambda m: estimate_error(m, STEEL, u).energy,
               lambda m: body_motions(m, sum_stiffness(m, STEEL), np.tile(np.eye(2), (len(m.points), 1, 1)), "ring")):
        expected = of(mesh)
        assert of(other) == pytest.approx(expected, rel=1e-11, abs=1e-11 * np.abs(expected).max())


def test_linear_displacement_is_exact():
    """A linear displacement, prescribed on the boundary, is solved for inside, and its stress is constant."""
    for mesh in (wavy(), annulus((6, 3)), halve(annulus((3, 2)), "mesh")):
        assert len(mesh.curved) > 0
        exact = mesh.points @ LINEAR.T + [1e-3, -2e-3]
        x, y = (AffineScalar(constant=c, x_slope=row[0], y_slope=row[1])
                for c, row in zip((1e-3, -2e-3), LINEAR, strict=True))
        found = solve(mesh, clamp=[Clamp(on=name, x=x, y=y) for name in mesh.groups])
        assert found == pytest.approx(exact, abs=1e-12 * np.abs(exact).max())
        sigma = stress(mesh, STEEL, found)
        assert sigma == pytest.approx(np.tile(sigma.mean(axis=0), (len(sigma), 1)), abs=1e-10 * np.abs(sigma).max())
        at, (xx, yy, _, xy) = stress_at(mesh, STEEL, found, POINTS), sigma.mean(axis=0)
        assert at == pytest.approx(np.broadcast_to(np.array([[xx, xy], [xy, yy]])[..., None, None], at.shape),
                                   abs=1e-10 * np.abs(sigma).max())
        error = estimate_error(mesh, STEEL, found)
        assert error.total <= 1e-18 * error.energy
        strain = (LINEAR + LINEAR.T) / 2
        lame, shear = STEEL.lame
        density = lame * np.trace(strain)**2 + 2 * shear * (strain**2).sum()
        assert error.energy == pytest.approx(density * mesh.measures().sum(), rel=1e-12)


def solve(mesh: Mesh, **keys) -> np.ndarray:
    """The displacement (nv, 2) of a body."""
    problem = assemble(mesh, spec(**keys))
    solver = PETSc.KSP().create(PETSc.COMM_SELF)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.setOperators(problem.A)
    u = problem.A.createVecRight()
    solver.solve(problem.b, u)
    return problem.expand(u)


PRESSURE = 1e8
E, NU = STEEL.young / (1 - STEEL.poisson**2), STEEL.poisson / (1 - STEEL.poisson)


def lame(points: np.ndarray) -> np.ndarray:
    """Displacement (…, 2) of a thick ring under an inner pressure, in plane strain."""
    A = PRESSURE * INNER**2 / (OUTER**2 - INNER**2)
    r2 = (points**2).sum(axis=-1, keepdims=True)
    return points * ((1 - NU) * A + (1 + NU) * A * OUTER**2 / r2) / E


def test_thick_ring_converges():
    """Lamé's ring: displacement converges with the third power of h in L2, the energy with the fourth."""
    load = AffineVector(constant=(0.0, 0.0), x_slope=(PRESSURE / INNER, 0.0), y_slope=(0.0, PRESSURE / INNER))
    errors, ratios = [], []
    for n in (4, 8, 16):
        mesh = annulus((n, n // 2))
        u = solve(mesh, clamp=[Clamp(on="start", y=0.0), Clamp(on="end", x=0.0)],
                  traction=[Traction(on="inner", value=load)])
        mapped = mesh.map(np.arange(len(mesh.triangles)), POINTS)
        parts = WEIGHTS[:, None] * mapped.measures
        found = np.einsum("qk,tkd->qtd", mesh.cell.shapes(POINTS), u[mesh.triangles])
        exact = lame(mapped.places)
        squares = [(parts[..., None] * each**2).sum() for each in (found - exact, exact)]
        estimate = estimate_error(mesh, STEEL, u)
        energy = PRESSURE * INNER * np.pi / 2 * lame(np.array([INNER, 0.0]))[0]
        errors.append((np.sqrt(squares[0] / squares[1]), abs(estimate.energy / energy - 1)))
        ratios.append(np.sqrt(estimate.total / energy / errors[-1][1]))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (rates >= [3.0, 3.5]).all()
    assert errors[-1][0] < 4e-5 and errors[-1][1] < 6e-6
    assert ratios[-1] == pytest.approx(1.0, abs=0.15)


def test_parts_of_a_curved_body_have_their_own_materials():
    """Its stiffness is the sum of those of its parts, and so is its energy."""
    mesh = wavy()
    soft, number = Material(young=1e10, poisson=0.2), (np.arange(len(mesh.triangles)) % 5 == 0).astype(int)
    whole = dense(sum_stiffness(mesh, Composite([STEEL, soft], number)))
    parts = sum(dense(sum_stiffness(Mesh(mesh.points, mesh.triangles[number == k], {}), each))
                for k, each in enumerate((STEEL, soft)))
    assert np.abs(whole - parts).max() <= 1e-14 * np.abs(whole).max()
    u = np.sin(3.0 * mesh.points)
    estimate = estimate_error(mesh, Composite([STEEL, soft], number), u)
    assert estimate.energy == pytest.approx(u.ravel() @ whole @ u.ravel(), rel=1e-3)
