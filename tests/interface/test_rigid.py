"""Contact with a rigid surface: gaps and directions of planes and circles, what faces them, how they move."""

import numpy as np
import pytest
from boundaries import held_beside, joined, rectangle, ring, side, touch

from ddmpi.errors import InputError
from ddmpi.interface.interface import check_overlap
from ddmpi.interface.trace import displacement_trace
from ddmpi.scene.contacts import Circle, Coulomb, NoFriction, Plane, Profile

COULOMB = Coulomb(coefficient=0.3)
FLOOR = Plane(name="floor", point=(7.0, 0.0), normal=(0.0, 2.0))


def block(divisions=(6, 2), size=(3.0, 1.0), origin=(0.0, 0.0), order=1):
    return rectangle(divisions, size, origin, order)


def circle_of(n: int, graded: bool) -> np.ndarray:
    t = 2 * np.pi * np.arange(n) / n
    return t + 0.3 * np.sin(t) if graded else t


def refused(*arguments) -> str:
    with pytest.raises(InputError) as error:
        touch(*arguments)
    assert str(error.value).startswith("contact.seam: ")
    return str(error.value)


# Planes


@pytest.mark.parametrize("order", [1, 2])
def test_a_block_above_a_floor(order):
    """The gap is the distance from the plane, the directions are the body's, the lengths its own."""
    boundary = side(block(origin=(0.0, 0.25), order=order), "bottom")
    contact = touch(boundary, FLOOR, COULOMB, "seam")
    assert contact.bodies == ("body", "floor")
    assert contact.gap == pytest.approx(np.full(contact.m, 0.25), rel=1e-14)
    assert np.array_equal(contact.normal, np.tile([0.0, -1.0], (contact.m, 1)))
    assert np.array_equal(contact.tangents[:, 0], np.tile([1.0, 0.0], (contact.m, 1)))
    assert contact.area == pytest.approx(boundary.area, rel=1e-14)
    assert np.array_equal(contact.rows.nodes[0], boundary.nodes) and len(contact.rows.nodes[1]) == 0
    assert contact.rows.transfer[1].shape == (contact.m, 0)
    assert contact.modulus == boundary.modulus
    assert contact.one_sided.all() and joined(contact).all()
    assert (contact.size, contact.law.name) == (2 * contact.m, "coulomb")
    assert len(contact.geometry.facets) == 6


def test_rounding_is_no_gap():
    assert not touch(side(block(origin=(0.0, 1e-13)), "bottom"), FLOOR, COULOMB, "seam").gap.any()


def test_a_boundary_that_does_not_face_the_surface_is_refused():
    text = refused(side(block(), "top"), FLOOR, COULOMB, "seam")
    assert (
        "near (0, 1) the boundary of 'body' does not face 'floor'; a plane's normal points towards the"
        in text
    )
    refused(side(block(), "left"), FLOOR, COULOMB, "seam")
    arch = ring(0.5, 1.0, np.radians([30.0, 60.0, 90.0, 110.0]), closed=False)
    assert "near (0.866025, 0.5) the" in refused(side(arch, "outer"), FLOOR, COULOMB, "seam")
    refused(
        side(block(), "bottom"),
        Plane(name="floor", point=(0.0, 0.0), normal=(0.0, -1.0)),
        COULOMB,
        "seam",
    )


def test_what_does_not_face_the_surface_carries_no_row():
    """A flat bottom keeps its corner, whose averaged normal looks aside, and its own length there."""
    boundary = side(block((6, 2), (0.6, 2.0)), "bottom", "left")
    assert np.abs(boundary.normal[:, 1]).min() < 0.5
    contact = touch(boundary, FLOOR, COULOMB, "seam")
    assert sorted(contact.xy[:, 0].tolist()) == pytest.approx(np.linspace(0.0, 0.6, 7).tolist())
    assert not contact.xy[:, 1].any()
    assert contact.area[np.argmin(contact.xy[:, 0])] == pytest.approx(0.05)
    assert len(contact.fixed.gap) == 0


