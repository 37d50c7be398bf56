"""Targets of results: meshes that are made for them, when a run stops, and what it says when it cannot get there."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from mpi4py import MPI
from scenes import (
    assert_refused,
    call,
    drawn_roller,
    pinched_blocks,
    rectangle,
    seldom,
    to_toml,
    write_scene,
)
from solid_scenes import two_boxes

import ddmpi
from ddmpi.errors import InputError
from ddmpi.judge.accuracy import (
    LADDER,
    Cost,
    Level,
    MeshLadder,
    Miss,
    allowed,
    demand,
    next_refinement,
    price_in_words,
    weighted,
)
from ddmpi.judge.bars import COARSE, ENDLESS, LARGEST, UNRESOLVED, Bar
from ddmpi.pictures.levels import draw_levels
from ddmpi.results import checkpoint
from ddmpi.results.summary import with_bar
from ddmpi.results.tables import read_results
from ddmpi.run.run import _squares
from ddmpi.scene.reader import read_scene, read_scene_file
from ddmpi.system.files import CHECKPOINT

NORMAL, ALONG = (f"contacts.upper-lower.{what}" for what in ("normal_force", "force.x"))
PEAK, PRESSURE = "bodies.upper.von_mises_max", "contacts.upper-lower.pressure_max"
PIN = [NORMAL.replace("upper-lower", "pin-lug"), "contacts.pin-lug.pressure_max"]


def aiming(target: dict, scene: dict | None = None, **method) -> dict:
    return (scene or pinched_blocks(6)) | {"method": {"target": target} | method}


def pin_in_lug(scale: float = 1.0) -> dict:
    """The pin and the lug of configs/drawn, meshed in the run."""
    lug = {"geometry": "configs/drawn/lug.geo", "size": 8.0}
    pin = {"geometry": "configs/drawn/pin.geo", "size": 4.0}
    contact = {"bodies": ["pin", "lug"], "on": ["shank", "hole"]}
    contact["friction"] = {"law": "coulomb", "coefficient": 0.2}
    return {
        "body": [
            {"name": "lug", "mesh": lug, "clamp": ["end"]}
            | {"material": {"young": 7e4 * scale, "poisson": 0.33}},
            {"name": "pin", "mesh": pin, "volume_force": [6.36619772367581 * scale, 0.0]}
            | {"material": {"young": 2.1e5 * scale, "poisson": 0.3}},
        ],
        "contact": [contact],
    }


def ladder_of(target: dict, scene: dict | None = None, *settings: str) -> MeshLadder:
    return MeshLadder(read_scene("scene.toml", to_toml(aiming(target, scene)), list(settings)))


def levels(answer) -> list[dict]:
    return answer.summary["discretization_error"]["levels"]


# Runs


def test_meshes_are_refined_until_all_bars_are_within():
    """By whole numbers, with quadratic elements; the values of 22 cells across, as the design gives them, are covered."""
    answer = ddmpi.solve(aiming({NORMAL: 0.01, ALONG: {"within": 2e5}}))
    assert answer.certified and answer.summary["order"] == 2
    assert levels(answer)[0]["n"] < 600  # half the divisions
    normal, along = answer.error(NORMAL), answer.error(ALONG)
    assert normal.bar <= 0.01 * normal.value and along.bar <= 2e5
    assert abs(normal.value - 1.1507844e8) < normal.bar
    assert abs(abs(along.value) - 8.325063e6) < along.bar
    before = levels(answer)[-2]["results"]
    assert before[NORMAL]["bar"] > 0.01 * normal.value or before[ALONG]["bar"] > 2e5
    assert [one["refinement"] for one in levels(answer)] == sorted(
        one["refinement"] for one in levels(answer)
    )


@pytest.mark.slow
def test_meshes_of_drawings_follow_the_results():
    """The pin in the lug to 0.1 %: uniform meshes need 70,000 unknowns, the energy norm 58,000. On a uniform mesh of 8
    times the fineness the force is 2090.9 N. Units hardly matter: gmsh rounds otherwise."""
    answer = ddmpi.solve(aiming(dict.fromkeys(PIN, 1e-3), pin_in_lug(), tolerance=1e-8))
    assert answer.certified and levels(answer)[-1]["dofs"] < 1.3 * 5642
    force, peak = (answer.error(one) for one in PIN)
    assert force.bar <= 1e-3 * force.value and peak.bar <= 1e-3 * peak.value
    assert abs(force.value - 2090.9) < force.bar
    scaled = ddmpi.solve(aiming(dict.fromkeys(PIN, 1e-3), pin_in_lug(1e3), tolerance=1e-8))
    assert scaled.summary["n"] == pytest.approx(answer.summary["n"], rel=0.05)
    assert all(scaled.error(one).bar <= 1e-3 * scaled.error(one).value for one in PIN)


@pytest.mark.slow
def test_targets_in_space_and_of_both_kinds():
    """Both hold: the smaller error decides."""
    scene = two_boxes(1)
    for each in scene["body"]:
        each["mesh"].pop("order", None)
    one = ddmpi.solve(aiming({NORMAL: 0.04}, scene))
    both = ddmpi.solve(aiming({NORMAL: 0.04}, scene, target_error=0.1))
    assert one.error(NORMAL).bar <= 0.04 * one.error(NORMAL).value
    assert both.error(NORMAL).bar <= 0.04 * both.error(NORMAL).value
    assert both.summary["discretization_error"]["energy_norm"] <= 0.09
    assert one.summary["discretization_error"]["energy_norm"] > 0.09
    assert both.summary["n"] > one.summary["n"] > levels(one)[0]["n"]


@pytest.mark.parametrize(
    ("target", "method", "words", "meshes"),
    [
        seldom(
            {ALONG: 0.01}, {"max_unknowns": 3000}, "would probably exceed method.max_unknowns", 2
        ),
        ({PEAK: 0.01}, {}, f"no bar, {ENDLESS}; {PEAK} has no bar on finer meshes either", 1),
        ({ALONG: 1e-5}, {}, "on any mesh", 1),
    ],
)
def test_what_cannot_be_met_is_said(tmp_path, target, method, words, meshes):
    """With the results, and with code 3; what no mesh changes after the first one."""
    scene = write_scene(aiming(target, **method), tmp_path / "scene.toml")
    done = call("run", str(scene), "--output", str(tmp_path / "out"), "--no-figures")
    assert done.code == 3 and words in done.messages[0]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert words in summary["reason"] and not summary["converged"]
    assert len(summary["discretization_error"]["levels"]) == meshes
    assert summary["errors"].keys() == target.keys()


def test_a_number_that_is_zero_by_statics_needs_a_unit():
    """A symmetric block between smooth jaws is not pushed aside."""
    block = rectangle("block", (0.0, 0.0), (2.0, 1.0), (4, 4), clamp=["bottom"])
    block["traction"] = [{"on": "top", "value": [0.0, -1e6]}]
    scene, aside = {"body": [block]}, "bodies.block.reaction.x"
    answer = ddmpi.solve(aiming({aside: 0.01}, scene))
    assert not answer.certified and "is zero but for rounding" in answer.reason
    assert len(levels(answer)) == 1
    assert ddmpi.solve(aiming({aside: {"within": 1e4}}, scene)).certified


@pytest.mark.slow
def test_a_peak_is_resolved_where_it_is_smooth():
    """A coarse mesh has words for it, a finer one a bar: Hertz's pressure of a cylinder between rigid planes."""
    scene, peak = drawn_roller(), "contacts.cylinder-block.pressure_max"
    answer = ddmpi.solve(aiming({peak: 0.01}, scene))
    assert answer.certified
    words = [one["results"][peak]["word"] for one in levels(answer)]
    assert words[0] and not words[-1]
    assert abs(answer.error(peak).value - 3585.36) < 0.01 * 3585.36


