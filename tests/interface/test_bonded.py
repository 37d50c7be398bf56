"""Bonded contacts: what they hold, where, and that nothing opens or slips in them."""

import numpy as np
import pytest
from boundaries import (
    body_side,
    compliance,
    elastic,
    held_beside,
    pair,
    rectangle,
    respond,
    side,
    touch,
    uncovered_profile,
)
from scenes import seldom
from test_interface import blocks

import ddmpi
from ddmpi.interface.law import BondedLaw
from ddmpi.interface.trace import trace
from ddmpi.methods.krylov import Linearised
from ddmpi.scene.bodies import Clamp
from ddmpi.scene.contacts import Coulomb, NoFriction, Plane, Profile

LAW = BondedLaw(4, np.array([0, 2, 3]), 1)


def points(size: int) -> np.ndarray:
    return np.random.default_rng(3).standard_normal((10, size))


def bonded(upper, lower, **arguments):
    return pair(upper, lower, NoFriction(), "seam", kind="bonded", **arguments)


def test_all_nodes_are_closed_and_stick_whatever_the_forces():
    """s − P(s − c r) = c r: whatever the forces, the gaps must vanish; none reaches a bound."""
    for s, r in zip(points(7), points(7)[::-1], strict=True):
        assert s - LAW.project(s - 2.0 * r) == pytest.approx(2.0 * r)
        active = LAW.active_set(s)
        assert active.closed.all() and not active.slip.any() and LAW.closed(s, 0.5).all()
        assert (
            LAW.settle(s, active).tolist() == s.tolist()
            and active.pressure.tolist() == s[:4].tolist()
        )
        linear = Linearised.of(LAW.linearise(active))
        assert (
            linear.number == 7
            and not linear.given.any()
            and linear.expand(s).tolist() == s.tolist()
        )
    for s in (np.zeros(7), np.full(7, 1e300), -np.full(7, 1e300)):
        assert not LAW.reaches_bound(s, LAW.bound_at(s)).any()
    box = LAW.cone(LAW.bound_at(np.zeros(7)))
    assert not np.isfinite([box.lower, box.upper]).any() and len(box.lower) == 7


def test_a_bond_holds_along_the_contact_too():
    """All nodes carry tangential unknowns without a friction law, but those that clamps hold."""
    upper, lower = blocks()
    contact = bonded(side(upper, "bottom"), side(lower, "top"))
    assert (contact.m, contact.size, contact.law.name) == (7, 14, "bonded")
    left = {"where": lambda x, y: x == 0.0, "x": True}
    contact = bonded(side(upper, "bottom", **left), side(lower, "top", **left))
    assert contact.sliding.tolist() == [1, 2, 3, 4, 5, 6]
    left["y"] = True
    contact = bonded(side(upper, "bottom", **left), side(lower, "top", **left))
    assert (contact.m, contact.size, len(contact.fixed.gap)) == (6, 12, 1)


def test_a_roller_along_the_normal_does_not_break_the_bond():
    """A node that both bodies hold along the normal may still slide; a bond holds it, friction cannot."""
    upper, lower = blocks()
    sides = [
        side(mesh, group, where=lambda x, y: x == 0.0, y=True)
        for mesh, group in ((upper, "bottom"), (lower, "top"))
    ]
    assert (bonded(*sides).m, len(bonded(*sides).fixed.gap)) == (7, 0)
    assert held_beside(bonded(*sides)) == pytest.approx(0.0, abs=1e-12)
    assert pair(*sides, Coulomb(coefficient=0.3), "seam").m == 6