def test_a_body_behind_the_surface_is_refused():
    """Deeper than its own depth a body cannot be meant to lie in a rigid partner; a large overlap is worth a word."""
    for origin, fits in ((-1.0, False), (-1.5, False), (-0.5, True), (0.0, True)):
        boundary = side(block(origin=(0.0, origin)), "bottom")
        contact = touch(boundary, FLOOR, COULOMB, "seam")
        if fits:
            warnings = check_overlap(contact, boundary)
            assert len(warnings) == (origin < 0.0)
            assert not warnings or "50.0% of the body's depth" in warnings[0]
        else:
            with pytest.raises(
                InputError, match=r"'body' lies .* deep in 'floor', more than its depth of 1"
            ):
                check_overlap(contact, boundary)
    small = side(block((4, 4), (0.2, 0.2), (0.0, 0.5)), "bottom")
    with pytest.raises(InputError, match="turned the wrong way"):
        check_overlap(
            touch(small, Circle(name="disc", center=(0.1, 0.0), radius=1.0), COULOMB, "seam"), small
        )


# Circles


def test_the_distance_from_a_disc():
    """A flat block on a roller: exact gaps, and no rows where the flat looks past the roller."""
    disc = Circle(name="roller", center=(1.5, -1.0), radius=0.9)
    contact = touch(side(block((12, 2)), "bottom"), disc, COULOMB, "seam")
    away = contact.xy - [1.5, -1.0]
    distance = np.linalg.norm(away, axis=1)
    assert contact.gap == pytest.approx(distance - 0.9)
    assert contact.normal == pytest.approx(-away / distance[:, None])
    assert contact.gap.min() == pytest.approx(0.1)
    assert contact.m == 13  # 1.5 aside of a centre 1 below: 56°
    small = Circle(name="roller", center=(1.5, -0.5), radius=0.5)
    contact = touch(side(block((12, 2)), "bottom"), small, COULOMB, "seam")
    # Nodes up to 60° face the disc, 0.866 aside.
    assert contact.xy[:, 0] == pytest.approx([0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25])
    assert contact.area == pytest.approx([0.125, *[0.25] * 5, 0.125])
    assert joined(contact).all() and held_beside(contact) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("closed", "graded"), [(True, False), (False, True)])
@pytest.mark.parametrize(
    ("group", "rigid", "gap"),
    [
        ("outer", Circle(name="bore", center=(0.0, 0.0), radius=1.001, inside=True), 0.001),
        ("inner", Circle(name="shaft", center=(0.0, 0.0), radius=0.6), -0.1),
    ],
)
def test_middles_of_straight_sides_stand_off_no_circle(group, rigid, gap, closed, graded):
    """Quadratic sides are chords of the boundary that is meant: the gap of their middles is that of the corners."""
    angles = circle_of(24, graded)[: None if closed else 15]
    mesh = ring(0.5, 1.0, angles, order=2, closed=closed)
    contact = touch(side(mesh, group), rigid, COULOMB, "seam")
    off = np.abs(np.linalg.norm(contact.xy, axis=1) - (1.0 if group == "outer" else 0.5))
    assert off.max() > 1e-3  # what would be measured at the middles
    assert contact.gap == pytest.approx(np.full(contact.m, gap), abs=1e-12)


# Motion and clamps


def test_middles_of_a_flat_stay_where_they_are():
    """Straight boundaries and corners are no curves; at a corner whose mean normal lies across no side leans."""
    disc = Circle(name="roller", center=(1.0, -1.0), radius=1.0)
    contact = touch(
        side(block((4, 2), (2.0, 1.0), order=2), "bottom", "right"), disc, COULOMB, "seam"
    )
    flat = contact.xy[:, 1] == 0.0
    assert flat.sum() == 9
    assert contact.gap[flat] == pytest.approx(
        np.hypot(contact.xy[flat, 0] - 1.0, 1.0) - 1.0, abs=1e-15
    )
    assert np.abs(contact.geometry.tilt).max() < 10.0


