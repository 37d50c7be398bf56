"""Sweeps: every case as if it had run alone, whatever happens to the others; and the table and plots of them."""

import csv
import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import fault
import pytest
import scenes
from PIL import Image
from scenes import Run, pinched_blocks
from solid_scenes import two_boxes

from ddmpi.cli.arguments import split_arguments
from ddmpi.errors import InputError, InterruptionError
from ddmpi.results.summary import units
from ddmpi.sweep import sweep
from ddmpi.sweep.table import find_column, numbers, read_table
from ddmpi.system.files import UNFINISHED
from ddmpi.system.provenance import whereabouts

COEFFICIENT, NEUMANN = (
    "contact.0.friction.coefficient",
    "ddmpi.published.published.Subproblem.neumann",
)


def run_sweep(scene: Path, folder: Path, *arguments: str, ranks: int | None = None) -> Run:
    """By mpirun, or without `ranks` and options of PETSc's in this process."""
    command = ["sweep", str(scene), "--output", str(folder), *arguments]
    if ranks or split_arguments(command)[1]:
        return scenes.run_python(["-m", "ddmpi", *command], ranks or 1, folder)
    return scenes.call(*command, folder=folder)


def rows(run: Run) -> list[dict[str, str]]:
    with open(run.folder / "sweep.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def stamp(path: Path) -> tuple[int, int]:
    """Changes whenever a file is written anew."""
    return path.stat().st_ino, path.stat().st_mtime_ns


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    return scenes.write_scene(pinched_blocks(2), tmp_path_factory.mktemp("scene") / "scene.toml")


# One sweep in which cases end in every way

MIXED = [
    "--set",
    "petsc.body_ksp_type=cg",
    "petsc.body_pc_type=none",
    "contact.0.pairing=nodes",
    "--vary",
    "body.upper.mesh.divisions=[7,2],[6,2]",
    "petsc.body_ksp_max_it=3,1000",
    "method.max_iterations=1,500",
]
GIVEN = ["-body_ksp_norm_type", "unpreconditioned", "-not_an_option", "7"]
EXPECTED = ["refused"] * 4 + ["solver failed"] * 2 + ["not converged", "certified"]
EXITS = {"refused": "2", "solver failed": "4", "not converged": "3", "certified": "0"}


@pytest.fixture(scope="module")
def mixed(small, tmp_path_factory) -> Run:
    folder = tmp_path_factory.mktemp("mixed") / "sweep"
    return run_sweep(small, folder, *MIXED, "--plot", "n_A:method.max_iterations", *GIVEN, ranks=2)


@pytest.mark.slow
def test_failing_cases_do_not_stop_the_others(mixed):
    assert mixed.code == 3, mixed.output
    assert [row["status"] for row in rows(mixed)] == EXPECTED
    assert [row["exit"] for row in rows(mixed)] == [EXITS[status] for status in EXPECTED]
    assert mixed.messages == [
        f"ddmpi: error: 1 of 8 cases in {mixed.folder} have a certified answer; 4 refused, "
        "2 solver failed, 1 not converged"
    ]
    lines = [line for line in mixed.stdout.splitlines() if re.match(r"\d/8  case ", line)]
    assert [line.partition("  case ")[2][0] for line in lines] == list("01234567")
    assert all(f": {status}" in line for line, status in zip(lines, EXPECTED, strict=True))
    assert "PETSc options that nothing used: not_an_option; " in lines[7]


@pytest.mark.slow
def test_the_table_has_reasons_and_repeats_the_summaries(mixed):
    """Of cases without an answer the columns are empty; their story is in their folders, a picture beside the table."""
    table = rows(mixed)
    reasons = [row["reason"] for row in table]
    assert "contact.upper-lower" in reasons[0] and "DIVERGED_MAX_IT" in reasons[4]
    assert "max_iterations" in reasons[6] and reasons[7] == "converged and certified"
    for row in table[6:]:
        found = numbers(json.loads((mixed.folder / row["folder"] / "summary.json").read_text()))
        assert {"n_A", "certificate.friction", "seconds.total"} <= found.keys()
        assert {name: float(row[name]) for name in found} == found
    assert all(row[name] == "" for row in table[:6] for name in found)
    log = (mixed.folder / table[6]["folder"] / "run.log").read_text()
    assert "n = " in log and "ddmpi: error: not converged" in log
    assert read_table(mixed.folder / "sweep.csv")[7]["n_A"] == int(table[7]["n_A"])
    with Image.open(mixed.folder / "n_A-method.max_iterations.png") as picture:
        assert "ddmpi sweep" in picture.text["Description"]


@pytest.mark.slow
def test_as_if_it_had_run_alone(mixed, small, tmp_path):
    """The same numbers to the last bit as the command makes, after six failures in the same processes."""
    alone = scenes.run_command(
        small,
        tmp_path / "alone",
        *MIXED[:4],
        "petsc.body_ksp_max_it=1000",
        "--no-figures",
        "-body_ksp_norm_type",
        "unpreconditioned",
    )
    assert alone.code == 0, alone.output
    swept = mixed.folder / rows(mixed)[7]["folder"]
    for name in ("contact_upper-lower.csv", "history.csv"):
        assert (swept / name).read_bytes() == (alone.folder / name).read_bytes()
    summary = json.loads((swept / "summary.json").read_text())
    assert {
        name: value for name, value in summary["options"].items() if name != "not_an_option"
    } == alone.summary["options"]
    assert summary["options_unused"] == ["not_an_option"]


@pytest.mark.slow
def test_again_only_what_has_no_results(mixed, small):
    """A list names all cases with their status; a plot can come later. Runs after the tests above."""
    listed = run_sweep(small, mixed.folder, *MIXED, *GIVEN, "--list")
    assert listed.code == 0 and listed.own_stderr == ""
    assert [line.split()[0] for line in listed.stdout.splitlines()] == list("01234567")
    assert all(
        status in line for line, status in zip(listed.stdout.splitlines(), EXPECTED, strict=True)
    )
    before = {path: stamp(path) for path in mixed.folder.glob("*/summary.json")}
    assert len(before) == 2
    again = run_sweep(small, mixed.folder, *MIXED, *GIVEN)
    assert again.code == 3
    assert "6 to run, 2 finished" in again.stdout
    assert {path: stamp(path) for path in mixed.folder.glob("*/summary.json")} == before
    assert [row["status"] for row in rows(again)] == EXPECTED
    assert scenes.call("sweep-plot", str(mixed.folder), "eff:max_iterations").code == 0
    assert (mixed.folder / "eff-method.max_iterations.png").is_file()


@pytest.mark.slow
def test_another_sweep_is_refused(mixed, small):
    before = {path: stamp(path) for path in mixed.folder.rglob("*")}
    run = run_sweep(small, mixed.folder, *MIXED, *GIVEN, "-body_ksp_rtol", "1e-3")
    assert run.code == 2
    assert len(run.messages) == 1 and all(
        word in run.messages[0] for word in ("PETSc options", "to another sweep")
    )
    assert {path: stamp(path) for path in mixed.folder.rglob("*")} == before


# Mistakes of the program

TWO = ["--vary", f"{COEFFICIENT}=0.2,0.3,0.4"]


def faulty(
    small: Path, folder: Path, ranks: int, failing: list[int], kind: str = "KeyError"
) -> Run:
    """A sweep of three cases; from the second call of `_judge` on these ranks have the fault, once."""
    code = (
        "import sys, ddmpi.run.run as run; from mpi4py import MPI; from ddmpi.cli.main import main; judge, calls = "
        "run._judge, []\n"
        "def fails(*arguments):\n"
        "    calls.append(1)\n"
        f"    if len(calls) == 2 and MPI.COMM_WORLD.rank in {failing}: raise {kind}('lost')\n"
        "    return judge(*arguments)\n"
        "run._judge = fails; import ddmpi.system.agreement as agreement; agreement.PATIENCE = 1.0\n"
        f"main(['sweep', {str(small)!r}, '--output', {str(folder)!r}, *{TWO!r}])"
    )
    return scenes.run_python(["-c", code], ranks, folder)


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_mistake_of_the_program_ends_one_case(small, tmp_path, ranks):
    """It is recorded with its words and its traceback, and the cases after it have the answers of a sweep without it."""
    run = faulty(small, tmp_path / "sweep", ranks, list(range(ranks)))
    assert run.code == 1, run.output
    table = rows(run)
    assert [row["status"] for row in table] == ["certified", "failed", "certified"]
    assert "KeyError: 'lost'" in table[1]["reason"] and table[1]["exit"] == "1"
    assert "Traceback" in (run.folder / table[1]["folder"] / "run.log").read_text("utf-8")
    assert run.messages == [
        f"ddmpi: internal error: 2 of 3 cases in {run.folder} have a certified answer; 1 failed"
    ]
    again = run_sweep(small, run.folder, *TWO, ranks=ranks)
    assert again.code == 0 and "1 to run, 2 finished" in again.stdout


@pytest.mark.slow
def test_a_mistake_on_one_rank_ends_the_sweep_and_is_recorded(small, tmp_path):
    """Other ranks may wait for it; the sweep that is started again goes on with the cases after it."""
    run = faulty(small, tmp_path / "sweep", 2, [1])
    assert run.code == 1 and "internal error on rank 1" in run.output
    listed = run_sweep(small, run.folder, *TWO, "--list")
    assert [line.split()[1] for line in listed.stdout.splitlines()] == [
        "certified",
        "failed",
        "not",
    ]
    again = run_sweep(small, run.folder, *TWO, ranks=2)
    assert again.code == 0 and [row["status"] for row in rows(again)] == ["certified"] * 3


# Refused before any work


@pytest.mark.slow
def test_bad_input(small, tmp_path):
    run = run_sweep(small, tmp_path / "out", "--vary", "method.thetta=0.1,0.2", ranks=2)
    assert run.code == 2
    assert len(run.messages) == 1
    assert all(word in run.output for word in ["--vary method.thetta=0.1", "'theta'"])
    assert not run.folder.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "varied", ["output.cut.x=1.0,9.0", "body.upper.mesh.origin=[0,1,0],[1e20,1,0]"]
)
def test_what_only_meshes_show_is_refused_in_its_case_alone(tmp_path, varied):
    """A cut that meets no body, and a mesh of cells without a volume, do not end the sweep."""
    boxes = two_boxes(2) | {"output": {"figures": False, "cut": {"x": 1.0}}}
    scene = scenes.write_scene(boxes, tmp_path / "scene.toml")
    run = run_sweep(scene, tmp_path / "out", "--vary", varied)
    assert [row["status"] for row in rows(run)] == ["certified", "refused"], run.output


