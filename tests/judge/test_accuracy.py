"""The accuracy target: how fine the meshes become, when a run stops, and what it says when it cannot get there."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import solids
from mpi4py import MPI
from scenes import (
    beside_clamps,
    certified,
    drawn_roller,
    pinched_blocks,
    prepare_scene,
    run_here,
    to_toml,
    write_scene,
)
from solid_scenes import two_boxes

from ddmpi.body.estimate import estimate_error, relative_error
from ddmpi.errors import InputError, NotConvergedError, SolverError
from ddmpi.judge.accuracy import (
    LADDER,
    Level,
    MeshLadder,
    demand,
    finer_sizes,
    next_refinement,
    refine_scene,
)
from ddmpi.mesh.build import build_mesh
from ddmpi.results.tables import read_results
from ddmpi.run.run import _climb
from ddmpi.run.solve import solve
from ddmpi.scene.method import PRESETS
from ddmpi.scene.reader import read_scene

PUNCH = "configs/punch.toml"
two_ranks = pytest.mark.mpi(ranks=2)


def without_none(value):
    """Tables without the keys that TOML cannot have."""
    if isinstance(value, dict):
        return {key: without_none(entry) for key, entry in value.items() if entry is not None}
    return [without_none(entry) for entry in value] if isinstance(value, list | tuple) else value


def linear(scene: dict) -> dict:
    """The scene with linear elements, whatever its target."""
    for body in scene["body"]:
        body["mesh"]["order"] = 1
    return scene


def scene_of(made: dict, *settings: str):
    return read_scene("scene.toml", to_toml(made), list(settings))


# How fine


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0])
def test_the_rate_that_was_seen_leads_to_the_target(rate):
    """Errors that fall exactly with a power of the refinement: the third mesh meets the target, and hardly more."""

    def level(k: int) -> Level:
        return Level(k, 1000 * k * k, 0.1 * k**-rate, 1000 * k * k)

    found = next_refinement(
        [level(1), level(2)], goal=0.1 * 6**-rate, most=10**9, doubling=False, dimension=2
    )
    assert 6 <= found <= 8
    assert level(found).error <= 0.1 * 6**-rate


@pytest.mark.slow
def test_refined_scene_has_finer_meshes_and_nothing_else():
    """Refinement changes the meshes of a scene and nothing else."""
    scene = scene_of(pinched_blocks(6))
    fine = refine_scene(scene, 3)
    assert [body.mesh.divisions for body in fine.body] == [(54, 18)] * 2
    assert refine_scene(fine, 1) == fine
    assert (fine.method, fine.contact, fine.body[0].material) == (
        scene.method,
        scene.contact,
        scene.body[0].material,
    )


# Geometries


def square(order: int = 1, sides: int = 10):
    return build_mesh(scene_of(pinched_blocks(sides), f"body.0.mesh.order={order}").body[0])


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_equal_errors_ask_for_equal_sizes(order):
    """Where all elements have the same error, a third of it takes sizes that are smaller by the order's rate."""
    mesh = square(order)
    squares = np.full(len(mesh.triangles), 4e-3 / len(mesh.triangles))
    share, total, triangles = demand(squares, order, 2)
    scale = (total / 9 / share) ** (0.5 / order)
    sizes = finer_sizes(mesh, squares, order, scale)
    assert sizes.sizes == pytest.approx(0.1 * np.sqrt(2 / np.sqrt(3)) * (1 / 3) ** (1 / order))
    assert share / scale**2 == pytest.approx(
        triangles * 9 ** (1 / order)
    )  # elements of the next mesh


def drawn_ladder(*settings: str, done: bool = True) -> tuple[MeshLadder, dict]:
    """The ladder of the drawn roller after a first mesh, with one body's errors on this rank."""
    scene = read_scene("scene.toml", to_toml(drawn_roller(target_error=0.1)), list(settings))
    mesh = square(2)
    squares = np.linspace(1.0, 2.0, len(mesh.triangles))
    ladder = MeshLadder(scene)
    if done and ladder.proceed(Level(1, 1000, 0.3, 1050), {"roller": demand(squares, 2, 2)}):
        ladder.draw({"roller": (mesh, squares)})
    return ladder, {"roller": (mesh, squares)}


