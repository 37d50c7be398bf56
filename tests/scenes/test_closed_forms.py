"""Stacks of two blocks whose displacements are linear, so that elements of any order are exact (design, section 5).
"""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import BRASS, CORK, STEEL, Block, Stack, confined_blocks, sheared_stack, solve_scene

pytestmark = pytest.mark.slow

TOLERANCE = 1e-10
"""A hundredth of what is asserted: the last update of λ bounds no error."""

RELATIVE = 1e-8

COULOMB = {"law": "coulomb", "coefficient": 0.3}
TRESCA = {"law": "tresca", "slip_bound": 4.0e7}
NONE = {"law": "none"}
STICK, SLIP = 1e-4, 1e-3
"""Shifts (m) below and above what the slip bounds allow."""


def on_a_mesh(n: int, order: int = 1) -> dict[str, Stack]:
    """Of n elements per side."""
    return {
        f"confined, touching, n={n}": confined_blocks(n, gap=0.0, order=order),
        f"confined, gap closes, n={n}": confined_blocks(n, gap=4e-4, order=order),
        f"confined, gap stays open, n={n}": confined_blocks(n, gap=1.5e-3, order=order),
        f"confined, gap closes, Coulomb, n={n}": confined_blocks(n, gap=4e-4, friction=COULOMB, order=order),
        f"confined, gap stays open, Coulomb, n={n}": confined_blocks(n, gap=1.5e-3, friction=COULOMB, order=order),
        f"confined by tractions, gap closes, Tresca, n={n}":
            confined_blocks(n, gap=4e-4, friction=TRESCA, sides="tractions", order=order),
        f"sheared, Coulomb stick, n={n}": sheared_stack(n, STICK, COULOMB, order=order),
        f"sheared, Coulomb slip, n={n}": sheared_stack(n, SLIP, COULOMB, order=order),
        f"sheared, Tresca stick, n={n}": sheared_stack(n, STICK, TRESCA, order=order),
        f"sheared, Tresca slip, n={n}": sheared_stack(n, SLIP, TRESCA, order=order),
    }


def quadratic() -> dict[str, Stack]:
    """Quadratic elements: stresses are forces over nodal lengths there, too."""
    cases = on_a_mesh(1, 2) | on_a_mesh(3, 2)
    cases |= {
        "plane stress, Coulomb slip": sheared_stack(2, SLIP, COULOMB, plane="stress", order=2),
        "initial overlap, sheared": sheared_stack(2, SLIP, COULOMB, gap=-5e-4, approach=0.0, order=2),
        "displacements on the sides, one contact node": sheared_stack(1, SLIP, COULOMB, sides="displacements", order=2),
        "displacements on the sides, Tresca stick": sheared_stack(3, STICK, TRESCA, sides="displacements", order=2),
    }
    return {f"order 2, {name}": stack for name, stack in cases.items()}


def variations() -> dict[str, Stack]:
    """One thing different at a time, on a mesh of 3 × 3 squares."""
    steel_below = {"upper": Block(**BRASS, height=0.4), "lower": Block(**STEEL, height=0.9)}
    equal = {"upper": Block(**STEEL, height=0.5), "lower": Block(**STEEL, height=0.5)}
    poisson_zero = {"upper": Block(**CORK, height=1.1), "lower": Block(**BRASS, height=0.7)}
    return {
        "steel below, confined": confined_blocks(3, 4e-4, first="lower", **steel_below),
        "steel below, sheared, slip": sheared_stack(3, SLIP, COULOMB, first="lower", **steel_below),
        "equal blocks, sheared, stick": sheared_stack(3, STICK, COULOMB, **equal),
        "equal blocks, confined": confined_blocks(3, 4e-4, **equal),
        "no lateral strain, confined": confined_blocks(3, 4e-4, **poisson_zero),
        "no lateral strain, sheared, slip": sheared_stack(3, SLIP, TRESCA, **poisson_zero),
        "roles swapped, confined": confined_blocks(3, 4e-4, first="lower"),
        "roles swapped, Coulomb stick": sheared_stack(3, STICK, COULOMB, first="lower"),
        "roles swapped, Coulomb slip": sheared_stack(3, SLIP, COULOMB, first="lower"),
        "roles swapped, Tresca slip": sheared_stack(3, SLIP, TRESCA, first="lower"),
        "sheared to the left, Coulomb slip": sheared_stack(3, -SLIP, COULOMB),
        "sheared to the left, Tresca stick": sheared_stack(3, -STICK, TRESCA),
        "sheared across a gap that closes": sheared_stack(3, SLIP, COULOMB, gap=4e-4),
        "sheared across an open gap, Coulomb": sheared_stack(3, SLIP, COULOMB, gap=1.5e-3),
        "sheared across an open gap, Tresca holds": sheared_stack(3, SLIP, TRESCA, gap=1.5e-3),
        "sheared without friction": sheared_stack(3, SLIP, NONE),
        "Coulomb coefficient zero": sheared_stack(3, SLIP, {"law": "coulomb", "coefficient": 0.0}),
        "Tresca bound zero": sheared_stack(3, SLIP, {"law": "tresca", "slip_bound": 0.0}),
        "initial overlap": confined_blocks(3, gap=-5e-4, approach=0.0),
        "initial overlap, sheared": sheared_stack(3, SLIP, COULOMB, gap=-5e-4, approach=0.0),
        "displacements on the sides, confined": confined_blocks(3, 4e-4, sides="displacements"),
        "displacements on the sides, one contact node": sheared_stack(2, SLIP, COULOMB, sides="displacements"),
        "displacements on the sides, Coulomb slip": sheared_stack(5, SLIP, COULOMB, sides="displacements"),
        "displacements on the sides, Tresca stick": sheared_stack(5, STICK, TRESCA, sides="displacements"),
        "displacements on the sides, open": confined_blocks(5, 1.5e-3, sides="displacements"),
        "plane stress, confined": confined_blocks(3, 4e-4, plane="stress"),
        "plane stress, confined by tractions": confined_blocks(2, 4e-4, plane="stress", sides="tractions"),
        "plane stress, Coulomb slip": sheared_stack(3, SLIP, COULOMB, plane="stress"),
        "plane stress, Tresca stick": sheared_stack(3, STICK, TRESCA, plane="stress"),
    }


