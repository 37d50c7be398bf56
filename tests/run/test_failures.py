"""Runs that must fail: the exit code, one message that names the cause, nothing half-written, and an end in time.

All runs are in children with a time limit, in the same one where they can.
"""

import pytest
import scenes
from fault_cases import run_in_one_go
from scenes import Run, pinched_blocks

pytestmark = pytest.mark.slow

RELAXATION = ("--set", "method.outer=relaxation")


def only_message(run: Run) -> str:
    assert len(run.messages) == 1, run.output
    assert "Traceback" not in run.output
    return run.messages[0]


def test_surroundings_that_do_not_fit_are_named_and_left_alone(tmp_path):
    """A folder with results, a scene that is not there."""
    scene, taken = (
        scenes.write_scene(pinched_blocks(2), tmp_path / "scene.toml"),
        tmp_path / "taken",
    )
    taken.mkdir()
    (taken / "summary.json").write_text("precious")
    for path, folder, arguments, words in (
        (scene, taken, (), ["taken", "summary.json"]),
        (tmp_path / "nowhere.toml", tmp_path / "none", (), ["nowhere.toml"]),
    ):
        run = scenes.run_here(path, folder, *arguments)
        assert run.code == 2 and all(word in only_message(run) for word in words)
        assert run.files == {"summary.json"} if folder == taken else not folder.exists()
    assert (taken / "summary.json").read_text() == "precious"


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
    scene = scenes.write_scene(pinched_blocks(2), here / "scene.toml")
    thin = pinched_blocks(6, max_iterations=1)
    thin["body"][1]["mesh"] |= {"divisions": [90, 2], "size": [0.01, 1.0]}
    thin["rigid"] = [
        {"name": "spare", "shape": "plane", "point": [0.0, -9.0], "normal": [0.0, 1.0]}
    ]
    cases = {name: [str(scene), *arguments] for name, arguments in UNSUCCESSFUL.items()}
    cases["thin"] = [str(scenes.write_scene(thin, here / "thin.toml"))]
    orderly = run_in_one_go(
        [(0, "", 0, "", str(here / name), more) for name, more in cases.items()],
        "run",
        "--no-figures",
    )
    return dict(
        zip(cases, orderly, strict=True)
    ) | {  # PETSc reads options of the command line once in a process
        name: scenes.run_command(scene, here / name, "--no-figures", *arguments)
        for name, arguments in FAILING_SOLVERS.items()
    }


@pytest.mark.parametrize(
    ("name", "iterations"),
    [("max_iterations", 3), ("max_iterations of newton", 2), ("theta = 1", None)],
)
def test_unsuccessful_runs_leave_results_that_say_so(unsuccessful, name, iterations):
    run = unsuccessful[name]
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


def test_an_unsuccessful_end_warns_of_thin_cells_and_slender_bodies(unsuccessful):
    """They may be why; each warning stands once on the screen, and in the summary."""
    run = unsuccessful["thin"]
    assert run.code == 3 and len(run.summary["warnings"]) == 3
    for words in (
        "spare: no contact names it",
        "360 of 360 triangles are thin",
        "times as long as it is thick",
    ):
        assert sum(words in line for line in run.output.splitlines()) == 1
        assert sum(words in warning for warning in run.summary["warnings"]) == 1


@pytest.mark.parametrize(
    ("name", "words"),
    [("ksp", ["body 'upper'", "cg", "DIVERGED_MAX_IT"]), ("qp", ["DIVERGED_MAXITS"])],
)
def test_solvers_that_cannot_reach_their_tolerance(unsuccessful, name, words):
    """Options from the scene and from the command line together."""
    run = unsuccessful[name]
    assert run.code == 4 and run.files == set(), run.output
    assert all(word in only_message(run) for word in words)
