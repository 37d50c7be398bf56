"""Load steps: friction with a memory, against closed forms; steps by accuracy; energy; files; restart."""

import copy
import dataclasses
import tomllib

import made_up
import meshio
import numpy as np
import pytest
from mpi4py import MPI
from restarts import go_on_from_checkpoints
from scenes import (
    COULOMB,
    FLOOR,
    ROOT,
    assert_refused,
    certified,
    pinched_blocks,
    rectangle,
    run_here,
    sheared_stack,
    write_scene,
)
from solid_scenes import box

import ddmpi
from ddmpi.cli.report import write_report
from ddmpi.errors import InputError
from ddmpi.methods.newton import Newton
from ddmpi.pictures.curves import draw_steps
from ddmpi.pictures.moved import magnify, rigid_parts
from ddmpi.results.histories import at_step
from ddmpi.results.tables import read_results
from ddmpi.run.gather import StepLog
from ddmpi.run.steps import MARKS, March

SHIFTS, SHEARS = (0.0, 1.0, 2.0, 0.0, -1.0, 0.0), (0.0, 1.0, 1.0, -1.0, -1.0, 0.0)
"""How far a pressed stack is shifted, over what makes it slip; its shear stress, over the slip bound."""


def turned_stack(**time) -> tuple[dict, float, float]:
    """A stack that is pressed and then shifted by SHIFTS; the shift that makes it slip (m), the slip bound (Pa)."""
    stack = sheared_stack(3, 1.0, COULOMB)
    bound = stack.slip_bound
    limit = bound * stack._shear_compliance
    stack = dataclasses.replace(stack, shift=limit)
    scene = stack.scene(tolerance=1e-10)
    top = scene["body"][0]["clamp"][0]
    scene["body"][0]["clamp"] = [
        {"on": "top", "y": top["y"]},
        {"on": "top", "x": limit, "history": "shift"},
    ]
    for body in scene["body"]:
        body["traction"] = [
            each
            for load in body["traction"]
            for each in (
                {"on": load["on"], "value": [load["value"][0], 0.0]},
                {"on": load["on"], "value": [0.0, load["value"][1]], "history": "shear"},
            )
        ]
    times = [float(k) for k in range(len(SHIFTS))]
    scene["history"] = {
        "shift": {"times": times, "factors": list(SHIFTS)},
        "shear": {"times": times, "factors": list(SHEARS)},
    }
    return scene | {"time": {"points": times[1:]} | time}, limit, bound


def sheared_blocks(**time) -> dict:
    """The pinched blocks, pressed and then pulled to and fro, so that zones slip, stick and open."""
    scene = pinched_blocks(3, tolerance=1e-10)
    scene["body"][0]["traction"][0]["history"] = "press"
    scene["body"][0]["traction"][1] |= {"value": [6.0e7, 3.0e7], "history": "pull"}
    scene["body"][1]["traction"][0]["history"] = "press"
    scene["history"] = {
        "press": {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
        "pull": {"times": [1.0, 2.0, 3.0], "factors": [0.0, 1.0, 0.4]},
    }
    return scene | {"time": {"points": [1.0, 2.0, 3.0]} | time}


def circle(**time) -> dict:
    """Unlike blocks that touch along y = 0 with the gap of a circle, pressed: nodes slip while the contact grows."""
    x, clamp = np.linspace(-4.0, 4.0, 33), [{"on": "top", "x": 0.0, "y": -0.06, "history": "press"}]
    return {
        "body": [
            rectangle("soft", (-4, 0), (8, 4), (32, 16), young=1.0, clamp=clamp),
            rectangle("hard", (-4, -4), (8, 4), (32, 16), young=10.0, clamp=["bottom"]),
        ],
        "contact": [
            {
                "bodies": ["soft", "hard"],
                "on": ["bottom", "top"],
                "friction": COULOMB,
                "gap": {"along": "x", "points": x.tolist(), "values": (x**2 / 60.0).tolist()},
            }
        ],
        "history": {"press": {"times": [0.0, 1.0], "factors": [0.0, 1.0]}},
        "time": {"points": [1.0]} | time,
    }


def sheared(press: float, **gap) -> dict:
    """Blocks that are pressed by a clamp, or a gap below zero, from time 0 on, and sheared in two legs."""
    top = [{"on": "top", "y": -press}, {"on": "top", "x": 1e-4, "history": "shift"}]
    return {
        "body": [
            rectangle(name, (0, y), (2, 1), (6, 4), young=2e11, clamp=clamp)
            for name, y, clamp in (("up", 1.0, top), ("low", 0.0, ["bottom"]))
        ],
        "contact": [{"bodies": ["up", "low"], "on": ["bottom", "top"], "friction": COULOMB, **gap}],
        "history": {"shift": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 0.2, 1.0]}},
        "time": {"points": [1.0, 2.0]},
    }


