"""Bodies of tetrahedra: scikit-fem, exact fields, rates, and the estimate."""

import numpy as np
import pytest
from by_skfem import load_of, stiffness_of, to_scipy
from petsc4py import PETSc
from scenes import seldom
from scipy.sparse import csr_matrix, identity, kron
from skfem import LinearForm
from skfem.helpers import dot
from solids import SIDES, STEEL, body, box, hold, shell, solve, wavy

from ddmpi.body.compliance import Compliance
from ddmpi.body.elasticity import assemble
from ddmpi.body.estimate import estimate_error
from ddmpi.body.loads import nodal_loads
from ddmpi.body.rigid_motions import add_springs, body_motions, support
from ddmpi.body.solver import StiffnessSolver
from ddmpi.body.stiffness import Stiffness, sum_stiffness
from ddmpi.body.stress import components, stress, von_mises
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Material, Traction
from meshes import energy_density, stress_at

both_orders = pytest.mark.parametrize("order", [1, 2])
SOFT = Material(young=1.0e9, poisson=0.45)


def matrix(mesh: Mesh, K: Stiffness) -> csr_matrix:
    return K.to_csr(np.tile(np.eye(3), (len(mesh.points), 1, 1)), np.arange(len(mesh.points)))


# Stiffness and loads


@both_orders
@pytest.mark.parametrize("material", [STEEL, SOFT], ids=["steel", "soft"])
def test_stiffness_is_that_of_skfem(order, material):
    """On a jittered mesh, with nodes numbered at random."""
    mesh = box((3, 2, 2), (3.0, 1.0, 2.0), order, jitter=0.2)
    corners = mesh.corners.max() + 1
    rng = np.random.default_rng(4)
    number = np.concatenate(
        [rng.permutation(corners), corners + rng.permutation(len(mesh.points) - corners)]
    )
    mesh = Mesh(mesh.points[np.argsort(number)], number[mesh.triangles], {})
    expected, K = stiffness_of(mesh, material), sum_stiffness(mesh, material)
    assert abs(matrix(mesh, K) - expected).max() <= 1e-14 * abs(expected).max()
    u = rng.standard_normal(mesh.points.shape)
    assert np.abs(K.mult(u).ravel() - expected @ u.ravel()).max() <= 1e-13 * abs(expected).max()


FORCE = ("3 + 2*x - z", "y*z - x**2", "1 + x*y")


def force(x, y, z):
    return np.stack([3 + 2 * x - z, y * z - x**2, 1 + x * y])


@both_orders
def test_loads_are_those_of_skfem(order):
    """Volume forces, tractions and pressures, as formulas and as numbers."""
    mesh = box((2, 3, 2), (3.0, 1.0, 2.0), order, jitter=0.2)
    right, top = mesh.groups["right"], mesh.groups["top"]
    cases = [
        ({"volume_force": FORCE}, load_of(mesh, LinearForm(lambda v, w: dot(force(*w.x), v)), 8)),
        (
            {"volume_force": (2.0, -3.0, 5.0)},
            load_of(mesh, LinearForm(lambda v, w: 2 * v[0] - 3 * v[1] + 5 * v[2])),
        ),
        (
            {"traction": [Traction(on="right", value=FORCE)]},
            load_of(mesh, LinearForm(lambda v, w: dot(force(*w.x), v)), 8, right),
        ),
        (
            {
                "traction": [
                    Traction(on="top", value=(2.0, -3.0, 5.0)),
                    Traction(on="right", pressure=7.0),
                ]
            },
            load_of(mesh, LinearForm(lambda v, w: 2 * v[0] - 3 * v[1] + 5 * v[2]), 4, top)
            - load_of(mesh, LinearForm(lambda v, w: 7 * dot(w.n, v)), 4, right),
        ),
        (
            {"traction": [Traction(on="top", pressure="x*y + z")]},
            load_of(
                mesh, LinearForm(lambda v, w: -(w.x[0] * w.x[1] + w.x[2]) * dot(w.n, v)), 8, top
            ),
        ),
    ]
    for loads, expected in cases:
        assert (
            np.abs(nodal_loads(mesh, body(**loads)).ravel() - expected).max()
            <= 1e-13 * np.abs(expected).max()
        )


def test_pressure_all_around_a_curved_body_is_its_buoyancy():
    """∮ p n dA is the integral of ∇p over the curved tetrahedra, exactly; the moment of a constant one is zero."""
    mesh = wavy()
    f = nodal_loads(
        mesh, body(traction=[Traction(on=on, pressure="2 + x - 3*y + 5*z") for on in SIDES])
    )
    assert f.sum(axis=0) == pytest.approx(
        mesh.measures().sum() * np.array([-1.0, 3.0, -5.0]), rel=1e-12
    )
    f = nodal_loads(mesh, body(traction=[Traction(on=on, pressure=2.0) for on in SIDES]))
    assert np.abs(np.cross(mesh.points, f).sum(axis=0)).max() <= 1e-13
    weight = nodal_loads(mesh, body(volume_force=(1.0, 2.0, 3.0)))
    assert weight.sum(axis=0) == pytest.approx(
        mesh.measures().sum() * np.array([1.0, 2.0, 3.0]), rel=1e-13
    )