def test_a_partner_that_comes_closer_closes_the_gap():
    """It has the sign of the second body's contact displacement."""
    moving = Plane(name="floor", point=(0.0, 0.0), normal=(0.0, 1.0), displacement=(0.2, 0.3))
    contact = touch(side(block(), "bottom"), moving, COULOMB, "seam")
    assert contact.prescribed == pytest.approx(np.repeat([0.3, -0.2], 7))
    both = displacement_trace(contact, 0, np.tile([0.2, 0.3], (21, 1))) + contact.prescribed
    assert both == pytest.approx(np.zeros(14), abs=1e-15)  # they move together
    ring_side = side(ring(0.5, 1.0, circle_of(16, False)), "outer")
    bore = Circle(name="bore", center=(0.0, 0.0), radius=1.0, inside=True, displacement=(0.2, 0.3))
    contact = touch(ring_side, bore, NoFriction(), "seam")
    assert contact.prescribed == pytest.approx(-contact.xy @ [0.2, 0.3])
    assert not touch(side(block(), "bottom"), FLOOR, COULOMB, "seam").prescribed.any()


def test_nodes_that_clamps_hold_along_the_normal_carry_no_row():
    """They keep the gap that they have at first, however the partner moves."""
    moving = Plane(name="floor", point=(0.0, 0.0), normal=(0.0, 1.0), displacement=(0.2, 0.03))
    boundary = side(block(origin=(0.0, 0.01)), "bottom", where=lambda x, y: x == 0.0, y=True)
    contact = touch(boundary, moving, COULOMB, "seam")
    assert (contact.m, len(contact.fixed.gap)) == (6, 1)
    assert contact.gap == pytest.approx(np.full(6, 0.01))
    assert contact.fixed.gap == pytest.approx([0.01]) and len(contact.probes.gap) == 0
    assert len(contact.fixed.nodes[0]) == 1 and len(contact.fixed.nodes[1]) == 0
    assert held_beside(contact) == pytest.approx([2.0, 0, 0, 0, 0, 0], abs=1e-12)
    slope = touch(
        boundary, Plane(name="slope", point=(0.0, 0.0), normal=(0.1, 1.0)), COULOMB, "seam"
    )
    # The node can still move a little along the normal.
    assert len(slope.fixed.gap) == len(slope.probes.gap) == 1
    assert len(slope.probes.nodes[0]) == 1 and len(slope.probes.nodes[1]) == 0
    # A node that is held along the tangent alone keeps its normal row.
    boundary = side(block(), "bottom", where=lambda x, y: x == 0.0, x=True)
    contact = touch(boundary, moving, COULOMB, "seam")
    assert (contact.m, contact.sliding.tolist()) == (7, [1, 2, 3, 4, 5, 6])
    assert "all nodes of the contact are clamped" in refused(
        side(block(), "bottom", where=lambda x, y: y == 0.0, y=True), moving, COULOMB, "seam"
    )


def test_a_given_gap_and_a_bond():
    boundary = side(block(origin=(0.0, 0.25)), "bottom")
    assert touch(boundary, FLOOR, COULOMB, "seam", gap=-1e-3).gap.tolist() == [-1e-3] * 7
    profile = Profile(along="x", points=[0.0, 3.0], values=[-3.0, 3.0])
    assert touch(boundary, FLOOR, COULOMB, "seam", gap=profile).gap == pytest.approx(
        np.linspace(-3.0, 3.0, 7)
    )
    contact = touch(boundary, FLOOR, NoFriction(), "seam", kind="bonded")
    assert (contact.size, contact.law.name, contact.gap.any()) == (14, "bonded", False)