# Arrays, crashes, signals


@pytest.mark.slow
def test_tasks_of_an_array_share_a_folder(small, tmp_path):
    """Tasks that start at once run disjoint cases of one sweep in one folder."""
    arguments = ["--vary", f"{COEFFICIENT}=0.1:0.3:3"]
    with ThreadPoolExecutor() as pool:
        tasks = [
            pool.submit(run_sweep, small, tmp_path / "out", *arguments, "--index", index, ranks=1)
            for index in ("0/2", "1/2")
        ]
        runs = [task.result() for task in tasks]
    assert [run.code for run in runs] == [0, 0], "".join(run.output for run in runs)
    assert not (tmp_path / "out" / "sweep.csv").exists()
    gathered = run_sweep(small, tmp_path / "out", *arguments, "--gather")
    assert gathered.code == 0, gathered.output
    assert [row["status"] for row in rows(gathered)] == ["certified"] * 3
    more = run_sweep(small, tmp_path / "out", "--vary", f"{COEFFICIENT}=0.1,0.5", "--gather")
    assert more.code == 3 and [row["status"] for row in rows(more)] == ["certified", "not run"]


@pytest.mark.slow
def test_a_case_that_another_process_runs_is_left_to_it(small, tmp_path):
    """The sweep goes on with the next case, and says at the end that one has no results."""
    arguments = ["--vary", f"{COEFFICIENT}=0.1:0.2:2", "--set", "output.figures=false"]
    assert run_sweep(small, tmp_path / "out", *arguments, "--index", "1").code == 0
    place = tmp_path / "out" / f"{COEFFICIENT}=0.1"
    claim = place / UNFINISHED / whereabouts()  # this process lives
    claim.mkdir(parents=True)
    run = run_sweep(small, tmp_path / "out", *arguments, ranks=1)
    assert run.code == 3 and "1 of 2 cases" in run.messages[0], run.output
    assert f"is left to another process ({whereabouts()})" in run.stdout and list(
        place.iterdir()
    ) == [claim.parent]
    claim.rmdir()
    assert run_sweep(small, tmp_path / "out", *arguments).code == 0


