"""`ddmpi import`: equations between nodes become supports, bonds and faces that move as one, or are lost by line."""

import re

import numpy as np
import pytest
from decks import STEEL, grid, step
from test_import import BOX, ROLLERS, SECTION, YOUNG, imported, refused, solved
from test_together import RIGID, TWO


def equal(one: str, two: str, components=(1, 2, 3), factor: float = -1.0) -> str:
    """Equations of the components of two nodes, or of two sets."""
    return "*EQUATION\n" + "".join(f"2\n{one}, {k}, 1., {two}, {k}, {factor}\n" for k in components)


def halves(joint: str) -> str:
    """A bar of two boxes that `joint` joins, pulled at its end."""
    upper = grid("B", (2, 2, 2), (1.0, 1.0, 1.5), [0.0, 0.0, 1.5], 101)
    both = "*SOLID SECTION, ELSET=B, MATERIAL=STEEL\n" + ROLLERS + "B_X0, 1\nB_Y0, 2\n"
    return (grid("A", (2, 2, 2), (1.0, 1.0, 1.5)) + upper + STEEL + SECTION + both + joint) + step(
        "*CLOAD", "B_Z1, 3, 1."
    )


TIED = "*SURFACE, TYPE=NODE, NAME=LOW\nA_Z1\n*SURFACE, TYPE=NODE, NAME=UP\nB_Z0\n*TIE, NAME=T\nLOW, UP\n"