def pressed_blocks(factors: list[float], friction: dict = COULOMB) -> dict:
    """A loose block upon a loose one upon a floor, with a mirror at the left, pressed from above by `factors`."""
    times, mirror = [float(k) for k in range(len(factors))], [{"on": "left", "x": 0.0}]
    load = {"on": "top", "value": [0.0, -1.0e6], "history": "press"}
    return {
        "body": [
            rectangle("upper", (0, 1), (2, 1), (12, 6), clamp=mirror, traction=[load]),
            rectangle("lower", (0, 0), (2, 1), (8, 4), young=3e9, clamp=mirror),
        ],
        "rigid": [dict(FLOOR)],
        "contact": [
            {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": friction},
            {"bodies": ["lower", "floor"], "on": ["bottom"], "friction": friction},
        ],
        "history": {"press": {"times": times, "factors": factors}},
        "time": {"points": times[1:]},
    }


@pytest.mark.parametrize("steps", [1, 3])
def test_friction_remembers_how_it_was_sheared(steps):
    """Stress, slip and dissipation of a stack that is sheared to and fro are those of an elastic-plastic spring."""
    scene, limit, bound = turned_stack(steps=steps)
    answer = certified(scene)
    (contact,) = answer.contacts.values()
    (name,) = answer.contacts
    width = contact.interface.area.sum()
    steps_of = {step["time"]: step["contacts"][name] for step in answer.summary["steps"]}
    assert len(steps_of) == 5 * steps
    for time, factor in enumerate(SHEARS[1:], start=1):
        assert abs(steps_of[float(time)]["force"][0]) == pytest.approx(
            abs(factor) * bound * width, abs=1e-6 * bound
        )
    assert steps_of[3.0]["force"][0] == pytest.approx(-steps_of[2.0]["force"][0], rel=1e-6)
    assert np.abs(contact.shear).max() <= 1e-6 * bound
    total = 2.0 * bound * limit * width
    assert answer.summary["contacts"][name]["dissipated"] == pytest.approx(total, rel=1e-6)
    energy = answer.summary["energy"]
    assert energy["residual"] <= 1e-9
    assert energy["dissipated"] == pytest.approx(total, rel=1e-6)
    assert energy["external_work"] == pytest.approx(
        energy["strain_energy"] + energy["interface_work"], rel=1e-9
    )


@pytest.mark.slow
@pytest.mark.parametrize(("stuck", "slipped", "percent"), [(0.78, 9.0, 11), (0.82, 9.0, 0)])
def test_given_steps_that_are_too_long_for_energies_are_told(stuck, slipped, percent):
    """In a step that begins at a part of the slip bound and ends with slip, contacts take ½ (1 + part) of what friction
    dissipates; one more step, to the bound, ends that."""
    scene, *_ = turned_stack(steps=1)
    for points in ([stuck], [stuck, 1.0]):
        times = [float(k) for k in range(len(points) + 2)]
        for name, last in ("shift", slipped), ("shear", 1.0):
            scene["history"][name] = {"times": times, "factors": [0.0, *points, last]}
        scene["time"]["points"] = times[1:]
        answer = certified(scene)
        energy = answer.summary["energy"]
        told = [each for each in answer.summary["warnings"] if "too long for energies" in each]
        short = -energy["lost"] / energy["dissipated"]
        assert short == pytest.approx(0.5 * (1.0 - points[-1]), abs=1e-6)
        assert len(told) == (percent > 0 and points == [stuck])
        assert all(f"more than contacts take, by {percent} % " in each for each in told)


def test_no_step_makes_up_for_one_that_is_too_long():
    """Contacts take 1 J less than friction dissipates in one step, and 2 J more in the next one, where gaps close."""
    log = StepLog()
    log.energies = [
        [time, 9.0, 9.0, took, 4.0 * time, 0.0] for time, took in ((1.0, 3.0), (2.0, 9.0))
    ]
    assert log.excess({"energies": ()}) == 1.0 / 8.0
    assert log.excess({"energies": ()}, given=-0.5) == 0.5 / 8.0
    assert log.excess({"energies": log.energies[:1]}) == 0.0


def test_no_friction_is_blamed_for_more_than_it_dissipates():
    """Contacts of a disc on a floor that moves far lose 0.1 J where rows change, of 0.08 J in all, and tiny friction takes
    4e-6 J: 980 % were told."""
    log = StepLog()
    log.energies = [[1.0, 0.08, 0.08, 0.0, 0.0, 0.0], [2.0, 0.08, 0.08, -0.1, 4e-6, 0.1]]
    assert log.excess({"energies": ()}) == pytest.approx(4e-6 / 0.01)
    log.energies[1][4] = 0.02
    assert log.excess({"energies": ()}) == pytest.approx(1.0)


@pytest.mark.slow
def test_a_proportional_load_dissipates_the_same_in_any_number_of_steps():
    """Blocks that slide as they are pressed: friction dissipates all that the contacts take, also without [time]."""
    scene = pressed_blocks([0.0, 1.0]) | {"method": {"tolerance": 1e-10}}
    ends = [
        certified(scene | {"time": {"points": [1.0]} | time})
        for time in ({"steps": 1}, {"steps": 4}, {})
    ]
    for answer in ends:
        energy = answer.summary["energy"]
        assert energy["dissipated"] == pytest.approx(energy["interface_work"], rel=1e-7) != 0.0
    del scene["history"], scene["time"], scene["body"][0]["traction"][0]["history"]
    for name, contact in certified(scene).summary["contacts"].items():
        assert contact["slip"] > 0
        assert contact["dissipated"] == pytest.approx(
            ends[1].summary["contacts"][name]["dissipated"], rel=1e-7
        )


@pytest.mark.slow
@pytest.mark.parametrize("law", [COULOMB, {"law": "none"}])
def test_what_is_unloaded_is_zero(caplog, law):
    """Zero, not what rounding leaves of factors; loaded again all is as before; the certificate is the worst one."""
    caplog.set_level("INFO", "ddmpi")
    left = 0.1 + 0.2 - 0.3
    answer = certified(pressed_blocks([0.0, 1.0, left, 1.0, left], law))
    said = " ".join(record.getMessage() for record in caplog.records)
    assert left > 0.0 and "certificate fails" not in said and "halved" not in said
    steps = {step["time"]: step["contacts"] for step in answer.summary["steps"]}
    for name, contact in answer.contacts.items():
        assert not contact.forces.any() and contact.count("open") == contact.interface.m
        assert steps[3.0][name]["force"] == pytest.approx(
            steps[1.0][name]["force"], rel=1e-6, abs=1.0
        )
        assert steps[2.0][name]["force"] == [0.0, 0.0]
    assert not any(body.displacement.any() or body.stress.any() for body in answer.bodies.values())
    pressed = certified(pressed_blocks([0.0, 1.0], law)).summary["certificate"]
    worst = answer.summary["certificate"]
    assert all(worst[kind] >= pressed[kind] for kind in worst) and pressed["penetration"] > 0.0
    assert all(np.abs(body["reaction"]).max() <= 1e-9 for body in answer.summary["bodies"].values())


@pytest.mark.slow
@pytest.mark.parametrize("little", [1e-3, 1e-8, 1e-9])
def test_a_small_load_after_a_large_one_is_solved_by_itself(little):
    """What is left of a load is no rounding: without friction all is in proportion.

    Forces are met to the tolerance 1e-8 of at least NO_FORCE = 1e-6 of the largest, 1e-14: 1e-5 of the last of these.
    """
    within = max(1e-5, 4e-14 / little)
    full, left = (
        certified(pressed_blocks(factors, {"law": "none"}))
        for factors in ([0.0, 1.0], [0.0, 1.0, little])
    )
    for name, body in full.bodies.items():
        size = np.abs(body.displacement).max()
        assert left.bodies[name].displacement / little == pytest.approx(
            body.displacement, abs=within * size
        )
        assert left.bodies[name].stress.any()


def test_one_load_step_is_the_run_without_time():
    """With all factors at 1 and one step, forces and iterations are those of a scene without [time], bit for bit."""
    scene = pinched_blocks(3)
    plain, timed = certified(scene), certified(scene | {"time": {"points": [1.0], "steps": 1}})
    one, other = (answer.contacts["upper-lower"] for answer in (plain, timed))
    assert np.array_equal(one.forces, other.forces) and np.array_equal(one.slip, other.slip)
    assert np.array_equal(other.slip_total, other.slip)
    assert plain.summary["n_A"] == timed.summary["n_A"]
    assert plain.summary["steps"] == timed.summary["steps"]
    assert "energy" not in plain.summary
    assert any("nothing follows a history" in warning for warning in timed.summary["warnings"])


@pytest.mark.slow
def test_forces_of_a_history_are_not_those_of_its_end():
    """What is left after pulling depends on the way; the number of steps on a leg does not matter here."""
    answers = [certified(sheared_blocks(steps=steps)) for steps in (1, 4)]
    one, four = (answer.contacts["upper-lower"] for answer in answers)
    size = np.abs(one.forces).max()
    scene = sheared_blocks(steps=1)
    scene["time"]["points"] = [3.0]
    for history in scene["history"].values():
        history |= {"times": [0.0, 3.0], "factors": [0.0, history["factors"][-1]]}
    direct = certified(scene).contacts["upper-lower"]
    assert np.abs(one.forces - direct.forces).max() > 0.01 * size
    assert np.abs(one.forces - four.forces).max() < 0.2 * np.abs(one.forces - direct.forces).max()
    assert all(answer.summary["energy"]["residual"] <= 1e-9 for answer in answers)
    kinked = certified(sheared_blocks(steps=1, points=[3.0]))  # kinks of histories end legs, too
    assert [step["time"] for step in kinked.summary["steps"]] == [1.0, 2.0, 3.0]
    assert np.array_equal(kinked.contacts["upper-lower"].forces, one.forces)
    newton = answers[1].solved.solution.outer
    assert newton.run(1e-7) == "converged"  # with gaps that are computed afresh
    assert [step.update for step in newton.history] == [0.0] and newton.history[0].residual <= 1e-9


@pytest.mark.slow
def test_legs_are_solved_in_as_many_steps_as_the_tolerance_asks_for():
    """Where nodes slip while they come into contact, the forces come as close to those of many steps as is asked."""
    fine = certified(circle(steps=32)).contacts["soft-hard"]
    size = 0.3 * np.linalg.norm(fine.normal_force)
    errors = {}
    for tolerance in (0.2, 0.05):
        answer = certified(circle(tolerance=tolerance))
        contact = answer.contacts["soft-hard"]
        errors[tolerance] = np.linalg.norm(contact.tangential_force - fine.tangential_force) / size
        times = [step["time"] for step in answer.summary["steps"]]
        assert len(times) >= 2 and times[-1] == 1.0
        # Steps equal in the growth of the contact are short at first.
        assert times[0] < 0.5 / len(times)
    once = certified(circle(steps=1)).contacts["soft-hard"]
    assert (
        errors[0.05]
        <= 0.05
        < errors[0.2]
        < np.linalg.norm(once.tangential_force - fine.tangential_force) / size
    )


@pytest.mark.slow
def test_an_overlap_that_acts_at_once_asks_for_no_steps():
    """An overlap of constant size is pressing a clamp down by as much, also in the number of load steps."""
    pressed, overlapping = certified(sheared(1e-4)), certified(sheared(0.0, gap=-1e-4))
    assert len(overlapping.summary["steps"]) == len(pressed.summary["steps"]) <= 4
    same = [answer.summary["contacts"]["up-low"]["dissipated"] for answer in (overlapping, pressed)]
    assert same[0] == pytest.approx(same[1], rel=1e-5)


@pytest.mark.slow
def test_gaps_that_close_within_the_first_step_do_not_agree_by_accident():
    """One step and two of a leg would place the slip of all nodes that touch alike, and wrongly."""

    def crowned(**time) -> dict:
        x = np.linspace(0.0, 2.0, 5)
        top = [{"on": "top", "y": -1.84e-3, "x": -1.17e-3, "history": "press"}]
        load = [{"on": "right", "value": [0.0, 94.4], "history": "press"}]
        return {
            "body": [
                rectangle("upper", (0, 0), (2, 1), (5, 2), young=1.0e5, clamp=top, traction=load),
                rectangle("lower", (0, -1), (2, 1), (5, 2), young=1.43e6, clamp=["bottom"]),
            ],
            "contact": [
                {
                    "bodies": ["upper", "lower"],
                    "on": ["bottom", "top"],
                    "friction": COULOMB | {"coefficient": 0.5},
                    "gap": {
                        "along": "x",
                        "points": x.tolist(),
                        "values": (3.15e-4 * (x - 1.0) ** 2).tolist(),
                    },
                }
            ],
            "history": {"press": {"times": [0.0, 1.0], "factors": [0.0, 1.0]}},
            "time": {"points": [1.0]} | time,
        }

    fine, found = (
        certified(crowned(**time)).contacts["upper-lower"]
        for time in ({"steps": 32}, {"tolerance": 0.02})
    )
    error = np.linalg.norm(found.tangential_force - fine.tangential_force)
    assert error <= 0.02 * np.linalg.norm(0.5 * fine.normal_force)


def test_a_later_step_of_a_leg_begins_where_the_one_before_leads():
    """Under loads in proportion later load steps take one step of Newton's method, else as statuses change: two."""
    answer = certified(sheared_blocks(steps=8))
    pressed, *others = (
        np.array([step["outer_iterations"] for step in answer.summary["steps"]])
        .reshape(3, 8)
        .tolist()
    )
    assert pressed[0] > 1 and pressed[1:] == [1] * 7
    assert all(max(leg) <= 2 and sum(leg[1:]) <= 9 for leg in others)


def noted_marches(monkeypatch):
    """A list to which each march through load steps that begins is added."""
    begin, marches = March.__init__, []

    def note(self, *parts):
        marches.append(self)
        begin(self, *parts)

    monkeypatch.setattr(March, "__init__", note)
    return marches


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["max_iterations", "drift"])
def test_a_step_that_fails_is_halved_from_the_state_before(monkeypatch, ending):
    """The forces after a cut are those of a run that was asked for the shorter steps."""
    scene, failed = sheared_blocks(steps=1), []
    run = Newton.run

    def fail_once(self, tolerance):
        stopped = run(self, tolerance)
        if marches[-1]._now.time == 1.0 and marches[-1]._ahead[0] == 2.0 and not failed:
            failed.append(self.forces)
            return ending
        return stopped

    marches = noted_marches(monkeypatch)
    monkeypatch.setattr(Newton, "run", fail_once)
    cut = certified(scene)
    monkeypatch.undo()
    assert failed and [step["time"] for step in cut.summary["steps"]] == [1.0, 1.5, 2.0, 3.0]
    scene["time"]["points"] = [1.0, 1.5, 2.0, 3.0]
    forces = certified(scene).contacts["upper-lower"].forces
    assert np.abs(cut.contacts["upper-lower"].forces - forces).max() <= 1e-9 * np.abs(forces).max()


