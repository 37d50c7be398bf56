"""One elastic body: its stiffness, exact linear and quadratic fields, loads, clamps."""

import numpy as np
import pytest
from by_skfem import load_of, solve, stiffness_of, to_scipy
from scipy.sparse.linalg import spsolve
from skfem import LinearForm

from ddmpi.body.elasticity import assemble
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import principal, stress, von_mises
from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction
from ddmpi.scene.values import AffineScalar, AffineVector

SIDES = ["left", "right", "bottom", "top"]
STRAIN = Material(young=3.0, poisson=0.3)
STRESS = Material(young=3.0, poisson=0.3, plane="stress")


both_orders = pytest.mark.parametrize("order", [1, 2])


def rectangle(divisions=(6, 4), size=(3.0, 2.0), origin=(1.0, -0.5), order=1) -> Mesh:
    mesh = generate_rectangle(
        MeshSpec(shape="rectangle", origin=origin, size=size, divisions=divisions)
    )
    return raise_order(mesh, "mesh") if order == 2 else mesh


def body(material=STRAIN, **rest) -> BodySpec:
    return BodySpec(name="block", mesh=MeshSpec(file="unused.msh"), material=material, **rest)


def distorted(mesh: Mesh) -> Mesh:
    """The mesh with its nodes moved by up to a third of the shortest side, and numbered at random."""
    rng = np.random.default_rng(1)
    ends = mesh.points[mesh.triangles[:, [0, 1]]]
    shortest = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min()
    points = mesh.points + shortest / 5 * rng.uniform(-1, 1, mesh.points.shape)
    number = rng.permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[number] = points
    return Mesh(
        shuffled,
        number[mesh.triangles],
        {name: number[edges] for name, edges in mesh.groups.items()},
    )


@both_orders
@pytest.mark.parametrize("material", [STRAIN, STRESS, Material(young=2e11, poisson=0.49)])
def test_stiffness_is_that_of_skfem(material, order):
    mesh = distorted(rectangle((7, 5)))
    if order == 2:
        mesh = raise_order(mesh, "mesh")
    K, whole = stiffness_of(mesh, material), sum_stiffness(mesh, material)
    A = whole.to_csr(np.tile(np.eye(2), (len(mesh.points), 1, 1)), np.arange(len(mesh.points)))
    assert np.all(np.diff(A.indices)[np.setdiff1d(np.arange(A.nnz - 1), A.indptr[1:-1] - 1)] > 0)
    assert abs(A - K).max() <= 1e-14 * abs(K).max()
    u = np.random.default_rng(2).standard_normal((len(mesh.points), 2))
    u[::3] = 0.0
    assert (
        np.abs(whole.mult(u).ravel() - K @ u.ravel()).max()
        <= 1e-14 * abs(K).max() * np.abs(u).max()
    )


# Linear fields are exact

GRADIENT = np.array([[1e-3, -4e-4], [7e-4, 5e-4]])
SHIFT = np.array([2e-3, -1e-3])


def linear(points: np.ndarray) -> np.ndarray:
    return SHIFT + points @ GRADIENT.T


def linear_clamp(group: str) -> Clamp:
    x, y = (
        AffineScalar(constant=SHIFT[i], x_slope=GRADIENT[i, 0], y_slope=GRADIENT[i, 1])
        for i in (0, 1)
    )
    return Clamp(on=group, x=x, y=y)


def linear_stress(material: Material) -> np.ndarray:
    """Hooke's law in the form ε = ((1 + ν) σ − ν tr σ) / E, inverted for the plane problem."""
    E, nu = material.young, material.poisson
    exx, eyy, exy = GRADIENT[0, 0], GRADIENT[1, 1], (GRADIENT[0, 1] + GRADIENT[1, 0]) / 2
    if material.plane == "stress":
        compliance = np.array([[1, -nu], [-nu, 1]]) / E
    else:
        compliance = np.array([[1 - nu**2, -nu * (1 + nu)], [-nu * (1 + nu), 1 - nu**2]]) / E
    sxx, syy = np.linalg.solve(compliance, [exx, eyy])
    szz = 0.0 if material.plane == "stress" else nu * (sxx + syy)
    return np.array([sxx, syy, szz, E / (1 + nu) * exy])


