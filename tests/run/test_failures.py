"""Runs that must fail: the exit code, one message that names the cause, nothing half-written, and an end in time.

All runs are children with a time limit, several at once: most of their time they wait for mpirun.
"""

import copy
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import scenes
from scenes import Run, pinched_blocks

pytestmark = pytest.mark.slow

AT_ONCE = 2
RELAXATION = ("--set", "method.outer=relaxation")


def run_all(jobs: dict[object, Callable[[], Run]]) -> dict[object, Run | Exception]:
    """The jobs' runs; an exception stands for a run that did not end."""
    def guarded(job: Callable[[], Run]) -> Run | Exception:
        try:
            return job()
        except Exception as error:
            return error

    with ThreadPoolExecutor(AT_ONCE) as pool:
        return dict(zip(jobs, pool.map(guarded, jobs.values()), strict=True))


def of(runs: dict, name: object) -> Run:
    if isinstance(runs[name], Exception):
        raise runs[name]
    return runs[name]


def changed(body: int | None = None, **entries) -> dict:
    """The pinched blocks at N = 2 with entries of the scene, or of a body, replaced; None removes one."""
    scene = copy.deepcopy(pinched_blocks(2))
    table = scene if body is None else scene["body"][body]
    for key, value in entries.items():
        if value is None:
            del table[key]
        else:
            table[key] = value
    return scene


def only_message(run: Run) -> str:
    assert len(run.messages) == 1, run.output
    assert "Traceback" not in run.output
    return run.messages[0]


# Bad input

ON_SCENE = {
    # what is wrong: (scene, arguments, what the message must name)
    "unknown key after --set": (changed(), ["--set", "method.thetta=0.3"],
                                ["scene.toml", "method.thetta", "'theta'"]),
    "unknown argument": (changed(), ["--ouput=x"], ["--ouput"]),
    "boundary that is not there": (changed(0, clamp=["lfet"]), [], ["scene.toml", "body.upper.clamp", "lfet", "left"]),
    "body that is not held, where it must be": (changed(0, clamp=[{"on": "left", "x": 0.0}]), RELAXATION,
                                                ["scene.toml", "method.outer", "of 'upper' leave a rigid motion free"]),
    "meshes that do not match": (changed(), ["--set", "body.upper.mesh.divisions=[7, 2]", "contact.0.pairing=nodes"],
                                 ["scene.toml", "contact.upper-lower", "8 and 7"]),
}


@pytest.fixture(scope="module")
def bad_input(tmp_path_factory) -> dict[str, Run]:
    def job(scene: dict, arguments: list[str]) -> Callable[[], Run]:
        folder = tmp_path_factory.mktemp("bad_input")
        scenes.write_scene(scene, folder / "scene.toml")
        return lambda: scenes.run_command("scene.toml", folder / "out", *arguments, cwd=folder)

    return run_all({name: job(scene, arguments) for name, (scene, arguments, _) in ON_SCENE.items()})


@pytest.mark.parametrize("name", ON_SCENE)
def test_bad_input(bad_input, name):
    run = of(bad_input, name)
    assert run.code == 2, run.output
    message = only_message(run)
    for word in ON_SCENE[name][2]:
        assert word in message
    assert [path.name for path in run.folder.parent.iterdir()] == ["scene.toml"]


# Surroundings that do not fit, and questions


@pytest.fixture(scope="module")
def surroundings(tmp_path_factory) -> dict[str, Run]:
    here = tmp_path_factory.mktemp("surroundings")
    scene = scenes.write_scene(pinched_blocks(2), here / "scene.toml")
    (here / "file").write_text("not a folder")
    taken = here / "taken"
    taken.mkdir()
    (taken / "summary.json").write_text("precious")

    def command(folder: Path, *arguments: str, path: Path = scene, ranks: int = 2) -> Callable[[], Run]:
        return lambda: scenes.run_command(path, folder, *arguments, ranks=ranks, cwd=here)

    def question(*arguments: str) -> Callable[[], Run]:
        return lambda: scenes.run_python(["-m", "ddmpi", *arguments], cwd=here)

    return run_all({
        "one rank": command(here / "one", *RELAXATION, ranks=1),
        "anderson on one rank": command(here / "anderson", "--set", "method.outer=anderson", ranks=1),
        "no scene": command(here / "none", path=here / "nowhere.toml"), "taken": command(taken),
        "below a file": command(here / "file" / "out"),
        "--version": question("--version"), "--help": question("run", "--help"),
    })


@pytest.mark.parametrize("name", ["one rank", "anderson on one rank"])
def test_the_published_iteration_wants_a_rank_for_each_body(surroundings, name):
    run = of(surroundings, name)
    assert run.code == 2
    assert "mpirun -n 2 (started on 1)" in only_message(run)
    assert not run.folder.exists()


def test_scene_that_is_not_there(surroundings):
    run = of(surroundings, "no scene")
    assert run.code == 2
    assert "nowhere.toml" in only_message(run)
    assert not run.folder.exists()


