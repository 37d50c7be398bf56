"""Bodies that move far: closed forms, what no frame, step, rank or order changes, refusals, files."""

import copy
import json

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from scenes import (
    COULOMB,
    FLOOR,
    assert_refused,
    certified,
    rectangle,
    run_here,
    seldom,
    write_scene,
)

import ddmpi
from ddmpi.interface import rows
from ddmpi.pictures.bodies import animate
from ddmpi.pictures.draw import draw_all
from ddmpi.results.tables import cells_by_kind, read_results
from ddmpi.run.steps import EXCESS
from ddmpi.system.numbers import Frame

MU = COULOMB["coefficient"]


def history(*corners: float) -> dict:
    """A factor that grows from 0 to 1 between two times, or takes those of (time, factor), …"""
    return {"times": list(corners[:2]), "factors": [0.0, 1.0]}


def block(order: int = 1, steps: int = 4, way: float = 1.3) -> dict:
    """A block that is pressed onto a longer one, and pushed along it."""
    return {
        "time": {"points": [1.0, 2.0], "steps": steps, "motions": "far"},
        "history": {"press": history(0.0, 1.0), "push": history(1.0, 2.0)},
        "body": [
            rectangle(
                "slider",
                (0, 0),
                (1, 0.5),
                (8, 2),
                order,
                young=1000.0,
                clamp=["top"],
                motion=[
                    {"shift": [0.0, -0.004], "history": "press"},
                    {"shift": [way, 0.0], "history": "push"},
                ],
            ),
            rectangle("base", (-1, -1), (4, 1), (27, 3), order, young=1000.0, clamp=["bottom"]),
        ],
        "contact": [{"bodies": ["slider", "base"], "on": ["bottom", "top"], "friction": COULOMB}],
    }


def disc(order: int = 1, turn: float = 90.0) -> dict:
    """A ring that is pressed onto a block and rubbed; then both are turned and shifted together."""
    spin = {"shift": [3.0, -1.0], "turn": turn, "pivot": [0.3, 0.2], "history": "spin"}
    ring = {
        "name": "ring",
        "mesh": {
            "shape": "annulus",
            "center": [0.0, 0.0],
            "radii": [0.5, 1.0],
            "angles": [0, 360],
            "divisions": [48, 2],
            "order": order,
        },
        "material": {"young": 1000.0, "poisson": 0.3},
        "clamp": ["inner"],
        "motion": [
            {"shift": [0.0, -0.03], "history": "press"},
            {"shift": [0.002, 0.0], "history": "rub"},
            spin,
        ],
    }
    return {
        "time": {"points": [1.0, 2.0, 3.0], "steps": 3, "motions": "far"},
        "history": {
            "press": history(0.0, 1.0),
            "rub": history(1.0, 2.0),
            "spin": history(2.0, 3.0),
        },
        "body": [
            ring,
            rectangle(
                "base",
                (-2, -2),
                (4, 1),
                (31, 3),
                order,
                young=1000.0,
                clamp=["bottom"],
                motion=spin,
            ),
        ],
        "contact": [{"bodies": ["ring", "base"], "on": ["outer", "top"], "friction": COULOMB}],
    }


def pin(way: float = 20.0, back: float = 1.0) -> dict:
    """A pin, wider than the bore by 0.01 mm, that is pushed into a hub from above it, and back."""
    return {
        "axisymmetric": True,
        "time": {"points": [1.0, 2.0], "steps": 6, "motions": "far"},
        "history": {"push": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, back]}},
        "body": [
            {
                "name": "pin",
                "mesh": {
                    "shape": "rectangle",
                    "origin": [0.0, 20.0],
                    "size": [10.01, 25.0],
                    "divisions": [5, 26],
                },
                "material": {"young": 2.1e5, "poisson": 0.3},
                "clamp": [{"on": "top", "y": 0.0}],
                "motion": {"shift": [0.0, -way], "history": "push"},
            },
            {
                "name": "hub",
                "mesh": {
                    "shape": "rectangle",
                    "origin": [10.0, 0.0],
                    "size": [10.0, 20.0],
                    "divisions": [5, 20],
                },
                "material": {"young": 2.1e5, "poisson": 0.3},
                "clamp": [{"on": "bottom", "y": 0.0}],
            },
        ],
        "contact": [{"bodies": ["pin", "hub"], "on": ["right", "left"], "friction": COULOMB}],
    }


