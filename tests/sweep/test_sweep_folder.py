"""Whose cases are in a folder: nobody gets another sweep's results for his own, and nobody's are lost."""

import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import scenes
from scenes import pinched_blocks
from test_sweep import COEFFICIENT, LIMIT, inject, rows, run_sweep, stamp

from ddmpi.errors import InputError, OutputError
from ddmpi.sweep import table as sweep_table
from ddmpi.sweep.cases import build_cases
from ddmpi.sweep.table import RECORD, case_identity, check_table, gather, read_outcome, record_case

OTHER = ["--set", "body.upper.material.young=2e9"]
TWO = ["--vary", f"{COEFFICIENT}=0.1,0.2"]


def build(*varied: str, settings: tuple[str, ...] = ()) -> list:
    return build_cases("scene.toml", scenes.to_toml(pinched_blocks(2)), list(settings), list(varied))


def identity(case) -> dict:
    return case_identity(case, [], Path("."))


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    return scenes.write_scene(pinched_blocks(2), tmp_path_factory.mktemp("scene") / "scene.toml")


@pytest.fixture(scope="module")
def finished(small, tmp_path_factory):
    """Two cases with results; not to be changed."""
    run = run_sweep(small, tmp_path_factory.mktemp("finished") / "out", *TWO, "--plot", "n_A:coefficient")
    assert run.code == 0, run.output
    return run


def copied(finished, tmp_path) -> Path:
    shutil.copytree(finished.folder, tmp_path / "out")
    return tmp_path / "out"


def whole(folder: Path) -> dict[Path, tuple[int, int]]:
    return {path: stamp(path) for path in folder.rglob("*")}


# Two sweeps at once


def test_two_sweeps_at_once(small, tmp_path):
    """One of them is refused, or both are; every case that is there is of one and the same sweep, and says so."""
    arguments = ["--vary", f"{COEFFICIENT}=0.1:0.5:6", "--set", "output.figures=false"]
    with ThreadPoolExecutor() as pool:
        runs = [task.result() for task in [pool.submit(run_sweep, small, tmp_path / "out", *arguments, *more)
                                           for more in ([], OTHER)]]
    codes = [run.code for run in runs]
    assert 2 in codes and set(codes) <= {0, 2}, "".join(run.output for run in runs)
    for run in runs:
        if run.code == 2:
            assert len(run.messages) == 1 and "body.0.material.young" in run.messages[0]
    places = [path.parent for path in (tmp_path / "out").glob("*/summary.json")]
    assert len(places) == 6 or codes == [2, 2]
    for place in places:
        record, summary = (json.loads((place / name).read_text()) for name in (RECORD, "summary.json"))
        assert record["scene"] == summary["scene"] and record["exit"] == 0


MEANWHILE = """
import json, shutil, sys
from pathlib import Path
from ddmpi.cli import main as cli
from ddmpi.sweep import sweep
original = sweep._run_case
def run_case(world, plan, case, options):
    result = original(world, plan, case, options)
    place = plan.folder / {place!r}
    if world.rank == 0 and not place.exists():
        shutil.copytree({source!r}, place)
    world.barrier()
    return result
sweep._run_case = run_case
cli.main(sys.argv[1:])
"""


@pytest.mark.parametrize("left", ["results", "record"])
def test_another_sweep_comes_meanwhile(finished, small, tmp_path, left):
    """While the first case runs the other sweep puts the second there, with results or only just started."""
    source = copied(finished, tmp_path) / rows(finished)[1]["folder"]
    if left == "record":
        for path in source.iterdir():
            if path.name != RECORD:
                path.unlink()
    hook = tmp_path / "hook.py"
    hook.write_text(MEANWHILE.format(place=source.name, source=str(source)))
    run = scenes.run_python([str(hook), "sweep", str(small), *TWO, *OTHER, "--output", str(tmp_path / "ours")],
                            limit=LIMIT)
    assert run.code == 2, run.output
    assert len(run.messages) == 1 and "body.0.material.young" in run.messages[0] and source.name in run.messages[0]
    assert (tmp_path / "ours" / source.name / RECORD).read_bytes() == (source / RECORD).read_bytes()
    assert not (tmp_path / "ours" / "sweep.csv").exists()


