"""Frames that forces decide: loose bodies that roll, hinges, axles, dead loads on bodies that turn, no stability."""

import logging
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from restarts import go_on_from_checkpoints
from scenes import COULOMB, FLOOR, assert_refused, call, certified, rectangle, seldom, write_scene
from test_far import changed, forces, history

import ddmpi
from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.coupling.coarse import Driven
from ddmpi.run import steps
from ddmpi.run.gather import _write_tables
from ddmpi.run.passes import Group
from ddmpi.run.places import FarMarch
from ddmpi.scene.motions import Motion
from ddmpi.system.numbers import Frame

SOFT = {"young": 1000.0, "poisson": 0.3}
WEIGHT = 8.0


def ring(
    name: str,
    center: tuple[float, float],
    radii: tuple[float, float],
    divisions: tuple[int, int],
    order: int = 1,
    **more,
) -> dict:
    return {
        "name": name,
        "mesh": {
            "shape": "annulus",
            "center": list(center),
            "radii": list(radii),
            "angles": [0, 360],
            "divisions": list(divisions),
            "order": order,
        },
        "material": SOFT,
    } | more


def rolling(turn: float = 15.0, order: int = 1, steps: int = 5, coarse: int = 1) -> dict:
    """A loose disc that falls onto the bottom of a bore by its weight; then the bore turns."""
    area, less = np.pi * (1.0 - 0.25**2), order * coarse
    return {
        "time": {"points": [1.0, 2.0], "steps": steps, "motions": "far"},
        "history": {"turn": history(1.0, 2.0)},
        "body": [
            ring(
                "disc",
                (0.0, -0.45),
                (0.25, 1.0),
                (120 // less, 10 // coarse),
                order,
                volume_force=[0.0, -WEIGHT / area],
            ),
            ring(
                "bore",
                (0.0, 0.0),
                (1.5, 2.2),
                (175 // less, 6 // coarse),
                order,
                clamp=["outer"],
                motion={"turn": turn, "history": "turn"},
            ),
        ],
        "contact": [
            {
                "bodies": ["disc", "bore"],
                "on": ["outer", "inner"],
                "slave": "disc",
                "friction": COULOMB,
            }
        ],
    }


def lever(moment: float = -3.0, friction: dict = COULOMB) -> dict:
    """A ring on an arm that turns about a hinge, by a moment, onto a block."""
    return {
        "time": {"points": [1.0], "steps": 2, "motions": "far"},
        "history": {"press": history(0.0, 1.0)},
        "body": [
            ring(
                "ring",
                (2.0, 0.0),
                (0.25, 0.5),
                (60, 4),
                clamp=["inner"],
                motion={
                    "free": ["turn"],
                    "pivot": [0.0, 0.1],
                    "moment": moment,
                    "history": "press",
                },
            ),
            rectangle("block", (-1, -1.5), (5, 1), (61, 3), young=1000.0, clamp=["bottom"]),
        ],
        "contact": [{"bodies": ["ring", "block"], "on": ["outer", "top"], "friction": friction}],
    }


def axle(
    turn: float = -40.0,
    force: tuple[float, float] = (-0.5, -8.0),
    rigid: bool = False,
    steps: int = 4,
    coarse: int = 1,
) -> dict:
    """A wheel, elastic or rigid, on a plate: its turn is prescribed, forces decide where its axle goes."""
    motion = [
        {"turn": turn, "pivot": [0.0, 1.0], "history": "roll"},
        {"free": ["x", "y"], "force": list(force), "history": "load"},
    ]
    divisions, rows = (120 // coarse, 6 // coarse), (120 // coarse + 1, 10 // coarse)
    wheel = ring("wheel", (0.0, 1.0), (0.4, 1.0), divisions, clamp=["inner"], motion=motion)
    made = {
        "time": {"points": [1.0, 2.0], "steps": steps, "motions": "far"},
        "history": {"load": history(0.0, 1.0), "roll": history(1.0, 2.0)},
        "body": [
            rectangle("plate", (-1, -1), (3, 1), rows, young=1000.0, clamp=["bottom"]),
            wheel,
        ],
        "contact": [
            {
                "bodies": ["plate", "wheel"],
                "on": ["top", "outer"],
                "slave": "plate",
                "friction": COULOMB,
            }
        ],
    }
    if rigid:
        made["body"].pop()
        made["rigid"] = [
            {
                "name": "wheel",
                "shape": "circle",
                "center": [0.0, 1.0],
                "radius": 1.0,
                "motion": motion,
            }
        ]
        made["contact"][0]["on"] = ["top"]
        made["contact"][0].pop("slave")
    return made


def gone(answer, name: str) -> np.ndarray:
    """How far a free frame has gone at the ends of all steps."""
    places = answer.solved.steps.places
    return np.array([places[step["time"]].freed[name] for step in answer.summary["steps"]])


@pytest.mark.slow
@pytest.mark.parametrize(("order", "coarse"), [(1, 3), (2, 1)])
def test_a_loose_disc_rolls_in_a_bore_that_turns(order, coarse):
    """At the bottom N is its weight and T nothing; its turn is that of the bore times the ratio of radii."""
    answer = certified(rolling(order=order, steps=3, coarse=coarse))
    T, N = forces(answer).T
    weight = -answer.summary["bodies"]["disc"]["loads"]["volume_force"]["force"][1]
    assert weight == pytest.approx(WEIGHT, rel=5e-3)
    assert pytest.approx(np.full(len(N), weight), rel=1e-9) == N and np.abs(T).max() < 1e-8 * weight
    turned = np.radians(np.diff(gone(answer, "disc")[2:, 2]))
    assert turned == pytest.approx(np.full(3, np.radians(5.0) * 1.5), rel=0.02)
    frame = answer.solved.assembly.frames["disc"]
    x, y = frame.at(np.array([0.0, -0.45]))
    assert abs(x) < 5e-3 and -0.53 < y < -0.5
    assert (
        answer.summary["energy"]["dissipated"] < 5e-3 * weight * np.radians(15.0) * 1.5
    )  # sliding that far takes 0.3
    assert not [words for words in answer.summary["warnings"] if "not stable" in words]


@pytest.mark.parametrize("friction", [seldom({"law": "none"}), COULOMB])
def test_a_hinge_balances_its_moment(friction):
    """The contact's moment about the hinge is the given one, also with friction; the arm turns until then."""
    answer = certified(lever(friction=friction))
    for step in answer.summary["steps"]:
        contact = step["contacts"]["ring-block"]
        about = contact["moment"] - np.cross([0.0, 0.1], contact["force"])
        assert about == pytest.approx(3.0 * step["time"], rel=1e-9)
    assert (np.diff(gone(answer, "ring")[:, 2]) < 0.0).all() and not gone(answer, "ring")[
        :, :2
    ].any()
    assert answer.summary["certificate"]["equilibrium"] < 1e-10


def carried(clear: float, friction: dict) -> dict:
    """A disc in a bush that moves by 1.25 radii a step."""
    disc = ring("disc", (0.0, -clear), (0.25, 1.0), (60, 3), volume_force=[0.0, -WEIGHT / np.pi])
    # what shifts alone carries the disc along
    moves = {"shift": [5.0, 1.5], "turn": 1e-4, "pivot": [0.0, 0.0], "history": "push"}
    bush = ring("bush", (0.0, 0.0), (1.0 + clear, 1.8), (77, 2), clamp=["outer"], motion=moves)
    contact = {"bodies": ["disc", "bush"], "on": ["outer", "inner"], "slave": "disc"}
    return {
        "time": {"points": [1.0, 2.0], "steps": 4, "motions": "far"},
        "history": {"push": history(1.0, 2.0)},
        "body": [disc, bush],
        "contact": [contact | {"friction": friction}],
    }


def told_slight(caplog) -> list[bool]:
    return ["resists less than facets may" in words for words in caplog.messages]


@pytest.mark.parametrize("clear, mu", [seldom(0.01, 0.0), (0.1, 1e-6)])
def test_a_turn_that_nothing_resists_is_put_back(clear, mu, caplog):
    """A disc without friction, or with less than facets may resist, goes along and does not turn, whatever the passes
    tried; it lies at the bottom, and is stable there. With 1e-6 it turned by 32 rounds."""
    caplog.set_level(logging.INFO)
    answer = certified(carried(clear, {"law": "coulomb", "coefficient": mu}))
    places = answer.solved.steps.places
    first, last = (places[time].freed["disc"] for time in (1.0, 2.0))
    assert last - first == pytest.approx([5.0, 1.5, 0.0], abs=1e-6)
    assert "turn counterclockwise" in answer.summary["held_motions"][0]["motion"]
    assert not any("not stable" in warning for warning in answer.summary["warnings"])
    assert any(told_slight(caplog)) == (mu > 0.0)


@pytest.mark.slow
def test_little_friction_does_not_spin_a_disc_that_is_carried_along(caplog):
    """Nor does one with more than that, which did not settle in steps of a 64th."""
    caplog.set_level(logging.INFO)
    answer = certified(carried(0.1, {"law": "coulomb", "coefficient": 1e-3}))
    places = answer.solved.steps.places
    assert places[2.0].freed["disc"] - places[1.0].freed["disc"] == pytest.approx(
        [5.0, 1.5, 0.0], abs=1e-3
    )
    assert len(answer.summary["steps"]) == 8 and answer.summary["held_motions"] == []
    assert not any(told_slight(caplog))


def test_a_turn_on_a_rigid_plane_is_put_back():
    """A disc without friction that is pushed along a floor goes along and does not turn: the floor's normals resist its
    turn about the ends of the contact, its own do not. It turned five times round."""
    disc = ring("disc", (0.0, 1.0), (0.25, 1.0), (60, 2), volume_force=[0.0, -WEIGHT / np.pi])
    pusher = ring("pusher", (-2.0, 1.0), (0.25, 1.0), (48, 2), clamp=["inner"])
    pusher["motion"] = [{"shift": [0.5, 0.0], "history": "push"}]
    scene = {
        "time": {"points": [1.0, 2.0], "steps": 2, "motions": "far"},
        "history": {"push": history(1.0, 2.0)},
        "body": [disc, pusher],
        "rigid": [FLOOR],
        "contact": [
            {"bodies": ["disc", "floor"], "on": ["outer"]},
            {"bodies": ["disc", "pusher"], "on": ["outer", "outer"]},
        ],
    }
    places = certified(scene).solved.steps.places
    gone = places[2.0].freed["disc"] - places[1.5].freed["disc"]  # it has touched before
    assert gone == pytest.approx([0.25, 0.0, 0.0], abs=1e-6)


def rolls(rows: int = 4, angle: float = 45.0) -> dict:
    """A wheel on a rigid floor, turned by an angle."""
    wheel = ring("wheel", (0.0, 1.0), (0.3, 1.0), (60, rows), clamp=["inner"])
    turn = {"turn": -angle, "pivot": [0.0, 1.0], "history": "roll"}
    wheel["motion"] = [turn, {"free": ["x", "y"], "force": [0.0, -1.0], "history": "press"}]
    return {
        "time": {"points": [1.0, 2.0], "motions": "far"},
        "history": {"press": history(0.0, 1.0), "roll": history(1.0, 2.0)},
        "body": [wheel],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["wheel", "floor"], "on": ["outer"], "friction": COULOMB}],
    }


@pytest.mark.slow
def test_steps_that_are_not_given_are_small_enough_to_roll():
    """A wheel that is turned rolls on by as much of its circumference, though the forces at the end are those of one
    step (by which it rolled 3 to 10 % of 45° too little)."""
    answer = certified(rolls(2, 22.5))
    assert not any("time.tolerance" in warning for warning in answer.summary["warnings"])
    places = answer.solved.steps.places
    gone = places[2.0].freed["wheel"] - places[1.0].freed["wheel"]
    assert gone[0] == pytest.approx(np.radians(22.5), rel=3e-3)
    assert answer.summary["energy"]["residual"] < 1e-8


@pytest.mark.slow
def test_a_wheel_that_slips_needs_no_steps_to_roll():
    """A wheel that spins where its axle stands rubs by its whole turn: steps resolve its friction, not that it rolls, for
    which it took 32 a leg."""
    scene = rolls(2)
    turn, free = scene["body"][0]["motion"]
    scene["body"][0]["motion"] = [turn | {"turn": -360.0}, free | {"free": ["y"]}]
    scene["time"]["tolerance"] = 0.1
    answer = certified(scene)
    assert len(answer.summary["steps"]) <= 10
    assert answer.summary["energy"]["dissipated"] == pytest.approx(0.3 * 2.0 * np.pi, rel=0.11)
    assert not any("time.tolerance" in warning for warning in answer.summary["warnings"])


def test_steps_before_the_last_of_a_leg_roll():
    """The largest angle by which sides turn past each other in a step of this leg at whose end some node sticks, whatever
    rank has them: none of the bodies of this one meets another."""
    angles, sticks = (
        {0.5: 90.0, 1.0: 120.0, 1.5: 130.0, 2.0: 170.0},
        {0.5: 1, 1.0: 1, 1.5: 3, 2.0: 0},
    )
    still = Frame.of((0.0, 0.0))
    places = {
        time: SimpleNamespace(frames={"wheel": Frame.of((time, 0.0), angle), "floor": still})
        for time, angle in angles.items()
    }
    march = SimpleNamespace(
        assembly=SimpleNamespace(
            scene=SimpleNamespace(
                contact=[SimpleNamespace(name="tread", bodies=("wheel", "floor"))]
            ),
            world=MPI.COMM_SELF,
            contacts=[],
        ),
        _base=SimpleNamespace(
            time=1.0, memory=SimpleNamespace(frames=lambda scene: places[1.0].frames)
        ),
        _before=SimpleNamespace(time=1.5),
        log=SimpleNamespace(
            places=places,
            steps=[
                {"time": time, "contacts": {"tread": {"stick": number}}}
                for time, number in sticks.items()
            ],
        ),
    )
    assert FarMarch._too_short(march) == pytest.approx(np.radians(10.0) ** 2 / 6.0)


def test_a_share_of_a_motion_does_not_depend_on_the_place():
    """A body far from the origin that would turn by 200 degrees turns by the most of a pass, about its middle, which goes
    by as much of its way: not by a share of what a turn about the origin shifts."""
    middle, way, still = np.array([10.0, -3.0]), np.array([0.1, 0.2]), Frame.of((0.0, 0.0))
    free = {"disc": FreeFrame.of(None, np.array([[9.0, -3.5], [11.0, -2.5]]))}
    slices = {"disc": slice(0, 3)}
    march = SimpleNamespace(
        assembly=SimpleNamespace(
            free=free,
            frames={"disc": still},
            joint=SimpleNamespace(slices=slices),
            placement=SimpleNamespace(freed={"disc": np.zeros(3)}),
        )
    )
    group = Group(free, np.ones(3, bool), slices)
    alpha = np.append(way, np.radians(200.0) * free["disc"].size)
    gone = FarMarch._gone(march, group.next(alpha, near=False))["disc"]
    assert gone[2] == pytest.approx(15.0)
    assert Frame.of(gone[:2], gone[2:]).at(middle) == pytest.approx(middle + 15.0 / 200.0 * way)


def test_a_step_is_looked_for_where_bodies_go_on_wherever_they_are():
    """A body far from the origin that turned by 40 degrees about its middle, which moved on, is looked for as much farther
    on its way: not beside it by a millionfold of that, as shifts of turns about the origin went on."""
    middle, way = np.array([3e6, -1e6]), np.array([0.5, 0.2])
    free = FreeFrame.of(None, middle + np.array([[1.0, 0.5], [-1.0, -0.5]]))
    turn = Frame.of(way, 40.0, middle)
    scene = SimpleNamespace(assembly=SimpleNamespace(free={"disc": free}, scene=None), _cuts=0)
    memories = [
        SimpleNamespace(time=time, freed={"disc": gone}, frames=lambda scene: {"disc": turn})
        for time, gone in ((1.0, np.zeros(3)), (2.0, np.append(turn.shift, 40.0)))
    ]
    scene._before, scene._now = (SimpleNamespace(memory=memory) for memory in memories)
    gone = FarMarch._ahead_of(scene, 3.0)["disc"]
    assert gone[2] == pytest.approx(80.0)
    assert Frame.of(gone[:2], gone[2:]).at(middle) == pytest.approx(middle + 2 * way, abs=1e-8)


def eccentric(beside: float, angle: float, around: int = 40, layers: int = 4) -> dict:
    """The mesh of a disc of radius 1.8 with a hole of 1.05 round (0, -0.05), whose middle is off the hole's by `beside`,
    `angle` degrees from below; of triangles."""
    turns = 2.0 * np.pi / around * np.arange(around)
    rim, off = (
        np.column_stack([np.cos(turns), np.sin(turns)]),
        np.radians(angle) - 0.5 * np.pi,
    )
    way = beside * np.array([np.cos(off), np.sin(off)])
    shares = np.linspace(0.0, 1.0, layers + 1)[:, None, None]
    points = [0.0, -0.05] + (1.0 - shares) * 1.05 * rim + shares * (way + 1.8 * rim)
    near = np.arange(layers)[:, None] * around + np.arange(around)
    next_to = np.roll(near, -1, axis=1)
    cells = [[near, near + around, next_to + around], [near, next_to + around, next_to]]
    hole = np.column_stack([near[0], next_to[0]])
    return {
        "points": points.reshape(-1, 2),
        "cells": np.moveaxis(cells, 1, -1).reshape(-1, 3),
        "groups": {"hole": hole},
    }


def hung(angles: list[float]) -> dict:
    """Eccentric discs, each hung over a shaft, without friction."""
    bodies, shafts = [], []
    for k, angle in enumerate(angles):
        mesh = eccentric(0.3, angle, layers=2)
        mesh["points"] = mesh["points"] + [6.0 * k, 0.0]
        bodies.append(
            {"name": f"part{k}", "mesh": mesh, "material": SOFT, "volume_force": [0.0, -0.3]}
        )
        shafts.append(
            {"name": f"shaft{k}", "shape": "circle", "center": [6.0 * k, 0.0], "radius": 1.0}
        )
    return {
        "time": {"points": [1.0], "steps": 1, "motions": "far"},
        "body": bodies,
        "rigid": shafts,
        "contact": [
            {"bodies": [part["name"], shaft["name"]], "on": ["hole"]}
            for part, shaft in zip(bodies, shafts, strict=True)
        ],
    }  # fmt: skip


@pytest.mark.parametrize("angle", [seldom(85.0), 90.0])
def test_a_part_turns_until_its_mass_centre_hangs_below_its_axis(angle):
    """An eccentric disc hung over a shaft, without friction: by the whole angle, within what facets of 9 degrees take. Drawn
    level, nothing resists its first turn, so that this was held, and no equilibrium told."""
    answer = certified(hung([angle]))
    assert answer.solved.steps.places[1.0].freed["part0"][2] == pytest.approx(-angle, abs=0.2)
    assert answer.summary["held_motions"] == answer.summary["undetermined"] == []


@pytest.mark.slow
def test_several_parts_turn_as_one_by_itself():
    """In the passes of the slowest: drawn level one turns once the other hangs, and passes of this counted as its own, so
    that no equilibrium was told."""
    angles = [85.0, 90.0]
    together = certified(hung(angles))
    places = together.solved.steps.places[1.0].freed
    turns = [places[f"part{k}"][2] for k in range(2)]
    assert turns == pytest.approx([-85.0, -90.0], abs=0.2)
    (passes,) = (step["passes"] for step in together.summary["steps"])
    assert passes <= 16  # of the second alone


@pytest.mark.parametrize(("turned", "far"), [(345.0, True), (360.0, False)])
def test_a_group_is_on_its_way_until_it_has_gone_round(turned, far):
    """From then on passes that turn far are useless, as everything was as it is."""
    free = {"disc": FreeFrame.of(None, np.array([[1.0, 0.5], [-1.0, -0.5]]))}
    group = Group(free, np.ones(3, bool), {"disc": slice(0, 3)})
    turn = np.array([0.0, 0.0, np.radians(20.0) * free["disc"].size])
    for _ in range(round(turned / 15.0)):
        assert group.on_its_way
        group.next(turn, near=False)
    assert group.on_its_way == far
    given_up = []
    for _ in range(8):
        given_up.append(group.useless(1.0))
        group.next(turn, near=False)
    assert given_up.index(True) == (7 if far else 6)


@pytest.mark.parametrize(("rate", "end"), [(0.8, None), (0.97, 6)])
def test_slow_progress_of_passes_is_progress(rate, end):
    """Passes are useless once six together leave more than 0.7. A ball in a groove of planes, which leaves 0.73 from pass
    to pass until frames are near, was given up though it settles in sixteen."""
    free = {"disc": FreeFrame.of(None, np.array([[1.0, 0.5], [-1.0, -0.5]]))}
    group = Group(free, np.ones(3, bool), {"disc": slice(0, 3)})
    given_up = [group.useless(rate**k) for k in range(20)]
    assert (given_up.index(True) if any(given_up) else None) == end


@pytest.mark.parametrize(("beyond", "left"), [(1.8, 0.0), (2.5, 0.0), (0.2, 0.8**2)])
def test_motions_that_go_back_are_met_between(beyond, left):
    """Far from where they settle frames go by α, unless it goes back from pass to pass: by less than α, then, which no
    body leaves the others by. A bar between a prop and the floor left 0.8 from pass to pass, and was given up."""
    free = {"disc": FreeFrame.of(None, np.array([[1.0, 0.5], [-1.0, -0.5]]))}
    group = Group(free, np.ones(3, bool), {"disc": slice(0, 3)})
    off = first = np.array([0.1, -0.2, 0.01])
    for _ in range(2):
        step = group.next(-beyond * off, near=False)
        assert np.linalg.norm(step) <= beyond * np.linalg.norm(off) * 1.000001
        off = off + step
    assert off == pytest.approx(left * first, abs=1e-12)


@pytest.mark.parametrize(("most", "short"), [(2, "0.035"), seldom(4, "0.01")])
def test_turns_that_the_most_steps_do_not_resolve_are_told(most, short, monkeypatch):
    """Not that forces miss the tolerance: these agree to rounding."""
    monkeypatch.setattr(steps, "MOST", most)
    warnings = certified(rolls(2)).summary["warnings"]
    told = [warning for warning in warnings if "time.tolerance" in warning]
    words = f"far past each other in each of {most} load steps that wheels roll by {short} of their way too little"
    assert [words in warning for warning in told] == [True]
    assert not any("forces miss it in" in warning for warning in told)


def test_what_holds_a_free_frame_is_judged():
    """The certificate has the balance of a frame with clamps, beside that of the body in it."""
    residuals = certified(lever()).solved.solution.certificate.equilibrium
    assert {"ring", "frame of ring", "block"} == residuals.keys() and residuals[
        "frame of ring"
    ] < 1e-10


@pytest.mark.slow
def test_a_wheel_under_a_large_pull_stays_on_its_plate():
    """Passes that are far from their place are not mixed, or bodies leave each other."""
    scene = axle(force=(-1.8, -8.0), rigid=True, coarse=2)
    assert forces(certified(scene))[-1] == pytest.approx([-1.8, -8.0], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("rigid", [False, True])
def test_a_wheel_rolls_where_forces_take_its_axle(rigid):
    """The plate carries the forces on the axle; the wheel rolls as far as it turns, but for creep against the pull. An
    elastic one does so in either direction."""
    answer = certified(axle(rigid=rigid, steps=3, coarse=2))
    found, way = forces(answer)[3:], gone(answer, "wheel")
    assert found == pytest.approx(np.tile([-0.5, -8.0], (3, 1)), rel=1e-9)
    rolled = (way[-1, 0] - way[2, 0]) / np.radians(40.0)
    assert 0.99 < rolled < 1.02 and not way[:, 2].any()
    if not rigid:
        back = axle(turn=40.0, force=(0.5, -8.0), steps=3, coarse=2)
        back["body"][0]["mesh"]["origin"] = [-2, -1]
        # mirrored, but for the diagonals of cells
        assert gone(certified(back), "wheel")[-1] == pytest.approx(
            way[-1] * [-1.0, 1.0, 1.0], abs=5e-3
        )
    else:
        entry = answer.summary["rigid"]["wheel"]
        assert entry["displacement"] == pytest.approx(way[-1, :2]) and entry[
            "turn"
        ] == pytest.approx(-np.radians(40.0))
        assert entry["force"] == pytest.approx([0.5, 8.0], rel=1e-9)


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_free_frames_on_two_ranks(comm):
    """By GMRES on two ranks, by factors on one: the same frames and forces."""
    scene = rolling(turn=6.0, steps=1, coarse=3)
    many = ddmpi.solve(scene, comm)
    if comm.rank == 0:
        alone = ddmpi.solve(scene, MPI.COMM_SELF)
        assert gone(many, "disc") == pytest.approx(gone(alone, "disc"), rel=1e-6, abs=1e-7)
        assert forces(many) == pytest.approx(forces(alone), abs=1e-6)


@pytest.mark.parametrize("follows", [None, True])
def test_loads_keep_their_direction_on_a_body_that_turns(follows):
    """Its reaction balances the load as the world sees it; stresses are those under the load as its frame sees it."""
    load, turned = np.array([2.0, 0.5]), Frame.of((0.0, 0.0), 37.0)
    spin = {"shift": [0.3, 0.0], "turn": 37.0, "pivot": [0.2, 0.1], "history": "spin"}
    made = {
        "time": {"points": [1.0], "steps": 1, "motions": "far"},
        "history": {"spin": history(0.0, 1.0)},
        "body": [
            rectangle(
                "block",
                (0, 0),
                (1, 0.5),
                (8, 4),
                young=1000.0,
                clamp=["left"],
                motion=spin,
                traction=[
                    {"on": "right", "value": load.tolist()} | ({"follows": True} if follows else {})
                ],
                volume_force=[0.0, -1.0],
            )
        ],
    }
    answer = certified(made)
    world = turned.along(load) if follows else load
    assert answer.summary["bodies"]["block"]["loads"]["right"]["force"] == pytest.approx(
        0.5 * world, rel=1e-12
    )
    assert answer.summary["bodies"]["block"]["reaction"] == pytest.approx(
        [-0.5 * world[0], -0.5 * world[1] + 0.5]
    )
    seen = turned.undone
    still = {
        "body": [
            made["body"][0]
            | {
                "volume_force": seen.along(np.array([0.0, -1.0])).tolist(),
                "traction": [
                    {"on": "right", "value": (load if follows else seen.along(load)).tolist()}
                ],
            }
        ]
    }
    del still["body"][0]["motion"]
    rest = certified(still)
    assert answer.solved.fields["block"].von_mises == pytest.approx(
        rest.solved.fields["block"].von_mises, rel=1e-9
    )


@pytest.mark.parametrize("d", [2, 3])
def test_loads_resist_motions_by_their_own_change(d):
    """K is minus the derivative of the loads along the motions, of loads that keep their direction and that follow."""
    rng, still = np.random.default_rng(3), np.zeros(d)
    turned = Frame.of(still, 25.0 if d == 2 else np.array([20.0, -35.0, 50.0])).turned
    points, dead, following = rng.standard_normal((3, 9, d))
    force = np.array([1.5, -0.7, 0.2])[:d]
    frame = FreeFrame.of(
        Motion(free=[*"xyz"[:d], "turn"], pivot=(0.3, -0.2, 0.1)[:d], force=tuple(force)), points
    )

    def loads(alpha: np.ndarray) -> np.ndarray:
        """Loads along motions about the place where the pivot was, after motions α."""
        here, turn = turned @ frame.pivot, np.degrees(alpha[d:] / frame.size)
        moved = Frame.of(alpha[:d], turn if d == 3 else float(turn[0]), here)
        x = np.vstack([np.tile(moved.at(points @ turned.T), (2, 1)), moved.at(here)]) - here
        f = np.vstack([dead @ turned.T, moved.along(following @ turned.T), force])
        return np.append(f.sum(axis=0), np.cross(x, f).sum(axis=0) / frame.size)

    K, step = frame.resists(points, turned, dead, following) + frame.levers, 1e-5
    for k, along in enumerate(np.eye(d * (d + 1) // 2)):
        assert -(loads(step * along) - loads(-step * along)) / (2 * step) == pytest.approx(
            K[:, k], abs=1e-7
        )


@pytest.mark.parametrize("x, y, outer", [(0.0, 2.499, False), seldom(0.1, -0.5, True)])
def test_an_unstable_equilibrium_is_told_of(x, y, outer):
    """A disc on top of a ring would roll off; at the bottom of a bore it stays. Beside it stands a block that is a thousand
    times as heavy, with which what pushes the disc on was compared."""
    area = np.pi * (1.0 - 0.25**2)
    radii, clamp = ((1.5, 2.2), "outer") if outer else ((0.5, 1.5), "inner")
    body = ring("ring", (0.0, 0.0), radii, (88, 2), clamp=[clamp])
    heavy = {"value": [0.0, -1e3 * WEIGHT], "history": "load"}
    block = rectangle("block", (5.0, 0.0), (2.0, 0.5), (2, 1), young=1e6, volume_force=heavy)
    made = {
        "time": {"points": [1.0], "steps": 2, "motions": "far"},
        "history": {"load": history(0.0, 1.0)},
        "body": [
            ring(
                "disc",
                (x, y),
                (0.25, 1.0),
                (60, 3),
                volume_force={"value": [0.0, -WEIGHT / area], "history": "load"},
            ),
            body,
            block,
        ],
        "rigid": [FLOOR],
        "contact": [
            {"bodies": ["block", "floor"], "on": ["bottom"]},
            {
                "bodies": ["disc", "ring"],
                "on": ["outer", "inner" if outer else "outer"],
                "slave": "disc",
                "friction": {"law": "coulomb", "coefficient": 0.5},
            },
        ],
    }
    told = [
        words
        for words in certified(made).summary["warnings"]
        if "the equilibrium is not stable: disc" in words
    ]
    assert bool(told) != outer


def test_no_table_of_frames_where_no_step_ended(tmp_path):
    """As where a leg in one step has an equilibrium, and its halves, which replace it, have none."""
    steps = SimpleNamespace(iterations=[], steps=[], places={1.0: SimpleNamespace(frames={})})
    scene = SimpleNamespace(method=SimpleNamespace(target=None), time=None)
    solution = SimpleNamespace(mechanism=None)
    _write_tables(tmp_path, SimpleNamespace(scene=scene, steps=steps, solution=solution))
    assert {path.name for path in tmp_path.iterdir()} == {"history.csv", "steps.csv"}


def test_a_coarse_disc_on_a_plane_is_not_pushed_on(monkeypatch, caplog):
    """On one node of 24 it stands as on a corner, which does not show how it rolls; and passes are told."""
    monkeypatch.setattr("ddmpi.run.places.TOLD", 2)
    load = {"force": [0.0, -WEIGHT], "history": "load"}
    frame = {"free": ["x", "y", "turn"], "pivot": [0.0, 1.0], **load}
    made = {
        "body": [ring("disc", (0.0, 1.0), (0.2, 1.0), (24, 2), clamp=["inner"], motion=[frame])],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["disc", "floor"], "on": ["outer"], "friction": COULOMB}],
        "history": {"load": history(0.0, 1.0)},
        "time": {"motions": "far", "points": [1.0], "steps": 1},
    }
    with caplog.at_level(logging.INFO, "ddmpi"):
        warnings = certified(made).summary["warnings"]
    assert any("only 1 closed node" in words for words in warnings)
    assert not [words for words in warnings if "not stable" in words]
    assert "time 1, pass 2: bodies are moved by " in caplog.text and "pass 1:" not in caplog.text


@pytest.mark.parametrize("friction", [None, COULOMB])
@pytest.mark.parametrize("size", [(1.0, 0.4), (0.1, 4.0)])
def test_a_block_on_a_plane_is_stable(size, friction):
    """What a flat contact holds yields by rounding alone, whatever its sign: it is not said to be pushed on."""
    block = rectangle(
        "block",
        (-0.5 * size[0], 0.0),
        size,
        (4, 4),
        young=1000.0,
        volume_force={"value": [0.0, -0.1], "history": "press"},
    )
    made = {
        "body": [block],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}],
        "history": {"press": history(0.0, 1.0)},
        "time": {"motions": "far", "points": [1.0], "steps": 1},
    }
    if friction:
        made["contact"][0]["friction"] = friction
    warnings = certified(made).summary["warnings"]
    assert not [words for words in warnings if "not stable" in words]