def test_halving_ends_before_a_load_that_nothing_holds(monkeypatch):
    """Steps are halved again after those that are solved, down to a sixty-fourth of the step that failed."""
    scene, run, tried = sheared_blocks(steps=1), Newton.run, []

    def fail_beyond(self, tolerance):
        tried.append(marches[-1]._ahead[0])
        assert len(tried) < 20
        return "drift" if tried[-1] > 1.9 else run(self, tolerance)

    marches = noted_marches(monkeypatch)
    monkeypatch.setattr(Newton, "run", fail_beyond)
    assert not ddmpi.solve(scene, MPI.COMM_SELF).certified
    assert tried == [1.0, 2.0, 1.5, 2.0, 1.75, 2.0, 1.875, 2.0, 1.9375, 1.90625, 1.890625, 1.90625]


@pytest.mark.clarabel
def test_a_load_that_nothing_holds_at_first_is_named_though_it_is_held_at_last():
    """A block that is pushed from time 0 on, and pressed more and more: no forces hold it before time 2/3."""
    loads = [
        {"on": "top", "value": [0.0, -1.0e5], "history": "press"},
        {"on": "left", "value": [4.0e4, 0.0]},
    ]
    answer = ddmpi.solve(
        {
            "body": [rectangle("block", (0, 0), (2, 1), (4, 2), traction=loads)],
            "rigid": [FLOOR],
            "contact": [{"bodies": ["block", "floor"], "on": ["bottom"], "friction": COULOMB}],
            "history": {"press": {"times": [0.0, 1.0], "factors": [0.0, 1.0]}},
            "time": {"points": [1.0], "steps": 2},
        },
        MPI.COMM_SELF,
    )
    assert answer.reason.startswith("no equilibrium: block would") and not answer.summary["steps"]
    assert not len(answer.history)  # before any iteration