@pytest.mark.slow
def test_ladder_of_drawn_meshes():
    """Drawn meshes have as many unknowns as their errors take; shapes beside them are finer by a whole number."""
    ladder, _ = drawn_ladder()
    assert ladder.refinement == pytest.approx(
        (0.3 / (LADDER["aim drawn"] * 0.09)) ** 0.5, rel=1e-2
    )  # equal errors
    assert ladder.factor == 1 and "about 3900 unknowns" in ladder.meshes
    assert ladder.proceed(Level(1, 4000, 0.08, 4200)) is None and not ladder.missed
    assert ladder.levels[-1].refinement == 2.0  # what it has become
    mixed, _ = drawn_ladder(
        'body.block.mesh={shape="rectangle", size=[100, 200], divisions=[2, 4]}'
    )
    assert isinstance(mixed.refinement, int) and mixed.factor == mixed.refinement > 1
    assert set(mixed.sizes) == {"roller"}
    assert refine_scene(mixed.scene, 3).body[0] == mixed.scene.body[0]
    assert refine_scene(mixed.scene, 3).body[1].mesh.divisions == (6, 12)
    one_step = MeshLadder(ladder.scene)
    step = one_step.proceed(Level(1, 1000, 100.0, 1050), {"roller": demand(np.ones(200), 2, 2)})
    assert step == pytest.approx(
        (1 / LADDER["drop"]) ** 0.5
    )  # coarse meshes do not say how fine the last one must be


@pytest.mark.slow
def test_ladder_of_drawn_meshes_is_restored(tmp_path):
    """The sizes of drawn meshes are kept in a checkpoint, those of the last certified answer, too."""
    from ddmpi.results.checkpoint import read, write

    ladder, own = drawn_ladder()
    level = Level(1, 3000, 0.2, 3100)
    ladder.proceed(level, {"roller": demand(own["roller"][1], ladder.rate(level), 2)})
    ladder.draw(own)
    write(tmp_path / "checkpoint.h5", {}, [{"ladder": ladder.state()}])
    (state,) = read(tmp_path / "checkpoint.h5")[1]
    again = MeshLadder(ladder.scene)
    again.restore(state["ladder"])
    assert (again.refinement, again.levels) == (ladder.refinement, ladder.levels)
    for each in (again, ladder):
        assert np.array_equal(each.sizes["roller"].sizes, ladder.sizes["roller"].sizes)
        assert (
            each.fall_back("of this kind")
            and "unknowns" in each.missed
            and "of this kind" in each.missed
        )
        assert each.refinement == ladder.levels[-1].refinement
    assert again.sizes["roller"].sizes.max() > 0.0


def test_drawn_meshes_do_not_exceed_the_most_unknowns():
    """A target that would take more unknowns than allowed is given up with the reason."""
    ladder, own = drawn_ladder("method.max_unknowns=2000")
    assert ladder.refinement <= np.sqrt(2000 / 1050) and not ladder.missed
    level = Level(1, 1900, 0.2, 1990)
    assert (
        ladder.proceed(level, {"roller": demand(own["roller"][1], ladder.rate(level), 2)}) is None
    )
    assert "method.max_unknowns = 2000" in ladder.missed


