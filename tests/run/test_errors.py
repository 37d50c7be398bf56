"""What a user sees of errors of results: keys, refusals, summary, log, report, sweep, Python, several ranks."""

import csv
import json

import numpy as np
import pytest
from mpi4py import MPI
from scenes import assert_refused, call, pinched_blocks, rectangle, run_here, write_scene

import ddmpi
from ddmpi.errors import InputError
from ddmpi.judge.bars import COARSE, ENDLESS, LOCKED, STEPPED, UNCERTIFIED
from ddmpi.results.summary import with_bar
from ddmpi.scene.reader import read_scene
from ddmpi.scene.results import wanted_errors

FORCE = "contacts.upper-lower.force.x"
NORMAL = "contacts.upper-lower.normal_force"
PEAK = "bodies.upper.von_mises_max"


def asking(*results: str, **more) -> dict:
    return pinched_blocks(6) | {"output": {"errors": list(results)} | more}


def test_every_number_has_a_bar_or_a_word():
    """With "main"; values are those of the summary."""
    scene = pinched_blocks(6) | {"output": {"errors": "main"}}
    answer = ddmpi.solve(scene)
    errors, contact = answer.summary["errors"], answer.summary["contacts"]["upper-lower"]
    assert [*errors] == [
        "contacts.upper-lower.normal_force",
        "contacts.upper-lower.force.x",
        "contacts.upper-lower.force.y",
        "contacts.upper-lower.pressure_max",
        "bodies.upper.reaction.x",
        "bodies.upper.reaction.y",
        "bodies.upper.displacement_max",
        "bodies.upper.von_mises_max",
        "bodies.lower.reaction.x",
        "bodies.lower.reaction.y",
        "bodies.lower.displacement_max",
        "bodies.lower.von_mises_max",
    ]
    assert all((entry["bar"] is None) == bool(entry["word"]) for entry in errors.values())
    assert all((entry["half"] is None) == bool(entry["word"]) for entry in errors.values())
    assert errors[FORCE]["value"] == contact["force"][0]
    assert 0.0 < errors[FORCE]["bar"] < abs(errors[FORCE]["value"])
    assert errors[PEAK]["word"] == ENDLESS  # a clamp ends there


def test_the_bar_covers_a_finer_mesh():
    """Of the blocks with 6 and 22 cells across, both of which the design gives."""
    answer = ddmpi.solve(asking("contacts.upper-lower.normal_force", FORCE))
    normal, along = (answer.error(one) for one in answer.summary["errors"])
    assert abs(normal.value - 1.1507844e8) < normal.bar < 0.2 * normal.value
    assert abs(abs(along.value) - 8.325063e6) < along.bar


def test_an_answer_tells_where_an_error_comes_from():
    answer = ddmpi.solve(asking(FORCE))
    entry = answer.error("contacts.upper-lower.force.0")
    assert entry.bar == answer.summary["errors"][FORCE]["bar"]
    assert {name: cells.shape for name, cells in entry.cells.items()} == {
        "upper": (216,),
        "lower": (216,),
    }
    with pytest.raises(InputError, match=r"did you mean 'contacts.upper-lower.force.x'"):
        answer.error("contacts.upper-lower.force.y")


@pytest.mark.slow
def test_fields_have_the_parts_of_cells_in_errors(tmp_path):
    """Over their mean, so that over the area they are it; of several results the mean. Pictures and the report show them."""
    answers = [ddmpi.solve(asking(*which)) for which in ([FORCE], [NORMAL], [FORCE, NORMAL])]
    parts, areas = [], []
    for answer in answers:
        bodies = answer.bodies.values()
        parts.append(np.concatenate([one.error_share for one in bodies]))
        corners = [one.points[one.cells[:, :3]] for one in bodies]
        edges = np.concatenate([each[:, 1:] - each[:, :1] for each in corners])
        areas.append(np.abs(np.linalg.det(edges)) / 2.0)
    assert parts[2] == pytest.approx((parts[0] + parts[1]) / 2.0)
    assert (parts[0] * areas[0]).sum() == pytest.approx(areas[0].sum())
    cells = np.concatenate([*answers[0].error(FORCE).cells.values()])
    assert parts[0] / parts[0].max() == pytest.approx(np.abs(cells) / np.abs(cells).max())
    scene = write_scene(asking(FORCE), tmp_path / "scene.toml")
    assert run_here(scene, tmp_path / "out").code == 0
    assert (tmp_path / "out" / "errors.png").exists()
    assert call("report", str(tmp_path / "out")).code == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Where the errors of results are made" in page


