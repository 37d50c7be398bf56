"""Loads of one body: pressures, formulas, and clamps on points."""

import numpy as np
import pytest
from boundaries import elastic, rectangle, respond
from by_skfem import solve

from ddmpi.body.elasticity import assemble
from ddmpi.body.loads import nodal_loads, resultants, springs
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_quadrilateral
from ddmpi.scene.bodies import BodySpec, Clamp, Foundation, Material, MeshSpec, Traction
from ddmpi.scene.values import AffineScalar, AffineVector

STEEL = Material(young=2.1e11, poisson=0.3)
DAM = [(0.0, 0.0), (30.0, 0.0), (12.0, 40.0), (5.0, 40.0)]
"""Corners (m) of a dam whose left side leans."""

both_orders = pytest.mark.parametrize("order", [1, 2])


def body(**rest) -> BodySpec:
    return BodySpec(name="block", mesh=MeshSpec(file="unused.msh"), material=STEEL, **rest)


def dam(order: int, divisions=(5, 7), vertices=()) -> Mesh:
    mesh = generate_quadrilateral(
        MeshSpec(shape="quadrilateral", corners=tuple(DAM), divisions=divisions)
    )
    mesh = Mesh(
        mesh.points,
        mesh.triangles,
        mesh.groups,
        {name: np.array([k]) for k, name in enumerate(vertices)},
    )
    return raise_order(mesh, "mesh") if order == 2 else mesh


def ring(around: int, across: int, order: int) -> Mesh:
    """A quarter of a ring from 1 to 2 m; of order 2 its sides are curved."""
    spec = MeshSpec(
        shape="annulus",
        center=(0.0, 0.0),
        radii=(1.0, 2.0),
        angles=(0.0, 90.0),
        divisions=(around, across),
        order=order,
    )
    return build_mesh(BodySpec(name="ring", mesh=spec, material=STEEL))


def moment(mesh: Mesh, f: np.ndarray) -> float:
    """x F_y − y F_x about the origin (N m)."""
    return float(mesh.points[:, 0] @ f[:, 1] - mesh.points[:, 1] @ f[:, 0])


@both_orders
@pytest.mark.parametrize("place", [0.0, 30.0])
def test_a_moment_is_spread_without_a_force(place, order):
    """About any point, on flat and curved groups; on a plane the stress grows with the distance from its middle."""
    quarter = ring(6, 3, order)
    quarter = Mesh(quarter.points + place, quarter.triangles, quarter.groups)
    top = build_mesh(
        BodySpec(
            name="box",
            material=STEEL,
            mesh=MeshSpec(
                shape="box",
                origin=(place, 0.0, -place),
                size=(3.0, 1.0, 2.0),
                divisions=(3, 2, 2),
                order=order,
            ),
        )
    )
    for mesh, on, given in (
        (quarter, "outer", 5.0),
        (quarter, "start", -2.0),
        (top, "top", (1.0, -2.0, 3.0)),
    ):
        load = Traction(on=on, moment=given)
        f = nodal_loads(mesh, body(traction=[load]))
        (total,) = resultants(mesh, [(on, f)]).values()
        assert np.abs(total["force"]).max() <= 1e-12 * np.abs(f).sum()
        assert total["moment"] == pytest.approx(
            np.array(given), abs=1e-11 * np.abs(f).sum() * (1.0 + place)
        )
        assert not f[np.setdiff1d(np.arange(len(f)), mesh.groups[on])].any()
    # about y alone: σ_zz = −M x / I with I = 3³/12
    bent = nodal_loads(top, body(traction=[Traction(on="top", moment=(0.0, 9.0, 0.0))]))
    stress = nodal_loads(
        top, body(traction=[Traction(on="top", value=(0.0, 0.0, f"-4 * (x - {place + 1.5})"))])
    )
    assert bent == pytest.approx(stress, abs=1e-11 * (1.0 + place))


# Foundations


