"""`ddmpi import`: what a deck says in several places is read together, or refused with the lines."""

import itertools
import re

import numpy as np
import pytest
from decks import STEEL, grid, step
from mpi4py import MPI
from test_import import (
    BOX,
    COUPLED,
    LAW,
    PAIR,
    PRESS,
    ROLLERS,
    SECTION,
    bolt,
    imported,
    refused,
    solved,
    stack,
)

import ddmpi
from ddmpi.decks.cards import DeckError
from ddmpi.decks.deck import Deck
from ddmpi.scene.formulas import evaluate

PULL = step("*CLOAD", "A_Z1, 3, 1.")
TWO = (
    grid("A", (2, 1, 1), (2.0, 1.0, 1.0))
    + grid("B", (2, 1, 1), (2.0, 1.0, 1.0), [3.0, 0.0, 0.0], 101)
    + STEEL
    + SECTION
    + "*SOLID SECTION, ELSET=B, MATERIAL=STEEL\n*NODE\n900, 2.5, 0.5, 0.5\n901, 0., 0., 9.\n"
    "*SURFACE, NAME=SA, TYPE=NODE\nA_X1\n*SURFACE, NAME=SB, TYPE=NODE\nB_X0\n"
    "*BOUNDARY\nA_X0, 1, 3\nB_X1, 1, 3\n"
)
KINEMATIC = "*COUPLING, REF NODE=900, SURFACE={}, CONSTRAINT NAME=C\n*KINEMATIC\n1, 3\n"
SPREAD = KINEMATIC.replace("KINEMATIC\n1, 3", "DISTRIBUTING\n1, 3")
RIGID = "*RIGID BODY, NSET={}, REF NODE=900\n"
SETS = {
    "couplings": KINEMATIC.format("SA") + KINEMATIC.format("SB"),
    "rigid bodies": RIGID.format("A_X1") + RIGID.format("B_X0"),
    "one of each": RIGID.format("A_X1") + KINEMATIC.format("SB"),
    "one set of two bodies": "*NSET, NSET=AB\nA_X1, B_X0\n" + RIGID.format("AB"),
    "a node of rotations": (RIGID.format("A_X1") + RIGID.format("B_X0")).replace(
        "900\n", "900, ROT NODE=901\n"
    ),
}


@pytest.mark.every(3)
@pytest.mark.parametrize("sets", SETS.values(), ids=SETS)
def test_a_reference_node_of_several_faces_is_one_rigid_body(tmp_path, sets):
    """It has one force, half of which each of two equal clamps bears, and no turn; each node moves with it."""
    deck = TWO + sets + step("*CLOAD", "900, 3, 100.")
    scene, lists = imported(tmp_path, deck)
    assert [rigid["force"] for rigid in scene["rigid"]] == [[0.0, 0.0, 100.0]]
    assert [contact["bodies"] for contact in scene["contact"]] == [["A", "rigid"], ["B", "rigid"]]
    assert ("CalculiX lets each turn by itself" in lists) == (
        sets.count("\n*") > 0 and "ROT" not in sets and "AB" not in sets
    )
    summary = solved(tmp_path, deck).summary
    for name in "AB":
        assert summary["bodies"][name]["reaction"] == pytest.approx(
            [0.0, 0.0, -50.0], rel=1e-6, abs=0.05
        )
    assert summary["rigid"]["rigid"]["turn"] == pytest.approx([0.0] * 3, abs=1e-6)
    assert summary["rigid"]["rigid"]["force"] == pytest.approx(
        [0.0, 0.0, -100.0], rel=1e-9, abs=1e-9
    )


@pytest.mark.parametrize("apart", [False, True])
def test_two_ends_of_a_body_are_one_rigid_body(tmp_path, apart):
    """Both ends of a bar that is held in the middle have the motion of their node: parallel faces are no plane, whether
    they are one set or two."""
    deck = grid("A", (4, 1, 1), (4.0, 1.0, 1.0)) + STEEL + SECTION + "*NODE\n900, 2., 0.5, 0.5\n"
    deck += "*NSET, NSET=MID\n3, 8, 13, 18\n*NSET, NSET=ENDS\nA_X0, A_X1\n*BOUNDARY\nMID, 1, 3\n"
    sets = RIGID.format("A_X0") + RIGID.format("A_X1") if apart else RIGID.format("ENDS")
    deck += sets + step("*CLOAD", "900, 3, 100.")
    assert imported(tmp_path, deck)[0]["rigid"][0]["shape"] == "node"
    answer = solved(tmp_path, deck)
    fields, moved = answer.bodies["A"], answer.summary["rigid"]["rigid"]
    for end in (0.0, 4.0):
        at = np.isclose(fields.points[:, 0], end)
        turned = np.cross(moved["turn"], fields.points[at] - [2.0, 0.5, 0.5])
        size = np.abs(fields.displacement).max()
        assert fields.displacement[at] == pytest.approx(
            moved["displacement"] + turned, abs=0.05 * size
        )
        assert fields.displacement[at][:, 2].mean() > 0.5 * size


def test_a_given_motion_is_that_of_all_faces(tmp_path):
    """A reference node with all six displacements moves the faces of both bodies by one rigid motion."""
    moved = ("900, 1, 2", "900, 3, 3, 0.01", "900, 4, 4", "900, 5, 5, 0.002", "900, 6, 6")
    scene, _ = imported(tmp_path, TWO + SETS["couplings"] + step("*BOUNDARY", *moved))
    a, b = ([clamp for clamp in body["clamp"] if clamp["on"] == "rigid"] for body in scene["body"])
    assert a == b and "rigid" not in scene
    z = np.array([2.0, 3.0])
    assert evaluate(a[0]["z"], z) == pytest.approx(0.01 - 0.002 * (z - 2.5))


def test_forces_that_given_displacements_take_change_nothing(tmp_path):
    """They are told, whether all of the displacements are given or some, and whatever history they have."""
    moved = "*BOUNDARY\n900, 1, 2\n900, 3, 3, 0.01\n900, 4, {}\n*CLOAD"
    for last, words in (6, "900, 3, 5.\n900, 4, 7."), (3, "900, 3, 5."):
        held = moved.format(last) if last > 3 else moved.replace("900, 4, {}\n", "")
        deck = TWO + SETS["couplings"]
        plain, _ = imported(tmp_path, deck + step(held) + step())
        for steps in step(held, words) + step(), step(held) + step("*CLOAD", words):
            scene, lists = imported(tmp_path, deck + steps)
            assert scene == plain
            assert "forces along displacements that are given change nothing" in lists


def test_forces_at_nodes_that_are_held_change_nothing(tmp_path):
    """They are told, and left out, but for those of a whole face, which are what a pressure on all of it is."""
    held = BOX + "*BOUNDARY\nA_X0, 1, 3\n"
    plain, _ = imported(tmp_path, held + step("*CLOAD", "33, 3, 2."))
    words = "forces at nodes along displacements that are given change nothing"
    for load in "33, 3, 2.\n1, 3, 5.", "33, 3, 2.\n28, 3, 5.\n31, 2, 1.":
        scene, lists = imported(tmp_path, held + step("*CLOAD", load))
        assert scene == plain and words in lists
    scene, lists = imported(tmp_path, held + step("*CLOAD", "A_Z1, 3, 2."))
    assert scene["body"][0]["traction"][0]["force"] == [0.0, 0.0, 18.0] and words not in lists
    steps = step("*DLOAD", "9, P2, 1.", "*CLOAD", "A_X0, 3, 5.") + step("*CLOAD, OP=NEW")
    scene, lists = imported(tmp_path, held + steps)
    assert len(scene["history"]) == len(scene["body"][0]["traction"]) == 1 and words in lists
    plain, no = imported(tmp_path, BOX + ROLLERS + step("*CLOAD", "9, 1, 2."))
    scene, lists = imported(tmp_path, BOX + ROLLERS + step("*CLOAD", "9, 1, 2.\n9, 3, 5."))
    assert scene == plain and words in lists and words not in no


def test_what_is_twice_in_a_set_has_its_load_once(tmp_path):
    """And it is told, as CalculiX adds it each time."""
    sets = "*NSET, NSET=N\n36, A_Z1\n*ELSET, ELSET=E\n9, 9\n*SURFACE, NAME=S\n9, S2\nE, S2\n"
    words = "a set or surface has members several times, and they have the load once"
    for load, once in ("*CLOAD\n{}, 3, 1.", "NA_Z1"), ("*DLOAD\n{}, P2, 1.", "E9"):
        (plain, no), (scene, lists) = (
            imported(tmp_path, BOX + ROLLERS + sets + step(load.format(name)))
            for name in (once[1:], once[0])
        )
        assert scene == plain and words in lists and words not in no
    assert words in imported(tmp_path, BOX + ROLLERS + sets + step("*DSLOAD", "S, P, 1."))[1]


def test_a_rigid_body_in_the_plane(tmp_path):
    """Force and moment of a reference node in the plane are per depth; the turn is the component 6."""
    deck = grid("A", (8, 2), (4.0, 1.0)) + STEEL + SECTION + "0.5\n*NODE\n900, 6., 0.5\n"
    deck += "*RIGID BODY, NSET=A_X1, REF NODE=900\n*BOUNDARY\nA_X0, 1, 2\n"
    deck += step("*CLOAD", "900, 2, -3.", "900, 6, 5.")
    (rigid,) = imported(tmp_path, deck)[0]["rigid"]
    coupled = "*SURFACE, NAME=END\n8, S2\n16, S2\n" + KINEMATIC.format("END").replace("1, 3", "{}")
    for components, found in ("1, 2", [rigid]), ("1, 2\n6", [rigid]), ("1", None):
        text = deck.replace(RIGID.format("A_X1"), coupled.format(components))
        if found:
            assert imported(tmp_path, text)[0]["rigid"] == found
        else:
            assert "a coupling of some components only" in refused(tmp_path, text)
    assert (rigid["force"], rigid["moment"], rigid["pivot"]) == ([0.0, -6.0], 10.0, [6.0, 0.5])
    assert rigid["shape"] == "node" and rigid["free"] == ["x"]
    reaction = solved(tmp_path, deck).summary["bodies"]["A"]["reactions"]["A_X0"]
    assert reaction["force"] == pytest.approx([0.0, 6.0], rel=1e-6, abs=1e-6)
    assert reaction["moment"] == pytest.approx(36.0 - 10.0, rel=1e-6)
    moved = deck.replace("*STEP", "*BOUNDARY\n900, 1, 2\n900, 6, 6, 0.1\n*STEP").replace(
        "*CLOAD", "*NODE PRINT"
    )
    clamp = imported(tmp_path, moved)[0]["body"][0]["clamp"][1]
    assert clamp == {
        "on": "rigid",
        "x": "0.05 + (-0.1) * y",
        "y": "-0.6000000000000001 + (0.1) * x",
    }
    assert "loaded or moved out of the plane" in refused(
        tmp_path, deck.replace("900, 6, 5.", "900, 3, 5.")
    )
    assert "around an axis" in refused(
        tmp_path, deck.replace("CPE4", "CAX4").replace("0.5\n*NODE", "*NODE")
    )


