"""Stacks of two blocks whose displacements are linear, so that elements of any order are exact (design, section 5)."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import (
    BRASS,
    CORK,
    COULOMB,
    STEEL,
    Block,
    Stack,
    confined_blocks,
    sheared_stack,
    solve_scene,
)

pytestmark = pytest.mark.slow

TOLERANCE = 1e-10
"""A hundredth of what is asserted: the last update of λ bounds no error."""

RELATIVE = 1e-8

TRESCA = {"law": "tresca", "slip_bound": 4.0e7}
NONE = {"law": "none"}
STICK, SLIP = 1e-4, 1e-3
"""Shifts (m) below and above what the slip bounds allow."""


def drawn(seed: int) -> Stack:
    """A stack at random: mesh, order, materials, law, plane, gap or overlap, shift, roles, and what holds its sides.

    Rollers at the sides leave no shift, so that no slip bound may be zero; displacements given there take the corners
    out of the contact.
    """
    rng = np.random.default_rng(seed)
    sides = str(rng.choice(["rollers", "tractions", "displacements"]))
    n = int(rng.integers(2 if sides == "displacements" else 1, 6))
    materials = [
        Block(**(STEEL, BRASS, CORK)[k], height=float(rng.uniform(0.4, 1.1)))
        for k in rng.integers(0, 3, 2)
    ]
    law = [COULOMB, TRESCA, NONE, COULOMB | {"coefficient": 0.0}, TRESCA | {"slip_bound": 0.0}][
        rng.choice(5, p=[0.4, 0.3, 0.1, 0.1, 0.1]) % (3 if sides == "rollers" else 5)
    ]
    gap, approach = [(0.0, 1e-3), (4e-4, 1e-3), (1.5e-3, 1e-3), (-5e-4, 0.0)][rng.integers(4)]
    shift = (
        0.0 if sides == "rollers" else float(rng.choice([-1.0, 1.0]) * rng.choice([STICK, SLIP]))
    )
    return Stack(
        n,
        law,
        approach,
        shift,
        gap,
        sides,
        str(rng.choice(["strain", "stress"])),
        str(rng.choice(["upper", "lower"])),
        *materials,
        order=int(rng.integers(1, 3)),
    )


PUBLISHED = {
    f"{algorithm}, {splitting}": {"algorithm": algorithm, "splitting": splitting, "theta": 0.4}
    for algorithm in ("original", "modified")
    for splitting in ("none", "step1", "step2", "step1+2")
}
BY_EVERY_METHOD = [
    confined_blocks(2, gap=4e-4),
    sheared_stack(2, SLIP, COULOMB),
    sheared_stack(2, SLIP, TRESCA),
]


def check(stack: Stack, comm=MPI.COMM_SELF, **method) -> None:
    """What is found is certified, and exact in displacements, gaps, forces, slips, statuses, energies. Collective."""
    solution = solve_scene(comm, stack.scene(tolerance=TOLERANCE, **method))
    assert solution["certified"], f"{solution['reason']}; {solution['certificate']}"
    assert 0 < solution["limit"] <= 50 * TOLERANCE
    assert all(0 <= residual <= solution["limit"] for residual in solution["certificate"].values())

    assert solution["m"] == stack.contact_nodes
    largest = max(
        np.abs(stack.displacement(body, points)).max()
        for body, (points, _) in solution["body"].items()
    )
    for body, (points, u) in solution["body"].items():
        assert np.abs(u - stack.displacement(body, points)).max() <= RELATIVE * largest, body
    assert np.abs(solution["gap"] - stack.opening).max() <= RELATIVE * largest

    force = max(stack.pressure, abs(stack.shear), 1e4) * solution["length"].max()
    assert (
        np.abs(solution["normal_force"] - stack.pressure * solution["length"]).max()
        <= RELATIVE * force
    )
    sliding, held = solution["sliding"], np.setdiff1d(np.arange(solution["m"]), solution["sliding"])
    tangential = solution["tangential_force"]
    assert (
        np.abs(tangential - stack.shear * solution["length"])[sliding].max(initial=0.0)
        <= RELATIVE * force
    )
    assert np.abs(solution["slip"] - stack.slip)[sliding].max(initial=0.0) <= RELATIVE * largest
    assert not tangential[held].any()
    if (
        stack.friction["law"] == "none"
    ):  # without tangential unknowns slip is that of the displacements
        assert np.abs(solution["slip"] - stack.slip).max() <= RELATIVE * largest
    else:
        assert not solution["slip"][held].any()
    assert solution["status"] == [stack.status] * solution["m"]
    order = ("upper", "lower") if stack.first == "upper" else ("lower", "upper")
    expected = [
        0.5
        * (stack.pressure**2 / b.confined(stack.plane) + stack.shear**2 / b.shear)
        * b.height
        * stack.width
        for b in (stack.blocks[body] for body in order)
    ]
    assert solution["energy"] == pytest.approx(expected, rel=RELATIVE)


@pytest.mark.parametrize("seed", range(36))
def test_closed_form(seed):
    """Newton's method finds linear displacements exactly, and what contacts carry."""
    check(drawn(seed))


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("method", [*PUBLISHED][::3])
def test_closed_form_by_the_published_iteration(comm, method):
    """So do variants of the published iteration, and the plainest one on some stacks at random."""
    for stack in [
        *BY_EVERY_METHOD,
        *(drawn(seed) for seed in (2, 7, 10, 19) if method == "original, none"),
    ]:
        check(stack, comm, **PUBLISHED[method])