def forces(answer) -> np.ndarray:
    """The force on the first body of the only contact, at the ends of all steps."""
    return np.array(
        [next(iter(step["contacts"].values()))["force"] for step in answer.summary["steps"]]
    )


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, seldom(2)])
def test_a_block_slides_with_the_friction_of_its_pressure(order):
    """T = μ N at every step, to rounding; and the end does not depend on the number of steps."""
    answer = certified(block(order))
    T, N = forces(answer)[4:].T
    assert np.abs(-T / N - MU).max() < 1e-12 and N.min() > 0.0
    for steps in (1, 3):
        assert forces(certified(block(order, steps)))[-1] == pytest.approx(
            forces(answer)[-1], rel=1e-9
        )
    assert answer.summary["energy"]["dissipated"] == pytest.approx(MU * N.mean() * 1.3, rel=0.02)
    external = np.array(answer.solved.steps.energies)[:, 1]
    assert np.diff(external)[-3:] == pytest.approx(
        -0.5 * (T[1:] + T[:-1]) * 1.3 / 4.0, rel=1e-6
    )  # of the pusher


@pytest.mark.parametrize("mu", [0.0, seldom(MU)])
def test_energies_balance_whatever_rows_enter_and_leave(mu):
    """The pusher's work is that of the resultants over its way, all of which friction takes but for what a step does not
    resolve; a contact without friction takes nothing, over nine cells in four steps. It took 1.4 times the energy."""
    scene = block(steps=4)
    scene["contact"][0]["friction"] = {"law": "coulomb", "coefficient": mu}
    answer = certified(scene)
    _, external, _, interface, dissipated, residual = np.transpose(
        [np.zeros(6), *answer.solved.steps.energies]
    )
    ways = np.zeros((9, 2))
    ways[:, 1], ways[5:, 0] = -0.004 * np.clip(np.arange(9) / 4, 0, 1), 1.3 * np.arange(1, 5) / 4
    F = np.vstack([np.zeros(2), forces(answer)])
    given = -0.5 * ((F[1:] + F[:-1]) * np.diff(ways, axis=0)).sum(axis=1)
    assert np.diff(external) == pytest.approx(given, abs=1e-3 * external[4])
    assert np.abs(residual).max() < 1e-12 * external.max()
    assert np.abs(interface - dissipated).max() < (
        0.2 * dissipated[-1] if mu else 1e-2 * external[4]
    )


@pytest.mark.parametrize(
    ("steps", "words"),
    [({"steps": 4}, "steps = 4, or leave"), seldom({"steps": 8}, ""), seldom({}, "")],
)
def test_given_steps_that_are_too_long_are_told(steps, words):
    """Friction cannot dissipate more than contacts take, but in long steps it does: 17 % in 4, 8 % in 8."""
    scene = block()
    scene["time"] = {name: v for name, v in scene["time"].items() if name != "steps"} | steps
    answer = certified(scene)
    energy = answer.summary["energy"]
    excess = -energy["lost"] / energy["dissipated"]
    told = [words for words in answer.summary["warnings"] if "too long for energies" in words]
    assert len(told) == (excess > EXCESS) == bool(words)
    how_much = f"by {100.0 * excess:.2g} % of what it dissipates"
    assert all(words in one and how_much in one for one in told)


@pytest.mark.slow
def test_clamps_move_a_body_within_its_frame():
    """A press of which the clamp does a third and the frame the rest has the forces of one by the frame alone."""
    frame, both = block(steps=2), block(steps=2)
    both["body"][0]["clamp"] = [{"on": "top", "x": 0.0, "y": -0.002, "history": "press"}]
    frame["body"][0]["motion"][0]["shift"] = [0.0, -0.006]
    assert forces(certified(both)) == pytest.approx(forces(certified(frame)), rel=1e-9)


@pytest.mark.slow
def test_a_small_motion_is_that_of_a_clamp():
    """A press that clamps prescribe has the same forces, stresses and slip as one by a frame."""
    far, small = block(way=1e-4), block(way=1e-4)
    small["body"][0].pop("motion")
    small["body"][0]["clamp"] = [{"on": "top", "x": 0.0, "y": -0.004, "history": "press"}]
    del small["time"]["motions"], small["history"]["push"]
    small["contact"][0]["pairing"] = "mortar"
    one, other = certified(far), certified(small)
    assert forces(one)[:4] == pytest.approx(forces(other)[:4], rel=1e-9, abs=1e-9)
    ours, theirs = (answer.summary["bodies"]["base"]["displacement_max"] for answer in (one, other))
    assert ours == pytest.approx(theirs, rel=0.02)  # the rub adds a little