def test_bad_targets_are_refused_before_work():
    assert_refused(aiming({"contacts.uper-lower.normal_force": 0.1}), "did you mean", NORMAL)
    steps = aiming({NORMAL: 0.1}) | {"time": {"points": [1.0], "steps": 1}}
    assert_refused(steps, "method.target is for one load step")
    assert_refused(
        aiming({"bodies.upper.points.tip.displacement.x": 0.1}), "method.target", "'tip'"
    )
    assert_refused(aiming({PEAK: 0.1}) | {"output": {"stress": False}}, "method.target", PEAK)


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_targets_on_two_ranks():
    """Bodies on ranks of their own get the meshes and the bars of one rank, which has these."""
    answer = ddmpi.solve(aiming({NORMAL: 0.02}, pinched_blocks(4)), MPI.COMM_WORLD)
    assert answer.certified
    assert [one["n"] for one in levels(answer)] == [240, 864]
    bars = [one["results"][NORMAL]["bar"] for one in levels(answer)]
    assert bars == pytest.approx([3916845.36, 1928402.18], rel=1e-6)


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_targets_of_drawings_on_several_ranks():
    """The meshes are those of one rank, but for rounding, from which gmsh makes other ones."""
    world, scene = MPI.COMM_WORLD, aiming(dict.fromkeys(PIN, 5e-3), pin_in_lug())
    answer = ddmpi.solve(scene, world)
    alone = ddmpi.solve(scene, MPI.COMM_SELF) if world.rank == 0 else None
    mine = [(one["n"], one["results"][PIN[0]]["bar"]) for one in levels(alone)] if alone else None
    expected = world.bcast(mine)
    assert answer.certified and len(levels(answer)) == len(expected)
    assert levels(answer)[0]["n"] == expected[0][0]
    for one, (n, bar) in zip(levels(answer), expected, strict=True):
        assert one["n"] == pytest.approx(n, rel=0.03)
        assert one["results"][PIN[0]]["bar"] == pytest.approx(bar, rel=0.3)


