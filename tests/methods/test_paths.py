"""The paths to where Newton's method converges: their energy, their ends, and the scenes that need them."""

from collections.abc import Iterator
from pathlib import Path

import assembly_scenes
import numpy as np
import pytest
import scenes
import solid_scenes
from hard_scenes import HARD, arch, falling_disc, pad, spanner, turned
from mpi4py import MPI
from test_steps import random_joint

import ddmpi
from ddmpi.coupling.assembly import prepare
from ddmpi.coupling.joint import Point
from ddmpi.methods import newton
from ddmpi.methods.krylov import Regularisation
from ddmpi.methods.paths import InteriorPoints, Softening, Station
from ddmpi.run.solve import solve
from ddmpi.scene.reader import read_scene

CONFIGS, PAD = scenes.ROOT / "configs", HARD / "pad.toml"


def energy(path: Softening, point: Point) -> float:
    """½ sᵀCs of the bodies and what the layer stores, of a joint that clamps hold, with the slip bound zero."""
    q = path._pressed(point, path._delta)
    layer = path._delta / path._c
    m = len(q) // 2
    return (
        0.5 * point.s @ (point.r + path._joint.d)
        + 0.5 * (layer[:m] * np.maximum(q[:m], 0.0) ** 2).sum()
    )


@pytest.mark.parametrize("delta", [10.0, 0.1])
def test_the_slope_along_a_step_is_that_of_the_energy(delta):
    """Differences of the energy of bodies and layer, without friction, give the same."""
    joint = random_joint(3, coefficient=0.0)
    path, rng = (
        Softening(joint, np.full(joint.size, 0.5), np.zeros(joint.size)),
        np.random.default_rng(1),
    )
    path._delta = delta
    s, ds = rng.standard_normal((2, joint.size))
    path.point = Point(s, joint.C @ s - joint.d, joint.e, joint.e)
    change = Point(ds, joint.C @ ds, joint.e, joint.e)
    t, h = np.array([0.0, 0.3, 1.0]), 1e-5
    slopes = path._slopes(change, t, None)
    before, after = (
        [energy(path, path.point.along(change, x + step)) for x in t] for step in (-h, h)
    )
    assert slopes == pytest.approx((np.array(after) - before) / (2 * h), rel=1e-5)


def test_a_step_ends_where_the_energy_is_least():
    """The full step where the energy still falls there or hardly rises; none where it does not fall at the start."""
    joint = random_joint(5, coefficient=0.0)
    path, rng = (
        Softening(joint, np.full(joint.size, 0.5), np.zeros(joint.size)),
        np.random.default_rng(2),
    )
    s = rng.standard_normal(joint.size)
    path.point = Point(s, joint.C @ s - joint.d, joint.e, joint.e)
    path._delta, found = 1.0, []
    for far in (1e-6, 1e-3, 1.0, 1e2, 1e5):
        ds = far * rng.standard_normal(joint.size)
        change = Point(ds, joint.C @ ds, joint.e, joint.e)
        start, end = path._slopes(change, np.array([0.0, 1.0]), None)
        length = path._length(change, None)
        if start >= 0.0:
            assert length == 0.0
            back = Point(*(-each for each in change))
            change, start, end = back, *path._slopes(back, np.array([0.0, 1.0]), None)
            length = path._length(back, None)
        assert (length == 1.0) == (end <= 0.5 * -start)
        if length < 1.0:
            (there,) = path._slopes(change, np.array([length]), None)
            assert abs(there) <= 0.1 * -start
        found.append(length)
    assert min(found) < 1e-2 and max(found) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "steps", "products"),
    [
        (arch(8, 8, 5e-3), 30, 300),
        (pad((154.32572695438697, 89.1)), 40, np.inf),
        (falling_disc(1e-2), 30, np.inf),
        (spanner(1e-3), 30, np.inf),
    ],
    ids=["arch", "pad", "disc", "spanner"],
)
def test_hard_scenes_take_few_steps(scene, steps, products):
    """Hinges, soft springs, a fall across a clearance, a slack spanner: products are those of a body."""
    summary = scenes.certified(scene).summary
    made = sum(body["n_A_by_purpose"]["newton"] for body in summary["bodies"].values()) / len(
        summary["bodies"]
    )
    assert summary["outer_iterations"] <= steps and made <= products