def test_a_stress_of_nothing_grows_nowhere():
    """A clamped block that nothing touches has no stress at its corners, and a bar of rounding."""
    beam = rectangle("beam", (0.0, 0.0), (4.0, 1.0), (16, 4), clamp=["left"])
    beam["mesh"]["order"] = 2
    beam["traction"] = [{"on": "top", "value": [0.0, 1e6]}]
    below = rectangle("below", (3.0, -1.0), (1.0, 1.0), (3, 3), clamp=["bottom"])
    below["mesh"]["order"] = 2
    contact = {"name": "c", "bodies": ["beam", "below"], "on": ["bottom", "top"]}
    results = [f"bodies.{name}.von_mises_max" for name in ("beam", "below")]
    answer = ddmpi.solve(
        {"body": [beam, below], "contact": [contact], "output": {"errors": results}}
    )
    bent, still = (answer.summary["errors"][result] for result in results)
    assert bent["bar"] is None and "grows with finer meshes" in bent["word"]
    assert still["value"] == 0.0 and 0.0 < still["bar"] <= 1e-5 * bent["value"]


@pytest.mark.parametrize(
    ("results", "words"),
    [
        (["contacts.upper-lower.force"], "did you mean 'contacts.upper-lower.force."),
        (["contacts.uper-lower.normal_force"], "did you mean 'contacts.upper-lower.normal_force'"),
        (["bodies.upper.heat"], "there is no result 'bodies.upper.heat'"),
        ([FORCE, FORCE], "stands there 2 times"),
        ([FORCE, "contacts.upper-lower.force.0"], "stands there 2 times"),
        (["bodies.upper.points.tip.displacement.x"], "no physical point 'tip'"),
    ],
)
def test_names_that_there_are_not_are_refused_before_work(results, words):
    with pytest.raises(InputError, match=r"output\.errors") as refused:
        ddmpi.solve(asking(*results))
    assert words in str(refused.value)


def test_what_goes_with_no_errors_is_refused():
    assert_refused(asking(FORCE, only="contacts"), "errors", "only")
    assert_refused(asking(PEAK, stress=False), PEAK, "stress = false")
    scene = asking(FORCE)
    scene["method"] = {"outer": "relaxation"}
    assert_refused(scene, "output.errors", '"newton"')
    axis = asking("bodies.upper.reaction.x") | {"axisymmetric": True}
    assert_refused(axis, "bodies.upper.reaction.x", "bodies.upper.reaction.y")
    assert not any("stress" in name for name in wanted_errors(read_scene("s", asking(FORCE))))


def test_without_errors_nothing_is_told():
    assert "errors" not in ddmpi.solve(pinched_blocks(6)).summary


def test_an_answer_that_is_not_certified_has_words():
    """Also where a clamp ends: nothing is known of stresses that are in no equilibrium."""
    scene = asking(FORCE, PEAK)
    scene["method"] = {"max_iterations": 2}
    answer = ddmpi.solve(scene)
    assert not answer.certified
    assert {entry["word"] for entry in answer.summary["errors"].values()} == {UNCERTIFIED}


@pytest.mark.parametrize(
    ("divisions", "poisson", "word"), [([2, 1], 0.3, COARSE), ([16, 8], 0.499, LOCKED)]
)
def test_forces_that_statics_gives_have_a_bar_on_any_mesh(divisions, poisson, word):
    """A block on a rough rigid floor, pushed down and aside on its top, bears the loads; the rest has a word."""
    block = {
        "name": "b",
        "mesh": {"shape": "rectangle", "size": [2.0, 1.0], "divisions": divisions},
        "material": {"young": 2e11, "poisson": poisson},
        "traction": [{"on": "top", "value": [1e5, "-1e6*(1 + 0.4*(x - 1))"]}],
    }
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    friction = {"law": "coulomb", "coefficient": 0.9}
    contact = {"name": "c", "bodies": ["b", "floor"], "on": ["bottom"], "friction": friction}
    wanted = ["contacts.c.force.x", "contacts.c.normal_force", "bodies.b.displacement_max"]
    scene = {"body": [block], "rigid": [floor], "contact": [contact], "output": {"errors": wanted}}
    errors = ddmpi.solve(scene).summary["errors"]
    along, normal, largest = (errors[result] for result in wanted)
    assert abs(along["value"] + 2e5) <= along["bar"] < 1e-4 * 2e6
    assert abs(normal["value"] - 2e6) <= normal["bar"] < 1e-4 * 2e6
    assert largest["bar"] is None and largest["word"] == word


def test_a_force_across_is_as_certain_as_the_largest():
    """A beam that a moment alone loads, on a bonded end: no force is left, but those at nodes are not small."""
    beam = rectangle("beam", (0.0, 0.0), (4.0, 1.0), (8, 2), clamp=["left"])
    beam["mesh"]["order"] = 2
    head = rectangle("head", (4.0, 0.0), (1.0, 1.0), (3, 3))
    head["mesh"]["order"] = 2
    head["traction"] = [{"on": "right", "value": ["1e6*(2*y - 1)", 0.0]}]
    contact = {"name": "c", "bodies": ["beam", "head"], "on": ["right", "left"], "kind": "bonded"}
    wanted = ["contacts.c.force.y", "bodies.beam.reaction.y"]
    scene = {"body": [beam, head], "contact": [contact], "output": {"errors": wanted}}
    for entry in ddmpi.solve(scene).summary["errors"].values():
        assert abs(entry["value"]) < entry["bar"]
        assert 1.0 < entry["bar"] < 10.0  # a part of 1e-5 of 2.5e5 N on each half


