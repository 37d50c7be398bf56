"""Whose cases are in a folder: no sweep takes another one's results for its own, and none are lost."""

import json
import re
import shutil
import tomllib
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import pytest
import scenes
from scenes import pinched_blocks
from test_sweep import COEFFICIENT, rows, run_sweep, stamp

from ddmpi.errors import InputError, NotConvergedError, OutputError
from ddmpi.scene.reader import read_data
from ddmpi.sweep import table as sweep_table
from ddmpi.sweep.cases import build_cases
from ddmpi.sweep.plots import draw_plot
from ddmpi.sweep.sweep import Sweep, _judge
from ddmpi.sweep.table import (
    check_sweep,
    claim_sweep,
    find_column,
    gather,
    identify,
    numbers,
    record_case,
)
from ddmpi.system.files import RECORD, SWEEP

pytestmark = pytest.mark.slow

TWO = ["--vary", f"{COEFFICIENT}=0.1,0.2"]


def build(*varied: str, settings: tuple[str, ...] = ()) -> list:
    return build_cases(
        "scene.toml",
        read_data("scene.toml", scenes.to_toml(pinched_blocks(2)), settings),
        list(varied),
    )


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    return scenes.write_scene(pinched_blocks(2), tmp_path_factory.mktemp("scene") / "scene.toml")


@pytest.fixture(scope="module")
def finished(small, tmp_path_factory):
    """Two cases with results; not to be changed."""
    run = run_sweep(
        small, tmp_path_factory.mktemp("finished") / "out", *TWO, "--plot", "n_A:coefficient"
    )
    assert run.code == 0, run.output
    return run


def copied(finished, tmp_path) -> Path:
    shutil.copytree(finished.folder, tmp_path / "out")
    return tmp_path / "out"


def whole(folder: Path) -> dict[Path, tuple[int, int]]:
    return {path: stamp(path) for path in folder.rglob("*")}


# Two sweeps at once


def test_a_folder_is_of_the_sweep_that_comes_first(tmp_path):
    """Also while its process is still writing what it is; a torn sweep.json is to be removed by hand."""
    cases, one, other = build("method.max_iterations=7"), {"scene": {"a": 1}}, {"scene": {"a": 2}}
    rest = {"PETSc options": [], "mesh files": {}}
    claim_sweep(tmp_path, one | rest, cases)
    claim_sweep(tmp_path, one | rest, cases)
    with pytest.raises(InputError, match=r"belongs to another sweep: scene\.a is 2 here, 1 there"):
        claim_sweep(tmp_path, other | rest, cases)
    (tmp_path / SWEEP).write_text("{")
    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(check_sweep, tmp_path, one | rest)
        (tmp_path / SWEEP).write_text(json.dumps(one | rest))
        assert waiting.result() is None


def test_a_torn_identity_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_table, "PATIENCE", 0.2)
    (tmp_path / SWEEP).write_text("{")
    with pytest.raises(InputError, match=rf"{tmp_path}/{SWEEP}: cannot be read .*remove it"):
        check_sweep(tmp_path, {})


# What an earlier sweep has left


@pytest.mark.parametrize("arguments", [[], ["--list"]])
def test_cases_of_no_sweep_are_refused(finished, small, tmp_path, arguments):
    """Without sweep.json nothing says whose they are."""
    folder = copied(finished, tmp_path)
    (folder / SWEEP).unlink()
    before = whole(folder)
    run = run_sweep(small, folder, *TWO, *arguments)
    assert run.code == 2 and len(run.messages) == 1, run.output
    assert str(folder) in run.messages[0] and f"no {SWEEP}" in run.messages[0]
    assert whole(folder) == before


def test_a_sweep_grows(finished, small, tmp_path):
    """By more values, and by another key; the table has the cases of the last command."""
    folder = copied(finished, tmp_path)
    grown = run_sweep(small, folder, "--vary", f"{COEFFICIENT}=0.1,0.15,0.2")
    assert grown.code == 0 and "1 to run, 2 finished" in grown.stdout, grown.output
    assert [row["status"] for row in rows(grown)] == ["certified"] * 3
    more = run_sweep(
        small, folder, "--vary", f"{COEFFICIENT}=0.1", "--vary", "method.max_iterations=400"
    )
    assert more.code == 0 and "1 to run" in more.stdout, more.output
    assert [row["method.max_iterations"] for row in rows(more)] == ["400"]