@pytest.mark.parametrize("links", [True, False])
def test_a_record_is_of_who_comes_first(tmp_path, monkeypatch, links):
    """Also where both have seen that there is none, and where the file system has no links."""
    if not links:
        def refuse(*arguments):
            raise PermissionError(1, "no links here")
        monkeypatch.setattr(os, "link", refuse)
    ours, = build("method.max_iterations=7")
    other, = build("method.max_iterations=7", settings=("method.tolerance=1e-3",))
    place = tmp_path / ours.folder
    place.mkdir()
    seen, original = [], sweep_table.read_outcome

    def read(folder):
        outcome = original(folder)
        if not seen:
            seen.append(folder)
            record_case(folder, other, identity(other))
        return outcome
    monkeypatch.setattr(sweep_table, "read_outcome", read)
    with pytest.raises(InputError, match=r"a case of another sweep, which differs in method\.tolerance"):
        record_case(place, ours, identity(ours))
    record_case(place, other, identity(other), 3, "no", "then")
    outcome = original(place)
    assert (outcome.identity, outcome.exit) == (identity(other), 3)
    assert [path.name for path in place.iterdir()] == [RECORD]


# What an earlier sweep has left


@pytest.mark.parametrize("arguments", [[], ["--gather"], ["--index", "1"]])
def test_results_without_a_record_are_nobodys(finished, small, tmp_path, arguments):
    folder = copied(finished, tmp_path)
    place = folder / rows(finished)[1]["folder"]
    (place / RECORD).unlink()
    before = whole(folder)
    run = run_sweep(small, folder, *TWO, *arguments)
    assert run.code == 2 and len(run.messages) == 1, run.output
    assert str(place) in run.messages[0] and f"no {RECORD}" in run.messages[0]
    assert whole(folder) == before


@pytest.mark.parametrize("arguments", [[], ["--gather"]])
def test_results_that_are_not_those_of_their_record(finished, small, tmp_path, arguments):
    """As two sweeps at once had left them."""
    folder = copied(finished, tmp_path)
    summary = folder / rows(finished)[0]["folder"] / "summary.json"
    changed = json.loads(summary.read_text())
    changed["scene"]["body"][1]["material"]["young"] = 2e9
    summary.write_text(json.dumps(changed))
    run = run_sweep(small, folder, *TWO, *arguments)
    assert run.code == 2 and "body.1.material.young (2000000000.0 there, 211900000000.0 now)" in run.messages[0]


def test_meshes_that_a_target_has_refined_are_the_sweeps_own(tmp_path):
    scene = scenes.write_scene(pinched_blocks(2, target_error=0.2), tmp_path / "scene.toml")
    arguments = ["--vary", f"{COEFFICIENT}=0.1", "--set", "output.figures=false"]
    run = run_sweep(scene, tmp_path / "out", *arguments)
    assert run.code == 0, run.output
    summary = json.loads(next(run.folder.glob("*/summary.json")).read_text())
    assert summary["scene"]["body"][0]["mesh"]["divisions"] != [6, 2]
    again = run_sweep(scene, tmp_path / "out", *arguments)
    assert again.code == 0 and "0 to run, 1 finished" in again.stdout


@pytest.mark.parametrize("arguments", [["--gather"], ["--list"]])
def test_nothing_of_another_sweep_is_gathered_or_listed(finished, small, arguments):
    before = whole(finished.folder)
    run = run_sweep(small, finished.folder, *TWO, *OTHER, *arguments, ranks=1)
    if arguments == ["--list"]:
        assert run.code == 0 and run.stdout.count("another sweep") == 2 and "certified" not in run.stdout
    else:
        assert run.code == 2 and "body.0.material.young" in run.messages[0]
    assert whole(finished.folder) == before


@pytest.fixture(scope="module")
def interrupted(small, tmp_path_factory) -> Path:
    """A folder with a checkpoint of the first of two cases."""
    folder = tmp_path_factory.mktemp("interrupted") / "out"
    run = inject(small, folder, "ddmpi.coupling.member.Body.neumann", 3, "SIGUSR1", "--set",
                 "method.outer=relaxation", *TWO)
    assert "interrupted by SIGUSR1" in run.stderr, run.output
    assert [path.name for path in folder.glob("*/checkpoint.h5")] == ["checkpoint.h5"]
    return folder


