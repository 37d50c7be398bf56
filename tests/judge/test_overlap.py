"""Bodies that run through each other: found wherever it is, and never where bodies only touch."""

import numpy as np
import pytest

from ddmpi.judge.overlap import Outline, run_through, through_itself
from ddmpi.mesh.boundary import outline
from ddmpi.mesh.build import generate_rectangle
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.scene.bodies import MeshSpec

NO_PAIRS = np.empty((2, 0), int), np.empty((0, 2))


def rectangle(origin, size, divisions=(4, 4)) -> Mesh:
    return generate_rectangle(MeshSpec(shape="rectangle", origin=origin, size=size, divisions=divisions))


def of(mesh: Mesh, motion=(0.0, 0.0)) -> Outline:
    edges = outline(mesh)
    nodes = np.unique(edges)
    at = mesh.points[nodes]
    moved = at + (motion(at) if callable(motion) else np.array(motion))
    return Outline(at, moved, np.searchsorted(nodes, edges))


def polygon(points) -> Outline:
    """A body with this boundary, counter-clockwise."""
    at, numbers = np.asarray(points, float), np.arange(len(points))
    return Outline(at, at, np.column_stack([numbers, np.roll(numbers, -1)]))


def arc(radius: float, start: float, stop: float, n: int) -> np.ndarray:
    angle = np.linspace(start, stop, n)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def paired(first: Outline, second: Outline, y: float, normal=(0.0, -1.0)) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of nodes with the same x on the lines at `y` as drawn."""
    places = [np.flatnonzero(np.abs(each.at[:, 1] - y) < 0.02) for each in (first, second)]
    pairs = np.array([place[np.argsort(each.at[place, 0])]
                      for place, each in zip(places, (first, second), strict=True)])
    return pairs, np.tile(normal, (pairs.shape[1], 1))


@pytest.mark.parametrize("order", [1, 2])
def test_an_outline_has_the_body_to_its_left(order):
    """Its area by the formula of Gauss is that of the body; middles of quadratic sides are on it."""
    mesh = rectangle((1.0, 2.0), (3.0, 1.0), (6, 2))
    body = of(mesh if order == 1 else raise_order(mesh, "mesh"))
    (x, y), (X, Y) = body.at[body.segments].transpose(1, 2, 0)
    assert len(body.segments) == len(body.at) == 16 * order
    assert (x * Y - X * y).sum() / 2 == pytest.approx(3.0)


DEEP = {
    "corner in corner": (rectangle((0.5, 0.5), (1, 1)), 0.5),
    "inside": (rectangle((0.4, 0.3), (0.2, 0.2)), 0.5),
    "around": (rectangle((-1, -1), (3, 3), (2, 2)), 1.0 + 0.25 / 4),  # of places a quarter of a segment inward
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
    overlap, drawn = run_through(*(bodies[::-1] if swapped else bodies), *NO_PAIRS)
    assert overlap.depth == drawn == pytest.approx(depth, rel=1e-9)


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
    overlap, drawn = run_through(of(rectangle(origin, size)), of(other), *NO_PAIRS)
    assert (overlap.depth, drawn) == (0.0, 0.0)


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_the_sagitta_of_a_curve_is_no_overlap(phase):
    """A disc in a hole of the same radius, their nodes apart; what is more than twice the hole's own sagitta is one."""
    hole = arc(1.0, 2 * np.pi, 0.0, 41)[:-1]
    ring = np.concatenate([hole, 2.0 * hole[::-1]])
    numbers = np.arange(40)
    ring = Outline(ring, ring, np.concatenate([np.column_stack([k + numbers, k + np.roll(numbers, -1)])
                                               for k in (0, 40)]))
    sagitta = 1.0 - np.cos(np.pi / 40)
    assert run_through(polygon(arc(1.0, phase, phase + 2 * np.pi, 31)[:-1]), ring, *NO_PAIRS)[0].depth == 0.0
    for depth in (3.3 * sagitta, 10 * sagitta):
        disc = polygon(arc(1.0 + depth, phase, phase + 2 * np.pi, 31)[:-1])
        assert run_through(disc, ring, *NO_PAIRS)[0].depth == pytest.approx(depth, abs=sagitta)