@pytest.mark.slow
def test_a_single_case_ends_with_its_own_exit_code(small, tmp_path):
    run = run_sweep(
        small,
        tmp_path / "out",
        "--set",
        "contact.0.pairing=nodes",
        "--vary",
        "body.upper.mesh.divisions=[7,2],[6,2]",
        "--index",
        "0",
    )
    assert run.code == 2
    assert len(run.messages) == 1 and "contact.upper-lower" in run.messages[0]


def inject(small: Path, folder: Path, target: str, call: int, what: str, *arguments: str) -> Run:
    faults = [(1, target, call, what, str(folder), [])]
    return scenes.run_python(
        [fault.__file__, json.dumps(faults), "sweep", str(small), *arguments], folder=folder
    )


@pytest.mark.slow
def test_a_crash_costs_one_case(small, tmp_path):
    """The second of four dies with its processes; a new start takes the untried ones first, then all is there."""
    arguments = ["--vary", f"{COEFFICIENT}=0.1:0.4:4"]
    crash = inject(small, tmp_path / "out", "ddmpi.run.run.prepare", 2, "SIGKILL", *arguments)
    assert crash.code not in (0, 2, 3, 4, 5, 6)
    done = list(crash.folder.glob("*/summary.json"))
    assert [path.parent.name for path in done] == [f"{COEFFICIENT}=0.1"]
    before = stamp(done[0])
    assert "unfinished" in run_sweep(small, crash.folder, *arguments, "--list").stdout
    again = run_sweep(small, crash.folder, *arguments)
    assert again.code == 0, again.output
    assert re.findall(r"\d/3  case (\d)", again.stdout) == ["2", "3", "1"]
    assert stamp(done[0]) == before