def test_a_loose_ring_moves_along_its_axis():
    """Around an axis: a ring without supports slides down to a stop under a load, and carries it."""
    made = {
        "axisymmetric": True,
        "time": {"points": [1.0], "steps": 2, "motions": "far"},
        "history": {"load": history(0.0, 1.0)},
        "body": [
            rectangle(
                "ring",
                (1, 0.3),
                (0.5, 0.5),
                (5, 5),
                young=1000.0,
                traction=[{"on": "top", "force": [0.0, -4.0], "history": "load"}],
            ),
            rectangle("stop", (0.5, -0.5), (1.5, 0.5), (12, 5), young=1000.0, clamp=["bottom"]),
        ],
        "contact": [{"bodies": ["ring", "stop"], "on": ["bottom", "top"]}],
    }
    answer = certified(made)
    assert forces(answer)[:, 1] == pytest.approx([2.0, 4.0], rel=1e-9)
    assert gone(answer, "ring")[-1] == pytest.approx([0.0, -0.3, 0.0], abs=0.01)


def test_a_body_falls_until_it_touches():
    """From beside and far above the bottom of a bore a disc falls onto its side, and rolls down to the bottom."""
    made = rolling(coarse=2)
    made["body"][0]["mesh"]["center"] = [0.2, 0.2]
    made["body"][1].pop("motion"), made.pop("history")
    answer = certified(made | {"time": {"points": [1.0], "steps": 1, "motions": "far"}})
    weight = -answer.summary["bodies"]["disc"]["loads"]["volume_force"]["force"][1]
    assert forces(answer)[-1] == pytest.approx([0.0, weight], rel=1e-9, abs=1e-9)
    *shift, turn = gone(answer, "disc")[-1]
    assert Frame.of(shift, turn).at(np.array([[0.2, 0.2]])) == pytest.approx(
        np.array([[0.0, -0.5]]), abs=0.03
    )