def test_meshes_that_a_target_has_refined_are_the_sweeps_own(tmp_path):
    scene = scenes.write_scene(pinched_blocks(2, target_error=0.08), tmp_path / "scene.toml")
    arguments = ["--vary", f"{COEFFICIENT}=0.1", "--set", "output.figures=false"]
    run = run_sweep(scene, tmp_path / "out", *arguments)
    assert run.code == 0, run.output
    summary = json.loads(next(run.folder.glob("*/summary.json")).read_text())
    assert summary["scene"]["body"][0]["mesh"]["divisions"] != [6, 2]
    again = run_sweep(scene, tmp_path / "out", *arguments)
    assert again.code == 0 and "0 to run, 1 finished" in again.stdout


# The table


SUMMARY = {
    "format": 2,
    "title": "t",
    "converged": True,
    "reason": "",
    "order": 1,
    "n": 12,
    "m": 3,
    "ranks": 2,
    "outer_iterations": 4,
    "inner_iterations": 7,
    "n_A": 20,
    "eff": 3.5,
    "displacement_max": 1e-4,
    "started": "then",
    "bodies": {
        name: {
            "n": 6,
            "ranks": [0, 1, 2, 3],
            "held": True,
            "energy": energy,
            "reaction": [1.0, 2.0],
            "memory_mib": 80,
        }
        for name, energy in {"a": 1.5, "b": 2, "c": 3}.items()
    },
    "contacts": {
        name: {
            "m": 3,
            "pairing": "nodes",
            "slave": None,
            "normal_force": 5.0,
            "force": [0.5, 0.25],
            "open": 1,
            "certificate": {"friction": 1e-9},
        }
        for name in ("a-b", "b-c")
    },
    "certificate": {"friction": 1e-9, "equilibrium": 1e-10},
    "steps": [{"time": 1.0}],
    "warnings": ["one", "two"],
    "discretization_error": {"energy_norm": None, "levels": [{"n": 1}, {"n": 2}]},
    "seconds": {"total": 1.0},
}


def test_columns_follow_from_the_summaries(tmp_path):
    """Numbers of every body and contact by name, however many; no texts, flags and histories."""
    cases = build("method.max_iterations=7,8,9")
    results = [
        SUMMARY,
        SUMMARY | {"contacts": {"a-b": SUMMARY["contacts"]["a-b"] | {"dissipated": 3.0}}},
    ]
    for case, summary in zip(cases, results, strict=False):
        (tmp_path / case.folder).mkdir()
        (tmp_path / case.folder / "summary.json").write_text(json.dumps(summary))
    table = sweep_table.read_table(gather(tmp_path, cases))
    names = list(table[0])
    assert names[:12] == [
        "case",
        "method.max_iterations",
        "status",
        "exit",
        "reason",
        "outer_iterations",
        "inner_iterations",
        "n_A",
        "eff",
        "n",
        "m",
        "displacement_max",
    ]
    body = [
        f"bodies.{name}.{entry}"
        for name in "abc"
        for entry in ("n", "energy", "reaction.x", "reaction.y", "memory_mib")
    ]
    contact = [
        f"contacts.{name}.{entry}"
        for name in ("a-b", "b-c")
        for entry in ("m", "normal_force", "force.x", "force.y", "open", "certificate.friction")
    ]
    rest = [
        "certificate.friction",
        "certificate.equilibrium",
        "seconds.total",
        "started",
        "folder",
        "warnings",
    ]
    assert sorted(names[12:]) == sorted([*body, *contact, *rest, "contacts.a-b.dissipated"])
    assert [row["warnings"] for row in table] == ["one | two", "one | two", None]
    assert [row["bodies.c.energy"] for row in table] == [3, 3, None]
    assert [row["contacts.b-c.force.x"] for row in table] == [0.5, None, None]
    assert [row["contacts.a-b.dissipated"] for row in table] == [None, 3.0, None]
    assert numbers(SUMMARY)["contacts.a-b.certificate.friction"] == 1e-9


def test_columns_of_derivatives():
    """A column for each number of each derivative; what is null has none, nor has the interval."""
    entry = {"until": [0.2, None], "contacts": {"a-b": {"force": [1.0, 2.0], "dissipated": 3.0}}}
    columns = numbers({"derivatives": {"contact.a-b.gap": entry, "body.a.traction.0": None}})
    assert columns == {
        "d contacts.a-b.force.x / d contact.a-b.gap": 1.0,
        "d contacts.a-b.force.y / d contact.a-b.gap": 2.0,
        "d contacts.a-b.dissipated / d contact.a-b.gap": 3.0,
    }
    assert (
        find_column("dissipated / d contact.a-b.gap", list(columns), "--plot") == list(columns)[2]
    )


# What wins over what is varied


def test_an_option_that_would_win(small, tmp_path):
    """What is varied must not be given on the command line, however it is written there."""
    run = run_sweep(
        small, tmp_path / "out", "--vary", "petsc.body_ksp_max_it=1,2,100", "-Body_KSP_max_it", "50"
    )
    assert run.code == 2 and len(run.messages) == 1, run.output
    assert "--vary petsc.body_ksp_max_it: this option is on the command line" in run.messages[0]
    assert not run.folder.exists()


