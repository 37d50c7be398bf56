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


@pytest.mark.mpi(ranks=2)
def test_without_friction_qps_in_space_have_bounds_for_any_type(comm, petsc_options):
    assembly = prepare_scene(comm, pinched_boxes(2, "none"))
    reference = run(assembly, outer="newton", tolerance=1e-10)[1]
    for name in ("python", "tron", "bntr", "blmvm"):
        petsc_options(qp_tao_type=name)
        answer, forces = run(assembly, outer="relaxation", theta=0.2, tolerance=1e-8)
        assert answer.certified, (name, answer.reason)
        assert np.linalg.norm(forces - reference) <= 1e-6 * np.linalg.norm(reference), name
        steps = comm.allgather(answer.outer.inner_steps)
        assert all("gradient" not in each for each in steps)
        assert sum(sum(each.values()) > 0 for each in steps) == (2 if name == "python" else 1)  # role 1 has no bounds


@pytest.mark.mpi(ranks=2)
def test_types_for_bounds_leave_the_run_in_space_as_it_is(comm, petsc_options):
    """Pressures of a split QP have bounds and are theirs; what lies in discs is not."""
    assembly = prepare_scene(comm, pinched_boxes(2))
    method = {"outer": "relaxation", "algorithm": "modified", "splitting": "step1+2", "theta": 0.2, "tolerance": 1e-6}
    reference = run(assembly, **method)[1]
    petsc_options(qp_tao_type="bncg")
    answer, forces = run(assembly, **method)
    assert answer.certified, answer.reason
    assert np.linalg.norm(forces - reference) <= 1e-4 * np.linalg.norm(reference)