@pytest.mark.slow
def test_a_drawn_roller_meets_its_target(tmp_path):
    """1 % on the shipped roller, from geometries: few meshes of few unknowns, Hertz's pressure and width to 1 %."""
    done = run_here("configs/roller.toml", tmp_path / "out", "--no-figures")
    assert done.code == 0, done.output
    told = done.summary["discretization_error"]
    assert told["energy_norm"] <= 0.9 * 0.01 < told["levels"][-2]["error"]
    assert len(told["levels"]) <= 4 and done.summary["n"] < 6000
    sides = done.table("contact_cylinder-block_sides.csv")
    x, p = np.array(sides["x"], float), np.array(sides["normal_stress"], float)
    inner = x < 0.8 * 6.2146
    slope, start = np.polyfit(x[inner] ** 2, p[inner] ** 2, 1)
    assert np.sqrt(start) == pytest.approx(3585.36, rel=0.01)
    assert np.sqrt(-start / slope) == pytest.approx(6.2146, rel=0.01)


# When it stops


def test_ladder_of_an_interrupted_run_goes_on_where_it_was():
    """A run that is interrupted on a finer mesh goes on with that mesh."""
    scene = scene_of(pinched_blocks(6), "method.target_error=0.01")
    ladder = MeshLadder(scene)
    second = ladder.proceed(Level(1, 1000, 0.1, 1100))
    third = ladder.proceed(Level(1, 1000 * second**2, 0.02, 1100 * second**2))
    again = MeshLadder(scene)
    again.restore(json.loads(json.dumps(ladder.state())))
    assert (again.refinement, again.levels) == (third, ladder.levels)
    again.proceed(Level(1, 10**6, 0.0079, 10**6))
    assert len(again.levels) == 3 and len(ladder.levels) == 2
    assert ladder.proceed(Level(1, 10**6, 0.0079, 10**6)) is None
    assert not ladder.missed


def test_an_estimate_meets_a_target_with_some_caution():
    """Those of linear triangles have been found a fifth too small, those of quadratic ones a tenth."""
    for order, good, bad in ((1, 0.079, 0.081), (2, 0.089, 0.091)):
        settings = ["method.target_error=0.1", *(f"body.{k}.mesh.order={order}" for k in (0, 1))]
        assert (
            MeshLadder(scene_of(pinched_blocks(6), *settings)).proceed(Level(1, 1000, good, 1000))
            is None
        )
        assert (
            MeshLadder(scene_of(pinched_blocks(6), *settings)).proceed(Level(1, 1000, bad, 1000))
            > 1
        )


def test_no_target_for_linear_triangles_that_lock():
    """At nu = 0.4999 their estimate was 0.14 where the error was 0.87."""
    soft = ["body.upper.material.poisson=0.4999", "method.target_error=0.1"]
    assert {body.mesh.order for body in scene_of(pinched_blocks(6), *soft).body} == {2}
    assert {
        body.mesh.order for body in scene_of(pinched_blocks(6), *soft, "method.preset=fast").body
    } == {2}
    with pytest.raises(
        InputError,
        match=r"body\.upper: linear elements lock at nu = 0\.4999.*leave mesh\.order out",
    ):
        scene_of(pinched_blocks(6), *soft, "body.lower.mesh.order=1")
    assert {body.mesh.order for body in scene_of(pinched_blocks(6), soft[0]).body} == {1}
    plane = [f'body.{k}.material.plane="stress"' for k in (0, 1)]
    first = ["body.0.mesh.order=1"]
    assert scene_of(pinched_blocks(6), *soft, *plane, *first).body[0].mesh.order == 1


@pytest.mark.parametrize(
    "settings, order, halved",
    [
        ([], 2, True),
        (["body.upper.mesh.order=1"], 1, False),
        (["body.upper.mesh.order=2"], 2, False),
        (["method.preset=fast"], 1, False),
        (["method.preset=balanced"], 2, False),
        (["body.upper.mesh.divisions=[18, 5]"], 2, False),
        (["body.upper.mesh.divisions=[18, 2]"], 2, False),
    ],
)
def test_a_target_makes_elements_quadratic_unless_their_order_is_named(settings, order, halved):
    """Shapes then begin with half their divisions, all or none, so that meshes that match go on matching."""
    scene = scene_of(pinched_blocks(6), "method.target_error=0.1", *settings)
    assert [body.mesh.order for body in scene.body] == [order, order]
    assert scene.body[1].mesh.divisions == ((9, 3) if halved else (18, 6))
    assert ("half their divisions" in scene.aimed) == halved
    assert bool(scene.aimed) == (not settings or "divisions" in settings[0])
    again = read_scene("scene.toml", to_toml(without_none(scene.resolved())), [])
    assert again.body == scene.body and not again.aimed


