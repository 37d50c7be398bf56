"""All TAO types that know bounds, on random programs and in a real run: one stopping test, one answer."""

import numpy as np
import pytest
from scenes import pinched_blocks, prepare_scene
from test_mprgp import Dense, check, exact, program, solve

pytestmark = pytest.mark.slow

TYPES = ("python", "gpcg", "tron", "bntr", "bntl", "bnls", "bncg", "bqnls", "blmvm", "bqpip")


class Explicit(Dense):
    """A dense operator that gives its matrix away."""

    def dense(self) -> np.ndarray:
        self.count["explicit"] = 1
        return self.matrix


@pytest.mark.parametrize("kind", ["none", "lower", "upper", "box", "contact", "mixed", "zero width", "shifted box"])
@pytest.mark.parametrize("name", TYPES)
def test_types_reach_the_same_answer(name, kind, petsc_options):
    petsc_options(qp_tao_type=name)
    for seed, norm, linear in ((0, 1.0, 1.0), (1, 1e-12, 1e-4), (2, 1e6, 1e7)):
        qp = program(20, kind, norm=norm, linear=linear, seed=seed)
        qp.C = Explicit(qp.C.matrix)
        tolerance = 1e-8 * np.linalg.norm(qp.d)
        result = solve(qp, tolerance)
        check(qp, result, tolerance)
        reference = exact(qp)
        assert np.linalg.norm(result.s - reference) <= 1e-5 * np.linalg.norm(reference)
        assert ("explicit" in qp.C.count) == (name == "bqpip" and kind != "none")


@pytest.mark.mpi(ranks=2)
def test_types_give_the_same_run(comm, petsc_options):
    """Role 1 has no bounds in the original algorithm; splitting holds half of the forces."""
    from ddmpi.run.solve import solve
    from ddmpi.scene.method import Method

    for law, algorithm, splitting, types in (("coulomb", "original", "none", TYPES[::4]),
                                             ("tresca", "modified", "step1+2", TYPES)):
        assembly = prepare_scene(comm, pinched_blocks(2, law))
        method = Method(outer="relaxation", algorithm=algorithm, splitting=splitting, theta=0.3, tolerance=1e-5)
        found = {}
        for name in types:
            petsc_options(qp_tao_type=name)
            answer = solve(assembly, method)
            assert answer.certified, (name, answer.reason)
            found[name] = len(answer.outer.history), answer.outer.forces
        k, forces = found["python"]
        for name in types:
            assert found[name][0] == pytest.approx(k, rel=0.2), name
            assert np.linalg.norm(found[name][1] - forces) <= 1e-4 * np.linalg.norm(forces), name
