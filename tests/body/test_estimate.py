"""The estimated discretization error against the true one, and what it must not see."""

import numpy as np
import pytest

from ddmpi.body.estimate import (
    ErrorEstimate,
    estimate_error,
    nodal_stress,
    relative_error,
    sum_errors,
)
from ddmpi.body.stress import Composite, components, energy_density, stress, stress_at
from ddmpi.mesh.elements import FINE
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import Material, MeshSpec

STEEL = Material(young=2e11, poisson=0.3)
ORDERS = pytest.mark.parametrize("order", [1, 2])


def rectangle(N: int, order: int, distorted: bool = False) -> Mesh:
    mesh = generate_rectangle(MeshSpec(shape="rectangle", size=(3.0, 1.0), divisions=(3 * N, N)))
    points = mesh.points.copy()
    if distorted:
        inner = (points > 1e-9).all(axis=1) & (points < np.array([3.0, 1.0]) - 1e-9).all(axis=1)
        points[inner] += np.random.default_rng(1).uniform(-0.2 / N, 0.2 / N, (inner.sum(), 2))
    mesh = Mesh(points, mesh.triangles, mesh.groups)
    return mesh if order == 1 else raise_order(mesh, "mesh")


def wave(points: np.ndarray) -> np.ndarray:
    """A smooth displacement (m)."""
    x, y = points.T
    return 1e-3 * np.column_stack([np.sin(1.3 * x + 0.5 * y), 2 * np.cos(0.7 * x - 1.1 * y)])


def wave_stress(points: np.ndarray, material: Material) -> np.ndarray:
    x, y = points.T
    first, shear = material.lame
    c, s = np.cos(1.3 * x + 0.5 * y), np.sin(0.7 * x - 1.1 * y)
    exx, eyy, gxy = 1.3e-3 * c, 2.2e-3 * s, 0.5e-3 * c - 1.4e-3 * s
    return np.stack(
        [first * (exx + eyy) + 2 * shear * exx, shear * gxy, first * (exx + eyy) + 2 * shear * eyy]
    )


def true_error(mesh: Mesh) -> tuple[float, float]:
    """Squared energy norms of the error of the interpolated wave and of itself, of steel."""
    points, weights = FINE[2]
    places = np.einsum("qa,tad->qtd", points, mesh.points[mesh.corners])
    found = components(stress_at(mesh, STEEL, wave(mesh.points), points))
    error = found - wave_stress(places.reshape(-1, 2), STEEL).reshape(found.shape)
    return tuple(
        float(weights @ energy_density(STEEL, each) @ mesh.measures()) for each in (error, found)
    )


@ORDERS
def test_what_the_elements_hold_exactly_has_no_error(order):
    mesh = rectangle(6, order, distorted=True)
    x, y = mesh.points.T
    u = (
        np.column_stack([2 * x - y + 1, x + 3 * y])
        if order == 1
        else np.column_stack([x * y - y * y, x * x + 3 * y])
    )
    estimate = estimate_error(mesh, STEEL, u)
    assert estimate.total <= 1e-20 * estimate.energy
    at_rest = estimate_error(mesh, STEEL, np.zeros_like(u))
    assert relative_error(at_rest.total, at_rest.energy) == 0.0


@ORDERS
def test_rounding_does_not_choose(order):
    """Turned with its displacement, a body has the same estimate, also where nodes are equally near to several."""
    mesh = rectangle(4, order)
    points = mesh.points @ [[1.0, 0.0], [-0.5, np.sqrt(0.75)]]  # triangles of equal sides
    squares = []
    for angle in np.linspace(0.0, 1.0, 6):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        turned = Mesh(points @ turn.T, mesh.triangles, mesh.groups)
        squares.append(estimate_error(turned, STEEL, wave(points) @ turn.T).squares)
    assert np.array(squares) == pytest.approx(
        np.tile(squares[0], (6, 1)), rel=1e-6, abs=1e-9 * squares[0].max()
    )


@pytest.mark.parametrize(
    "order, plane, known", [(1, "strain", False), (2, "strain", True), (1, "stress", True)]
)
def test_triangles_that_lock_have_no_estimate(order, plane, known):
    """The error of all bodies is unknown where the triangles of one lock; energies are still there."""
    mesh = rectangle(5, order)
    soft, hard = (
        estimate_error(mesh, material, wave(mesh.points))
        for material in (Material(young=1.0, poisson=0.4999, plane=plane), STEEL)
    )
    bodies = {
        name: (each.total, each.energy, each.area)
        for name, each in (("soft", soft), ("hard", hard))
    }
    error = sum_errors(bodies, {"hard": hard}, np.sum(list(bodies.values()), axis=0))
    assert list(error.by_body) == ["soft", "hard"]
    assert np.isfinite([error.relative, *error.by_body.values()]).tolist() == [known] * 3
    assert (error.density("hard") is not None) == known and soft.energy > 0.0


@ORDERS
def test_a_rigid_motion_has_neither_energy_nor_error(order):
    """But for rounding, which a solve with a stiffness adds to; a strain of a millionth of it counts."""
    mesh = rectangle(6, order, distorted=True)
    rigid = 0.1 + 0.01 * mesh.points @ [[0.0, 1.0], [-1.0, 0.0]]
    rounded = rigid * (1 + 1e-13 * np.random.default_rng(0).uniform(-1, 1, rigid.shape))
    estimate = estimate_error(mesh, STEEL, rounded)
    assert (estimate.energy, estimate.total) == (0.0, 0.0)
    strained = estimate_error(mesh, STEEL, rigid + 1e-7 * wave(mesh.points))
    assert strained.energy == pytest.approx(
        1e-14 * estimate_error(mesh, STEEL, wave(mesh.points)).energy, rel=1e-3
    )


