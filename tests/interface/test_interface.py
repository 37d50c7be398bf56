"""The interface: order, normals and lengths of a side, pairing of two sides, clamped nodes, traces."""

from dataclasses import replace

import numpy as np
import pytest
from boundaries import held_beside, joined, pair, rectangle, ring, side, turned

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.trace import displacement_trace
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.contacts import Coulomb, NoFriction

COULOMB = Coulomb(coefficient=0.3)
LEFT = {"where": lambda x, y: x == 0.0}


def blocks(gap: float = 0.0, aside: float = 0.0, order: int = 1) -> tuple[Mesh, Mesh]:
    """Upper and lower block, 3 × 1 each, six contact edges; different meshes across the height."""
    return rectangle((6, 2), (3.0, 1.0), (aside, 1.0 + gap), order), rectangle(
        (6, 3), (3.0, 1.0), order=order
    )


def interface_of(upper: Mesh, lower: Mesh, friction=COULOMB, *clamps: dict) -> Interface:
    """Of blocks, with clamps of the one and the other."""
    one, other = clamps or ({}, {})
    return pair(side(upper, "bottom", **one), side(lower, "top", **other), friction, "seam")


# One side


@pytest.mark.parametrize(
    ("group", "normal", "component"),
    [
        ("bottom", (0.0, -1.0), 0),
        ("top", (0.0, 1.0), 0),
        ("left", (-1.0, 0.0), 1),
        ("right", (1.0, 0.0), 1),
    ],
)
def test_side_of_a_rectangle(group, normal, component):
    mesh = rectangle((6, 4), (3.0, 1.0))
    boundary = side(mesh, group)
    step, total = (0.5, 3.0) if component == 0 else (0.25, 1.0)
    assert np.array_equal(boundary.xy, mesh.points[boundary.nodes])
    count = round(total / step) + 1
    assert boundary.xy[:, component] == pytest.approx(np.linspace(0.0, total, count), rel=1e-14)
    assert np.array_equal(boundary.normal, np.tile(normal, (count, 1)))
    assert boundary.area[1:-1] == pytest.approx(np.full(count - 2, step), rel=1e-14)
    assert boundary.area[[0, -1]] == pytest.approx([step / 2, step / 2], rel=1e-14)
    assert boundary.area.sum() == pytest.approx(total, rel=1e-14)
    assert np.array_equal(boundary.free, np.tile(np.eye(2), (count, 1, 1)))


def test_side_around_a_corner_averages_normals_by_length():
    mesh = rectangle((3, 4), (3.0, 1.0))  # edges of 1 along x, of 0.25 along y
    boundary = side(mesh, "right", "bottom")
    expected = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 0.25), (3, 0.5), (3, 0.75), (3, 1)]
    assert boundary.xy.tolist() == [list(p) for p in expected]
    assert boundary.normal[3] == pytest.approx(
        np.array([0.25, -1.0]) / np.hypot(0.25, 1.0), rel=1e-14
    )
    assert boundary.area[3] == pytest.approx(0.625, rel=1e-14)
    assert boundary.area.sum() == pytest.approx(4.0, rel=1e-14)


# Pairs


def test_area_and_normal_are_those_of_both_sides():
    """Neither side alone says how long a contact node's share of the contact is, and which way it faces."""
    upper, lower = blocks()
    first, second = side(upper, "bottom"), side(lower, "top")
    turned = np.array([np.sin(0.2), np.cos(0.2)])
    contact = pair(
        first,
        replace(second, area=3.0 * second.area, normal=np.tile(turned, (7, 1))),
        NoFriction(),
        "seam",
    )
    assert contact.area == pytest.approx(2.0 * first.area)
    assert contact.normal == pytest.approx(np.tile([-np.sin(0.1), -np.cos(0.1)], (7, 1)))


@pytest.mark.parametrize("gap", [-1e-3, 5.0])
def test_gap_and_overlap(gap):
    contact = interface_of(*blocks(gap))
    assert contact.gap == pytest.approx(np.full(7, gap), rel=1e-12)
    assert contact.xy[:, 1] == pytest.approx(np.full(7, 1.0 + gap), rel=1e-15)


def test_nodes_may_be_a_little_aside():
    assert interface_of(*blocks(aside=0.001)).m == 7


# Refusals


def one_moved() -> tuple[Mesh, Mesh]:
    upper, lower = blocks()
    lower.points[np.flatnonzero((lower.points == [1.5, 1.0]).all(axis=1)), 0] = 1.6
    return upper, lower


AROUND = 2 * np.pi * np.arange(24) / 24

