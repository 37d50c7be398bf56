"""Bodies that penetrate each other: found wherever it is, and never where bodies only touch."""

from dataclasses import replace

import numpy as np
import pytest
import solids
from scenes import seldom

from ddmpi.judge.overlap import Solid, penetrates_itself, penetration
from ddmpi.mesh.boundary import creases
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import MeshSpec
from ddmpi.surface.near import contained, distance_to
from ddmpi.system.numbers import nearest_in


def rectangle(origin, size, divisions=(4, 4)) -> Mesh:
    return generate_rectangle(
        MeshSpec(shape="rectangle", origin=origin, size=size, divisions=divisions)
    )


def of(mesh: Mesh, motion=(0.0, 0.0)) -> Solid:
    at = mesh.points
    return Solid.of(mesh, motion(at) if callable(motion) else np.tile(motion, (len(at), 1)))


def strip(first, second) -> Solid:
    """A body between two closed curves of equally many points, the second to the left of the first."""
    n, k = len(first), np.arange(len(first))
    around = np.roll(k, -1)
    cells = np.concatenate(
        [np.column_stack([k, around, n + around]), np.column_stack([k, n + around, n + k])]
    )
    at = np.concatenate([first, second])
    return Solid.of(Mesh(at, cells, {}), np.zeros_like(at))


def squares(filled, side: float) -> Mesh:
    """A mesh of the squares (i, j) in `filled`, in two triangles each."""
    nodes = {
        at: k
        for k, at in enumerate(
            sorted({(i + a, j + b) for i, j in filled for a in (0, 1) for b in (0, 1)})
        )
    }
    cells = [
        [nodes[i + a, j + b] for a, b in corners]
        for i, j in sorted(filled)
        for corners in (((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 1), (0, 1)))
    ]
    return Mesh(side * np.array(list(nodes), float), np.array(cells), {})


def arc(radius: float, start: float, stop: float, n: int) -> np.ndarray:
    angle = np.linspace(start, stop, n)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def disc(radius: float, phase: float, n: int, center=(0.0, 0.0)) -> Solid:
    at = np.vstack([arc(radius, phase, phase + 2 * np.pi, n + 1)[:-1], np.zeros((1, 2))]) + center
    k = np.arange(n)
    return of(Mesh(at, np.column_stack([k, np.roll(k, -1), np.full(n, n)]), {}))


def through(first: Solid, second: Solid, y: float = np.nan) -> tuple[float, float]:
    """How deep they penetrate each other, and as drawn; contacts keep nodes apart that are drawn at height `y`."""
    kept = np.abs(first.at[:, 1] - y) < 0.02, np.abs(second.at[:, 1] - y) < 0.02
    overlap, drawn = penetration(first, second, kept)
    return overlap.depth, drawn


DEEP = {
    "corner in corner": (rectangle((0.5, 0.5), (1, 1)), 0.5),
    "inside": (rectangle((0.4, 0.3), (0.2, 0.2)), 0.5),
    "around": (
        rectangle((-1, -1), (3, 3), (2, 2)),
        1.0 + 0.25 / 4,
    ),  # of places a quarter of a segment inward
    "the same": (rectangle((0, 0), (1, 1)), 0.0625),
    "thin bar across, no node inside": (rectangle((0.45, -1), (0.1, 3), (1, 1)), 0.45),
    "coarse bar across an edge": (rectangle((0.9, 0.3), (5, 0.1), (1, 1)), 0.1),
}


@pytest.mark.parametrize("name", DEEP)
@pytest.mark.parametrize("swapped", [False, True])
def test_drawn_overlaps_are_found(name, swapped):
    """Whichever of the two has nodes in the other, or none."""
    other, depth = DEEP[name]
    bodies = (of(other), of(rectangle((0, 0), (1, 1))))
    found, drawn = through(*(bodies[::-1] if swapped else bodies))
    assert found == drawn == pytest.approx(depth, rel=1e-9)


TOUCHING = {
    "a corner": (rectangle((1, 1), (1, 1)), (1.0, 1.0)),
    "a corner on an edge": (rectangle((0.5, 1), (1, 1)), (1.0, 1.0)),
    "an edge": (rectangle((1, 0), (1, 1), (3, 7)), (1.0, 1.0)),
    "rounding": (rectangle((1 - 1e-8, 0), (1, 1)), (1.0, 1.0)),
    "far origin": (rectangle((1e6 + 1, 1e6 + 0.3), (1, 1)), (1.0, 1.0)),
}