LOST = "*NSET, NSET=LOST\n77777, 77778\n"
APART = [
    (LOST + RIGID.format("LOST") + RIGID.format("B_X0"), "*RIGID BODY: the set LOST is empty"),
    (
        "*SURFACE, NAME=S, TYPE=NODE\n901\n" + KINEMATIC.format("S") + KINEMATIC.format("SB"),
        "one has no node of a body",
    ),
    (SPREAD.format("SA") + SPREAD.format("SB"), "have one reference node; how its force divides"),
    (
        KINEMATIC.format("SA") + SPREAD.format("SB"),
        "have one reference node; how its force divides",
    ),
    (
        RIGID.format("A_X1") + RIGID.format("B_X0")[:-1] + ", ROT NODE=901\n",
        "turn by different nodes",
    ),
    (
        RIGID.format("A_X1") + RIGID.format("A_X1").replace("900", "901"),
        "some of its nodes are in the set of line",
    ),
    (
        (RIGID.format("A_X1") + RIGID.format("B_X0").replace("900", "902")).replace(
            "\n", ", ROT NODE=901\n"
        )
        + "*NODE\n902, 3., 0., 0.\n",
        "its node of rotations is also that of line",
    ),
    (
        "*NSET, NSET=ALSO\nA_X1, 901\n"
        + RIGID.format("ALSO")
        + RIGID.format("B_X0").replace("900", "901"),
        "the reference node of one set is in the other",
    ),
    (
        RIGID.format("A_X1").replace("900", "101"),
        "its reference node is one of a body, and not one of the set",
    ),
    (
        RIGID.format("A_X1") + "*NSET, NSET=R\n900\n*TRANSFORM, NSET=R\n0., 1., 0., -1., 0., 0.\n",
        "its reference node has a *TRANSFORM",
    ),
    (
        "*COUPLING, REF NODE=900, SURFACE=SA\n",
        "*COUPLING: neither *KINEMATIC nor *DISTRIBUTING follows it",
    ),
    ("*KINEMATIC\n1, 3\n", "*KINEMATIC: it does not follow *COUPLING"),
    (KINEMATIC.format("SA") + "*DISTRIBUTING\n", "*DISTRIBUTING: it does not follow *COUPLING"),
    (KINEMATIC.format("SA").replace("1, 3", "1, 1\n3, 3"), "a coupling of some components only"),
    (
        SPREAD.format("SA").replace("ING\n", "ING, WEIGHTING METHOD=LINEAR\n"),
        "weights that are not uniform",
    ),
]


@pytest.mark.parametrize("sets, words", APART)
def test_sets_that_are_no_one_rigid_body_are_refused(tmp_path, sets, words):
    """Where they have one node, or nodes of each other, in ways that no scene has."""
    load = "101" if "REF NODE=101" in sets else "900"
    assert words in refused(tmp_path, TWO + sets + step("*CLOAD", f"{load}, 3, 100."))


def test_components_of_a_coupling_in_several_lines(tmp_path):
    """They count together."""
    sets = KINEMATIC.format("SA").replace("1, 3", "1\n2, 2\n3")
    assert len(imported(tmp_path, TWO + sets + step("*CLOAD", "900, 3, 1."))[0]["rigid"]) == 1


def test_a_reference_node_in_its_own_set_has_its_force_once(tmp_path):
    """The load and the supports of such a node are those of the rigid partner alone."""
    sets = RIGID.format("A_X1").replace("900", "3") + "*BOUNDARY\n3, 1\n"
    scene, _ = imported(tmp_path, TWO + sets + step("*CLOAD", "3, 3, 8."))
    assert scene["rigid"][0]["force"] == [0.0, 0.0, 8.0] and scene["rigid"][0]["free"] == ["y"]
    assert "traction" not in scene["body"][0] and [*scene["body"][0]["clamp"][0]] == [
        "on",
        "x",
        "y",
        "z",
    ]
    assert len(scene["body"][0]["clamp"]) == 1


def test_loads_of_a_distributing_coupling_may_change_in_different_ways(tmp_path):
    """A force in the first step, and another one across it with a moment in the second; not of a rigid body."""
    loads = step("*CLOAD", "900, 3, 100.") + step("*CLOAD", "900, 2, 40.", "900, 4, 7.")
    deck = TWO + SPREAD.format("SA") + loads
    scene, _ = imported(tmp_path, deck)
    courses = [
        scene["history"][load["history"]]["factors"] for load in scene["body"][0]["traction"]
    ]
    assert courses == [[0.0, 1.0, 1.0]] * 2 + [[0.0, 0.0, 1.0]] * 2
    answer = solved(tmp_path, deck)
    held = answer.summary["bodies"]["A"]["reactions"]["A_X0"]
    force = np.array([0.0, 40.0, 100.0])
    moment = np.cross([2.5, 0.5, 0.5], force) + np.array([7.0, 0.0, 0.0])
    assert held["force"] == pytest.approx(-force, rel=1e-6, abs=1e-6)
    assert held["moment"] == pytest.approx(-moment, rel=1e-6, abs=1e-5)


@pytest.mark.slow
def test_loads_of_a_rigid_body_may_change_in_different_ways(tmp_path):
    """They move it as they do at once, also where a displacement comes first; displacements may not."""
    first, more = ("900, 3, 100.",), ("900, 2, 40.", "900, 4, 7.")
    sets = TWO + KINEMATIC.format("SA")
    scene, _ = imported(tmp_path, sets + step("*CLOAD", *first) + step("*CLOAD", *more))
    courses = [
        scene["history"][load["history"]]["factors"] for load in scene["body"][0]["traction"]
    ]
    assert courses == [[0.0, 1.0, 1.0]] * 2 + [[0.0, 0.0, 1.0]] * 2
    moved = "*BOUNDARY\n900, 3, 3, 0.01\n*CLOAD"
    for before, after in (
        (step("*CLOAD", *first) + step("*CLOAD", *more), step("*CLOAD", *first, *more)),
        (step(moved, "900, 5, 3.") + step("*CLOAD", *more), step(moved, "900, 5, 3.", *more)),
    ):
        parted, at_once = (
            solved(tmp_path, sets + steps).bodies["A"].displacement for steps in (before, after)
        )
        assert abs(parted - at_once).max() < 1e-9 * abs(at_once).max()
    other = step("*BOUNDARY", "900, 2, 3, 0.01") + step("*BOUNDARY", "900, 3, 3, 0.02")
    scene, lists = imported(tmp_path, sets + other)
    assert (
        scene
        == imported(tmp_path, sets + step("*BOUNDARY", "900, 2, 2, 0.01", "900, 3, 3, 0.02"))[0]
    )
    words = "its loads and displacements change in different ways"
    assert f"{words}: only the state at the end of the last step is computed" in lists


def test_a_large_turn_with_nlgeom_is_refused(tmp_path):
    """Turns are small in a scene."""
    turn = ("*BOUNDARY", "900, 1, 5", "900, 6, 6, 0.5")
    deck = TWO + RIGID.format("A_X1")
    assert "it turns by 0.5, and turns are small" in refused(
        tmp_path, deck + step(*turn, options=", NLGEOM")
    )
    assert imported(tmp_path, deck + step(*turn))


ALIKE = "there is one of the name"
TWICE = [
    (COUPLED + "*NSET, NSET=G\nA_X0\n*RIGID BODY, NSET=G, REF NODE=901\n", "there is no node 901"),
    (BOX + "*BOUNDARY\nB.A_X1, 1\n", "*BOUNDARY: there is no set B.A_X1"),
    (BOX + "*BOUNDARY\n901, 1\n", "*BOUNDARY: there is no node 901"),
    (BOX + "*SOLID SECTION, ELSET=99, MATERIAL=STEEL\n", "*SOLID SECTION: there is no element 99"),
    (
        COUPLED.replace("UP, S2", "UP, S7") + KINEMATIC.format("TOP") + "*ELSET, ELSET=TIP\n9\n",
        "the surface TOP has faces that its elements do not have",
    ),
    (
        BOX + "*SURFACE, NAME=T, TYPE=NODE\nA_Z1\n*SURFACE, NAME=T\n10, S2\n",
        "a surface T on line 131 already",
    ),
    (BOX + 2 * "*AMPLITUDE, NAME=UP\n0., 0., 1., 1.\n", f"{ALIKE} UP on line 131 already"),
    (BOX + 2 * "*ORIENTATION, NAME=O\n1., 0., 0., 0., 1., 0.\n", f"{ALIKE} O on line 131 already"),
    (
        BOX + STEEL.replace("STEEL", "St eel"),
        "there are two of the name ST EEL; the other is on line",
    ),
    (BOX + LAW + LAW, "there are two of the name I; the other is on line 131"),
    (
        BOX.replace("*DENSITY", "*ELASTIC\n1., 0.\n*DENSITY"),
        "there is one of this *MATERIAL on line",
    ),
    (
        BOX + LAW + "*FRICTION\n0.1\n*FRICTION\n0.2\n",
        "there is one of this *SURFACE INTERACTION on line 132",
    ),
    (BOX + "*NODE\n1, 0., 0., 1.\n", "*NODE: the node 1 is there twice, at two places"),
    (
        BOX
        + "*TRANSFORM, NSET=A_Z1\n0., 1., 0., -1., 0., 0.\n*TRANSFORM, NSET=A_X1\n1., 0., 0., 0., 1., 0.\n",
        "has another *TRANSFORM on line 131",
    ),
    (BOX + "*NSET, NSET=G, GENERATE\n36, 28\n", "it generates numbers from 36 to 28"),
    (BOX + "*BOUNDARY, OP=NEW, OP=MOD\nA_Z0, 3\n", "*BOUNDARY: it has two OP"),
    (
        "*PART, NAME=P\n*END PART\n*PART, NAME=p\n*END PART\n" + BOX,
        "*PART: there are two of the name p",
    ),
    (
        "*PART, NAME=P\n*END PART\n*ASSEMBLY, NAME=A\n"
        + 2 * "*INSTANCE, NAME=I, PART=P\n*END INSTANCE\n"
        + "*END ASSEMBLY\n",
        "two of its instances have one name",
    ),
    (BOX + "*AMPLITUDE\n0., 0., 1., 1.\n", "*AMPLITUDE: it lacks NAME"),
    (BOX + "*END STEP\n", "*END STEP: no *STEP begins before it"),
    (BOX + LAW + "*FRICTION\n-0.1\n", "a coefficient of friction, which is not negative"),
    (BOX.replace("0.3\n", "0.7\n", 1), "its scene: body.A.material.poisson"),
]


