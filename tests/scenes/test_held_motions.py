"""Round parts without friction, and bodies without forces: what nothing determines stays where it was, and is told."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse
from bolts import bar
from restarts import go_on_from_checkpoints
from scenes import certified, pinched_blocks, rectangle, seldom

import ddmpi
from ddmpi.body.rigid_motions import Centring
from ddmpi.judge.equilibrium import IMBALANCE
from ddmpi.judge.motions import unresisted
from ddmpi.run import held, solve
from ddmpi.run.least import nearest
from ddmpi.run.solve import Iteration

STEEL = {"young": 2.1e5, "poisson": 0.3}
TURN = "shaft can turn counterclockwise about (0, 0) without any force"


def shaft(around: tuple[int, int], load: list, order: int = 2) -> dict:
    """A shaft of radius 10 in a bush with a clearance of 0.05, which it touches below."""

    def ring(name: str, centre: list, radii: list, number: int, **more) -> dict:
        mesh = {"shape": "annulus", "center": centre, "radii": radii, "angles": [0.0, 360.0]}
        return {
            "name": name,
            "mesh": mesh | {"divisions": [number, 3], "order": order},
            "material": STEEL,
        } | more

    return {
        "body": [
            ring("shaft", [0.0, -0.05], [4.0, 10.0], around[0], volume_force=load),
            ring("bush", [0.0, 0.0], [10.05, 20.0], around[1], clamp=["outer"]),
        ],
        "contact": [{"bodies": ["shaft", "bush"], "on": ["outer", "inner"]}],
    }


def split(around: tuple[int, int], order: int) -> dict:
    """The same with a bush of two halves, which are bonded below and above the shaft."""
    scene = shaft(around, [0.0, -3.79], order)
    bush = scene["body"].pop()
    for name, first in {"left": 90.0, "right": -90.0}.items():
        mesh = bush["mesh"] | {"angles": [first, first + 180.0]}
        mesh["divisions"] = [around[1] // 2, 3]
        scene["body"].append(bush | {"name": name, "mesh": mesh})
        scene["contact"].append({"bodies": ["shaft", name], "on": ["outer", "inner"]})
    for name, ends in {"below": ["end", "start"], "above": ["start", "end"]}.items():
        scene["contact"].append(
            {"name": name, "bodies": ["left", "right"], "on": ends, "kind": "bonded"}
        )
    del scene["contact"][0]
    return scene


def symmetric(around: int, order: int) -> dict:
    """The right half of the same."""
    scene = shaft((around // 2, around // 2), [0.0, -3.79], order)
    for body in scene["body"]:
        body["mesh"]["angles"] = [-90.0, 90.0]
        body["clamp"] = [*body.get("clamp", []), {"on": "start", "x": 0.0}, {"on": "end", "x": 0.0}]
    return scene


@pytest.mark.parametrize(
    ("around", "order"),
    [((40, 46), 1), seldom((40, 40), 2)],
)
def test_a_shaft_in_a_bush_turns_no_more_than_its_half(around, order):
    """Its displacement is that of the half with a plane of symmetry, in at most twice the steps, and its turn is held."""
    answer = certified(shaft(around, [0.0, -3.79], order))
    half = certified(symmetric(40, order))
    whole = answer.summary["bodies"]["shaft"]["displacement_max"]
    assert whole == pytest.approx(half.summary["bodies"]["shaft"]["displacement_max"], rel=0.02)
    assert answer.summary["outer_iterations"] <= 2 * half.summary["outer_iterations"]
    (held,) = answer.summary["held_motions"]
    assert (
        held["body"] == "shaft" and held["motion"] == TURN and answer.summary["undetermined"] == []
    )
    assert held["moment"] <= 1e-3 * held["bound"] and half.summary["held_motions"] == []


@pytest.mark.clarabel
@pytest.mark.parametrize(
    ("clearance", "centre"),
    [(0.04, (0.02, -0.03)), (0.2, (0.16, 0.0)), seldom(0.04, (0.0, -0.03)), seldom(0.04, (0.005, 0.0))],
)  # fmt: skip
def test_a_disc_drawn_anywhere_in_a_bore_is_pressed_to_where_its_load_points(clearance, centre):
    """Its centre goes by the clearance to that side, whatever lever arm the load has about the bore as drawn."""
    mesh = {"shape": "annulus", "center": list(centre), "radii": [1.0, 5.0], "angles": [0.0, 360.0]}
    disc = {"name": "disc", "mesh": mesh | {"divisions": [41, 4], "order": 2}, "material": STEEL}
    bore = {"shape": "circle", "name": "bore", "center": [0.0, 0.0], "inside": True}
    bore["radius"] = 5.0 + clearance
    contact = {"bodies": ["disc", "bore"], "on": ["outer"]}
    scene = {"body": [disc | {"volume_force": [0.4, -1.0]}], "rigid": [bore], "contact": [contact]}
    answer = certified(scene)
    gone = clearance * np.array([0.4, -1.0]) / np.hypot(0.4, 1.0) - centre
    # and by less than 1e-3 more, as it yields, and as normals are those as drawn
    assert answer.summary["bodies"]["disc"]["displacement_max"] == pytest.approx(
        np.linalg.norm(gone), abs=1e-3 + clearance**2 / 10.0
    )
    (held,) = answer.summary["held_motions"]
    assert held["moment"] <= 1e-9


def test_held_motions_are_in_the_order_of_the_scene():
    """Whichever of two discs in bores of their own its facets resist more."""
    scene: dict = {"body": [], "rigid": [], "contact": []}
    for name, at, number in (("fine", 0.0, 17), ("coarse", 20.0, 13)):
        mesh = {"shape": "annulus", "center": [at, -0.1], "radii": [3.0, 5.0], "order": 2}
        mesh |= {"angles": [0.0, 360.0], "divisions": [number, 1]}
        body = {"name": name, "mesh": mesh, "material": STEEL, "volume_force": [0.0, -1.0]}
        bore = {"shape": "circle", "name": f"{name}-bore", "center": [at, 0.0], "inside": True}
        scene["body"].append(body)
        scene["rigid"].append(bore | {"radius": 5.1})
        scene["contact"].append({"bodies": [name, f"{name}-bore"], "on": ["outer"]})
    for bodies in (scene["body"], scene["body"][::-1]):
        told = certified(scene | {"body": bodies}).summary["held_motions"]
        assert [held["body"] for held in told] == [body["name"] for body in bodies]


@pytest.mark.parametrize("order", [seldom(1), 2])
def test_a_load_aslant_leaves_no_moment(order):
    """It goes through the shaft's axis, about which the bush's forces have no moment, whatever the gap as drawn."""
    answer = certified(shaft((40, 46), [-2.68, -2.68], order))
    (held,) = answer.summary["held_motions"]
    # the lever arm of the normals between both sides is half the clearance: 35 N mm, 0.025 mm times 1,400 N
    assert held["moment"] < 1e-3 * held["bound"] and held["bound"] < 5.0
    assert answer.summary["bodies"]["shaft"]["displacement_max"] < 0.1
    assert answer.contacts["shaft-bush"].pressure.max() < 200.0


@pytest.mark.clarabel
@pytest.mark.parametrize(
    ("clearance", "load", "moment"),
    [(0.05, [0.0, 4.0], 0.0), seldom(0.05, [0.0, 4.0], 20.0), seldom(1.0, [-2.7, 2.7], 0.0),
     seldom(1.0, [-2.7, 2.7], 20.0)],
)  # fmt: skip
def test_a_gap_that_is_crossed_bears_no_moment(clearance, load, moment):
    """A shaft pulled across its clearance rests without a moment, and with one below force times clearance it turns."""
    # ∫ x² over the ring
    load = [load[0], f"{load[1]} + {moment / (np.pi / 4 * (10.0**4 - 4.0**4))!r} * x"]
    scene = shaft((40, 46), load)
    scene["body"][0]["mesh"]["center"] = [0.0, -clearance]
    scene["body"][1]["mesh"]["radii"] = [10.0 + clearance, 20.0]
    answer = ddmpi.solve(scene)
    (held,) = answer.summary["held_motions"]
    assert held["moment"] == pytest.approx(moment, rel=1e-2, abs=1e-3)
    if not moment:
        # to where it touches: (r sin a, r cos a) from the middle of the bush, and drawn below that
        angle = np.arctan2(load[0] if isinstance(load[0], float) else 0.0, 2.7 if load[0] else 4.0)
        gone = clearance * np.array([np.sin(angle), np.cos(angle) + 1.0])
        assert answer.certified
        assert answer.summary["bodies"]["shaft"]["displacement_max"] == pytest.approx(
            np.linalg.norm(gone), rel=0.02, abs=0.03
        )
    else:
        assert answer.reason.startswith(
            "no equilibrium: shaft would turn counterclockwise about (0, "
        )


@pytest.mark.slow
def test_lobes_resist_a_turn():
    """Three lobes of a thousandth of the radius are no facets: a moment is balanced, as with a friction of 1e-6."""
    geometry = Path(__file__).parents[2] / "scripts" / "round"
    body = [
        {"name": name, "mesh": {"geometry": str(geometry / f"lobed_{name}.geo"), "size": 4.0, "order": 1},
         "material": STEEL}
        for name in ("pin", "lug")
    ]  # fmt: skip
    body[0]["volume_force"] = [0.0, f"-3.18 + {1.0 / (np.pi / 4 * 10.0**4)!r} * x"]
    body[1]["clamp"] = ["top"]
    contact = {"bodies": ["pin", "lug"], "on": ["rim", "bore"]}
    turned = []
    for more in ({}, {"friction": {"law": "coulomb", "coefficient": 1e-6}}):
        answer = certified({"body": body, "contact": [contact | more]})
        assert answer.summary["held_motions"] == [] and answer.summary["warnings"]
        turned.append(answer.summary["bodies"]["pin"]["displacement_max"])
    assert turned[0] == pytest.approx(turned[1], rel=0.02) and turned[0] > 2.0


def rolling(order: int, slave: str, moment: float = 0.0) -> dict:
    """A ball between two plates, which is meshed coarsely."""
    low, high = (
        {
            "name": name,
            "material": {"young": 1e5, "poisson": 0.3},
            "mesh": {
                "shape": "box",
                "origin": [-2.0, -2.0, z],
                "size": [4.0, 4.0, 1.0],
                "divisions": [5, 5, 2],
            },
        }
        for name, z in (("low", -1.0), ("high", 2.0))
    )
    low["clamp"] = ["bottom"]
    high["clamp"] = [{"on": "top", "x": 0.0, "y": 0.0, "z": -0.01}]
    mesh = {"shape": "ball", "center": [0.13, -0.21, 1.0], "radius": 1.0, "size": 0.7}
    ball = {
        "name": "ball",
        "mesh": mesh | {"order": order},
        "material": {"young": 1e5, "poisson": 0.3},
    }
    if moment:
        # the moment of inertia of a ball about an axis: 8/15 π r⁵
        size = moment / (8.0 / 15.0 * np.pi)
        ball["volume_force"] = [f"{-size!r} * (y + 0.21)", f"{size!r} * (x - 0.13)", 0.0]
    contacts = [
        {"bodies": ["ball", plate], "on": ["surface", side], "slave": slave or plate}
        for plate, side in (("low", "top"), ("high", "bottom"))
    ]
    return {"body": [ball, low, high], "contact": contacts}


@pytest.mark.slow
@pytest.mark.parametrize(("order", "slave"), [(1, "ball"), (2, "")])
def test_a_ball_turns_freely_about_three_axes(order, slave):
    """By its own normals, which are radial on linear elements, too: nothing is left along its turns."""
    answer = certified(rolling(order, slave))
    held = answer.summary["held_motions"]
    assert len(held) == 3 and all("ball can turn about the axis" in one["motion"] for one in held)
    assert all(one["moment"] <= (1e-9 if order == 1 else 0.2 * one["bound"]) for one in held)
    assert answer.summary["bodies"]["ball"]["displacement_max"] < 1.0  # that of coarse contacts
    assert not any("facets" in warning for warning in answer.summary["warnings"])


@pytest.mark.clarabel
@pytest.mark.parametrize("moment", [1e-4, 1e-2])
def test_a_moment_beyond_what_facets_may_bear_has_no_equilibrium(moment):
    """A small moment is held and told; a large one turns the shaft, and both numbers are named."""
    answer = ddmpi.solve(shaft((40, 46), [0.0, f"-3.79 + {moment} * x"]))
    # ∫ moment x² over the ring is its moment about the middle
    driven = moment * np.pi / 4 * (10.0**4 - 4.0**4)
    if moment < 1e-3:
        assert answer.certified
        (held,) = answer.summary["held_motions"]
        assert held["moment"] == pytest.approx(driven, rel=0.02)
        return
    assert answer.reason.startswith(
        "no equilibrium: shaft would turn counterclockwise about (0, 0): "
    )
    told, bound = map(float, re.findall(r"[(:] ?([\d.]+) N·m/m", answer.reason))
    assert told == pytest.approx(driven, rel=0.02) and bound < 0.1 * told
    assert (
        "only the facets of the meshes resist" in answer.reason
        and "clamp the turn" in answer.reason
    )


def test_coarse_elements_let_hold_what_is_resisted_far_less_than_the_rest():
    """Linear ones in space: 1e-3 beside 1 is held, 1e-3 beside 1e-2 is not; of other elements neither is."""
    of_sides = np.eye(3)

    def found(second: float, coarse: bool) -> tuple[np.ndarray, bool]:
        return unresisted(np.diag([1.0, 1e-3, second]) ** 2, of_sides, coarse)

    vectors, level = found(0.5, True)
    assert np.abs(vectors[:, 0]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert vectors.shape == (3, 1) and level
    for second, coarse in ((1.5e-2, True), (0.5, False)):
        vectors, level = found(second, coarse)
        assert vectors.shape == (3, 0) and not level


def test_a_motion_past_nothing_is_held_whatever_its_rounding():
    """Squares far below those of a motion are none, neither of what resists it nor of how far it moves."""
    vectors, _ = unresisted(np.diag([1.0, 1e-26]), np.diag([1.0, 1e-29]))
    assert np.abs(vectors.T) == pytest.approx(np.array([[0.0, 1.0]]))


def test_what_coarse_elements_let_hold_is_told():
    """Once a body, with its motions, and what may also be the reason."""
    ways = [f"ball can turn about the axis along {axis} without any force" for axis in "xy"]
    told = held.coarse_words(
        [
            *(held.HeldMotion("ball", way, 1.0, 2.0, True) for way in ways),
            held.HeldMotion("pin", "pin can turn without any force", 1.0, 2.0, False),
        ]
    )
    (words,) = told
    assert words.startswith("body.ball: facets, or a shape as near to a round one, resist")
    assert "along x; ball can turn about the axis along y" in words and "order 2" in words


def test_square_pin_in_square_hole_is_not_held():
    """Its flanks resist the turn: balance is asked of it, and a small moment turns it by the clearance."""
    sides = {
        "left": ([-4, -3], [1, 6]), "right": ([3, -3], [1, 6]), "below": ([-4, -4], [8, 1]), "above": ([-4, 3], [8, 1]),
    }  # fmt: skip
    faces = {
        "left": ["left", "right"],
        "right": ["right", "left"],
        "below": ["bottom", "top"],
        "above": ["top", "bottom"],
    }
    pin = rectangle(
        "pin", (-3, -3), (6, 6), (6, 6), material=STEEL, volume_force=[0.0, "-1.0 + 1e-3 * x"]
    )
    walls = [
        rectangle(
            name,
            origin,
            size,
            (max(size[0], 2), max(size[1], 2)),
            material=STEEL,
            clamp=[faces[name][0]],
        )
        for name, (origin, size) in sides.items()
    ]
    contacts = [{"bodies": ["pin", name], "on": on} for name, on in faces.items()]
    answer = certified({"body": [pin, *walls], "contact": contacts})
    assert answer.summary["held_motions"] == []


@pytest.mark.slow
def test_two_free_turns_in_load_steps():
    """Shaft and loose bush both stay; so they do as the load falls, and what is left along them is told of the end."""
    scene = shaft((40, 46), {"value": [0.0, -3.79], "history": "pull"})
    housing = {
        "name": "housing",
        "mesh": {"shape": "annulus", "center": [0.0, 0.0], "radii": [20.05, 30.0], "angles": [0.0, 360.0],
                 "divisions": [52, 3], "order": 2},
        "material": STEEL, "clamp": ["outer"],
    }  # fmt: skip
    del scene["body"][1]["clamp"]
    scene["body"][0]["mesh"]["center"], scene["body"][1]["mesh"]["center"] = (
        [0.0, -0.1],
        [0.0, -0.05],
    )
    scene["body"].append(housing)
    scene["contact"].append(
        {"name": "outside", "bodies": ["bush", "housing"], "on": ["outer", "inner"]}
    )
    scene |= {
        "history": {"pull": {"times": [0, 1, 2], "factors": [0, 1, 0.5]}},
        "time": {"points": [1.0, 2.0]},
    }
    answer = certified(scene)
    assert [held["body"] for held in answer.summary["held_motions"]] == ["shaft", "bush"]
    assert answer.summary["bodies"]["shaft"]["displacement_max"] < 0.03
    assert abs(answer.summary["energy"]["residual"]) < 1e-8


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_held_motions_on_two_ranks(comm):
    """The same answer, and the same words, as on one rank."""
    scene = shaft((20, 23), [-2.68, -2.68], 1)
    both, alone = ddmpi.solve(scene, comm), ddmpi.solve(scene)
    assert both.certified and alone.certified
    if comm.rank == 0:
        (held,), (other,) = both.summary["held_motions"], alone.summary["held_motions"]
        assert held["motion"] == other["motion"] and held["moment"] == pytest.approx(
            other["moment"], rel=1e-5
        )


@pytest.mark.slow
def test_a_prepared_model_holds_anew():
    """Friction determines the turn, and without it the model holds it: each answer is that of a run by itself."""
    scene = shaft((20, 23), [-2.68, -2.68], 1)
    rough = {"contact.shaft-bush.friction": {"law": "coulomb", "coefficient": 0.2}}
    with ddmpi.prepare(scene) as model:
        answers = [model.solve(change) for change in ({}, rough, {})]
    assert [len(answer.summary["held_motions"]) for answer in answers] == [1, 0, 1]
    first, last = (answer.solved.solution.outer.forces for answer in answers[::2])
    assert np.array_equal(first, last)
    assert np.array_equal(first, ddmpi.solve(scene).solved.solution.outer.forces)


def test_an_unloaded_lid_lies_where_it_moves_least():
    """Of all places on the bent beam; with friction as without. The beam lifts it by the parallel that clears its arc."""
    beam = rectangle("beam", (0, 0), (10, 1), (40, 4), material={"young": 1e5, "poisson": 0.3}, clamp=["left"],
                     traction=[{"on": "right", "force": [0.0, 20.0]}])  # fmt: skip
    lid = rectangle("lid", (2, 1), (6, 1), (29, 3), material={"young": 1e5, "poisson": 0.3})
    contact = {"bodies": ["lid", "beam"], "on": ["bottom", "top"]}
    moved = []
    for friction in (0.0, 0.15):
        contact["friction"] = {"law": "coulomb", "coefficient": friction}
        answer = certified({"body": [beam, lid], "contact": [contact]})
        moved.append(answer.summary["bodies"]["lid"]["displacement_max"])
        assert answer.contacts["lid-beam"].gap.min() > -1e-9
    assert moved == pytest.approx([0.4183, 0.4183], abs=1e-4)


def test_the_nearest_point_is_that_of_a_fine_search():
    """Within half-planes; one that no row excludes is itself."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        rows, room, wanted = (
            rng.standard_normal((8, 2)),
            rng.random(8),
            3.0 * rng.standard_normal(2),
        )
        x = nearest(wanted, rows, room)
        assert (rows @ x <= room + 1e-9).all()
        grid = x + np.linspace(-0.2, 0.2, 81)[:, None] * np.array([[1.0, 0.0]])
        grid = np.vstack([grid + t * np.array([0.0, 1.0]) for t in np.linspace(-0.2, 0.2, 81)])
        allowed = grid[(grid @ rows.T <= room).all(axis=1)]
        assert np.linalg.norm(x - wanted) <= np.linalg.norm(allowed - wanted, axis=1).min() + 1e-9
    assert nearest(np.array([0.1, 0.2]), np.zeros((0, 2)), np.zeros(0)).tolist() == [0.1, 0.2]