def test_results_are_not_overwritten(surroundings):
    run = of(surroundings, "taken")
    assert run.code == 2
    assert "taken" in only_message(run) and "summary.json" in only_message(run)
    assert run.files == {"summary.json"}
    assert (run.folder / "summary.json").read_text() == "precious"


def test_folder_that_cannot_be_written(surroundings):
    """Below a regular file: permissions do not bind root."""
    run = of(surroundings, "below a file")
    assert run.code == 2
    assert str(run.folder) in only_message(run)


@pytest.mark.parametrize(("name", "once"), [("--version", r"^ddmpi \d+\.\d+\.\d+$"), ("--help", r"^usage: ddmpi run ")])
def test_questions_are_answered_once(surroundings, name, once):
    run = of(surroundings, name)
    assert run.code == 0
    assert run.own_stderr == ""
    assert len(re.findall(once, run.stdout, re.MULTILINE)) == 1


def test_exit_codes_are_in_the_help(surroundings):
    text = of(surroundings, "--help").stdout
    assert "2 bad input" in text and "3 not converged" in text


# Runs that do not converge, and solvers that fail

UNSUCCESSFUL = {
    "max_iterations": [*RELAXATION, "method.max_iterations=3"],
    "max_iterations of newton": ["--set", "method.outer=newton", "method.max_iterations=2"],
    "theta = 1": [*RELAXATION, "method.theta=1.0"],
}
FAILING_SOLVERS = {
    "ksp": ["--set", "petsc.body_ksp_type=cg", "petsc.body_pc_type=none", "-body_ksp_max_it", "3"],
    "qp": [*RELAXATION, "-qp_tao_max_it", "2"],
}


@pytest.fixture(scope="module")
def unsuccessful(tmp_path_factory) -> dict[str, Run]:
    here = tmp_path_factory.mktemp("unsuccessful")
    scene = scenes.write_scene(pinched_blocks(4), here / "scene.toml")
    return run_all({name: lambda name=name, arguments=arguments: scenes.run_command(
        scene, here / name, "--no-figures", *arguments)
        for name, arguments in (UNSUCCESSFUL | FAILING_SOLVERS).items()})


@pytest.mark.parametrize("name", UNSUCCESSFUL)
def test_unsuccessful_runs_leave_results_that_say_so(unsuccessful, name):
    run = of(unsuccessful, name)
    assert run.code == 3, run.output
    message, summary = only_message(run), run.summary
    assert summary["converged"] is False
    assert summary["reason"] in message
    assert run.files == scenes.DATA
    assert len(run.table("history.csv")["iteration"]) == summary["outer_iterations"]
    residuals = [residual for residual in summary["certificate"].values() if residual is not None]
    assert any(residual > summary["certificate_limit"] for residual in residuals)


@pytest.mark.parametrize(("name", "iterations"), [("max_iterations", 3), ("max_iterations of newton", 2)])
def test_max_iterations(unsuccessful, name, iterations):
    run = of(unsuccessful, name)
    assert run.summary["outer_iterations"] == iterations
    assert "max_iterations" in only_message(run)


def test_an_unsuccessful_end_warns_of_thin_cells_and_slender_bodies(tmp_path):
    """They may be why; each warning stands once on the screen, and in the summary."""
    scene = scenes.pinched_blocks(6)
    scene["body"][1]["mesh"] |= {"divisions": [90, 2], "size": [0.01, 1.0]}
    scene["rigid"] = [{"name": "spare", "shape": "plane", "point": [0.0, -9.0], "normal": [0.0, 1.0]}]
    scene["method"] = {"max_iterations": 1}
    run = scenes.run_command(scenes.write_scene(scene, tmp_path / "scene.toml"), tmp_path / "out", "--no-figures")
    assert run.code == 3 and len(run.summary["warnings"]) == 3
    for words in ("spare: no contact names it", "360 of 360 triangles are thin", "times as long as it is thick"):
        assert sum(words in line for line in run.output.splitlines()) == 1
        assert sum(words in warning for warning in run.summary["warnings"]) == 1


def test_too_large_theta(unsuccessful):
    run = of(unsuccessful, "theta = 1")
    assert "diverged" in run.summary["reason"] or "max_iterations" in run.summary["reason"]
    assert run.summary["outer_iterations"] <= 500
    assert "theta" in run.output


def test_ksp_that_cannot_reach_its_tolerance(unsuccessful):
    """Options from the scene and from the command line together."""
    run = of(unsuccessful, "ksp")
    assert run.code == 4, run.output
    message = only_message(run)
    assert "body 'upper'" in message and "cg" in message and "DIVERGED_MAX_IT" in message
    assert run.files == set()


def test_subproblem_that_cannot_reach_its_tolerance(unsuccessful):
    run = of(unsuccessful, "qp")
    assert run.code == 4, run.output
    assert "DIVERGED_MAXITS" in only_message(run)
    assert run.files == set()