@pytest.mark.every(3)
@pytest.mark.parametrize(
    "joint",
    [
        equal("A_Z1", "B_Z0"),
        equal("B_Z0", "A_Z1").replace("1., A", "-2., A").replace("-1.0", "2."),
        "*MPC\nTIE, A_Z1, B_Z0\n",
        # supports say the rest at the sides of symmetry
        "*EQUATION\n"
        + "".join(
            f"2\n{19 + n}, {k}, 1., {101 + n}, {k}, -1.\n"
            for n in range(9)
            for k in (1, 2, 3)
            if k == 3 or (n % 3 if k == 1 else n // 3)
        ),
    ],
)
def test_equal_displacements_of_two_faces_are_a_bond(tmp_path, joint):
    """As *TIE of the faces, whichever the coefficients are called; the bar is 9 F L / (E A) longer."""
    (tie,), (bond,) = (imported(tmp_path, halves(one))[0]["contact"] for one in (TIED, joint))
    assert (
        {*bond["bodies"]} == {*tie["bodies"]} and bond["kind"] == "bonded" and "image" not in bond
    )
    answer = solved(tmp_path, halves(joint))
    assert answer.bodies["B"].displacement[:, 2].max() == pytest.approx(27.0 / YOUNG, rel=1e-9)


@pytest.mark.parametrize("components", [(1, 2, 3), (3,)])
def test_layers_of_one_element_are_joined_at_their_faces(tmp_path, components):
    """Their sides have nodes of supports and of the pairs alone, and are no faces in contact: a bar in series."""
    upper = grid("B", (2, 2, 1), (1.0, 1.0, 0.5), [0.0, 0.0, 0.5], 101)
    deck = grid("A", (2, 2, 1), (1.0, 1.0, 0.5)) + upper + STEEL + SECTION
    deck += "*SOLID SECTION, ELSET=B, MATERIAL=STEEL\n*BOUNDARY\nA_Z0, 1, 3\nB_Z1, 1, 2\n"
    deck += equal("A_Z1", "B_Z0", components) + step("*BOUNDARY", "B_Z1, 3, 3, 0.001")
    deck = deck.replace("210000., 0.3", "210000., 0.")
    (found,) = solved(tmp_path, deck).summary["contacts"].values()
    assert found["normal_force"] == pytest.approx(-YOUNG * 0.001, rel=1e-7)
    for name, side in ("A", "S2"), ("B", "S1"):
        mesh = (tmp_path / "0" / "deck" / f"{name}.inp").read_text()
        faces = re.findall("S[1-6]", mesh.partition("NAME=tied\n")[2].partition("*")[0])
        assert faces == [side] * 4


def test_equal_displacements_along_the_normal_are_a_guided_face(tmp_path):
    """Two boxes that slide past each other: the upper one is pushed aside, against the roller at its end, and neither
    parts from the lower one nor moves it."""
    deck = halves(equal("A_Z1", "B_Z0", [3]))
    (contact,) = imported(tmp_path, deck)[0]["contact"]
    assert contact["kind"] == "guided" and "image" not in contact
    answer = solved(tmp_path, deck)
    assert answer.bodies["B"].displacement[:, 2].max() == pytest.approx(27.0 / YOUNG, rel=1e-9)
    pushed = solved(
        tmp_path, deck.replace("B_Z1, 3, 1.", "B_Z1, 1, -1.\nB_Z0, 1, -1.\nB_Z1, 2, 1.")
    )
    below, above = (np.abs(pushed.bodies[name].displacement).max() for name in "AB")
    assert below < 0.2 * above


def wheel(angle: float = 90.0, d: int = 3, rows: str = "", first: int = 1, off: float = 0.0) -> str:
    """A sector of a ring from 1 to 2 under a pressure of 5 inside, whose flanks have equal displacements in the
    directions of a cylinder; with nodes from `first` on, which are `off` by this much."""
    lines = grid("A", (1, 6, 1)[:d], (1.0, 1.0, 0.5)[:d], first=first).split("\n")
    rng = np.random.default_rng(first)
    for k in range(1, next(k for k, line in enumerate(lines[1:], 1) if line.startswith("*"))):
        node, x, y, *z = lines[k].split(", ")
        turn = np.radians(angle) * float(y)
        at = (1.0 + float(x)) * np.array([np.cos(turn), np.sin(turn)]) + off * rng.normal(size=2)
        lines[k] = ", ".join([node, *map(repr, at.tolist()), *z])
    held = "*BOUNDARY\nA_Z0, 3, 3\n" * (d == 3) + "*NSET, NSET=F\nA_Y0, A_Y1\n"
    held += "*TRANSFORM, TYPE=C, NSET=F\n0., 0., 0., 0., 0., 2.\n"
    joint = "*EQUATION\n" + rows if rows else equal("A_Y1", "A_Y0", range(1, d + 1))
    load = step("*DLOAD", "A, P6, 5." if d == 3 else "A, P4, 5.")
    return "\n".join(lines) + STEEL + SECTION + held + joint + load


def test_sectors_of_few_digits_are_of_one_wheel(tmp_path):
    """Two bodies of a sector, whose nodes are off by 1e-6, have one image."""
    second = re.sub(r"\*MATERIAL.*?(?=\*SOLID)", "", wheel(60.0, first=101, off=1e-6), flags=re.S)
    second = second.replace("A_", "B_").replace("ELSET=A", "ELSET=B").replace("A, P6", "B, P6")
    deck = wheel(60.0, off=1e-6).partition("*STEP")[0] + second
    one, two = imported(tmp_path, deck)[0]["contact"]
    assert one["bodies"] != two["bodies"] and one["image"] == two["image"]
    assert one["image"]["turn"] == 60.0 and one["image"]["pivot"][0] != 0.0


SWAPPED = (
    "2\nA_Y1, 1, 1., A_Y0, 1, -1.\n2\nA_Y0, 2, 1., A_Y1, 2, -1.\n2\nA_Y1, 3, 1., A_Y0, 3, -1.\n"
)
# supports say the rest at z = 0
PARTLY = "".join(
    f"2\n{a + 12}, {k}, 1., {a}, {k}, -1.\n"
    for a in (1, 2, 15, 16)
    for k in (1, 2, 3)
    if k < 3 or a > 2
)


@pytest.mark.parametrize("rows", ["", SWAPPED, PARTLY])
def test_equations_in_cylindrical_directions_are_a_sector(tmp_path, rows):
    """The bond of a flank to its image by a quarter turn bears the hoop force, in whichever order nodes are."""
    (contact,) = imported(tmp_path, wheel(rows=rows))[0]["contact"]
    assert contact["image"]["turn"] == pytest.approx(90.0, rel=1e-12)
    assert contact["image"]["axis"] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert contact["image"]["pivot"] == pytest.approx([0.0] * 3, abs=1e-9)
    (found,) = solved(tmp_path, wheel(rows=rows)).summary["contacts"].values()
    assert found["normal_force"] == pytest.approx(-5.0 * 1.0 * 0.5, rel=1e-8)


def test_a_sector_that_is_turned_and_moved(tmp_path):
    """About a skew axis anywhere, with coordinates of seven digits, its image is exactly a quarter of the wheel away."""
    from scipy.spatial.transform import Rotation

    R, shift = Rotation.from_rotvec([0.4, -0.7, 0.3]).as_matrix(), np.array([30.0, -20.0, 10.0])
    lines = wheel().replace("NSET=F\n0., 0., 0., 0., 0., 2.", "NSET=ALL\nAXIS").split("\n")
    for k in range(1, next(k for k, line in enumerate(lines[1:], 1) if line.startswith("*"))):
        node, *at = lines[k].split(", ")
        place = R @ [float(x) for x in at] + shift
        lines[k] = ", ".join([node, *(f"{x:.6e}" for x in place)])
    axis = [*shift, *(shift + R @ [0.0, 0.0, 2.0])]
    nodes = "*NSET, NSET=ALL, GENERATE\n1, 28\n*TRANSFORM"
    deck = "\n".join(lines).replace("*TRANSFORM", nodes).replace("AXIS", ", ".join(map(str, axis)))
    (contact,) = imported(tmp_path, deck)[0]["contact"]
    assert contact["image"]["turn"] == 90.0
    assert contact["image"]["axis"] == pytest.approx((R @ [0.0, 0.0, 1.0]).tolist(), abs=1e-5)
    (found,) = solved(tmp_path, deck).summary["contacts"].values()
    assert found["normal_force"] == pytest.approx(-5.0 * 1.0 * 0.5, rel=1e-4)


def test_a_sector_in_the_plane(tmp_path):
    """Its image has no axis; by the other order of the nodes it is turned back."""
    (contact,) = imported(tmp_path, wheel(60.0, 2))[0]["contact"]
    assert contact["image"]["turn"] == pytest.approx(60.0) and len(contact["image"]["pivot"]) == 2
    (found,) = solved(tmp_path, wheel(60.0, 2)).summary["contacts"].values()
    assert found["normal_force"] == pytest.approx(-5.0, rel=1e-8)
    back = wheel(60.0, 2).replace("A_Y1, 1, 1., A_Y0", "A_Y0, 1, 1., A_Y1")
    back = back.replace("A_Y1, 2, 1., A_Y0", "A_Y0, 2, 1., A_Y1")
    (contact,) = imported(tmp_path, back)[0]["contact"]
    assert contact["image"]["turn"] == pytest.approx(-60.0)


def test_opposite_faces_of_one_body_are_a_periodic_cell(tmp_path):
    """A layer of cells that is pressed by p, and free to get thicker in y alone, bears ν p across."""
    deck = BOX + "*BOUNDARY\nA_Z0, 3\nA_Y0, 2\n" + equal("A_X1", "A_X0")
    (contact,) = imported(tmp_path, deck + step("*DLOAD", "9, P2, 1."))[0]["contact"]
    assert contact["image"] == {"shift": [1.0, 0.0, 0.0]}
    pressed = step("*DLOAD", *(f"{k}, P2, 10." for k in range(9, 13)))
    (found,) = solved(tmp_path, deck + pressed).summary["contacts"].values()
    assert abs(found["normal_force"]) == pytest.approx(0.3 * 10.0 * 3.0, rel=1e-8)


def apart(one: str, two: str, ref: int, components=(1, 2, 3)) -> str:
    """Equations of the components of two sets that differ by those of a node."""
    rows = (f"3\n{one}, {k}, 1., {two}, {k}, -1., {ref}, {k}, -1.\n" for k in components)
    return "*NODE\n900, 9., 9., 9.\n901, 9., 9., 9.\n*EQUATION\n" + "".join(rows)


def test_a_cell_whose_faces_differ_by_a_given_displacement_is_stretched(tmp_path):
    """A cell, free to get thinner in y and z, is stretched by the displacement of a node, and back: E ε across."""
    deck = BOX + "*BOUNDARY\nA_Z0, 3\nA_Y0, 2\n900, 2, 3\n" + apart("A_X1", "A_X0", 900)
    stretched = deck + step("*BOUNDARY\n900, 1, 1, 0.01")
    (contact,) = imported(tmp_path, stretched)[0]["contact"]
    assert contact["image"] == {"shift": [1.0, 0.0, 0.0]} and contact["gap"] == 0.01
    answer = solved(tmp_path, stretched)
    (found,) = answer.summary["contacts"].values()
    assert found["normal_force"] == pytest.approx(-YOUNG * 0.01 * 3.0 * 1.0, rel=1e-7)
    back = stretched + step("*BOUNDARY\n900, 1, 1, -0.004")
    (contact,) = imported(tmp_path, back)[0]["contact"]
    assert contact["gap"]["value"] == 0.01
    (found,) = solved(tmp_path, back).summary["contacts"].values()
    assert found["normal_force"] == pytest.approx(YOUNG * 0.004 * 3.0, rel=1e-7)


def test_a_node_that_stays_gives_no_difference(tmp_path):
    """With a third node that is held, opposite faces are those of a periodic cell; so they are the other way around."""
    for pair in (("A_X1", "A_X0"), ("A_X0", "A_X1")):
        deck = BOX + "*BOUNDARY\nA_Z0, 3\nA_Y0, 2\n900, 1, 3\n" + apart(*pair, 900)
        (contact,) = imported(tmp_path, deck + step("*DLOAD", "9, P2, 1."))[0]["contact"]
        assert "gap" not in contact and contact["kind"] == "bonded"


COLUMNS = (
    grid("A", (2, 1, 2), (2.0, 1.0, 3.0))
    + "*MATERIAL, NAME=SOFT\n*ELASTIC\n1000., 0.\n*MATERIAL, NAME=HARD\n*ELASTIC\n3000., 0.\n"
    "*ELSET, ELSET=L\n1, 3\n*ELSET, ELSET=R\n2, 4\n*NODE\n900, 5., 5., 5.\n"
    "*SOLID SECTION, ELSET=L, MATERIAL=SOFT\n*SOLID SECTION, ELSET=R, MATERIAL=HARD\n*BOUNDARY\nA_Z0, 1, 3\n"
)
TOP = range(13, 19)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    "equations",
    [
        equal("A_Z1", "900", [3]),
        "*EQUATION\n" + "".join(f"2\n{k}, 3, 1., 900, 3, -1.\n" for k in TOP),
        equal("A_Z1", "900"),
        "*MPC\nPIN, A_Z1, 900\n",
    ],
)
def test_a_face_that_moves_as_one(tmp_path, equations):
    """Two columns under a plate that does not tilt: its node moves by F L / Σ E A."""
    deck = COLUMNS + equations + step("*CLOAD", "900, 3, 8.")
    scene, _ = imported(tmp_path, deck)
    guided = "1, 1.," not in equations and "PIN" not in equations
    assert scene["contact"][0]["kind"] == ("guided" if guided else "bonded")
    answer = solved(tmp_path, deck)
    top = answer.bodies[scene["body"][0]["name"]]
    at = np.isclose(top.points[:, 2], 3.0)
    assert top.displacement[at][:, 2] == pytest.approx(8.0 * 3.0 / 4000.0, rel=1e-8)


