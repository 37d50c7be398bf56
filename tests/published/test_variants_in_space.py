"""The published iteration and its accelerated form of two solids: the answer of Newton's method, by QPs on discs."""

import itertools

import numpy as np
import pytest
from scenes import everywhere, prepare_scene
from solid_scenes import two_boxes

pytestmark = pytest.mark.slow

ALGORITHMS = ("original", "modified")
SPLITTINGS = ("none", "step1", "step2", "step1+2")


def pinched_boxes(N: int, law: str = "coulomb") -> dict:
    """Two boxes clamped at their left sides, pressed together and pulled along both tangents."""
    friction = {"coulomb": {"coefficient": 0.3}, "tresca": {"slip_bound": 1.2e7}, "none": {}}[law]
    return two_boxes(N, law={"law": law} | friction)


def run(assembly, **method):
    from ddmpi.run.solve import solve
    from ddmpi.scene.method import Method

    answer = solve(assembly, Method(**method))
    return answer, everywhere(assembly, answer.outer.forces)


@pytest.mark.mpi(ranks=2)
def test_every_variant_and_the_accelerated_form_find_newtons_answer(comm):
    """Half of the variants with each law, so that either has all splittings and both algorithms."""
    every = list(itertools.product(ALGORITHMS, SPLITTINGS))
    for law, half in (("tresca", every[:4:2] + every[5::2]), ("coulomb", every[1:4:2] + every[4::2])):
        assembly = prepare_scene(comm, pinched_boxes(2, law))
        newton, reference = run(assembly, outer="newton", tolerance=1e-10)
        contact = newton.contacts["upper-lower"]
        assert newton.certified and contact.slip and contact.stick and contact.open
        methods = [{"outer": "relaxation", "algorithm": algorithm, "splitting": splitting, "theta": 0.2,
                    "tolerance": 1e-6} for algorithm, splitting in half]
        for method in [*methods, {"outer": "anderson", "tolerance": 1e-6}]:
            answer, forces = run(assembly, **method)
            assert answer.certified, (law, method, answer.reason)
            assert np.linalg.norm(forces - reference) <= 5e-5 * np.linalg.norm(reference), (law, method)
            kinds = set().union(*comm.allgather(set(answer.outer.inner_steps)))
            assert {"cg", "gradient"} <= kinds, (law, method)
