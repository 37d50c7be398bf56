"""Rigid partners that turn: remote forces and moments on bonded faces, and hinges that press."""

import re
from pathlib import Path

import numpy as np
import pytest
from elsewhere import Elsewhere
from mpi4py import MPI
from scenes import assert_refused, call, certified, rectangle, run_here, write_scene
from solid_scenes import box

import ddmpi
from ddmpi.errors import InputError

LENGTH, HEIGHT, YOUNG, MOMENT = 10.0, 1.0, 1e9, 1e3
STIFF = YOUNG * HEIGHT**3 / 12  # E I, as the depth is 1


def cantilever(d: int, order: int = 2, contact: dict | None = None, **head) -> dict:
    """A beam along x, clamped on the left and bonded to a rigid head on the right, without Poisson's effect."""
    if d == 2:
        body = rectangle(
            "beam", (0.0, 0.0), (LENGTH, HEIGHT), (20, 2), order, YOUNG, 0.0, clamp=["left"]
        )
    else:
        body = box(
            "beam",
            (0.0, 0.0, 0.0),
            (LENGTH, 1.0, HEIGHT),
            (10, 1, 1),
            order,
            YOUNG,
            0.0,
            clamp=[{"on": "left", "x": 0.0, "y": 0.0, "z": 0.0}],
        )
    middle = [LENGTH, *[0.5] * (d - 1)]
    return {
        "body": [body],
        "rigid": [
            {
                "name": "head",
                "shape": "plane",
                "point": middle,
                "pivot": middle,
                "normal": [-1.0] + [0.0] * (d - 1),
            }
            | head
        ],
        "contact": [
            {"bodies": ["beam", "head"], "on": ["right"], "kind": "bonded"} | (contact or {})
        ],
    }


@pytest.mark.parametrize("pivot", [(0.0, 0.0), (0.3, -0.5), (50.0, 20.0), (1e5, 0.0)])
def test_a_remote_moment_bends_a_cantilever(pivot):
    """Its turn is M L / E I wherever the pivot is, and the clamp bears the moment and nothing else, to rounding."""
    at = [LENGTH + pivot[0], 0.5 * HEIGHT + pivot[1]]
    summary = certified(cantilever(2, moment=MOMENT, pivot=at)).summary
    head, turn = summary["rigid"]["head"], MOMENT * LENGTH / STIFF
    assert head["turn"] == pytest.approx(turn, rel=1e-9)
    tip = np.array([0.0, MOMENT * LENGTH**2 / 2 / STIFF])
    assert head["displacement"] == pytest.approx(
        tip + turn * np.array([-pivot[1], pivot[0]]),
        rel=1e-9,
        abs=1e-9 * turn * max(1.0, *np.abs(pivot)),
    )
    assert np.abs(head["force"]).max() <= 1e-10 * MOMENT
    contact, clamp = (
        summary["contacts"]["beam-head"],
        summary["bodies"]["beam"]["reactions"]["left"],
    )
    assert contact["moment"] == pytest.approx(MOMENT, rel=1e-11)
    assert (
        clamp["moment"] == pytest.approx(-MOMENT, rel=1e-8)
        and np.abs(clamp["force"]).max() <= 1e-8 * MOMENT
    )
    assert summary["undetermined"] == [] and summary["warnings"] == []


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_remote_moment_in_space(axis):
    """Bending about y and z is M L / E I; torsion turns about x alone. The beam bears exactly the moment."""
    moment = MOMENT * np.eye(3)[axis]
    summary = certified(cantilever(3, moment=moment.tolist(), pivot=[LENGTH, 0.5, 0.5])).summary
    head, free = summary["rigid"]["head"], MOMENT * LENGTH / STIFF
    assert np.delete(head["turn"], axis) == pytest.approx([0.0, 0.0], abs=1e-9 * free)
    if axis:
        assert head["turn"][axis] == pytest.approx(free, rel=1e-8)
        tip = np.cross(moment, [1.0, 0.0, 0.0]) * LENGTH**2 / 2 / STIFF
        assert head["displacement"] == pytest.approx(tip, abs=1e-8 * free)
    else:
        assert 0.8 * free < head["turn"][0] < 1.2 * MOMENT * LENGTH / (0.1406 * YOUNG / 2)
    about = np.cross([LENGTH, 0.5, 0.5], summary["contacts"]["beam-head"]["force"])
    assert np.array(summary["contacts"]["beam-head"]["moment"]) - about == pytest.approx(
        moment, abs=1e-9 * MOMENT
    )
    assert head["moment"] == pytest.approx(-moment, abs=1e-9 * MOMENT)