def test_a_target_makes_the_triangles_of_a_file_quadratic():
    """With new middles on straight sides, which is said; files are not made coarser."""
    text = Path(PUNCH).read_text(encoding="utf-8")
    assert {body.mesh.order for body in read_scene(PUNCH, text, []).body} == {1}
    scene = read_scene(PUNCH, text, ["method.target_error=0.1"])
    assert {body.mesh.order for body in scene.body} == {2} and "straight" in scene.aimed


def test_files_are_halved_where_a_target_asks_for_it_alone():
    text = Path(PUNCH).read_text(encoding="utf-8")
    halved = [
        {body.mesh.refine for body in read_scene(PUNCH, text, settings).body}
        for settings in ([], ["method.target_error=0.1"])
    ]
    assert halved[0] == {0}
    assert halved[1] <= {0, "as needed"}


def test_what_a_target_makes_of_meshes_is_said_as_its_ladder_begins(caplog):
    """And nothing of a scene whose meshes stay."""
    caplog.set_level("INFO", "ddmpi")
    text = Path(PUNCH).read_text(encoding="utf-8")
    scene = read_scene(PUNCH, text, ["method.target_error=0.1"])
    MeshLadder(scene)
    assert [record.getMessage() for record in caplog.records] == [scene.aimed]
    caplog.clear()
    MeshLadder(read_scene(PUNCH, text, []))
    assert not caplog.records


@pytest.mark.slow
def test_linear_elements_with_a_large_error_hear_what_quadratic_ones_cost(tmp_path):
    """Their unknowns on the same cells; quadratic elements hear nothing, nor do linear ones with a small error."""
    path = write_scene(pinched_blocks(4), tmp_path / "scene.toml")
    linear, quadratic = (
        run_here(
            path,
            tmp_path / f"of order {order}",
            "--no-figures",
            "--set",
            f"body.0.mesh.order={order}",
        )
        for order in (1, 2)
    )
    told = linear.summary["discretization_error"]["quadratic_n"]
    assert told == pytest.approx(quadratic.summary["n"], rel=0.1)
    assert (
        f"with mesh.order = 2 it is smaller, and these cells have about {told} unknowns"
        in linear.output
    )
    assert quadratic.summary["discretization_error"]["quadratic_n"] is None
    assert "mesh.order" not in quadratic.output


@pytest.mark.slow
def test_quadratic_unknowns_in_space_are_counted_without_edges():
    """By Euler's formula, on bodies without holes."""
    counts = [certified(two_boxes(2, order=k)).summary for k in (1, 2)]
    assert counts[0]["discretization_error"]["quadratic_n"] == pytest.approx(
        counts[1]["n"], rel=0.15
    )


def test_the_published_iteration_stops_later_for_a_target():
    """What is left is about its last update over theta."""
    found = scene_of(pinched_blocks(6) | {"method": {"theta": 0.05, "target_error": 0.1}}).method
    assert found.tolerance == pytest.approx(5e-5)


@pytest.mark.slow
def test_the_tolerance_follows_the_target_unless_it_is_named():
    """The iteration stops at a hundredth of the target."""
    bare = pinched_blocks(6) | {"method": {}}
    assert scene_of(bare, "method.target_error=0.02").method.tolerance == pytest.approx(2e-4)
    assert (
        scene_of(bare, "method.target_error=0.02", "method.tolerance=1e-6").method.tolerance == 1e-6
    )
    assert scene_of(bare).method.tolerance == 1e-8