@pytest.mark.slow
def test_no_case_is_started_after_a_signal(small, tmp_path, monkeypatch):
    """A failing case does not stop the others, an interrupted one does."""
    started = []

    def interrupted(cases, scene, *_, **__):
        started.append(scene)
        error = InterruptionError("SIGTERM")
        error.agreed = True
        raise error

    monkeypatch.setattr(sweep.Cases, "compute", interrupted)
    assert run_sweep(small, tmp_path / "out", "--vary", f"{COEFFICIENT}=0.1:0.3:3").code == 6
    assert len(started) == 1


@pytest.mark.slow
def test_a_signal_ends_the_sweep_and_the_next_start_continues_the_case(small, tmp_path):
    arguments = [
        "--set",
        "method.outer=relaxation",
        "method.tolerance=1e-3",
        "--vary",
        f"{COEFFICIENT}=0.1:0.3:3",
    ]
    whole = run_sweep(small, tmp_path / "whole", *arguments, ranks=2)
    assert whole.code == 0, whole.output
    # in the middle of the second case: every case has the same calls or more
    neumann = int(rows(whole)[0]["outer_iterations"]) + 5
    run = inject(small, tmp_path / "out", NEUMANN, neumann, "SIGUSR1", *arguments)
    assert f"{fault.END} 6 6" in run.stderr, run.output
    assert "interrupted by SIGUSR1" in run.stderr
    assert {path.name for path in run.folder.glob("*/checkpoint.h5")} == {"checkpoint.h5"}
    listed = run_sweep(small, run.folder, *arguments, "--list").stdout
    assert [line.split()[1] for line in listed.splitlines()] == ["certified", "interrupted", "not"]
    again = run_sweep(small, run.folder, *arguments, ranks=2)
    assert again.code == 0, again.output
    case = rows(again)[1]["folder"]
    assert "continuing after iteration" in (run.folder / case / "run.log").read_text()
    for row in rows(again):
        for name in ("contact_upper-lower.csv", "history.csv"):
            assert (run.folder / row["folder"] / name).read_bytes() == (
                whole.folder / row["folder"] / name
            ).read_bytes()