@pytest.mark.parametrize("order, turn", [seldom(1, 90.0), seldom(2, 90.0), (1, -137.0)])
def test_a_motion_of_both_bodies_changes_nothing(order, turn):
    """Turned and shifted together, bodies have the forces of before, turned, and no friction works; strains stay."""
    answer = certified(disc(order, turn))
    steps, frame = answer.summary["steps"], Frame.of((0.0, 0.0), turn)
    before, after = forces(answer)[[5, -1]]
    assert (
        after == pytest.approx(frame.along(before), rel=1e-9) and abs(before[0]) > 0.01 * before[1]
    )
    assert [step["contacts"]["ring-base"]["dissipated"] for step in steps[6:]] == pytest.approx(
        [0.0] * 3, abs=1e-12
    )
    at = answer.contacts["ring-base"].interface
    assert at.normal == pytest.approx(
        frame.along(np.array([[0.0, -1.0]])).repeat(at.m, axis=0), abs=0.7
    )
    closed = answer.contacts["ring-base"].status != "open"
    assert at.xy[closed] == pytest.approx(
        Frame.of((3.0, -1.0), turn, (0.3, 0.2))
        .at(np.array([[0.002, -1.0]]))
        .repeat(closed.sum(), axis=0),
        abs=0.3,
    )
    reaction = answer.summary["bodies"]["base"]["reaction"]
    assert reaction == pytest.approx(after, rel=1e-8)


@pytest.mark.slow
def test_a_pin_enters_a_hub_and_leaves_it():
    """Around an axis: no contact above the hub, T = μ N on the way in and out, and nothing but a warning at the end."""
    answer = certified(pin(back=0.0))
    found = forces(answer)
    N, T = -found[:, 0], found[:, 1]  # around an axis N is the sum of the radial forces
    inside = np.arange(6)
    assert (N[inside] > 0.0).all() and np.abs(T[inside] / N[inside] - MU).max() < 1e-12
    assert np.abs(T[6:-1] / N[6:-1] + MU).max() < 1e-12 and found[-1].tolist() == [0.0, 0.0]
    assert np.diff(N[inside]).min() > 0.0
    assert "contact.pin-hub: pin and hub do not face each other; " in "".join(
        answer.summary["warnings"]
    )
    assert answer.contacts["pin-hub"].interface.m == 0


def test_a_rigid_partner_that_turns_rubs_as_far_as_it_goes():
    """A rigid disc that turns about its centre under a block slides at every node; its place is that of its frame."""
    made = {
        "time": {"points": [1.0, 2.0], "steps": 3, "motions": "far"},
        "history": {"lift": history(0.0, 1.0), "spin": history(1.0, 2.0)},
        "body": [rectangle("block", (-1, 1), (2, 1), (16, 6), young=1000.0, clamp=["top"])],
        "rigid": [
            {
                "name": "disc",
                "shape": "circle",
                "center": [0.0, 0.0],
                "radius": 1.0,
                "motion": [
                    {"shift": [0.0, 0.03], "history": "lift"},
                    {"turn": 36.0, "pivot": [0.0, 0.03], "history": "spin"},
                ],
            }
        ],
        "contact": [{"bodies": ["block", "disc"], "on": ["bottom"], "friction": COULOMB}],
    }
    answer = certified(made)
    state, steps = answer.contacts["block-disc"], answer.summary["steps"]
    slips = state.status == "slip"
    assert slips.sum() >= 2 and not (state.status == "stick").any()
    assert np.abs(state.tangential_force[slips, 0]) == pytest.approx(
        MU * state.normal_force[slips], rel=1e-9
    )
    assert np.abs(state.slip[slips, 0]) == pytest.approx(np.radians(36.0 / 3), rel=0.03)
    # a disc that only turns about its centre leaves the pressure as it is but for friction
    assert steps[-1]["contacts"]["block-disc"]["normal_force"] == pytest.approx(
        steps[2]["contacts"]["block-disc"]["normal_force"], rel=0.05
    )
    still = copy.deepcopy(made)
    still["rigid"][0]["motion"] = still["rigid"][0]["motion"][0] | {"shift": [0.0, 0.03]}
    still["history"].pop("spin")
    assert forces(certified(still))[2] == pytest.approx(forces(answer)[2], rel=1e-12)