@pytest.mark.slow
def test_interior_points_that_jam_are_given_up_soon():
    """A row whose steps get shorter and shorter, or stay short: 79 steps where they are not given up."""
    assert scenes.certified(assembly_scenes.random_scene(523)).summary["outer_iterations"] <= 40


def lid_on_bent_plate(load: float) -> dict:
    """A plate that a bolt bends by 6 kN over a foot; then a lid that lay on it without a load carries one (N)."""

    def box(name, origin, size, divisions, **keys):
        mesh = {"shape": "box", "origin": origin, "size": size, "divisions": divisions}
        return {"name": name, "mesh": mesh, "material": scenes.STEEL, **keys}

    down = {"on": "top", "force": [0.0, 0.0, -load], "history": "work"}
    pull = {"force": 6000.0, "along": [0, 0, 1], "history": "tighten"}
    rubs, later = {"law": "coulomb", "coefficient": 0.15}, {"times": [1, 2], "factors": [0, 1]}
    return {
        "body": [
            box("plate", [0, 0, 0], [0.12, 0.1, 0.01], [12, 10, 1], clamp=["left", "right"]),
            box("tie", [0.05, 0.04, -0.03], [0.02, 0.02, 0.03], [2, 2, 3], clamp=["bottom"]),
            box("foot", [0.015, 0.02, -0.02], [0.02, 0.05, 0.02], [2, 4, 2], clamp=["bottom"]),
            box("lid", [0.023, 0.017, 0.01], [0.07, 0.06, 0.01], [9, 8, 1], traction=[down]),
        ],
        "contact": [
            {
                "name": "thread",
                "bodies": ["tie", "plate"],
                "on": ["top", "bottom"],
                "kind": "bonded",
            }
            | {"pretension": pull},
            {"bodies": ["plate", "foot"], "on": ["bottom", "top"], "friction": rubs},
            {"name": "side", "bodies": ["lid", "plate"], "on": ["bottom", "top"], "friction": rubs},
        ],
        "history": {"tighten": {"times": [0, 1], "factors": [0, 1]}, "work": later},
        "time": {"points": [1.0, 2.0], "steps": 1},
    }


@pytest.mark.slow
def test_a_small_load_beside_large_forces_is_carried():
    """10 N on a few of the lid's nodes, beside 6 kN of a bolt that keeps its offset: it was "no equilibrium found", as
    interior points began with 10 N."""
    load = 10.0
    summary = scenes.certified(lid_on_bent_plate(load)).summary
    side, steps = summary["contacts"]["side"], [step["time"] for step in summary["steps"]]
    assert steps == [1.0, 2.0]
    assert summary["outer_iterations"] <= 90
    assert side["force"] == pytest.approx([0.0, 0.0, load], abs=1e-6 * load)
    middle = 0.023 + 0.07 / 2, 0.017 + 0.06 / 2  # of the lid, on which the load acts
    assert side["moment"] == pytest.approx(
        [load * middle[1], -load * middle[0], 0.0], abs=1e-6 * load
    )


@pytest.mark.slow
def test_a_body_that_lay_without_a_load_begins_on_the_nodes_that_touch():
    """Where the first step took all of its nodes as open, springs alone held it: a residual of 1e5."""
    scene = read_scene("lid", lid_on_bent_plate(2000.0), [])
    assembly = prepare(MPI.COMM_SELF, scene)
    outer = newton.Newton(assembly.joint, 50)
    ends = []
    for time in (1.0, 2.0):
        before = assembly.joint.d
        assembly.joint.keep(["thread"] if ends else [], outer.motions)
        assembly.act(time)
        if ends:
            outer.begin((outer.forces, outer.gaps - (assembly.joint.d - before), outer.motions))
        else:
            outer.begin()
        ends.append(outer.run(1e-8))
    assert ends == ["converged", "converged"]
    assert outer.history[0].residual < 1.0


