"""What the shapes of rigid partners say of their geometry; a new shape is tested with an example here."""

from typing import get_args

import numpy as np
import pytest

from ddmpi.scene.contacts import Circle, Cylinder, Node, Plane, Rigid, RigidSurface, Sphere
from ddmpi.system.numbers import nearest_in

EXAMPLES = {
    "a plane": Plane(name="wall", point=(1.0, 0.5), normal=(3.0, 4.0)),
    "a disc": Circle(name="disc", center=(0.5, -0.25), radius=0.75),
    "a bore": Circle(name="bore", center=(0.5, -0.25), radius=1.5, inside=True),
    "a plane in space": Plane(name="wall", point=(1.0, 0.5, 0.0), normal=(1.0, 2.0, 2.0)),
    "a ball": Sphere(name="ball", center=(0.5, -0.25, 0.25), radius=0.75),
    "a shaft": Cylinder(name="shaft", point=(0.5, -0.25, 0.25), axis=(1.0, 2.0, -2.0), radius=0.75),
}

STEP = 1e-6


def random_points(shape: RigidSurface, *number: int) -> np.ndarray:
    """In a square or cube around the origin, of the shape's dimension."""
    return np.random.default_rng(27).uniform(
        -2.0, 2.0, (*number, len(getattr(shape, "center", None) or shape.point))
    )


def test_every_shape_has_an_example():
    """But the one that has no surface."""
    surfaces = {shape for shape in get_args(Rigid) if shape.surface}
    assert {type(shape) for shape in EXAMPLES.values()} == surfaces == {*get_args(Rigid)} - {Node}


@pytest.mark.parametrize("shape", EXAMPLES.values(), ids=EXAMPLES)
def test_normals_are_those_of_the_distance(shape):
    """They are its gradient, and lead to the surface."""
    points = random_points(shape, 40)
    normal, distance = shape.facing(points)
    slopes = np.transpose(
        [
            (shape.facing(points + e)[1] - shape.facing(points - e)[1]) / (2 * STEP)
            for e in STEP * np.eye(points.shape[1])
        ]
    )
    assert slopes == pytest.approx(normal, abs=1e-8)
    again, left = shape.facing(points - distance[:, None] * normal)
    assert again == pytest.approx(normal) and left == pytest.approx(np.zeros(40), abs=1e-12)
    assert shape.depth(points[None]) == pytest.approx(-distance[None])


@pytest.mark.parametrize("corners", [2, 3])
@pytest.mark.parametrize("shape", EXAMPLES.values(), ids=EXAMPLES)
def test_no_place_of_a_facet_lies_deeper_than_the_deepest(shape, corners):
    """Where a small partner lies between nodes, too; a facet is a segment in the plane, a triangle in space."""
    facets = random_points(shape, 200, corners)
    places = shape.deepest(facets)
    assert nearest_in(places, facets) == pytest.approx(places)  # they lie in the facets
    part = np.random.default_rng(1).dirichlet(np.ones(corners), 500)
    others = shape.depth(np.einsum("sj,kjd->ksd", part, facets)).max(axis=1)
    assert (others <= shape.depth(places) + 1e-9).all()
    assert not len(shape.deepest(facets[:0]))


@pytest.mark.parametrize("shape", EXAMPLES.values(), ids=EXAMPLES)
def test_normals_turn_as_the_smallest_radius_says(shape):
    points = random_points(shape, 400)
    normal, distance = shape.facing(points)
    at = points - distance[:, None] * normal
    moved = at + 1e-3 * np.roll(normal, 1, axis=1)
    other, aside = shape.facing(moved)
    walk = np.linalg.norm(moved - aside[:, None] * other - at, axis=1)
    turn = np.linalg.norm(other - normal, axis=1)[walk > 1e-5] / walk[walk > 1e-5]
    assert turn.max() == pytest.approx(1.0 / shape.bend, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("name", ["a plane", "a disc", "a bore"])
def test_outlines_lie_on_the_surface_and_reach_past_what_may_touch_it(name):
    shape = EXAMPLES[name]
    touched = np.array([[0.5, -0.85], [0.6, -0.8], [0.7, -0.7]])
    places = shape.outline(touched, touched, 0.1)
    assert shape.depth(places) == pytest.approx(np.zeros(len(places)), abs=1e-12)
    along = (places - places[0]) @ (places[-1] - places[0])
    nearest = touched - shape.facing(touched)[1][:, None] * shape.facing(touched)[0]
    reach = (nearest - places[0]) @ (places[-1] - places[0])
    assert along.min() < reach.min() < reach.max() < along.max()


def test_a_centre_has_no_normal():
    disc = EXAMPLES["a disc"]
    normal, distance = disc.facing(np.array([disc.center]))
    assert not normal.any() and distance == pytest.approx([-disc.radius])