def sagging() -> dict:
    """A ring above a block, bent down to it by its weight, which is fifty times larger in the second step."""
    made = disc()
    made["body"][0] |= {
        "motion": {"shift": [0.0, 1e-3]},
        "volume_force": {"value": [0.0, -30.0], "history": "load"},
    }
    made["body"][0]["mesh"]["divisions"] = [96, 2]
    made["body"][1].pop("motion")
    return made | {
        "history": {"load": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 0.02, 1.0]}},
        "time": {"points": [1.0, 2.0], "steps": 1, "motions": "far"},
    }


@pytest.mark.parametrize("make", [seldom(disc), sagging])
def test_rows_that_stay_open_are_left_out(make, monkeypatch, caplog):
    """Answers are those of all rows: a step in which one closes that was left out is repeated with all of them."""
    caplog.set_level("INFO", "ddmpi")
    few = certified(make())
    assert ("once more with all nodes" in caplog.text) == (make is sagging)
    monkeypatch.setattr(rows, "WIDER", 1e9)
    whole = certified(make())
    assert forces(few) == pytest.approx(forces(whole), rel=1e-9, abs=1e-12)
    assert forces(few)[-1, 1] ** 2 + forces(few)[-1, 0] ** 2 > 1.0
    (state,), (other,) = few.contacts.values(), whole.contacts.values()
    assert (
        state.interface.m == other.interface.m
        if make is sagging
        else 2 * state.interface.m < other.interface.m
    )
    assert state.deepest == pytest.approx(other.deepest, rel=1e-9)
    assert few.summary["energy"] == pytest.approx(whole.summary["energy"], rel=1e-9, abs=1e-9)


@pytest.mark.slow
def test_order_and_scale_do_not_matter():
    """Bodies in the other order, and lengths in other units, give the same forces."""
    first = block(steps=2)
    found = forces(certified(first))
    swapped = copy.deepcopy(first)
    swapped["body"].reverse()
    swapped["contact"][0] |= {"bodies": ["base", "slider"], "on": ["top", "bottom"]}
    assert forces(certified(swapped)) == pytest.approx(-found, rel=1e-9)
    scaled = json.loads(json.dumps(first))
    for body in scaled["body"]:
        body["mesh"] |= {key: [1000.0 * x for x in body["mesh"][key]] for key in ("origin", "size")}
        for part in body.get("motion", ()):
            part["shift"] = [1000.0 * x for x in part["shift"]]
    assert forces(certified(scaled)) == pytest.approx(1000.0 * found, rel=1e-9)


def three(steps: int = 4) -> dict:
    """A block between two others, pushed out of one contact while the other holds it, without friction there."""
    made = block(steps=steps)
    made["body"].append(rectangle("lid", (-1, 0.5), (4, 0.5), (21, 4), young=1000.0, clamp=["top"]))
    made["body"][0] |= {"clamp": [{"on": "left", "x": 0.0, "y": 0.0}]}
    made["contact"].append({"bodies": ["slider", "lid"], "on": ["top", "bottom"]})
    return made


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_ranks_do_not_matter(comm):
    """Several ranks a body have the forces of one rank."""
    scene = three(steps=2)
    many = ddmpi.solve(scene, comm).summary
    if comm.rank == 0:
        alone = ddmpi.solve(scene, MPI.COMM_SELF).summary
        for one, other in zip(alone["steps"], many["steps"], strict=True):
            for name, contact in one["contacts"].items():
                assert other["contacts"][name]["force"] == pytest.approx(
                    contact["force"], rel=1e-6, abs=1e-6
                )


def changed(*changes, make=block) -> dict:
    """A scene with changes (keys, value); keys are a path, and a value of None is left out."""
    made = copy.deepcopy(make())
    for *path, last, value in changes:
        table = made
        for key in path:
            table = table[key]
        table[last] = value
        if value is None:
            del table[last]
    return made


SHIFT = {"shift": [0.1, 0.0]}
RIGID = {"name": "wall", "shape": "plane", "point": [0.0, -3.0], "normal": [0.0, 1.0]}