@pytest.mark.parametrize("name", TOUCHING)
def test_bodies_that_touch_do_not_run_through_each_other(name):
    other, size = TOUCHING[name]
    origin = (1e6, 1e6) if "far" in name else (0, 0)
    assert through(of(rectangle(origin, size)), of(other)) == (0.0, 0.0)


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_the_sagitta_of_a_curve_is_no_overlap(phase):
    """A disc in a hole of the same radius, their nodes apart; what is more than twice the hole's own sagitta is one."""
    hole = arc(1.0, 0.0, 2 * np.pi, 41)[:-1]
    ring = strip(2.0 * hole, hole)
    sagitta = 1.0 - np.cos(np.pi / 40)
    assert through(disc(1.0, phase, 30), ring)[0] == 0.0
    for depth in (3.3 * sagitta, 10 * sagitta):
        assert through(disc(1.0 + depth, phase, 30), ring)[0] == pytest.approx(depth, abs=sagitta)


def test_a_roller_near_a_flat_is_no_overlap():
    assert (
        through(disc(1.0, 0.0, 60, (0.0, 1.0)), of(rectangle((-2, -1), (4, 1), (33, 4))))[0] == 0.0
    )


def test_a_contact_that_closes_is_no_overlap():
    """Its nodes are kept apart by the contact, where they slide along a wavy surface too."""

    def wave(at: np.ndarray) -> np.ndarray:
        return 1e-3 * np.column_stack([np.sin(3 * at[:, 0]), np.sin(7 * at[:, 0])])

    lower = of(rectangle((0, 0), (3, 1), (12, 4)), wave)
    upper = of(rectangle((0, 1.01), (3, 1), (12, 4)), lambda at: wave(at) + np.array([1e-3, -0.01]))
    assert through(upper, lower, 1.0)[0] == 0.0
    assert through(upper, lower)[0] == 0.0  # a slip times a slope is of second order
    deeper = of(rectangle((0, 1.01), (3, 1), (12, 4)), (0.0, -0.02))
    assert through(deeper, of(rectangle((0, 0), (3, 1), (12, 4))))[0] == pytest.approx(0.01)


def test_a_contact_node_in_another_part_of_the_partner_is_found():
    """A contact keeps two boundaries apart, not the rest of the bodies: lifted, the upper one runs into a roof."""
    upper = of(rectangle((0, 1), (1, 0.1)), (0.0, 0.15))
    walls = {(i, j) for i in range(-5, 15) for j in range(7) if j < 5 or j == 6 or i > 10}
    found, drawn = through(upper, of(squares(walls, 0.2)), 1.0)
    assert (found, drawn) == (pytest.approx(0.05), 0.0)