# What a smaller bar takes


def seen(*levels: tuple[float, float], target: dict | None = None, scene: dict | None = None):
    """A ladder that has been on meshes with these refinements and bars of NORMAL."""
    ladder = ladder_of(target or {NORMAL: 1e-4}, scene)
    for refinement, bar in levels:
        n = round(500 * refinement**2)
        bars = {NORMAL: Bar(100.0, bar, "", bar)}
        ladder.levels.append(Level(refinement, n, 0.1, n, bars, Cost(n / 500, 0.0, 5.0 * n, 0.0)))
    return ladder


def test_half_a_bar_takes_what_a_ladder_would():
    """With the rate that was seen: bars that fall with the square of the size are halved by a third more divisions; the
    ladder goes there from the first mesh."""
    price = seen((1, 8.0), (2, 2.0), (4, 0.5)).price(NORMAL, 0.5)
    assert price is not None
    last = seen((1, 8.0), (2, 2.0), (4, 0.5)).levels[-1]
    finest = (price["unknowns"] / last.n) ** 0.5 * 4
    assert finest == pytest.approx(round(finest)) and 8.0 / finest**2 <= 0.25 < 8.0 / 4**2
    slow = seen((1, 4.0), (2, 2.0), (4, 1.0)).price(NORMAL, 0.5)
    assert slow["unknowns"] > price["unknowns"]
    first = seen((1, 8.0)).price(NORMAL, 0.5)
    assert 2.0 < first["unknowns"] / 500 < 9.0
    assert seen((1, 8.0)).price(NORMAL, 0.99)["unknowns"] == 2000  # of twice the divisions
    assert seen((1, 1e-4)).price(NORMAL, 0.5)["unknowns"] == first["unknowns"]


