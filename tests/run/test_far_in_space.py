"""Solids that move far: they slide, turn and roll, prescribed and free."""

import functools

import numpy as np
import pytest
import scipy.sparse as sparse
import solid_scenes
from mpi4py import MPI
from scenes import COULOMB, assert_refused, certified, run_here, seldom, write_scene
from test_far import changed, forces, history

import ddmpi
from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.body.stress import turned as stress_turned
from ddmpi.body.stress import von_mises
from ddmpi.judge import motions
from ddmpi.judge.motions import RESISTED
from ddmpi.results.histories import placed
from ddmpi.results.tables import read_results
from ddmpi.run import held
from ddmpi.run.places import put_back
from ddmpi.system.numbers import Frame

box = functools.partial(solid_scenes.box, young=1000.0)


def pressed(
    way: dict, order: int = 1, steps: int = 3, together: dict | None = None, n: int = 4
) -> dict:
    """A block that is pressed onto a plate and goes its way; then both go `together`."""
    motion = [{"shift": [0.0, 0.0, -0.004], "history": "press"}, way | {"history": "go"}]
    made = {
        "time": {"points": [1.0, 2.0], "steps": steps, "motions": "far"},
        "history": {"press": history(0.0, 1.0), "go": history(1.0, 2.0)},
        "body": [
            box("block", [0, 0, 0], [1, 1, 0.4], [n, n, 2], order, clamp=["top"], motion=motion),
            box(
                "plate",
                [-1, -1, -0.4],
                [3, 3, 0.4],
                [2 * n + 1, 2 * n + 1, 2],
                order,
                clamp=["bottom"],
            ),
        ],
        "contact": [{"bodies": ["block", "plate"], "on": ["bottom", "top"], "friction": COULOMB}],
    }
    if together:
        made["time"]["points"].append(3.0)
        made["history"]["both"] = history(2.0, 3.0)
        for body in made["body"]:
            body["motion"] = [*body.get("motion", []), together | {"history": "both"}]
    return made


SLIDE, TURN = (
    {"shift": [0.6, 0.3, 0.0]},
    {"turn": 30.0, "axis": [0.0, 0.0, 2.0], "pivot": [0.5, 0.5, 0.0]},
)


@pytest.mark.slow
def test_a_motion_of_both_bodies_changes_nothing():
    """Turned about any axis, forces, moments, reactions and stresses turn along, and nothing slips."""
    axis = [1.0, -2.0, 0.5]
    together = {"shift": [0.3, 0.1, -2.0], "turn": 110.0, "axis": axis, "pivot": [0.2, 0.4, 0.1]}
    answer = certified(pressed(SLIDE, steps=2, together=together))
    frame = Frame.of(
        together["shift"], 110.0 * np.array(axis) / np.linalg.norm(axis), together["pivot"]
    )
    before, after = forces(answer)[[3, -1]]
    assert after == pytest.approx(frame.along(before), rel=1e-7)
    steps = answer.summary["steps"]
    moments = [np.array(steps[k]["contacts"]["block-plate"]["moment"]) for k in (3, -1)]
    assert moments[1] == pytest.approx(
        frame.along(moments[0]) + np.cross(frame.shift, after), rel=1e-6
    )
    lost = [step["contacts"]["block-plate"]["dissipated"] for step in steps]
    assert sum(lost[4:]) < 1e-6 * sum(lost[2:4])
    assert answer.summary["bodies"]["plate"]["reaction"] == pytest.approx(after, rel=1e-6)
    still = certified(pressed(SLIDE, steps=2))
    for name in ("block", "plate"):
        assert answer.solved.fields[name].stress == pytest.approx(
            stress_turned(still.solved.fields[name].stress, frame.turned), abs=1e-5
        )