@both_orders
@pytest.mark.parametrize("normal, tangential", [(3.0, 2.0), (0.0, 2.0), (3.0, 0.0)])
def test_springs_act_along_the_normal_and_across_it(normal, tangential, order):
    """A displacement stores half its part squared times the stiffness over the area; on a ring half is normal."""
    top = build_mesh(
        BodySpec(
            name="box",
            material=STEEL,
            mesh=MeshSpec(shape="box", size=(3.0, 1.0, 2.0), divisions=(3, 2, 2), order=order),
        )
    )
    for mesh, on, area, u, along in (
        (top, "top", 3.0, (0.0, 0.0, 1.0), 1.0),
        (top, "top", 3.0, (0.6, 0.8, 0.0), 0.0),
        (top, "top", 3.0, (0.6, 0.0, 0.8), 0.64),
        (ring(64, 4, order), "inner", np.pi / 2, (1.0, 0.0), 0.5),
    ):
        ((group, root, Q),) = springs(
            mesh, body(foundation=(Foundation(on=on, normal=normal, tangential=tangential),))
        )
        stored = (root * np.linalg.norm(Q @ np.tile(u, len(mesh.points)))) ** 2
        assert group == on
        assert stored == pytest.approx(
            area * (along * normal + (1.0 - along) * tangential), rel=1e-3
        )


def test_clamps_move_the_ends_of_springs():
    """A block that its bottom carries along a wall of springs, which a traction stretches as far: it moves as one."""
    mesh, along, away = rectangle((4, 3), (2.0, 1.0)), np.array([2e-3, 1e-3]), np.array([5e8, 3e8])
    block = elastic(
        mesh,
        [Clamp(on="bottom", x=along[0], y=along[1])],
        foundation=(Foundation(on="left", normal=away[0], tangential=away[1]),),
        traction=(Traction(on="left", value=tuple(away * along)),),
    )
    assert respond(block) == pytest.approx(np.tile(along, (len(mesh.points), 1)), rel=1e-9)


# Forces


@both_orders
def test_force_is_spread_evenly(order):
    """It is the stress of the force over its area, on straight and curved sides, in the plane and in space."""
    half_pi = np.pi / 2
    box = build_mesh(
        BodySpec(
            name="box",
            material=STEEL,
            mesh=MeshSpec(shape="box", size=(3.0, 1.0, 2.0), divisions=(3, 2, 2), order=order),
        )
    )
    for mesh, on, area, force in (
        (dam(order), "left", np.hypot(5.0, 40.0), (2e5, -1e6)),
        (ring(64, 32, order), "inner", half_pi, (2e5, -1e6)),
        (box, "top", 3.0, (2e5, -1e6, 3e4)),
    ):
        f, g = (
            nodal_loads(mesh, body(traction=[load]))
            for load in (
                Traction(on=on, force=force),
                Traction(on=on, value=tuple(each / area for each in force)),
            )
        )
        assert f.sum(axis=0) == pytest.approx(force, rel=1e-13)
        assert np.abs(f - g).max() <= (2e-4 if on == "inner" else 1e-13) * np.abs(g).max()


def test_force_on_no_area_is_refused():
    """A force on a group whose facets have no area, on a point, or on an empty group is one clear error."""
    mesh = dam(1, vertices=["tip"])
    line = Mesh(
        mesh.points * [1.0, 0.0],
        mesh.triangles,
        mesh.groups | {"none": np.empty((0, 2), int)},
        mesh.vertices,
    )
    flat = Mesh(
        np.where(
            np.isin(np.arange(len(mesh.points)), mesh.groups["left"])[:, None], 0.0, mesh.points
        ),
        mesh.triangles,
        mesh.groups,
    )
    for of, on, words in (
        (flat, "left", "'left' has no area over which a force could be spread"),
        (line, "none", "'none' of the mesh has a name, but no lines"),
        (mesh, "tip", "'tip' is a physical point of the mesh, which only a clamp may name"),
    ):
        with pytest.raises(InputError, match=words):
            nodal_loads(of, body(traction=[Traction(on=on, force=(1.0, 1.0))]))


# Pressures