@pytest.mark.parametrize(
    ("bars", "ends"),
    [
        ([(1, 2.0), (2, 8.0), (8, 7.0)], True),
        ([(1, 2.0), (2, 8.0), (8, 6.0)], False),
        ([(1, 8.0), (2, 8.0), (3, 7.0)], False),
        ([(1, 8.0), (8, 7.0)], False),
    ],
)
def test_a_bar_that_stays_ends_the_ladder(bars, ends):
    ladder = seen(*bars[:-1])
    refinement, last = bars[-1]
    ladder.refinement, n = refinement, round(500 * refinement**2)
    ladder.proceed(Level(1, n, 0.1, n, {NORMAL: Bar(100.0, last, "", last)}))
    assert ("stays as it is on finer meshes, as where straight sides" in ladder.missed) == ends


def test_there_is_no_price_of_what_no_mesh_has():
    ladder = seen((1, 8.0))
    bars = {
        NORMAL: Bar(100.0, None, UNRESOLVED, 8.0, 2.0),
        ALONG: Bar(1.0, 2e-3, "", 2e-3, 0.0, 1e-3),
    }
    ladder.levels[-1] = ladder.levels[-1]._replace(results=bars)
    assert ladder.price(NORMAL, 0.5) is None and ladder.price(ALONG, 0.5) is None
    assert ladder.price(ALONG, 0.6) is not None


def test_meshes_of_drawings_cost_what_equal_errors_take():
    """From the first mesh by the demand of its cells; from there on they share the errors already."""
    ladder = ladder_of({PIN[0]: 1e-3}, pin_in_lug())
    cost, bars = Cost(1.0, 0.0, 4e8, 1e8), {PIN[0]: Bar(100.0, 8.0, "", 8.0)}
    equal = {PIN[0]: demand(np.ones(1000), 2.0, 2)}
    ladder.proceed(Level(1, 5000, 0.1, 5000, bars, cost), {"pin": equal[PIN[0]]}, equal)
    price = ladder.price(PIN[0], 0.5)
    assert price["unknowns"] == pytest.approx(5000 / (0.5 * LADDER["aim drawn"] ** 2) ** 0.5, abs=1)
    few = {PIN[0]: demand(np.append(np.ones(10), 1e-9 * np.ones(990)), 2.0, 2)}
    ladder._alone = few
    assert ladder.price(PIN[0], 0.5)["bytes"] == 4e8  # the first mesh is there before
    assert 0.25 * 5000 < ladder.price(PIN[0], 0.5)["unknowns"] < 0.3 * 5000  # elements grow twofold
    ladder.levels.append(ladder.levels[0]._replace(n=4000, dofs=4000))
    again = ladder.price(PIN[0], 0.5)
    assert again["unknowns"] == pytest.approx(4000 * 2.0**0.5, abs=1)
    assert again["bytes"] == pytest.approx(1e8 + 3e8 * 2.0**0.5)
    assert again["seconds"] == pytest.approx(2.0 + (4000 * 2.0**0.5 + 5000) / 9000)


def test_factors_in_space_grow_faster_than_the_rest():
    """Of a mesh of 1,500 unknowns half of the rest is there on any mesh."""
    seconds, memory = Cost(3.0, 1.0, 5.0, 1.0).of(1500, 8.0, 3)
    assert seconds == pytest.approx(8.0**1.75 + 2.0 * (8.0 + 1.0) / 2.0)
    assert memory == pytest.approx(1.0 + 4.0 * 16.0)
    assert Cost(3.0, 1.0, 5.0, 1.0).of(5000, 1.0, 2) == (3.0, 5.0)