def test_a_remote_force():
    """A force beside the face bends by its arm, whatever point of its line is the pivot; turned and in other units."""
    force, arm = -MOMENT, 3.0
    scene = cantilever(2, turns=True, force=[0.0, force], pivot=[LENGTH + arm, 7.0])
    head = certified(scene).summary["rigid"]["head"]
    turn = force * (LENGTH**2 / 2 + arm * LENGTH) / STIFF
    assert head["turn"] == pytest.approx(turn, rel=1e-9)
    assert head["moment"] == pytest.approx(0.0, abs=1e-9 * MOMENT)
    Q = np.array([[0.8, -0.6], [0.6, 0.8]])
    other = certified(Elsewhere(Q, length=1e-3, stress=1e6).scene(scene)).summary["rigid"]["head"]
    assert other["turn"] == pytest.approx(turn, rel=1e-8)
    assert other["displacement"] == pytest.approx(1e3 * Q @ head["displacement"], rel=1e-8)


def test_the_example_of_the_page():
    """The scene in docs/use/bolts.md is one: force and moment reach the clamp, with the arm of the pivot."""
    page = (Path(ddmpi.__file__).parents[1] / "docs" / "use" / "bolts.md").read_text(
        encoding="utf-8"
    )
    (scene,) = (
        block for block in re.findall(r"```toml\n(.*?)```", page, re.DOTALL) if "[[body]]" in block
    )
    clamp = certified(scene).summary["bodies"]["beam"]["reactions"]["left"]
    assert clamp["force"] == pytest.approx([0.0, 0.0, 500.0], abs=1e-6)
    assert clamp["moment"] == pytest.approx([250.0, -1e3 - 12.0 * 500.0, 0.0], abs=1e-5)


def test_a_hinge_where_the_displacement_is_given():
    """A bonded face that turns about a point which stays: M L / 4 E I and the force 3 M / 2 L, of a slender beam."""
    scene = cantilever(2, moment=MOMENT, displacement=[0.0, 0.0])
    summary = certified(scene).summary
    head = summary["rigid"]["head"]
    assert head["displacement"] == [0.0, 0.0]
    assert head["turn"] == pytest.approx(MOMENT * LENGTH / 4 / STIFF, rel=0.02)
    assert head["force"][1] == pytest.approx(1.5 * MOMENT / LENGTH, rel=0.02)
    clamp = summary["bodies"]["beam"]["reactions"]["left"]
    assert clamp["moment"] == pytest.approx(-MOMENT + LENGTH * head["force"][1], rel=1e-7)
    # With the longitudinal motion held alone the beam bends freely.
    scene["rigid"][0] |= {"free": ["y"]}
    assert certified(scene).summary["rigid"]["head"]["turn"] == pytest.approx(
        MOMENT * LENGTH / STIFF, rel=1e-9
    )
    # without a load on it the head is a hinge of the face by itself, and carries nothing of a longitudinal load
    scene = cantilever(2, turns=True)
    scene["body"][0]["traction"] = [{"on": "top", "value": [0.0, -100.0]}]
    head = certified(scene).summary["rigid"]["head"]  # 3/8 of a uniform load, q L³ / 48 E I
    assert head["force"][1] == pytest.approx(-375.0, rel=0.02) and head["displacement"] == [
        0.0,
        0.0,
    ]
    assert head["turn"] == pytest.approx(100.0 * LENGTH**3 / 48 / STIFF, rel=0.05)