REFUSED = {
    "numbers": (
        (blocks()[0], rectangle((5, 2), (3.0, 1.0))),
        ("bottom", "top"),
        "7 and 6 nodes;.*match node by node",
    ),
    "one node": (one_moved(), ("bottom", "top"), r"\(1.5, 1\) against \(1.6, 1\)\)"),
    "aside": (
        blocks(aside=0.02),
        ("bottom", "top"),
        r"opposite.*\((\d?.?\d?)2, 1\) against \(\1, 1\)",
    ),
    "far apart": (
        blocks(aside=10.0),
        ("bottom", "top"),
        r"one to one.*\(13, 1\) against \(3, 1\)\)",
    ),
    "backs": ((blocks()[1],) * 2, ("top", "top"), r"near \(0, 1\).*do not face each other"),
    "turned": (
        (ring(2.0, 3.0, AROUND + 0.01), ring(1.0, 2.0, AROUND)),
        ("inner", "outer"),
        "opposite",
    ),
    "held": (blocks(), ("bottom", "top"), "all nodes of the contact are clamped"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_sides_that_do_not_match_are_refused_with_coordinates(case):
    meshes, groups, words = REFUSED[case]
    held = {"where": lambda x, y: y == 1.0, "x": True, "y": True} if case == "held" else {}
    with pytest.raises(InputError, match=rf"contact\.seam: .*{words}"):
        pair(
            *(side(mesh, group, **held) for mesh, group in zip(meshes, groups, strict=True)),
            COULOMB,
            "seam",
        )


# Clamps


def test_clamped_nodes_drop_out():
    contact = interface_of(*blocks(1e-3), COULOMB, *[LEFT | {"x": True, "y": True}] * 2)
    assert (contact.m, contact.size, len(contact.fixed.gap)) == (6, 12, 1)
    assert contact.xy[:, 0] == pytest.approx(np.linspace(0.5, 3.0, 6))
    assert contact.area.sum() == pytest.approx(2.75)
    assert np.array_equal(contact.sliding, np.arange(6))
    assert all(len(x) == 6 for x in (*contact.rows.nodes, contact.tangents, contact.gap))
    assert joined(contact).tolist() == [True] * 5
    assert held_beside(contact) == pytest.approx([1 / 0.5, 0, 0, 0, 0, 0], abs=1e-12)


def test_clamped_node_in_the_middle_parts_its_neighbours():
    contact = interface_of(
        *blocks(), COULOMB, *[{"where": lambda x, y: x == 1.5, "x": True, "y": True}] * 2
    )
    assert joined(contact).tolist() == [True, True, False, True, True]
    assert held_beside(contact) == pytest.approx([0, 0, 2, 2, 0, 0], abs=1e-12)


@pytest.mark.parametrize("which", [0, 1])
def test_node_that_one_body_holds_stays(which):
    """The other body can move there, and must not move into the first."""
    contact = interface_of(
        *blocks(), COULOMB, *(LEFT | {"x": k == which, "y": k == which} for k in (0, 1))
    )
    assert (contact.m, len(contact.fixed.gap), contact.size) == (7, 0, 14)
    assert np.flatnonzero(contact.one_sided).tolist() == [0, 7]
    assert held_beside(contact) == pytest.approx(0.0, abs=1e-12)


def test_roller_across_the_normal_keeps_the_normal_unknown():
    contact = interface_of(*blocks(), COULOMB, *[LEFT | {"x": True}] * 2)
    assert (contact.m, len(contact.fixed.gap), contact.size) == (7, 0, 13)
    assert np.array_equal(contact.sliding, np.arange(1, 7))


@pytest.mark.parametrize(("angle", "kept"), [(0, 7), (40, 7), (50, 6), (90, 6)])
def test_roller_at_an_oblique_contact_keeps_the_nearest_unknown(angle, kept):
    """The blocks turned by `angle`, the end node free along y only; at 0° that is along the normal."""
    meshes, clamps = [], []
    for mesh in blocks():
        corner = (mesh.points == [0.0, 1.0]).all(axis=1)
        meshes.append(turned(mesh, np.deg2rad(angle)))
        clamps.append({"where": lambda x, y, corner=corner: corner, "x": True})
    assert interface_of(*meshes, COULOMB, *clamps).m == kept


def test_displacement_trace_has_the_signs_of_the_slides():
    """Opposite normals and tangents: closing and sliding displacements of the two bodies add up."""
    upper, lower = blocks()
    contact = interface_of(upper, lower)
    down = displacement_trace(contact, 0, np.tile([3.0, -2.0], (len(upper.points), 1)))
    still = displacement_trace(contact, 1, np.tile([3.0, -2.0], (len(lower.points), 1)))
    assert np.array_equal(down, np.repeat([2.0, 3.0], 7))
    assert np.array_equal(still, -down)


def test_quadratic_edges_with_a_node_without_unknowns_are_left_out():
    """A clamped corner takes the edges on its two sides along, a clamped middle its own."""
    for x, left in ((1.5, 4), (1.25, 5)):
        held = {"where": lambda at, y, x=x: at == x, "x": True, "y": True}
        contact = interface_of(*blocks(order=2), COULOMB, held, held)
        assert len(contact.geometry.facets) == left and contact.m == 12
        assert contact.xy[contact.geometry.facets[:, :2]].mean(axis=1) == pytest.approx(
            contact.xy[contact.geometry.facets[:, 2]]
        )