@pytest.mark.parametrize("deck, words", TWICE)
def test_what_is_there_twice_is_refused(tmp_path, deck, words):
    """With the line of the other, where it may mean either."""
    assert words in refused(tmp_path, deck + ROLLERS + PULL)


SAME = [
    ("\n*DENSITY", "\n*ELASTIC\n210000., 0.3\n*DENSITY"),
    ("*BOUNDARY", 2 * SECTION + "*BOUNDARY"),
    ("*BOUNDARY", "*NODE\n1, 0., 0., 0.\n*BOUNDARY"),
    ("*CLOAD", "*CLOAD,"),
    ("A_Z1, 3, 1.", "A_Z1, 3, 1.\nA_Z1, 4, 0.\nA_Z1, 5, 0."),
    ("*STATIC", "*STATIC\n*STATIC"),
    ("*NSET, NSET=A_Z1", "*NSET, NSET=A_ Z1"),
    ("A_Z0, 3", "A_Z0, 3\nA_Z0, 5, 6"),
    ("A_Z0, 3", "A_Z0, 3\na _z0 , 3, 3, 0."),
    ("*SOLID SECTION, ELSET=A, MATERIAL=STEEL", "*SOLID SECTION, ELSET=a, MATERIAL=S teel"),
    ("*DENSITY", "*CONDUCTIVITY\n50.\n*SPECIFIC HEAT\n4.5E8\n*DAMPING, ALPHA=1.\n*DENSITY"),
    ("*END STEP", "*END STEP\n*STEP, PERTURBATION\n*FREQUENCY\n10\n*BOUNDARY\nA_X1, 1\n*END STEP"),
    ("*END STEP", "*END STEP\n*STEP\n*BUCKLE\n10\n*CLOAD\nA_X1, 1, 1.\n*END STEP"),
    (
        "*END STEP",
        "*END STEP\n*STEP\n*BUCKLE\n10\n*TRANSFORM, NSET=A_Z1\n0., 0., 1., 1., 0., 0.\n"
        "*PRE-TENSION SECTION, NODE=36, SURFACE=NO\n*MPC\nBEAM, A_Z1, 1\n*END STEP",
    ),
    ("*END STEP", "*FILM, OP=NEW\n*DFLUX\nA, BF, 1.\n*CFLUX\nA_Z1, 11, 1.\n*RADIATE\n*END STEP"),
    (
        "*STEP",
        "*RESTART, WRITE, FREQUENCY=1\n*SECTION CONTROLS, NAME=E, HOURGLASS=ENHANCED\n1., 1.\n*STEP",
    ),
    ("*STATIC", "*STATIC, STABILIZE=0.0002, ALLSDTOL=0.05, CONTINUE=NO"),
    ("*STEP", "*CONTACT CONTROLS, STABILIZE\n*STEP"),
    ("*STEP", "** a\x0cb \x85c \u2028 d\n*STEP"),
]


@pytest.mark.parametrize("old, new", SAME)
def test_what_makes_no_difference(tmp_path, old, new):
    """Things that are there twice and alike, or change no static answer, are no reason to refuse a deck."""
    deck = BOX + ROLLERS + PULL
    assert (
        deck.count(old)
        and imported(tmp_path, deck)[0] == imported(tmp_path, deck.replace(old, new))[0]
    )


RAMPS = "*AMPLITUDE, NAME=UP, SMOOTH=0.2\n0., 0., 1., 1.\n*AMPLITUDE, NAME=DOWN\n0., 1., 1., 0.\n"
TOLD = [
    (
        SECTION,
        SECTION
        + STEEL.replace("STEEL", "SOFT").replace("210000.", "1000.")
        + "*ELSET, ELSET=LOW\n1, 2\n*SOLID SECTION, ELSET=LOW, MATERIAL=SOFT\n",
        "elements that line 130 gives another section have this one",
    ),
    (
        "*END STEP",
        "*CHANGE SOLID SECTION, ELSET=A, MATERIAL=STEEL, ORIENTATION=O\n*CHANGE SOLID SECTION, ELSET=A, MATERIAL=STEEL\n"
        "*END STEP",
        "*CHANGE SOLID SECTION: elements that line 139 gives another section have this one",
    ),
    (
        "*CLOAD",
        "*BOUNDARY\nA_X1, 1, 1, 0.1\nA_X1, 1, 1, 0.2\n*CLOAD",
        "gives another displacement of the same nodes; the last one counts",
    ),
    (
        "*END STEP",
        "*CLOAD\nA_Z1, 3, 2.\n*END STEP",
        "*CLOAD: added to line 137 where places are the same",
    ),
    (
        "A_Z0, 3",
        "A_Z0, 3\nA_Z0, 5, 6",
        "nodes of solids have no turns: components 4 to 6 have no effect",
    ),
    (
        "*DENSITY",
        "*CONDUCTIVITY\n50.\n*DENSITY",
        "*CONDUCTIVITY: left out: heat changes no static answer",
    ),
    (
        "*END STEP",
        "*END STEP\n*STEP\n*FREQUENCY\n10\n*END STEP",
        "*FREQUENCY: this step is left out",
    ),
    (
        "*STEP",
        "*CLOAD\nA_Z1, 1, 1.\n*STEP",
        "it stands in no *STEP, and counts from the beginning of the next",
    ),
    (ROLLERS, "", "no support and no contact holds A"),
    (
        "*CLOAD",
        f"{RAMPS}*BOUNDARY, AMPLITUDE=UP\nA_X1, 1, 1, 0.1\n*BOUNDARY, AMPLITUDE=DOWN\nA_X1, 1, 1, 0.1\n*CLOAD",
        "gives another displacement of the same nodes; the last one counts",
    ),
    (
        "*CLOAD",
        "*TEMPERATURE\nA_Z1, 20.\nA_X1, 0.\nA_Z1, 0.\n*CLOAD",
        "gives another temperature of the same nodes; the last one counts",
    ),
    (
        "*STEP",
        "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nA_Z1, 20.\nA_X1, 0.\n*STEP",
        "some of its nodes have another initial temperature before; the last one counts",
    ),
    (
        "*STEP",
        f"{LAW}*SURFACE BEHAVIOR, PENALTY\n*STEP",
        "PENALTY: hard contact, the stiffness is dropped",
    ),
    (
        "*STEP",
        f"{LAW}*FRICTION, SLIP TOLERANCE=0.005\n0.2\n*STEP",
        "*FRICTION: SLIPTOLERANCE: nodes stick without slip",
    ),
    (
        "*STATIC",
        "*STATIC, STABILIZE",
        "STABILIZE: left out, as equilibria need no damping",
    ),
    (
        "*STEP",
        "*CONTACT CONTROLS, STABILIZE\n*STEP",
        "*CONTACT CONTROLS: left out: how programs iterate changes no answer",
    ),
    ("*STEP", "*STEP, AMPLITUDE=STEP", "its amplitude counts at the end of the step"),
    (
        "*CLOAD",
        f"{RAMPS}*CLOAD, AMPLITUDE=UP",
        "*AMPLITUDE: SMOOTH is dropped: it is straight between its times",
    ),
]


@pytest.mark.parametrize("old, new, words", TOLD)
def test_what_counts_is_told(tmp_path, old, new, words):
    """Where of several the last one counts, or their sum, and what is left out."""
    deck = BOX + ROLLERS + PULL
    assert deck.count(old) >= 1 and words in imported(tmp_path, deck.replace(old, new, 1))[1]


MISSING = [
    ("*NSET, NSET=A_Z1\n77778, 77777, 1\n", "*NSET: there is no node 77777 and 1 more; left out"),
    ("*NSET, NSET=HOLES, GENERATE\n30, 37\n", "*NSET: there is no node 37; left out"),
    ("*ELSET, ELSET=A\n13\n", "*ELSET: there is no element 13; left out"),
    ("*SURFACE, NAME=S\n14, S2\n", "*SURFACE: there is no element 14; left out"),
    ("*SURFACE, NAME=S, TYPE=NODE\n37\n", "*SURFACE: there is no node 37; left out"),
]


@pytest.mark.parametrize("card, words", MISSING)
def test_numbers_that_are_not_there_are_told(tmp_path, card, words):
    """In sets and surfaces, by the line that names them; the scene is that without them."""
    deck = BOX + ROLLERS + PULL.replace("A_Z1", "A_X1")
    (plain, _), (scene, lists) = imported(tmp_path, deck), imported(tmp_path, deck + card)
    assert words in lists.split("changed:")[1] and scene == plain


GROWN = [
    ("*NSET, NSET=HELD, ELSET=E\n", "*ELSET, ELSET=E\n9, 10\n"),
    ("*NSET, NSET=F, ELSET=E\n*NSET, NSET=HELD\nF, 28\n", "*NSET, NSET=F\n36\n"),
    ("*ELSET, ELSET=D\nE\n*NSET, NSET=HELD, ELSET=D\n", "*ELSET, ELSET=E\n9, 10\n"),
]


@pytest.mark.parametrize("sets, more", GROWN)
def test_a_set_has_what_its_sets_have_where_it_stands(tmp_path, sets, more):
    """As in Abaqus and CalculiX; what these get later is told. A set that is made later still has them."""
    deck = BOX + "*ELSET, ELSET=E, GENERATE\n1, 4\n{}*BOUNDARY\nHELD, 1, 3\n" + PULL
    decks = [deck.format(cards) for cards in (sets, sets + more, more + sets)]
    lists = [imported(tmp_path, text)[1] for text in decks]
    files = [(tmp_path / f"{k}" / "deck" / "A.inp").read_text() for k in range(3)]
    plain, scene, after = (text.partition("NSET=HELD")[2].partition("*")[0] for text in files)
    assert scene == plain != after
    words = "has the set as it is there, without these, as in Abaqus and CalculiX"
    assert [words in one.split("changed:")[1] for one in lists] == [False, True, False]