# PETSc's options


@pytest.mark.slow
def test_options_do_not_leak_from_case_to_case(petsc_options):
    from petsc4py import PETSc

    from ddmpi.petsc.options import RunOptions, unused_options

    petsc_options(given=1, asked="yes")
    PETSc.Options().hasName("asked")  # as PetscInitialize does with its own
    database = PETSc.Options()
    options, outside = RunOptions(), database.getAll()
    options.use({"own": 2, "given": 3, "flag": True, "-dash": False})
    # The command line wins.
    assert database.getAll() == outside | {
        "own": "2",
        "flag": None,
        "dash": "false",
    }
    assert database.getString("own") == "2" and "own" not in unused_options()
    database.setValue("set_by_a_solver", 1)
    options.use({"own": 4})
    assert database.getAll() == outside | {"own": "4"}
    assert {"own", "given"} <= set(unused_options()) and "asked" not in unused_options()
    options.use({})
    assert database.getAll() == outside


# Table and plots


def test_find_column():
    """A unique ending of a column's name will do."""
    names = [
        "case",
        "contact.0.friction.coefficient",
        "n_A",
        "contacts.a-b.n_A",
        "seconds.total",
        "method.theta",
    ]
    assert find_column("theta", names, "a plot") == "method.theta"
    assert find_column("n_A", names, "a plot") == "n_A"
    assert find_column("a-b.n_A", names, "a plot") == "contacts.a-b.n_A"
    with pytest.raises(InputError, match=r"'thetta'.*'theta'"):
        find_column("thetta", names, "a plot")
    with pytest.raises(InputError, match=r"upper\.young or lower\.young"):
        find_column("young", ["upper.young", "lower.young"], "a plot")


def table(**columns) -> list[dict]:
    """Rows as `read_table` gives them."""
    fixed = {"status": "certified", "exit": 0, "reason": "", "n_A": 5, "folder": ""}
    length = len(next(iter(columns.values())))
    return [
        {"case": k}
        | {name: values[k] for name, values in columns.items() if "." in name}
        | fixed
        | {name: values[k] for name, values in columns.items() if "." not in name}
        for k in range(length)
    ]


SUMMARY = {"title": "t", "units": units({"output": {"length_unit": "mm", "stress_unit": "MPa"}}, 2)}


def draw(rows: list[dict], result: str, key: str):
    import matplotlib

    matplotlib.use("agg")
    from ddmpi.sweep.plots import draw_curves

    return draw_curves(rows, result, key, SUMMARY).axes[0]


