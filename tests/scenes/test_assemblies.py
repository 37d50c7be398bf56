"""Assemblies with known answers: the shipped ones, and scenes such as a new user would write."""

import numpy as np
import pytest
from scenes import COULOMB, FLOOR, ROOT, certified, rectangle

import ddmpi

pytestmark = pytest.mark.slow

MATERIAL = {"young": 2.0e10, "poisson": 0.25}


def block(name: str, x: float, y: float, width: float, height: float, N: int = 8, **more) -> dict:
    divisions = round(width * N), round(height * N)
    return rectangle(name, (x, y), (width, height), divisions, **{"material": MATERIAL} | more)


def contact(first: str, second: str, *on: str, **more) -> dict:
    return {"bodies": [first, second], "on": list(on)} | more


@pytest.mark.parametrize(
    ("name", "overrides", "displacement"),
    [
        ("wall", {}, 5.3563296e-6),
        ("arch", {"rigid.right.displacement": [0.005, 0.0]}, 5.00089917e-3),
    ],
)
def test_shipped_assemblies_move_as_an_independent_code_says(name, overrides, displacement):
    """Largest displacements (m) by dense factorisations; the gallery's test asks for resultants and thrust."""
    summary = certified(ROOT / "configs" / f"{name}.toml", None, **overrides).summary
    (hinge,) = summary["warnings"]
    assert "closed at a single node" in hinge
    assert summary["displacement_max"] == pytest.approx(displacement, rel=1e-6)


# Scenes of a new user, as in docs/studies/assemblies_tried.md


ROUGH = COULOMB | {"coefficient": 0.6}


def feet() -> dict:
    """A half ring stands on a beam with both feet: two contacts of the same two bodies."""
    ring = {
        "name": "ring",
        "material": MATERIAL,
        "volume_force": [0.0, -2.0e4],
        "mesh": {
            "shape": "annulus",
            "center": [0.0, 0.0],
            "radii": [1.0, 1.5],
            "angles": [0, 180],
            "divisions": [32, 4],
        },
    }
    return {
        "rigid": [FLOOR | {"point": [0.0, -0.5]}],
        "body": [ring, block("beam", -2.0, -0.5, 4.0, 0.5)],
        "contact": [
            contact("ring", "beam", "start", "top", name="right", friction=ROUGH),
            contact("ring", "beam", "end", "top", name="left", friction=ROUGH),
            contact("beam", "floor", "bottom", friction=ROUGH),
        ],
    }


def pushed(push: float, law: dict) -> dict:
    """Two blocks of 20 kN on a floor, the upper one pushed at its side by so many newtons."""
    weight, side = [0.0, -2.0e4], [{"on": "left", "value": [push / 0.5, 0.0]}]
    return {
        "rigid": [FLOOR],
        "body": [
            block("lower", 0.0, 0.0, 2.0, 0.5, volume_force=weight),
            block("upper", 0.0, 0.5, 2.0, 0.5, volume_force=weight, traction=side),
        ],
        "contact": [
            contact("lower", "floor", "bottom", friction=law),
            contact("upper", "lower", "bottom", "top", friction=law),
        ],
    }


def test_both_feet_bear_half_of_a_ring():
    """Two contacts of the same two bodies have an answer each."""
    contacts = certified(feet()).summary["contacts"]
    half = 2.0e4 * (1.5**2 - 1.0**2) * np.sin(np.pi / 32) * 32 / 4
    (fx, fy), (gx, gy) = contacts["left"]["force"], contacts["right"]["force"]
    assert (fy, gy) == pytest.approx((half, half), rel=1e-3)  # triangles are not symmetric
    assert fy + gy == pytest.approx(2 * half, rel=1e-6)
    assert fx == pytest.approx(-gx, rel=1e-6) and fx > 0.0  # the feet are kept from sliding outward


@pytest.mark.mpi(ranks=2)
@pytest.mark.clarabel
@pytest.mark.parametrize(
    "law, bears",
    [(COULOMB | {"coefficient": 0.5}, 1.0e4), ({"law": "tresca", "slip_bound": 5.0e3}, 1.0e4)],
    ids=["coulomb", "tresca"],
)
def test_a_block_is_pushed_up_to_its_friction(comm, law, bears):
    """Friction holds 0.5 of the upper block's weight, or the slip bound times the length; a larger push is refused."""
    for each in certified(pushed(0.98 * bears, law), comm).summary["contacts"].values():
        assert each["force"][0] == pytest.approx(-0.98 * bears, rel=1e-6)
    assert (
        "no equilibrium: upper would move along x"
        in ddmpi.solve(pushed(1.02 * bears, law), comm).reason
    )