@pytest.mark.parametrize(("side", "depth"), [(0.1, 0.1), (0.02, 0.02), (0.0, 0.0)])
@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_a_contact_node_that_comes_in_beside_the_contact_is_found(side, depth, turn):
    """The corner of a square that stands on its tip, all of it contact nodes, is in the side of a block by `side`, 0.15
    below the contact on its top."""
    block, square = rectangle((0, 0), (1, 1)), rectangle((0, 0), (0.5, 0.5), (2, 2))
    c, s = np.cos(turn), np.sin(turn)
    tip = square.points @ (np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0)) @ [[0, 1], [-1, 0]]
    tip = tip - tip[tip[:, 0].argmin()] + [1.0 - side, 0.85]
    Q = np.array([[c, s], [-s, c]])
    solids_ = [
        of(replace(mesh, points=at @ Q)) for mesh, at in ((block, block.points), (square, tip))
    ]
    kept = np.abs(block.points[:, 1] - 1.0) < 1e-9, np.ones(len(tip), bool)
    for order in (1, -1):
        found = penetration(*solids_[::order], kept[::order])[0]
        assert found.depth == pytest.approx(depth, rel=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_a_body_that_moves_by_more_than_a_side_of_its_is_looked_at(turn):
    """However it lies: by less than the diagonal, in a block that it meets, and within one body."""
    c, s = np.cos(turn), np.sin(turn)
    Q = np.array([[c, s], [-s, c]])
    one, other = (
        replace(each, points=each.points @ Q)
        for each in (rectangle((0, 0), (1, 1)), rectangle((2, 0), (1, 1)))
    )
    moved = np.array([-1.3, 0.0]) @ Q
    found, drawn = penetration(of(one), of(other, moved), [np.zeros(25, bool)] * 2)
    assert (found.depth, drawn) == (pytest.approx(0.3), 0.0)
    number = len(one.points)
    both = Mesh(
        np.concatenate([one.points, other.points]),
        np.concatenate([one.triangles, other.triangles + number]),
        {},
    )
    later = np.arange(2 * number)[:, None] >= number
    assert penetrates_itself(of(both, lambda at: later * moved)).depth == pytest.approx(0.3)


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_overlaps_by_the_load_are_found_whatever_the_units(size):
    wall = of(rectangle((size, 0), (size, size)))
    block = of(rectangle((0, 0), (size, size)), lambda at: 1e-5 * at * (1.0, 0.0))
    assert through(block, wall) == (pytest.approx(1e-5 * size), 0.0)


def test_a_body_that_has_passed_a_thin_one_is_found():
    """In the end they are apart again."""
    rod, block = (
        of(rectangle((1.02, 0), (0.01, 1), (1, 50))),
        of(rectangle((0.9, 0.2), (0.1, 0.5)), (0.15, 0.0)),
    )
    assert through(block, rod)[0] > 0.003


def test_a_thin_body_that_has_passed_another_one_is_found_however_it_bends():
    """Places between are as close as the node that moves most beside the others asks, not the one that moves least."""
    rod = rectangle((1.02, -5.0), (0.01, 10.0), (1, 500))
    bent = of(rod, lambda at: np.outer(1.0 + at[:, 1] / 40.0, (-0.15, 0.0)))
    block = of(rectangle((0.9, 0.2), (0.1, 0.5)))
    assert bent.moved[:, 0].max() < 0.9 < 1.0 < bent.at[:, 0].min()
    assert through(block, bent)[0] > 0.003


def test_displacements_that_mean_nothing_leave_the_drawing():
    """Of an answer that diverged, nothing is said, and nothing breaks."""
    fixed, apart = of(rectangle((0, 0), (1, 1))), rectangle((1, 0), (1, 1))
    for size in (np.nan, np.inf, 1e300):
        assert through(fixed, of(apart, (size, 0.0)))[0] == 0.0


@pytest.mark.parametrize(
    ("turn", "closed"), [(0.0, False), (0.05, False), (0.2, True), (-0.2, False)]
)
@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_a_clip_that_closes_through_itself_is_found(turn, closed, scale):
    """The upper arm of a C is turned down by an angle; sides that touch as drawn, at its root, do not count."""
    mesh = squares(
        {(i, j) for i in range(20) for j in range(12) if i < 5 or j not in (5, 6)}, 0.2 * scale
    )
    root, (c, s) = np.array([0.5, 1.9]) * scale, (np.cos(turn), np.sin(turn))

    def motion(at: np.ndarray) -> np.ndarray:
        upper = (at[:, 1] > 1.3 * scale) & (at[:, 0] > 0.9 * scale)
        return np.where(upper[:, None], root - at + (at - root) @ np.array([[c, -s], [s, c]]), 0.0)

    found = penetrates_itself(of(mesh, motion))
    place = found.place
    assert (found.depth > 0.0) == closed
    if closed:
        assert 0.9 * scale < place[0] < 4.1 * scale and 0.5 * scale < place[1] < 1.5 * scale


@pytest.mark.parametrize(("down", "closed"), [(0.03, True), (0.005, False), (1.5, True)])
def test_a_slot_that_closes_is_found_in_the_cells_at_the_boundary(down, closed):
    """The slot of a C narrows to 0.01 at its tip; by 1.5 it jumps over several cells."""
    mesh = squares({(i, j) for i in range(20) for j in range(12) if i < 5 or j not in (5, 6)}, 0.2)
    bent = np.where(mesh.points[:, 1] > 1.3, np.maximum(mesh.points[:, 0] - 1.0, 0.0) / 3.0, 0.0)[
        :, None
    ] * [0.0, 1.0]
    body = of(replace(mesh, points=mesh.points - 0.39 * bent), lambda _: -down * bent)
    assert (penetrates_itself(body).depth > 0.0) == closed


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("down", [0.1, 0.5, 1.5])
@pytest.mark.parametrize("turn", [0.0, np.deg2rad(37.0)])
def test_the_depth_of_a_body_in_itself_is_the_deepest(down, turn, size):
    """The upper arm of a C, whose slot is 0.4 wide at its root and 0.01 at its tip, is bent into the lower one, which is
    1 wide: to the nearest side of that one by hand, at the middles of facets."""
    mesh = squares({(i, j) for i in range(20) for j in range(12) if i < 5 or j not in (5, 6)}, 0.2)
    part = np.where(mesh.points[:, 1] > 1.3, np.maximum(mesh.points[:, 0] - 1.0, 0.0) / 3.0, 0.0)
    c, s = np.cos(turn), np.sin(turn)
    Q = size * np.array([[c, s], [-s, c]])
    bent = part[:, None] * [0.0, 1.0]
    drawn = replace(mesh, points=(mesh.points - 0.39 * bent) @ Q)
    found = penetrates_itself(of(drawn, lambda _: -down * bent @ Q))
    x = np.arange(1.1, 4.0, 0.2)
    inside = (down + 0.39) * (x - 1.0) / 3.0 - 0.4
    depths = np.minimum(np.minimum(inside, 1.0 - inside), 4.0 - x)
    assert found.depth == pytest.approx(size * depths.max(), rel=1e-9)
    place = size * np.array([x[depths.argmax()], 1.0 - inside[depths.argmax()]])
    assert found.place @ Q.T / size**2 == pytest.approx(place / size, rel=1e-9)


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize(
    ("motion", "depth"),
    [((0.0, -1.0), 1.0), ((1.0, -0.5), 0.5), ((0.0, 1.0), 0.0), ((1.0, 0.0), 0.0)],
)
def test_sides_of_a_seam_that_pass_through_each_other_are_found_at_small_strains(
    motion, depth, size
):
    """Measured against the displacement, a millionth of the body, whatever the units; not where they open or slide."""
    lower, upper = rectangle((0, 0), (2, 1), (8, 4)), rectangle((0, 1), (2, 1), (8, 4))
    points = size * np.concatenate([lower.points, upper.points])
    mesh = Mesh(points, np.concatenate([lower.triangles, upper.triangles + len(lower.points)]), {})
    moved = np.where(np.arange(len(points))[:, None] < len(lower.points), 0.0, motion)
    found = penetrates_itself(of(mesh, lambda at: 1e-6 * size * moved))
    assert found.depth == pytest.approx(1e-6 * size * depth, rel=1e-3)


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e-4, 1e-2])
def test_a_body_that_strains_does_not_penetrate_itself(scale):
    """Neither an L that bends at its inner corner, nor the sides of a crack that opens."""
    mesh = squares({(i, j) for i in range(8) for j in range(8) if i < 4 or j < 4}, 0.25)

    def bent(at: np.ndarray) -> np.ndarray:
        x, y = at.T
        return scale * np.column_stack([-y * x**2, x**3 - y**2])

    assert penetrates_itself(of(mesh, bent)).depth == 0.0
    assert penetrates_itself(of(mesh, lambda at: -bent(at))).depth == 0.0