REFUSED = {
    "no far motions": (
        changed(("time", "motions", None)),
        "body.slider.motion: bodies move far with",
    ),
    "no motion": (
        changed(("body", 0, "motion", None), ("history", {})),
        "time.motions: no body and no rigid partner",
    ),
    "an empty motion": (changed(("body", 0, "motion", {})), "a motion has a shift"),
    "a pivot alone": (
        changed(("body", 0, "motion", SHIFT | {"pivot": [0, 0]})),
        "pivot is that of a turn",
    ),
    "a displacement as well": (
        changed(("rigid", [RIGID | {"displacement": [0.1, 0.0], "motion": SHIFT}])),
        "rigid.wall: has both a motion and a displacement",
    ),
    "a force": (changed(("rigid", [RIGID | {"force": [0.0, 1.0]}])), "moves as its motion says"),
    "a bond": (
        changed(("contact", 0, "kind", "bonded"), ("contact", 0, "friction", {"law": "none"})),
        "contact.slider-base.kind: does not go with",
    ),
    "a gap": (changed(("contact", 0, "gap", 0.0)), "contact.slider-base.gap: does not go with"),
    "pairs": (
        changed(("contact", 0, "pairing", "nodes")),
        "contact.slider-base.pairing: does not go with",
    ),
    "a profile": (
        changed(
            (
                "contact",
                0,
                "friction",
                "coefficient",
                {"along": "x", "points": [0, 1], "values": [0, 1]},
            )
        ),
        "contact.slider-base.friction: does not go with",
    ),
    "cycles": (changed(("time", "cycle", {"from": 1.0, "to": 1.0, "repeat": 2})), "cycle"),
    "derivatives": (
        changed(("output", {"derivatives": ["body.base.material.young"]})),
        "output.derivatives: there",
    ),
    "solves": (
        changed(("method", {"compliance": "direct"})),
        "method.compliance: 'direct' does not go with",
    ),
    "a turn around an axis": (
        changed(("body", 0, "motion", {"turn": 90.0}), make=pin),
        "shift along y only",
    ),
    "follows without far": (
        changed(
            ("time", "motions", None),
            ("body", 0, "motion", None),
            ("body", 0, "traction", [{"on": "left", "value": [1.0, 0.0], "follows": True}]),
        ),
        "slider.traction.0.follows: bodies move far",
    ),
    "a loose body": (
        changed(("body", 0, "clamp", [])),
        "body.slider: clamps leave a rigid motion free",
    ),
    "past": (
        changed(
            ("body", 0, "motion", {"shift": [6.0, -2.5], "history": "press"}), ("time", "steps", 1)
        ),
        "they would pass through",
    ),
    "through": (
        changed(("body", 0, "motion", {"shift": [0.0, -0.7], "history": "press"})),
        "they would pass through",
    ),
}


@pytest.mark.parametrize("made, words", REFUSED.values(), ids=REFUSED)
def test_what_does_not_go_together_is_refused(made, words):
    assert_refused(made, words)


@pytest.mark.slow
def test_motions_of_nothing_are_motions():
    """A shift or a turn of zero, as at the first value of a sweep, leaves bodies where they are."""
    still = [
        {"shift": [0.0, -0.004], "history": "press"},
        {"turn": 0.0, "pivot": [1.0, 0.0]},
        {"shift": [0.0, 0.0]},
    ]
    one, two = (
        certified(
            changed(
                ("body", 0, "motion", motion), ("time", "points", [1.0]), ("history", "push", None)
            )
        )
        for motion in (still, still[0])
    )
    assert forces(one).tolist() == forces(two).tolist() and forces(one)[-1, 1] > 0.0


