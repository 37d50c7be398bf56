"""Runs that must fail: the exit code, one message that names the cause, nothing half-written, and an end in time.

All runs are in children with a time limit, in the same one where they can.
"""

import copy

import pytest
import scenes
from fault_cases import run_in_one_go
from scenes import Run, pinched_blocks

pytestmark = pytest.mark.slow

RELAXATION = ("--set", "method.outer=relaxation")


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
    faults = []
    for scene, arguments, _ in ON_SCENE.values():
        folder = tmp_path_factory.mktemp("bad_input")
        path = scenes.write_scene(scene, folder / "scene.toml")
        faults.append((0, "", 0, "", str(folder / "out"), [str(path), *arguments]))
    return dict(zip(ON_SCENE, run_in_one_go(faults, "run"), strict=True))


@pytest.mark.parametrize("name", ON_SCENE)
def test_bad_input(bad_input, name):
    run = bad_input[name]
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

    one = scenes.run_command(scene, here / "one", *RELAXATION, ranks=1, cwd=here)
    two = run_in_one_go([(0, "", 0, "", str(taken), [str(scene)]),
                         (0, "", 0, "", str(here / "none"), [str(here / "nowhere.toml")])], "run")
    return dict(zip(("one rank", "taken", "no scene"), (one, *two), strict=True))


@pytest.mark.parametrize(("name", "words", "files"), [
    ("one rank", ["mpirun -n 2 (started on 1)"], None), ("no scene", ["nowhere.toml"], None),
    ("taken", ["taken", "summary.json"], {"summary.json"})])
def test_surroundings_that_do_not_fit_are_named_and_left_alone(surroundings, name, words, files):
    run = surroundings[name]
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
    thin = pinched_blocks(6, max_iterations=1)
    thin["body"][1]["mesh"] |= {"divisions": [90, 2], "size": [0.01, 1.0]}
    thin["rigid"] = [{"name": "spare", "shape": "plane", "point": [0.0, -9.0], "normal": [0.0, 1.0]}]
    cases = {name: [str(scene), *arguments] for name, arguments in UNSUCCESSFUL.items()}
    cases["thin"] = [str(scenes.write_scene(thin, here / "thin.toml"))]
    orderly = run_in_one_go([(0, "", 0, "", str(here / name), more) for name, more in cases.items()], "run",
                            "--no-figures")
    return dict(zip(cases, orderly, strict=True)) | {  # PETSc reads options of the command line once in a process
        name: scenes.run_command(scene, here / name, "--no-figures", *arguments)
        for name, arguments in FAILING_SOLVERS.items()}


@pytest.mark.parametrize(("name", "iterations"), [("max_iterations", 3), ("max_iterations of newton", 2),
                                                  ("theta = 1", None)])
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
    for words in ("spare: no contact names it", "360 of 360 triangles are thin", "times as long as it is thick"):
        assert sum(words in line for line in run.output.splitlines()) == 1
        assert sum(words in warning for warning in run.summary["warnings"]) == 1


def test_ksp_that_cannot_reach_its_tolerance(unsuccessful):
    """Options from the scene and from the command line together."""
    run = unsuccessful["ksp"]
    assert run.code == 4, run.output
    message = only_message(run)
    assert "body 'upper'" in message and "cg" in message and "DIVERGED_MAX_IT" in message
    assert run.files == set()


def test_subproblem_that_cannot_reach_its_tolerance(unsuccessful):
    run = unsuccessful["qp"]
    assert run.code == 4, run.output
    assert "DIVERGED_MAXITS" in only_message(run)
    assert run.files == set()