def test_a_surface_has_what_its_sets_have_where_it_stands(tmp_path):
    """A pressure on it is not on elements that its set gets later."""
    top = "*ELSET, ELSET=T\n9, 10\n*SURFACE, NAME=S\nT, S2\n*ELSET, ELSET=T\n11, 12\n"
    push = step("*DSLOAD", "S, P, 3.")
    loads = solved(tmp_path, BOX + ROLLERS + top + push).summary["bodies"]["A"]["loads"]
    assert loads["S"]["force"] == pytest.approx([0.0, 0.0, -1.5])


def test_surfaces_of_one_name_are_one(tmp_path):
    """As in CalculiX, and told; so is one without faces, which has those that no other element has."""
    push = step("*DSLOAD", "T, P, 3.")
    parts = "*SURFACE, NAME=T\n9, S2\n*SURFACE, NAME=t\n10, S2\n9, S2\n"
    whole = parts.replace("*SURFACE, NAME=t\n", "")
    scene, lists = imported(tmp_path, BOX + ROLLERS + parts + push)
    assert scene == imported(tmp_path, BOX + ROLLERS + whole + push)[0]
    assert "*SURFACE: adds to that of line 135, as in CalculiX" in lists
    slave = "*SURFACE, NAME=SLAVE, TYPE=NODE\n"
    deck = stack(PAIR, LAW).replace(slave, f"{slave}101\n{slave}")
    assert imported(tmp_path, deck + PRESS)[0] == imported(tmp_path, stack(PAIR, LAW) + PRESS)[0]


def test_a_surface_without_faces_has_those_that_are_free(tmp_path):
    """As in Abaqus, of a set of elements those that no other element has."""
    push = step("*DSLOAD", "T, P, 3.")
    for rows in "12,\n11, \n", "12, S2\n12, S4\n12, S5\n11, S2\n11, S5\n11, S6\n":
        deck = f"{BOX}{ROLLERS}*SURFACE, NAME=T\n{rows}{push}"
        (load,) = solved(tmp_path, deck).summary["bodies"]["A"]["loads"].values()
        assert load["force"] == pytest.approx([0.0, -3.0, -1.5])


def test_gravity_without_a_set_is_that_of_all(tmp_path):
    """As Abaqus/CAE writes the weight of a whole model."""
    deck = BOX + grid("B", (1, 1, 1), (1.0, 1.0, 1.0), [5.0, 0.0, 0.0], 101) + ROLLERS
    deck += "*SOLID SECTION, ELSET=B, MATERIAL=STEEL\n*BOUNDARY\nB_Z0, 1, 3\n"
    scene, _ = imported(tmp_path, deck + step("*DLOAD", ", GRAV, 9810., 0., 0., -1."))
    for body in scene["body"]:
        assert body["volume_force"] == pytest.approx([0.0, 0.0, -7.8e-9 * 9810.0])


ONE = "*AMPLITUDE, NAME=ONE\n0., 1., 1., 1.\n"
LATER = "*AMPLITUDE, NAME=ONE\n0., 0., 0.5, 0., 0.5, 1.\n"
FIRST = step("*DSLOAD", "S, P, 1.")
JUMPS = {
    "an amplitude jumps at a step": (
        ONE + FIRST + step("*DLOAD, AMPLITUDE=ONE", "10, P2, 1."),
        [0.0, 1.0, 1.001, 2.0],
        [0.0, 0.0, 1.0, 1.0],
    ),
    "it may begin later, by another factor": (
        ONE.replace("\n0.,", ", SHIFTX=0.5, SHIFTY=-0.5\n0.,").replace("1., 1.", "0.5, 2.")
        + FIRST
        + step("*DLOAD, AMPLITUDE=ONE", "10, P2, 1."),
        [0.0, 1.5, 2.0],
        [0.0, 0.0, 1.0],
    ),
    "or in a step": (
        LATER + FIRST + step("*DLOAD, AMPLITUDE=ONE", "10, P2, 1."),
        [0.0, 1.499, 1.5, 2.0],
        [0.0, 0.0, 1.0, 1.0],
    ),
    "or from the value of the step before": (
        ONE + FIRST + step("*DSLOAD, AMPLITUDE=ONE", "S, P, 2.", time="0.1, 4."),
        [0.0, 1.0, 1.004, 5.0],
        [0.0, 0.5, 1.0, 1.0],
    ),
    "all loads of a step may": (
        FIRST + step("*DSLOAD", "S, P, 2.", options=", AMPLITUDE=STEP"),
        [0.0, 1.0, 1.001, 2.0],
        [0.0, 0.5, 1.0, 1.0],
    ),
    "and those that end there": (
        FIRST + step("*DSLOAD, OP=NEW", options=", AMPLITUDE=STEP"),
        [0.0, 1.0, 1.001, 2.0],
        [0.0, 1.0, 0.0, 0.0],
    ),
    "which come down else, whatever amplitude they had": (
        ONE + step("*DSLOAD, AMPLITUDE=ONE", "S, P, 1.") + step("*DSLOAD, OP=NEW"),
        [0.0, 0.001, 1.0, 2.0],
        [0.0, 1.0, 1.0, 0.0],
    ),
    "what an amplitude does within this thousandth stays": (
        "*AMPLITUDE, NAME=ONE\n0., 1., 4e-4, 0., 0.5, 0., 0.5002, 0.5, 0.5002, 0., 1., 0.\n"
        + FIRST
        + step("*DLOAD, AMPLITUDE=ONE", "10, P2, 1."),
        [0.0, 1.0, 1.0002, 1.0004, 1.5, 1.5001, 1.5002, 2.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.5, 0.0, 0.0],
    ),
    "a jump after the step is none": (
        "*AMPLITUDE, NAME=ONE\n0., 0., 1., 1., 3., 1., 3., 0.\n"
        + step("*DSLOAD, AMPLITUDE=ONE", "S, P, 1.")
        + step("*DSLOAD", "S, P, 0."),
        [0.0, 1.0, 2.0],
        [0.0, 1.0, 0.0],
    ),
    "an amplitude that begins where the load is does not jump": (
        ONE + FIRST + step("*DSLOAD, AMPLITUDE=ONE", "S, P, 1."),
        [0.0, 1.0, 2.0],
        [0.0, 1.0, 1.0],
    ),
}


@pytest.mark.parametrize("steps, times, factors", JUMPS.values(), ids=JUMPS)
def test_loads_that_jump(tmp_path, steps, times, factors):
    """As ccx 2.20 has them, over a thousandth of the step in place of its first increment, and told."""
    deck = BOX + ROLLERS + "*SURFACE, NAME=S\n9, S2\n" + steps
    scene, lists = imported(tmp_path, deck)
    history = scene["history"][scene["body"][0]["traction"][-1]["history"]]
    assert history["times"] == pytest.approx(times)
    assert history["factors"] == pytest.approx(factors)
    assert ("it jumps, over a thousandth of the step" in lists) == (len(times) > 3)


def test_the_last_displacement_counts(tmp_path):
    """As in CalculiX; supports of a step after those of the model are no two."""
    moved = step("*BOUNDARY", "A_Z1, 3, 3, 0.1", "36, 3, 3, 0.1", "A_Z1, 3, 3, 0.2")
    scene, lists = imported(tmp_path, BOX + ROLLERS + moved)
    assert {"on": "A_Z1", "z": 0.2} in scene["body"][0]["clamp"] and "the last one counts" in lists
    single = step("*BOUNDARY", "A_Z0, 3, 3, 0.1")
    assert "the last one counts" not in imported(tmp_path, BOX + ROLLERS + single)[1]


LOST = [
    (
        stack(PAIR, LAW) + "*CLEARANCE, SLAVE=SLAVE, MASTER=OTHER, VALUE=0.1\n",
        "*CLEARANCE: no *CONTACT PAIR has",
    ),
    (
        stack(PAIR, LAW)
        + f"{PAIR.replace('=I', '=J')}\nSLAVE, MASTER\n"
        + LAW.replace("=I", "=J")
        + "*FRICTION\n0.2\n",
        "a contact beside that of line",
    ),
    (stack(PAIR, LAW) + "*TIE\nSLAVE, MASTER\n", "a contact beside that of line"),
    (
        stack(PAIR, LAW)
        + step()
        + step("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE", "MASTER, SLAVE"),
        "*MODEL CHANGE: there is no *CONTACT PAIR of master and slave",
    ),
    (
        BOX + ROLLERS + step("*CLOAD", "A_Z1, 3, 1.", "*CLOAD, OP=NEW", "A_Z1, 1, 1."),
        "OP=NEW after line 137 of this step",
    ),
    (
        BOX
        + ROLLERS
        + "*AMPLITUDE, NAME=UP\n0., 0., 1., 1.\n"
        + step(
            "*CLOAD, AMPLITUDE=UP",
            "A_Z1, 3, 1.",
            "*CLOAD, AMPLITUDE=UP, TIME DELAY=0.5",
            "A_Z1, 3, 2.",
        ),
        "a load beside another one of this step with another amplitude",
    ),
    (
        BOX
        + ROLLERS
        + "*SURFACE, NAME=T\n9, S2\n"
        + step("*DSLOAD", "T, TRVEC, 1., 1., 0., 0.")
        + step("*DSLOAD", "T, TRVEC, 1., 0., 1., 0."),
        "TRVEC in another direction than in the step before",
    ),
    (
        BOX
        + ROLLERS
        + "*SURFACE, NAME=T\n9, S2\n"
        + step("*DSLOAD", "T, P, 1.")
        + step("*DLOAD, OP=NEW", "10, P2, 1."),
        "OP=NEW beside *DLOAD and *DSLOAD",
    ),
    (
        stack(PAIR, LAW + "*FRICTION\n0.1\n")
        + step(*[f"*CHANGE FRICTION, INTERACTION=I\n*FRICTION\n{mu}" for mu in (0.2, 0.3)]),
        "another coefficient of this interaction stands before it in this step",
    ),
    (
        stack(PAIR, LAW)
        + step(
            *(
                "*CHANGE SURFACE BEHAVIOR, INTERACTION=I\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n"
                + slope
                for slope in ("1e5", "2e5")
            )
        ),
        "gives this interaction another law in this step",
    ),
    (BOX + ROLLERS + PULL + "*CLOAD\nA_Z1, 3, 1.\n", "*CLOAD: it stands after the last *STEP"),
    (
        BOX + ROLLERS + step().replace("STATIC", "FREQUENCY") + PULL,
        "*FREQUENCY: only *STATIC steps are computed",
    ),
    (
        BOX + ROLLERS + PULL + step().replace("STATIC", "DYNAMIC"),
        "*DYNAMIC: only *STATIC steps are computed",
    ),
    (
        bolt() + step("*CLOAD", "900, 1, 5.", "900, 2, 5."),
        "a pre-tension has the component 1 alone",
    ),
    (
        bolt().replace(
            "*BOUNDARY",
            "*SURFACE, NAME=OTHER\n3, S2\n*PRE-TENSION SECTION, SURFACE=OTHER, NODE=900\n*BOUNDARY",
        )
        + step("*CLOAD", "900, 1, 5."),
        "its node is also that of line",
    ),
    (BOX + ROLLERS + step("*BOUNDARY", "A_Z1, 6, 6, 0.1"), "component 6 of the displacement"),
    (BOX + ROLLERS + step("*BOUNDARY", "A_Z1, 11, 11, 0."), "component 11 of the displacement"),
    (
        stack(PAIR, f"{LAW}*FRICTION\n0.2\n")
        + step("*DLOAD", "A, GRAV, 1., 0., 0., -1.")
        + step("*DLOAD", "A, GRAV, 1., 1., 0., 0."),
        "if its steps are load cases, keep one step per deck",
    ),
    *(
        (
            f"{BOX}{ROLLERS}*ELSET, ELSET=ALL\nA\n" + loads,
            "on elements that have one of another set or axis: programs take one or both",
        )
        for loads in (
            step(
                "*DLOAD",
                "A, CENTRIF, 1., 0., 0., 0., 0., 0., 1.\nALL, CENTRIF, 1., 0., 0., 0., 0., 0., 1.",
            ),
            step("*DLOAD", "A, CENTRIF, 1., 0., 0., 0., 0., 0., 1.")
            + step("*DLOAD", "A, CENTRIF, 1., 0., 0., 0., 1., 0., 0."),
            step("*DLOAD", "A, BX, 1.") + step("*DLOAD", "ALL, BX, 1."),
        )
    ),
]