@pytest.mark.slow
def test_adaptive_steps_go_on_from_wherever_they_were(tmp_path):
    """From checkpoints here and there, in legs of large, of smaller and of no forces."""
    times = [0.0, 1.0, 2.0, 3.0, 4.0]
    scene = circle(points=times[1:], tolerance=0.07)
    scene["history"]["press"] = {"times": times, "factors": [0.0, 1.0, 0.02, 0.2, 0.0]}
    go_on_from_checkpoints(
        scene | {"checkpoint": {"iterations": 9}, "output": {"steps": "all", "stress": False}},
        tmp_path,
        slice(2, None, 6),
    )


def test_a_restored_march_is_the_whole_one(monkeypatch):
    """All that a march through load steps knows is in its state, but for what is found anew for each step."""
    states, step, made = [], March._step, noted_marches(monkeypatch)

    def known(march: March) -> dict:
        parts = {
            name: vars(value) if name in MARKS else value
            for name, value in vars(march).items()
            if name not in ("assembly", "iteration", "outer", "log", "_safe", "_d", "_chain")
        }
        return copy.deepcopy(parts)

    def note(march: March, time: float):
        states.append((march.state(), known(march)))
        return step(march, time)

    monkeypatch.setattr(March, "_step", note)
    certified(sheared(0.0, gap=-1e-4))
    (march,) = made
    assert march._given and len(states) >= 6
    for state, expected in states.copy():
        fresh = March(march.assembly, march.iteration, StepLog())
        fresh.restore(state)
        np.testing.assert_equal(known(fresh), expected)