@pytest.mark.slow
def test_stacks_where_bodies_slide_take_few_steps():
    """Softening alone gets nowhere there, and took over 40 steps."""
    assert scenes.certified(assembly_scenes.random_scene(897)).summary["outer_iterations"] <= 30


@pytest.mark.slow
def test_given_slip_bounds_need_no_path():
    """The lower one of the pinched blocks alone is loaded: 14 steps where the first ones were shortened."""
    friction = {"contact.0.friction": {"law": "tresca", "slip_bound": 1.2e7}}
    lift = {
        "body.upper.traction": [],
        "body.lower.traction": [{"on": "bottom", "value": [0.0, 4e7]}],
    }
    scene = (CONFIGS / "pinched_blocks.toml").read_text(encoding="utf-8")
    answer = ddmpi.solve(scene, MPI.COMM_SELF, friction | lift)
    assert answer.certified and answer.summary["outer_iterations"] <= 8


@pytest.mark.slow
@pytest.mark.parametrize("coefficient", [0.104, 0.2])
def test_a_body_that_slides_off_is_named_where_interior_points_fail_too(coefficient):
    """Friction that the convex program believes in and elastic bodies do not find: b02 slides along -x."""
    answer = ddmpi.solve(
        str(Path(__file__).with_name("drift.toml")),
        MPI.COMM_SELF,
        {"contact.c1.friction.coefficient": coefficient},
    )
    assert "no equilibrium found: b02 would move along -x" in answer.reason
    assert answer.summary["outer_iterations"] <= 60


@pytest.mark.slow
@pytest.mark.mpi(ranks=[2, 3])
def test_ranks_of_unequal_unknowns_end_alike(comm):
    """The scene that kept two ranks waiting for each other for ever; the same answer on any number of ranks."""
    answer = ddmpi.solve(PAD, comm)
    assert answer.certified and answer.summary["outer_iterations"] <= 40
    assert answer.summary["contacts"]["c"]["force"] == pytest.approx([-7732.0, 9391.6], rel=1e-4)


def slot(contrast: float) -> dict:
    """A block and one of another modulus on it, tilted a little, in a frictionless slot a millimetre too wide."""

    def block(name, corners, divisions, modulus, aside):
        return {
            "name": name,
            "mesh": {
                "shape": "quadrilateral",
                "corners": turned(corners, aside / 2e4),
                "divisions": divisions,
            },
            "material": {"young": modulus, "poisson": 0.2},
            "volume_force": [aside, -2e4],
        }

    lower = block("lower", [[0.0, 0.01], [1.0, 0.01], [1.0, 0.51], [0.0, 0.51]], [10, 5], 2e10, 3e3)
    upper = block(
        "upper",
        [[0.05, 0.52], [0.95, 0.52], [0.95, 1.02], [0.05, 1.02]],
        [7, 4],
        2e10 * contrast,
        -3e3,
    )
    walls = [
        {"name": name, "shape": "plane", "point": point, "normal": normal}
        for name, point, normal in (
            ("left", [-1e-3, 0.0], [1.0, 0.0]),
            ("right", [1.001, 0.0], [-1.0, 0.0]),
        )
    ]
    sides = [(body, wall, [wall]) for body in ("lower", "upper") for wall in ("left", "right")]
    sides += [("lower", "floor", ["bottom"]), ("upper", "lower", ["bottom", "top"])]
    return {
        "body": [lower, upper],
        "rigid": [scenes.FLOOR, *walls],
        "contact": [{"bodies": [body, other], "on": on} for body, other, on in sides],
    }


@pytest.mark.slow
@pytest.mark.parametrize("contrast", [1e-2, 1e4])
def test_stiff_bodies_cross_clearances_without_friction(contrast):
    """Bodies move a thousand times farther than they give way; without friction there is always an answer."""
    assert scenes.certified(slot(contrast)).summary["outer_iterations"] <= 60


