"""Clamps along normals and directions: at any angle, on curved surfaces, several at a node; what they leave loose."""

import numpy as np
import pytest
from by_skfem import solve

from ddmpi.body.elasticity import assemble, clamp_forces
from ddmpi.body.loads import resultants, supports
from ddmpi.errors import InputError
from ddmpi.mesh.boundary import outer_normals
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_annulus
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction

STEEL = Material(young=2.1e11, poisson=0.3)
both_orders = pytest.mark.parametrize("order", [1, 2])
turns = pytest.mark.parametrize("angle", [0.0, 27.0])


def rotation(angle: float, d: int = 2) -> np.ndarray:
    """About z, and in space then about an oblique axis."""
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    R = np.array([[c, -s], [s, c]])
    if d == 3:
        R = np.block([[R, np.zeros((2, 1))], [np.zeros((1, 2)), 1.0]]) @ np.array(
            [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
        )
    return R


def box(d: int, order: int) -> Mesh:
    return build_mesh(
        BodySpec(
            name="box",
            material=STEEL,
            mesh=MeshSpec(
                shape="rectangle" if d == 2 else "box",
                size=(2.0, 1.0, 1.5)[:d],
                divisions=(4, 3, 2)[:d],
                order=order,
            ),
        )
    )


def turned(mesh: Mesh, R: np.ndarray) -> Mesh:
    return Mesh(mesh.points @ R.T, mesh.triangles, mesh.groups, mesh.vertices)


def ring(angles: np.ndarray, order: int = 1, across: int = 3) -> Mesh:
    """A ring from 1 to 2 m; its nodes stand at the same angles (rad) on all circles, which are curved in order 2."""
    whole = generate_annulus(
        MeshSpec(
            shape="annulus",
            center=(0.0, 0.0),
            radii=(1.0, 2.0),
            angles=(0.0, 360.0),
            divisions=(len(angles), across),
        )
    )
    radius, at = np.hypot(*whole.points.T), np.arctan2(*whole.points.T[::-1]) % (2 * np.pi)
    at = np.interp(
        at,
        np.arange(len(angles) + 1) * 2 * np.pi / len(angles),
        np.append(angles, angles[0] + 2 * np.pi),
    )
    mesh = Mesh(
        radius[:, None] * np.column_stack([np.cos(at), np.sin(at)]), whole.triangles, whole.groups
    )
    if order == 1:
        return mesh
    fine = raise_order(mesh, "mesh")
    ends, middles = (
        fine.triangles[:, fine.cell.edges[:, :2]],
        fine.triangles[:, fine.cell.edges[:, 2]],
    )
    points, size = fine.points.copy(), np.hypot(*fine.points.T)
    along = np.isclose(size[ends[..., 0]], size[ends[..., 1]])
    points[middles[along]] *= (size[ends[along][:, 0]] / size[middles[along]])[:, None]
    return Mesh(points, fine.triangles, fine.groups)


IRREGULAR = np.cumsum(np.tile([1.0, 1.7, 0.6, 1.2], 6)) * 2 * np.pi / 27.0


def body(**more) -> BodySpec:
    return BodySpec(name="body", mesh=MeshSpec(file="unused.msh"), material=STEEL, **more)


@pytest.mark.every(5)
@both_orders
@turns
@pytest.mark.parametrize("by", ["normal", "along", "formulas"])
@pytest.mark.parametrize("d", [2, 3])
def test_a_turned_body_on_symmetry_planes_is_its_twin(d, angle, order, by):
    """On planes of symmetry and under a moved side at any angle a body does what it does along the axes."""
    R, upright = rotation(angle, d), box(d, order)
    planes = [
        ("left", 0.0),
        ("bottom", 0.0),
        ("right", 2e-3),
        *([("front", 0.0)] if d == 3 else []),
    ]
    axes = {"left": "x", "bottom": "y" if d == 2 else "z", "right": "x", "front": "y"}
    clamps = [Clamp(on=on, normal=value) for on, value in planes]
    if by != "normal":
        ways = {on: 7.0 * R[:, "xyz".index(axis)] for on, axis in axes.items()}
        if by == "formulas":
            ways = {on: [f"{part} * (2 + x**2)" for part in way] for on, way in ways.items()}
        clamps = [Clamp(on=on, along=tuple(ways[on]), value=value) for on, value in planes]
    plain = [Clamp(on=on, **{axes[on]: value}) for on, value in planes]
    load = (1e6, -3e8, 2e8)[:d]
    found = []
    for mesh, held, force in (
        (upright, plain, load),
        (turned(upright, R), clamps, tuple(R @ load)),
    ):
        spec = body(clamp=held, traction=[Traction(on="top", value=force)])
        u, problem = solve(mesh, spec), assemble(mesh, spec)
        reactions = resultants(mesh, clamp_forces(mesh, spec, problem, u, np.zeros_like(u)))
        found.append((u, problem.n, {on: each["force"] for on, each in reactions.items()}))
        assert problem.supported
        total = sum(found[-1][2].values()) + problem.acting.f.sum(axis=0)
        assert np.abs(total).max() <= 1e-9 * np.abs(problem.acting.f).sum()
    (u, n, forces), (v, m, others) = found
    assert n == m
    assert np.abs(v - u @ R.T).max() <= 1e-10 * np.abs(u).max()
    assert all(others[on] == pytest.approx(R @ forces[on], rel=1e-9, abs=1.0) for on in forces)


@both_orders
def test_each_plane_of_a_wedge_reacts_along_its_own_normal(order):
    """On planes that are not at right angles, their common node included."""
    spec = BodySpec(
        name="wedge",
        material=STEEL,
        mesh=MeshSpec(
            shape="quadrilateral",
            corners=((0.0, 0.0), (2.0, 0.0), (3.0, 2.0), (1.0, 2.0)),
            divisions=(4, 3),
            order=order,
        ),
        clamp=[Clamp(on="bottom", normal=0.0), Clamp(on="left", normal=0.0)],
        traction=[Traction(on="top", value=(4e6, -1e7))],
    )
    mesh = build_mesh(spec)
    u, problem = solve(mesh, spec), assemble(mesh, spec)
    found = resultants(mesh, clamp_forces(mesh, spec, problem, u, np.zeros_like(u)))
    planes = np.array([outer_normals(mesh, on, "key")[1][0] for on in ("bottom", "left")])
    expected = planes * np.linalg.solve(planes.T, [-8e6, 2e7])[:, None]
    assert [found[on]["force"] for on in ("bottom", "left")] == [
        pytest.approx(force, rel=1e-9) for force in expected
    ]


@both_orders
@pytest.mark.parametrize(
    "angles", [np.arange(24) * 2 * np.pi / 24, IRREGULAR], ids=["even", "irregular"]
)
def test_normals_of_a_circle_are_radial(order, angles):
    """Wherever the nodes stand on a circle, normals are its own: a body can turn in a bore that clamps its normals."""
    mesh = ring(angles, order)
    for on, sign in (("inner", -1.0), ("outer", 1.0)):
        nodes, normal = outer_normals(mesh, on, "key")
        radial = sign * mesh.points[nodes] / np.hypot(*mesh.points[nodes].T)[:, None]
        assert np.abs(normal - radial).max() <= 1e-12
        problem = assemble(mesh, body(clamp=[Clamp(on=on, normal=0.0)]))
        assert problem.motions.shape[2] == 1
        motion = problem.motions[..., 0] / np.abs(problem.motions).max() * 2.0
        assert (
            np.abs(motion - np.sign(motion[0, 1]) * mesh.points[:, ::-1] * [-1.0, 1.0]).max()
            <= 1e-9
        )


@both_orders
def test_a_direction_by_formulas_is_that_of_each_node(order):
    """A ring that is held around turns with the clamp; held along its radius it can turn."""
    mesh, across = ring(IRREGULAR, order), 1e-3
    held = [
        Clamp(on="inner", along=("-y", "x"), value=across),
        Clamp(on="inner", along=("3*x", "3*y"), value=0.0),
    ]
    u = solve(mesh, body(clamp=held))
    inner = np.unique(mesh.groups["inner"])
    turned = across * mesh.points[inner][:, ::-1] * [-1.0, 1.0]
    assert np.abs(u[inner] - turned).max() <= 1e-12 * across
    assert np.abs(u / across - mesh.points[:, ::-1] * [-1.0, 1.0]).max() <= 1e-9
    assert assemble(mesh, body(clamp=held[1:])).motions.shape[2] == 1


def test_a_direction_that_is_zero_somewhere_is_refused_with_its_place():
    """Also where rounding is left of it; a direction that is only shorter there is none of these."""
    mesh = box(2, 1)
    for x, refused in (("x", True), ("x + 1e-17", True), ("x + 1e-6", False)):
        spec = body(clamp=[Clamp(on="bottom", along=(x, "0"), value=0.0)])
        if not refused:
            assert not supports(mesh, spec).free[mesh.groups["bottom"], 0].any()
            continue
        words = (
            r"body.body.clamp: along has no direction at \(0, 0\), on 'bottom': it is zero there"
        )
        with pytest.raises(InputError, match=words):
            supports(mesh, spec)


def test_normals_of_a_sphere_are_radial(monkeypatch):
    """On an irregular mesh of a sphere as well."""
    rng = np.random.default_rng(3)
    mesh = box(3, 1)
    points = 2.0 * mesh.points / [2.0, 1.0, 1.5] - 1.0
    size = np.abs(points).max(axis=1)
    points *= (size / np.maximum(np.linalg.norm(points, axis=1), 1e-9))[:, None]
    outer = np.unique(np.concatenate(list(mesh.groups.values())))
    points[outer] += 0.05 * rng.standard_normal((len(outer), 3))
    points[outer] /= np.linalg.norm(points[outer], axis=1)[:, None]
    sphere = Mesh(points, mesh.triangles, {"skin": np.concatenate(list(mesh.groups.values()))})
    monkeypatch.setattr("ddmpi.mesh.boundary.SHARPEST", np.pi)  # the mesh is a coarse one
    nodes, normal = outer_normals(sphere, "skin", "key")
    assert np.abs(normal - points[nodes]).max() <= 1e-12


def test_a_corner_inside_a_group_is_refused_with_its_place():
    """A group that goes around a corner has no normal there."""
    mesh = box(2, 1)
    both = Mesh(
        mesh.points,
        mesh.triangles,
        {"flank": np.concatenate([mesh.groups["left"], mesh.groups["top"]])},
    )
    with pytest.raises(
        InputError,
        match=r"body.body.clamp: 'flank' has a corner at \(0, 1\), where it has no normal",
    ):
        assemble(both, body(clamp=[Clamp(on="flank", normal=0.0)]))
    solid = box(3, 2)
    both = Mesh(
        solid.points,
        solid.triangles,
        {"flank": np.concatenate([solid.groups["left"], solid.groups["top"]])},
    )
    with pytest.raises(
        InputError, match=r"'flank' has a corner at \(0, [\d.]+, 1.5\), where it has no normal"
    ):
        assemble(both, body(clamp=[Clamp(on="flank", normal=0.0)]))


def test_a_point_has_no_normal():
    """Only boundary groups have one."""
    mesh = box(2, 1)
    mesh = Mesh(mesh.points, mesh.triangles, mesh.groups, {"tip": np.array([0])})
    with pytest.raises(
        InputError, match="'tip' is no boundary group of the mesh and has no normal; give x, y or z"
    ):
        assemble(mesh, body(clamp=[Clamp(on="tip", normal=0.0)]))


@turns
def test_several_clamps_at_a_node(angle):
    """Both normals hold at the node where two groups meet; what they prescribe there goes together or is refused."""
    mesh = turned(box(2, 1), rotation(angle))
    held = supports(
        mesh,
        body(
            clamp=[Clamp(on="left", normal=1e-3), Clamp(on="bottom", normal="2e-3", history="on")],
            traction=[Traction(on="top", pressure=1.0, history="on")],
        ),
    )
    corner = np.intersect1d(*(mesh.groups[on] for on in ("left", "bottom")))
    assert not held.free[corner].any()
    left, bottom = -rotation(angle).T
    assert held.moved[None][corner[0]] == pytest.approx(1e-3 * left, abs=1e-15)
    assert held.moved["on"][corner[0]] == pytest.approx(2e-3 * bottom, abs=1e-15)
    supports(
        mesh, body(clamp=[Clamp(on="left", normal=1e-3), Clamp(on="left", normal="1e-3 + 0*x")])
    )
    for clash in (
        [Clamp(on="left", normal=1e-3), Clamp(on="left", normal=2e-3)],
        [Clamp(on="left", normal=1e-3), Clamp(on="left", x=0.0, y=0.0)],
        ["left", Clamp(on="left", normal=1e-3)],
        [Clamp(on="left", normal=1e-3), Clamp(on="left", along=tuple(left), value=2e-3)],
        [
            Clamp(on="left", x=0.0),
            Clamp(on="left", along=(1.0, 1.0), value=0.0),
            Clamp(on="left", y=1e-3),
        ],
    ):
        with pytest.raises(
            InputError, match=r"body.body.clamp: \w+ at .* is prescribed twice, as "
        ):
            supports(mesh, body(clamp=clash))


def test_groups_that_join_smoothly_have_one_normal():
    """Where a curved surface goes on in another group the nodes between them can slide."""
    mesh = ring(np.arange(24) * 2 * np.pi / 24)
    outer = mesh.groups["outer"]
    halves = Mesh(mesh.points, mesh.triangles, {"one": outer[:12], "other": outer[12:]})
    held = supports(
        halves, body(clamp=[Clamp(on="one", normal=0.0), Clamp(on="other", normal=0.0)])
    )
    assert np.einsum("kii->k", held.free)[np.unique(outer)] == pytest.approx(1.0)


@turns
def test_a_load_that_a_clamp_takes_up_is_warned_of(angle):
    """A pressure on a group that is clamped along its normal is lost; a load along the group is not."""
    R = rotation(angle)
    mesh, along = turned(box(2, 1), R), tuple(R @ [0.0, 1e6])
    for load, lost in (
        (Traction(on="left", pressure=1e6), True),
        (Traction(on="left", force=along), False),
        (Traction(on="top", pressure=1e6), False),
    ):
        warnings = assemble(
            mesh, body(clamp=[Clamp(on="left", normal=0.0)], traction=[load])
        ).warnings
        assert (
            any("is lost, as clamps constrain the whole group" in each for each in warnings) == lost
        )