@pytest.mark.slow
def test_files_of_load_steps(tmp_path):
    """Fields of the legs' ends are a time series; tables have a line per step; a picture has the loop of forces."""
    scene = write_scene(sheared_blocks(steps=2), tmp_path / "scene.toml")
    done = run_here(scene, tmp_path / "out", "--no-figures")
    steps, energy, history = (done.table(f"{name}.csv") for name in ("steps", "energy", "history"))
    assert steps["time"].tolist() == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0] == energy["time"].tolist()
    assert set(history["step"]) == {1, 2, 3, 4, 5, 6}
    assert energy["dissipated"][-1] == pytest.approx(steps["dissipated"].sum(), rel=1e-12)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "out" / "result.xdmf") as reader:
        reader.read_points_cells()
        found = [reader.read_data(k) for k in range(reader.num_steps)]
    assert [time for time, _, _ in found] == [1.0, 2.0, 3.0]
    results, grids = read_results(tmp_path / "out"), made_up.named_grids(tmp_path / "out")
    legs, last = results.legs["upper-lower"], results.contacts["upper-lower"]
    assert (last["slip"] != last["slip_total"]).any()
    assert [grid["time"] for grid in grids["upper"]] == [1.0, 2.0, 3.0]
    assert list(grids) == ["upper", "lower", "upper-lower"]
    for grid in grids["upper-lower"]:
        for field, column in (
            ("pressure", "normal_stress"),
            ("slip_total", "slip_total"),
        ):  # at nodes, and in between
            assert np.isin(legs[column][legs["time"] == grid["time"]], grid[field]).all()
    assert np.array_equal(legs["tangential_stress"][legs["time"] == 3.0], last["tangential_stress"])
    (loop, *_) = draw_steps(results).axes
    assert loop.lines[0].get_xdata().tolist() == [0.0, 0.0, 0.0, 0.5, 1.0, 0.7, 0.4]
    assert loop.lines[0].get_ydata()[1:].tolist() == results.steps["tangential_force"].tolist()
    pressed = certified(sheared_blocks(steps=2), time__points=[1.0])
    u = np.concatenate([pressed.bodies[name].displacement for name in ("upper", "lower")])
    assert found[0][1]["displacement"][:, :2] == pytest.approx(
        u, rel=1e-9, abs=1e-9 * np.abs(u).max()
    )


