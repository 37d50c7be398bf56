"""Belts around drums, which slip as wholes: verdicts, and the start of interior points, which they need."""

import math

import numpy as np
import pytest
import scenes
from mpi4py import MPI

import ddmpi
from ddmpi.coupling.assembly import prepare
from ddmpi.methods.paths import InteriorPoints
from ddmpi.scene.reader import read_scene


def belt(
    thickness: float,
    wrap: float,
    friction: float,
    divisions: int,
    young: float,
    move: float | None = None,
    pull: float = 0.0,
) -> dict:
    """A belt around a rigid drum of radius 1 m, wrapped by so many degrees, that slips as a whole.

    Its start is pulled by 100 kPa. Its end is moved along this pull by a clamp, `move` metres; without it the end is
    pulled as well, by exp(`pull` μ wrap) times as much. As it is pulled in its middle, it slides from a `pull` of
    1/(1 + thickness/2) on (Euler and Eytelwein).
    """
    first, last = 90.0 - wrap / 2, 90.0 + wrap / 2
    ahead = {
        end: [-math.sin(math.radians(angle)), math.cos(math.radians(angle))]
        for end, angle in (("start", first), ("end", last))
    }
    pulls = {"start": -1e5} | (
        {} if move else {"end": 1e5 * math.exp(pull * friction * math.radians(wrap))}
    )
    clamp = (
        [{"on": "end"} | {axis: -move * x for axis, x in zip("xy", ahead["end"], strict=True)}]
        if move
        else []
    )
    return {
        "body": [
            {
                "name": "belt",
                "material": {"young": young, "poisson": 0.3},
                "clamp": clamp,
                "traction": [
                    {"on": end, "value": [q * x for x in ahead[end]]} for end, q in pulls.items()
                ],
                "mesh": {
                    "shape": "annulus",
                    "center": [0.0, 0.0],
                    "radii": [1.0, 1.0 + thickness],
                    "angles": [first, last],
                    "divisions": [divisions, 2],
                },
            }
        ],
        "rigid": [{"name": "drum", "shape": "circle", "center": [0.0, 0.0], "radius": 1.0}],
        "contact": [
            {
                "bodies": ["belt", "drum"],
                "on": ["inner"],
                "friction": {"law": "coulomb", "coefficient": friction},
            }
        ],
    }


@pytest.mark.parametrize(
    ("belt", "steps", "said"),
    [
        (belt(0.01, 180, 0.5, 120, 2e11, -0.05), 120, "converged and certified"),
        (belt(0.05, 180, 0.3, 48, 2e9, pull=0.999), 80, "no equilibrium found"),
        (belt(0.01, 180, 0.1, 48, 2e9, pull=0.97), 80, "converged and certified"),
        (belt(0.01, 180, 0.1, 48, 2e9, pull=0.999), 80, "no equilibrium found"),
    ],
)
def test_belts_that_slip_as_wholes(belt, steps, said):
    """Clamped ones are certified; loose ones up to the limit of friction, beyond which they slide around the drum."""
    answer = ddmpi.solve(belt, MPI.COMM_SELF)
    assert answer.reason.startswith(said) and answer.summary["outer_iterations"] <= steps


def loose_block() -> dict:
    """Of weight, on a floor 1 mm below it, and pushed aside."""
    block = scenes.rectangle(
        "block", (0, 1e-3), (1, 0.5), (6, 3), young=2e10, poisson=0.2, volume_force=[2e3, -2e4]
    )
    return {
        "body": [block],
        "rigid": [scenes.FLOOR],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"], "friction": scenes.COULOMB}],
    }


@pytest.mark.parametrize(
    "scene", [loose_block(), belt(0.01, 180, 0.5, 48, 2e11, -0.05)], ids=["block", "belt"]
)
def test_interior_points_start_with_the_gaps_and_slips_of_their_forces(scene):
    """r = C s − d − Zα with motions that leave the least of it; gaps and slips are of r, and inside their bounds."""
    joint = prepare(MPI.COMM_SELF, read_scene("scene", scene, [])).joint
    path = InteriorPoints(
        joint, np.concatenate([each.stiffness for each in joint.space.interfaces])
    )
    s, r, alpha, _ = path.point
    free = joint.product(s, "newton") - joint.d
    assert r == pytest.approx(free - joint.rigid.spread(alpha), abs=1e-9 * np.abs(free).max())
    assert np.abs(joint.rigid.Z.T @ r).max(initial=0.0) <= 1e-8 * np.abs(
        joint.rigid.Z.T @ free
    ).max(initial=0.0)
    assert np.array_equal(path._slip, r[path._rows])
    assert (path._most > np.abs(path._slip)).all() and (
        path._w[path._normal] >= r[path._normal]
    ).all()
