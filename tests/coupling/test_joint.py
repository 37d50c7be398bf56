"""The joint operator on stand-ins for bodies and exchange: free gaps, sums, and how precise a product is."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from mpi4py import MPI

from ddmpi.coupling.joint import STEERING, Joint, Stays


class AllSeeAll:
    """An exchange between bodies that each take part in all interfaces, on one rank."""

    world = SimpleNamespace(
        allgather=lambda each: [each], Allreduce=lambda here, each, operation: None
    )
    deferred = staticmethod(contextlib.nullcontext)

    def spread(self, x):
        return [x.copy(), x.copy()]

    def total(self, parts, about):
        return np.sum(parts, axis=0)


def joint(asked: list[float]) -> Joint:
    """Of two bodies, which multiply by 1.5 and 2.5, and note the precision that they are asked for."""

    def member(name: str, factor: float, h: float) -> SimpleNamespace:
        def mult(x, y, purpose, relative):
            asked.append(relative)
            y[:] = factor * x

        return SimpleNamespace(
            name=name,
            dear=False,
            G=np.empty((0, 3)),
            mult=mult,
            response=lambda history: (np.full(3, h), np.empty(0)),
        )

    space = SimpleNamespace(
        size=3,
        gap=np.array([0.25, 0.0, 0.0]),
        interfaces=[],
        layers=[],
        norm=lambda x: float(np.linalg.norm(x)),
        softness=lambda s: (0.0 * s, 0.0 * s),
    )
    return Joint([member("upper", 1.5, 0.75), member("lower", 2.5, 1.25)], AllSeeAll(), space)


def test_products_and_free_gaps_are_sums_over_the_bodies():
    operator, x = joint([]), np.array([1.0, 2.0, 3.0])
    assert operator.d.tolist() == [1.75, 2.0, 2.0]
    assert operator.product(x, "newton").tolist() == [4.0, 8.0, 12.0]
    assert x.tolist() == [1.0, 2.0, 3.0]


def test_a_product_that_is_kept_is_as_precise_as_matters():
    """The error may be what is neglected, over the forces; it is never larger than what steers GMRES."""
    asked: list[float] = []
    operator, x = joint(asked), np.array([6.0, 8.0, 0.0])
    operator.neglected = 1e-3
    operator.product(x, "newton")
    operator.product(1e-5 * x, "newton")
    operator.product(0.0 * x, "newton")
    operator.product(x, "newton", 0.5)
    assert asked == [
        value for each in (pytest.approx(1e-4), STEERING, 0.0, 0.5) for value in (each, each)
    ]


def test_the_first_guess_closes_what_a_load_brings_to_touch():
    """A loose block stands on one end of its side: nodes whose gap is below load / E* are closed, others are not."""
    force, slope, moduli = 5e5, 3e-4, ((2e9, 0.3), (3e9, 0.25))
    upper, lower = (
        scenes.rectangle(name, (0.0, y), (4.0, 1.0), (16, 4), young=young, poisson=poisson)
        for name, y, (young, poisson) in zip(("upper", "lower"), (0.0, -1.0), moduli, strict=True)
    )
    upper["traction"] = [{"on": "top", "value": [0.0, -force / 4.0]}]
    lower["clamp"] = ["bottom"]
    gap = {"points": [0.0, 4.0], "values": [0.0, 4.0 * slope]}
    contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "gap": gap}
    assembly = scenes.prepare_scene(MPI.COMM_SELF, {"body": [upper, lower], "contact": [contact]})
    closed, falls = assembly.joint.first_closed()
    reach = force * sum((1.0 - poisson**2) / young for young, poisson in moduli) / slope
    x = scenes.the_interface(assembly).xy[:, 0]
    assert x.min() == 0.0 and 0.5 < reach < 3.5
    assert (closed == (x < reach)).all() and not falls.any()


def test_the_load_of_loose_bodies_is_the_present_one():
    """The sum of all nodal loads, which need no resultant, of histories added up without their signs."""
    block = scenes.rectangle("block", (0.0, 0.0), (4.0, 1.0), (8, 2))
    block["traction"] = [
        {"on": "left", "pressure": 3e5},
        {"on": "right", "pressure": 3e5},
        {"on": "top", "pressure": 2e5, "history": "way"},
        {"on": "bottom", "pressure": 2e5, "history": "way"},
    ]
    scene = {
        "body": [block],
        "history": {"way": {"times": [0.0, 1.0], "factors": [0.0, -0.5]}},
        "time": {"points": [1.0], "steps": 1},
    }
    operator = scenes.prepare_scene(MPI.COMM_SELF, scene).joint
    for factor, way in ((1.0, 1.0), (0.25, -0.5), (1e-9, 0.0)):
        operator.act({None: factor, "way": way})
        assert operator.load == pytest.approx(factor * 6e5 + abs(way) * 16e5)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e7])
def test_a_held_motion_is_driven_by_more_than_its_share_of_a_load(size):
    """Whatever the size of the load, and by none where nothing is held."""
    stays, along, across = Stays(3), np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0])
    stays.share = 0.1
    assert not stays.drives(size * along)
    stays.hold(along[:, None], np.zeros(3))
    for share, driven in ((0.099, False), (0.101, True)):
        load = size * (share * along + np.sqrt(1.0 - share**2) * across)
        assert stays.drives(load) == stays.drives(-load) == driven