@pytest.mark.slow
def test_the_step_of_the_largest_load_is_shown(tmp_path):
    """Pictures and report are those of a run that ends there, or at another step; their titles say which."""
    folders = {}
    for name, factors in (("whole", [0.0, 0.5, 1.0, 0.0]), ("end", [0.0, 0.5, 1.0])):
        scene = pressed_blocks(factors)
        scene["rigid"][0] |= {"displacement": [0.0, 1e-4], "history": "press"}
        scene["time"]["steps"] = 1
        for body in scene["body"]:
            body["mesh"] |= {"order": 2, "divisions": [4, 2]}
        path = write_scene(scene, tmp_path / f"{name}.toml")
        folders[name] = run_here(path, tmp_path / name, "--no-figures").folder
    whole, end = (read_results(folder) for folder in folders.values())
    shown = at_step(whole, folders["whole"])
    assert (shown.time, shown.heading(True)) == (2.0, "time 2: ")
    assert shown.summary["displacement_max"] == end.summary["displacement_max"] > 0.0
    for name, table in end.contacts.items():
        for ours, theirs in ((shown.contacts[name], table), (shown.sides[name], end.sides[name])):
            assert all(
                np.array_equal(ours[column], values)
                if column == "status"
                else ours[column] == pytest.approx(values, rel=1e-12)
                for column, values in theirs.items()
            )
        for key in ("force", "normal_force", "open", "slip", "stick", "pressure_max"):
            assert shown.summary["contacts"][name][key] == end.summary["contacts"][name][key], key
    for name in ("displacement", "stress", "von_mises"):
        assert np.array_equal(shown.fields[name], end.fields[name])
    assert np.array_equal(magnify(shown)[1], magnify(end)[1])
    assert np.array_equal(rigid_parts(shown, 1.0)[0].at, rigid_parts(end, 1.0)[0].at)
    last = at_step(whole, folders["whole"], 3.0)
    assert last.fields is whole.fields and not last.fields["displacement"].any()
    with pytest.raises(
        InputError, match=r"no fields of time 1.5; the times that have some: 1, 2, 3"
    ):
        at_step(whole, folders["whole"], 1.5)
    for time, words in ((None, "at time 2"), (3.0, "of the last load step")):
        page = write_report(folders["whole"], str(tmp_path / "report.html"), time).read_text(
            encoding="utf-8"
        )
        assert f"are those {words};" in page and ("data:image/png" in page) == (time is not None)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"history": {"pull": {"times": [0.0], "factors": [1.0]}}}, ["history.pull", "[time]"]),
        (
            {"time": {"points": [1.0], "steps": 2, "tolerance": 0.1}},
            ["time", "steps and tolerance"],
        ),
        ({"time": {"points": [1.0, 1.0]}}, ["time", "ascend"]),
        ({"time": {"points": [0.0]}}, ["time", "positive"]),
        ({"output": {"animation": True}}, ["output.animation", "[time]"]),
        (
            {"time": {"points": [1.0]}, "method": {"outer": "anderson"}},
            ["time", "anderson", "newton"],
        ),
        ({"time": {"points": [1.0]}, "method": {"target_error": 0.1}}, ["time", "target_error"]),
        (
            {
                "time": {"points": [1.0]},
                "history": {"pull": {"times": [0.0, 0.0], "factors": [1.0, 2.0]}},
            },
            ["history.pull", "ascend"],
        ),
        (
            {
                "time": {"points": [1.0]},
                "history": {
                    "a": {"times": [0.0], "factors": [1.0]},
                    "b": {"times": [0.0, 1.0], "factors": [1.0]},
                },
            },
            ["history.b", "equally many"],
        ),
        (
            {"time": {"points": [1.0]}, "history": {'"a b"': {"times": [0.0], "factors": [1.0]}}},
            ["history", "name"],
        ),
    ],
)
def test_what_load_steps_cannot_be_is_refused_by_its_key(change, words):
    """Bad histories and load steps are refused before any work, by one message that names the key."""
    assert_refused(pinched_blocks(2) | change, *words)