@pytest.mark.slow
def test_a_run_says_what_half_its_bars_take(tmp_path):
    """In the log, the report and the summary; a run with half the bar takes about as much."""
    scene = write_scene(
        pinched_blocks(4) | {"output": {"errors": [NORMAL, ALONG]}}, tmp_path / "s.toml"
    )
    done = call("run", str(scene), "--output", str(tmp_path / "out"), "--no-figures")
    errors = json.loads((tmp_path / "out" / "summary.json").read_text())["errors"]
    halves = {name: entry["half"] for name, entry in errors.items()}
    assert f"half of the bar of {NORMAL}, the dearest one, takes about" in done.stdout
    assert "s of processor time and" in done.stdout
    assert call("report", str(tmp_path / "out")).code == 0
    assert price_in_words(halves[ALONG]) in (tmp_path / "out" / "report.html").read_text()
    for name, half in halves.items():
        target = {name: {"within": errors[name]["bar"] / 2}}
        linear = pinched_blocks(4)
        for each in linear["body"]:
            each["mesh"]["order"] = 1
        finer = ddmpi.solve(aiming(target, linear))
        assert 0.4 < half["unknowns"] / finer.summary["n"] < 2.5
        assert half["bytes"] > 1e7 and half["seconds"] > 0.0


# The command


def test_converge_takes_overrides():
    answer = ddmpi.converge(pinched_blocks(2), NORMAL, 1.0, overrides={"title": "pinched"})
    assert answer.summary["scene"]["title"] == "pinched"
    assert len(answer.meshes(NORMAL)) == 1


@pytest.mark.slow
def test_converge_is_a_run_with_one_target(tmp_path):
    """The table in the log, in converge.json and in Python is that of the meshes; the picture has them."""
    scene, out = write_scene(pinched_blocks(4), tmp_path / "scene.toml"), tmp_path / "out"
    done = call("converge", str(scene), "--of", NORMAL, "--within", "0.03", "--output", str(out))
    assert done.code == 0 and (out / "accuracy.png").exists()
    told = json.loads((out / "converge.json").read_text())
    assert told["converged"] and [*told["results"]] == [NORMAL]
    meshes = told["results"][NORMAL]["meshes"]
    answer = ddmpi.converge(pinched_blocks(4), of=NORMAL, within=0.03)
    same = answer.meshes(NORMAL)
    assert [mesh["unknowns"] for mesh in same] == [mesh["unknowns"] for mesh in meshes]
    assert meshes[-1]["bar"] <= 0.03 * meshes[-1]["value"] < meshes[-2]["bar"]
    assert all(f"{mesh['unknowns']:>10}  " in done.stdout for mesh in meshes)
    with pytest.raises(InputError, match=r"method\.target of the scene does not name it"):
        answer.meshes(ALONG)
    missed = call(
        "converge", str(scene), "--of", PEAK, "--output", str(tmp_path / "missed"), "--no-figures"
    )
    assert missed.code == 3 and (tmp_path / "missed" / "converge.json").exists()
    assert call("converge", str(scene), "--of", NORMAL, "--within", "2").code == 2
    with pytest.raises(InputError, match="there is no result"):
        ddmpi.converge(str(scene), of=[NORMAL])


@pytest.mark.slow
def test_files_become_finer_for_results():
    """A number of halvings that the scene names stays, and a target in the energy norm alone asks for leave."""
    of = "contacts.punch-base.normal_force"
    answer = ddmpi.converge("configs/punch.toml", of=of, within=0.01)
    assert answer.certified and len(answer.meshes(of)) > 1
    both = [f"body.{k}.mesh.refine" for k in (0, 1)]
    fixed = ddmpi.converge("configs/punch.toml", of, 0.01, overrides=dict.fromkeys(both, 0))
    assert len(fixed.meshes(of)) == 1
    assert (
        'of punch and of base is given: allow finer ones by mesh.refine = "as needed"'
        in fixed.reason
    )
    assert f"{of}: {with_bar(fixed.summary, of).split(' N')[0]}, at most" in fixed.reason
    energy = read_scene_file("configs/punch.toml", ["method.target_error=0.01"])
    assert not any(body.mesh.refinable for body in energy.body)


