"""Bolts: a bond that a pretension pulls, given while tightened, with its offset kept after."""

import numpy as np
import pytest
from bolts import AREAS, FORCE, HEIGHT, HISTORY, YOUNG, bar, joint, of_joint
from mpi4py import MPI
from scenes import assert_refused, call, certified, run_here, seldom, write_scene

import ddmpi
from ddmpi.methods import newton, paths


def pretension(summary: dict, name: str = "cut") -> list[float]:
    """Force and offset of a contact in a summary, or in one of its steps."""
    return list(summary["contacts"][name]["pretension"].values())


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("d", "order", "n", "sign", "swapped"),
    [(2, 1, 2, 1.0, False), (2, 2, 3, -1.0, True), (3, 1, 3, 1.0, True), (3, 2, 2, -1.0, False)],
)
def test_a_bar_that_is_pulled_in_the_middle(d, order, n, sign, swapped):
    """The force is the given one, and the offset F L / E A; in any direction, order of bodies, on any meshes."""
    scene = bar(d, order, n, force=sign * FORCE, along=[2.5] + [0.0] * (d - 1))
    if swapped:
        (contact,) = scene["contact"]
        contact |= {"bodies": ["two", "one"], "on": ["left", "right"]}
        contact["pretension"]["along"][0] *= -1.0
    answer = certified(scene)
    assert pretension(answer.summary) == pytest.approx(
        [sign * FORCE, sign * 3.0 * FORCE / YOUNG], rel=1e-8
    )
    assert answer.summary["bodies"]["one"]["reaction"][0] == pytest.approx(-sign * FORCE, rel=1e-8)
    assert np.abs(answer.contacts["cut"].gap).max() <= 1e-8 * 3.0 * FORCE / YOUNG
    assert set(answer.contacts["cut"].status) == {"stick"} and answer.summary["warnings"] == []


@pytest.mark.parametrize(
    ("kind", "order", "n"),
    [
        seldom("plane", 1, 3),
        seldom("plane", 2, 4),
        ("axis", 1, 4),
        seldom("axis", 2, 3),
        seldom("space", 1, 3),
    ],
)
def test_a_joint_under_load(kind, order, n):
    """The offset stays, to the bit; the bolt takes a part of the load by the stiffness ratio, then all of it."""
    summary = certified(joint(kind, order, n, steps=2)).summary
    for step in summary["steps"]:
        assert pretension(step) == pytest.approx(of_joint(kind, step["time"]), rel=1e-8), step[
            "time"
        ]
    assert len({pretension(step)[1] for step in summary["steps"][1:]}) == 1
    assert pretension(summary) == pretension(summary["steps"][-1])
    assert summary["energy"]["residual"] <= 1e-10
    assert summary["contacts"]["sleeve-head"]["normal_force"] == 0.0


def test_a_force_without_history_stays():
    """The force is the given one in every load step; the sleeve alone gives way, F/k_b + (F − P)/k_s."""
    scene = joint(steps=1)
    del scene["contact"][0]["pretension"]["history"]
    scene |= {"history": {"work": HISTORY["work"]}, "time": {"points": [1.0, 2.0], "steps": 1}}
    steps = certified(scene).summary["steps"]
    shank, sleeve = (FORCE * HEIGHT / area / YOUNG for area in AREAS["plane"])
    assert pretension(steps[0]) == pytest.approx([FORCE, shank + sleeve], rel=1e-8)
    assert pretension(steps[1]) == pytest.approx([FORCE, shank + 0.5 * sleeve], rel=1e-8)


def test_the_last_time_ends_the_force():
    """The force is given until the last time of its history, a flat part included; a load step ends there."""
    scene = joint(steps=1)
    scene["history"] = HISTORY | {"tighten": {"times": [0.0, 1.0, 1.5], "factors": [0.0, 1.0, 1.0]}}
    steps = certified(scene).summary["steps"]
    assert [step["time"] for step in steps] == [1.0, 1.5, 2.0, 3.0]
    forces, offsets = zip(*map(pretension, steps), strict=True)
    assert forces[1] == pytest.approx(FORCE, rel=1e-9) and forces[2] > 1.01 * FORCE
    assert offsets[1] < 0.95 * offsets[0] and offsets[1] == offsets[2] == offsets[3]


@pytest.mark.parametrize("path", [paths.Softening, seldom(paths.InteriorPoints)])
def test_all_ways_to_the_answer_keep_the_offset(path, monkeypatch):
    """The paths of Newton's method, which begin without forces, end with the same forces and offsets."""
    scene = joint(steps=1, poisson=0.3, law={"law": "coulomb", "coefficient": 0.2})
    expected = [pretension(step) for step in certified(scene).summary["steps"]]
    monkeypatch.setattr(newton, "PATIENCE", 0)
    monkeypatch.setattr(newton, "PATHS", [path])
    assert [pretension(step) for step in certified(scene).summary["steps"]] == [
        pytest.approx(one, rel=1e-7) for one in expected
    ]


@pytest.mark.slow
def test_products_by_multigrid():
    """With an iterative compliance, whose steps are by a model, forces and offsets are the same."""
    scene = joint(steps=1)
    steps = certified(scene, method__compliance="iterative").summary["steps"]
    assert [pretension(step) for step in steps] == [
        pytest.approx(of_joint("plane", step["time"]), rel=1e-7) for step in steps
    ]


@pytest.mark.slow
@pytest.mark.clarabel
def test_a_nut_in_the_air(tmp_path):
    """A bolt that nothing holds against its pretension has no equilibrium, in words that name the contact."""
    scene = joint()
    del scene["body"][0]["clamp"]
    answer = ddmpi.solve(scene, MPI.COMM_SELF)
    assert answer.reason.startswith(
        "no equilibrium: lower and pretension of cut would move along y "
        "(or should its `along` be turned round?)"
    )
    run = run_here(write_scene(scene, tmp_path / "scene.toml"), tmp_path / "out")
    assert run.code == 3


def test_check_and_log_tell_it(tmp_path):
    """`ddmpi check` names the pull; the log ends with force and offset."""
    path = write_scene(bar(), tmp_path / "scene.toml")
    assert (
        "contact cut: pulled by 100000 along (1, 0)"
        in call("check", str(path), "--no-figures").output
    )
    run = run_here(path, tmp_path / "out", "--no-figures")
    assert run.code == 0 and "; pretension 1e+05 N/m at the offset 0.0003 m" in run.stdout, (
        run.stdout
    )


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        (
            {"kind": "unilateral"},
            'contact.cut: pretension goes with kind = "bonded", a bond that is pulled as a whole; '
            "this contact is unilateral",
        ),
        ({"kind": "guided"}, "this contact is guided"),
        ({"clamp": True}, "contact.cut.pretension: at (1, 0) clamps hold both sides along (0, 1)"),
    ],
)
def test_a_pretension_is_refused(contact, words):
    """In words, before any work; other mistakes of a pretension are in tests/products/bounds.py."""
    scene = bar()
    if contact.pop("clamp", False):
        for body in scene["body"]:
            body["clamp"].append({"on": "bottom", "y": 0.0})
        scene["contact"][0]["pretension"]["along"] = [0.0, 1.0]
    scene["contact"][0] |= contact
    assert_refused(scene, words)