# In space


def moved_box(origin, size=(1.0, 1.0, 1.0), divisions=(3, 3, 3), order=1) -> Solid:
    mesh = solids.box(divisions, size, order)
    return of(replace(mesh, points=mesh.points + origin), np.zeros(3))


@pytest.mark.parametrize(
    ("origin", "size", "depth"),
    [
        ((0.9, 0.3, 0.3), (1.0, 0.4, 0.4), 0.1),
        ((0.45, -1.0, 0.45), (0.1, 3.0, 0.1), 0.45),
        ((1.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0),
        ((1.0, 1.0, 0.3), (1.0, 1.0, 1.0), 0.0),
        ((0.2, 0.3, 1.0), (0.5, 0.5, 1.0), 0.0),
        ((1.1, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0),
    ],
)
@pytest.mark.parametrize("order", [1, 2])
def test_boxes_that_overlap_in_space(origin, size, depth, order):
    """One in the other, a bar across and no node inside; never where they share a face, an edge or a part of one."""
    first, second = moved_box((0, 0, 0), order=order), moved_box(origin, size, (2, 1, 2), order)
    kept = np.zeros(len(first.at), bool), np.zeros(len(second.at), bool)
    overlap, drawn = penetration(first, second, kept)
    assert drawn == pytest.approx(depth, rel=0.3)
    assert (overlap.depth > 0.0) == (depth > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("flat", [seldom(1.0), seldom(1e-2), 1e-4])
def test_the_nearest_of_flat_facets_is_found(flat):
    """Also of facets ten thousand times as long as high."""
    body = moved_box((0, 0, 0), (1.0, flat, 1.0), (1, 1, 20))
    facets = body.at[body.facets[:, :-1]]
    points = facets.mean(axis=1) + np.array([0.0, 1e-2 * flat, 0.0])
    by_all = np.array(
        [
            np.linalg.norm(nearest_in(np.tile(p, (len(facets), 1)), facets) - p, axis=1)
            for p in points
        ]
    )
    distance, number = distance_to(points, facets)
    assert distance == pytest.approx(by_all.min(axis=1), rel=1e-12, abs=1e-15)
    assert by_all[np.arange(len(points)), number] == pytest.approx(distance, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("dimension", [2, 3])
def test_points_and_the_boxes_that_contain_them(dimension):
    """All pairs, whatever the sizes of the boxes, where points crowd and where many have the same coordinate."""
    rng = np.random.default_rng(dimension)
    points = np.concatenate(
        [
            rng.random((50, dimension)),
            1e-3 * rng.random((50, dimension)),
            rng.integers(0, 3, (30, dimension)) / 2.0,
        ]
    )
    low = rng.random((80, dimension)) * rng.choice([1e-3, 1.0], (80, 1))
    high = low + rng.choice([0.0, 1e-3, 0.1, 1.0], (80, 1))
    low[:30], high[:20] = points[-30:], np.maximum(points[-20:], low[:20])
    pairs = np.argwhere(((low <= points[:, None]) & (points[:, None] <= high)).all(axis=2))
    assert (
        np.unique(np.column_stack(contained(points, low, high)), axis=0).tolist() == pairs.tolist()
    )
    assert (
        contained(points[:0], low, high)[0].size
        == contained(points, low[:0], high[:0])[0].size
        == 0
    )


def test_a_solid_that_is_moved_through_another_is_found():
    """A box that is pushed into its neighbour; kept apart by a contact it may be."""
    first = moved_box((0, 0, 0))
    mesh = solids.box((2, 2, 2))
    second = of(
        replace(mesh, points=mesh.points + np.eye(3)[2]),
        lambda at: -0.2 * (3 - at[:, 2:]) * np.eye(3)[2:],
    )
    kept = np.abs(first.at[:, 2] - 1.0) < 1e-9, np.abs(second.at[:, 2] - 1.0) < 1e-9
    assert penetration(first, second, (0 * kept[0] > 0, 0 * kept[1] > 0))[0].depth > 0.1
    assert penetration(first, second, kept)[0].depth == 0.0


def test_creases_of_a_solid():
    """A box has turns of a quarter at its edges; where a quarter is cut out, the boundary is hollow along one edge."""
    mesh = solids.box((2, 2, 2))
    cells = mesh.triangles[(mesh.points[mesh.triangles].mean(axis=1)[:, :2] < 0.5).any(axis=1)]
    for some, edges, hollow in ((mesh.triangles, 24, 0), (cells, 28, 2)):
        facets = Solid.of(Mesh(mesh.points, some, {}), np.zeros(1)).facets
        found = creases(
            mesh.points, facets[:, :-1], mesh.points[facets[:, 0]] - mesh.points[facets[:, -1]]
        )
        assert (
            np.isclose(np.abs(found.turn), np.pi / 2) | np.isclose(found.turn, 0.0, atol=1e-6)
        ).all()
        assert (np.abs(found.turn) > 1.0).sum() == edges and (found.turn < -1.0).sum() == hollow
        assert not len(found.rim)
        assert (mesh.points[found.nodes[found.turn < -1.0]][:, :, :2] == 0.5).all()