def test_the_picture_of_many_results_has_those_with_targets(tmp_path):
    """Of all main results those with the largest bars over their values, each with a colour of its own."""
    across = "contacts.upper-lower.force.y"
    scene = aiming({NORMAL: 0.5, across.replace("y", "1"): 0.5})
    scene["output"] = {"errors": "main"}
    path, out = write_scene(scene, tmp_path / "scene.toml"), tmp_path / "out"
    assert call("run", str(path), "--output", str(out), "--no-figures").code == 0
    lines = draw_levels(read_results(out)).axes[0].get_lines()
    labels = {line.get_label(): line.get_color() for line in lines if line.get_label()[0] != "_"}
    assert {"energy norm", NORMAL, across} < {*labels}
    assert len({to_rgb(colour) for colour in labels.values()}) == len(labels) > 5


# The ladder


def test_the_order_and_the_tolerance_follow_targets():
    """As with a target of the energy norm: a named order and tolerance win, then those of the preset."""

    def settled(*settings: str):
        return ladder_of({NORMAL: 0.02, ALONG: {"within": 3.0}}, None, *settings).scene

    assert settled().body[0].mesh.order == 2 and settled().method.tolerance == pytest.approx(2e-4)
    assert "beside method.target;" in settled().aimed
    assert settled("body.upper.mesh.order=1").body[1].mesh.order == 1
    assert settled("method.preset=fast").body[0].mesh.order == 1
    assert settled("method.preset=balanced").method.tolerance == 1e-6
    assert ladder_of({ALONG: {"within": 3.0}}).scene.method.tolerance == 1e-8


def test_squared_errors_are_summed_over_what_is_allowed():
    """Each target counts as much as it misses, wherever its cells are; no cell asks for less than a part of the mean."""
    parts = {"a": {"x": np.array([3.0, 1.0])}, "b": {"x": np.array([0.0, 5e3])}}
    sums, misses = {"a": 4.0, "b": 5e3}, {"a": Miss(2.0, 1.0), "b": Miss(3.0, 1.0)}
    found = weighted(parts, sums, misses, 2)["x"]
    assert found / found[0] == pytest.approx([1.0, (1.0 + 9.0) / 3.0])
    least = weighted({"b": parts["b"]}, sums, {"b": misses["b"]}, 2)["x"]
    assert least[0] / least[1] == pytest.approx(0.5 * LADDER["least"])
    energy = {"": {"x": np.array([0.0, 0.3])}}
    alone = weighted(energy, {"": 0.3}, {"": Miss(0.7, 0.3)}, 2)
    assert alone["x"].tolist() == [0.0, 0.3]


def test_the_root_of_a_bar_is_an_error():
    """Over what is allowed; a peak that is not resolved errs by how far it differs from its neighbours."""
    ladder = ladder_of({NORMAL: 0.01, ALONG: {"within": 4.0}})
    bars = {NORMAL: Bar(-100.0, 9.0, "", 9.0), ALONG: Bar(5.0, 1.0, "", 1.0)}
    found = ladder.misses(Level(1, 1, 0.1, 1, bars))
    assert found[NORMAL].over == pytest.approx(3.0) and found[ALONG].over == pytest.approx(0.5)
    assert found[""] == Miss(0.1, LARGEST)  # above there are no bars
    assert allowed(ladder.targets[NORMAL], -100.0) == 1.0
    peak = bars | {ALONG: Bar(5.0, None, UNRESOLVED, 1.0, 2.5)}
    assert ladder.misses(Level(1, 1, 0.1, 1, peak))[ALONG].over == pytest.approx(2.5)
    alone = bars | {ALONG: Bar(5.0, None, UNRESOLVED, 1.0, np.inf)}
    assert ladder.misses(Level(1, 1, 0.1, 1, alone))[ALONG].over == pytest.approx(
        LADDER["unresolved"]
    )
    linear = ladder_of({ALONG: 0.1}, None, "body.upper.mesh.order=1").misses(
        Level(1, 1, 0.1, 1, peak)
    )
    assert linear[ALONG].over == pytest.approx(2.5**0.5)


