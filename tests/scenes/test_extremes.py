"""The default method at the extremes of material, friction, shape, size and load, on small meshes.

Every scene is certified at 1e-8 and gives the contact forces of the coupled problem, which
`tests/support/brute_force.py` finds by brute force, or is refused for a reason. Most run on one rank, random scenes on
two. The same scenes on larger meshes: scripts/extremes.py.
"""

import copy

import numpy as np
import pytest
from extremes import (
    NO_FRICTION,
    OTHER_ORDER,
    coulomb,
    divisions,
    jump,
    loads,
    material,
    size,
    tresca,
)
from extremes_in_space import attempt_solid, side_by_side
from mpi4py import MPI
from scenes import everywhere, exact_forces, pinched_blocks, prepare_scene, the_interface

from ddmpi.scene.keys import override

pytestmark = pytest.mark.slow

N = 6
TOLERANCE, DISTANCE = 1e-8, 1e-6
two_ranks = pytest.mark.mpi(ranks=2)


def scene(*changes: dict, N: int = N, law: str = "coulomb") -> dict:
    """Pinched blocks with `changes` by key."""
    made = copy.deepcopy(pinched_blocks(N, law, tolerance=TOLERANCE))
    for change in changes:
        for key, value in change.items():
            override(made, key, value)
    return made


def clamps(upper: list, lower: list) -> dict:
    """Other clamps, without the loads on what they hold."""
    held = {"upper": upper, "lower": lower}
    loaded = {body["name"]: body["traction"] for body in pinched_blocks(N)["body"]}
    return {f"body.{name}.clamp": groups for name, groups in held.items()} | {
        f"body.{name}.traction": [load for load in loaded[name] if load["on"] not in groups]
        for name, groups in held.items()
    }


def find(comm, made: dict):
    """The assembly, its answer, the outer iteration, and the distance from the coupled problem. Collective."""
    assembly, answer = find_answer(comm, made)
    outer = answer.outer
    exact = exact_forces(assembly)
    distance = np.linalg.norm(everywhere(assembly, outer.forces) - exact) / (
        np.linalg.norm(exact) or 1.0
    )
    return assembly, answer, outer, distance


def state_of(answer):
    (state,) = answer.states.values()
    return state


def find_answer(comm, made: dict):
    """The assembly and its answer. Collective."""
    from ddmpi.run.solve import solve

    assembly = prepare_scene(comm, made)
    return assembly, solve(assembly, assembly.scene.method)


LAWS = ("coulomb", "tresca", "none")
LIFTING = loads({"top": (0.0, 6e7)}, {"bottom": (0.0, -6e7)})
ROLLER = [{"on": "left", "x": 0.0}, {"on": "right", "x": 0.0, "y": 0.0}]
THIN = divisions(12, 1)
"""One row of elements, held on the far side: no other node is left, or hardly any."""

EXTREMES = {
    "stiffness contrasts with either body first": {
        f"E1/E2 = {factor:g}, {'lower' if swap else 'upper'} body in role 1": scene(
            material(upper=factor), swap
        )
        for factor in (1e-6, 1e-2, 1e4, 1e6)
        for swap in ({}, OTHER_ORDER)
    },
    "friction from none to sticking": {
        name: scene(change)
        for name, change in (
            {f"coulomb {F:g}": coulomb(F) for F in (0.0, 1e-6, 1.0, 10.0)}
            | {f"tresca {g:g}": tresca(g) for g in (0.0, 1e3, 1.2e7, 1e20)}
            | {
                "none": NO_FRICTION,
                "bound jumps": tresca(jump(1e5, 3e7)),
                "coefficient jumps": coulomb(jump(10.0, 0.01)),
                "rough half": coulomb(jump(0.0, 1.0)),
            }
        ).items()
    },
    "Poisson ratios up to nearly incompressible": {
        f"{pair}": scene(material(poisson=pair))
        for pair in ((0.0, 0.0), (0.4999, 0.4999), (0.0, 0.4999), (0.4999, 0.0), (-0.9, 0.4))
    },
    "flat triangles, slender bodies, one node": {
        name: scene(change)
        for name, change in {
            "3 x 0.003, 1 x 3 triangles": divisions(3, 1000),
            "0.1 x 1": divisions(30, 1),
            "0.01 x 3": divisions(100, 1) | size(1.0, 3.0),
            "slender": divisions(40, 2) | size(3.0, 0.1),
            "one node": divisions(1, 1),
            "two nodes": divisions(2, 1),
        }.items()
    },
    "loads that lift, press one body, or are absent": {
        f"{name}, {law}": scene(change, law=law)
        for name, change in {
            "lifted": LIFTING,
            "no load": loads({}, {}),
            "upper only": loads({"top": (0.0, -6e7), "right": (2e7, 3e7)}, {}),
            "lower only": loads({}, {"bottom": (0.0, 4e7)}),
            "a billionth": loads({"top": (0.0, -0.06)}, {}),
        }.items()
        for law in LAWS
    },
    # left of one body, right of the other; a roller; a rigid foundation, which does not yield at all
    "clamps that hold one body at contact nodes only": {
        f"{name}, {law}": scene(change, law=law)
        for name, change in (
            {
                f"{sides} of contact nodes only": THIN | clamps(*sides)
                for sides in ((["top"], ["bottom"]), (["top"], ["left"]), (["left"], ["bottom"]))
            }
            | {
                "left and right": clamps(["left"], ["right"]),
                "right and left": clamps(["right"], ["left"]),
                "roller": clamps(["left"], ROLLER),
                "foundation": clamps(["left"], ["bottom", "top"]),
                "foundation above": clamps(["bottom"], ["bottom"]),
            }
        ).items()
        for law in LAWS
    },
}