def test_flat_faces_that_meet_at_an_edge(tmp_path):
    """Both are guided, and have nodes in common: a bar stays a bar, and gets thinner by ν F L / (E A)."""
    nodes = "*NODE\n900, 5., 5., 5.\n901, 5., 5., 6.\n"
    equations = equal("A_X1", "900", [1]) + equal("A_Z1", "901", [3])
    deck = BOX + ROLLERS + nodes + equations + step("*CLOAD", "901, 3, 7.")
    scene, _ = imported(tmp_path, deck)
    assert [contact["kind"] for contact in scene["contact"]] == ["guided"] * 2
    u = solved(tmp_path, deck).bodies["A"].displacement
    assert u[:, 2].max() == pytest.approx(7.0 * 3.0 / YOUNG, rel=1e-8)
    assert u[:, 0].min() == pytest.approx(-0.3 * 7.0 / YOUNG, rel=1e-8)


def test_a_flat_side_in_the_plane(tmp_path):
    """Its line moves by F L / (E A) with the force of its node, which is per thickness."""
    deck = (
        grid("A", (3, 2), (3.0, 2.0), kind="CPS4") + STEEL + SECTION + "0.5\n*NODE\n900, 9., 9.\n"
    )
    deck += "*BOUNDARY\nA_X0, 1\nA_Y0, 2\n" + equal("A_X1", "900", [1])
    deck += step("*CLOAD", "900, 1, 7.")
    assert imported(tmp_path, deck)[0]["rigid"][0]["shape"] == "plane"
    u = solved(tmp_path, deck).bodies["A"].displacement
    assert u[:, 0].max() == pytest.approx(7.0 * 3.0 / (YOUNG * 2.0 * 0.5), rel=1e-8)