def lever(d: int, law: dict | None = None, lift: float = 0.0, order: int = 1, **lid) -> dict:
    """A block under a lid that turns about an axis on its left, where the moment 1e5 presses it down."""
    axis = [-1.0, *[0.5] * (d - 2), 1.0 + lift]
    clamp = [{"on": "bottom"} | {key: 0.0 for key in "xyz"[:d]}]
    body = (
        rectangle("block", (0.0, 0.0), (1.0, 1.0), (6, 6), order, clamp=clamp)
        if d == 2
        else box("block", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (3, 3, 3), order, 1e9, clamp=clamp)
    )
    up = [0.0] * (d - 1) + [-1.0]
    return {
        "body": [body],
        "rigid": [
            {
                "name": "lid",
                "shape": "plane",
                "point": axis,
                "normal": up,
                "pivot": axis,
                "moment": -1e5 if d == 2 else [0.0, 1e5, 0.0],
            }
            | lid
        ],
        "contact": [
            {"bodies": ["block", "lid"], "on": ["top"]} | ({"friction": law} if law else {})
        ],
    }


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("d", "law", "lift", "order"),
    [
        (2, None, 0.0, 1),
        (2, {"law": "coulomb", "coefficient": 0.3}, 0.01, 2),
        (3, {"law": "coulomb", "coefficient": 0.3}, 0.01, 1),
        (3, {"law": "tresca", "slip_bound": 1e4}, 0.0, 2),
    ],
)
def test_a_lever_presses_as_its_moment_says(d, law, lift, order):
    """The pivot stays, the moment of the contact forces about it is the given one, and gaps are those of the turn."""
    answer = certified(lever(d, law, lift, order))
    lid, (state,) = answer.summary["rigid"]["lid"], answer.contacts.values()
    about = np.array([-1.0, *[0.5] * (d - 2), 1.0 + lift])
    arms = state.interface.geometry.at[0] - about
    # The opposite forces act on the lid.
    around = -arms[:, 0] * state.forces[:, -1] + arms[:, -1] * state.forces[:, 0]
    assert around.sum() == pytest.approx(1e5, rel=1e-9) and lid["displacement"] == [0.0] * d
    turn = lid["turn"] if d == 2 else -lid["turn"][1]
    assert turn < -0.5 * lift
    if d == 2 and order == 1:
        body = answer.bodies["block"]
        on_top = np.array(
            [
                body.displacement[np.linalg.norm(body.points - at, axis=1).argmin()]
                for at in state.interface.xy
            ]
        )
        assert state.gap == pytest.approx(lift + turn * arms[:, 0] - on_top[:, 1], abs=1e-12)


def test_a_partner_that_turns_on_clamped_nodes():
    """A flat lid that meets a clamped corner turns no farther, and the corner bears the whole moment."""
    scene = lever(2)
    scene["body"][0]["clamp"] = ["bottom", "left"]
    lid = certified(scene).summary["rigid"]["lid"]
    assert lid["turn"] == pytest.approx(0.0, abs=1e-12)
    assert lid["force"] == pytest.approx([0.0, 1e5], rel=1e-8, abs=1e-3)


@pytest.mark.clarabel
def test_a_lever_that_nothing_bears():
    """A moment that lifts the lid has no equilibrium, in words that name it."""
    answer = ddmpi.solve(lever(2, moment=1e5), MPI.COMM_SELF)
    assert answer.reason == "no equilibrium: lid would move most at (1.08, 1), along y"
    answer = certified(lever(3))
    held = [motion["motion"] for motion in answer.summary["held_motions"]]
    assert held and all("lid can move" in text for text in held)