def test_curves():
    """A curve for each value of the other key; keys that vary together count once; only certified answers."""
    rows = table(
        **{"a.young": [1, 2, 1, 2], "b.young": [1, 2, 1, 2], "method.theta": [0.1, 0.1, 0.2, 0.2]},
        n_A=[10, 20, 30, 40],
        status=["certified"] * 3 + ["not converged"],
    )
    axes = draw(rows, "n_A", "a.young")
    assert [line.get_label() for line in axes.get_legend().get_lines()] == ["0.1", "0.2"]
    assert [list(zip(*line.get_data(), strict=True)) for line in axes.lines] == [
        [(1, 10), (2, 20)],
        [(1, 30)],
    ]
    assert "3 cases, 1 without a certified answer left out" in axes.get_title()


@pytest.mark.parametrize(
    ("result", "label"),
    [
        ("contacts.tyre-road.normal_force", "normal force of tyre-road (N/mm)"),
        ("bodies.tyre.energy", "strain energy of tyre (mJ/mm)"),
        ("body.tyre.traction.0.value.1", "traction value y of tyre"),
        ("displacement_max", "largest displacement (mm)"),
        ("seconds.total", "time (s)"),
        ("n_A", "solves with stiffnesses"),
    ],
)
def test_labels(result, label):
    """Names have their units, those of the scene; numbers stand by size, words beside each other."""
    varied = {"method.splitting": ["step2", "none", "none"], "k.v": [2e11, 20000000000, 2e9]}
    axes = draw([row | {result: 1.0} for row in table(**varied)], result, "method.splitting")
    assert axes.get_ylabel() == label
    assert [each.get_text() for each in axes.get_xticklabels()] == ["none", "step2"]
    assert [line.get_label() for line in axes.get_legend().get_lines()] == [
        "2e+09",
        "2e+10",
        "2e+11",
    ]


CROWDS = {
    "log": [[1, 100], [2, 9, 50], [1, 2, 3, 4, 100], [0.1, 0.1, 1, 10]],
    "linear": [[1, 20], [0.1, 0.2, 0.4, 0.9], [1, 60, 70, 80, 100], [0, 1, 100], [-1, 1, 100]],
}
"""Scales by values."""


@pytest.mark.parametrize("scale", CROWDS)
def test_values_that_crowd(scale):
    """Positive values that are far apart, half of which are small."""
    from ddmpi.sweep.plots import _crowds

    assert {_crowds(values) for values in CROWDS[scale]} == {scale == "log"}


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        pytest.param(values, scale, marks=[] if k == 2 else pytest.mark.slow)
        for scale, every in CROWDS.items()
        for k, values in enumerate(every)
    ],
)
def test_an_axis_on_which_values_crowd(values, scale):
    """An axis is logarithmic where values are far apart and half of them are small; else it is linear."""
    rows = table(**{"a.young": values}, n_A=list(range(1, len(values) + 1)))
    axes = draw(rows, "n_A", "a.young")
    assert (axes.get_xscale(), axes.get_yscale()) == (scale, "linear")
    rows = table(**{"a.young": list(range(1, len(values) + 1))}, n_A=values)
    axes = draw(rows, "n_A", "a.young")
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", scale)
    assert scale == "linear" or axes.yaxis.get_major_formatter()(0.1) == "0.1"


@pytest.mark.parametrize(
    ("columns", "result", "word"),
    [
        (
            {"method.theta": [1, 2], "status": ["refused"] * 2, "n_A": [None, None]},
            "n_A",
            "no case with a certified",
        ),
        ({"method.theta": [1, 2], "status": ["certified"] * 2}, "status", "status is not a number"),
        ({"method.theta": [0] * 13, "a.x": list(range(13)), "n_A": [1] * 13}, "n_A", "13 curves"),
    ],
)
def test_plots_that_cannot_be_drawn(columns, result, word):
    with pytest.raises(InputError, match=word):
        draw(table(**columns), result, "method.theta")