def test_an_interrupted_case_of_another_sweep_is_refused(interrupted, small):
    before = whole(interrupted)
    run = run_sweep(small, interrupted, "--set", "method.outer=relaxation", "method.theta=0.15", *TWO)
    assert run.code == 2 and len(run.messages) == 1
    assert "a case of another sweep, which differs in method.theta (0.2 there, 0.15 now)" in run.messages[0]
    assert whole(interrupted) == before


def test_after_an_update_the_message_says_what_to_remove(interrupted, small, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(interrupted, folder)
    hook = tmp_path / "hook.py"
    hook.write_text("import sys\nfrom ddmpi.cli import main as cli\nfrom ddmpi.system import provenance\nprovenance.ddmpi.__version__ = '9.9'\n"
                    "cli.main(sys.argv[1:])\n")
    arguments = ["sweep", str(small), "--set", "method.outer=relaxation", *TWO, "--output", str(folder)]
    run = scenes.run_python([str(hook), *arguments], limit=LIMIT, folder=folder)
    assert run.code == 3, run.output
    assert [row["status"] for row in rows(run)] == ["refused", "certified"]
    checkpoint, = folder.glob("*/checkpoint.h5")
    for part in (str(checkpoint), "ddmpi is '9.9' here", "remove the checkpoint"):
        assert part in rows(run)[0]["reason"]
    checkpoint.unlink()
    again = scenes.run_python([str(hook), *arguments], limit=LIMIT, folder=folder)
    assert again.code == 0, again.output


# The table


def written(folder: Path, cases: list, finished_numbers: set[int]) -> None:
    folder.mkdir(exist_ok=True)
    for case in cases:
        if case.number in finished_numbers:
            (folder / case.folder).mkdir(exist_ok=True)
            record_case(folder / case.folder, case, identity(case), 3, "no")
    gather(folder, cases)


def test_a_table_loses_no_case(tmp_path):
    """More values may come, and some that were never run may go; nothing else."""
    three, two = build("method.max_iterations=7,8,9"), build("method.max_iterations=7,8")
    written(tmp_path, three, {0, 1})
    written(tmp_path, two, {0, 1})
    written(tmp_path, three, {0, 1, 2})
    before = (tmp_path / "sweep.csv").read_bytes()
    for cases in (two, build("contact.0.friction.coefficient=0.1,0.2"), build("contact.0.friction.coefficient=0.1",
                                                                             "method.max_iterations=7,8,9")):
        with pytest.raises(InputError, match=r"sweep\.csv: .*max_iterations=[79]"):
            check_table(tmp_path, cases)
        with pytest.raises(OutputError, match=r"sweep\.csv: "):
            gather(tmp_path, cases)
    assert (tmp_path / "sweep.csv").read_bytes() == before


@pytest.mark.parametrize("arguments", [[], ["--gather"]])
def test_another_sweep_does_not_replace_the_table(finished, small, arguments):
    before = whole(finished.folder)
    run = run_sweep(small, finished.folder, "--vary", "method.max_iterations=400,500", *arguments)
    assert run.code == 2 and len(run.messages) == 1 and "sweep.csv" in run.messages[0]
    assert whole(finished.folder) == before


# What wins over what is varied


@pytest.mark.parametrize(("arguments", "variable"), [
    (["-Body_KSP_max_it", "50"], ""), ([], "-body_ksp_max_it 50"), (["--gather", "-body_ksp_max_it", "50"], "")])
def test_an_option_that_would_win(small, tmp_path, monkeypatch, arguments, variable):
    monkeypatch.setenv("PETSC_OPTIONS", variable)
    run = run_sweep(small, tmp_path / "out", "--vary", "petsc.body_ksp_max_it=1,2,100", *arguments)
    assert run.code == 2 and len(run.messages) == 1, run.output
    assert "--vary petsc.body_ksp_max_it" in run.messages[0] and " 50 on the command line" in run.messages[0]
    assert not run.folder.exists()


# Plots


@pytest.mark.parametrize(("vary", "plot", "words"), [
    ("method.max_iterations=1:13:13", "n_A:coefficient", "13 curves"),
    ("method.max_iterations=1:2:2", "status:coefficient", "status is not a number")])
def test_impossible_plots_are_refused_before_any_work(small, tmp_path, vary, plot, words):
    run = run_sweep(small, tmp_path / "out", *TWO, "--vary", vary, "--plot", plot)
    assert run.code == 2 and len(run.messages) == 1 and words in run.messages[0]
    assert not run.folder.exists()


def test_all_cases_have_failed_with_a_plot(small, tmp_path):
    run = run_sweep(small, tmp_path / "out", *TWO, "--set", "body.upper.mesh.divisions=[7,2]", "--plot",
                    "n_A:coefficient")
    assert run.code == 3, run.output
    assert len(run.messages) == 1 and "0 of 2 cases" in run.messages[0] and "not drawn: " in run.stdout
    assert [row["status"] for row in rows(run)] == ["refused"] * 2


def test_a_plot_that_cannot_be_written(finished, small, tmp_path):
    folder = copied(finished, tmp_path)
    picture, = folder.glob("*.png")
    picture.unlink()
    picture.mkdir()
    run = run_sweep(small, folder, *TWO, "--plot", "n_A:coefficient")
    assert run.code == 5 and len(run.messages) == 1, run.output
    assert str(picture) in run.messages[0] and "all 2 cases have a certified answer" in run.messages[0]


# Shares, lists, closed folders


def test_a_share_without_cases(finished, small):
    run = run_sweep(small, finished.folder, *TWO, "--index", "3/5")
    assert run.code == 0 and "none of the 2 cases falls to this share" in run.stdout and "all 0" not in run.stdout


def test_a_list_that_nobody_reads_to_its_end(small, tmp_path):
    """PETSc would have said so on a page, and MPI_ABORT on another."""
    command = [sys.executable, "-m", "ddmpi", "sweep", str(small), "--vary", "method.max_iterations=1:3000:3000",
               "--output", str(tmp_path / "out"), "--list"]
    with subprocess.Popen(command, env=scenes.clean_environment(), stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE) as run:
        run.stdout.close()
        said = run.stderr.read()
        assert (run.wait(LIMIT), said) == (0, b"")


CLOSED = """
import os, sys
from ddmpi.cli import main as cli
from ddmpi.sweep import sweep
original = sweep.check_plots
def check_plots(*arguments):
    if os.geteuid() == 0:  # nothing is closed to root
        os.seteuid(65534)
    original(*arguments)
sweep.check_plots = check_plots
cli.main(sys.argv[1:])
"""


@pytest.mark.parametrize(("arguments", "ranks"), [(["--gather"], 1), ([], 2)])
def test_a_folder_one_may_not_search(small, tmp_path, arguments, ranks):
    hook = tmp_path / "hook.py"
    hook.write_text(CLOSED)
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o000)
    try:
        run = scenes.run_python([str(hook), "sweep", str(small), *TWO, "--output", str(locked / "x"), *arguments],
                                ranks, LIMIT)
    finally:
        locked.chmod(0o755)
    assert run.code == 2 and len(run.messages) == 1, run.output
    assert str(locked / "x") in run.messages[0] and "Permission denied" in run.messages[0]


