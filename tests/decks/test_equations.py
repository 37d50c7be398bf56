"""`ddmpi import`: equations between nodes become supports, or are lost by line."""

import re

import pytest
from decks import grid, step
from test_import import imported, refused, solved


def equal(one: str, two: str, components=(1, 2, 3), factor: float = -1.0) -> str:
    """Equations of the components of two nodes, or of two sets."""
    return "*EQUATION\n" + "".join(f"2\n{one}, {k}, 1., {two}, {k}, {factor}\n" for k in components)


COLUMNS = (
    grid("A", (2, 1, 2), (2.0, 1.0, 3.0))
    + "*MATERIAL, NAME=SOFT\n*ELASTIC\n1000., 0.\n*MATERIAL, NAME=HARD\n*ELASTIC\n3000., 0.\n"
    "*ELSET, ELSET=L\n1, 3\n*ELSET, ELSET=R\n2, 4\n*NODE\n900, 5., 5., 5.\n"
    "*SOLID SECTION, ELSET=L, MATERIAL=SOFT\n*SOLID SECTION, ELSET=R, MATERIAL=HARD\n*BOUNDARY\nA_Z0, 1, 3\n"
)
TOP = range(13, 19)


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


@pytest.mark.parametrize(
    ("deck", "words"),
    [
        (COLUMNS + equal("A_Z1", "900", [3]) + step(), "several free displacements"),
        (
            COLUMNS + "*EQUATION\n3\n13, 3, 1., 14, 3, 1., 15, 3, 1.\n" + step(),
            "several free displacements",
        ),
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
    ],
)
def test_other_equations_are_refused_by_line(tmp_path, deck, words):
    """Several unknown displacements, two given ones, none on an axis, a node twice, and cards that are cut off."""
    message = refused(tmp_path, deck)
    assert words in message
    assert re.search(r"line.* \d+.*: \*EQUATION: ", message)
