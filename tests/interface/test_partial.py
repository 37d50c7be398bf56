"""Sides that cover each other partly: which nodes pair off, with what lengths, and what is no contact."""

import numpy as np
import pytest
from boundaries import held_beside, joined, pair, rectangle, ring, side

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.contacts import Coulomb
from ddmpi.surface.side import Side

COULOMB = Coulomb(coefficient=0.3)
orders = pytest.mark.parametrize("order", [1, 2])


def brick(x: float, y: float = 0.0, order: int = 1, divisions=(4, 2), size=(2.0, 1.0)) -> Mesh:
    """2 × 1 on 4 × 2, its lower left corner at (x, y)."""
    return rectangle(divisions, size, (x, y), order)


def met(first: Side, second: Side) -> Interface:
    return pair(first, second, COULOMB, "seam")


def refused(first: Side, second: Side) -> str:
    with pytest.raises(InputError) as error:
        met(first, second)
    return str(error.value)


@orders
def test_a_brick_on_two_bricks(order):
    """Each upper brick carries the part that it covers, and the parts add up to the lower brick's top."""
    lower = side(brick(0.0, order=order), "top")
    contacts = [met(side(brick(x, 1.0, order), "bottom"), lower) for x in (-1.0, 1.0)]
    spacing = 0.5 / order
    for contact, start in zip(contacts, (0.0, 1.0), strict=True):
        assert contact.xy[:, 0] == pytest.approx(np.arange(start, start + 1.01, spacing))
        assert contact.area.sum() == pytest.approx(1.0)
        weights = {1: [0.25, 0.5, 0.25], 2: [0.5 / 6, 2 / 6, 1 / 6, 2 / 6, 0.5 / 6]}[order]
        assert contact.area == pytest.approx(weights)
        assert joined(contact).all() and held_beside(contact) == pytest.approx(0.0, abs=1e-12)
        assert len(contact.fixed.gap) == 0 and not contact.gap.any()
        assert contact.normal == pytest.approx(np.tile([0.0, -1.0], (contact.m, 1)))
        assert len(contact.geometry.facets) == 2
        if order == 2:
            assert contact.xy[contact.geometry.facets[:, :2]].mean(axis=1) == pytest.approx(
                contact.xy[contact.geometry.facets[:, 2]]
            )
    total = dict.fromkeys(lower.nodes.tolist(), 0.0)
    for contact in contacts:
        for node, length in zip(contact.rows.nodes[1].tolist(), contact.area, strict=True):
            total[node] += length
    assert list(total.values()) == pytest.approx(lower.area)


@orders
@pytest.mark.parametrize("part", [0.006, 0.5])
def test_a_shift_by_a_part_of_an_element_is_refused(order, part):
    """Whatever overlaps: no node, one by accident, or ends that nearly coincide."""
    for elements in (0, 1, 2, 3):
        aside = 0.5 / order * (elements * order + part)
        text = refused(
            side(brick(aside, 1.0, order), "bottom"), side(brick(0.0, order=order), "top")
        )
        assert "one to one" in text or "opposite" in text


def test_corners_opposite_middles_are_no_partners():
    """Quadratic bricks shifted by half an edge: their nodes coincide, but what a pressure gives them does not."""
    for aside in (0.25, 1.25):
        refused(side(brick(aside, 1.0, 2), "bottom"), side(brick(0.0, order=2), "top"))


@orders
def test_a_contact_of_one_node(order):
    """Bricks that share a corner: the iteration takes the mean spacing of both sides there for a length."""
    upper = rectangle((8, 2), (2.0, 1.0), (2.0, 1.0), order)
    contact = met(side(upper, "bottom"), side(brick(0.0, order=order), "top"))
    assert (contact.m, contact.xy.tolist()) == (1, [[2.0, 1.0]])
    assert contact.area == pytest.approx([(0.25 + 0.5) / 2 / order])
    assert contact.normal == pytest.approx(np.array([[0.0, -1.0]]))
    assert held_beside(contact) == 0.0 and len(contact.geometry.facets) == 0
    assert (
        contact.geometry.pointwise
        and contact.lines.area.tolist() == [0.0]
        and contact.shares.tolist() == [1.0]
    )
    assert not met(
        side(brick(1.0, 1.0, order), "bottom"), side(brick(0.0, order=order), "top")
    ).geometry.pointwise


@pytest.mark.parametrize(
    "groups", [("left", "right"), ("bottom", "left"), ("top", "bottom"), ("top", "top")]
)
def test_a_corner_seen_from_behind_is_no_contact(groups):
    """Sides that do not face each other, or only through their own bodies, may share a node by accident."""
    refused(side(brick(0.0, 1.0), groups[0]), side(brick(1.0), groups[1]))


def test_a_hole_in_one_side_is_not_bridged():
    """Two pieces of a boundary, one element apart: the other side's edge between them is no common one."""
    mesh = brick(0.0)
    edges = mesh.groups["top"]
    x = mesh.points[edges, 0].mean(axis=1)
    mesh.groups["pieces"] = edges[(x < 1.0) | (x > 1.5)]
    contact = met(
        side(brick(-0.5, 1.0, divisions=(6, 2), size=(3.0, 1.0)), "bottom"), side(mesh, "pieces")
    )
    assert contact.xy[:, 0] == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    assert joined(contact).tolist() == [True, True, False, True]
    assert contact.area == pytest.approx([0.25, 0.5, 0.25, 0.25, 0.25])


@orders
def test_a_half_ring_in_a_ring(order):
    """An open chain meets a part of a closed one, also where that one begins and ends."""
    angles = 2 * np.pi * np.arange(24) / 24
    outer = ring(1.0, 1.5, angles, order)
    for start in (0, 6, 12, 15):
        inner = ring(0.5, 1.0, np.roll(angles, -start)[:13], order, closed=False)
        contact = met(side(inner, "outer"), side(outer, "inner"))
        assert contact.m == 12 * order + 1
        assert contact.area.sum() == pytest.approx(24 * np.sin(np.pi / 24))
        assert not contact.gap.any() and joined(contact).all()
        swapped = met(side(outer, "inner"), side(inner, "outer"))
        assert sorted(swapped.area) == pytest.approx(sorted(contact.area))
        assert (
            swapped.geometry.laplacian.nnz - swapped.m
        ) == 2 * 12 * order  # a closed chain begins somewhere
        assert contact.geometry.laplacian[0, contact.m - 1] == 0.0
        assert len(swapped.geometry.facets) == 12
