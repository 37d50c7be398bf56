"""Belts around drums, which slip as wholes: verdicts, and the start of interior points, which they need."""

import numpy as np
import pytest
import scenes
from hard_scenes import belt
from mpi4py import MPI

import ddmpi
from ddmpi.coupling.assembly import prepare
from ddmpi.methods.paths import InteriorPoints
from ddmpi.scene.reader import read_scene


@pytest.mark.parametrize(
    ("belt", "steps", "said"),
    [
        scenes.seldom(belt(0.01, 180, 0.5, 120, 2e11, -0.05), 120, "converged and certified"),
        scenes.seldom(belt(0.05, 180, 0.3, 48, 2e9, limit=0.999), 80, "no equilibrium found"),
        scenes.seldom(belt(0.01, 180, 0.1, 48, 2e9, limit=0.97), 80, "converged and certified"),
        scenes.seldom(belt(0.01, 180, 0.1, 48, 2e9, limit=0.999), 80, "no equilibrium found"),
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
