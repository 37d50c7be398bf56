"""Contacts of curved quadratic sides: lengths, normals and integrals follow the sides, gaps the arcs that are meant."""

from types import SimpleNamespace

import bricks
import numpy as np
import pytest
import solids
from boundaries import mortar, pair, raise_order, rectangle, ring, side, touch
from made_up_solids import box, tube

from ddmpi.interface.mortar import cover
from ddmpi.mesh.elements import on_line
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import bend
from ddmpi.scene.contacts import Circle, NoFriction, Plane
from ddmpi.surface.patch import Patch
from ddmpi.surface.side import Side, cross, frames, unit

UNEVEN = np.cumsum([0.0, 0.2, 0.12, 0.25, 0.16, 0.2, 0.1, 0.22, 0.15])


def curved_ring(inner: float, outer: float, angles: np.ndarray, closed: bool = False) -> Mesh:
    """A ring of one layer whose middles lie at the mean angle and radius of their ends."""
    mesh = ring(inner, outer, angles, order=2, closed=closed)
    ends, middle = (
        mesh.points[mesh.triangles[:, mesh.cell.edges[:, :2]]],
        mesh.points[mesh.triangles[:, 3:]],
    )
    radius = np.linalg.norm(ends, axis=3)
    direction = (ends / radius[..., None]).sum(axis=2)
    target = (
        direction
        / np.linalg.norm(direction, axis=2, keepdims=True)
        * radius.mean(axis=2)[..., None]
    )
    return bend(mesh, target - middle)