@pytest.mark.slow
def test_presets_fill_in_what_is_left_out():
    """A preset fills in order, tolerance and target, but no key that the scene names."""
    bare = pinched_blocks(6) | {"method": {}}
    for name, preset in PRESETS.items():
        scene = scene_of(bare, f"method.preset={name}")
        assert {body.mesh.order for body in scene.body} == {preset["order"]}
        assert (scene.method.tolerance, scene.method.target_error) == (
            preset["tolerance"],
            preset.get("target_error"),
        )
    named = scene_of(bare, "method.preset=accurate", "body.0.mesh.order=1", "method.tolerance=1e-5")
    assert {body.mesh.order for body in named.body} == {1}
    assert named.method.tolerance == 1e-5
    assert scene_of(bare, "method.preset=fast", "method.target_error=0.1").method.tolerance == 1e-4
    assert scene_of(
        bare, "method.preset=fast", "method.target_error=1e-3"
    ).method.tolerance == pytest.approx(1e-5)


def test_a_preset_asks_no_target_of_meshes_that_are_given():
    """A preset asks for a target only if all meshes may be refined."""
    text = Path(PUNCH).read_text(encoding="utf-8")
    assert read_scene(PUNCH, text, ["method.preset=accurate"]).method.target_error is None
    both = [f'body.{k}.mesh.refine="as needed"' for k in (0, 1)]
    assert (
        read_scene(PUNCH, text, ["method.preset=accurate", *both]).method.target_error is not None
    )


# Runs


@pytest.mark.slow
def test_linear_triangles_that_lock_have_no_estimate(tmp_path):
    """Where linear triangles lock, the estimated error is null, not 0.14, and a warning says what would be right."""
    scene = pinched_blocks(6) | {"output": {"error": True}}
    done = run_here(
        write_scene(scene, tmp_path / "scene.toml"),
        tmp_path / "results",
        "--no-figures",
        "--set",
        "body.upper.material.poisson=0.4999",
    )
    assert done.code == 0, done.output
    warning = "upper: no estimate: linear elements lock at nu = 0.4999; write mesh.order = 2"
    assert beside_clamps(done.summary["warnings"]) == [warning] and done.output.count(warning) == 1
    assert "estimated discretization error" not in done.output
    error = done.summary["discretization_error"]
    assert error["energy_norm"] is None and error["levels"][0]["error"] is None
    assert [body["discretization_error"] for body in done.summary["bodies"].values()] == [
        None,
        None,
    ]
    assert (
        "error" not in read_results(tmp_path / "results").fields
    )  # of which there is then no picture
    quadratic = run_here(
        write_scene(scene, tmp_path / "scene.toml"),
        tmp_path / "quadratic",
        "--no-figures",
        "--set",
        "body.upper.material.poisson=0.4999",
        "body.upper.mesh.order=2",
    )
    assert 0.0 < quadratic.summary["discretization_error"]["energy_norm"] < 0.3
    assert beside_clamps(quadratic.summary["warnings"]) == []


@pytest.mark.slow
def test_target_is_met_and_told(tmp_path):
    """A run refines until the estimate meets the target, and reports every mesh; nodes that pair off go on so."""
    scene = linear(pinched_blocks(6)) | {
        "method": {"target_error": 0.06},
        "output": {"error": True, "figures": False},
    }
    scene["body"][1]["mesh"]["origin"] = [5e-4, -1e-3]  # the nodes at the ends allow 1/1200
    done = run_here(write_scene(scene, tmp_path / "scene.toml"), tmp_path / "results")
    assert done.code == 0, done.output
    told = done.summary["discretization_error"]
    assert told["energy_norm"] <= 0.8 * 0.06 < told["levels"][-2]["error"]
    assert [level["refinement"] for level in told["levels"]] == sorted(
        {level["refinement"] for level in told["levels"]}
    )
    finest = told["levels"][-1]["refinement"]
    assert done.summary["scene"]["body"][0]["mesh"]["divisions"] == [18 * finest, 6 * finest]
    assert done.summary["n"] == told["levels"][-1]["n"]
    assert (
        "going on with meshes" in done.stdout
        and "error" in read_results(tmp_path / "results").fields
    )


