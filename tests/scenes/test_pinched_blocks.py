"""The model scene: the measured answers of the design."""

import numpy as np
import pytest
from scenes import certified, pinched_blocks, solve_scene

pytestmark = pytest.mark.slow

SIX_DIGITS = 1e-6
PUBLISHED = {
    "outer": "relaxation",
    "algorithm": "original",
    "splitting": "none",
    "theta": 0.2,
    "tolerance": 1e-4,
}

ANSWERS = {
    # design, section 3: open, slip, stick; normal, tangential resultant (N/m); displacement at (3, 2) (m)
    (22, "coulomb"): ((4, 45, 17), 1.1499786e8, 8.368861e6, (9.221043e-5, 1.7731729e-4)),
    (22, "tresca"): ((4, 42, 20), 1.1493356e8, 5.868415e6, (1.1189385e-4, 1.3447327e-4)),
    (54, "coulomb"): ((9, 110, 43), 1.1507844e8, 8.325063e6, (8.474154e-5, 1.8386317e-4)),
    # an independent P1 code in scipy: sparse LU, non-negative least squares for the coupled dual problem
    (22, "none"): ((4, 62, 0), 1.149542927e8, 0.0, (-1.684004e-4, 1.5922347e-3)),
}
"""Answers of the discrete problem for N and the friction law."""


@pytest.mark.parametrize("N, law", ANSWERS)
def test_table_of_the_design(N, law):
    """Newton's method has all digits of the independent codes, and a certificate below its limit."""
    counts, normal, tangential, displacement = ANSWERS[N, law]
    answer = certified(pinched_blocks(N, law, tolerance=1e-9))
    summary, contact = answer.summary, answer.summary["contacts"]["upper-lower"]
    assert (summary["n"], summary["m"]) == (12 * N * (N + 1), 3 * N)
    assert (contact["open"], contact["slip"], contact["stick"]) == counts
    assert contact["normal_force"] == pytest.approx(normal, rel=SIX_DIGITS)
    assert contact["tangential_force"] == pytest.approx(tangential, rel=SIX_DIGITS)
    corner = np.abs(answer.bodies["upper"].points - [3.0, 2.0]).sum(axis=1).argmin()
    assert answer.bodies["upper"].displacement[corner] == pytest.approx(
        displacement, rel=SIX_DIGITS
    )
    assert 0 < summary["certificate_limit"] <= 1e-7
    assert all(
        0 <= residual <= summary["certificate_limit"]
        for residual in summary["certificate"].values()
    )


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize(
    ("law", "iterations", "n_A"), [("coulomb", (40, 47), 1000), ("tresca", (37, 43), 850)]
)
def test_published_iteration_takes_the_published_counts(comm, law, iterations, n_A):
    """Design, section 3: N = 22, original, θ = 0.2, tol = 1e-4, η = 0.1."""
    solution = solve_scene(comm, pinched_blocks(22, law, **PUBLISHED))
    assert solution["certified"]
    assert iterations[0] <= solution["outer_iterations"] <= iterations[1]
    assert solution["n_A"] <= n_A
    _, normal, tangential, _ = ANSWERS[22, law]
    assert solution["normal_force"].sum() == pytest.approx(normal, rel=1e-4)
    assert solution["tangential_force"].sum() == pytest.approx(tangential, rel=1e-3)


@pytest.mark.mpi(ranks=2)
def test_no_bit_of_the_published_iteration_depends_on_the_units(comm):
    """Powers of two scale without rounding, so that only a number with a hidden unit can change the course."""
    length, stress = 2.0**10, 2.0**-20
    base, other = (
        solve_scene(comm, pinched_blocks(6, "coulomb", *unit, **PUBLISHED))
        for unit in ((1.0, 1.0), (length, stress))
    )
    assert base["certified"]
    for key in ("certified", "outer_iterations", "n_A_by_body", "status", "certificate"):
        assert other[key] == base[key], key
    for name in ("normal_force", "tangential_force"):
        assert np.array_equal(other[name], base[name] * length * stress)
    for name, (_, u) in base["body"].items():
        assert np.array_equal(other["body"][name][1], u * length)