# Plots


def test_impossible_plots_are_a_warning(finished, small):
    run = run_sweep(
        small, finished.folder, *TWO, "--gather", "--plot", "n_A", "--plot", "n_A:coeficient"
    )
    assert run.code == 0 and run.stderr.count("not drawn: ") == 2
    assert "expected RESULT:KEY" in run.stderr and "'coefficient'" in run.stderr


def test_a_sweep_without_results_has_no_plots(finished, tmp_path):
    """Nor has one without a table; with the results of one case it has."""
    folder = copied(finished, tmp_path)
    first, second = sorted(path.parent for path in folder.glob("*/summary.json"))
    (first / "summary.json").unlink()
    assert draw_plot(folder, "n_A:coefficient").exists()
    (second / "summary.json").unlink()
    with pytest.raises(InputError, match=r"--plot n_A:coefficient: no case has results"):
        draw_plot(folder, "n_A:coefficient")
    (folder / "sweep.csv").write_bytes(b"\xff")
    with pytest.raises(InputError, match="the table of a sweep"):
        draw_plot(folder, "n_A:coefficient")


def test_an_identity_that_is_a_folder_is_named(tmp_path):
    """What a file says of the same sweep is no mistake."""
    (tmp_path / SWEEP).mkdir()
    words = rf"{tmp_path}/{SWEEP}: is no file; remove it, or name another --output"
    with pytest.raises(InputError, match=words):
        check_sweep(tmp_path, {})
    (tmp_path / SWEEP).rmdir()
    (tmp_path / SWEEP).write_text('{"mesh files": {}}')
    check_sweep(tmp_path, {"mesh files": {}})


def test_a_plot_that_cannot_be_written(finished, small, tmp_path):
    folder = copied(finished, tmp_path)
    (picture,) = folder.glob("*.png")
    picture.unlink()
    picture.mkdir()
    run = run_sweep(small, folder, *TWO, "--plot", "n_A:coefficient")
    assert run.code == 5 and len(run.messages) == 1, run.output
    assert str(picture) in run.messages[0]


@pytest.mark.parametrize(
    ("codes", "error"), [((0, 5), OutputError), ((3, 2), NotConvergedError), ((0, 0), None)]
)
def test_a_sweep_whose_results_cannot_be_written_ends_like_a_run(tmp_path, codes, error):
    """On a full disk a run ends with exit code 5, and so does the sweep."""
    sweep = Sweep("scene.toml", {}, tmp_path, build(*TWO[1:]), build(*TWO[1:]), False, [])
    for case, code in zip(sweep.cases, codes, strict=True):
        sweep.place(case).mkdir()
        record_case(sweep.place(case), case, code, "")
    with (
        pytest.raises(error, match=r"of 2 cases in .* have a certified answer; ")
        if error
        else nullcontext()
    ):
        _judge(sweep)


# Shares, lists, closed folders


def test_a_share_without_cases(finished, small):
    run = run_sweep(small, finished.folder, *TWO, "--index", "3/5")
    assert run.code == 0 and "0 of 0 cases" in run.stdout


# Mesh files


def test_mesh_files_are_part_of_a_sweep(tmp_path):
    """Those that both sweeps have: more cases may bring more of them."""
    for name in ("punch_base.msh", "punch_block.msh"):
        shutil.copy(scenes.ROOT / "meshes" / name, tmp_path)
    text = re.sub(
        r'file = "[^"]*/', 'file = "', (scenes.ROOT / "configs" / "punch.toml").read_text()
    )
    cases = build_cases("scene.toml", tomllib.loads(text), [f"{COEFFICIENT}=0.1"])
    first = identify({}, [], cases, tmp_path)
    assert first["mesh files"].keys() == {"punch_base.msh", "punch_block.msh"}
    # No versions: after an update a sweep goes on.
    assert first.keys() == {
        "scene",
        "PETSc options",
        "mesh files",
    }
    claim_sweep(
        tmp_path / "out",
        {**first, "mesh files": {"punch_base.msh": first["mesh files"]["punch_base.msh"]}},
        cases,
    )
    check_sweep(tmp_path / "out", first)
    with open(tmp_path / "punch_base.msh", "a") as file:
        file.write("\n")
    with pytest.raises(InputError, match=r"another sweep: mesh files\.punch_base\.msh is"):
        check_sweep(tmp_path / "out", identify({}, [], cases, tmp_path))


def test_a_record_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / RECORD).write_text("{")
    with pytest.raises(InputError, match=re.escape(f"{tmp_path / RECORD}: cannot be read")):
        sweep_table.read_outcome(tmp_path)