@pytest.mark.slow
def test_target_out_of_reach_is_an_error_with_results(tmp_path):
    """A run that cannot meet its target ends with code 3, the reason, and results."""
    scene = pinched_blocks(6) | {
        "method": {"target_error": 0.02, "max_unknowns": 5000},
        "output": {"figures": False},
    }
    done = run_here(write_scene(scene, tmp_path / "scene.toml"), tmp_path / "results")
    assert done.code == 3
    assert len(done.messages) == 1
    reason = "method.max_unknowns = 5000"
    assert reason in done.messages[0] and "misses method.target_error = 0.02" in done.messages[0]
    assert done.summary["converged"] is False
    assert reason in done.summary["reason"]


@pytest.mark.slow
def test_the_last_certified_answer_survives_a_finer_mesh(tmp_path):
    """Where a finer mesh has no certified answer, the results are those of the last mesh that has one."""
    scene = linear(pinched_blocks(6)) | {"method": {}, "output": {"figures": False}}
    path = write_scene(scene, tmp_path / "scene.toml")
    coarse = run_here(path, tmp_path / "coarse")
    most = coarse.summary["outer_iterations"]
    done = run_here(
        path,
        tmp_path / "fine",
        "--set",
        "method.target_error=0.03",
        f"method.max_iterations={most}",
        "method.tolerance=1e-8",
    )
    assert done.code == 3, done.output
    assert len(done.messages) == 1 and "max_iterations is reached" in done.messages[0]
    assert done.files == coarse.files
    told = done.summary
    assert told["converged"] is False and "max_iterations is reached" in told["reason"]
    levels = told["discretization_error"]["levels"]
    assert (levels[-1]["n"], levels[-1]["error"]) == (
        told["n"],
        told["discretization_error"]["energy_norm"],
    )
    assert max(told["certificate"].values()) <= told["certificate_limit"]


@pytest.mark.slow
@two_ranks
@pytest.mark.parametrize("failure", [InputError, SolverError])
def test_errors_on_a_finer_mesh_leave_the_last_certified_answer(
    comm, tmp_path, monkeypatch, failure
):
    """Pairing or a solver that fails on a finer mesh ends with NotConvergedError, the reason, and results."""
    from ddmpi.run import run as module

    folder = Path(comm.bcast(str(tmp_path)))
    name = "prepare" if failure is InputError else "march"
    works = getattr(module, name)

    def fails(first, second, *more):
        made = second if name == "prepare" else first.scene
        if made.body[0].mesh.divisions[1] > 6:
            error = failure("of this kind")
            error.agreed = True
            raise error
        return works(first, second, *more)

    monkeypatch.setattr(module, name, fails)
    scene = scene_of(linear(pinched_blocks(6)) | {"method": {"target_error": 0.06}})
    with pytest.raises(NotConvergedError, match=r"certified, but .* times as fine .*of this kind"):
        module.run(comm, scene, "scene.toml", str(folder / "out"), figures=False)
    comm.barrier()
    summary = json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["converged"] is False and "of this kind" in summary["reason"]
    assert [level["refinement"] for level in summary["discretization_error"]["levels"]] == [1]
    assert summary["n"] == summary["discretization_error"]["levels"][0]["n"]
    comm.barrier()


@pytest.mark.parametrize("continuing", [False, True])
@pytest.mark.parametrize("failure", [InputError, SolverError])
def test_an_error_on_a_finer_mesh_leaves_the_answer_before(failure, continuing):
    """But for a checkpoint that is refused as a run goes on, which leaves nothing."""
    error = failure("of this kind")
    error.agreed = True
    ladder = SimpleNamespace(fall_back=lambda words: words == "of this kind")
    checkpoints = SimpleNamespace(continuing=continuing, leave=lambda: None)
    outcomes = iter([error, "the answer before"])

    def attempt():
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    if continuing and failure is InputError:
        with pytest.raises(InputError, match="of this kind"):
            _climb(attempt, ladder, checkpoints)
    else:
        assert _climb(attempt, ladder, checkpoints) == "the answer before"