def test_clamps_that_contradict_each_other_by_their_histories_are_refused():
    scene = sheared_blocks()
    scene["body"][0]["clamp"] = [
        {"on": "left", "x": 1e-4, "history": "pull"},
        {"on": "left", "x": 1e-4, "y": 0.0, "history": "press"},
    ]
    with pytest.raises(
        InputError, match=r"body\.upper\.clamp: x at .*prescribed twice.*another history"
    ):
        ddmpi.solve(scene, MPI.COMM_SELF)


@pytest.mark.slow
def test_motions_that_come_back_are_doubted():
    """A stack that slides far and comes back is warned of once, with the time; one that slides a little is not."""
    scene, *_ = turned_stack(steps=1)
    for factor, warned in ((1.0, False), (4000.0, True)):
        scene["history"]["shift"]["factors"] = [0.0, 1.0, factor, 0.0, -factor, 0.0]
        summary = certified(scene).summary
        told = [warning for warning in summary["warnings"] if "node pairs slid" in warning]
        assert bool(told) == warned and len(told) <= 1, summary["warnings"]
        assert not warned or told[0].endswith("(at time 2)")


@pytest.mark.slow
def test_unloading_dissipates_no_more_than_the_loads_did():
    """A blade slides back in its slot: slip begins within a step whose forces agree; energies ask for more steps."""
    scene = tomllib.loads(
        (ROOT / "configs" / "drawn" / "dovetail.toml").read_text(encoding="utf-8")
    )
    for body in scene["body"]:
        body["mesh"] = {
            "geometry": str(ROOT / "configs" / "drawn" / body["mesh"]["geometry"]),
            "size": 12.0,
        }
    scene["body"][0]["traction"][0]["history"] = "spin"
    scene |= {
        "method": {},
        "history": {"spin": {"times": [0.0, 1.0, 1.8, 2.0], "factors": [0.0, 1.0, 0.2, 0.0]}},
        "time": {"points": [1.0, 1.8, 2.0]},
    }
    answer = certified(scene)
    energy = answer.summary["energy"]
    assert 0.0 < energy["dissipated"] <= 1.02 * energy["external_work"]


