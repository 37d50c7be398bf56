"""Orthotropic materials: strips at an angle, boxes, the same by isotropic constants, moduli along a normal."""

import msgspec
import numpy as np
import pytest
from by_skfem import solve

from ddmpi.body.elasticity import assemble
from ddmpi.body.estimate import estimate_error
from ddmpi.body.stress import (
    Composite,
    components,
    moduli_along,
    modulus_beside,
    stress,
    thermal,
)
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction
from meshes import energy_density

E, NU, G, ALPHA = (1.4e11, 1.0e10, 2.0e10), (0.3, 0.25, 0.4), (5.0e9, 7.0e9, 3.0e9), 1.2e-5
"""A carbon laminate, more or less; all three axes differ."""

both_orders = pytest.mark.parametrize("order", [1, 2])


def laminate(plane: str | None, angle: float | None = None, **more) -> Material:
    return Material(
        young=E, poisson=NU, shear=G[0] if plane else G, plane=plane, angle=angle, **more
    )


def strip(d: int, order: int, **more) -> tuple[Mesh, BodySpec]:
    """A skewed strip with supports that hold it at three points, in space a skewed box."""
    quad = ((0.0, 0.0), (3.0, 0.5), (2.5, 2.0), (0.0, 1.0))
    corners = quad if d == 2 else tuple((*at, z) for z in (0.0, 1.0) for at in quad)
    spec = BodySpec(
        name="strip",
        material=Material(young=1.0, poisson=0.0),
        mesh=MeshSpec(
            shape="quadrilateral" if d == 2 else "hexahedron",
            corners=corners,
            divisions=(4, 3, 2)[:d],
            order=order,
        ),
    )
    mesh = build_mesh(spec)
    places = {"a": (0.0, 0.0, 0.0), "b": (3.0, 0.5, 0.0), "c": (0.0, 0.0, 1.0)}
    vertices = {
        name: np.flatnonzero(np.linalg.norm(mesh.points - at[:d], axis=1) < 1e-9)
        for name, at in places.items()
    }
    clamps = [
        Clamp(on="a", x=0.0, y=0.0, z=0.0),
        Clamp(on="b", y=0.0),
        Clamp(on="c", x=0.0, y=0.0),
    ][:d]
    return Mesh(mesh.points, mesh.triangles, mesh.groups, vertices), msgspec.structs.replace(
        spec, clamp=clamps, **more
    )


def pulled(mesh: Mesh, sigma: np.ndarray) -> list[Traction]:
    """Tractions of a constant stress (d, d) on all sides, as their nodes are on planes."""
    found = []
    for on, facets in mesh.groups.items():
        x = mesh.points[facets[:, : mesh.dimension]]
        along = (x[:, 1:] - x[:, :1])[0]
        normal = np.array([along[0, 1], -along[0, 0]]) if mesh.dimension == 2 else np.cross(*along)
        normal /= np.linalg.norm(normal)
        normal *= np.sign(normal @ (x.mean(axis=(0, 1)) - mesh.points.mean(axis=0)))
        found.append(Traction(on=on, value=tuple((sigma @ normal).tolist())))
    return found