@pytest.mark.slow
@pytest.mark.parametrize("x, y", [(0.3, 0.1), seldom(-0.3, 0.1)])
def test_a_disc_that_falls_onto_the_side_of_a_bore_rolls_down(x, y):
    """By 17 degrees of its own turn: passes in which its turn was held did not count as those in which it rolls."""
    made = rolling(coarse=3)
    made["body"][0]["mesh"]["center"] = [x, y]
    made["body"][1].pop("motion"), made.pop("history")
    answer = certified(made | {"time": {"points": [1.0], "steps": 1, "motions": "far"}})
    *shift, turn = gone(answer, "disc")[-1]
    assert Frame.of(shift, turn).at(np.array([[x, y]])) == pytest.approx(
        np.array([[0.0, -0.5]]), abs=0.06
    )


@pytest.mark.parametrize("rigid", [True, False])
def test_a_disc_on_a_plane_is_held_along_it_and_about_its_middle(rigid):
    """Without friction nothing resists either motion: lever arms of its weight move along with the contact. On an elastic
    plate it moved on from pass to pass, on a rigid one its shift alone was said to be undetermined."""
    disc = ring("disc", (0.0, 1.0), (0.25, 1.0), (60, 4), volume_force=[0.0, -WEIGHT / np.pi])
    plate = rectangle("plate", (-3, -1), (6, 1), (61, 4), young=1000.0, clamp=["bottom"])
    contact = {
        "bodies": ["disc", "floor" if rigid else "plate"],
        "on": ["outer", "top"][: 2 - rigid],
    }
    scene = {
        "time": {"points": [1.0], "steps": 1, "motions": "far"},
        "body": [disc] if rigid else [disc, plate],
        "rigid": [FLOOR] if rigid else [],
        "contact": [contact],
    }
    answer = certified(scene)
    told = [each["motion"] for each in answer.summary["held_motions"]]
    assert ["move along x" in told[0], "turn counterclockwise" in told[1]] == [True, True]
    assert answer.summary["undetermined"] == []
    assert gone(answer, "disc")[-1][[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_block_slides_by_its_length_to_a_stop():
    """Without friction, under its weight and a force: the lever arm of its weight moves on by its length, but so do those
    of contact forces. It ended as no equilibrium from 1 length on."""
    push = {"on": "left", "force": [0.5, 0.0], "history": "push"}
    block = rectangle("block", (0, 0), (2, 0.5), (8, 2), young=1000.0)
    block |= {"volume_force": [0.0, -1.0], "traction": [push]}
    stop = rectangle("stop", (4.0, 0), (0.5, 0.5), (2, 2), young=1000.0, clamp=["right"])
    scene = {
        "time": {"points": [1.0], "steps": 1, "motions": "far"},
        "history": {"push": history(0.0, 1.0)},
        "body": [block, stop],
        "rigid": [FLOOR],
        "contact": [
            {"bodies": ["block", "floor"], "on": ["bottom"]},
            {"bodies": ["block", "stop"], "on": ["right", "left"]},
        ],
    }
    answer = certified(scene)
    contacts = answer.summary["steps"][-1]["contacts"]
    assert gone(answer, "block")[-1] == pytest.approx([2.0, 0.0, 0.0], abs=1e-2)
    assert contacts["block-stop"]["force"] == pytest.approx([-0.5, 0.0], abs=1e-4)
    assert contacts["block-floor"]["force"] == pytest.approx([0.0, 1.0], abs=1e-4)


@pytest.mark.parametrize("history", [{}, seldom({"history": "turn"})])
def test_what_nothing_stops_is_an_error_in_words(history, caplog):
    """A disc that falls past everything has no equilibrium. Loads that act at once are the same in a shorter step from
    the drawing on: such a step was halved six times."""
    caplog.set_level(logging.INFO)
    made = rolling(coarse=4)
    disc, bore = made["body"]
    disc["mesh"]["center"], bore["mesh"]["radii"] = [0.0, -4.0], [0.5, 1.0]
    disc["volume_force"] = {"value": disc["volume_force"], **history}
    made["history"]["turn"] = {"times": [0.0, 1.0, 2.0], "factors": [0.0, 0.5, 1.0]}
    made["contact"][0]["on"] = ["outer", "outer"]
    bore["clamp"] = ["inner"]
    bore.pop("motion")
    if not history:
        made.pop("history")
    answer = ddmpi.solve(made)
    assert not answer.certified and "no equilibrium found: " in answer.reason
    halved = [words for words in caplog.messages if "the step is halved" in words]
    assert len(halved) == (6 if history else 0)


REFUSED = {
    "twice": (
        [{"turn": 9.0}, {"free": ["turn"]}],
        "prescribes turn in one part and frees it in another",
    ),
    "twice along": (
        [{"shift": [0.0, 9.0]}, {"free": ["x", "y"]}],
        "prescribes y in one part and frees it in another",
    ),
    "two free parts": ([{"free": ["x"]}, {"free": ["y"]}], "has 2 free parts"),
    "both at once": ({"free": ["x"], "shift": [1.0, 0.0]}, "or it is free"),
    "a moment of nothing": ({"free": ["x"], "moment": 1.0}, "moment: needs a free turn"),
    "a force across": (
        {"free": ["x"], "force": [0.0, 1.0]},
        "force: acts along y, which is not free",
    ),
    "a pivot of nothing": ({"free": ["x"], "pivot": [0.0, 1.0]}, "pivot is that of a turn"),
    "one twice": ({"free": ["x", "x"]}, "free names a component twice"),
}


@pytest.mark.parametrize("motion, words", REFUSED.values(), ids=REFUSED)
def test_a_motion_that_is_free_and_not_is_refused(motion, words):
    assert_refused(changed(("body", 0, "motion", motion), make=lever), words)


@pytest.mark.slow
def test_free_frames_go_on_from_any_step(tmp_path):
    """At the end of a leg and within one, frames.csv too."""
    assert "frames.csv" in go_on_from_checkpoints(
        rolling(turn=6.0, steps=2, coarse=3)
        | {"checkpoint": {"iterations": 1}, "output": {"steps": "all", "stress": False}},
        tmp_path,
        slice(1, None),
    )


def test_a_scene_is_checked_without_factors(tmp_path):
    """`ddmpi check` pairs the bodies as drawn, and says what is free."""
    path = write_scene(rolling(), tmp_path / "scene.toml")
    done = call("check", str(path), "--no-figures")
    assert done.code == 0 and "contact disc-bore: disc.outer and bore.inner" in done.stdout


@pytest.mark.slow
def test_a_prepared_model_has_free_frames():
    """Another moment through one model, with the answer of a run by itself."""
    model = ddmpi.prepare(lever())
    model.solve()
    answer = model.solve({"body.ring.motion.moment": -1.5})
    assert forces(answer).tolist() == forces(certified(lever(-1.5))).tolist()
    assert "factors" in model.reused["ring"]


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, 0.8)])
def test_a_partner_moves_contacts_as_its_frame_moves(axis):
    """In space a rigid partner turns about its own axis, wherever it is: to first order as its frame does."""
    points, frame = (
        np.random.default_rng(0).random((5, 3)),
        Frame.of((0.3, 0.1, -0.2), np.array([10.0, 70.0, 5.0])),
    )
    free = FreeFrame.of(Motion(free=["x", "turn"], axis=axis, pivot=(0.5, 0.2, 0.1)), points)
    moved = np.einsum("ij,njk->nik", frame.turned, free.motions(points, frame.turned))
    assert (
        np.abs(Driven.of_frame("follower", free, frame).motions(frame.at(points)) - moved).max()
        <= 1e-14
    )
