"""Solids in contact whose exact answers elements of any order have: bars, stacks, gaps, overlaps, slip as a vector."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from scenes import COULOMB, certified, seldom
from solid_scenes import box

from ddmpi.run.answer import Answer

YOUNG = 1e9
FRICTION = {"friction": COULOMB}
FLOOR = {"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}


def cube(
    name: str,
    z: float = 0.0,
    x: float = 0.0,
    divisions: int = 2,
    order: int = 1,
    young: float = YOUNG,
    poisson: float = 0.3,
    **more,
) -> dict:
    """Of side 1, with its lowest corner at (x, 0, z)."""
    return box(name, (x, 0, z), (1, 1, 1), [divisions] * 3, order, young, poisson, **more)


def solve(bodies: list[dict], contacts: list[dict], **more) -> Answer:
    """The certified answer."""
    return certified({"body": bodies, "contact": contacts, **more})


def on(first: str, second: str, **more) -> dict:
    """The contact of the bottom of the first with the top of the second, or with a rigid partner."""
    return {
        "name": "c",
        "bodies": [first, second],
        "on": ["bottom", "top"][: 1 if second == "floor" else 2],
        **more,
    }


PRESSURE, THICK = 1e6, 0.01


def dragged(path: np.ndarray, **more) -> dict:
    """A thin plate, pressed on a floor with 1 MPa, its top dragged along a path (k, 2) from 0."""
    times = np.arange(len(path) + 1.0)
    clamp = [{"on": "top", axis: 1.0, "history": axis} for axis in "xy"]
    plate = cube(
        "plate", clamp=[*clamp, {"on": "top", "z": -PRESSURE * THICK / YOUNG}], poisson=0.0
    )
    plate["mesh"]["size"] = [1.0, 1.0, THICK]
    return {
        "body": [plate],
        "rigid": [FLOOR],
        "contact": [on("plate", "floor", **FRICTION)],
        "history": {
            axis: {"times": times.tolist(), "factors": [0.0, *path[:, k].tolist()]}
            for k, axis in enumerate("xy")
        },
        "time": {"points": times[1:].tolist(), "steps": 1},
        **more,
    }


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_a_plate_that_is_dragged_around_a_circle_follows_the_radial_return():
    """Friction as a vector with memory: q ← P(q + k Δu) in each step, and what it dissipates."""
    angle = 2.0 * np.pi * np.arange(1, 17) / 16
    path = 2e-5 * np.column_stack([1.0 - np.cos(angle), np.sin(angle)])
    answer = certified(dragged(path), MPI.COMM_WORLD)
    stiffness, bound = YOUNG / 2.0 / THICK, 0.3 * PRESSURE
    q, before, work = np.zeros(2), np.zeros(2), 0.0
    for k, (end, step) in enumerate(zip(path, answer.summary["steps"], strict=True)):
        trial = q + stiffness * (end - before)
        q = trial * min(1.0, bound / np.linalg.norm(trial))
        slip = np.linalg.norm(trial - q) / stiffness
        work += slip * (bound if k else bound / 2.0)
        assert step["contacts"]["c"]["force"] == pytest.approx([*-q, PRESSURE], abs=0.01 * bound)
        before = end
    assert answer.summary["contacts"]["c"]["dissipated"] == pytest.approx(work, rel=0.01)


@pytest.mark.parametrize(
    ("missing", "way"),
    [
        (1e-3, (-0.8, 0.6)),
        seldom(1e-7, (0.8, 0.6)),
        seldom(1e-7, (0.0, -1.0)),
        seldom(1e-3, (0.8, 0.6)),
        seldom(1e-3, (0.0, -1.0)),
        seldom(1e-7, (-0.8, 0.6)),
    ],
)
def test_a_body_whose_friction_is_at_its_limit_is_said_to_slide(missing, way):
    """Friction that Poisson's effect has turned aside resists by turning back, the less the farther the body goes."""
    pull, p = 0.3 * (1.0 - missing) * np.array(way), 1e4
    slider = cube("slider", divisions=3, traction=[{"on": "top", "value": [*p * pull, -p]}])
    answer = solve([slider], [on("slider", "floor", **FRICTION)], rigid=[FLOOR])
    said = ["-y" if way[0] == 0.0 else f"({way[0]}, {way[1]}, 0)"] * (missing < 1e-5)
    assert answer.summary["undetermined"] == [
        f"slider can move along {each} without any force" for each in said
    ]
    np.testing.assert_allclose(
        answer.summary["contacts"]["c"]["force"], [*-p * pull, p], 1e-6, 1e-6 * p
    )


@pytest.mark.parametrize("order", [1, 2])
def test_normals_on_a_rigid_partner_are_its_own(order):
    """Also where a body lies askew on it: no force along a plane without friction."""
    corners = [
        [0, 0, 0.0],
        [1, 0, 0.01],
        [1, 1, 0.03],
        [0, 1, 0.02],
        [0, 0, 1],
        [1, 0, 1],
        [1, 1, 1],
        [0, 1, 1],
    ]
    mesh = {"shape": "hexahedron", "corners": corners, "divisions": [2, 2, 2], "order": order}
    block = {
        "name": "block",
        "mesh": mesh,
        "material": {"young": 1e9, "poisson": 0.3},
        "clamp": [{"on": "top", "x": 0.0, "y": 0.0, "z": -0.05}],
    }
    state = solve([block], [on("block", "floor")], rigid=[FLOOR]).contacts["c"]
    assert np.abs(state.interface.normal + np.eye(3)[2]).max() < 1e-15
    assert np.abs(state.force[:2]).max() <= 1e-12 * state.force[2]