def squeezed(friction: float) -> dict:
    """A block of weight between two walls, longer by 10 µm on either side than they are apart."""
    block = scenes.rectangle(
        "block", (0, 0), (1, 0.5), (10, 5), young=2e10, poisson=0.2, volume_force=[0.0, -2e4]
    )
    walls = [
        {"name": name, "shape": "plane", "point": [x, 0.0], "normal": [1.0 - 2.0 * x, 0.0]}
        for name, x in (("left", 0.0), ("right", 1.0))
    ]
    return {
        "body": [block],
        "rigid": walls,
        "contact": [
            {
                "bodies": ["block", wall],
                "on": [wall],
                "gap": -1e-5,
                "friction": {"law": "coulomb", "coefficient": friction},
            }
            for wall in ("left", "right")
        ],
    }


@pytest.mark.parametrize("friction", [0.025, scenes.seldom(0.05)])
def test_a_squeezed_block_that_friction_holds_is_not_condemned(friction):
    """The least friction that holds it is about 0.0241; the convex program, which may squeeze harder, needs less."""
    assert scenes.certified(squeezed(friction)).summary["outer_iterations"] <= 40


@pytest.mark.slow
@pytest.mark.parametrize("excess", [1.05, 2.0])
def test_a_squeezed_block_past_its_limit_is_named_in_few_steps(excess):
    answer = ddmpi.solve(squeezed(0.0241 / excess), MPI.COMM_SELF)
    assert "no equilibrium found: block would move along -y" in answer.reason
    assert answer.summary["outer_iterations"] <= 60


def plug(
    walls: int, taper: float, friction: float, divisions: int, push: list[float], fall: float
) -> dict:
    """A plug that falls into a wedge of two rigid walls, or between four, and is pushed along them."""
    sides = [("left", (-1, 0)), ("right", (1, 0)), ("front", (0, -1)), ("back", (0, 1))][:walls]
    widths = [(0.3 + taper * z, 0.3 + taper * z if walls > 2 else 0.5, z) for z in (0.0, 0.6)]
    body = {
        "name": "plug",
        "material": {"young": 1e9, "poisson": 0.25},
        "traction": [{"on": "top", "value": push}],
        "mesh": {
            "shape": "hexahedron",
            "divisions": 3 * [divisions],
            "corners": [
                [x * a, y * b, z]
                for a, b, z in widths
                for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
            ],
        },
    }
    return {
        "body": [body],
        "rigid": [
            {
                "name": f"at_{side}",
                "shape": "plane",
                "point": [0.3 * x, 0.3 * y, -fall],
                "normal": [-x, -y, taper],
            }
            for side, (x, y) in sides
        ],
        "contact": [
            {
                "bodies": ["plug", f"at_{side}"],
                "on": [side],
                "friction": {"law": "coulomb", "coefficient": friction},
            }
            for side, _ in sides
        ],
    }


@pytest.mark.slow
@pytest.mark.parametrize("fall", [1e-3, 1e-2])
def test_a_plug_falls_far_beyond_elastic_displacements(fall):
    """Where a stage of softening leaves all nodes open, the body falls on, until there is something that stops it."""
    assert (
        scenes.certified(plug(2, 0.4, 1.0, 2, [150.0, 200.0, -1e3], fall)).summary[
            "outer_iterations"
        ]
        <= 35
    )


@pytest.mark.slow
def test_a_plug_that_turns_between_four_walls_comes_to_rest():
    """Friction of 1.9 on four walls, all of it on discs: interior points with squares ended elsewhere."""
    scene = plug(4, 0.474, 1.9131, 4, [996.0, -923.0, -2707.0], 0.01)
    assert scenes.certified(scene).summary["outer_iterations"] <= 100


