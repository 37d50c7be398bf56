"""Contacts that end within facets: forces reach as far as the contact does, on any mesh and with either slave."""

import pytest
from scenes import rectangle, seldom
from solid_scenes import HELD, box

import ddmpi

PRESSURE = 1e5
"""On top of a block 1 m wide and high (Pa)."""


def tipping(sideways: float, end: float, cells: int, order: int, slave: str, space: bool) -> dict:
    """A block on a slab that ends at x = `end` below it, pushed along x at its top by a part of the pressure there."""
    shape = box if space else rectangle
    depth, thick = ([1.0], [cells]) if space else ([], [])
    push = [sideways * PRESSURE, *[0.0] * space, -PRESSURE]
    block = shape(
        "block",
        [0.0, *[0.0] * space, 0.0],
        [1.0, *depth, 1.0],
        [cells, *thick, cells],
        order,
        traction=[{"on": "top", "value": push}],
    )
    clamp = {"on": "bottom"} | (HELD if space else {"x": 0.0, "y": 0.0})
    slab = shape(
        "slab",
        [end - 2.0, *[-0.5] * space, -0.5],
        [2.0, *[2.0] * space, 0.5],
        [5, *[5] * space, 2],
        order,
        clamp=[clamp],
    )
    return {
        "body": [block, slab],
        "contact": [
            {
                "bodies": ["block", "slab"],
                "on": ["bottom", "top"],
                "slave": slave,
                "pairing": "mortar",
                "friction": {"law": "coulomb", "coefficient": 1.0},
            }
        ],
    }


@pytest.mark.parametrize(("order", "space"), [(2, False), seldom(1, True)])
@pytest.mark.parametrize(
    ("cells", "end", "slave"),
    [(1, 0.8, "slab"), seldom(2, 0.7, "block")],
)
def test_a_block_tips_where_the_contact_ends(cells, end, slave, order, space):
    """It does when the moments of push and pressure about the slab's end are equal: sideways · 1 = end − 1/2."""
    limit = end - 0.5
    assert ddmpi.solve(tipping(limit - 2e-3, end, cells, order, slave, space)).certified
    beyond = ddmpi.solve(tipping(limit + 2e-3, end, cells, order, slave, space))
    assert not beyond.certified and beyond.reason.startswith("no equilibrium")