@pytest.mark.parametrize("kind", ["unilateral", "bonded"])
def test_a_given_gap_takes_the_place_of_the_measured_one(kind):
    """A number or a profile with signs, at nodes without unknowns as well."""
    upper, lower = blocks(1e-3)
    left = {"where": lambda x, y: x == 0.0, "x": True, "y": True}
    sides = side(upper, "bottom", **left), side(lower, "top", **left)
    profile = Profile(along="x", points=[0.0, 3.0], values=[-3e-4, 3e-4])
    contact = pair(*sides, NoFriction(), "seam", gap=profile, kind=kind)
    assert contact.gap == pytest.approx(-3e-4 + 2e-4 * contact.xy[:, 0])
    assert contact.fixed.gap == pytest.approx([-3e-4])
    assert pair(*sides, NoFriction(), "seam", gap=-1e-5, kind=kind).gap.tolist() == [-1e-5] * 6
    assert pair(*sides, NoFriction(), "seam", gap=0.0, kind=kind).gap.tolist() == [0.0] * 6
    assert uncovered_profile(contact, NoFriction(), profile) == []
    short = Profile(along="x", points=[0.0, 2.0], values=[0.0, 1e-4])
    assert (
        "contact.seam.gap: the profile covers x from 0 to 2"
        in uncovered_profile(contact, NoFriction(), short)[0]
    )


def test_a_body_bonded_to_a_moving_floor_moves_as_if_clamped_to_it():
    """The displacement of a rigid partner acts like a prescribed one of the body's nodes, sign and all."""
    mesh, (ux, uy) = rectangle((4, 3), (2.0, 1.0)), (3e-3, -2e-3)
    expected = respond(elastic(mesh, ["top", Clamp(on="bottom", x=ux, y=uy)]))
    body = elastic(mesh, ["top"])
    floor = Plane(name="floor", point=(0.0, 0.0), normal=(0.0, 1.0), displacement=(ux, uy))
    contact = touch(body_side(mesh, body, "bottom"), floor, NoFriction(), "seam", kind="bonded")
    B = trace(contact, 0, body).toarray()
    assert not contact.gap.any()
    s = np.linalg.solve(compliance(body, B), contact.prescribed)
    assert respond(body, -B.T @ s) == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


