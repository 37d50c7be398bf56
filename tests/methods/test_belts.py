"""Belts around drums, which slip as wholes: verdicts, and the start of interior points, which they need."""

import hard_scenes
import numpy as np
import pytest
import scenes
from mpi4py import MPI

import ddmpi
from ddmpi.coupling.assembly import prepare
from ddmpi.methods.paths import InteriorPoints
from ddmpi.scene.reader import read_scene


def belt_case(*words: str) -> tuple:
    """The only belt of the study whose name has all these words."""
    case, = (case for case in hard_scenes.belts() if all(word in case[0] for word in words))
    return case


@pytest.mark.parametrize("words", [
    ("0.01 m thick, 180°, 𝓕 = 0.5", "E = 2e+11 Pa, moved by -0.05"), ("0.05 m thick, 180°, 𝓕 = 0.3", "99.9%"),
    ("0.01 m thick, 180°, 𝓕 = 0.1", "97.0%"), ("0.01 m thick, 180°, 𝓕 = 0.1", "99.9%")])
@pytest.mark.mpi(ranks=[1, 2])
def test_belts_that_slip_as_wholes(words, comm):
    """Clamped ones are certified; loose ones up to the limit of friction, beyond which they slide around the drum."""
    _, scene, steps, _, said = belt_case(*words)
    answer = ddmpi.solve(scene(), comm)
    assert answer.reason.startswith(said) and answer.summary["outer_iterations"] <= steps


def loose_block() -> dict:
    """Of weight, on a floor 1 mm below it, and pushed aside."""
    block = scenes.rectangle("block", (0, 1e-3), (1, 0.5), (6, 3), young=2e10, poisson=0.2, volume_force=[2e3, -2e4])
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    return {"body": [block], "rigid": [floor], "contact": [
        {"bodies": ["block", "floor"], "on": ["bottom"], "friction": {"law": "coulomb", "coefficient": 0.3}}]}


@pytest.mark.parametrize("scene", [loose_block(), hard_scenes.belt(0.01, 180, 0.5, 48, 2e11, -0.05)],
                         ids=["block", "belt"])
def test_interior_points_start_with_the_gaps_and_slips_of_their_forces(scene):
    """r = C s − d − Zα with motions that leave the least of it; gaps and slips are of r, and inside their bounds."""
    joint = prepare(MPI.COMM_SELF, read_scene("scene", scene, [])).joint
    path = InteriorPoints(joint, np.concatenate([each.stiffness for each in joint.space.interfaces]))
    s, r, alpha, _ = path.point
    free = joint.product(s, "newton") - joint.d
    assert r == pytest.approx(free - joint.rigid.spread(alpha), abs=1e-9 * np.abs(free).max())
    assert np.abs(joint.rigid.Z.T @ r).max(initial=0.0) <= 1e-8 * np.abs(joint.rigid.Z.T @ free).max(initial=0.0)
    assert np.array_equal(path._slip, r[path._rows])
    assert (path._most > np.abs(path._slip)).all() and (path._w[path._normal] >= r[path._normal]).all()