@pytest.mark.parametrize("kind", EXTREMES)
def test_extremes_are_certified_and_right(kind):
    for name, made in EXTREMES[kind].items():
        _, answer, _, distance = find(MPI.COMM_SELF, made)
        assert answer.certified and distance <= DISTANCE, (
            name,
            answer.reason,
            answer.violations,
            distance,
        )


def test_friction_of_nothing_is_none():
    found = []
    for change in (NO_FRICTION, coulomb(0.0), tresca(0.0)):
        assembly, _, outer, _ = find(MPI.COMM_SELF, scene(change))
        normal, tangential = np.split(everywhere(assembly, outer.forces), [assembly.m])
        found.append(normal)
        assert (
            normal == pytest.approx(found[0], rel=1e-6, abs=1e-6 * normal.max())
            and not tangential.any()
        )


def test_bodies_that_are_lifted_take_one_step():
    assembly, answer, outer, _ = find(MPI.COMM_SELF, scene(LIFTING))
    assert state_of(answer).count("open") == assembly.m
    assert not outer.forces.any() and len(outer.history) == 1


def test_thin_triangles_in_a_single_row():
    """1000 of 3 mm × 1 m: softening solves its linear problems until the forces are known, too."""
    _, answer = find_answer(MPI.COMM_SELF, scene(divisions(1000, 1)))
    assert answer.certified


def test_contact_at_a_corner_only(comm):
    """A gap that only the tip of the upper block, bent down, overcomes."""
    for law in ("coulomb", "tresca"):
        bent = scene(
            {"body.upper.mesh.origin": [0.0, 1.006]}, loads({"right": (0.0, -1e8)}, {}), law=law
        )
        assembly, answer, _, distance = find(comm, bent)
        assert answer.certified and distance <= DISTANCE
        closed = np.flatnonzero(state_of(answer).normal_force)
        assert 1 <= len(closed) <= 3
        assert the_interface(assembly).xy[closed, 0].min() > 2.5


@pytest.mark.parametrize(
    "sides, dropped", [((["left"], ["right"]), 0), ((["left"], ["bottom", "top"]), 1)]
)
def test_nodes_that_clamps_of_both_bodies_hold_drop_out(sides, dropped):
    assembly, answer, _, _ = find(MPI.COMM_SELF, scene(clamps(*sides)))
    assert len(the_interface(assembly).fixed.gap) == dropped
    assert state_of(answer).gap.min() >= -1e-9 * max(
        np.abs(u).max() for u in answer.displacements.values()
    )


def test_touching_bodies_without_pressure_that_slide(comm):
    """The upper block is moved along the lower one, by a millimetre and pressed by less than rounding."""
    for law in ("coulomb", "none"):
        for pressed in (0.0, -1e-15, -1e-12, -1e-10, -1e-6):
            held = clamps([{"on": "top", "x": 1e-3, "y": pressed}], ["bottom"])
            made = scene(held, loads({}, {}), law=law)
            _, answer = find_answer(comm, made)
            assert answer.certified, (law, pressed, answer.violations)
    _, answer, _, distance = find(comm, made)  # a millionth of a metre
    assert answer.certified and distance <= DISTANCE


def test_a_huge_friction_coefficient_ends_in_good_order(comm):
    """𝓕 = 100 and more, where there may be no solution: certified and right, or stopped without a claim."""
    for F in (1e2, 1e3, 1e4):
        made = scene(
            material(upper=1e-2, poisson=(0.45, 0.0)),
            coulomb({"along": "x", "points": [0.0, 1.0, 2.0, 3.0], "values": [0.0, F, F, 0.5]}),
        )
        made["method"]["max_iterations"] = 150
        _, answer = find_answer(comm, made)
        assert answer.certified or answer.stopped in ("max_iterations", "stalled")
        updates = [step.update for step in answer.outer.history]
        assert sum(update == 0.0 for update in updates) <= 10, "iterations that do nothing"


@two_ranks
@pytest.mark.clarabel
def test_bodies_that_clamps_do_not_hold_are_held_by_contact_or_the_reason_is_named(comm):
    """By friction they are; without it, a body without a clamp along x would slide. The published iteration refuses."""
    from ddmpi.errors import InputError

    for held, slides in (
        ([{"on": "left", "x": 0.0}], False),
        ([{"on": "top", "y": 0.0}], True),
    ):
        change = {"body.upper.clamp": held}
        for law in ("coulomb", "none"):
            _, answer = find_answer(comm, scene(change, law=law))
            assert answer.certified == (law == "coulomb" or not slides), answer.reason
            assert answer.certified or answer.reason == "no equilibrium: upper would move along x"
        for method in ({"theta": 0.2}, {"outer": "anderson"}):
            with pytest.raises(InputError, match="a clamp constrains one body only"):
                prepare_scene(comm, scene(clamps(["left"], ["right"])) | {"method": method})
            with pytest.raises(
                InputError, match=r"method\.outer = .*of 'upper' leave a rigid motion free.*newton"
            ):
                prepare_scene(comm, scene(change) | {"method": method})


def test_bodies_that_are_too_slender_are_refused_with_the_reason(comm):
    from ddmpi.errors import SolverError

    with pytest.raises(SolverError, match=r"body '(upper|lower)'.*true residual"):
        # This cantilever is singular to the last digits.
        find(comm, scene(divisions(66, 6), size(3.0, 0.003)))


@pytest.mark.parametrize("slenderness", [30, 100])
def test_slender_solids_take_few_steps(slenderness):
    """10 to 13 steps; 18 to 28 where GMRES stops by displacements alone, most of which are bending."""
    for pairs in (True, False):
        row, _ = attempt_solid(side_by_side(slenderness)(pairs, 1), None, None)
        assert row["outcome"] == "certified" and row["iterations"] <= 17, row