@both_orders
@pytest.mark.parametrize(
    "pressure",
    [AffineScalar(constant=40 * 9810.0, y_slope=-9810.0), "9810 * (40 - y)"],
    ids=["affine", "formula"],
)
def test_water_behind_a_leaning_dam(order, pressure):
    """Force and moment of water are exact: γ H²/2 to the right, γ V downward on the foot of the leaning side."""
    mesh, weight, H, lean = dam(order), 9810.0, 40.0, 5.0
    f = nodal_loads(mesh, body(traction=[Traction(on="left", pressure=pressure)]))
    assert f.sum(axis=0) == pytest.approx([weight * H**2 / 2, -weight * H * lean / 2], rel=1e-13)
    # P acts at y along x; the water's wedge rests at lean / 3.
    about = -weight * H**3 / 6 - weight * H * lean**2 / 6
    assert moment(mesh, f) == pytest.approx(about, rel=1e-13)


def test_formulas_on_curved_triangles_and_sides():
    """Linear formulas are the affine loads on curved sides; a quartic force has the resultant of calculus."""
    mesh = ring(12, 6, 2)
    formula = ("3 + 2*x", "-6e7 * (1 + x/3) + y")
    affine = AffineVector(constant=(3.0, -6e7), x_slope=(2.0, -2e7), y_slope=(0.0, 1.0))
    f, g = (
        nodal_loads(mesh, body(traction=[Traction(on="outer", value=value)]))
        for value in (formula, affine)
    )
    assert np.abs(f - g).max() <= 1e-14 * np.abs(g).max()
    f = nodal_loads(mesh, body(volume_force=("(x**2 + y**2)**2", 1.0)))
    # Sides are parabolas, so that circles are met up to 1e-5.
    assert f.sum(axis=0) == pytest.approx([np.pi / 2 * (2**6 - 1) / 6, np.pi / 4 * 3], rel=1e-5)


@pytest.mark.parametrize(
    "loads, key, words",
    [
        (
            {"traction": [Traction(on="bottom", pressure="1 / x")]},
            "traction",
            '"1 / x" is inf at (0, 0)',
        ),
        (
            {"traction": [Traction(on="top", value=(0.0, "log(9 - x)"))]},
            "traction",
            '"log(9 - x)" is nan at (',
        ),
        ({"volume_force": ("1e200*y", 0.0)}, "volume_force", '"1e200*y" is 3.99'),
        ({"volume_force": ("sqrt(y - 1)", 0.0)}, "volume_force", '"sqrt(y - 1)" is nan at ('),
        ({"clamp": [Clamp(on="left", y="1/(y - 40)")]}, "clamp", '"1/(y - 40)" is inf at (5, 40)'),
    ],
)
def test_formula_that_is_not_finite_is_refused(loads, key, words):
    """A formula must be finite at the nodes where it acts; the message quotes it, and says where it is not."""
    with pytest.raises(InputError) as error:
        assemble(dam(1), body(**({"clamp": ["bottom"]} | loads)))
    assert str(error.value).startswith(f"body.block.{key}: the formula {words}")


def test_point_clamps_that_determine_the_position_carry_nothing():
    """Clamps on points that only fix the position take up no part of balanced loads."""
    mesh = dam(2, vertices=("heel", "toe"))
    spec = body(
        clamp=["heel", Clamp(on="toe", y=0.0)],
        traction=[Traction(on=side, pressure=3e6) for side in mesh.groups],
    )
    problem = assemble(mesh, spec)
    assert problem.supported
    assert np.argwhere(~problem.free).tolist() == [[0, 0], [0, 1], [1, 1]]
    u = solve(mesh, spec)
    reaction = sum_stiffness(mesh, STEEL).mult(u) - nodal_loads(mesh, spec)
    assert np.abs(reaction).max() <= 1e-9 * problem.load
    # The same pressure everywhere: all of it contracts alike.
    strain = np.linalg.lstsq(mesh.points, u, rcond=None)[0]
    bulk = -3e6 * (1 + 0.3) * (1 - 2 * 0.3) / STEEL.young
    assert np.abs(strain - bulk * np.eye(2)).max() <= 1e-9 * abs(bulk)
