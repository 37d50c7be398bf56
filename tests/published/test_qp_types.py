"""All TAO types that know bounds, on random programs and in a real run: one stopping test, one answer."""

import numpy as np
import pytest
from scenes import seldom
from test_mprgp import Dense, check, exact, program, solve

TYPES = ("python", "gpcg", "tron", "bntr", "bntl", "bnls", "bncg", "bqnls", "blmvm", "bqpip")


class Explicit(Dense):
    """A dense operator that gives its matrix away."""

    def dense(self) -> np.ndarray:
        self.count["explicit"] = 1
        return self.matrix


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        (pytest.param if (name, kind) == ("bqpip", "contact") else seldom)(name, kind)
        for name in TYPES
        for kind in ("none", "contact", "mixed", "zero width", "shifted box")
    ],
)
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