@both_orders
@pytest.mark.parametrize("material", [STRAIN, STRESS], ids=["strain", "stress"])
def test_a_linear_field_is_exact(material, order):
    """Prescribed all around, or on one side and by tractions on the others; its stress is constant."""
    mesh, expected = rectangle(order=order), linear_stress(material)
    sxx, syy, _, sxy = expected
    tractions = [
        Traction(on="right", value=(sxx, sxy)),
        Traction(on="top", value=(sxy, syy)),
        Traction(on="bottom", value=(-sxy, -syy)),
    ]
    for spec in (
        body(material, clamp=[linear_clamp(s) for s in SIDES]),
        body(material, clamp=[linear_clamp("left")], traction=tractions),
    ):
        u = solve(mesh, spec)
        assert np.abs(u - linear(mesh.points)).max() <= 1e-12 * np.abs(u).max()
    sigma = stress(mesh, material, linear(mesh.points))
    assert sigma.shape == (len(mesh.triangles), 4)
    assert np.abs(sigma - expected).max() <= 1e-12 * np.abs(expected).max()


def test_von_mises():
    cases = np.array(
        [[5.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -2.0], [3.0, 3.0, 3.0, 0.0], [4.0, -1.0, 2.0, 1.5]]
    )
    deviator = np.array([4.0, -1.0, 2.0]) - 5 / 3
    general = np.sqrt(1.5 * (deviator @ deviator + 2 * 1.5**2))
    assert von_mises(cases) == pytest.approx([5.0, 2.0 * np.sqrt(3), 0.0, general], rel=1e-14)


def test_principal_stresses():
    """Of pure shear, of a diagonal tensor in any order, and of a turned one in space; the largest first."""
    assert principal(np.array([[0.0, 0.0, 0.5, -2.0], [3.0, -1.0, 7.0, 0.0]])) == pytest.approx(
        np.array([[2.0, 0.5, -2.0], [7.0, 3.0, -1.0]]), abs=1e-14
    )
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    (xx, xy, xz), (_, yy, yz), (*_, zz) = turn @ np.diag([5.0, -4.0, 1.0]) @ turn.T
    assert principal(np.array([[xx, yy, zz, xy, yz, xz]])) == pytest.approx(
        np.array([[5.0, 1.0, -4.0]]), abs=1e-13
    )


# Loads. With the virtual displacement w = (x − x_left) e_i, which is in the space and vanishes on the
# clamp, b·w is the integral of load times w.


@both_orders
@pytest.mark.parametrize("component", [0, 1])
@pytest.mark.parametrize(
    ("rest", "expected"),
    [
        # block [1, 4] × [−0.5, 1.5], r = x − 1
        (
            {
                "volume_force": AffineVector(
                    constant=(1.0, 0.0), x_slope=(2.0, 0.0), y_slope=(0.0, 4.0)
                )
            },
            (9.0 + 2.0 * (9.0 + 18.0), 4.0 * 9.0 * 0.5),
        ),
        (
            {
                "traction": [
                    Traction(on="top", value=(2.0, -3.0)),
                    Traction(on="bottom", value=(1.0, 0.0)),
                ]
            },
            (3.0 * 4.5, -3.0 * 4.5),
        ),
        (
            {
                "traction": [
                    Traction(on="top", value=AffineVector(constant=(1.0, 0.0), x_slope=(0.0, 2.0)))
                ]
            },
            (4.5, 2.0 * (4.5 + 9.0)),
        ),
        (
            {
                "traction": [
                    Traction(
                        on="right", value=AffineVector(y_slope=(6.0, 0.0), constant=(0.0, 1.0))
                    )
                ]
            },
            (6.0 * 3.0 * 1.0, 6.0),
        ),
        (
            {
                "traction": [
                    Traction(on="right", value=(1.0, 0.0)),
                    Traction(on="right", value=(1.0, 5.0)),
                ],
                "volume_force": (0.0, 1.0),
            },
            (12.0, 39.0),
        ),
    ],
    ids=["affine volume", "top and bottom", "affine top", "affine right", "sum"],
)
def test_load_is_the_integral(rest, expected, component, order):
    mesh = rectangle(order=order)
    problem = assemble(mesh, body(clamp=["left"], **rest))
    w = np.zeros((len(problem.nodes), 2))
    w[:, component] = mesh.points[problem.nodes, 0] - 1.0
    assert problem.b.array_r @ w.ravel() == pytest.approx(expected[component], rel=1e-13)


