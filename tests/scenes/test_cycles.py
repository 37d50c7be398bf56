"""Cycles of load steps: what a history that repeats itself gives, ended when the forces do not change any more."""

import copy

import bolts
import numpy as np
import pytest
from mpi4py import MPI
from restarts import go_on_from_checkpoints
from scenes import COULOMB, assert_refused, certified, rectangle, run_here, seldom, write_scene

import ddmpi
from ddmpi.cli.report import write_report
from ddmpi.errors import InputError
from ddmpi.pictures.curves import draw_steps
from ddmpi.results.histories import at_step, step_times
from ddmpi.results.summary import factor_at
from ddmpi.results.tables import read_results
from ddmpi.run.answer import Answer

CYCLE = {"from": 1.0, "to": 3.0, "repeat": 3}


def rubbed(points=(1.0, 1.5, 2.5, 3.0, 4.0), factors=(0.0, 1.0, -1.0, 0.0, 0.5), **time) -> dict:
    """Unlike blocks, one loose, of which the upper one is pressed on and then rubbed to and fro by its load."""
    loads = [
        {"on": "top", "value": [0.0, -1e6], "history": "press"},
        {"on": "right", "value": [2.7e5, 0.0], "history": "rub"},
    ]
    return {
        "body": [
            rectangle("upper", (0, 1), (2, 1), (5, 3), young=2e9, traction=loads),
            rectangle("lower", (-1, 0), (4, 1), (12, 3), clamp=["bottom"]),
        ],
        "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": COULOMB}],
        "history": {
            "press": {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
            "rub": {"times": list(points), "factors": list(factors)},
        },
        "time": {"points": list(points)} | time,
    }


def unrolled(scene: dict, run: int) -> dict:
    """A scene of `rubbed` blocks with cycles, as one without, with long histories."""
    scene = copy.deepcopy(scene)
    time, rub = scene["time"], scene["history"]["rub"]
    cycle = time.pop("cycle")
    shifts = [k * (cycle["to"] - cycle["from"]) for k in range(run)]
    drawn = [(time, factor) for time, factor in zip(rub["times"], rub["factors"], strict=True)]
    within = [(t, f) for t, f in drawn if cycle["from"] < t <= cycle["to"]]
    course = [
        *((t, f) for t, f in drawn if t <= cycle["from"]),
        *((t + shift, f) for shift in shifts for t, f in within),
        *((t + shifts[-1], f) for t, f in drawn if t > cycle["to"]),
    ]
    rub["times"], rub["factors"] = (list(values) for values in zip(*course, strict=True))
    time["points"] = rub["times"]
    return scene


