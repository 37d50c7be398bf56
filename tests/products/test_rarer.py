"""What scenes of rarer kinds rest on: numbers beside the answer, and rules at their limits."""

from types import SimpleNamespace

import numpy as np
import pytest
from decks import STEEL, grid
from decks import step as deck_step
from kinds import Kind
from mpi4py import MPI
from scenes import COULOMB, FLOOR, certified, rectangle, to_toml

from ddmpi.coupling.team import Team
from ddmpi.decks.scene import import_deck
from ddmpi.errors import InputError, SolverError
from ddmpi.interface.interface import check_overlap
from ddmpi.interface.law import CoulombLaw
from ddmpi.interface.state import slip_start, touching
from ddmpi.mesh.mesh import Mesh, refuse_folded
from ddmpi.results.tables import side_means
from ddmpi.scene.motions import frames_of
from ddmpi.scene.reader import read_scene
from ddmpi.scene.time import History, most_loaded


def test_a_cell_that_folds_at_its_corner_alone_is_refused():
    """The middle of a side nearer to a corner than a quarter of the side turns the cell over there, and only there."""

    def triangle(middle: float) -> Mesh:
        corners = np.array([[0.0, 0.0], [1.3, 0.2], [0.3, 1.1]])
        ends = [(0, 1), (1, 2), (0, 2)]
        middles = np.array([corners[[i, j]].mean(axis=0) for i, j in ends])
        middles[0] = corners[0] + middle * (corners[1] - corners[0])
        points = np.vstack([corners, middles])
        numbers = {(0, 1): 3, (1, 2): 4, (0, 2): 5}
        sides = {
            name: np.array([[*side, numbers[side]]]) for name, side in zip("abc", ends, strict=True)
        }
        return Mesh(points, np.array([[0, 1, 2, 3, 4, 5]]), sides)

    refuse_folded(triangle(0.26), "mesh")
    with pytest.raises(InputError, match="folds"):
        refuse_folded(triangle(0.24), "mesh")


@pytest.mark.parametrize("axisymmetric", [False, True])
def test_means_over_sides_are_those_of_their_area(axisymmetric):
    """Around an axis a stress counts by the circumference at which it acts: ∫ σ r ds / ∫ r ds."""
    ends = np.array([[0.3, 0.1], [0.9, -0.2]])
    places = np.array([[*ends, ends.mean(axis=0)]])
    t, weights = np.polynomial.legendre.leggauss(4)
    t = 0.5 * (1.0 + t)
    shares = weights * ((1 - t) * 0.3 + t * 0.9 if axisymmetric else 1.0)
    mean = shares @ (7.0 + 4.0 * t) / shares.sum()
    assert side_means(np.array([[7.0, 11.0, 9.0]]), places, axisymmetric) == pytest.approx([mean])


def test_pictures_show_the_step_of_the_largest_factor_whatever_its_sign():
    """Each history counts by its factors over the largest, which may be negative: 1.2, 1.6 and 0.05 here."""
    times = [1.0, 2.0, 2.3]
    way = History(times=times, factors=[-2.0, -1.2, 0.1])
    load = History(times=times, factors=[0.6, 3.0, 0.0])
    assert times[most_loaded([way, load], times)] == 2.0


def test_a_node_that_touches_ahead_slides_no_more_than_its_step():
    """The touching-time correction foresees one step: what touches later begins no later than that, and what stands
    still touches nothing."""
    law = CoulombLaw(3, np.arange(3), 1, np.array([0.3, 0.4, 0.2]))
    closed = np.array([-0.2, -5.0, -0.7, 0.11, -0.06, 0.09])  # gaps of 0.2, 5 and 0.7
    rate = np.array([0.5, 0.5, 0.0, 0.3, 0.3, 0.0])  # two of them close by 0.5 in a step
    assert touching(law, np.zeros(6), closed, rate, 0.7) == pytest.approx([0.4, 0.7, 0.0])
    # its slip counts from where it will have gone by then
    start = slip_start(law, np.zeros(6), closed, rate, 0.7)
    assert start == pytest.approx([0.0, 0.0, 0.0, 0.11 + 0.12, -0.06 + 0.21, 0.09])


def test_a_free_shift_goes_along_the_axes_of_the_world():
    """A body turned by 90 degrees that has gone freely along x has done so along the scene's x."""
    scene = Kind("strain", 1, False).scene(
        rectangle(
            "block",
            (0.4, 0.3),
            (0.5, 0.7),
            (1, 1),
            clamp=["bottom"],
            motion=[{"turn": 90.0, "pivot": [0.2, 0.1]}, {"free": ["x"]}],
        ),
        rigid=[FLOOR],
        contact=[{"bodies": ["block", "floor"], "on": ["right"]}],
        time={"points": [1.0], "steps": 1, "motions": "far"},
    )
    settled = read_scene("scene of a test", to_toml(scene))
    gone = {"block": np.array([0.11, 0.0, 0.0])}
    frame = frames_of(settled, 1.0, gone)["block"]
    # (0.9, 0.3) about (0.2, 0.1) by a quarter is (0.2 − 0.2, 0.1 + 0.7)
    assert frame.at(np.array([[0.9, 0.3]])) == pytest.approx(np.array([[0.11, 0.8]]))