@pytest.mark.parametrize("deck, words", LOST)
def test_what_contradicts_is_refused(tmp_path, deck, words):
    """Contacts of the same faces, loads that replace or add by program, and steps that no scene has."""
    deck = deck if "*STEP" in deck else deck + PULL
    assert words in refused(tmp_path, deck)


@pytest.mark.parametrize("first", ["SLAVE, MASTER", "FACES, MASTER", "MASTER, SLAVE"])
def test_a_contact_that_is_there_twice_is_one(tmp_path, first):
    """Given again, by another surface of the same faces, or the other way round."""
    press = step("*BOUNDARY", "B_Z1, 3, 3, -0.001")
    deck = stack(
        PAIR, f"*ELSET, ELSET=LOW\n101, 102, 103, 104\n*SURFACE, NAME=FACES\nLOW, S1\n{LAW}"
    )
    scene, lists = imported(
        tmp_path, f"{deck}{PAIR}\n{first}\n{press}".replace("*CONTACT", "*CONTACT", 1)
    )
    assert len(scene["contact"]) == 1 and "a contact that is there already is one contact" in lists


def test_ties_have_the_slave_of_the_deck(tmp_path):
    """As contacts have it; unless supports constrain all of it."""
    press = step("*BOUNDARY", "B_Z1, 3, 3, -0.001")
    for first, slave in ("SLAVE, MASTER", "B"), ("MASTER, SLAVE", "A"):
        assert (
            imported(tmp_path, stack("*TIE, NAME=T", first=first) + press)[0]["contact"][0]["slave"]
            == slave
        )
    held = stack("*TIE, NAME=T").replace("*BOUNDARY\n", "*BOUNDARY\nB_Z0, 1, 3\n", 1)
    assert "slave" not in imported(tmp_path, held + press)[0]["contact"][0]


def slit(card: str, parted: int = 2) -> str:
    """Two blocks on each other of which one mesh is made, but for a slit from the left to the node `parted`."""
    lower = grid("A", (4, 1, 1), (4.0, 1.0, 1.0))
    upper = grid("B", (4, 1, 1), (4.0, 1.0, 1.0), [0.0, 0.0, 1.0], 101)
    for y in (0, 1):  # of the upper side of A, and the lower one of B
        for x in range(parted, 5):
            ours, theirs = 1 + x + 5 * y + 10, 101 + x + 5 * y
            upper = re.sub(rf"^{theirs}, .*\n", "", upper, count=1, flags=re.M)
            upper = re.sub(rf"(?<=, ){theirs}(?=,|$)", str(ours), upper, flags=re.M)
            upper = re.sub(rf"^{theirs},$", f"{ours},", upper, flags=re.M)
    both = "*ELSET, ELSET=ALL\nA, B\n"
    sides = "*SURFACE, NAME=LOWER\n1, S2\n2, S2\n*SURFACE, NAME=UPPER\n101, S1\n102, S1\n"
    section = "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL\n"
    held = "*BOUNDARY\nA_Z0, 1, 3\n"
    joint = f"{sides}{LAW}{card}\nLOWER, UPPER\n" if card else ""
    return f"{lower}{upper}{both}{STEEL}{section}{held}{joint}" + step("*DLOAD", "B, P2, 5.")


def test_a_body_that_touches_itself(tmp_path):
    """Two surfaces of one body are a contact of it with itself, or a bond, with which it is the body without a slit."""
    scene, _ = imported(tmp_path, slit(PAIR))
    (contact,) = scene["contact"]
    assert len(set(contact["bodies"])) == 1 and contact["on"] == ["LOWER", "UPPER"]
    assert contact["slave"] == "first"
    (found,) = solved(tmp_path, slit(PAIR)).summary["contacts"].values()
    assert found["normal_force"] > 0.0
    moved = []
    for deck in (slit("*TIE, NAME=T"), slit("", 0)):
        imported(tmp_path, deck)
        path = max(tmp_path.glob("*/deck/scene.toml"), key=lambda path: int(path.parts[-3]))
        # quadratic solids are bonded at the corners of facets alone
        answer = ddmpi.solve(str(path), MPI.COMM_SELF, {"body.ALL.mesh.order": 1})
        moved.append(answer.summary["bodies"]["ALL"]["displacement_max"])
    assert moved[0] == pytest.approx(moved[1], rel=1e-8)


def sector(
    wheel: str, name: str = "T", cells: int = 6, turn: float = 90.0, swept: float = 0.0
) -> str:
    """A quarter of a ring from 1 to 2 under a pressure of 5 inside, whose flanks are tied to their images; or a sector of
    another angle, whose outside is `swept` forwards by an angle (degrees)."""
    lines, nodes = grid("A", (1, cells, 1), (1.0, 1.0, 0.5)).split("\n"), True
    for k, line in enumerate(lines[1:], 1):
        nodes &= not line.startswith("*")
        if nodes:
            node, x, y, z = line.split(", ")
            r, angle = 1.0 + float(x), np.radians(turn * float(y) + swept * float(x))
            lines[k] = f"{node}, {r * np.cos(angle)!r}, {r * np.sin(angle)!r}, {z}"
    flanks = "".join(f"*SURFACE, TYPE=NODE, NAME=Y{k}\nA_Y{k}\n" for k in (0, 1))
    tie = f"*TIE, NAME={name}, CYCLIC SYMMETRY\nY1, Y0\n{wheel}"
    section = "*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n*BOUNDARY\nA_Z0, 3, 3\n"
    return "\n".join(lines) + STEEL + section + flanks + tie + step("*DLOAD", "A, P6, 5.")


WHEEL = "*CYCLIC SYMMETRY MODEL, N=4, TIE=T\n0., 0., 0., 0., 0., 2.\n"


def test_a_cyclic_tie_is_an_image(tmp_path):
    """The flank bears the hoop force of a ring; the turn leads from the master to the slave."""
    scene, lists = imported(tmp_path, sector(WHEEL))
    (contact,) = scene["contact"]
    image = {"turn": 90.0, "axis": [0.0, 0.0, 2.0], "pivot": [0.0, 0.0, 0.0]}
    assert contact["image"] == image and contact["kind"] == "bonded"
    assert "a sector with an image of its flank" in lists
    answer = solved(tmp_path, sector(WHEEL))
    (found,) = answer.summary["contacts"].values()
    assert found["normal_force"] == pytest.approx(-5.0 * 1.0 * 0.5, rel=1e-8)
    assert found["image"] == {"turn": 90.0, "sectors": 4}
    back = sector(WHEEL).replace("Y1, Y0", "Y0, Y1")
    assert imported(tmp_path, back)[0]["contact"][0]["image"]["turn"] == -90.0


def test_a_swept_flank_is_turned_onto_the_other_one(tmp_path):
    """By the middles of all nodes of both: a sector of one element and 4 degrees, whose outer nodes are 40 degrees ahead
    of the inner ones. Without its first node the middle of a flank would be beyond that of the other flank."""
    deck = sector(WHEEL.replace("N=4", "N=90"), cells=1, turn=4.0, swept=40.0)
    for one, turn in ((deck, 4.0), (deck.replace("Y1, Y0", "Y0, Y1"), -4.0)):
        assert imported(tmp_path, one)[0]["contact"][0]["image"]["turn"] == turn


@pytest.mark.parametrize(
    ("wheel", "words"),
    [
        ("", "a cyclic tie without a *CYCLIC SYMMETRY MODEL"),
        (WHEEL.replace("N=4", "N=1"), "N is a whole number of sectors from 2 on"),
        (WHEEL.replace("0., 0., 2.", "0., 0., 0."), "its axis is given by two points in space"),
        (WHEEL + WHEEL, "a second cyclic symmetry of this tie"),
    ],
)
def test_what_is_no_sector_is_refused(tmp_path, wheel, words):
    """Without sectors or an axis, and twice."""
    assert words in refused(tmp_path, sector(wheel))


def test_a_cyclic_symmetry_without_a_tie_is_lost(tmp_path):
    """Its name is that of no tie."""
    deck = sector(WHEEL.replace("TIE=T", "TIE=U")).replace(", CYCLIC SYMMETRY\n", "\n")
    assert "no *TIE with CYCLIC SYMMETRY has its name" in refused(tmp_path, deck)


def test_faces_within_a_body_are_left_out_of_contacts(tmp_path):
    """With a word: no other body can touch them."""
    deck = stack(PAIR, LAW).replace("A, S2", "A, S2\nB, S2")
    deck = deck.replace("SLAVE, MASTER", "SLAVE, UPPER").replace(
        "*SURFACE, NAME=SLAVE", "*SURFACE, NAME=UPPER\nA, S2\nA, S4\n*SURFACE, NAME=SLAVE"
    )
    assert (
        "faces of the surface UPPER that are on no boundary (4) are left out"
        in imported(tmp_path, deck + PULL)[1]
    )