def test_a_faint_motion_is_balanced_by_loads():
    """Contact forces along it would be thousands of times the load; what balances it changes no other motion."""
    angles = np.linspace(0.0, 2.0 * np.pi, 7)[:-1]
    points = np.column_stack([np.cos(angles), np.sin(angles)])
    turn = np.column_stack([-points[:, 1], points[:, 0]])
    R = np.stack([np.tile([1.0, 0.0], 6), np.tile([0.0, 1.0], 6), turn.ravel()], axis=1)
    # radial rows, whose normals are off by 1e-5: the turn moves them by so much
    normals = points + 1e-5 * turn
    B = sparse.csr_matrix((normals.ravel(), (np.repeat(np.arange(6), 2), np.arange(12))))
    centring = Centring(R, B)
    f = np.random.default_rng(3).standard_normal(12)
    balanced = centring.balance(f)
    assert R.T @ balanced == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.abs(balanced).max() < 10.0 * np.abs(f).max()
    # centring is the transposed of it
    by_load = [centring.balance(load) for load in np.eye(12)]
    by_displacement = np.array([centring.centre(u) for u in np.eye(12)]).T
    assert by_displacement == pytest.approx(np.array(by_load), abs=1e-12)
    assert centring.faint == pytest.approx(1e-5 * np.ones((1, 6)), rel=1e-3, abs=0.0) or (
        centring.faint == pytest.approx(-1e-5 * np.ones((1, 6)), rel=1e-3, abs=0.0)
    )