def small_load(kind: str, size: float) -> dict:
    return {
        "traction": {"traction": [Traction(on="right", value=(0.0, -size))]},
        "volume": {"volume_force": (size, 0.0)},
        "clamp": {"clamp": ["left", Clamp(on="right", x=size)]},
    }[kind]


@pytest.mark.parametrize("kind", ["traction", "volume", "clamp"])
@pytest.mark.parametrize("size", [1e-151, 5e-324])
def test_loads_whose_squares_underflow_are_refused(kind, size):
    """Their norm has lost digits or is zero, as if nothing acted; a little larger ones are solved."""
    with pytest.raises(InputError, match=r"body\.block: loads .* so small .* choose other units"):
        assemble(rectangle(), body(**{"clamp": ["left"]} | small_load(kind, size)))
    assert (
        assemble(rectangle(), body(**{"clamp": ["left"]} | small_load(kind, 1e-145))).b.norm() > 0.0
    )
    assert assemble(rectangle(), body(clamp=["left"])).b.norm() == 0.0


def test_traction_inside_the_body_is_refused():
    mesh = rectangle((2, 1), (2.0, 1.0), (0.0, 0.0))
    middle = np.flatnonzero(mesh.points[:, 0] == 1.0)
    inside = Mesh(mesh.points, mesh.triangles, {**mesh.groups, "middle": middle[None, :]})
    with pytest.raises(InputError, match=r"not on the body's boundary, as at \(1, 0.5\)"):
        assemble(inside, body(clamp=["left"], traction=[Traction(on="middle", value=(1.0, 0.0))]))


# Clamps

ROLLERS = [
    Clamp(on="left", x=2e-3),
    Clamp(on="bottom", y=AffineScalar(constant=1e-3, x_slope=-1e-4)),
]
CLAMPS = {
    "full": ["left"],
    "rollers": ROLLERS,
    "roller and full": ["left", Clamp(on="right", y=-1e-3)],
    "all around": [*SIDES],
}


@both_orders
@pytest.mark.parametrize("clamps", CLAMPS.values(), ids=CLAMPS)
def test_clamps_against_elimination_by_scipy(clamps, order):
    mesh = rectangle(order=order)
    load = {"traction": [Traction(on="top", value=(0.01, -0.02))], "volume_force": (0.03, 0.01)}
    spec = body(clamp=clamps, **load)
    problem = assemble(mesh, spec)

    K = stiffness_of(mesh, STRAIN)
    held = np.zeros((len(mesh.points), 2), bool)
    given = np.zeros((len(mesh.points), 2))
    for clamp in spec.clamps:
        nodes = np.unique(mesh.groups[clamp.on])
        for i, value in enumerate((clamp.x, clamp.y)):
            if value is not None:
                held[nodes, i] = True
                affine = isinstance(value, AffineScalar)
                given[nodes, i] = (
                    value.constant + value.x_slope * mesh.points[nodes, 0] if affine else value
                )
    f = load_of(mesh, LinearForm(lambda v, w: 0.03 * v[0] + 0.01 * v[1]))
    shares = [1 / 2, 1 / 2] if order == 1 else [1 / 6, 1 / 6, 4 / 6]
    for edge in mesh.groups["top"]:
        length = np.linalg.norm(mesh.points[edge[1]] - mesh.points[edge[0]])
        f[2 * edge] += 0.01 * length * np.array(shares)
        f[2 * edge + 1] += -0.02 * length * np.array(shares)
    u, free = given.ravel().copy(), ~held.ravel()
    u[free] = spsolve(K[free][:, free].tocsc(), (f - K @ u)[free])

    assert np.array_equal(problem.free, ~held)
    assert np.array_equal(problem.acting.prescribed, given)
    assert problem.n == free.sum()
    assert np.array_equal(problem.nodes, np.flatnonzero(~held.all(axis=1)))
    assert not problem.b.array_r.reshape(-1, 2)[held[problem.nodes]].any()
    assert np.abs(solve(mesh, spec).ravel() - u).max() <= 1e-11 * np.abs(u).max()


