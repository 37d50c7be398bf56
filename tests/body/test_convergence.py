"""Fitted rates for both orders: one body against a cubic field, contact pressure against a closed form and a fine mesh.

All loads are affine, as the scene language has them.
"""

import numpy as np
import pytest
import scenes
from by_skfem import basis_of
from scenes import BRASS, STEEL
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve
from skfem import Functional, asm

from ddmpi.body.elasticity import assemble
from ddmpi.mesh.build import build_mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction
from ddmpi.scene.values import AffineScalar, AffineVector

pytestmark = pytest.mark.slow


def rate(sizes, errors) -> float:
    """The exponent p of errors ~ h^p, fitted; h is one over `sizes`."""
    return -np.polyfit(np.log(sizes), np.log(errors), 1)[0]


# One body: u = (a y³ + c x y², −3a x y² + b y³) with c chosen so that σ_xx has no y², and all loads are affine

MATERIAL = Material(young=3.0, poisson=0.3)
FIRST, SHEAR = MATERIAL.lame
CONFINED = FIRST + 2 * SHEAR
A, B = 1.0, 0.7
C = -3 * FIRST * B / CONFINED
LEFT, BOTTOM, SIZE = 0.2, 0.3, 1.0


def exact(x, y):
    return np.array([A * y**3 + C * x * y**2, -3 * A * x * y**2 + B * y**3])


def exact_gradient(x, y):
    return np.array([[C * y**2, 3 * A * y**2 + 2 * C * x * y], [-3 * A * y**2, -6 * A * x * y + 3 * B * y**2]])


def cubic_body(n: int, order: int) -> BodySpec:
    """Clamped at the bottom; σ_xx = −6λa xy, σ_xy = 2μc xy, σ_yy = −6(λ+2μ)a xy + (λc + 3(λ+2μ)b) y²."""
    square = FIRST * C + 3 * CONFINED * B
    top, right = BOTTOM + SIZE, LEFT + SIZE
    sides = [Traction(on=on, value=AffineVector(y_slope=(-6 * FIRST * A * x * sign, 2 * SHEAR * C * x * sign)))
             for on, x, sign in (("left", LEFT, -1), ("right", right, 1))]
    ceiling = Traction(on="top", value=AffineVector(constant=(0.0, square * top**2),
                                                    x_slope=(2 * SHEAR * C * top, -6 * CONFINED * A * top)))
    floor = Clamp(on="bottom", x=AffineScalar(constant=A * BOTTOM**3, x_slope=C * BOTTOM**2),
                  y=AffineScalar(constant=B * BOTTOM**3, x_slope=-3 * A * BOTTOM**2))
    force = AffineVector(x_slope=(-2 * SHEAR * C, 6 * CONFINED * A),
                         y_slope=(6 * FIRST * A, -2 * SHEAR * C - 2 * square))
    mesh = MeshSpec(shape="rectangle", origin=(LEFT, BOTTOM), size=(SIZE, SIZE), divisions=(n, n), order=order)
    return BodySpec(name="block", mesh=mesh, material=MATERIAL, clamp=[floor], traction=[*sides, ceiling],
                    volume_force=force)


def errors(n: int, order: int) -> tuple[float, float]:
    """Errors in L2 and in the energy norm, each relative to the field's own norm."""
    spec = cubic_body(n, order)
    mesh = build_mesh(spec)
    problem = assemble(mesh, spec)
    indptr, indices, data = problem.A.getValuesCSR()
    reduced = problem.b.duplicate()
    reduced.array[:] = spsolve(csr_matrix((data, indices, indptr), problem.A.size).tocsc(), problem.b.array_r)
    basis, numbers = basis_of(mesh, intorder=6)
    field = basis.interpolate(problem.expand(reduced).ravel()[numbers])

    def norms(difference, gradient):
        @Functional
        def squared(w):
            return (difference(w) ** 2).sum(axis=0)

        @Functional
        def squared_energy(w):
            e = gradient(w)
            e = (e + e.swapaxes(0, 1)) / 2
            return FIRST * (e[0, 0] + e[1, 1]) ** 2 + 2 * SHEAR * (e**2).sum(axis=(0, 1))

        return np.sqrt([asm(squared, basis, u=field), asm(squared_energy, basis, u=field)])

    error = norms(lambda w: w["u"] - exact(*w.x), lambda w: w["u"].grad - exact_gradient(*w.x))
    return tuple(error / norms(lambda w: exact(*w.x), lambda w: exact_gradient(*w.x)))


@pytest.mark.parametrize(("order", "largest"), [(1, (3e-3, 4e-2)), (2, (2e-6, 2e-4))])
def test_displacement_of_one_body(order, largest):
    sizes = [8, 16, 32]
    l2, energy = np.transpose([errors(n, order) for n in sizes])
    assert rate(sizes, l2) == pytest.approx(order + 1, abs=0.15)
    assert rate(sizes, energy) == pytest.approx(order, abs=0.1)
    assert l2[-1] < largest[0] and energy[-1] < largest[1]


# Contact pressure


def block(name: str, n: int, order: int, left: float, y: float, material: dict, **rest) -> dict:
    return {"name": name, "material": material, **rest,
            "mesh": {"shape": "rectangle", "origin": [left, y], "size": [1.0, 1.0], "divisions": [n, n],
                     "order": order}}