def test_a_roller_near_a_flat_is_no_overlap():
    roller = polygon(arc(1.0, 0.0, 2 * np.pi, 61)[:-1] + np.array([0.0, 1.0]))
    assert run_through(roller, of(rectangle((-2, -1), (4, 1), (33, 4))), *NO_PAIRS)[0].depth == 0.0


def test_a_contact_that_closes_is_no_overlap():
    """Its nodes are kept apart by the contact, where they slide along a wavy surface too."""
    def wave(at: np.ndarray) -> np.ndarray:
        return 1e-3 * np.column_stack([np.sin(3 * at[:, 0]), np.sin(7 * at[:, 0])])

    lower = of(rectangle((0, 0), (3, 1), (12, 4)), wave)
    upper = of(rectangle((0, 1.01), (3, 1), (12, 4)), lambda at: wave(at) + np.array([1e-3, -0.01]))
    assert run_through(upper, lower, *paired(upper, lower, 1.0))[0].depth == 0.0
    assert run_through(upper, lower, *NO_PAIRS)[0].depth == 0.0  # a slip times a slope is of second order
    deeper = of(rectangle((0, 1.01), (3, 1), (12, 4)), (0.0, -0.02))
    assert run_through(deeper, of(rectangle((0, 0), (3, 1), (12, 4))), *NO_PAIRS)[0].depth == pytest.approx(0.01)


def test_a_paired_node_in_another_part_of_the_partner_is_found():
    """A pair keeps two nodes apart, not the rest of the bodies: lifted, the upper one runs into a roof."""
    upper = of(rectangle((0, 1), (1, 0.1)), (0.0, 0.15))
    lower = polygon([(0, 0), (3, 0), (3, 1.4), (-1, 1.4), (-1, 1.2), (2, 1.2), (2, 0.9), (1, 1), (0.75, 1), (0.5, 1),
                     (0.25, 1), (0, 1)])
    overlap, drawn = run_through(upper, lower, *paired(upper, lower, 1.0))
    assert (overlap.depth, drawn) == (pytest.approx(0.05), 0.0)


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_overlaps_by_the_load_are_found_whatever_the_units(size):
    wall = of(rectangle((size, 0), (size, size)))
    block = of(rectangle((0, 0), (size, size)), lambda at: 1e-5 * at * (1.0, 0.0))
    overlap, drawn = run_through(block, wall, *NO_PAIRS)
    assert (overlap.depth, drawn) == (pytest.approx(1e-5 * size), 0.0)


def test_a_body_that_has_passed_a_thin_one_is_found():
    """In the end they are apart again."""
    rod, block = of(rectangle((1.02, 0), (0.01, 1), (1, 50))), of(rectangle((0, 0.2), (1, 0.5)), (0.1, 0.0))
    assert run_through(block, rod, *NO_PAIRS)[0].depth > 0.003


def test_displacements_that_mean_nothing_leave_the_drawing():
    """Of an answer that diverged, nothing is said, and nothing breaks."""
    fixed, apart = of(rectangle((0, 0), (1, 1))), rectangle((1, 0), (1, 1))
    for size in (np.nan, np.inf, 1e300):
        assert run_through(fixed, of(apart, (size, 0.0)), *NO_PAIRS)[0].depth == 0.0


@pytest.mark.parametrize(("turn", "closed"), [(0.0, False), (0.05, False), (0.2, True), (-0.2, False)])
@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_a_clip_that_closes_through_itself_is_found(turn, closed, scale):
    """The upper arm of a C is turned down by an angle; sides that touch as drawn, at its root, do not count."""
    corners = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 1.4], [4, 1.4], [4, 2.4], [0, 2.4]], float) * scale
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    at = np.concatenate([a + np.arange(n)[:, None] / n * (b - a)
                         for n, (a, b) in zip((8, 3, 13, 1, 7, 2, 9, 5), sides, strict=True)])
    root, (c, s) = np.array([0.5, 1.9]) * scale, (np.cos(turn), np.sin(turn))
    upper = (at[:, 1] > 1.2 * scale) & (at[:, 0] > 0.9 * scale)
    moved = np.where(upper[:, None], root + (at - root) @ np.array([[c, -s], [s, c]]), at)
    numbers = np.arange(len(at))
    place = through_itself(Outline(at, moved, np.column_stack([numbers, np.roll(numbers, -1)])))
    assert (place is not None) == closed
    if closed:
        assert 0.9 * scale < place[0] < 4.1 * scale and 0.5 * scale < place[1] < 1.5 * scale