LOOSE = {
    "no clamp": ([], "x y rotation"),
    "slides along x": ([Clamp(on="bottom", y=0.0)], "x"),
    "slides along x between": ([Clamp(on="bottom", y=0.0), Clamp(on="top", y=0.0)], "x"),
    "slides along y": ([Clamp(on="left", x=0.0), Clamp(on="right", x=1e-3)], "y"),
    "slides and turns": ([Clamp(on="bottom", x=0.0)], "y rotation"),
    "turns about a corner": ([Clamp(on="bottom", x=0.0), Clamp(on="left", y=0.0)], "rotation"),
}


@pytest.mark.parametrize(
    "geometry",
    [
        {},
        {"divisions": (1, 1), "order": 2},
        {"divisions": (30, 7), "size": (1e-9, 1e-9), "origin": (0.0, 0.0)},
        {"size": (1.0, 1.0), "origin": (1e5, 1e5)},
        {"divisions": (40, 2), "size": (100.0, 1.0)},
    ],
    ids=["plain", "coarse, order 2", "nano", "far", "slender"],
)
@pytest.mark.parametrize("case", LOOSE)
def test_motions_of_a_loose_body(case, geometry):
    """Translations by one, and scaled rotations about a point that the clamps allow, the centroid if they can."""
    clamps, expected = LOOSE[case]
    mesh = rectangle(**geometry)
    problem = assemble(mesh, body(clamp=clamps))
    assert not problem.supported
    assert problem.motions.shape == (*mesh.points.shape, len(expected.split()))
    assert not problem.motions[~problem.free].any()
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    centre = (low + high) / 2
    if case == "slides and turns":
        centre[1] = low[1]
    if case == "turns about a corner":
        centre = low
    x, y = ((mesh.points - centre) / (np.linalg.norm(high - low) / 2)).T
    known = {"x": (1 + 0 * x, 0 * x), "y": (0 * x, 1 + 0 * x), "rotation": (-y, x)}
    rounding = 1e-15 * (1 + np.abs(mesh.points).max() / mesh.extent)
    for motion, name in zip(problem.motions.transpose(2, 0, 1), expected.split(), strict=True):
        assert np.abs(motion - np.column_stack(known[name])).max() <= 10 * rounding
    forces = to_scipy(problem.A) @ problem.motions[problem.nodes].reshape(problem.b.size, -1)
    assert np.abs(forces).max() <= 100 * rounding * np.abs(to_scipy(problem.A)).max()


def two_squares() -> Mesh:
    """Two separate squares in one mesh."""
    square = rectangle((2, 2), (1.0, 1.0), (0.0, 0.0))
    count = len(square.points)
    return Mesh(
        np.vstack([square.points, square.points + np.array([3.0, 0.0])]),
        np.vstack([square.triangles, square.triangles + count]),
        square.groups | {"other": square.groups["right"] + count},
    )


@pytest.mark.parametrize("clamps", [[], ["left"], ["left", Clamp(on="other", x=0.0)]])
def test_piece_that_no_clamp_holds_is_refused(clamps):
    """A body of two pieces, one of which is loose, is refused, as their motions are not those of one body."""
    with pytest.raises(
        InputError,
        match=r"body\.block\.clamp: a piece of the body .* can still .*; make each piece a "
        r"body of its own",
    ):
        assemble(two_squares(), body(clamp=clamps))
