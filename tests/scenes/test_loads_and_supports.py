"""Forces, supports along normals, heat and orthotropic materials in whole scenes, against closed forms and twins."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import pinched_blocks, solve_scene

COMM = MPI.COMM_WORLD


@pytest.mark.mpi(ranks=2)
def test_force_is_the_stress_times_the_area():
    """A scene loaded by total forces has the answer of the same scene loaded by stresses, on two ranks."""
    stresses, forces = pinched_blocks(4), pinched_blocks(4)
    for body in forces["body"]:
        for load in body["traction"]:
            area = 3.0 if load["on"] in ("top", "bottom") else 1.0
            load["force"] = [area * each for each in load.pop("value")]
    one, other = (solve_scene(COMM, scene) for scene in (stresses, forces))
    assert one["certified"] and other["certified"]
    assert other["normal_force"] == pytest.approx(one["normal_force"], rel=1e-9, abs=1e-3)
    assert other["n_A"] == one["n_A"]
    assert np.abs(one["normal_force"]).max() > 1e6