# Rigid motions


@pytest.mark.parametrize(
    ("order", "iterative"), [(1, True), (2, False)], ids=["multigrid", "factors"]
)
def test_a_loose_body_under_pressure(order, iterative):
    """Held by its six springs alone, a cube under the same pressure all around shrinks alike in all directions."""
    mesh = box((3, 3, 3), order=order, jitter=0.2)
    problem = assemble(mesh, body(traction=[Traction(on=on, pressure=3e6) for on in SIDES]))
    A, u = add_springs(problem.A, support(problem.motions[problem.nodes])), problem.b.duplicate()
    StiffnessSolver(A, "block", iterative=iterative).solve(problem.b, u)
    at, moved = (each - each.mean(axis=0) for each in (mesh.points, problem.expand(u)))
    strain = np.linalg.lstsq(at, moved, rcond=None)[0]
    bulk = -3e6 * (1 - 2 * 0.3) / STEEL.young
    assert np.abs((strain + strain.T) / 2 - bulk * np.eye(3)).max() <= 1e-6 * abs(bulk)


def test_centroid_is_that_of_the_volume():
    """Rotations are about the centroid of an octant of a hollow ball, whose place its spheres give."""
    mesh = shell(6)
    motions = body_motions(
        mesh, sum_stiffness(mesh, STEEL), np.tile(np.eye(3), (len(mesh.points), 1, 1)), "ball"
    )
    for rotation, (i, j) in zip(
        np.moveaxis(motions[:, :, 3:], 2, 0), ((1, 2), (0, 2), (0, 1)), strict=True
    ):
        for moved, along in ((i, j), (j, i)):  # u_i grows with x_j, and is zero at the centre
            slope, start = np.polyfit(mesh.points[:, along], rotation[:, moved], 1)
            assert -start / slope == pytest.approx(
                3 / 8 * (1.0 - 0.5**4) / (1.0 - 0.5**3), rel=1e-4
            )


GRADIENT = np.array([[1e-3, -4e-4, 2e-4], [7e-4, 5e-4, -6e-4], [3e-4, 8e-4, -9e-4]])


def linear_clamps() -> list:
    rows = [
        " + ".join(f"{value}*{axis}" for value, axis in zip(row, "xyz", strict=True))
        for row in GRADIENT.tolist()
    ]
    return [hold(side, *rows) for side in SIDES]