def box_in_a_bore(divisions, radius, center, friction, push):
    """A box falls into a bore of the x axis, far beyond what it gives way."""
    return {
        "body": [
            solid_scenes.box(
                "box",
                (-0.5, -0.5, -0.5),
                (1, 1, 0.5),
                divisions,
                young=1e9,
                poisson=0.083,
                traction=[{"on": "top", "value": push}],
            )
        ],
        "rigid": [
            {
                "name": "bore",
                "shape": "cylinder",
                "inside": True,
                "point": center,
                "axis": [1.0, 0.0, 0.0],
                "radius": radius,
            }
        ],
        "contact": [
            {
                "bodies": ["box", "bore"],
                "on": ["bottom"],
                "friction": {"law": "coulomb", "coefficient": friction},
            }
        ],
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        box_in_a_bore(
            [4, 3, 2], 2.1270086681, [0.0, 0.0, 1.4674055902], 1.0104991663, [0.0, 0.0, -481657.8]
        ),
        box_in_a_bore(
            [4, 2, 1],
            2.6627393074,
            [0.0, 0.0244531, 2.0153738966],
            1.156323,
            [-3978.1, -5177.9, -47107.5],
        ),
    ],
)
def test_a_box_in_a_bore_comes_to_rest(scene):
    """All nodes slide round about."""
    assert scenes.certified(scene).summary["outer_iterations"] <= 100


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene", [scenes.pinched_blocks(6), solid_scenes.two_boxes(2)], ids=["plane", "space"]
)
def test_interior_points_close_an_interference_without_loads(scene, monkeypatch):
    """Their first forces are those that close it; without any they would give up at once."""
    scene["body"] = [
        {key: value for key, value in body.items() if key != "traction"} for body in scene["body"]
    ]
    scene["contact"][0]["gap"] = -1e-3
    usual, _ = force(scene)
    monkeypatch.setattr(newton, "PATHS", (InteriorPoints,))
    monkeypatch.setattr(newton, "PATIENCE", 0)
    found, stages = force(scene)
    assert stages and found == pytest.approx(usual, rel=1e-6)


def force(scene: dict) -> tuple[list[float], list[str]]:
    """Of the only contact of a certified answer, with the stages of paths that led there."""
    answer = scenes.certified(scene)
    (contact,) = answer.summary["contacts"].values()
    return contact["force"], [
        step.stage for step in answer.solved.solution.outer.history if step.stage
    ]


class Stuck:
    """A path that ends in the air, `way` up from where the bodies have been."""

    by, way = Regularisation(precise=True), 0.0

    def __init__(self, joint, c, before) -> None:
        s, alpha = np.zeros(joint.size), np.zeros(joint.rigid.size)
        alpha[1] = self.way
        self.point = Point(
            s, -joint.d - joint.rigid.spread(alpha), alpha, joint.imbalance(s, alpha)
        )

    def points(self, solve) -> Iterator[Station]:
        yield Station(self.point, "stuck", 0.0)


@pytest.mark.parametrize("way, ending", [(-1e-3, "stalled"), (1e-3, "drift")])
def test_bodies_on_their_way_to_a_contact_do_not_drift(way, ending, monkeypatch):
    """Where a path fails in the air: below a body that falls there is still a contact; above one that rises is none."""
    disc = falling_disc(1e-2)
    disc["body"][0]["mesh"]["angles"] = [-170.0, -10.0]  # the lower half
    disc["rigid"][0]["center"][1] = -2e-2
    joint = prepare(MPI.COMM_SELF, read_scene("scene", disc, [])).joint
    monkeypatch.setattr(newton, "PATHS", (Stuck,))
    monkeypatch.setattr(newton, "PATIENCE", 0)
    monkeypatch.setattr(Stuck, "way", way)
    assert newton.Newton(joint, 100).run(1e-8) == ending


@pytest.mark.slow
def test_small_forces_of_stiff_bodies_hold_them():
    """Beside forces that would close all gaps these are nothing, and yet no body is moved off its contacts."""
    assembly = scenes.prepare_scene(MPI.COMM_SELF, slot(1e4))
    solution = solve(assembly, assembly.scene.method)
    outer, alpha = solution.outer, solution.outer.motions
    assert outer.negligible(1e-9, 1e-8) < 1e-2 * outer.forces[outer.forces > 0.0].min()
    way = np.zeros(len(alpha))
    way[assembly.joint.slices["upper"]] = 1e-4
    outer.shift(way, 1e-8)
    assert np.array_equal(outer.motions, alpha)