@both_orders
def test_a_box_is_pulled_along_each_axis(order):
    """In space ν12 is −ε2/ε1 under stress along 1, and so on; shear strains follow the three shear moduli."""
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        sigma = np.zeros((3, 3))
        sigma[i, j] = sigma[j, i] = 1e6
        mesh, spec = strip(3, order, material=laminate(None))
        spec = msgspec.structs.replace(spec, traction=pulled(mesh, sigma))
        u = solve(mesh, spec)
        gradient = np.linalg.lstsq(np.column_stack([np.ones(len(u)), mesh.points]), u, rcond=None)[
            0
        ][1:]
        strain = (gradient + gradient.T) / 2
        if k < 3:
            ratios = np.array(
                [
                    [1.0, -NU[0], -NU[1]],
                    [-NU[0] * E[1] / E[0], 1.0, -NU[2]],
                    [-NU[1] * E[2] / E[0], -NU[2] * E[2] / E[1], 1.0],
                ]
            )
            expected = np.diag(1e6 / E[k] * ratios[k])
        else:
            expected = sigma / 2 / G[k - 3]
        assert np.abs(strain - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(("d", "plane"), [(2, "strain"), (2, "stress"), (3, None)])
def test_equal_constants_are_isotropic(d, plane):
    """With the same moduli and ratios along all axes, whatever the angle, all is that of the isotropic material."""
    young, nu = 2.1e11, 0.3
    shear = young / 2 / (1 + nu)
    one = Material(young=young, poisson=nu, plane=plane, expansion=ALPHA)
    other = Material(
        young=(young,) * 3,
        poisson=(nu,) * 3,
        shear=shear if d == 2 else (shear,) * 3,
        plane=plane,
        angle=25.0 if d == 2 else None,
        expansion=ALPHA,
    )
    assert other.tensor(d) == pytest.approx(one.tensor(d), rel=1e-13, abs=1e-3)
    assert other.across == pytest.approx(one.across, abs=1e-14)
    assert other.mean_ratio == pytest.approx(nu, rel=1e-13)
    for mine, its in zip(thermal(one, d), thermal(other, d), strict=True):
        assert np.abs(mine - its).max() <= 1e-12 * young * ALPHA
    rng = np.random.default_rng(1)
    normals = rng.standard_normal((5, d))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    assert moduli_along(other, normals) == pytest.approx(moduli_along(one, normals), rel=1e-12)
    sigma = components(rng.standard_normal((d, d, 7)))
    assert energy_density(other, sigma) == pytest.approx(energy_density(one, sigma), rel=1e-12)


def test_the_modulus_at_a_contact_is_that_along_its_normal():
    """Along the fibres a laminate is stiff, across them soft; two materials count by their measures."""
    mesh, _ = strip(2, 1)
    stiff, soft = (
        modulus_beside(mesh, laminate("stress", angle), mesh.facets("left"))
        for angle in (0.0, 90.0)
    )
    assert (stiff, soft) == pytest.approx(E[:2])
    stiff = modulus_beside(mesh, laminate("strain", 0.0), mesh.facets("left"))
    assert stiff == pytest.approx(1.0 / (1.0 / E[0] - NU[1] ** 2 * E[2] / E[0] ** 2))
    number = (mesh.points[mesh.corners].mean(axis=1)[:, 1] > 0.5).astype(int)
    both = modulus_beside(
        mesh,
        Composite([laminate("stress", 0.0), laminate("stress", 90.0)], number),
        mesh.facets("left"),
    )
    assert soft < both < stiff


def test_axes_of_a_solid_turn_its_material():
    """About z as `angle` does in the plane; vectors need not be unit ones or orthogonal."""
    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    turned = laminate(None, axes=((2 * c, 2 * s, 0.0), (c - s, s + c, 0.0)))
    assert turned.tensor(3)[:2, :2, :2, :2] == pytest.approx(
        laminate("strain", 30.0).tensor(2), rel=1e-12
    )
    assert turned.rotation == pytest.approx(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    stood = laminate(None, axes=((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
    assert moduli_along(stood, np.array([[0.0, 0.0, 1.0]])) == pytest.approx(
        moduli_along(laminate(None), np.array([[1.0, 0.0, 0.0]]))
    )
    with pytest.raises(ValueError, match="axes: both are parallel or zero"):
        laminate(None, axes=((1.0, 0.0, 0.0), (-2.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match="axes: an isotropic material has no axes"):
        Material(young=1.0, poisson=0.3, axes=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))


@both_orders
@pytest.mark.parametrize(
    ("plane", "turn"),
    [
        ("stress", {"angle": 30.0}),
        ("strain", {"angle": -50.0}),
        (None, {"axes": ((1.0, 2.0, 0.5), (0.0, 1.0, 1.0))}),
    ],
)
def test_expansion_along_each_axis(plane, turn, order):
    """A free body grows by its coefficients, without stress but that across the plane, whose energy it keeps."""
    d, T, alpha = 2 if plane else 3, 80.0, (1e-6, 3e-5, 2e-5)
    material = laminate(plane, expansion=alpha, **turn)
    mesh, spec = strip(d, order, material=material, temperature=T)
    problem, u = assemble(mesh, spec), solve(mesh, spec)
    R, S = material.rotation, material.compliance
    growth = T * R @ np.diag(alpha) @ R.T
    across = -E[2] * alpha[2] * T * (plane == "strain")
    growth = (growth + S[:, :, 2, 2] * across)[:d, :d]
    moved = mesh.points - mesh.points[0]
    strain = np.linalg.lstsq(moved, u - u[0], rcond=None)[0]
    assert (strain + strain.T) / 2 == pytest.approx(growth, abs=1e-10 * np.abs(growth).max())
    sigma = stress(mesh, material, u, problem.acting.heated)
    expected = np.zeros_like(sigma)
    expected[:, 2] = across
    assert np.abs(sigma - expected).max() <= 1e-9 * max(E) * max(alpha) * T
    error = estimate_error(mesh, material, u, problem.acting.heated)
    least = 1e-14 * max(E) * (max(alpha) * T) ** 2 * error.area
    assert error.energy == pytest.approx(across**2 / E[2] * error.area, rel=1e-9, abs=least)
    with pytest.raises(
        ValueError, match="expansion: an isotropic material has no axes; write expansion = α"
    ):
        Material(young=1.0, poisson=0.3, expansion=alpha)
