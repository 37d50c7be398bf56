"""Rows of contacts in space between quadratic elements: where they act, what clamps leave of them, and how exact."""

import numpy as np
import pytest
from boundaries import join, side
from made_up_solids import box
from solid_scenes import box as block
from solid_scenes import two_boxes

import ddmpi
from ddmpi.interface.interface import Interface
from ddmpi.scene.contacts import Coulomb


def seam(above: tuple[int, int], below: tuple[int, int], scale: float = 1.0, **held) -> Interface:
    """A block of 1 × 1 × 1 on one of 3 × 3 × 1, both times `scale`, with so many cells along x and y."""
    upper = box((0.0, 0.0, scale), (scale, scale, scale), (*above, 1), 2)
    lower = box((-scale, -scale, 0.0), (3 * scale, 3 * scale, scale), (*below, 1), 2)
    return join(
        side(upper, "bottom", body="upper", **held),
        side(lower, "top", body="lower"),
        Coulomb(coefficient=0.3),
        "seam",
        pairing="mortar",
        slave="upper",
    )


@pytest.mark.parametrize("scale", [1e-3, 1.0])
@pytest.mark.parametrize("above, below", [((1, 1), (2, 2)), ((2, 5), (3, 9))])
def test_forces_act_at_the_vertices(above, below, scale):
    """Any force at a row has its moment about any axis, on both bodies: a row measures linear motions exactly."""
    contact = seam(above, below, scale)
    assert contact.m == (above[0] + 1) * (above[1] + 1)
    for at in contact.geometry.at:
        assert np.abs(at[:, :2] - contact.xy[:, :2]).max() < 1e-12 * scale
    assert contact.area.sum() == pytest.approx(scale**2, rel=1e-12)


@pytest.mark.parametrize("place", [0.01, 0.3])
def test_a_clamped_edge_keeps_its_rows(place):
    """A clamp that ends at an edge of the contact leaves all rows, as its middles move; the areas still add up."""
    contact = seam((3, 4), (5, 5), where=lambda x, y, z: x < place, x=True, y=True, z=True)
    assert contact.m == 4 * 5 and contact.area.sum() == pytest.approx(1.0, rel=1e-12)
    assert contact.area.min() > 0.0


@pytest.mark.slow
def test_the_force_of_two_boxes():
    """The meshes of N = 8 give the force of meshes 3.5 times finer to a tenth of a percent."""
    totals = ddmpi.solve(two_boxes(4, 3, 2)).contacts["upper-lower"].totals
    found, fine = (
        np.array([totals.normal_force, totals.tangential_force]),
        np.array([1.15831e8, 9.3032e6]),
    )
    assert np.linalg.norm(found - fine) < 1e-3 * np.linalg.norm(fine)


@pytest.mark.slow
def test_the_top_of_a_loose_stack():
    """Three cells a cube give the displacement of twelve to 1.5 %; the push lifts a part of each cube off the next."""
    cubes = [
        block(f"cube{k}", (0, 0, k), (1, 1, 1), (3, 3, 3), 2, 2.119e11, 0.277) for k in range(4)
    ]
    cubes[0]["clamp"] = ["bottom"]
    cubes[3]["traction"] = [{"on": "top", "value": [5.0e6, 2.5e6, -6.0e7]}]
    top = ddmpi.solve(
        {
            "body": cubes,
            "contact": [
                {
                    "bodies": [f"cube{k + 1}", f"cube{k}"],
                    "on": ["bottom", "top"],
                    "friction": {"law": "coulomb", "coefficient": 0.3},
                }
                for k in range(3)
            ],
        }
    ).bodies["cube3"]
    fine = np.array([7.0728e-3, 3.7250e-3, -2.9795e-3])
    assert np.linalg.norm(
        top.displacement[top.points.sum(axis=1).argmax()] - fine
    ) < 0.015 * np.linalg.norm(fine)