def points(boundary: Side, links: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Where on links (q,) the parameters t (q,) are."""
    return np.einsum(
        "ql,qld->qd", boundary.cell.shapes(on_line(t)), boundary.xy[boundary.facets[links]]
    )


def test_normals_and_lengths_of_a_graded_circle():
    """Nodal normals are those of the circle whatever the lengths of sides, and nodal lengths add up to its arc."""
    mesh = curved_ring(0.5, 1.0, UNEVEN)
    for group, sign in (("outer", 1.0), ("inner", -1.0)):
        boundary = side(mesh, group)
        radial = sign * boundary.xy / np.linalg.norm(boundary.xy, axis=1, keepdims=True)
        inside = slice(1, -1)  # an end has a side on one hand only
        assert boundary.normal[inside] == pytest.approx(radial[inside], abs=4e-4)
        assert np.abs(cross(boundary.normal[[0, -1]], radial[[0, -1]])).max() < 5e-3
        length = UNEVEN[-1] * (1.0 if group == "outer" else 0.5)
        assert boundary.area.sum() == pytest.approx(boundary.lengths.sum(), rel=1e-14)
        assert boundary.area.sum() == pytest.approx(length, rel=2e-5)
        assert boundary.lengths_over(np.ones(8, bool)) == pytest.approx(boundary.area, rel=1e-14)
        assert boundary.normals_over(np.ones(8, bool)) == pytest.approx(boundary.normal, abs=1e-14)
    straight = side(ring(0.5, 1.0, UNEVEN, order=2, closed=False), "outer")
    curved = side(mesh, "outer")
    off = np.abs(cross(curved.normal[1:-1], curved.xy[1:-1])).max()
    assert 20 * off < np.abs(cross(straight.normal[1:-1], straight.xy[1:-1])).max()


def test_points_that_face_each_other_lie_on_one_ray():
    """A point of the slave's curve, its ray, and the point of the master's curve that it faces are in line."""
    slave = side(curved_ring(0.5, 1.0, np.linspace(0.0, 1.5, 7)), "outer", body="slave")
    master = side(curved_ring(1.01, 1.5, np.linspace(0.0, 1.5, 9)), "inner", body="master")
    over = cover(slave, master)
    here, there = (
        points(slave, over.facet, over.at[:, 1]),
        points(master, over.other, over.there[:, 1]),
    )
    inside = over.there.min(axis=1) > 1e-6
    assert inside.mean() > 0.8
    assert cross(there - here, over.direction)[inside] == pytest.approx(0.0, abs=1e-14)
    assert np.abs(cross(there - here, over.direction)[over.weight > 0.0]).max() < 1e-4
    assert np.bincount(over.facet, over.weight) == pytest.approx(slave.lengths, rel=1e-7)
    assert over.gap == pytest.approx(0.01, abs=1e-7)


def test_gap_between_curved_sides_is_that_of_the_circles():
    """Matching, non-matching and rigid circles: gaps are those between circles, not between parabolas."""
    angles = np.linspace(0.0, 1.5, 13)
    first, second = (
        side(curved_ring(*radii, angles), group, body=name)
        for radii, group, name in (
            ((0.5, 1.0), "outer", "first"),
            ((1.001, 1.5), "inner", "second"),
        )
    )
    straight = [
        side(ring(*radii, angles, order=2, closed=False), group, body=name)
        for radii, group, name in (
            ((0.5, 1.0), "outer", "first"),
            ((1.001, 1.5), "inner", "second"),
        )
    ]
    parabola = (
        first.xy[first.facets[:, 0]] * 0.375
        + first.xy[first.facets[:, 2]] * 0.75
        - first.xy[first.facets[:, 1]] * 0.125
    )
    assert np.abs(np.linalg.norm(parabola, axis=1) - 1.0).max() > 1e-7
    for interface in (
        pair(first, second, NoFriction(), "seam"),
        mortar(first, second, NoFriction(), "seam"),
        touch(
            first,
            Circle(name="bore", center=(0.0, 0.0), radius=1.001, inside=True),
            NoFriction(),
            "seam",
        ),
    ):
        assert interface.gap == pytest.approx(1e-3, abs=1e-9)
    assert pair(*straight, NoFriction(), "seam").gap[1:-1] == pytest.approx(1e-3, abs=1e-9)
    curved, chords = (pair(*sides, NoFriction(), "seam") for sides in ((first, second), straight))
    assert curved.area.sum() == pytest.approx(1.5 * 1.0005, rel=2e-6)
    assert chords.area.sum() < (1.0 - 5e-4) * curved.area.sum()


@pytest.mark.parametrize("sides", [16, 64])
def test_gaps_of_curved_sides_over_partners_are_distances(sides):
    """Nodes on a circle are as far from a plane, a disc and a bore as the circle is, on whichever ray that is."""
    boundary = side(curved_ring(0.5, 1.0, np.linspace(0.0, 2 * np.pi, sides + 1), True), "outer")
    disc = {"name": "partner", "center": (0.0, -4.0), "radius": 3.0}
    for partner, distance in (
        (Plane(name="partner", point=(0.0, -1.0), normal=(0.0, 1.0)), lambda x, y: y + 1.0),
        (
            Plane(name="partner", point=(-1.0, 0.0), normal=(0.8, 0.6)),
            lambda x, y: 0.8 * x + 0.8 + 0.6 * y,
        ),
        (Circle(**disc), lambda x, y: np.hypot(x, y + 4.0) - 3.0),
        (
            Circle(**disc | {"center": (0.0, 0.5), "radius": 2.0}, inside=True),
            lambda x, y: 2.0 - np.hypot(x, y - 0.5),
        ),
    ):
        met = touch(boundary, partner, NoFriction(), "seam")
        assert met.gap == pytest.approx(distance(*met.xy.T), abs=1e-13)


@pytest.mark.parametrize("order", [1, 2])
def test_normals_at_an_edge_of_a_solid_are_those_of_its_faces(order):
    """Where faces meet at a sharp edge each keeps its own normal; along a wheel they are radial."""
    boundary = side(box(divisions=(3, 2, 2), order=order), "top", "right")
    assert boundary.fans == pytest.approx(
        np.repeat(boundary.outward[:, None], 3, axis=1), abs=1e-15
    )
    rim = side(tube((0.5, 1.0), 1.0, order=order), "outer")
    assert rim.fans[..., :2] == pytest.approx(rim.xy[rim.corners][..., :2], abs=1e-3)


@pytest.mark.parametrize("made", [bricks.grid, solids.grid])
@pytest.mark.parametrize("sides", [6, 12, 24, 40])
def test_normals_of_a_strip_are_those_of_its_cylinder(made, sides):
    """A single row of facets across tells nothing of the curvature along it; its normals, also at its ends, are radial
    as those of two rows are. They were off by 9 degrees."""
    off = []
    for rows in (1, 2):
        mesh = made((1, sides, rows))
        radius, angle, z = mesh.points.T * [[0.3], [np.pi / 2.0], [0.2]]
        points = np.stack(
            [(0.3 + radius) * np.cos(angle), (0.3 + radius) * np.sin(angle), z], axis=1
        )
        wall = side(Mesh(points, mesh.triangles, mesh.groups), "right")
        radial = unit((wall.xy[wall.simplices] * [1.0, 1.0, 0.0]).reshape(-1, 3))
        off.append(np.abs(wall.fans.reshape(-1, 3) - radial).max())
    assert off[0] < 0.7 * (1.5 / sides) ** 2 and off[0] < 4.0 * off[1]


@pytest.mark.parametrize("shear", [0.0, -1.0])
@pytest.mark.parametrize("aspect", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("sides", [6, 12, 40])
def test_normals_of_a_strip_lean_no_more_than_its_facets(sides, aspect, shear):
    """Across a strip that is `aspect` of a facet wide, sheared by a facet or not, rounding and higher terms of a fit
    count as slopes; its normals are at most as far from radial as facets at their corners. They were off by 57 degrees."""
    mesh, arc = solids.grid((1, sides, 1)), np.pi / 2.0 / sides
    radius, angle, z = mesh.points.T * [[0.3], [np.pi / 2.0], [1.0]]
    angle = angle + shear * arc * z
    points = [(0.7 + radius) * np.cos(angle), (0.7 + radius) * np.sin(angle), aspect * arc * z]
    wall = side(Mesh(np.stack(points, axis=1), mesh.triangles, mesh.groups), "right")
    radial = unit((wall.xy[wall.simplices] * [1.0, 1.0, 0.0]).reshape(-1, 3))
    assert np.linalg.norm(wall.fans.reshape(-1, 3) - radial, axis=1).max() < 0.501 * arc


def sheared(sides: int, aspect: float, shear: float, rows: int, zigzag: bool = False) -> Side:
    """A quarter of a cylinder of radius 1, of `rows` of facets `aspect` arcs wide, each by `shear` arcs further than the one
    below, or back again."""
    mesh, arc = solids.grid((1, sides, rows)), np.pi / 2.0 / sides
    radius, angle, z = mesh.points.T * [[0.3], [np.pi / 2.0], [rows]]
    angle = angle + shear * arc * (z % 2.0 if zigzag else z)
    points = [(0.7 + radius) * np.cos(angle), (0.7 + radius) * np.sin(angle), aspect * arc * z]
    return side(Mesh(np.stack(points, axis=1), mesh.triangles, mesh.groups), "right", body="wall")


LEANING = [
    # sides, aspect, shear, rows, zigzag; the angle in degrees by which facets lean out of the face
    (12, 0.03, -0.5, 1, False, 28.6),
    (24, 0.01, 0.2, 1, False, 38.2),
    (12, 0.1, 1.0, 8, False, 52.6),
    (40, 0.1, 0.5, 8, True, 8.4),  # at a tip alone normals were off
    (24, 0.03, 0.5, 3, True, 39.3),
]


@pytest.mark.parametrize(("sides", "aspect", "shear", "rows", "zigzag", "lean"), LEANING)
def test_normals_of_a_face_do_not_lean_with_its_facets(sides, aspect, shear, rows, zigzag, lean):
    """Corners of a Schwarz lantern are on its cylinder, whichever way the facets lean. Normals leant as these do."""
    wall = sheared(sides, aspect, shear, rows, zigzag)
    assert np.degrees(np.arcsin(np.abs(wall.flat[:, 2]).max())) == pytest.approx(lean, abs=0.2)
    radial = unit((wall.xy[wall.simplices] * [1.0, 1.0, 0.0]).reshape(-1, 3))
    assert np.linalg.norm(wall.fans.reshape(-1, 3) - radial, axis=1).max() < 0.006


def test_gaps_of_a_face_are_those_of_its_arcs_where_facets_lean():
    """A bush of another mesh, 0.001 wider than a wall whose facets lean by 28 degrees; gaps were off by up to 0.0021."""
    wall = sheared(12, 0.03, 0.2, 8)
    mesh = solids.grid((1, 17, 2))
    radius, angle, z = mesh.points.T
    radius, angle = 1.001 + 0.3 * radius, np.pi / 2.0 * (1.4 * angle - 0.2)
    points = [radius * np.cos(angle), radius * np.sin(angle), wall.xy[:, 2].max() * z]
    bush = side(Mesh(np.stack(points, axis=1), mesh.triangles, mesh.groups), "left", body="bush")
    for slave, most in (("bush", 2e-5), ("wall", 1.4e-4)):  # 1 / cos 28°
        assert mortar(bush, wall, NoFriction(), "seam", slave=slave).gap == pytest.approx(
            1e-3, abs=most
        )


@pytest.mark.parametrize("turn", [45.0, 60.0, 90.0])
@pytest.mark.parametrize(("per", "rows", "width"), [(1, 1, 0.02), (1, 2, 1.0), (2, 3, 0.2)])
def test_edges_of_a_prism_stay_sharp(turn, per, rows, width):
    """Edges of a polygon are on a circle as well, but it turns as much as the facets do; here they are bent along."""
    mesh, turns = solids.grid((1, 3 * per, rows)), np.radians(turn) * np.arange(3)
    path = np.append([0.0], np.cumsum(np.exp(1j * turns) * 1j))
    radius, along, z = mesh.points.T * [[0.3], [3.0], [width]]
    wall = np.interp(along, range(4), path.real) + 1j * np.interp(along, range(4), path.imag)
    middle = wall.mean()
    points = middle + (0.7 + radius) * (wall - middle)
    points = np.stack([points.real, points.imag + 0.05 * z * z, z], axis=1)
    prism = side(Mesh(points, mesh.triangles, mesh.groups), "right")
    own = np.einsum("fd,fcd->fc", prism.flat, prism.fans)
    assert own.min() > np.cos(np.radians(0.1 * turn + 10.0 * width))


@pytest.mark.every(5)
@pytest.mark.parametrize("rows", [1, 2, 8])
@pytest.mark.parametrize("aspect", [0.05, 1.0, 5.0, 30.0])
def test_normals_of_a_cylinder_do_not_depend_on_its_axis_and_slender_facets(rows, aspect):
    """Facets of 7.5 degrees, and of `aspect` arcs along the axis, wherever that points, each row of long ones by half an
    arc further. They were off by up to 10 degrees."""
    off = []
    for axis in ([0.0, 0.0, 1.0], [0.3, -0.5, 0.81], [0.58, 0.57, -0.58]):
        mesh, turn = solids.grid((1, 12, rows)), np.linalg.svd([axis])[2]
        radius, angle, z = mesh.points.T * [[0.3], [np.pi / 2.0], [np.pi / 24.0 * aspect * rows]]
        angle = angle + 0.5 * z / max(aspect, 1.0)
        points = np.stack(
            [(0.7 + radius) * np.cos(angle), (0.7 + radius) * np.sin(angle), z], axis=1
        )
        turn = turn[[1, 2, 0]] * [[np.linalg.det(turn)], [1.0], [1.0]]
        wall = side(Mesh(points @ turn, mesh.triangles, mesh.groups), "right")
        radial = unit((wall.xy[wall.simplices] @ turn.T * [1.0, 1.0, 0.0]).reshape(-1, 3))
        off.append(np.abs(wall.fans.reshape(-1, 3) @ turn.T - radial).max())
    assert max(off) < 0.008


@pytest.mark.parametrize("rise", [0.0, 0.4])
def test_areas_of_curved_facets_in_space_are_those_of_the_surface(rise):
    """A top of the height 1 + c x (1 − x), c the rise, has the area ∫ (1 + c² (1 − 2x)²)^½ dx."""
    vault, roof = (
        box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2, 2, 1), 2),
        box((-1.0, 0.0, 1.5), (3.0, 1.0, 1.0), (4, 3, 1)),
    )
    x, _, z = vault.points.T
    vault.points[:, 2] += rise * x * (1.0 - x) * z
    over = cover(side(vault, "top"), side(roof, "bottom"))
    t, weights = np.polynomial.legendre.leggauss(20)
    assert over.weight.sum() == pytest.approx(
        weights @ np.sqrt(1.0 + (rise * t) ** 2) / 2, rel=1e-4
    )


def test_single_curved_side_has_its_own_slopes():
    """A curved side between two corners is its own arc: nothing else says what is meant."""
    mesh = rectangle((1, 1), (1.0, 1.0), order=2)
    bends = np.zeros((2, 3, 2))
    bends[np.isin(mesh.triangles[:, 3:], mesh.groups["top"][:, 2])] = [0.0, 0.05]
    boundary = side(bend(mesh, bends), "top")
    assert boundary.slopes == pytest.approx(np.full((1, 2), np.arctan(0.2)))
    here, up = np.array([0]), np.array([[0.0, 1.0]])
    assert boundary.bulge(here, np.array([0.5]), up) == pytest.approx(0.05, rel=0.02)
    assert boundary.rise(boundary.facets[here, 2], up) == pytest.approx(0.0, abs=1e-3)
    assert side(raise_order(rectangle((1, 1), (1.0, 1.0)), "mesh"), "top").slopes.tolist() == [
        [0.0, 0.0]
    ]


def test_a_curved_triangle_meets_its_corners():
    """However coordinates round there, the boundary that is meant goes through the corners of a ball's facets."""
    ball = SimpleNamespace(
        xy=np.eye(3),
        simplices=np.arange(3)[None],
        flat=np.full((1, 3), 3**-0.5),
        fans=np.eye(3)[None],
    )
    at = np.array(
        [[1.0, -3e-16, 2e-16], [2e-16, 1.0, -4e-16], [-1e-16, -1e-16, 1.0], [0.5, 0.5, -1e-17]]
    )
    off = Patch.bulge(ball, np.zeros(4, int), at, np.tile(np.full(3, 3**-0.5), (4, 1)))
    assert np.abs(off[:3]).max() < 1e-15
    assert off[3] == pytest.approx(np.sqrt(5 / 6) - np.sqrt(1 / 3), rel=1e-12)


def test_neighbours_have_nearly_the_same_tangents():
    """Over a cap of 120° tangents turn no faster than normals do."""
    angle = np.linspace(-np.pi / 3, np.pi / 3, 60)
    normals = np.column_stack([np.sin(angle), 0.3 * np.sin(2 * angle), np.cos(angle)])
    found = frames(unit(normals))
    assert np.abs(np.diff(found, axis=0)).max() < 2.0 * np.abs(np.diff(unit(normals), axis=0)).max()