def test_a_ladder_goes_on_while_there_are_words():
    """Where the mesh is too coarse, the error in the energy norm decides."""
    ladder = ladder_of({NORMAL: 0.5})
    coarse = {NORMAL: Bar(100.0, None, COARSE, 1.0)}
    assert ladder.proceed(Level(1, 500, 0.5, 550, coarse)) == 3
    assert ladder.proceed(Level(1, 4500, 0.24, 4900, {NORMAL: Bar(100.0, 30.0, "", 30.0)})) is None
    assert not ladder.missed


@pytest.mark.parametrize(("excess", "ends"), [((4.0, 4.2, 4.4), True), ((4.0, 4.2, 2.9), False)])
def test_a_peak_that_finer_meshes_leave_as_it_is_ends_the_ladder(excess, ends):
    """Smooth peaks come nearer to their neighbours."""
    ladder = ladder_of({PRESSURE: 0.01})
    for k, one in enumerate(excess, 1):
        assert not ladder.missed
        ladder.proceed(
            Level(
                1, 500 * k * k, 0.1, 550 * k * k, {PRESSURE: Bar(9.0, None, UNRESOLVED, 1.0, one)}
            )
        )
    assert ("do not bring it nearer to its neighbours" in ladder.missed) == ends


@pytest.mark.parametrize("meshes", [LADDER["meshes"], LADDER["meshes"] - 1])
def test_a_ladder_of_drawings_has_an_end(meshes):
    """After so many meshes it is said that they did not reach it, and before the reason is another one."""
    ladder = ladder_of({PIN[0]: 1e-5}, pin_in_lug(), "method.max_unknowns=6000")
    ladder.levels = [
        Level(1.0, 4900 + k, 0.1, 5000, {PIN[0]: Bar(1e3, 9.0, "", 9.0)}, Cost(1.0, 0, 1.0, 0))
        for k in range(meshes - 1)
    ]
    equal = {PIN[0]: demand(np.ones(1000), 2.0, 2)}
    bars = {PIN[0]: Bar(1e3, 8.9, "", 8.9)}
    ladder.proceed(Level(1, 5000, 0.1, 5000, bars), {"pin": equal[PIN[0]]}, equal)
    assert (f"{meshes} meshes did not reach it" in ladder.missed) == (meshes == LADDER["meshes"])
    assert ladder.missed


def test_the_bars_of_a_ladder_are_kept():
    ladder = ladder_of({NORMAL: 0.01})
    cost = Cost(2.0, 1.0, 3e8, 1e8)
    ladder.proceed(Level(1, 500, 0.1, 550, {NORMAL: Bar(100.0, 9.0, "", 9.0)}, cost))
    again = ladder_of({NORMAL: 0.01})
    again.restore(json.loads(json.dumps(ladder.state())))
    assert again.levels == ladder.levels and again.refinement == ladder.refinement > 1
    told = again.levels[0].told()
    assert told["results"] == {NORMAL: {"value": 100.0, "bar": 9.0, "word": ""}}
    assert (told["seconds"], told["bytes"]) == (2.0, 3e8)


def test_a_checkpoint_gives_a_ladder_back(tmp_path):
    """A run without one takes the rest of the state."""
    ladder, identity = ladder_of({NORMAL: 0.01}), {"versions": {}}
    ladder.proceed(Level(1, 500, 0.1, 550, {NORMAL: Bar(100.0, 9.0, "", 9.0)}))
    state = {"ladder": ladder.state(), "goal": 3.0}
    checkpoint.write(tmp_path / CHECKPOINT, identity, [state])
    for again in (ladder_of({NORMAL: 0.01}), None):
        given = checkpoint.continue_from(MPI.COMM_SELF, str(tmp_path), identity, again)
        assert given["goal"] == 3.0
        assert again is None or again.levels == ladder.levels