@pytest.mark.slow
def test_load_steps(tmp_path):
    """A moment that comes and goes: works balance at each step; check, log and pictures know it."""
    scene = lever(2, {"law": "coulomb", "coefficient": 0.3}, history="push") | {
        "history": {"push": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.3]}},
        "time": {"points": [1.0, 2.0], "steps": 2},
        "output": {"steps": "all"},
    }
    path = write_scene(scene, tmp_path / "scene.toml")
    done = call("check", str(path), "--no-figures")
    assert "rigid lid: turned by a moment -1e+05 about (-1, 1) (history push)" in done.output, (
        done.output
    )
    run = run_here(path, tmp_path / "out")
    assert run.code == 0 and "moment of bodies 3e+04 N·m/m, turn -1.0" in run.stdout, run.stdout
    summary = certified(scene).summary
    assert summary["energy"]["residual"] <= 1e-10
    moments = [step["rigid"]["lid"]["moment"] for step in summary["steps"]]
    assert moments == pytest.approx([5e4, 1e5, 6.5e4, 3e4], rel=1e-9)
    assert summary["steps"][-1]["rigid"]["lid"]["turn"] == summary["rigid"]["lid"]["turn"]


@pytest.mark.parametrize(
    ("lid", "words"),
    [
        (
            {"pivot": None},
            "rigid.lid: moment needs pivot = […], the point about which the partner turns",
        ),
        ({"moment": None, "turns": True, "pivot": None}, "rigid.lid: turns needs pivot"),
        ({"moment": None}, "rigid.lid: pivot goes with a moment, or with turns = true"),
        ({"moment": 0.0}, "rigid.lid: moment must not be zero"),
        ({"moment": [0.0, 1.0, 0.0]}, "rigid.lid.moment: [0.0, 1.0, 0.0] is in space"),
        ({"free": ["z"]}, "rigid.lid.free: there is no z in the plane"),
        (
            {"free": ["x"], "displacement": [1e-3, 0.0]},
            "rigid.lid: along x it has both freedom to move and a displacement",
        ),
        (
            {"axisymmetric": True},
            "rigid.lid.pivot: an axisymmetric partner is pushed along y only and does not",
        ),
    ],
)
def test_a_turn_is_refused(lid, words):
    """Each mistake of a partner that turns has one message."""
    scene = lever(2)
    scene |= {"axisymmetric": True} if lid.pop("axisymmetric", None) else {}
    scene["body"][0]["mesh"]["origin"] = [0.0, 0.0]
    scene["rigid"][0] = {
        key: value for key, value in (scene["rigid"][0] | lid).items() if value is not None
    }
    assert_refused(scene, words)


def test_a_moment_in_space_has_three_components():
    scene = lever(3, moment=1e5)
    with pytest.raises(
        InputError, match=r"rigid\.lid\.moment: a moment in space has three components"
    ):
        ddmpi.solve(scene, MPI.COMM_SELF)


def test_a_partner_that_is_free_without_a_force_is_in_equilibrium():
    """Its contact forces cancel along the free axes: what is left is rounding beside them, and not beside their sum."""
    answer = ddmpi.solve(
        {
            "body": [
                {
                    "name": "beam",
                    "mesh": {"shape": "box", "size": [4, 1, 1], "divisions": [8, 2, 2]},
                    "material": {"young": 1e5, "poisson": 0.3},
                    "clamp": ["left"],
                }
            ],
            "rigid": [
                {
                    "name": "plate",
                    "shape": "plane",
                    "point": [4, 0, 0],
                    "normal": [-1, 0, 0],
                    "free": ["x", "y"],
                    "pivot": [4, 0.5, 0.5],
                    "turns": True,
                    "displacement": [0, 0, 0.1],
                }
            ],
            "contact": [{"bodies": ["beam", "plate"], "on": ["right"], "kind": "bonded"}],
        },
        MPI.COMM_SELF,
    )
    assert answer.certified and answer.summary["certificate"]["equilibrium"] < 1e-9
    assert answer.summary["rigid"]["plate"]["force"][2] == pytest.approx(-73.06, rel=1e-3)