@pytest.mark.parametrize(
    "mesh",
    [box((3, 2, 2), jitter=0.2), box((3, 2, 2), order=2, jitter=0.2), wavy()],
    ids=["order 1", "order 2", "curved"],
)
def test_linear_displacement_is_exact(mesh):
    """Prescribed all around, it is found inside; the stress is constant and the estimated error zero."""
    exact = mesh.points @ GRADIENT.T
    u = solve(mesh, body(clamp=linear_clamps()))
    assert np.abs(u - exact).max() <= 1e-12 * np.abs(exact).max()
    (first, shear), strain = STEEL.lame, (GRADIENT + GRADIENT.T) / 2
    sigma = first * np.trace(strain) * np.eye(3) + 2 * shear * strain
    found = stress_at(mesh, STEEL, u, CELLS[3, 1].quadrature[0])
    assert np.abs(found - sigma[..., None, None]).max() <= 1e-10 * np.abs(sigma).max()
    columns = sigma[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    assert np.abs(stress(mesh, STEEL, u) - columns).max() <= 1e-10 * np.abs(sigma).max()
    deviator = sigma - np.trace(sigma) / 3 * np.eye(3)
    assert von_mises(columns[None]) == pytest.approx(np.sqrt(1.5 * (deviator**2).sum()))
    error = estimate_error(mesh, STEEL, u)
    assert error.total <= 1e-18 * error.energy
    assert error.energy == pytest.approx((sigma * strain).sum() * mesh.measures().sum(), rel=1e-12)


# Rates: u = a sin(k · x + 1), whose volume force is ((λ + μ) (a · k) k + μ k² a) sin(k · x + 1)

MATERIAL = Material(young=3.0, poisson=0.3)
A, K = np.array([1.0, -0.6, 0.8]), np.array([1.1, 0.7, -1.6])
PHASE = " + ".join(f"{k}*{axis}" for k, axis in zip(K.tolist(), "xyz", strict=True)) + " + 1"


def wave(points: np.ndarray) -> np.ndarray:
    return np.sin(points @ K + 1)[:, None] * A


def wave_stress(points: np.ndarray) -> np.ndarray:
    """(3, 3, …) at points (…, 3)."""
    (first, shear), both = MATERIAL.lame, np.outer(A, K)
    return (first * np.trace(both) * np.eye(3) + shear * (both + both.T))[
        (...,) + (None,) * (points.ndim - 1)
    ] * np.cos(points @ K + 1)


def waving(n: int, order: int, jitter: float = 0.15) -> tuple[Mesh, np.ndarray]:
    """A cube that is held at its left and loaded elsewhere, with its displacement."""
    first, shear = MATERIAL.lame
    mesh = box((n, n, n), order=order, jitter=jitter)
    unit = wave_stress(np.zeros((1, 3)))[..., 0] / np.cos(1.0)
    tractions = []
    for k, side in enumerate(SIDES[1:], start=1):
        normal = (2 * (k % 2) - 1) * np.eye(3)[k // 2]
        tractions.append(
            Traction(on=side, value=tuple(f"{t}*cos({PHASE})" for t in (unit @ normal).tolist()))
        )
    weight = (first + shear) * (A @ K) * K + shear * (K @ K) * A
    spec = body(
        MATERIAL,
        clamp=[hold("left", *(f"{a}*sin({PHASE})" for a in A.tolist()))],
        traction=tractions,
        volume_force=tuple(f"{w}*sin({PHASE})" for w in weight.tolist()),
    )
    return mesh, solve(mesh, spec)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "sizes", "largest"), [seldom(1, (4, 8, 12), 0.1), (2, (2, 4, 6), 0.02)]
)
def test_rates(order, sizes, largest):
    """The error falls with h^(p+1) in L2 and h^p in energy; the estimate is that error, but for a fifth."""
    errors, points, weights = [], *CELLS[3, 1].quadrature
    for n in sizes:
        mesh, u = waving(n, order)
        places = np.einsum("qi,tid->qtd", points, mesh.points[mesh.corners])
        found = np.einsum("qk,tkd->qtd", mesh.cell.shapes(points), u[mesh.triangles])
        exact = wave(places.reshape(-1, 3)).reshape(places.shape)
        off = components(stress_at(mesh, MATERIAL, u, points) - wave_stress(places))
        energy = [
            weights @ energy_density(MATERIAL, each) @ mesh.measures()
            for each in (off, components(wave_stress(places)))
        ]
        l2 = [weights @ (each**2).sum(axis=2) @ mesh.measures() for each in (found - exact, exact)]
        errors.append(np.sqrt([l2[0] / l2[1], energy[0] / energy[1]]))
        estimate = estimate_error(mesh, MATERIAL, u)
        assert estimate.energy == pytest.approx(
            float((u * sum_stiffness(mesh, MATERIAL).mult(u)).sum()), rel=1e-11
        )
        effectivity = np.sqrt(estimate.total / energy[0])
    rates = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert rates == pytest.approx([order + 1, order], abs=0.25), rates
    assert errors[-1][1] < largest and effectivity == pytest.approx(1.0, abs=0.2), (
        errors,
        effectivity,
    )


def contact(order: int, held: bool) -> tuple[PETSc.Mat, csr_matrix, np.ndarray]:
    """A of a box, on its bottom a row for each component of each vertex, and the nodes of A; a loose one on springs."""
    mesh = box((3, 2, 2), (3.0, 1.0, 1.0), order, jitter=0.2)
    problem = assemble(mesh, body(clamp=[hold("left", 0.0, 0.0, 0.0)] if held else []))
    A = problem.A if held else add_springs(problem.A, support(problem.motions[problem.nodes]))
    facets = np.searchsorted(
        problem.nodes, mesh.groups["bottom"][np.isin(mesh.groups["bottom"], problem.nodes).all(1)]
    )
    rows, number = np.unique(facets[:, :3], return_inverse=True)
    ends = (
        np.repeat(number.reshape(-1, 3), facets.shape[1], axis=1).ravel(),
        np.tile(facets, 3).ravel(),
    )
    B = csr_matrix((np.arange(1.0, 1 + len(ends[0])), ends), (len(rows), len(problem.nodes)))
    return A, kron(B, identity(3), "csr"), mesh.points[problem.nodes]


@pytest.mark.parametrize(
    ("order", "held", "route"),
    [
        (1, True, "own order"),
        (2, False, "own order"),
        (2, True, "MUMPS's order"),
        (2, True, "through PETSc"),
    ],
)
def test_compliance_is_the_dense_one(order, held, route, petsc_options, monkeypatch):
    """With its order of elimination, without, and where PETSc calls MUMPS."""
    monkeypatch.setattr("ddmpi.petsc.dissection.FEWEST", 0 if route == "own order" else 10**9)
    if route == "through PETSc":
        petsc_options(body_mat_mumps_icntl_10=0)
    A, B, points = contact(order, held)
    found = Compliance(A, B, "block", "explicit", points=points)
    expected = B @ np.linalg.solve(to_scipy(A).toarray(), B.T.toarray())
    assert np.abs(found.dense() - expected).max() <= 1e-11 * np.abs(expected).max()
    f, u = A.createVecs()
    f.array[:] = np.random.default_rng(2).standard_normal(f.size)
    found.solve(f, u, "load")
    expected = np.linalg.solve(to_scipy(A).toarray(), f.array_r)
    assert np.abs(u.array_r - expected).max() <= 1e-11 * np.abs(expected).max()