STACKS = on_a_mesh(1) | on_a_mesh(2) | on_a_mesh(5) | quadratic() | variations()
PUBLISHED = {f"{algorithm}, {splitting}": {"algorithm": algorithm, "splitting": splitting, "theta": 0.4}
             for algorithm in ("original", "modified") for splitting in ("none", "step1", "step2", "step1+2")}
BY_EVERY_METHOD = ["confined, gap closes, n=2", "sheared, Coulomb slip, n=2", "sheared, Tresca slip, n=2"]


def solve(name: str, comm=MPI.COMM_SELF, **method) -> tuple[Stack, dict]:
    """The stack of a name and what is found of it. Collective."""
    stack = STACKS[name]
    return stack, solve_scene(comm, stack.scene(tolerance=TOLERANCE, **method))


def check(stack: Stack, solution: dict) -> None:
    """A solution is certified and exact in displacements, gaps, forces, slips and statuses."""
    assert solution["certified"], f"{solution['reason']}; {solution['certificate']}"
    assert 0 < solution["limit"] <= 50 * TOLERANCE
    assert all(0 <= residual <= solution["limit"] for residual in solution["certificate"].values())

    assert solution["m"] == stack.contact_nodes
    largest = max(np.abs(stack.displacement(body, points)).max() for body, (points, _) in solution["body"].items())
    for body, (points, u) in solution["body"].items():
        assert np.abs(u - stack.displacement(body, points)).max() <= RELATIVE * largest, body
    assert np.abs(solution["gap"] - stack.opening).max() <= RELATIVE * largest

    force = max(stack.pressure, abs(stack.shear)) * solution["length"].max()
    assert np.abs(solution["normal_force"] - stack.pressure * solution["length"]).max() <= RELATIVE * force
    sliding, held = solution["sliding"], np.setdiff1d(np.arange(solution["m"]), solution["sliding"])
    tangential = solution["tangential_force"]
    assert np.abs(tangential - stack.shear * solution["length"])[sliding].max(initial=0.0) <= RELATIVE * force
    assert np.abs(solution["slip"] - stack.slip)[sliding].max(initial=0.0) <= RELATIVE * largest
    assert not tangential[held].any()
    if stack.friction["law"] == "none":  # without tangential unknowns slip is that of the displacements
        assert np.abs(solution["slip"] - stack.slip).max() <= RELATIVE * largest
    else:
        assert not solution["slip"][held].any()
    assert solution["status"] == [stack.status] * solution["m"]


@pytest.mark.parametrize("name", STACKS)
def test_closed_form(name):
    """Newton's method finds linear displacements exactly, and what contacts carry; so is the strain energy."""
    stack, solution = solve(name)
    check(stack, solution)
    order = ("upper", "lower") if stack.first == "upper" else ("lower", "upper")
    expected = [0.5 * (stack.pressure**2 / b.confined(stack.plane) + stack.shear**2 / b.shear)
                * b.height * stack.width for b in (stack.blocks[body] for body in order)]
    assert solution["energy"] == pytest.approx(expected, rel=RELATIVE)
    if stack.sides != "displacements" and stack.first == "upper":
        assert solution["length"].sum() == pytest.approx(stack.width, rel=1e-14)
        assert solution["xy"][:, 0] == pytest.approx(stack.corner[0] + np.linspace(0, stack.width, stack.contact_nodes))
        assert solution["xy"][:, 1] == pytest.approx(stack.corner[1] + stack.lower.height + stack.gap)


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("method", PUBLISHED)
def test_closed_form_by_the_published_iteration(comm, method):
    """So do all variants of the published iteration, the plainest one every other of the stacks that vary something."""
    more = [*[*variations()][::2], "order 2, sheared, Coulomb slip, n=3"] if method == "original, none" else []
    for name in [*BY_EVERY_METHOD, *more]:
        check(*solve(name, comm, **PUBLISHED[method]))


@pytest.mark.parametrize("name, sliding, dropped", [
    ("confined, gap closes, Coulomb, n=2", [1], 0),  # rollers hold the corners along x
    ("confined, gap closes, Coulomb, n=1", [], 0), ("sheared, Coulomb slip, n=2", [0, 1, 2], 0),
    ("displacements on the sides, Coulomb slip", [0, 1, 2, 3], 2)])
def test_clamped_sides_leave_unknowns_out(name, sliding, dropped):
    """Tangential ones where clamps hold both sides along the contact, all where they hold everything."""
    _, solution = solve(name)
    assert (solution["sliding"].tolist(), solution["dropped"]) == (sliding, dropped)