def test_a_body_that_is_let_loose_on_the_way_is_named():
    """Where all load is taken off a body and comes back, the answer depends on a place that nothing determines."""
    block = rectangle(
        "block",
        (0, 0),
        (2, 1),
        (4, 2),
        poisson=0.0,
        traction=[{"on": "top", "value": [0.0, -1e6], "history": "press"}],
    )
    scene = {
        "body": [block],
        "rigid": [FLOOR],
        "contact": [
            {
                "bodies": ["block", "floor"],
                "on": ["bottom"],
                "friction": COULOMB | {"coefficient": 0.1},
            }
        ],
        "history": {"press": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 1.0, 0.0, 1.0]}},
    }
    for last, told, left in (
        (3.0, ["nothing touches block: it can move freely (at time 2)"], []),
        (2.0, [], ["nothing touches block: it can move freely"]),
    ):
        time = {"points": [1.0, 2.0, 3.0][: int(last)], "steps": 1}
        summary = ddmpi.solve(scene | {"time": time}, MPI.COMM_SELF).summary
        assert [each for each in summary["warnings"] if "freely" in each] == told
        assert summary["undetermined"] == left


@pytest.mark.clarabel
def test_legs_that_have_an_answer_keep_their_warnings():
    """Though a later leg has none: the first one moves the block far, the second one pulls it off."""
    loads = [
        {"on": "top", "value": [0.0, -3e5], "history": "press"},
        {"on": "right", "value": [1e6, 0.0], "history": "pull"},
    ]
    answer = ddmpi.solve(
        {
            "body": [
                rectangle("up", (0, 1), (2, 1), (8, 4), young=1e6, traction=loads),
                rectangle("low", (0, 0), (2, 1), (8, 4), young=1e6, clamp=["bottom"]),
            ],
            "contact": [{"bodies": ["up", "low"], "on": ["bottom", "top"], "friction": COULOMB}],
            "history": {
                "press": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 1.0]},
                "pull": {"times": [1.0, 2.0], "factors": [0.0, 1.0]},
            },
            "time": {"points": [1.0, 2.0], "steps": 1},
        },
        MPI.COMM_SELF,
    )
    assert "no equilibrium" in answer.reason
    assert answer.summary["warnings"] and all(
        "(at time 1)" in each for each in answer.summary["warnings"]
    )


@pytest.mark.every(3)
@pytest.mark.parametrize("partner", ["body", "rigid"])
@pytest.mark.parametrize("d", [2, 3])
def test_slip_without_friction(d, partner):
    """A block that is moved over another one, or over a rigid plane, slips by what it is moved, in steps and in all."""
    make, up = (rectangle, [0.0, 1.0]) if d == 2 else (box, [0.0, 0.0, 1.0])
    sides = [{"on": on, "x": 1e-3, "history": "go"} for on in ("left", "right")]
    upper = make(
        "upper",
        up,
        (1.0,) * d,
        (2,) * d,
        poisson=0.0,
        clamp=sides,
        traction=[{"on": "top", "value": [-1e6 * each for each in up]}],
    )
    scene = {
        "body": [upper],
        "contact": [{"name": "c", "bodies": ["upper", "lower"], "on": ["bottom"]}],
        "history": {"go": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 3.0]}},
        "time": {"points": [1.0, 2.0]},
    }
    if d == 3:
        upper["clamp"].append({"on": "front", "y": 0.0})
    if partner == "body":
        scene["body"].append(
            make("lower", (0.0,) * d, (1.0,) * d, (2,) * d, poisson=0.0, clamp=["bottom"])
        )
        scene["contact"][0]["on"].append("top")
    else:
        scene["rigid"] = [{"name": "lower", "shape": "plane", "point": up, "normal": up}]
    state = certified(scene).contacts["c"]
    along = state.along(state.slip), state.along(state.slip_total)
    for vectors, moved in zip(along, (2e-3, 3e-3), strict=True):
        assert vectors == pytest.approx(np.tile(np.eye(d)[0] * moved, (len(vectors), 1)), abs=1e-5)
    assert set(state.status) == {"slip"} and state.dissipated == 0.0
