"""Runs that must fail: the exit code, one message that names the cause, nothing half-written, and an end in time.

All runs are children with a time limit, several at once: most of their time they wait for mpirun.
"""

import copy
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
    "boundary that is not there": (changed(0, clamp=["lfet"]), [], ["scene.toml", "body.upper.clamp", "lfet", "left"]),
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


# Surroundings that do not fit


@pytest.fixture(scope="module")
def surroundings(tmp_path_factory) -> dict[str, Run]:
    here = tmp_path_factory.mktemp("surroundings")
    scene = scenes.write_scene(pinched_blocks(2), here / "scene.toml")
    taken = here / "taken"
    taken.mkdir()
    (taken / "summary.json").write_text("precious")

    def command(folder: Path, *arguments: str, path: Path = scene, ranks: int = 2) -> Callable[[], Run]:
        return lambda: scenes.run_command(path, folder, *arguments, ranks=ranks, cwd=here)

    return run_all({"one rank": command(here / "one", *RELAXATION, ranks=1), "taken": command(taken),
                    "no scene": command(here / "none", path=here / "nowhere.toml")})


@pytest.mark.parametrize(("name", "words", "files"), [
    ("one rank", ["mpirun -n 2 (started on 1)"], None), ("no scene", ["nowhere.toml"], None),
    ("taken", ["taken", "summary.json"], {"summary.json"})])
def test_surroundings_that_do_not_fit_are_named_and_left_alone(surroundings, name, words, files):
    run = of(surroundings, name)
    assert run.code == 2 and all(word in only_message(run) for word in words)
    assert run.files == files if files else not run.folder.exists()
    if name == "taken":
        assert (run.folder / "summary.json").read_text() == "precious"


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


@pytest.mark.parametrize(("name", "iterations"), [("max_iterations", 3), ("max_iterations of newton", 2),
                                                  ("theta = 1", None)])
def test_unsuccessful_runs_leave_results_that_say_so(unsuccessful, name, iterations):
    run = of(unsuccessful, name)
    assert run.code == 3, run.output
    message, summary = only_message(run), run.summary
    assert summary["converged"] is False and summary["reason"] in message
    assert run.files == scenes.DATA
    assert len(run.table("history.csv")["iteration"]) == summary["outer_iterations"]
    residuals = [residual for residual in summary["certificate"].values() if residual is not None]
    assert any(residual > summary["certificate_limit"] for residual in residuals)
    if iterations:
        assert summary["outer_iterations"] == iterations and "max_iterations" in message
    else:
        assert summary["outer_iterations"] <= 500 and "theta" in run.output


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