@pytest.mark.slow
def test_files_are_of_the_world(tmp_path):
    """Places, displacements, stresses, reactions and tables of contacts are where bodies are at the end of a step."""
    made = disc() | {"output": {"steps": "all", "figures": False}}
    made["time"]["steps"] = 2
    run = run_here(write_scene(made, tmp_path / "scene.toml"), tmp_path / "results")
    folder, legs = run.folder, run.table("contact_ring-base_legs.csv")
    frames = {
        (time, name): Frame.of(shift).after(Frame.of((0.0, 0.0), turn))
        for time, name, *shift, turn in zip(*run.table("frames.csv").values(), strict=True)
    }
    assert len(frames) == 6 * 2
    results = read_results(folder)
    with h5py.File(folder / "result.h5") as file:
        points, body = file["points"][()][:, :2], np.zeros(len(file["points"]), int)
        (cells,) = cells_by_kind(file).values()
        body[cells[()]] = file["body"][()][:, None]
        for number, time in enumerate(sorted({time for time, _ in frames})):
            group = file.get(f"step_{number:06d}", file)
            u, total = (
                group[name][()][:, :2] for name in ("displacement_in_frame", "displacement")
            )
            for k, name in enumerate(("ring", "base")):
                mine = body == k
                assert points[mine] + total[mine] == pytest.approx(
                    frames[time, name].at(points[mine] + u[mine]), abs=1e-12
                )
            # rows of the contact stand on the slave's boundary where it is
            at = np.column_stack([legs["x"], legs["y"]])[legs["time"] == time]
            surface = group["surfaces/points"][()][:, :2]
            assert (
                len(at) and np.abs(at[:, None] - surface[None]).sum(axis=2).min(axis=1).max() < 0.05
            )
        stress = file["von_mises"][()]
    found = results.summary["bodies"]["base"]["von_mises_max"]
    assert found == pytest.approx(stress[results.fields["body"] == 1].max())
    last = results.summary["steps"][-1]
    assert last["bodies"]["base"]["reaction"] == pytest.approx(
        last["contacts"]["ring-base"]["force"], rel=1e-8
    )


@pytest.mark.slow
def test_pictures_are_of_where_bodies_are(tmp_path):
    """Drawn bodies stand at their places, a rigid partner too, and an animation has them all on one sheet."""
    from ddmpi.pictures.moved import rigid_parts
    from ddmpi.results.histories import at_step, placed

    made = block(steps=1) | {
        "rigid": [
            RIGID
            | {
                "point": [0.0, 0.5],
                "normal": [0.0, -1.0],
                "motion": {"shift": [0.0, 0.25], "history": "push"},
            }
        ]
    }
    made["contact"].append({"bodies": ["slider", "wall"], "on": ["top"]})
    made["body"][0]["clamp"] = [{"on": "left", "x": 0.0, "y": 0.0}]
    made["output"] = {"steps": "all", "figures": False, "animation": True}
    run_here(write_scene(made, tmp_path / "scene.toml"), tmp_path / "results")
    results = read_results(tmp_path / "results")
    for time, shift, wall in ((1.0, [0.0, -0.004], 0.5), (2.0, [1.3, -0.004], 0.75)):
        drawn = placed(at_step(results, tmp_path / "results", time))
        slider = drawn.fields["body"] == 0
        nodes = np.unique(drawn.fields["cells"][slider])
        assert drawn.points[nodes] == pytest.approx(results.points[nodes] + shift, abs=1e-12)
        (line,) = rigid_parts(drawn)
        assert line.at[:, 1] == pytest.approx(wall, abs=1e-9)
    drawn = draw_all(tmp_path / "results", time=1.0, into=tmp_path)
    assert {path.name for path in drawn} >= {"bodies.png", "contacts.png"}
    animate(placed(results), tmp_path / "results", "title")
    assert (tmp_path / "results" / "animation.gif").stat().st_size > 1000


@pytest.mark.slow
def test_steps_of_a_contact_that_grows_by_rounding_are_equal():
    """A block slides on a plane, so that the length of its contact is the same but for rounding. (1,026 steps, of which
    one took half of the way, became 34.)"""
    mesh = {"shape": "rectangle", "size": [2.0, 1.0], "divisions": [4, 1]}
    press = {"shift": [0.0, -1e-3], "history": "press"}
    scene = {
        "time": {"points": [1.0, 2.0], "motions": "far"},
        "history": {"press": history(0.0, 1.0), "push": history(1.0, 2.0)},
        "body": [
            {
                "name": "block",
                "mesh": mesh,
                "material": {"young": 2e5, "poisson": 0.3},
                "clamp": ["top"],
                "motion": [press, {"shift": [7.3, 0.0], "history": "push"}],
            }
        ],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"], "friction": COULOMB}],
    }
    answer = certified(scene)
    times = np.array([step["time"] for step in answer.summary["steps"]])
    pushed = np.diff(times[times >= 1.0])
    assert len(times) < 50 and np.ptp(pushed) < 1e-9