def test_stresses_turn_as_tensors():
    """Columns xx, yy, zz, xy, yz, xz in other axes."""
    rng = np.random.default_rng(1)
    sigma, Q = (
        rng.standard_normal((5, 6)),
        Frame.of(np.zeros(3), rng.standard_normal(3) * 60.0).turned,
    )
    xx, yy, zz, xy, yz, xz = sigma.T
    tensors = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), 2, 0)
    found = Q @ tensors @ Q.T
    assert stress_turned(sigma, Q)[:, 3:] == pytest.approx(found[:, [0, 1, 0], [1, 2, 2]])
    assert von_mises(stress_turned(sigma, Q)) == pytest.approx(von_mises(sigma))


def ball(turn: float = 20.0, steps: int = 3) -> dict:
    """A rigid ball on a plate: its turn is prescribed, forces take it along."""
    return {
        "time": {"points": [1.0, 2.0], "steps": steps, "motions": "far"},
        "history": {"load": history(0.0, 1.0), "roll": history(1.0, 2.0)},
        "body": [box("plate", [-0.5, -0.4, -0.3], [1.4, 0.8, 0.3], [14, 8, 2], clamp=["bottom"])],
        "rigid": [
            {
                "name": "ball",
                "shape": "sphere",
                "center": [0.0, 0.0, 1.0],
                "radius": 1.0,
                "motion": [
                    {
                        "turn": turn,
                        "axis": [0.0, 1.0, 0.0],
                        "pivot": [0.0, 0.0, 1.0],
                        "history": "roll",
                    },
                    {"free": ["x", "y", "z"], "force": [-0.1, 0.0, -4.0], "history": "load"},
                ],
            }
        ],
        "contact": [{"bodies": ["plate", "ball"], "on": ["top"], "friction": COULOMB}],
    }


@pytest.mark.slow
def test_a_ball_rolls_where_forces_take_it():
    """It goes as far as it turns, and the plate carries its forces; frames.csv and the summary say where it is."""
    answer = certified(ball())
    assert forces(answer)[3:] == pytest.approx(np.tile([-0.1, 0.0, -4.0], (3, 1)), abs=1e-8)
    places = answer.solved.steps.places
    way = np.array([places[step["time"]].freed["ball"] for step in answer.summary["steps"]])
    assert way[-1, 0] - way[2, 0] == pytest.approx(np.radians(20.0), rel=0.02)
    assert abs(way[-1, 1]) < 0.01 and not way[:, 3:].any()
    entry = answer.summary["rigid"]["ball"]
    assert entry["displacement"] == pytest.approx(way[-1, :3]) and entry["turn"] == pytest.approx(
        [0.0, np.radians(20.0), 0.0]
    )
    assert all(1 < step["passes"] < 12 for step in answer.summary["steps"])


def flap(moment, axis, n: int = 9) -> dict:
    """A board on a hinge along an axis, that a moment presses onto a plate."""
    motion = {"free": ["turn"], "pivot": [0.0, 0.0, 0.3], "moment": moment, "history": "load"}
    return {
        "time": {"points": [1.0], "steps": 2, "motions": "far"},
        "history": {"load": history(0.0, 1.0)},
        "body": [
            box(
                "board",
                [0.8, -0.3, 0.002],
                [0.6, 0.6, 0.3],
                [3, 3, 2],
                clamp=["top"],
                motion=motion | ({"axis": axis} if axis else {}),
            ),
            box("plate", [0.0, -1.0, -0.4], [2, 2, 0.4], [n, n, 2], clamp=["bottom"]),
        ],
        "contact": [{"bodies": ["board", "plate"], "on": ["bottom", "top"], "friction": COULOMB}],
    }


@pytest.mark.slow
@pytest.mark.parametrize("moment, axis", [(2.0, [0.0, 1.0, 0.0]), seldom([0.0, 2.0, 0.0], None)])
def test_a_hinge_in_space_balances_its_moment(moment, axis):
    """About its axis, or about all axes through the pivot."""
    answer = certified(flap(moment, axis))
    for step in answer.summary["steps"]:
        contact = step["contacts"]["board-plate"]
        about = np.array(contact["moment"]) - np.cross([0.0, 0.0, 0.3], contact["force"])
        free = slice(None) if axis is None else slice(1, 2)
        assert about[free] == pytest.approx(
            np.array([0.0, -2.0 * step["time"], 0.0])[free], abs=1e-7
        )


