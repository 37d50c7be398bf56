"""A body of curved quadratic triangles: constant stresses are exact, thick rings converge as the elements do."""

import numpy as np
import pytest
from by_skfem import solve

from ddmpi.body.estimate import estimate_error
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import Composite, stress
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import bend, halve
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec
from ddmpi.scene.values import AffineScalar
from meshes import stress_at

POINTS, _ = CELLS[2, 2].quadrature
STEEL = Material(young=2.1e11, poisson=0.3)
INNER, OUTER = 0.5, 1.0
LINEAR = np.array([[1e-3, 2e-4], [-3e-4, 5e-4]])


def annulus(divisions, angles=(0.0, 90.0), order=2) -> Mesh:
    return build_mesh(
        spec(
            mesh=MeshSpec(
                shape="annulus",
                center=(0.0, 0.0),
                radii=(INNER, OUTER),
                angles=angles,
                divisions=divisions,
                order=order,
            )
        )
    )


def spec(**keys) -> BodySpec:
    return BodySpec(
        **({"name": "ring", "mesh": MeshSpec(file="unused.msh"), "material": STEEL} | keys)
    )


def wavy() -> Mesh:
    """A square of which some sides, at the boundary and inside, are bent in all directions."""
    mesh = build_mesh(
        spec(mesh=MeshSpec(shape="rectangle", size=(1.0, 1.0), divisions=(4, 4), order=2))
    )
    at, number = mesh.points[mesh.triangles[:, 3:]], len(mesh.triangles)
    bends = 0.02 * np.sin([[11.0, 7.0], [5.0, 13.0]] @ at[..., None] + [[0.3], [1.1]])[..., 0]
    bends[np.arange(number) % 3 == 0] = 0.0  # whose other triangles bend them, or none
    return bend(mesh, np.where((at[..., :1] > 0.4), bends, 0.0))


def dense(mesh: Mesh, material: Material | Composite) -> np.ndarray:
    number = len(mesh.points)
    return (
        sum_stiffness(mesh, material)
        .to_csr(np.tile(np.eye(2), (number, 1, 1)), np.arange(number))
        .toarray()
    )


def test_linear_displacement_is_exact():
    """A linear displacement, prescribed on the boundary, is solved for inside, and its stress is constant."""
    for mesh in (wavy(), annulus((6, 3)), halve(annulus((3, 2)), "mesh")):
        assert len(mesh.curved) > 0
        exact = mesh.points @ LINEAR.T + [1e-3, -2e-3]
        x, y = (
            AffineScalar(constant=c, x_slope=row[0], y_slope=row[1])
            for c, row in zip((1e-3, -2e-3), LINEAR, strict=True)
        )
        found = solve(mesh, spec(clamp=[Clamp(on=name, x=x, y=y) for name in mesh.groups]))
        assert found == pytest.approx(exact, abs=1e-12 * np.abs(exact).max())
        sigma = stress(mesh, STEEL, found)
        assert sigma == pytest.approx(
            np.tile(sigma.mean(axis=0), (len(sigma), 1)), abs=1e-10 * np.abs(sigma).max()
        )
        at, (xx, yy, _, xy) = stress_at(mesh, STEEL, found, POINTS), sigma.mean(axis=0)
        assert at == pytest.approx(
            np.broadcast_to(np.array([[xx, xy], [xy, yy]])[..., None, None], at.shape),
            abs=1e-10 * np.abs(sigma).max(),
        )
        error = estimate_error(mesh, STEEL, found)
        assert error.total <= 1e-18 * error.energy
        strain = (LINEAR + LINEAR.T) / 2
        lame, shear = STEEL.lame
        density = lame * np.trace(strain) ** 2 + 2 * shear * (strain**2).sum()
        assert error.energy == pytest.approx(density * mesh.measures().sum(), rel=1e-12)


def test_parts_of_a_curved_body_have_their_own_materials():
    """Its stiffness is the sum of those of its parts, and so is its energy."""
    mesh = wavy()
    soft, number = (
        Material(young=1e10, poisson=0.2),
        (np.arange(len(mesh.triangles)) % 5 == 0).astype(int),
    )
    whole = dense(mesh, Composite([STEEL, soft], number))
    parts = sum(
        dense(Mesh(mesh.points, mesh.triangles[number == k], {}), each)
        for k, each in enumerate((STEEL, soft))
    )
    assert np.abs(whole - parts).max() <= 1e-14 * np.abs(whole).max()
    u = np.sin(3.0 * mesh.points)
    estimate = estimate_error(mesh, Composite([STEEL, soft], number), u)
    assert estimate.energy == pytest.approx(u.ravel() @ whole @ u.ravel(), rel=1e-3)