def rows(answer: Answer) -> np.ndarray:
    """Times, forces, dissipation and counts of all steps."""
    return np.array(
        [
            [
                step["time"],
                *contact["force"],
                contact["normal_force"],
                contact["dissipated"],
                contact["open"],
                contact["slip"],
            ]
            for step in answer.solved.steps.steps
            for contact in step["contacts"].values()
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize("time", [{"steps": 2}, seldom({"tolerance": 0.05})])
def test_cycles_are_what_a_long_history_gives(time):
    """Steps, forces, energies, slip and what comes after them; later points shift by the time of the cycles."""
    scene = rubbed(cycle=CYCLE, **time)
    answer, plain = certified(scene), certified(unrolled(scene, 3))
    ours = rows(answer)
    assert ours[-1, 0] == 8.0 and answer.summary["cycles"]["run"] == 3
    if "steps" in time:
        theirs = rows(plain)
        assert ours == pytest.approx(theirs, rel=1e-8, abs=1e-9 * np.abs(theirs).max())
        assert answer.summary["energy"] == pytest.approx(
            plain.summary["energy"], rel=1e-8, abs=1e-12
        )
        slip, other = (each.contacts["upper-lower"].slip_total for each in (answer, plain))
        assert slip == pytest.approx(other, rel=1e-6, abs=1e-8 * np.abs(other).max())
    numbers = [step["cycle"] for step in answer.solved.steps.steps]
    per_cycle = [numbers.count(k) for k in (1, 2, 3)]
    assert numbers == sorted(numbers[: -numbers[::-1].index(3)]) + [0] * numbers[::-1].index(3)
    # Later cycles take the steps of the first.
    assert per_cycle[0] == per_cycle[1] == per_cycle[2] >= 4
    assert [step["cycle"] for step in answer.summary["steps"] if step["cycle"]] == [3] * per_cycle[
        2
    ]
    expected = sum(row[4] for row in ours)
    dissipated = answer.summary["contacts"]["upper-lower"]["dissipated"]
    assert dissipated == pytest.approx(expected, rel=1e-12) and expected > 0.0
    assert answer.summary["energy"]["residual"] < 1e-10


@pytest.mark.parametrize("unit", [1.0, seldom(1e-3)])
def test_cycles_end_when_forces_stay(unit):
    """Shaken down, they end early, in any unit of time; without a bound all are run; a cycle may begin at time 0."""
    points = [unit * time for time in (1.0, 1.5, 2.5, 3.0, 4.0)]
    scene = rubbed(
        points, steps=2, cycle={"from": points[0], "to": points[3], "repeat": 50, "until": 1e-6}
    )
    scene["history"]["press"]["times"] = [0.0, unit]
    answer = certified(scene)
    cycles, steps = answer.summary["cycles"], answer.summary["steps"]
    assert 2 <= cycles["run"] < 10 and cycles["change"] < 1e-6
    assert steps[-1]["time"] == pytest.approx(
        points[-1] + (cycles["run"] - 1) * 2.0 * unit, rel=1e-12
    )
    all_run = certified(
        scene, time__cycle={"from": points[0], "to": points[3], "repeat": 4}
    ).summary["cycles"]
    assert all_run["run"] == 4 and all_run["change"] < 1e-6
    early = rubbed((1.0, 2.0), (1.0, 0.0), steps=1, cycle={"from": 0.0, "to": 2.0, "repeat": 3})
    early["history"]["press"] = {"times": [0.0, 1.0, 2.0], "factors": [1.0, 1.5, 1.0]}
    early["history"]["rub"] = {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.0]}
    found = certified(early)
    assert [step["time"] for step in found.solved.steps.steps] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert found.summary["cycles"]["run"] == 3 and found.summary["energy"]["residual"] < 1e-10


@pytest.mark.slow
def test_files_of_cycles(tmp_path):
    """Tables number the cycles; fields are those of the last one; pictures and report know which loads act."""
    path = write_scene(rubbed(steps=2, cycle=CYCLE), tmp_path / "scene.toml")
    done = run_here(path, tmp_path / "out", "--no-figures")
    steps, energy = done.table("steps.csv"), done.table("energy.csv")
    assert (
        steps["cycle"].tolist()
        == [0] * 2 + [1] * 6 + [2] * 6 + [3] * 6 + [0] * 2
        == energy["cycle"].tolist()
    )
    assert step_times(tmp_path / "out") == [1.0, 5.5, 6.5, 7.0, 8.0]
    results = read_results(tmp_path / "out")
    assert set(results.legs["upper-lower"]["time"]) == {1.0, 5.5, 6.5, 7.0, 8.0}
    times = (1.0, 1.5, 2.5, 3.5, 5.0, 6.5, 7.0, 7.5, 8.0, None)
    assert [factor_at(results.summary, "rub", time) for time in times] == [
        0,
        1,
        -1,
        1,
        0,
        -1,
        0,
        0.25,
        0.5,
        0.5,
    ]
    assert at_step(results, tmp_path / "out").time == 6.5
    loop = draw_steps(results).axes[0].lines[0]
    assert loop.get_xdata().tolist() == [0, 0, 0, *3 * [0.5, 1, 0, -1, -0.5, 0], 0.25, 0.5]
    assert "at time 6.5" in write_report(tmp_path / "out", str(tmp_path / "r.html"), 6.5).read_text(
        encoding="utf-8"
    )
    told = {step["time"]: step for step in results.summary["steps"]}
    for time, load in ((5.5, 2.7e5), (6.5, -2.7e5), (8.0, 1.35e5)):
        assert told[time]["bodies"]["upper"]["loads"]["right"]["force"] == pytest.approx(
            [load, 0.0]
        )
        assert told[time]["bodies"]["lower"]["reaction"] == pytest.approx([-load, 2e6], rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("time", [{"steps": 2}, {"tolerance": 0.05}])
def test_a_run_goes_on_within_cycles(time, tmp_path):
    """From checkpoints here and there."""
    go_on_from_checkpoints(
        rubbed(cycle=CYCLE | {"until": 1e-9}, **time) | {"checkpoint": {"iterations": 1}},
        tmp_path,
        slice(3, None, 9),
        ("steps", "cycles", "n_A", "energy", "certificate"),
    )


def test_a_cycle_without_equilibrium_is_named():
    """What fails in a cycle ends the run there, with the time of the step and the number of the cycle."""
    scene = rubbed(steps=2, cycle=CYCLE)
    scene["body"][0]["traction"][1]["value"] = [6.1e5, 0.0]  # friction bears 6e5
    answer = ddmpi.solve(scene, MPI.COMM_SELF)
    assert "no equilibrium" in answer.reason and "in the step to time 1.5" in answer.reason
    assert answer.summary["cycles"] == {"run": 1, "change": None}
    assert [step["time"] for step in answer.summary["steps"]][:2] == [0.5, 1.0]


@pytest.mark.parametrize(
    "cycle, words",
    [
        ({"from": 3.5, "to": 1.5, "repeat": 2}, ["time.cycle.from: 3.5 must be before to = 1.5"]),
        ({"from": 1.0, "to": 3.0, "repeat": 0}, ["cycle.repeat", ">= 1"]),
        ({"from": -1.0, "to": 3.0, "repeat": 2}, ["cycle.from", ">= 0"]),
        ({"from": 1.0, "to": 5.5, "repeat": 2}, ["time.cycle: to = 5.5", "4"]),
        (
            {"from": 1.5, "to": 2.5, "repeat": 2},
            ["time.cycle", "history.rub", "factor 1 at from = 1.5", "-1 at to = 2.5"],
        ),
        ({"from": 0.0, "to": 1.0, "repeat": 2}, ["time.cycle", "history.press"]),
        ({"from": 1.5, "to": 3.5, "repeat": 2, "until": 1.5}, ["cycle.until"]),
    ],
)
def test_what_cycles_cannot_be_is_refused(cycle, words):
    """Before any work, by one message that names the key."""
    assert_refused(rubbed(cycle=cycle), *words)


def test_a_pretension_is_given_before_or_throughout_cycles():
    """One that ends within cycles would be given and kept in turns; one that ends with a single cycle is kept after."""
    scene = bolts.joint() | {
        "time": {"points": [1.0, 3.0, 4.0], "cycle": {"from": 1.0, "to": 3.0, "repeat": 2}}
    }
    scene["history"] = {"work": {"times": [1.0, 2.0, 3.0, 4.0], "factors": [0.0, 1.0, 0.0, 1.0]}}
    for end in 1.5, 3.0:
        scene["history"]["tighten"] = {"times": [0.0, 1.0, end], "factors": [0.0, 1.0, 1.0]}
        with pytest.raises(
            InputError, match=r"contact.cut.pretension.history: .* within the cycle from 1 to 3"
        ):
            ddmpi.solve(scene, MPI.COMM_SELF)
    scene["history"]["tighten"]["times"][-1] = 3.5
    *given, last = [
        step["contacts"]["cut"]["pretension"]["force"] for step in certified(scene).summary["steps"]
    ]
    assert given[:-1] == pytest.approx([bolts.FORCE] * (len(given) - 1), rel=1e-8)
    assert last > 1.01 * bolts.FORCE