@pytest.mark.slow
def test_a_loose_block_lies_on_a_plate_that_moves():
    """By its weight it is carried along, without supports of its own."""
    made = {
        "time": {"points": [1.0, 2.0], "steps": 2, "motions": "far"},
        "history": {"load": history(0.0, 1.0), "go": history(1.0, 2.0)},
        "body": [
            box(
                "block",
                [0, 0, 0],
                [1, 1, 0.4],
                [4, 4, 2],
                volume_force={"value": [0.0, 0.0, -5.0], "history": "load"},
            ),
            box(
                "plate",
                [-1, -1, -0.4],
                [3, 3, 0.4],
                [9, 9, 2],
                clamp=["bottom"],
                motion={
                    "turn": 40.0,
                    "axis": [0.0, 0.0, 1.0],
                    "pivot": [2.0, 0.0, 0.0],
                    "history": "go",
                },
            ),
        ],
        "contact": [{"bodies": ["block", "plate"], "on": ["bottom", "top"], "friction": COULOMB}],
    }
    answer = certified(made)
    steps = [
        step for step in answer.summary["steps"] if step["time"] >= 1.0
    ]  # where a step is halved, more
    weighed = np.array([step["contacts"]["block-plate"]["force"] for step in steps])
    assert len(weighed) >= 3 and np.abs(weighed - [0.0, 0.0, 2.0]).max() < 1e-6
    middle = answer.solved.assembly.frames["block"].at(np.array([0.5, 0.5, 0.2]))
    carried = Frame.of(np.zeros(3), np.array([0.0, 0.0, 40.0]), [2.0, 0.0, 0.0]).at(
        np.array([0.5, 0.5, 0.2])
    )
    assert middle == pytest.approx(carried, abs=0.01)


def test_a_free_turn_goes_on_beyond_half_a_turn():
    """The vector of the turn is continuous, and its frame that of all turns one after the other."""
    free, points = FreeFrame.of(None, np.random.default_rng(2).standard_normal((9, 3))), np.zeros(3)
    gone, whole = np.zeros(6), Frame.of(points)
    for _ in range(30):
        frame = Frame.of(gone[:3]).after(Frame.of(points, gone[3:]))
        assert frame.turned == pytest.approx(whole.turned, abs=1e-12)
        assert frame.shift == pytest.approx(whole.shift, abs=1e-12)
        alpha = np.append([0.1, 0.0, 0.0], np.radians([0.0, 9.0, 12.0]) * free.size)
        here = frame.at(free.pivot)
        whole = Frame.of(alpha[:3], np.array([0.0, 9.0, 12.0]), here).after(whole)
        gone = free.gone(gone, frame, alpha)
    assert gone[3:] == pytest.approx([0.0, 270.0, 360.0])


REFUSED = {
    "a turn without axis": (
        changed(("body", 0, "motion", {"turn": 9.0}), make=lambda: pressed(SLIDE)),
        "a turn in space has an axis",
    ),
    "an axis of nothing": (
        changed(
            ("body", 0, "motion", SLIDE | {"axis": [0.0, 0.0, 1.0]}), make=lambda: pressed(SLIDE)
        ),
        "axis is that of a turn",
    ),
    "no axis": (
        changed(("body", 0, "motion", TURN | {"axis": [0.0] * 3}), make=lambda: pressed(SLIDE)),
        "not be zero",
    ),
    "an axis in the plane": (
        changed(("body", 0, "motion", {"turn": 9.0, "axis": [0.0, 0.0, 1.0]})),
        "in the plane",
    ),
    "z in the plane": (
        changed(("body", 0, "motion", {"free": ["z"]})),
        "there is no z in the plane",
    ),
    "a rigid hinge": (
        changed(("rigid", 0, "motion", {"free": ["turn"], "axis": [0.0, 0.0, 1.0]}), make=ball),
        "turns freely about all axes",
    ),
    "held in part": (
        changed(("body", 0, "clamp", [{"on": "top", "z": 0.0}]), make=lambda: pressed(SLIDE)),
        "clamps leave a rigid motion free",
    ),
}