@ORDERS
@pytest.mark.parametrize("divisions", [(6, 1), (48, 1), (1, 1)], ids=str)
def test_bodies_without_inner_vertices_get_a_rough_estimate(order, divisions):
    """The elements around a vertex of the boundary stand in."""
    size = (3.0, 18.0 / divisions[0] * divisions[1]) if divisions[0] > 1 else (1.0, 1.0)
    mesh = generate_rectangle(MeshSpec(shape="rectangle", size=size, divisions=divisions))
    mesh = mesh if order == 1 else raise_order(mesh, "mesh")
    estimate = estimate_error(mesh, STEEL, wave(mesh.points))
    error, energy = true_error(mesh)
    effectivity = relative_error(estimate.total, estimate.energy) / relative_error(error, energy)
    assert 0.5 <= effectivity <= 2.0


@ORDERS
def test_a_wall_of_one_element_borrows_no_far_fit(order):
    """Polynomials of the block are not extrapolated along the thin wall that it bears."""
    mesh = rectangle(4, 1)
    x, y = mesh.points[mesh.triangles].mean(axis=1).T
    mesh = Mesh(mesh.points, mesh.triangles[(x < 1.0) | (y < 0.25)], {})
    mesh = mesh if order == 1 else raise_order(mesh, "mesh")
    assert (
        0.5
        <= np.sqrt(estimate_error(mesh, STEEL, wave(mesh.points)).total / true_error(mesh)[0])
        <= 1.5
    )


def test_relative_error():
    assert relative_error(0.0, 0.0) == 0.0
    assert relative_error(1.0, 3.0) == 0.5
    assert (
        ErrorEstimate(np.array([1.0, 2.0]), np.array([0.5, 0.5]), 5.0, np.zeros((3, 4))).total
        == 3.0
    )


# The recovered stress at the nodes


@pytest.mark.parametrize("cell, order", [("plane", 1), ("plane", 2), ("space", 1)])
def test_stress_at_nodes_is_exact_where_it_can_be(cell, order):
    """A constant stress with linear elements, a linear one with quadratic elements, at all nodes; σ_zz as well."""
    mesh = (
        rectangle(4, order, distorted=True)
        if cell == "plane"
        else generate_rectangle(MeshSpec(shape="box", size=(2.0, 1.0, 1.0), divisions=(4, 3, 3)))
    )
    x, *_, y = mesh.points.T
    strain = 1e-3 * (1.0 + (order - 1) * x)
    u = np.zeros_like(mesh.points)
    u[:, 0] = 1e-3 * (x + (order - 1) * x**2 / 2)
    u[:, -1] = -2e-4 * y
    first, shear = STEEL.lame
    trace = first * (strain - 2e-4)
    along = [trace + 2 * shear * strain, trace, trace]
    along[len(u.T) - 1] = trace - 4e-4 * shear
    expected = np.stack([*along, *np.zeros((2 * len(u.T) - 3, len(u)))], axis=1)
    assert nodal_stress(mesh, STEEL, u) == pytest.approx(
        expected, abs=1e-9 * np.abs(expected).max()
    )
    assert np.array_equal(estimate_error(mesh, STEEL, u).stress, nodal_stress(mesh, STEEL, u))


@ORDERS
@pytest.mark.parametrize("count", [1, 3])
def test_stress_at_nodes_of_few_triangles_is_theirs(count, order):
    """Around no vertex are enough of them for a polynomial: nodes have the mean."""
    x = np.arange(count + 2.0)
    strip = Mesh(
        np.column_stack([x, x % 2.0]),
        np.array([[k, k + 1, k + 2] if k % 2 else [k, k + 2, k + 1] for k in range(count)]),
        {"start": np.array([[0, 1]])},
    )
    mesh = strip if order == 1 else raise_order(strip, "mesh")
    u = mesh.points @ np.array([[1e-3, 2e-4], [-3e-4, 5e-4]])
    expected = stress(mesh, STEEL, u)[0]
    assert nodal_stress(mesh, STEEL, u) == pytest.approx(np.tile(expected, (len(u), 1)), rel=1e-9)


def test_stress_at_nodes_knows_of_heat():
    """Where the strain and the temperature are constant, all nodes have the stress of the cells."""
    mesh, warm = rectangle(4, 1), Material(young=2e11, poisson=0.3, expansion=1e-5)
    u, heat = 1e-4 * mesh.points, np.full(len(mesh.points), 40.0)
    expected = stress(mesh, warm, u, heat)[0]
    assert nodal_stress(mesh, warm, u, heat) == pytest.approx(
        np.tile(expected, (len(u), 1)), rel=1e-9, abs=1.0
    )


def test_stress_at_nodes_between_materials_is_the_mean_of_theirs():
    """Beside the nodes that two materials share, each has its own stress."""
    mesh = rectangle(4, 2)
    soft = Material(young=1e11, poisson=0.2)
    number = (mesh.points[mesh.corners].mean(axis=1)[:, 0] > 1.5).astype(int)
    u = 1e-3 * np.column_stack([mesh.points[:, 0], 0.0 * mesh.points[:, 0]])
    pure = [nodal_stress(mesh, each, u)[0] for each in (STEEL, soft)]
    assert not np.allclose(*pure)
    found, x = nodal_stress(mesh, Composite([STEEL, soft], number), u), mesh.points[:, 0]
    for at, expected in (
        (x < 1.49, pure[0]),
        (x > 1.51, pure[1]),
        (np.abs(x - 1.5) < 0.01, np.mean(pure, axis=0)),
    ):
        assert found[at] == pytest.approx(
            np.broadcast_to(expected, found[at].shape), abs=1e-9 * np.abs(pure).max()
        )