def test_a_face_that_follows_a_node_is_supported(tmp_path):
    """All nodes have the displacement of the one that is moved, over the coefficients; those of no face, too."""
    moved = "*BOUNDARY\n900, 3, 3, 0.006\n"
    deck = COLUMNS + equal("A_Z1", "900", [3], -2.0) + step(moved.strip())
    clamps = imported(tmp_path, deck)[0]["body"][0]["clamp"]
    assert {"on": "A_Z1", "z": 0.012} in clamps
    (body,) = solved(tmp_path, deck).summary["bodies"].values()  # Σ E A u / L
    assert body["reactions"]["A_Z1"]["force"][2] == pytest.approx(4000.0 * 0.012 / 3.0, rel=1e-8)
    single = COLUMNS + "*EQUATION\n1\n13, 1, 3.\n2\n14, 1, 1., 13, 1, -1.\n" + step()
    assert {"on": "fixed", "x": 0.0} in imported(tmp_path, single)[0]["body"][0]["clamp"]


def test_an_equation_of_one_node_is_a_support_along_a_direction(tmp_path):
    """0.6 u_x + 0.8 u_z = 0 on a face is a support along (0.6, 0, 0.8), as of *TRANSFORM."""
    rows = "".join(f"2\n{k}, 1, 3., {k}, 3, 4.\n" for k in TOP)
    slope = "*TRANSFORM, NSET=A_Z1\n0.6, 0., 0.8, 0., 1., 0.\n*BOUNDARY\nA_Z1, 1\n"
    pull = step("*DLOAD", "A, P5, 1.").replace("A,", "L,")
    one, two = (
        imported(tmp_path, COLUMNS + cards + pull)[0]["body"][0]["clamp"]
        for cards in ("*EQUATION\n" + rows, slope)
    )
    assert len(one) == len(two)
    for mine, its in zip(one, two, strict=True):
        assert mine["on"] == its["on"] and mine.get("along") == pytest.approx(its.get("along"))