def beam(cells: int, parts: int) -> dict:
    """A beam of two cubes of quadratic tetrahedra, bent and twisted; of one part, or of two that are bonded."""
    bodies = [
        {
            "name": name,
            "mesh": {
                "shape": "box",
                "origin": [x, 0.0, 0.0],
                "size": [2.0 / parts, 1.0, 1.0],
                "divisions": [2 * cells // parts, cells, cells],
                "order": 2,
            },
            "material": {"young": 2e11, "poisson": 0.3},
        }
        for name, x in (("one", 0.0), ("other", 1.0))[:parts]
    ]
    bodies[0]["clamp"] = ["left"]
    bodies[-1]["traction"] = [{"on": "right", "value": ["1e6", "2e6 * z", "-3e6 * y"]}]
    bond = {"bodies": ["one", "other"], "on": ["right", "left"], "kind": "bonded"}
    contacts = {"contact": [bond], "method": {"tolerance": 1e-10}} if parts > 1 else {}
    return {"body": bodies, "output": {"figures": False}} | contacts


@pytest.mark.parametrize("cells", [2, seldom(3)])
def test_a_body_of_quadratic_tetrahedra_that_is_cut_by_a_bond_is_the_whole_one(cells):
    """Matching meshes are glued at all six nodes of a facet: displacements are those of one body, to 1e-9."""
    whole, cut = (ddmpi.solve(beam(cells, parts)) for parts in (1, 2))
    assert cut.certified, cut.reason
    exact = whole.bodies["one"]
    place = {
        tuple(at): u
        for at, u in zip(exact.points.round(9).tolist(), exact.displacement, strict=True)
    }
    size = np.abs(exact.displacement).max()
    for body in cut.bodies.values():
        u = np.array([place[tuple(at)] for at in body.points.round(9).tolist()])
        assert np.abs(body.displacement - u).max() <= 1e-9 * size
    contact = cut.contacts["one-other"]
    assert contact.interface.m == (2 * cells + 1) ** 2
    assert contact.interface.area.sum() == pytest.approx(1.0) and contact.interface.area.min() > 0.0


@pytest.mark.slow
def test_a_body_that_is_cut_into_four_is_the_whole_one():
    """Also where four bonds meet along an edge, whose ties say one thing twice; with fewer products than the rows at
    vertices took, 58 a body."""

    def box(name: str, origin: list[float], count: int) -> dict:
        size, cells = [float(count), 1.0, float(count)], [2 * count, 2, 2 * count]
        mesh = {"shape": "box", "origin": origin, "size": size, "divisions": cells, "order": 2}
        made = {"name": name, "mesh": mesh, "material": {"young": 2e11, "poisson": 0.3}}
        pressed = [{"on": "top", "value": [1e6, 0.5e6, -2e6]}]
        low, top = origin[2] == 0.0, origin[2] + count == 2.0
        return made | {"clamp": ["bottom"] if low else [], "traction": pressed if top else []}

    places = {
        "b0": [0.0, 0.0, 0.0],
        "b1": [1.0, 0.0, 0.0],
        "b2": [0.0, 0.0, 1.0],
        "b3": [1.0, 0.0, 1.0],
    }
    aside, above = ["right", "left"], ["bottom", "top"]
    bonds = [("b0", "b1", aside), ("b2", "b3", aside), ("b2", "b0", above), ("b3", "b1", above)]
    contacts = [{"bodies": [a, b], "on": on, "kind": "bonded"} for a, b, on in bonds]
    boxes = [box(name, at, 1) for name, at in places.items()]
    method = {"method": {"tolerance": 1e-11}}
    cut = ddmpi.solve({"body": boxes, "contact": contacts} | method)
    whole = ddmpi.solve({"body": [box("whole", [0.0, 0.0, 0.0], 2)]})
    assert cut.certified, cut.reason
    exact = whole.bodies["whole"]
    place = dict(zip(map(tuple, exact.points.round(9)), exact.displacement, strict=True))
    size = np.abs(exact.displacement).max()
    for body in cut.bodies.values():
        u = np.array([place[tuple(at)] for at in body.points.round(9)])
        assert np.abs(body.displacement - u).max() <= 1e-9 * size
    loose = ddmpi.solve({"body": boxes, "contact": contacts}).summary["bodies"].values()
    assert np.mean([body["n_A_by_purpose"]["newton"] for body in loose]) <= 0.8 * 58


@pytest.mark.parametrize(("elements", "rows"), [({}, 25), ({"elements": "bricks"}, 21)])
def test_a_constant_stress_goes_through_a_bond_of_quadratic_solids(elements, rows):
    """Also where the larger side goes on beside it: all nodes bear the same pressure, as rows have areas."""
    keys = {"order": 2, "shape": "box"} | elements
    steel = {"young": 2e11, "poisson": 0.0}
    lower = {
        "name": "lower",
        "material": steel,
        "mesh": keys | {"origin": [0, 0, 0], "size": [2, 1, 1], "divisions": [4, 2, 2]},
        "clamp": [
            {"on": on, axis: 0.0}
            for on, axis in zip(("left", "front", "bottom"), "xyz", strict=True)
        ],
        "traction": [{"on": "top", "value": ["0", "0", "-2e6 * (x >= 1)"]}],
    }
    upper = {
        "name": "upper",
        "material": steel,
        "mesh": keys | {"origin": [0, 0, 1], "size": [1, 1, 1], "divisions": [2, 2, 2]},
        "traction": [{"on": "top", "pressure": 2e6}],
    }
    bond = {"bodies": ["lower", "upper"], "on": ["top", "bottom"], "kind": "bonded"}
    scene = {"body": [lower, upper], "contact": [bond], "output": {"figures": False}}
    answer = ddmpi.solve(scene)
    assert answer.certified, answer.reason
    contact = answer.contacts["lower-upper"]
    assert contact.interface.m == rows
    assert contact.pressure == pytest.approx(np.full(rows, 2e6), rel=1e-6)
