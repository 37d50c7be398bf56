"""Foundations: springs per area on boundary groups, against closed forms; what they hold, and what they leave."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import assert_refused, certified, rectangle

import ddmpi

YOUNG, POISSON, PRESSURE = 1e9, 0.3, 1e6
CONFINED = YOUNG * (1 - POISSON) / (1 + POISSON) / (1 - 2 * POISSON)
STEEL = {"young": YOUNG, "poisson": POISSON}


def resting(k: float) -> dict:
    """A block between rollers on springs alone, pressed from above; far from it a rigid plane."""
    return {
        "body": [
            rectangle(
                "block",
                (0.0, 0.0),
                (2.0, 1.0),
                (6, 4),
                young=YOUNG,
                clamp=[{"on": on, "x": 0.0} for on in ("left", "right")],
                foundation=[{"on": "bottom", "normal": k}],
                traction=[{"on": "top", "value": [0.0, -PRESSURE]}],
            )
        ],
        "rigid": [{"name": "sky", "shape": "plane", "point": [0.0, 9.0], "normal": [0.0, -1.0]}],
        "contact": [{"bodies": ["block", "sky"], "on": ["top"]}],
    }


@pytest.mark.parametrize("solver", ["explicit", "direct", "iterative"])
def test_every_compliance_knows_of_the_springs(solver):
    """Dense, by solves and by multigrid: pressed from below against the sky, springs bear a part of the load."""
    scene = resting(1e9)
    scene["rigid"][0]["point"][-1] = 1.0
    scene["body"][0]["traction"] = [{"on": "bottom", "value": [0.0, PRESSURE]}]
    answer = certified(scene, method__compliance=solver, method__tolerance=1e-6)
    assert answer.contacts["block-sky"].pressure == pytest.approx(
        np.full(7, PRESSURE / (1 + 1e9 / CONFINED)), rel=1e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_a_curved_foundation(order):
    """A ring that a pressure widens against springs around it: Lamé with p = k u at the rim."""
    a, b, k = 0.5, 1.0, 1e9
    ring = {
        "name": "ring",
        "material": STEEL,
        "foundation": [{"on": "outer", "normal": k}],
        "mesh": {
            "shape": "annulus",
            "center": [0.0, 0.0],
            "radii": [a, b],
            "angles": [0.0, 90.0],
            "divisions": [48, 24],
            "order": order,
        },
        "clamp": [{"on": "start", "y": 0.0}, {"on": "end", "x": 0.0}],
        "traction": [{"on": "inner", "pressure": PRESSURE}],
    }
    scene = {
        "body": [ring],
        "rigid": [
            {"name": "far", "shape": "circle", "center": [0.0, 0.0], "radius": 9.0, "inside": True}
        ],
        "contact": [{"bodies": ["ring", "far"], "on": ["outer"]}],
    }
    shear = YOUNG / 2 / (1 + POISSON)
    bulk = shear / (1 - 2 * POISSON)  # u = A r + B/r, σ_r = 2 bulk A − 2 shear B/r²
    A, B = np.linalg.solve(
        [[2 * bulk, -2 * shear / a**2], [2 * bulk + k * b, -2 * shear / b**2 + k / b]],
        [-PRESSURE, 0.0],
    )
    fields = certified(scene).bodies["ring"]
    rim = np.isclose(np.linalg.norm(fields.points, axis=1), b)
    u = np.einsum("ij,ij->i", fields.points, fields.displacement)[rim] / b
    assert u == pytest.approx(np.full(rim.sum(), A * b + B / b), rel={1: 5e-3, 2: 1e-5}[order])


def beside(
    solid: bool, tangential: float = 0.0, friction: float = 0.3, pull: float = 0.0, **clamps
) -> dict:
    """A block on another one, which a foundation alone bears; the upper one is pulled aside."""

    def mesh(x: float, z: float, width: float, across: int) -> dict:
        if solid:
            return {
                "shape": "box",
                "origin": [x, 0.0, z],
                "size": [width, 1.0, 1.0],
                "divisions": [across, 2, 2],
            }
        return {
            "shape": "rectangle",
            "origin": [x, z],
            "size": [width, 1.0],
            "divisions": [across, 3],
        }

    load = [pull, 0.0, -PRESSURE] if solid else [pull, -PRESSURE]
    springs = {"on": "bottom", "normal": 1e9} | ({"tangential": tangential} if tangential else {})
    return {
        "body": [
            {
                "name": "upper",
                "mesh": mesh(0.5, 1.0, 1.0, 3),
                "material": STEEL,
                "traction": [{"on": "top", "value": load}],
            },
            {
                "name": "lower",
                "mesh": mesh(0.0, 0.0, 2.0, 8),
                "material": STEEL,
                "foundation": [springs],
            }
            | clamps,
        ],
        "contact": [
            {
                "bodies": ["upper", "lower"],
                "on": ["bottom", "top"],
                "friction": {"law": "coulomb", "coefficient": friction},
            }
        ],
    }


@pytest.mark.slow
@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.clarabel
def test_what_a_foundation_leaves(solid):
    """Sliding along a flat base: told where no load asks for it; tangential springs, or a clamp, hold it."""
    answer = certified(beside(solid))
    held_motions = [each["motion"] for each in answer.summary["held_motions"]]
    assert any("move along x without any force" in each for each in held_motions)
    assert not any("facets" in warning for warning in answer.summary["warnings"])
    assert not answer.summary["bodies"]["lower"]["held"]
    lost = ddmpi.solve(beside(solid, pull=0.1 * PRESSURE), MPI.COMM_SELF)
    assert "no equilibrium: upper and lower would move along x" in lost.reason
    held = certified(beside(solid, tangential=1e8, pull=0.1 * PRESSURE))
    assert held.summary["bodies"]["lower"]["held"] and not held.summary["undetermined"]
    assert not held.summary["held_motions"]
    assert held.summary["bodies"]["lower"]["reaction"][0] == pytest.approx(
        -0.1 * PRESSURE, rel=1e-6
    )
    clamped = certified(beside(solid, pull=0.1 * PRESSURE, clamp=["left"]))
    lower = clamped.summary["bodies"]["lower"]
    assert lower["held"] and lower["reaction"] == pytest.approx(
        np.sum([lower["reactions"][group]["force"] for group in ("left", "bottom")], axis=0),
        abs=1.0,
    )
    slips = ddmpi.solve(
        beside(solid, tangential=1e8, friction=0.05, pull=0.1 * PRESSURE), MPI.COMM_SELF
    )
    assert "no equilibrium: upper would move along x" in slips.reason


@pytest.mark.parametrize(
    ("foundation", "words"),
    [
        ({"on": "bottom"}, "body.block.foundation.0: a foundation has a stiffness per area"),
        (
            {"on": "bottom", "normal": -1.0},
            "body.block.foundation.0.normal: expected a number >= 0",
        ),
        (
            {"on": "botom", "normal": 1e9},
            "body.block.foundation: the mesh has no boundary group 'botom'; did you mean",
        ),
    ],
)
def test_a_foundation_is_refused(foundation, words):
    scene = resting(1e9)
    scene["body"][0]["foundation"] = [foundation]
    assert_refused(scene, words)