@pytest.mark.slow
def test_a_released_motion_stays_released_after_a_restart(tmp_path, monkeypatch):
    """A run that goes on does not hold again what loads have driven; its steps take as many iterations."""
    scene = shaft((20, 23), [1.0, -3.0], 1) | {
        "time": {"points": [1.0], "steps": 4},
        "checkpoint": {"iterations": 1},
        "output": {"steps": "all", "stress": False},
    }
    released, judge, left, release = (
        [],
        solve.judge_held,
        Iteration._left_along_held,
        Iteration.release,
    )

    def as_if_driven(self, stopped):
        """Until it is released, the turn counts as one that coarse elements let hold and loads drive."""
        monkeypatch.setattr(
            solve, "judge_held", judge if self.released else lambda *_: ([], None, True)
        )
        return left(self, stopped)

    monkeypatch.setattr(Iteration, "_left_along_held", as_if_driven)
    monkeypatch.setattr(Iteration, "release", lambda self: released.append(release(self)))
    go_on_from_checkpoints(scene, tmp_path, slice(-2, None))
    assert len(released) == 3


def test_a_restart_releases_nothing_by_itself(tmp_path, monkeypatch):
    """What the run held is held as it goes on."""
    monkeypatch.setattr(Iteration, "release", lambda self: pytest.fail("released"))
    scene = pinched_blocks(1, outer="relaxation", tolerance=1e-2)
    scene |= {"checkpoint": {"iterations": 2}, "output": {"figures": False}}
    go_on_from_checkpoints(scene, tmp_path, slice(2), ())