# Mesh files


def test_a_mesh_file_is_read_once(monkeypatch, tmp_path):
    for name in ("punch_base.msh", "punch_block.msh"):
        shutil.copy(scenes.ROOT / "meshes" / name, tmp_path)
    text = re.sub(r'file = "[^"]*/', 'file = "', (scenes.ROOT / "configs" / "punch.toml").read_text())
    cases = build_cases("scene.toml", text, [], [f"{COEFFICIENT}=0.1:0.5:5"])
    read, original = [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path.name) or original(path))
    first = [case_identity(case, [], tmp_path)["meshes"] for case in cases]
    assert sorted(read) == ["punch_base.msh", "punch_block.msh"] and all(each == first[0] for each in first)
    with open(tmp_path / "punch_block.msh", "a") as file:
        file.write("\n")
    changed = case_identity(cases[0], [], tmp_path)["meshes"]
    assert sorted(read) == ["punch_base.msh", "punch_block.msh", "punch_block.msh"]
    assert {name for name in changed if changed[name] != first[0][name]} == {"punch_block.msh"}


def test_what_cannot_be_read_is_not_run_over(tmp_path):
    case, = build("method.max_iterations=7")
    (tmp_path / RECORD).write_text("{")
    assert read_outcome(tmp_path).status == "unreadable"
    with pytest.raises(InputError, match=re.escape(str(tmp_path))):
        record_case(tmp_path, case, identity(case))
    assert (tmp_path / RECORD).read_text() == "{"