@pytest.mark.parametrize("made, words", REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_in_space_is_refused(made, words):
    assert_refused(made, words)


@pytest.mark.slow
def test_files_are_of_the_world(tmp_path):
    """frames.csv, displacements with and without the motion, and pictures of where solids are."""
    made = pressed(TURN, steps=1, n=2)
    made["output"] = {"steps": "all", "figures": True, "animation": True}
    run = run_here(write_scene(made, tmp_path / "scene.toml"), tmp_path / "results")
    folder, frames = run.folder, run.table("frames.csv")
    shift, turn = (
        np.array([frames[f"{kind}_{axis}"][-2] for axis in "xyz"]) for kind in ("shift", "turn")
    )
    assert frames["body"][-2] == "block" and turn == pytest.approx([0.0, 0.0, 30.0])
    frame = Frame.of(shift).after(Frame.of(np.zeros(3), turn))
    results = read_results(folder)
    block = np.unique(results.fields["cells"][results.fields["body"] == 0])
    points = results.points[block]
    total, u = (results.fields[name][block] for name in ("displacement", "displacement_in_frame"))
    assert points + total == pytest.approx(frame.at(points + u), abs=1e-9)
    assert placed(results).points[block] == pytest.approx(frame.at(points), abs=1e-9)
    assert all(
        (folder / name).stat().st_size > 5000
        for name in ("bodies.png", "contact.png", "animation.gif")
    )


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_solids_move_far_on_two_ranks(comm):
    """As on one rank, prescribed and free."""
    for made in (pressed(SLIDE, steps=1, n=2), flap(2.0, [0.0, 1.0, 0.0], 5)):
        made["time"]["steps"] = 1
        many = ddmpi.solve(made, comm)
        if comm.rank == 0:
            assert forces(many) == pytest.approx(forces(ddmpi.solve(made, MPI.COMM_SELF)), abs=2e-4)


def round_bar(around: int = 16, layers: int = 1) -> dict:
    """The mesh of a bar of radius 1 along y from -0.5 to 0.5, of linear tetrahedra, whose axis is off their mass centre:
    its nodes are not equally far apart."""
    angles = 2.0 * np.pi / around * np.arange(around)
    angles = angles + 0.02 * np.sin(angles)
    section = np.vstack([[0.0, 0.0], np.column_stack([np.cos(angles), np.sin(angles)])])
    heights = np.linspace(-0.5, 0.5, layers + 1)
    points = np.array([[x, y, z] for y in heights for x, z in section])
    first, second = 1 + np.arange(around), 1 + (1 + np.arange(around)) % around
    cells, rim, apart = [], [], len(section)
    for base in apart * np.arange(layers):
        for pair in zip(first, second, strict=True):
            a, b = sorted(base + np.array(pair))
            low, top = base, base + apart
            cells += [
                [low, a, b, b + apart],
                [low, a, a + apart, b + apart],
                [low, top, a + apart, b + apart],
            ]
            rim += [[a, b, b + apart], [a, a + apart, b + apart]]
    return {"points": points, "cells": np.array(cells), "groups": {"rim": np.array(rim)}}


@pytest.mark.parametrize("moves", [[0.5, 1.0, 0.2], seldom([-2.0, 0.0, 0.0])])
def test_a_bar_in_a_groove_goes_along_and_does_not_turn(moves):
    """Nor does it shift along the groove, which moves past it: its mass centre, off its axis by facets, drives
    it by less than normals are off. It turned by 10 degrees; both motions are held, and told."""
    slope = 0.5**0.5
    sides = {"left": -1.0, "right": 1.0}
    way = {"shift": moves, "turn": 1e-4, "axis": [0.0, 0.0, 1.0], "history": "push"}
    scene = {
        "time": {"points": [1.0, 2.0], "steps": 1, "motions": "far"},
        "history": {"push": history(1.0, 2.0)},
        "body": [{"name": "bar", "mesh": round_bar(), "material": {"young": 1000.0, "poisson": 0.3},
                  "volume_force": [0.0, 0.0, -2.0]}],
        "rigid": [{"name": name, "shape": "plane", "point": [sign * slope, 0.0, -slope],
                   "normal": [-sign * slope, 0.0, slope], "motion": way}
                  for name, sign in sides.items()],
        "contact": [{"bodies": ["bar", name], "on": ["rim"]} for name in sides],
    }  # fmt: skip
    answer = certified(scene)
    places = answer.solved.steps.places
    first, last = (places[time].freed["bar"] for time in (1.0, 2.0))
    assert last - first == pytest.approx([moves[0], 0.0, moves[2], 0.0, 0.0, 0.0], abs=2e-3)
    assert abs(first[4]) < 1e-2
    shift, turn = answer.summary["held_motions"]
    assert (
        "bar can move along y" in shift["motion"]
        and "bar can turn about the axis" in turn["motion"]
    )
    assert 0.0 < turn["moment"] < 0.5 * turn["bound"] and not answer.summary["undetermined"]


def test_held_motions_are_put_back_by_angles_and_by_ways():
    """A part that was carried along stays in its angle, though it turns about an axis beside the middle of its nodes; a
    shift that turns it by rounding goes back by its way."""
    turns = np.repeat([False, True], 3)
    turn, shift = (
        np.array([0.1, 0.0, 0.0, 0.0, 1.0, 0.0]),
        np.array([0.0, 1.0, 0.0, 1e-4, 0.0, 0.0]),
    )
    span = np.linalg.qr(np.array([turn + shift, shift]).T)[0]
    gone = np.array([5.0, 0.3, 2.0, 1e-3, 0.02, 0.4])
    back = span @ put_back(span, gone, turns)
    assert back == pytest.approx(-0.02 * turn - 0.3 * shift, abs=1e-5)


@pytest.mark.parametrize("off, dead", [(1e-4, True), (1e-2, False)])
def test_a_mass_centre_off_its_axis_determines_a_turn(off, dead):
    """By more than the error of normals, beside the loads of its own body, not those of a heavy one."""
    K = np.diag([off, 0.0])
    K[0, 1] = 1.0  # as the load moves along
    K = 1e-3 * np.kron(np.diag([1.0, 0.0]), K) + 1e3 * np.kron(np.diag([0.0, 1.0]), K)
    found = motions.dead(np.eye(4)[:, [0]], K, np.repeat([1e-3, 1e3], 2), RESISTED)
    assert found.shape == (4, int(dead))


@pytest.mark.parametrize(
    "tilt, coarse, kept", [(3.4e-4, True, 1), (3.4e-4, False, 0), (2e-2, True, 0)]
)
def test_a_shift_that_facets_tilt_is_held_as_a_coarse_one(tilt, coarse, kept):
    """A bar in a trough, of which facets tilt the shift y by the turn -tilt about x, along which its weight has the moment y;
    a trough that bends by more determines it."""
    F, K = np.array([[tilt, 1.0]]), sparse.csr_matrix([[0.0, 0.0], [1.0, 0.0]])
    sums = [sparse.csr_matrix(each) for each in (F.T @ F, F.T @ F, np.eye(2))]
    of_bodies = np.zeros(2, int), np.array([False, True])
    basis, levels = held._chosen([np.arange(2)], sums, K, of_bodies, coarse)
    assert basis.T.tolist() == [[1.0, 0.0]] * kept and levels.tolist() == [True] * kept


@pytest.mark.slow
def test_a_ball_of_order_1_rests_in_a_bowl_that_moves():
    """It goes along and does not turn, by facets that drive it less than normals are off; it came to no rest."""
    mesh = {"shape": "ball", "center": [0.0, 0.0, -0.5], "radius": 1.0, "size": 0.8}
    way = [0.3, 0.1, 0.2]
    scene = {
        "time": {"points": [1.0, 2.0], "steps": 1, "motions": "far"},
        "history": {"load": history(0.0, 1.0), "push": history(1.0, 2.0)},
        "body": [{"name": "ball", "mesh": mesh, "material": {"young": 1000.0, "poisson": 0.3},
                  "volume_force": {"value": [0.0, 0.0, -2.0], "history": "load"}}],
        "rigid": [{"name": "bowl", "shape": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.5, "inside": True,
                   "motion": {"shift": way, "history": "push"}}],
        "contact": [{"bodies": ["ball", "bowl"], "on": ["surface"]}],
    }  # fmt: skip
    answer = certified(scene)
    places = answer.solved.steps.places
    gone = places[2.0].freed["ball"] - places[1.0].freed["ball"]
    assert gone == pytest.approx([*way, 0.0, 0.0, 0.0], abs=1e-6)
    assert len(answer.summary["held_motions"]) == 3 and not answer.summary["undetermined"]


def in_a_groove(moves: list[float], friction: dict) -> dict:
    """A block, whose edge is below, in a groove of two planes at 45 degrees, which then shift."""
    ends = np.array([[0, 1], [1, 2], [0, 3], [-1, 2]]) / np.sqrt(2.0)
    corners = [[x, y, z] for y in (1.0, 0.0) for x, z in ends]
    mesh = {"shape": "hexahedron", "corners": corners, "divisions": [2, 2, 2]}
    mesh["corners"] = [[x, y, z - ends[0][1] + 0.01] for x, y, z in corners]
    block = {"name": "block", "mesh": mesh, "material": {"young": 1000.0, "poisson": 0.3}}
    way = {"shift": moves, "history": "go"}
    planes = [
        {"name": name, "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [lean, 0.0, 1.0]}
        for name, lean in (("left", 1.0), ("right", -1.0))
    ]
    groups = {"left": "left", "right": "front"}
    return {
        "time": {"points": [1.0, 2.0], "steps": 1, "motions": "far"},
        "history": {"go": history(1.0, 2.0)},
        "body": [block | {"volume_force": [0.0, 0.0, -1.0]}],
        "rigid": [plane | {"motion": way} for plane in planes],
        "contact": [
            {"bodies": ["block", name], "on": [groups[name]], "friction": friction}
            for name in groups
        ],
    }


@pytest.mark.parametrize("friction", [COULOMB, seldom({"law": "none"})])
def test_a_block_goes_along_with_the_planes_that_it_lies_on(friction):
    """It lies on them as before, whatever their way: it was looked for where it was, fell, and came to lie elsewhere. Along
    the groove friction alone takes it along."""
    answer = certified(in_a_groove([2.0, 1.0, 0.5], friction))
    places = answer.solved.steps.places
    gone = places[2.0].freed["block"] - places[1.0].freed["block"]
    along = [2.0, 1.0 if friction is COULOMB else 0.0, 0.5, 0.0, 0.0, 0.0]
    # what is held is the way along the edge as it settled, by 6e-5 off y
    assert gone == pytest.approx(along, abs=1e-9 if friction is COULOMB else 1e-4)
    first, last = answer.summary["steps"]
    assert last["passes"] <= 2
    for name in ("block-left", "block-right"):
        before, after = (step["contacts"][name] for step in (first, last))
        assert after["force"] == pytest.approx(before["force"], abs=1e-9)
        assert after["dissipated"] == pytest.approx(0.0, abs=1e-12)
    assert sum(last["contacts"][name]["force"][2] for name in last["contacts"]) == pytest.approx(
        1.0
    )