@pytest.mark.slow
def test_a_shaft_that_its_bush_carries_far_does_not_turn():
    """It goes with the bush to where it lay in it, as its frame has moved by other motions than that which is held."""
    scene = shaft((40, 46), [0.0, -3.79], 1)
    scene["body"][1]["motion"] = [{"shift": [3.0, 4.0], "history": "carry"}]
    scene["history"] = {"carry": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 0.0, 1.0]}}
    scene["time"] = {"motions": "far", "points": [1.0, 2.0], "steps": 4}
    answer = certified(scene)
    (held,) = answer.summary["held_motions"]
    assert held["motion"].startswith("shaft can turn counterclockwise")
    frame = answer.solved.assembly.frames["shaft"]
    place = frame.at(np.array([0.0, -0.05]))
    assert place == pytest.approx([3.0, 4.0 - 0.05], abs=0.02)  # within what the contact yields
    assert frame.at(np.array([10.0, -0.05])) - place == pytest.approx([10.0, 0.0], abs=1e-6)
    assert answer.summary["contacts"]["shaft-bush"]["force"][1] == pytest.approx(1000.0, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("around", "order"),
    [
        ((40, 46), 1),
        ((36, 40), 2),
        ((40, 40), 1),
        ((60, 60), 2),
    ],
)
def test_a_shaft_in_a_split_bush_is_that_in_a_whole_one(around, order):
    """Below the shaft both halves press on one of its nodes, where they are bonded: how they share its force changes
    next to nothing, so that one of them opens where the mesh is not its own mirror image."""
    answer, whole = certified(split(around, order)), certified(shaft(around, [0.0, -3.79], order))
    assert answer.summary["outer_iterations"] <= 25  # 47 to 105, or not converged, before
    moved = [each.summary["bodies"]["shaft"]["displacement_max"] for each in (answer, whole)]
    assert moved[0] == pytest.approx(moved[1], rel=0.02)
    carried = [answer.summary["contacts"][name]["force"] for name in ("shaft-left", "shaft-right")]
    assert np.sum(carried, axis=0) == pytest.approx([0.0, 1000.0], abs=10.0)  # 84 π · 3.79 N
    assert abs(carried[0][0]) == pytest.approx(abs(carried[1][0]), rel=1e-6)