def ring(parts: int) -> str:
    """A quarter of a ring in the plane, whose inner nodes have cylindrical directions."""
    angles = np.linspace(0.0, np.pi / 2, parts + 1)
    points = [(r * np.cos(a), r * np.sin(a)) for r in (1.0, 2.0) for a in angles]
    text = "*NODE\n" + "\n".join(f"{k}, {x!r}, {y!r}" for k, (x, y) in enumerate(points, 1))
    text += "\n*ELEMENT, TYPE=CPE4, ELSET=A\n" + "\n".join(
        f"{k}, {k}, {k + parts + 1}, {k + parts + 2}, {k + 1}" for k in range(1, parts + 1)
    )
    text += f"\n*NSET, NSET=IN, GENERATE\n1, {parts + 1}\n*TRANSFORM, NSET=IN, TYPE=C\n0, 0, 0, 0, 0, 1\n"
    return text + STEEL + SECTION


@pytest.mark.parametrize("parts", [4, 8])
def test_nodes_on_the_axes_of_a_cylinder_are_held_with_the_others(tmp_path, parts):
    """A set whose radial directions are along x and y at its ends has one clamp."""
    scene, _ = imported(tmp_path, ring(parts) + "*BOUNDARY\nIN, 1\n" + step("*DLOAD", "1, P2, 1."))
    (clamp,) = scene["body"][0]["clamp"]
    assert clamp["on"] == "IN" and len(clamp["along"]) == 2


def bush(parts: int) -> str:
    """A quarter of a ring of CPE8, between radii 1 and 2, whose outer face slides on a cylinder."""
    angles = np.linspace(0.0, np.pi / 2, 2 * parts + 1)
    at = {
        (i, k): 3 * k + i + 1 for k in range(len(angles)) for i in range(3) if i != 1 or k % 2 == 0
    }
    text = "*NODE\n" + "".join(
        f"{node}, {(1 + i / 2) * np.cos(angles[k])!r}, {(1 + i / 2) * np.sin(angles[k])!r}\n"
        for (i, k), node in at.items()
    )
    text += "*ELEMENT, TYPE=CPE8, ELSET=A\n"
    for e in range(parts):
        corners = (0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)
        nodes = [at[i, 2 * e + k] for i, k in corners]
        text += ", ".join(map(str, [e + 1, *nodes])) + "\n"
    for name, nodes in {
        "OUT": [at[2, k] for k in range(len(angles))],
        "X": [at[i, 0] for i in (0, 1, 2)],
        "Y": [at[i, 2 * parts] for i in (0, 1, 2)],
    }.items():
        text += f"*NSET, NSET={name}\n" + "".join(f"{node},\n" for node in nodes)
    text += "*TRANSFORM, NSET=OUT, TYPE=C\n0, 0, 0, 0, 0, 1\n" + STEEL + SECTION
    ends = f"{at[2, 0]}, 2\n{at[2, 2 * parts]}, 2\n{at[0, 0]}, 2\n{at[1, 0]}, 2\n"
    ends += f"{at[0, 2 * parts]}, 1\n{at[1, 2 * parts]}, 1\n"
    load = [f"{e + 1}, P4, 100." for e in range(parts)]
    return text + f"*BOUNDARY\nOUT, 1\n{ends}" + step("*DLOAD", *load)


def test_a_curved_face_slides_on_a_cylinder(tmp_path):
    """Three curved elements on a quarter; the bore grows as by Lamé's formula, u = B (1/r − r/4)."""
    grown = solved(tmp_path, bush(3)).summary["bodies"]["A"]["displacement_max"]
    assert grown == pytest.approx(0.75 * 100.0 * 1.3 * 0.4 / (0.65 * 210000.0), rel=0.03)


@pytest.mark.parametrize("deck", [ring(3), ring(2), bush(2)])
def test_nodes_of_coarse_faces_move_around_an_axis(tmp_path, deck):
    """Each has a direction of its own, however much these turn over a face."""
    deck = deck if "*STEP" in deck else deck + "*BOUNDARY\nIN, 1\n" + step("*DLOAD", "1, P2, 1.")
    deck = deck.replace("*STEP", "*BOUNDARY\n1, 2\n*STEP", 1) if "OUT" not in deck else deck
    fields, held = solved(tmp_path, deck).bodies["A"], 2.0 if "OUT" in deck else 1.0
    some = np.isclose(np.hypot(*fields.points.T), held)
    radial = (fields.displacement[some] * fields.points[some]).sum(axis=1)
    assert some.sum() >= 3 and np.abs(radial).max() <= 1e-14 < np.abs(fields.displacement).max()


def quadratic(kind: str) -> str:
    """One quadratic element, of whose side or face at the bottom the corners are held, under its weight."""
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    ends = [(0, 1), (1, 2), (2, 3), (3, 0)]
    if kind == "C3D10":
        corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)]
        ends = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    points = np.array([*corners, *(0.5 * np.add(corners[a], corners[b]) for a, b in ends)])
    nodes = "".join(f"{k}, {', '.join(map(str, at))}\n" for k, at in enumerate(points.tolist(), 1))
    held = "".join(f"{k}, 1, 3\n" for k in np.flatnonzero(points[: len(corners), 1] == 0.0) + 1)
    element = ", ".join(map(str, [1, *range(1, len(points) + 1)]))
    mesh = f"*NODE\n{nodes}*ELEMENT, TYPE={kind}, ELSET=A\n{element}\n{STEEL}{SECTION}"
    return f"{mesh}*BOUNDARY\n{held}" + step("*DLOAD", "A, BY, -1.")


@pytest.mark.parametrize("kind", ["CPE8", "C3D10"])
def test_middles_are_free_between_corners_that_are_held(tmp_path, kind):
    """Of quadratic elements, as in the deck: they were held, too, where the supports have both ends of a side."""
    fields = solved(tmp_path, quadratic(kind)).bodies["A"]
    at = fields.points[:, 1] == 0.0
    middle = (fields.points[at] == 0.5).any(axis=1)
    assert np.abs(fields.displacement[at][~middle]).max() < 1e-15
    assert fields.displacement[at][middle, 1].max() < -1e-7
    every = quadratic(kind).replace("*STEP", "5, 1, 3\n6, 1, 3\n7, 1, 3\n*STEP")
    assert len(imported(tmp_path, every)[0]["body"][0]["clamp"]) == 1


def test_many_corners_that_are_held_are_few_sets(tmp_path):
    """Of a row of quadratic elements, none of which has two corners in one set: it was a set for each corner."""
    places = [(x, y) for y in range(3) for x in range(13)]
    nodes = "".join(f"{k}, {x / 2}, {y / 2}\n" for k, (x, y) in enumerate(places, 1))
    own = np.array([1, 3, 29, 27, 2, 16, 28, 14])
    rows = "".join(f"{k}, {', '.join(map(str, own + 2 * k - 2))}\n" for k in range(1, 7))
    held = "".join(f"{k}, 1, 2\n" for k in range(1, 14, 2))
    deck = f"*NODE\n{nodes}*ELEMENT, TYPE=CPE8, ELSET=A\n{rows}{STEEL}{SECTION}*BOUNDARY\n{held}"
    scene, _ = imported(tmp_path, deck + step("*DLOAD", "A, BY, -1."))
    assert len(scene["body"][0]["clamp"]) == 2
    mesh = (tmp_path / "0" / "deck" / "A.inp").read_text()
    sets = [text.split("\n*")[0] for text in mesh.split("*NSET, NSET=fixed")[1:]]
    assert [text.split("\n")[1] for text in sets] == ["1, 5, 9, 13", "3, 7, 11"]


def turned_part(place: str, way: str = "*ORIENTATION, NAME=O\n1., 0., 0., 0., 1., 0.\n") -> str:
    """A part of an orthotropic material, in an instance at a place, with an orientation of its own."""
    material = "*MATERIAL, NAME=WOOD\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n10., 1., 1., 0., 0., 0., 1., 1.,\n1.\n"
    section = "*SOLID SECTION, ELSET=A, MATERIAL=WOOD, ORIENTATION=O\n"
    return (
        "*PART, NAME=P\n"
        + grid("A", (1, 1, 1), (1.0, 1.0, 1.0))
        + way
        + section
        + "*END PART\n*ASSEMBLY, NAME=ALL\n"
        f"*INSTANCE, NAME=I, PART=P\n{place}*END INSTANCE\n*END ASSEMBLY\n{material}*BOUNDARY\nI.A_X0, 1, 3\n"
        + step("*CLOAD", "I.A_X1, 1, 1.")
    )


def test_orientations_turn_with_their_instance(tmp_path):
    """The axes of a material are those of the part, wherever the instance turns them."""
    quarter = "0., 0., 0.\n0., 0., 0., 0., 0., 1., 90.\n"
    still = imported(tmp_path, turned_part("5., 0., 0.\n"))[0]["body"][0]["material"]
    turned = imported(tmp_path, turned_part(quarter))[0]["body"][0]["material"]
    assert "axes" not in still
    assert np.array(turned["axes"]) == pytest.approx(
        np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]), abs=1e-12
    )