def test_the_last_time_of_a_history_ends_a_leg():
    """A factor that stays after its last time changes its slope there."""
    assert History(times=[0.2, 0.9], factors=[0.0, -1.3]).kinks == [0.2, 0.9]
    scene = Kind("strain", 1, False).scene(
        rectangle(
            "block",
            (0.4, 0.3),
            (0.5, 0.7),
            (1, 1),
            clamp=["bottom"],
            traction=[{"on": "top", "pressure": 3e5, "history": "way"}],
        ),
        history={"way": {"times": [0.2, 0.9], "factors": [0.0, -1.3]}},
        time={"points": [1.7], "steps": 1},
    )
    steps = certified(scene).summary["steps"]
    assert [step["time"] for step in steps] == pytest.approx([0.2, 0.9, 1.7])


@pytest.mark.parametrize(("kind", "depth"), [("CPS4", 0.4), ("CPE4", 0.4), ("CAX4", 1.0)])
def test_a_pretension_of_a_deck_is_per_depth(tmp_path, kind, depth):
    """The force at the node of a section is that of the whole part, 0.4 deep, or of the whole circumference."""
    deck = grid("A", (2, 4), (1.0, 4.0), kind=kind) + STEEL
    deck += "*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n" + ("0.4\n" if kind != "CAX4" else "")
    deck += "*NODE\n900, 9., 9.\n*SURFACE, NAME=CUT\n3, S3\n4, S3\n"
    deck += "*PRE-TENSION SECTION, SURFACE=CUT, NODE=900\n*BOUNDARY\nA_Y0, 2\nA_Y1, 2\nA_X0, 1\n"
    path = tmp_path / "deck.inp"
    path.write_text(deck + deck_step("*CLOAD", "900, 1, 50."))
    import_deck(path, tmp_path / "scene")
    answer = certified(tmp_path / "scene" / "scene.toml")
    (contact,) = answer.summary["contacts"].values()
    assert contact["pretension"]["force"] == pytest.approx(50.0 / depth)
    reaction = answer.summary["bodies"]
    assert max(abs(one["reaction"][1]) for one in reaction.values()) == pytest.approx(50.0 / depth)


def test_ranks_of_a_body_are_asked_only_until_their_end():
    """What a closed model has not worked out cannot be had from it any more."""
    team = Team(MPI.COMM_SELF, [0], 1)
    assert team.do("room") > 0.0
    team.end()
    with pytest.raises(SolverError, match="the ranks of this body have ended their work"):
        team.do("room")


@pytest.mark.mpi(ranks=2)
def test_a_loose_body_on_several_ranks_is_in_equilibrium(comm):
    """A block on a floor, on two ranks: the floor bears its loads."""
    scene = {
        "body": [
            rectangle(
                "block",
                (0.7, 0.0),
                (1.5, 0.5),
                (6, 3),
                traction=[{"on": "top", "value": [2.1e4, -3e5]}],
            )
        ],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"], "friction": COULOMB}],
    }
    force = certified(scene, comm).summary["contacts"]["block-floor"]["force"]
    assert force == pytest.approx([-3.15e4, 4.5e5], rel=1e-6)


def of_two(**contact) -> dict:
    """A block on one that is a little higher, with the ways of the upper one's top and the other's bottom."""
    ways = contact.pop("ways", (0.0, 0.0))
    above = [{"on": "top", "x": ways[0], "y": -1e-5}]
    below = [{"on": "bottom", "x": ways[1], "y": 0.0}]
    return {
        "body": [
            rectangle("upper", (0.0, 1.1), (3.0, 1.0), (12, 2), clamp=above),
            rectangle("lower", (0.0, 0.0), (3.0, 1.1), (12, 2), clamp=below),
        ],
        "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"]} | contact],
    }


@pytest.mark.parametrize(("ways", "far"), [((0.3, -0.1), True), ((0.3, 0.3), False)])
def test_bodies_that_are_carried_along_do_not_slide(ways, far):
    """What counts is how far one moves past the other, here by 1.6 cells, or not at all; a node has 12/13 of a cell."""
    warnings = certified(of_two(ways=ways)).summary["warnings"]
    slid = [warning for warning in warnings if "node pairs slid" in warning]
    assert len(slid) == far
    assert all("up to 1.73 times the distance" in each for each in slid)


@pytest.mark.parametrize("heights", [(1.1, 1.0), (1.0, 1.1)])
def test_of_bodies_that_face_away_the_thinner_one_is_named(heights):
    """Whichever it is: names in the wrong order mean an overlap of both heights."""
    contact = SimpleNamespace(
        name="seam",
        gap=np.array([-2.1]),
        normal=np.array([[0.0, 1.0]]),
        fixed=SimpleNamespace(gap=np.empty(0), normal=np.empty((0, 2))),
        law=SimpleNamespace(two_sided=False),
        itself=False,
    )
    sides = [
        SimpleNamespace(body=f"of {height} m", extent=np.array([3.0, height])) for height in heights
    ]
    with pytest.raises(InputError, match=r"overlap by 2.1 m, and the depth of 'of 1.0 m' is 1 m"):
        check_overlap(contact, *sides)


def test_points_that_carry_a_body_are_told():
    """A beam on its two lower corners: each bears half of its load of 6e4 N/m, which no side does."""
    beam = rectangle(
        "beam",
        (0.3, 0.2),
        (2.0, 0.5),
        (8, 2),
        clamp=[{"on": "left & bottom", "x": 0.0, "y": 0.0}, {"on": "right & bottom", "y": 0.0}],
        traction=[{"on": "top", "value": [0.0, -3e4]}],
    )
    told = certified({"body": [beam]}).summary["warnings"]
    words = "body.beam.clamp: the point 'left & bottom' carries a force of 3e+04 N/m"
    assert any(warning.startswith(words) for warning in told)