def test_errors_with_load_steps_are_of_the_last_one():
    """Work of friction is of all steps, and has a word; of a load that grows in one leg a force errs as in one step."""
    scene = asking(FORCE, "contacts.upper-lower.dissipated")
    one = ddmpi.solve(scene)
    scene["time"] = {"points": [1.0], "steps": 1}
    stepped = ddmpi.solve(scene)
    assert stepped.summary["errors"]["contacts.upper-lower.dissipated"]["word"] == STEPPED
    assert one.summary["errors"]["contacts.upper-lower.dissipated"]["bar"] > 0.0
    assert stepped.error(FORCE).bar == pytest.approx(one.error(FORCE).bar, rel=1e-3)


@pytest.mark.parametrize(
    ("value", "bar", "words"),
    [
        (35123.0, 420.0, "3.51e+04 ± 5e+02 N"),
        (35123.0, 400.0, "3.51e+04 ± 4e+02 N"),
        (0.0905964, 7e-5, "0.09060 ± 0.00007 N"),
        (-2091.04, 0.6, "-2091.0 ± 0.6 N"),
        (-1.0, 20.0, "0 ± 20 N"),
        (8012.0, 490.0, "8000 ± 500 N"),
        (161.98, 1.21, "162.0 ± 1.3 N"),
        (0.02616, 0.0128, "0.026 ± 0.013 N"),
        (0.0, 0.5, "0.0 ± 0.5 N"),
        (-1e5, 2.0, "-100000 ± 2 N"),
        (-1e5, 2e5, "-1e+05 ± 2e+05 N"),
        (3.0, 0.0, "3 ± 0 N"),
    ],
)
def test_a_value_is_told_to_the_digits_of_its_bar(value, bar, words):
    """The bar has one digit, rounded up."""
    entry = {"value": value, "bar": bar, "word": ""}
    summary = {"errors": {"contacts.c.force.x": entry}, "units": {"force": "N"}}
    assert with_bar(summary, "contacts.c.force.x") == words


def test_log_report_and_sweep_tell_errors(tmp_path):
    """`run --errors` is output.errors = "main"."""
    scene = write_scene(pinched_blocks(4), tmp_path / "scene.toml")
    run = run_here(scene, tmp_path / "out", "--errors", "--no-figures")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    told = f"{FORCE}: {with_bar(summary, FORCE)}"
    assert told in run.stdout
    assert f"{PEAK}: " in run.stdout and f"no bar: {ENDLESS}" in run.stdout
    assert call("report", str(tmp_path / "out")).code == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Errors of results" in page and with_bar(summary, FORCE) in page
    both = pinched_blocks(4) | {"output": {"errors": [FORCE, PEAK]}}
    asked = write_scene(both, tmp_path / "asked.toml")
    vary = ["--vary", "method.tolerance=1e-7,1e-8"]
    assert call("sweep", str(asked), "--output", str(tmp_path / "sweep"), *vary).code == 0
    with open(tmp_path / "sweep" / "sweep.csv", newline="", encoding="utf-8") as table:
        row = next(csv.DictReader(table))
    assert f"± {PEAK}" not in row  # no case has a bar
    assert float(row[f"± {FORCE}"]) == pytest.approx(summary["errors"][FORCE]["bar"], rel=1e-4)


def errors_are_those_of_one_rank(world: MPI.Comm) -> None:
    results = [FORCE, "bodies.lower.energy", "bodies.upper.displacement_max", PEAK]
    scene = pinched_blocks(2) | {"output": {"errors": results}}
    answer = ddmpi.solve(scene, world)
    alone = world.bcast(
        ddmpi.solve(scene, MPI.COMM_SELF).summary["errors"] if world.rank == 0 else None
    )
    assert answer.summary["errors"].keys() == alone.keys()
    for result, entry in answer.summary["errors"].items():
        assert entry["word"] == alone[result]["word"]
        if entry["bar"] is not None:
            assert entry["bar"] == pytest.approx(alone[result]["bar"], rel=1e-6)
    cells = answer.error(FORCE).cells
    sizes = world.allreduce(sum(np.abs(one).sum() for one in cells.values()))
    assert sizes > 0.0


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_errors_on_two_ranks(comm):
    """Bodies of their own ranks have the errors of one rank."""
    errors_are_those_of_one_rank(comm)


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_errors_on_more_ranks_than_bodies(comm):
    """So have several ranks a body."""
    errors_are_those_of_one_rank(comm)


def test_multigrid_has_nearly_the_same_bars():
    """Where products are by an iterative solver the adjoint is solved to 1e-2 only."""
    results = FORCE, "bodies.upper.displacement_max"
    exact = ddmpi.solve(asking(*results))
    rough = ddmpi.solve(asking(*results), overrides={"method.compliance": "iterative"})
    for result in results:
        assert rough.error(result).bar == pytest.approx(exact.error(result).bar, rel=0.03)