def test_axes_are_turned_by_a_second_line(tmp_path):
    """Of *ORIENTATION, by an angle about one of them, as in CalculiX, also in an instance that is turned."""
    way = "*ORIENTATION, NAME=O\n0., 1., 0., 0., 0., 1.\n{}"
    for line, first, second in (
        ("3, 90.\n", [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]),
        ("2, 30.\n", [-0.5, 0.75**0.5, 0.0], [0.0, 0.0, 1.0]),
        ("1, 90.\n", [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]),
        ("3\n", [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
    ):
        found = [
            imported(tmp_path, turned_part(place, way.format(line)))[0]["body"][0]["material"]
            for place in ("", "0., 0., 0.\n0., 0., 0., 1., 0., 0., 90.\n")
        ]
        assert np.array(found[0]["axes"]) == pytest.approx(np.array([first, second]), abs=1e-12)
        (x, y, z), (u, v, w) = first, second
        moved = np.array([[x, -z, y], [u, -w, v]])
        assert np.array(found[1]["axes"]) == pytest.approx(moved, abs=1e-12)
    words = "*ORIENTATION: its axes are turned about one of them, 1 to 3"
    assert words in refused(tmp_path, turned_part("", way.format("4, 30.\n")))


def test_transforms_turn_with_their_instance(tmp_path):
    """A radial direction is that of the axis where the instance has it."""
    deck = turned_part("3., 4., 0.\n0., 0., 0., 0., 0., 1., 90.\n").replace(
        "O\n*END PART", "O\n*TRANSFORM, NSET=A_X1, TYPE=R\n1., 0., 0., 0., 1., 0.\n*END PART"
    )
    force = imported(tmp_path, deck)[0]["body"][0]["traction"][0]["force"]
    assert force == pytest.approx([0.0, 4.0, 0.0], abs=1e-12)


def test_a_bolt_turns_with_its_instance(tmp_path):
    """The normal of its section is that of the part: upside down, the bolt is pulled as before."""
    part = "*PART, NAME=P\n" + grid("A", (1, 1, 4), (1.0, 1.0, 4.0)) + SECTION
    part += "*SURFACE, NAME=CUT\n2, S2\n*END PART\n*PART, NAME=Q\n*NODE, NSET=N\n1, 9., 9., 9.\n"
    joint = "*PRE-TENSION SECTION, SURFACE=CUT, NODE=B.1\n0., 0., 1.\n"
    whole = "*END PART\n*ASSEMBLY, NAME=S\n*INSTANCE, NAME=I, PART=P\n{}{}*END INSTANCE\n"
    whole += "*INSTANCE, NAME=B, PART=Q\n*END INSTANCE\n*END ASSEMBLY\n" + STEEL
    held = "*BOUNDARY\nI.A_Z0, 1, 3\nI.A_Z1, 1, 3\n" + step("*CLOAD", "B.1, 1, 50.")
    for place in "", "0., 0., 5.\n0., 0., 0., 1., 0., 0., 180.\n":
        scene, _ = imported(tmp_path, part + whole.format(place, joint) + held)
        pull = scene["contact"][0]["pretension"]
        sense = -1.0 if place else 1.0
        assert pull == {"force": 50.0, "along": pytest.approx([0.0, 0.0, sense], abs=1e-12)}


def test_a_sector_turns_with_its_instance(tmp_path):
    """Its axis is that of the part, where the instance has it."""
    mesh, rest = sector(WHEEL).split("*MATERIAL")
    matter, rest = rest.split("*SOLID SECTION")
    inside, outside = rest.split("*STEP")
    place = "5., 0., 0.\n0., 0., 0., 1., 0., 0., 90.\n"
    deck = f"*PART, NAME=P\n{mesh}*SOLID SECTION{inside.replace('*BOUNDARY', '*NSET, NSET=N')}"
    deck = deck.replace("N\nA_Z0, 3, 3\n", "N\nA_Z0\n") + "*END PART\n*ASSEMBLY, NAME=S\n"
    deck += f"*INSTANCE, NAME=I, PART=P\n{place}*END INSTANCE\n*END ASSEMBLY\n*MATERIAL{matter}"
    deck += "*BOUNDARY\nI.A_Z0, 1, 3\n*STEP" + outside.replace("A, P6", "I.A, P6")
    (contact,) = imported(tmp_path, deck)[0]["contact"]
    assert contact["image"]["pivot"] == pytest.approx([5.0, 0.0, 0.0])
    assert contact["image"]["axis"] == pytest.approx([0.0, -2.0, 0.0], abs=1e-12)
    assert contact["image"]["turn"] == 90.0


def test_a_force_along_a_direction_that_is_none_is_refused(tmp_path):
    """On the axis of a cylinder there is no radius: its force was dropped without a word."""
    deck = BOX + ROLLERS + "*TRANSFORM, NSET=A_Z1, TYPE=C\n0.5, 0.5, 0., 0.5, 0.5, 1.\n"
    words = "*CLOAD: a direction of *TRANSFORM at a node on its axis, where it has none"
    assert words in refused(tmp_path, deck + step("*CLOAD", "32, 1, 1."))
    assert imported(tmp_path, deck + step("*CLOAD", "32, 3, 1."))


def test_each_part_has_orientations_of_its_own(tmp_path):
    """Two parts may have one each of the same name."""
    one = turned_part("")
    other = "*ORIENTATION, NAME=O\n0., 1., 0., -1., 0., 0.\n"
    second = (
        one.split("*ASSEMBLY")[0]
        .replace("NAME=P", "NAME=Q")
        .replace("*ORIENTATION, NAME=O\n1., 0., 0., 0., 1., 0.\n", other)
    )
    deck = second + one.replace(
        "*END ASSEMBLY", "*INSTANCE, NAME=J, PART=Q\n9., 0., 0.\n*END INSTANCE\n*END ASSEMBLY"
    )
    deck = deck.replace("I.A_X0, 1, 3\n", "I.A_X0, 1, 3\nJ.A_X0, 1, 3\n")
    bodies = {body["name"]: body["material"] for body in imported(tmp_path, deck)[0]["body"]}
    assert "axes" not in bodies["I"] and bodies["J"]["axes"][0] == [0.0, 1.0, 0.0]


def test_a_set_of_an_instance_is_no_other_set(tmp_path):
    """A name with that of an instance before it means no set of the whole assembly, or of another instance."""
    deck = turned_part("").replace(
        "*END ASSEMBLY", "*NSET, NSET=FREE, INSTANCE=I\n1\n*END ASSEMBLY"
    )
    assert imported(tmp_path, deck.replace("*STEP", "*BOUNDARY\nFREE, 1\n*STEP"))
    assert "there is no set I.FREE" in refused(
        tmp_path, deck.replace("*STEP", "*BOUNDARY\nI.FREE, 1\n*STEP")
    )


def test_sets_and_surfaces_of_a_part_and_of_the_assembly_with_one_name(tmp_path):
    """The name is that of the assembly, where this has members of the part, as for its loads; it had both."""
    part = "*NSET, NSET=S\nA_X0, A_X1\n*SURFACE, NAME=F\n1, S1\n*END PART"
    whole = "*NSET, NSET=S, INSTANCE=I\n1\n*SURFACE, NAME=F\nI.A, S2\n*SURFACE, NAME=F2\nI.A, S3\n"
    deck = turned_part("").replace("*END PART", part)
    (tmp_path / "a.inp").write_text(deck.replace("*END ASSEMBLY", f"{whole}*END ASSEMBLY"))
    mesh = Deck(tmp_path / "a.inp").mesh("I")
    assert {name: len(mesh.point_sets[name]) for name in ("S", "I.S")} == {"S": 1, "I.S": 8}
    assert all(sum(map(len, mesh.cell_sets[name])) == 1 for name in ("F", "I.F", "F2"))
    other = "*INSTANCE, NAME=J, PART=P\n9., 0., 0.\n*END INSTANCE\n" + whole.replace("I", "J")
    other = other.replace("JNSTANCE", "INSTANCE")
    (tmp_path / "b.inp").write_text(deck.replace("*END ASSEMBLY", f"{other}*END ASSEMBLY"))
    mesh = Deck(tmp_path / "b.inp").mesh("I")
    assert len(mesh.point_sets["S"]) == 8 and "I.S" not in mesh.point_sets


def test_a_set_and_a_surface_of_nodes_with_one_name(tmp_path):
    """They are no two groups of a mesh file: with the same nodes they are one, with others refused."""
    faces = "*SURFACE, NAME=A_Z1, TYPE=NODE\n{}\n"
    for nodes, words in ("A_Z1", ""), ("A_Z0", "the set A_Z1 and the surface of this name have"):
        (tmp_path / "a.inp").write_text(BOX + faces.format(nodes))
        if words:
            with pytest.raises(DeckError, match=words):
                Deck(tmp_path / "a.inp").mesh()
        else:
            assert len(Deck(tmp_path / "a.inp").mesh().point_sets["A_Z1"]) == 9


def test_a_body_that_nothing_names_has_a_boundary(tmp_path):
    """Its mesh file has one surface, so that a run says what is missing: a support."""
    imported(tmp_path, BOX + step("*DLOAD", "A, GRAV, 9.81, 0., 0., -1."))
    assert "*SURFACE, NAME=boundary" in (tmp_path / "0" / "deck" / "A.inp").read_text()


KEYWORDS = (
    stack(f"{PAIR}, ADJUST=0.", LAW + "*FRICTION\n0.2, 1e5\n")
    + (
        "*NODE\n900, 0.5, 0.5, 3.\n*RIGID BODY, NSET=B_Z1, REF NODE=900\n*AMPLITUDE, NAME=UP\n0., 0., 1., 1.\n"
    )
    + step("*CLOAD, AMPLITUDE=UP", "900, 3, -5.", "*DLOAD", "A, GRAV, 9., 0., 0., -1.")
)


@pytest.mark.slow
def test_a_deck_with_lines_twice_missing_or_moved(tmp_path):
    """Each is one message, or a scene; never a traceback."""
    lines = KEYWORDS.splitlines()
    heads = [k for k, line in enumerate(lines) if line.startswith("*")] + [len(lines)]
    rng, ends = np.random.default_rng(3), {True: 0, False: 0}
    for first, last in itertools.pairwise(heads):
        card, target = lines[first:last], int(rng.choice(heads[:-1]))
        rest = lines[:first] + lines[last:]
        for text in (
            lines[:last] + card + lines[last:],
            rest,
            rest[:target] + card + rest[target:],
        ):
            try:
                imported(tmp_path, "\n".join(text) + "\n")
                ends[True] += 1
            except Exception as error:
                assert type(error).__name__ == "InputError", text
                ends[False] += 1
    assert min(ends.values()) > 20


def test_a_weight_replaces_that_of_the_step_before_in_its_direction_alone(tmp_path):
    """In another direction it adds to it, which is said."""
    words = "adds to that of the step before, which has another direction or axis"
    deck = BOX + ROLLERS + step("*DLOAD", "A, GRAV, 9810., 0., 0., -1.")
    same, another = (
        imported(tmp_path, deck + step("*DLOAD", f"A, GRAV, 2400., {way}"), partial=True)[1]
        for way in ("0., 0., -1.", "0.6, 0., -0.8")
    )
    assert words not in same and words in another


def test_what_no_steps_can_have_leaves_the_end(tmp_path):
    """Without friction the state at the end is the same however loads come; a rotation may be given otherwise."""
    axes = "A, CENTRIF, 1., 0., 0., 0., 0., 0., 0.3", "A, CENTRIF, 3., 0.2, 0.1, 0.7, 0., 0., 7."
    axes = (axes[0].replace("0., 0., 0., 0.,", "0.2, 0.1, 0., 0.,"), axes[1])
    pull = "A, GRAV, 9810., 1., 0., 0."
    steps = step("*DLOAD", axes[0]) + step("*DLOAD", axes[1], pull)
    scene, lists = imported(tmp_path, BOX + ROLLERS + steps)
    assert scene == imported(tmp_path, BOX + ROLLERS + step("*DLOAD", axes[1], pull))[0]
    words = (
        "volume forces that change in different ways: only the state at the end of the last step"
    )
    assert words in lists and "its amplitude" not in lists


def test_heat_of_a_body_whose_materials_do_not_all_expand(tmp_path):
    """One material that expands is enough: the other half of the column stays as long as it is."""
    column = grid("A", (1, 1, 2), (1.0, 1.0, 3.0)).replace("*NODE\n", "*NODE, NSET=A_ALL\n")
    deck = column + "*ELSET, ELSET=LOW\n1\n*ELSET, ELSET=HIGH\n2\n" + STEEL
    deck += "*MATERIAL, NAME=RIGID\n*ELASTIC\n210000., 0.\n"
    deck += (
        "*SOLID SECTION, ELSET=LOW, MATERIAL=STEEL\n*SOLID SECTION, ELSET=HIGH, MATERIAL=RIGID\n"
    )
    scene, lists = imported(tmp_path, deck + ROLLERS + step("*TEMPERATURE", "A_ALL, 50."))
    assert "no thermal strain" not in lists
    (body,) = scene["body"]
    assert body["temperature"] == pytest.approx(50.0)
    given = [material.get("expansion", 0.0) for material in body["material"]]
    assert sorted(given) == pytest.approx([0.0, 1.2e-5])


def test_a_face_twice_in_a_surface_has_its_pressure_once(tmp_path):
    """Faces that are in several sets of a surface, or there by number too, are one face each."""
    top = "*ELSET, ELSET=LEFT\n9, 11\n*ELSET, ELSET=TOP\nLEFT, 10, 12\n*SURFACE, NAME=S\n"
    push = step("*DSLOAD", "S, P, 3.")
    once, twice = (
        imported(tmp_path, BOX + ROLLERS + top + faces + push)[0]
        for faces in ("TOP, S2\n", "9, S2\nTOP, S2\nLEFT, S2\n")
    )
    assert once == twice and once["body"][0]["traction"] == [{"on": "S", "pressure": 3.0}]


@pytest.mark.parametrize("second", ["*TEMPERATURE\nALL, {}\n", "*TEMPERATURE, OP=NEW\nA_Z0, {}\n"])
def test_temperatures_begin_and_end_at_the_initial_ones(tmp_path, second):
    """In later steps as in the first one: the thermal strain of one expansion does not depend on where zero is."""
    deck = BOX + ROLLERS + "*NSET, NSET=ALL, GENERATE\n1, 36\n*SURFACE, NAME=S\n9, S2\n"
    deck += "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, {}\n"
    warm = "*TEMPERATURE\nALL, {}\n" if "OP=NEW" in second else ""
    deck += step("*DSLOAD\nS, P, 1.", warm) + step(second)
    values = (100.0, 0.0) if warm else (100.0,)
    scenes = [
        imported(tmp_path, deck.format(zero, *(zero + value for value in values)))[0]
        for zero in (0.0, 20.0)
    ]
    assert scenes[0] == scenes[1]
    heat = scenes[1]["body"][0]["temperature"]
    factors = scenes[1]["history"][heat["history"]]["factors"]
    assert heat["value"] == pytest.approx(100.0)
    assert factors == ([0.0, 1.0, 0.0] if warm else [0.0, 0.0, 1.0])


def test_nodes_of_a_set_that_is_unsorted_are_paired_as_they_are_given(tmp_path):
    """As in Abaqus; those of other sets by their numbers."""
    deck = BOX + "*BOUNDARY\nA_X0, 1\nA_Y0, 2\n1, 3, 3, 0.1\n3, 3, 3, 0.2\n"
    deck += "*NSET, NSET=V\n1, 3\n*EQUATION\n2\nU, 3, 1., V, 3, -1.\n" + step()
    for kind, moved in ("", {0.0: 0.1, 1.0: 0.2}), (", UNSORTED", {0.0: 0.2, 1.0: 0.1}):
        fields = solved(tmp_path, f"{deck}*NSET, NSET=U{kind}\n30, 28\n").bodies["A"]
        top = np.isclose(fields.points[:, 1:], [0.0, 3.0]).all(axis=1)
        for x, value in moved.items():
            at = top & np.isclose(fields.points[:, 0], x)
            assert fields.displacement[at, 2] == pytest.approx([value], rel=1e-9)
    mixed = deck + "*NSET, NSET=W\n28\n*NSET, NSET=U, UNSORTED\n30, W\n"
    assert "the set U is UNSORTED and has other sets" in refused(tmp_path, mixed)


def test_density_is_that_of_the_temperature(tmp_path):
    """Halfway between two rows of its table, and told."""
    deck = BOX.replace("7.8e-9\n", "8e-9, 100.\n6e-9, 0.\n") + ROLLERS
    deck += "*NSET, NSET=ALL, GENERATE\n1, 36\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 50.\n"
    scene, lists = imported(tmp_path, deck + step("*DLOAD", "A, GRAV, 10., 0., 0., -1."))
    assert scene["body"][0]["volume_force"] == pytest.approx([0.0, 0.0, -7e-8])
    assert "density at the mean temperature of A at the end" in lists


def test_forces_at_nodes_on_the_axis_are_on_the_faces_beside_it(tmp_path):
    """The axis has no area: the face beside it has the same resultant and the same first moment, which is none."""
    deck = grid("A", (2, 2), (2.0, 1.0), kind="CAX4") + STEEL + SECTION + "*BOUNDARY\nA_Y0, 2\n"
    scene, _ = imported(tmp_path, deck + step("*CLOAD", "7, 2, 5."))
    whole, uneven = scene["body"][0]["traction"]
    r = (np.arange(2000) + 0.5) / 2000
    t = whole["force"][1] / np.pi + evaluate(uneven["value"][1], r)
    assert 2.0 * np.pi * np.mean(t * r) == pytest.approx(5.0, abs=1e-4)
    assert 2.0 * np.pi * np.mean(t * r * r) == pytest.approx(0.0, abs=1e-4)
    reaction = solved(tmp_path, deck + step("*CLOAD", "7, 2, 5.")).summary["bodies"]["A"][
        "reaction"
    ]
    assert reaction == pytest.approx([0.0, -5.0], abs=1e-9)
    words = "a force at a node that is not on the boundary"
    assert words in refused(tmp_path, deck + step("*CLOAD", "4, 2, 5."))


def test_faces_on_the_axis_are_no_boundary(tmp_path):
    """A pressure there is refused by its line; contacts leave them out, with a word; beside the axis they are faces."""
    low = grid("A", (2, 2), (2.0, 1.0), kind="CAX4") + STEEL + SECTION + "*BOUNDARY\nA_Y0, 2\n"
    words = "a pressure on a face that is not on a boundary; those on the axis are not"
    assert words in refused(tmp_path, low + step("*DLOAD", "1, P4, 5.", "3, P3, 5."))
    ring = low.replace("*ELEMENT", "1, 0.01, 0.0\n4, 0.01, 0.5\n*ELEMENT")
    ring = ring.replace("1, 0.0, 0.0\n", "").replace("4, 0.0, 0.5\n", "")
    assert imported(tmp_path, ring + step("*DLOAD", "1, P4, 5."))[0]["body"][0]["traction"]
    top = grid("B", (2, 1), (2.0, 1.0), [0.0, 1.0], 101, "CAX4")
    top += "*SOLID SECTION, ELSET=B, MATERIAL=STEEL\n" + LAW
    faces = "*SURFACE, NAME=M\nHIGH, S3\n*SURFACE, NAME=S\n101, S1\n102, S1\n101, S4\n"
    deck = low + "*ELSET, ELSET=HIGH\n3, 4\n" + top + faces + f"{PAIR}\nS, M\n"
    deck += step("*BOUNDARY", "B_Y1, 2, 2, -0.001")
    assert (
        "faces of the surface S that are on no boundary (1) are left out"
        in imported(tmp_path, deck)[1]
    )
    (contact,) = solved(tmp_path, deck).summary["contacts"].values()
    assert contact["normal_force"] == pytest.approx(4.0 * np.pi * 210000.0 * 0.0005, rel=1e-6)


@pytest.mark.parametrize("way", ["KINEMATIC\n1, 6", "DISTRIBUTING\n1, 3"])
def test_a_reference_node_of_a_part_stands_where_its_instance_does(tmp_path, way):
    """Moved by 5 and turned by a quarter; a force at its arm of 1.5 has the moment of 1.5 about the face."""
    part = grid("ALL", (1, 1, 1), (1.0, 1.0, 1.0)) + "*NODE\n900, 2., 0.5, 3.\n*NSET, NSET=R\n900\n"
    part += "*SURFACE, NAME=TOP\n1, S2\n*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL\n"
    place = "5., 0., 0.\n5., 0., 0., 5., 0., 1., 90.\n"
    coupling = f"*COUPLING, CONSTRAINT NAME=C, REF NODE=I.R, SURFACE=I.TOP\n*{way}\n"
    deck = f"*PART, NAME=P\n{part}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n{place}"
    deck += f"*END INSTANCE\n{coupling}*END ASSEMBLY\n{STEEL}*BOUNDARY\nI.ALL_Z0, 1, 3\n"
    scene, _ = imported(tmp_path, deck + step("*CLOAD", "I.R, 3, 1."))
    if "rigid" in scene:
        assert scene["rigid"][0]["pivot"] == pytest.approx([4.5, 2.0, 3.0])
    else:
        force, moment = scene["body"][0]["traction"]
        assert force["force"] == [0.0, 0.0, 1.0]
        assert moment["moment"] == pytest.approx([1.5, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("more", ["", "A_Z1\n"])
def test_a_set_and_a_surface_of_one_name_in_a_mesh_file(tmp_path, more):
    """They are one group if they have the same nodes."""
    path = tmp_path / "deck.inp"
    path.write_text(f"{BOX}*SURFACE, TYPE=NODE, NAME=A_Z0\nA_Z0\n{more}")
    if more:
        with pytest.raises(DeckError, match="the set A_Z0 and the surface of this name"):
            Deck(path).mesh()
    else:
        assert len(Deck(path).mesh().point_sets["A_Z0"]) == 9