def test_beams_of_multiple_points_are_a_rigid_body(tmp_path):
    """*MPC BEAM of the nodes of two faces and one node is *RIGID BODY of all."""
    loads = step("*CLOAD", "900, 3, 100.")
    beam = "*MPC\nBEAM, A_X1, 900\nBEAM, B_X0, 900\n"
    both = "*NSET, NSET=AB\nA_X1, B_X0\n" + RIGID.format("AB")
    assert imported(tmp_path, TWO + beam + loads)[0] == imported(tmp_path, TWO + both + loads)[0]


HALF = "*EQUATION\n" + "".join(
    f"2\n{19 + n}, {k}, 1., {101 + n}, {k}, -1.\n" for n in range(5) for k in (1, 2, 3)
)

# at one side supports move the two parts, and the pairs there say nothing of that
MOVED = "*EQUATION\n" + "".join(
    f"2\n{19 + n}, {k}, 1., {101 + n}, {k}, -1.\n"
    for n in range(9)
    for k in (1, 2, 3)
    if k > 1 or n % 3 < 2
)
MOVED = halves(MOVED).replace("*CLOAD", "*BOUNDARY\nA_X1, 1, 1, 0.01\nB_X1, 1, 1, 0.02\n*CLOAD")


@pytest.mark.parametrize(
    ("deck", "words"),
    [
        (halves(equal("A_Z1", "B_Z0", factor=-0.5)), "those of no tie, shift or turn"),
        (halves(equal("A_Z1", "B_Z0", [2])), "pairs of no tie, shift or turn"),
        (halves(equal("A_Z1", "B_Z0", [2, 3])), "those of no tie, shift or turn"),
        (halves(HALF), "pairs of nodes that are no whole faces"),
        (halves(equal("A_Z1", "B_Z1").replace("B_Z1", "B_X1")), "no whole faces"),
        (MOVED, "those of no tie, shift or turn"),
        (COLUMNS + equal("A_Z1", "900", [1]) + step(), "not along all axes or the normal"),
        (COLUMNS + equal("A_Z1", "900", [1, 3]) + step(), "not along all axes or the normal"),
        (COLUMNS + equal("A_Z1", "900", [3], -2.0) + step(), "not equal along one axis"),
        (COLUMNS + equal("14", "13", [3]) + equal("15", "13", [3]) + step(), "no whole faces"),
        (
            COLUMNS + "*EQUATION\n3\n13, 3, 1., 14, 3, 1., 15, 3, 1.\n" + step(),
            "several free displacements",
        ),
        (
            BOX + apart("A_X1", "A_X0", 900) + step("*BOUNDARY\n900, 1, 3, 0.01"),
            "not along the normal of a flat face",
        ),
        (
            BOX
            + apart("A_X1", "A_X0", 900, [1, 3])
            + apart("A_X1", "A_X0", 901, [2]).partition("*EQUATION\n")[2]
            + step("*BOUNDARY\n900, 1, 1, 0.01\n900, 3, 3\n*BOUNDARY\n901, 2, 2, 0.02"),
            "differences that are given by several nodes",
        ),
        (
            COLUMNS
            + "*EQUATION\n3\n14, 3, 1., 13, 3, -1., 900, 3, 1.\n3\n15, 3, 1., 13, 3, -1., 900, 3, 1.\n"
            + step("*BOUNDARY\n900, 3, 3, 0.01"),
            "displacements that differ by a given one, of no pairs",
        ),
        (COLUMNS + "*MPC\nMEANROT, 13, 14, 900\n" + step(), "MEANROT: of these BEAM, PIN and TIE"),
        (COLUMNS + "*EQUATION\n2\n13, 3, 1., 13, 3, 2.\n" + step(), "a component of node 13 twice"),
        (COLUMNS + "*EQUATION\n2\n13, 3, 1., 14, 3, 2.\n" * 2 + step(), "twice, also on line"),
        (COLUMNS + "*EQUATION\n2\n13, 3, 0., 14, 3, 2.\n" + step(), "the first one counts"),
        (COLUMNS + "*EQUATION\n2\n13, 3, 1., 14, 5, 2.\n" + step(), "the components 1 to 3 alone"),
        (COLUMNS + "*EQUATION\n2\n13, 3, 1., 99, 3, 2.\n" + step(), "there is no node 99"),
        (COLUMNS + "*EQUATION\n2\nA_Z1, 3, 1., A_Y0, 3, 2.\n" + step(), "sets of different sizes"),
        (COLUMNS + "*EQUATION\n2\n13, 3, 1., 14, 3\n" + step(), "a data line is too short"),
        (COLUMNS + "*EQUATION, REMOVE\n" + step(), "its parameter REMOVE is not possible"),
        (
            COLUMNS
            + "*NODE\n901, 9., 0., 0.\n*EQUATION\n3\n13, 3, 1., 900, 3, 1., 901, 3, 1.\n"
            + step("*BOUNDARY", "900, 3, 3, 1.", "901, 3, 3, 2."),
            "several free displacements",
        ),
        (
            COLUMNS
            + "*NSET, NSET=P\n13,\n*TRANSFORM, TYPE=C, NSET=P\n0., 0., 0., 0., 0., 1.\n"
            + "*EQUATION\n2\n13, 1, 1., 13, 2, 1.\n"
            + step(),
            "several free displacements",
        ),
        (wheel(80.0), "a turn by 80 degrees that does not close"),
    ],
)
def test_other_equations_are_refused_by_line(tmp_path, deck, words):
    """Unlike coefficients, parts of faces, sides moved apart, a node twice, nodes on an axis, and what no scene has."""
    message = refused(tmp_path, deck)
    assert words in message
    assert re.search(r"line.* \d+.*: \*(EQUATION|MPC): ", message)