@pytest.mark.slow
def test_a_ladder_that_went_back_stays_there():
    """A run that is interrupted after it went back to a coarser mesh goes on with that mesh and its reason."""
    ladder = MeshLadder(scene_of(pinched_blocks(6), "method.target_error=0.01"))
    assert not ladder.fall_back("no coarser mesh")
    second = ladder.proceed(Level(1, 1000, 0.1, 1100))
    assert ladder.fall_back("of this kind") and f"{second} times as fine" in ladder.missed
    again = MeshLadder(ladder.scene)
    again.restore(json.loads(json.dumps(ladder.state())))
    assert (again.refinement, again.missed, again.levels) == (1, ladder.missed, ladder.levels)
    assert again.proceed(Level(1, 1000, 0.1, 1100)) is None and len(again.levels) == 1
    assert not again.fall_back("twice")


@pytest.mark.slow
def test_given_meshes_are_refined_on_request_only(tmp_path):
    """Meshes of files are refined only with mesh.refine = "as needed"."""
    given = run_here(
        PUNCH, tmp_path / "given", "--set", "method.target_error=0.07", "output.figures=false"
    )
    assert given.code == 3
    assert 'mesh.refine = "as needed"' in given.messages[0]
    allowed = run_here(
        PUNCH,
        tmp_path / "allowed",
        "--set",
        "method.target_error=0.07",
        "output.figures=false",
        *(f'body.{k}.mesh.refine="as needed"' for k in (0, 1)),
    )
    assert allowed.code == 0, allowed.output
    assert allowed.summary["discretization_error"]["energy_norm"] <= 0.8 * 0.07
    assert allowed.summary["scene"]["body"][0]["mesh"]["refine"] > 0


@pytest.mark.slow
def test_the_iteration_leaves_a_small_part_of_the_discretization_error():
    """Against the iteration run to 1e-12 on the same mesh: a tenth of the estimate, or much less."""
    assembly = prepare_scene(MPI.COMM_SELF, pinched_blocks(12) | {"method": {"target_error": 0.1}})
    answer = solve(assembly, assembly.scene.method)
    exact = solve(assembly, scene_of(pinched_blocks(12), "method.tolerance=1e-12").method)
    assert answer.certified
    total = energy = left = 0.0
    for body in assembly.bodies:
        u = answer.displacements[body.spec.name]
        estimate = estimate_error(body.mesh, body.material, u)
        total, energy = total + estimate.total, energy + estimate.energy
        left += estimate_error(
            body.mesh, body.material, u - exact.displacements[body.spec.name]
        ).energy
    assert 0.0 < relative_error(left, energy) <= 0.1 * relative_error(total, energy)


def test_sizes_of_solids_share_the_error():
    """Tetrahedra of the new sizes have alike errors, as many as the demand says, and the total that is wanted."""
    mesh, rate, factor = solids.box((4, 4, 4)), 1.0, 0.5
    squares = np.linspace(1.0, 3.0, len(mesh.triangles)) ** 4
    share, total, _ = demand(squares, rate, 3)
    scale = (total * factor**2 / share) ** (0.5 / rate)
    ratio = scale * squares ** (-1 / (2 * rate + 3))  # h_new over h
    assert (squares * ratio ** (2 * rate)).sum() == pytest.approx(factor**2 * total)
    assert np.ptp(squares * ratio ** (2 * rate + 3)) < 1e-9 * squares.max()  # of a new cell each
    assert (ratio**-3.0).sum() == pytest.approx(share / scale**3)
    alike = finer_sizes(mesh, np.ones(len(mesh.triangles)), rate, 1.0)
    assert alike.sizes == pytest.approx((np.sqrt(2.0) / 64) ** (1 / 3))