def test_a_step_to_meshes_made_for_results_says_nothing_of_their_rate():
    """Two meshes that are made for them do."""
    ladder = ladder_of({PIN[0]: 1e-3}, pin_in_lug())

    def bar(size: float) -> dict:
        return {PIN[0]: Bar(1000.0, size, "", size)}

    assert ladder.rate(Level(1, 1, 0.1, 1, bar(30.0))) == 2.0
    ladder.proceed(Level(1, 5000, 0.1, 5100, bar(30.0)))
    assert ladder.rate(Level(1, 1, 0.1, 1, bar(20.0))) == 2.0
    ladder.missed = ""
    ladder.levels.append(ladder.levels[0]._replace(results=bar(20.0)))
    assert ladder.rate(Level(1, 1, 0.1, 1, bar(15.0))) < 1.0


GROWTH, FAR, GOOD = (
    LADDER["growth"],
    [Level(1, 900, 0.5, 1000)],
    [Level(1, 1000, 0.8, 1000), Level(2, 4000, 0.4, 4000)],
)


@pytest.mark.parametrize(
    ("levels", "goal", "most", "doubling", "dimension", "least", "largest"),
    [
        # finer in any case, but not by more than the greatest step and the most unknowns allow
        (FAR, 1e-4, 10**9, False, 2, GROWTH, GROWTH),
        (FAR, 0.4999, 10**9, False, 2, 2, 2),
        (FAR, 1e-4, 9500, False, 2, 3, 3),
        (FAR, 1e-4, 9500, True, 2, 2, 2),
        (FAR, 1e-4, 3999, True, 2, None, None),
        ([Level(2, 1000, 0.5, 1000)], 0.35, 10**9, True, 2, 4, 4),
        (
            [Level(1, 1000, 0.4, 1000), Level(2, 4000, 0.5, 4000)],
            0.3,
            10**9,
            False,
            2,
            3,
            2 * GROWTH,
        ),  # no rate to be seen
        # what takes more than the greatest step is done in two, not in one that hardly misses and one that does all again
        (GOOD, 0.08, 10**9, False, 2, 4, 5),
        ([*GOOD, Level(5, 25_000, 0.16, 25_000)], 0.08, 10**9, False, 2, 10, 11),
        # where even the largest meshes would miss the target by far, the last steps are spared
        (GOOD, 0.15, 36_000, False, 2, 6, 6),
        (GOOD, 0.15, 30_000, False, 2, 5, 5),
        (GOOD, 0.15, 16_000, False, 2, None, None),
        # the rate of coarse meshes is not that of finer ones (blocks of 3 × 1 elements: 0.009 took 240,000 unknowns)
        (
            [Level(1, 72, 0.156, 100), Level(4, 864, 0.0805, 1000)],
            0.009,
            3_000_000,
            False,
            2,
            16,
            16,
        ),
        # unknowns of solids are those of the refinement cubed
        (FAR, 1e-4, 27_500, False, 3, 3, 3),
        (FAR, 1e-4, 26_500, False, 3, 2, 2),
        (FAR, 1e-4, 7_900, False, 3, None, None),
    ],
)
def test_limits_of_refinement(levels, goal, most, doubling, dimension, least, largest):
    found = next_refinement(levels, goal, most, doubling=doubling, dimension=dimension)
    assert found is None if least is None else least <= found <= largest


def test_cells_are_made_smaller_whatever_the_sign_of_their_errors():
    """Contributions of cells to the error of a result have signs, and add up; sizes follow from how large they are."""

    def squares(signs: list[float]) -> np.ndarray:
        cells = {"b": np.array([4.0, 1.0, 0.0]) * signs}
        solved = SimpleNamespace(
            error=SimpleNamespace(estimates={"b": SimpleNamespace(squares=np.ones(3))}),
            errors={"bodies.b.energy": SimpleNamespace(cells=cells)},
            assembly=SimpleNamespace(world=MPI.COMM_SELF),
        )
        return _squares(solved, {"bodies.b.energy": Miss(0.2, 0.1)})["b"]

    expected = squares([1.0, 1.0, 1.0])
    assert expected[:2] == pytest.approx([4.0, 1.0]) and 0.0 <= expected[2] < 1.0
    for signs in ([-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, 1.0]):
        assert squares(signs) == pytest.approx(expected)