@pytest.mark.parametrize(
    ("around", "method"),
    [
        (24, {"tolerance": 1e-12}),
        seldom(24, {"compliance": "iterative"}),
        *(seldom(around, {"tolerance": 1e-10}) for around in (40, 60)),
        seldom(40, {"compliance": "iterative"}),
    ],
)
def test_shares_of_a_force_settle_to_any_tolerance(around, method):
    """Both normals at the shared node differ by a mesh's error: an exchange of forces of the halves and their bond
    moves its sides by 1e-8 of what one of the forces does, and yet the answer is one that obeys the laws."""
    answer = certified(split((around, around), 2) | {"method": method})
    assert answer.summary["outer_iterations"] <= 25
    assert answer.solved.solution.outer.history[-1].residual < 1e-9
    below = [
        state.normal_force[np.hypot(*(state.interface.xy - [0.0, -10.05]).T).argmin()]
        for name, state in answer.contacts.items()
        if name.startswith("shaft")
    ]
    assert min(below) == 0.0 < max(below)


@pytest.mark.parametrize("d", [2, 3])
def test_a_half_that_only_a_pretension_without_force_holds_stays(d):
    """The half moves as far as the offset, so that rounding decides which of both is told as the one that moves."""
    scene = bar(d, force=0.0, along=[1.0] + [0.0] * (d - 1))
    del scene["body"][1]["clamp"]
    answer = certified(scene)
    (held,) = answer.summary["held_motions"]
    assert held["body"] in ("two", "pretension of cut")
    assert "two can move along" in held["motion"]
    assert answer.bodies["two"].displacement == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e5])
def test_slides_are_driven_by_more_than_rounding_of_their_bound(size):
    """Turns are not asked: errors of normals may bear them."""
    for share, driven in ((0.9, False), (1.1, True)):
        moment = share * IMBALANCE * size
        for way, asked in (("along x", True), ("turn about (0, 0)", False)):
            one = held.HeldMotion("pin", f"pin can {way} without", moment, size, False)
            assert held.slides([one]) == (driven and asked)