def stack(bodies: list[dict]) -> dict:
    return {"body": bodies, "method": {"tolerance": 1e-10},
            "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": {"law": "none"}}]}


def wedged(n: int, order: int) -> tuple[dict, float]:
    """Steel on brass under u = a (d³, −3x d²) with d = y − s: no shear stress, and a pressure that grows with x.

    σ_yy = −6(λ+2μ)a x d. At y = 1, where the blocks meet, a d² and (λ+2μ)a d are the same in both. Also gives the
    pressure over x (Pa/m).
    """
    lame = {name: Material(**material).lame for name, material in (("upper", STEEL), ("lower", BRASS))}
    confined = {name: first + 2 * shear for name, (first, shear) in lame.items()}
    depth = {"lower": 1.0, "upper": confined["upper"] / confined["lower"]}
    left, right, bodies = 0.5, 1.5, []
    for name, material, y, far in (("upper", STEEL, 1.0, 2.0), ("lower", BRASS, 0.0, 0.0)):
        first, a, s = lame[name][0], 1e-3 / depth[name] ** 2, 1.0 - depth[name]
        clamp = {"on": "top" if far else "bottom", "x": a * (far - s) ** 3, "y": {"x_slope": -3 * a * (far - s) ** 2}}
        sides = [{"on": on, "value": {"constant": [sign * 6 * first * a * x * s, 0.0],
                                      "y_slope": [-sign * 6 * first * a * x, 0.0]}}
                 for on, x, sign in (("left", left, -1), ("right", right, 1))]
        force = {"constant": [-6 * first * a * s, 0.0], "x_slope": [0.0, 6 * confined[name] * a],
                 "y_slope": [6 * first * a, 0.0]}
        bodies.append(block(name, n, order, left, y, material, clamp=[clamp], traction=sides, volume_force=force))
    return stack(bodies), 6 * confined["lower"] * 1e-3


def weighed_down(n: int, order: int) -> dict:
    """Steel whose weight grows with x on brass, between smooth walls: a curved pressure."""
    walls = [{"on": "left", "x": 0.0}, {"on": "right", "x": 0.0}]
    return stack([block("upper", n, order, 0.0, 1.0, STEEL, clamp=[*walls, {"on": "top", "x": 0.0, "y": -1e-3}],
                        volume_force={"x_slope": [0.0, -2.0e8]}),
                  block("lower", n, order, 0.0, 0.0, BRASS, clamp=[*walls, {"on": "bottom", "x": 0.0, "y": 0.0}])])


SIZES = {1: (8, 16, 32), 2: (4, 8, 16)}
"""Squares per side: the same contact nodes for both orders."""

FINE = 64
CASES = ([("wedged", n, order) for order in SIZES for n in SIZES[order]]
         + [("weighed down", n, order) for order in SIZES for n in SIZES[order]] + [("weighed down", FINE, 2)])


@pytest.fixture(scope="module")
def solutions(tmp_path_factory) -> dict[tuple, dict]:
    cases = {str(case): wedged(*case[1:])[0] if case[0] == "wedged" else weighed_down(*case[1:]) for case in CASES}
    solved = scenes.solve_all(cases, tmp_path_factory.mktemp("convergence"))
    return {case: solved[str(case)] for case in CASES}


def pressure_error(solution: dict, reference: np.ndarray) -> float:
    """L2 norm of the pressure's error over that of the pressure, by the nodal lengths."""
    assert "error" not in solution, solution["error"]
    assert solution["certified"]
    assert set(solution["status"]) == {"slip"}  # closed everywhere
    length = solution["length"]
    error = solution["normal_force"] / length - reference
    return float(np.sqrt(length @ error**2 / (length @ reference**2)))


@pytest.mark.parametrize(("order", "lowest", "highest", "largest"), [(1, 1.2, 1.6, 2e-3), (2, 1.9, 2.1, 2e-4)])
def test_pressure_of_a_closed_form(solutions, order, lowest, highest, largest):
    found = []
    for n in SIZES[order]:
        solution = solutions["wedged", n, order]
        found.append(pressure_error(solution, wedged(n, order)[1] * solution["xy"][:, 0]))
    assert lowest < rate(SIZES[order], found) < highest
    assert found[-1] < largest


@pytest.mark.parametrize(("order", "lowest", "highest", "largest"), [(1, 1.0, 1.4, 3e-3), (2, 1.6, 2.0, 6e-4)])
def test_curved_pressure_against_a_fine_mesh(solutions, order, lowest, highest, largest):
    fine = solutions["weighed down", FINE, 2]
    assert "error" not in fine, fine["error"]
    found = []
    for n in SIZES[order]:
        solution = solutions["weighed down", n, order]
        x = solution["xy"][:, 0]
        same = np.searchsorted(fine["xy"][:, 0], x - 1e-9)
        assert np.array_equal(fine["xy"][same, 0], x)
        found.append(pressure_error(solution, (fine["normal_force"] / fine["length"])[same]))
    assert lowest < rate(SIZES[order], found) < highest
    assert found[-1] < largest
