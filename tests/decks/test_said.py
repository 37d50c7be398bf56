"""Both sides of what `ddmpi import` says of a deck: a deck of which it is said, and one beside it of which it is not."""

import pytest
from decks import STEEL, grid, step
from test_import import BOX, COUPLED, LAW, PAIR, PRESS, ROLLERS, bolt, imported, stack

from ddmpi.errors import InputError

PULL = step("*CLOAD", "A_Z1, 3, 1.")
GRAVITY = step("*DLOAD", "A, GRAV, 9810., 0., 0., -1.")


def heated(last: str) -> str:
    """Nodes at the bottom whose temperature changes in a second step as that of the top, or to another one."""
    first, second = (
        step("*TEMPERATURE", f"A_Z1, {top}", f"A_Z0, {low}") for top, low in ((50, 20), (100, last))
    )
    return BOX + ROLLERS + first + second


def of_two(dense: str) -> str:
    """A body of two materials under its weight, of which the lower one has another density."""
    soft = STEEL.replace("STEEL", "SOFT").replace("7.8e-9", dense)
    sets = "*ELSET, ELSET=LOW, GENERATE\n1, 4\n*ELSET, ELSET=HIGH, GENERATE\n5, 12\n"
    sections = "".join(
        f"*SOLID SECTION, ELSET={name}, MATERIAL={material}\n"
        for name, material in (("LOW", "SOFT"), ("HIGH", "STEEL"))
    )
    mesh = grid("A", (2, 2, 3), (1.0, 1.0, 3.0))
    return mesh + STEEL + soft + sets + sections + ROLLERS + GRAVITY


def placed(turn: str = "", part: str = "Block") -> str:
    """A block in an assembly, which an instance of a part has turned."""
    return (
        "*PART, NAME=Block\n"
        + grid("ALL", (1, 1, 1), (1.0, 1.0, 1.0))
        + "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL\n*END PART\n*ASSEMBLY, NAME=S\n*INSTANCE, NAME=low, "
        f"PART={part}\n0., 0., 1.\n{turn}*END INSTANCE\n*END ASSEMBLY\n{STEEL}"
        "*BOUNDARY\nlow.ALL_Z0, 1, 3\n" + step("*CLOAD", "low.ALL_Z1, 3, 1.")
    )


def twisted(held: str) -> str:
    """A rigid face that turns by what its node is given, and goes where it wants, or not."""
    given = step("*BOUNDARY", "900, 4, 4", "900, 5, 5, 0.02", "900, 6, 6", *held.split("|"))
    return COUPLED + "*RIGID BODY, NSET=A_Z1, REF NODE=900\n" + given


def removed(more: str) -> str:
    """A second step that removes the contact of a stack, which its last step has or not."""
    law = stack(PAIR, LAW).replace("*BOUNDARY\n", "*BOUNDARY\nB_Z0, 3\n", 1)
    return law + PRESS + step(*more.split("|"))


def wedge() -> str:
    """A wedge of order 2 that is pressed from above."""
    corners = [(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
    ends = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
    middles = [
        [0.5 * (a + b) for a, b in zip(corners[i], corners[j], strict=True)] for i, j in ends
    ]
    nodes = "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate([*corners, *middles], 1))
    element = ", ".join(map(str, [1, *range(1, 16)]))
    body = f"*NODE\n{nodes}*ELEMENT, TYPE=C3D15, ELSET=A\n{element}\n{STEEL}"
    held = "*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n*NSET, NSET=A_Z0\n1, 2, 3\n*BOUNDARY\nA_Z0, 1, 3\n"
    return body + held + step("*DLOAD", "1, P2, 1.")


def ring(bore: float) -> str:
    """A ring far away along its axis, with a pressure in its bore."""
    body = grid("A", (2, 2), (1.0, 1.0), [bore, 1000.0], kind="CAX4") + STEEL
    held = "*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n*BOUNDARY\nA_Y0, 2\n"
    return body + held + step("*DLOAD", "1, P4, 1.")


TWO_SETS = COUPLED + "*RIGID BODY, NSET=A_Z1, REF NODE=900\n"

SIDES = {
    "the material STEEL has no *DENSITY": [
        (BOX + ROLLERS + GRAVITY).replace(f"*DENSITY\n{given}", "") for given in ("7.8e-9\n", "0")
    ],
    "GRAV on a body with several densities": [of_two("7.9e-9"), of_two("7.8e-9")],
    "temperatures that change in different ways in one body": [heated("41"), heated("40")],
    "the instance low is of a part Blok, which is not there": [placed(part="Blok"), placed()],
    "has node 2, which is not there; is the file cut off?": [
        BOX.replace("2, 0.5, 0.0, 0.0\n", "") + PULL,
        BOX + ROLLERS + PULL,
    ],
    "an instance is turned by 7 numbers, and one has 6": [
        placed("0., 0., 0., 0., 0., 1.\n"),
        placed("0., 0., 0., 0., 0., 1., 30.\n"),
    ],
    "*DSLOAD: the surface S is empty": [
        BOX + ROLLERS + f"*SURFACE, NAME=S\n{row}" + step("*DSLOAD", "S, P, 1.")
        for row in ("99, S1\n", "99, S1\n9, S2\n")
    ],
    "*CONTACT PAIR: the surface SLAVE is empty": [
        stack(PAIR, LAW).replace("SLAVE, TYPE=NODE\nB_Z0", f"SLAVE\n{row}") + PRESS
        for row in ("", "B, S1")
    ],
    "*CONTACT PAIR: the surface MASTER has a side SPOS that is no face S1 to S6": [
        stack(PAIR, LAW).replace("A, S2", "A, SPOS") + PRESS,
        stack(PAIR, LAW) + PRESS,
    ],
    "there is a surface master on line 197 already": [
        stack(PAIR, f"{LAW}*SURFACE, NAME={name}, TYPE=NODE\n2\n") + PRESS
        for name in ("master", "other")
    ],
    "a bond over a gap": [
        bolt() + step("*BOUNDARY", "900, 1, 1, 0.002"),
        bolt() + step("*CLOAD", "900, 1, 50."),
    ],
    "SLAVE or INNER has no faces on a body": [
        stack(PAIR, f"{LAW}*SURFACE, NAME=INNER\n1, S4\n", first=f"SLAVE, {name}") + PRESS
        for name in ("INNER", "MASTER")
    ],
    "elements of type CPS4 without a section are left out": [
        BOX + faces + ROLLERS + PULL
        for faces in ("*ELEMENT, TYPE=CPS4, ELSET=F\n91, 1, 2, 5, 4\n", "")
    ],
    "element 1 of A has no *SOLID SECTION": [
        (BOX + "*ELEMENT, TYPE=S4, ELSET=F\n91, 1, 2, 5, 4\n" + ROLLERS + PULL).replace(*words)
        for words in (
            ("*SOLID SECTION, ELSET=A", "*SHELL SECTION, ELSET=F"),
            ("*SHELL", "*SOLID"),
        )
    ],
    "there is no surface SLAV": [
        stack(PAIR, LAW, first=f'"{name}", "master"') + PRESS for name in ("SLAV", "slave")
    ],
    "there is no node low.9": [
        placed().replace("low.ALL_Z0, 1, 3", f"low.{node}, 1, 3") for node in (9, 8)
    ],
    "TYPE=PGPGMORTAR is not possible": [
        stack(f"{PAIR}, TYPE={kind}MORTAR".replace(", TYPE=SURFACE TO SURFACE", ""), LAW) + PRESS
        for kind in ("PGPG", "PG")
    ],
    "its parameter CONSTANT is not possible": [
        BOX + ROLLERS + "*SURFACE, NAME=S\n9, S2\n" + step(f"*DSLOAD, CONSTANT{way}", "S, P, 1.")
        for way in ("", " RESULTANT=YES")
    ],
    "a face that is not on a boundary; those on the axis are not": [
        ring(0.0),
        ring(1e-4),
    ],
    "C3D15 cut into quadratic tetrahedra": [wedge(), BOX + ROLLERS + PULL],
    "the material STEEL has no *ELASTIC": [
        BOX.replace("*ELASTIC\n210000., 0.3\n", "") + ROLLERS + PULL,
        BOX + ROLLERS + PULL,
    ],
    "a clearance without one VALUE": [
        stack(PAIR, f"{LAW}*CLEARANCE, SLAVE=SLAVE, MASTER=MASTER{value}\n", 0.05) + PRESS
        for value in ("", ", VALUE=0.02")
    ],
    "a contact that is removed": [
        removed("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE|SLAVE, MASTER"),
        removed("*NODE PRINT, NSET=A_Z1|U"),
    ],
    "this step is left out, as are its loads and supports; the scene is that of the *STATIC steps before": [
        BOX + ROLLERS + PULL + step().replace("STATIC", word) for word in ("FREQUENCY\n3", "STATIC")
    ],
    "the stick slope is dropped: nodes stick without slip": [
        stack(PAIR, f"*SURFACE INTERACTION, NAME=I\n*FRICTION\n0.2, {slope}\n") + PRESS
        for slope in ("1e-9", "0.")
    ],
    "a distributing coupling whose reference node is held": [
        COUPLED
        + "*COUPLING, CONSTRAINT NAME=C, REF NODE=900, SURFACE=TOP\n*DISTRIBUTING\n"
        + step(*("*BOUNDARY", "900, 2")[:k], "*CLOAD", "900, 1, 3.")
        for k in (2, 0)
    ],
    "its turns are given, and some of its displacements are free": [
        twisted("900, 1, 2"),
        twisted("900, 1, 3"),
    ],
    "2 sets with one reference node are one rigid body, as in Abaqus": [
        TWO_SETS + second + step("*CLOAD", "900, 3, 3.")
        for second in ("*RIGID BODY, NSET=A_Y1, REF NODE=900\n", "")
    ],
}
"""By words the deck of which they are said, and one of which they are not."""


def said_of(folder, deck: str) -> str:
    """The lists of a deck, or the message that refuses it."""
    try:
        return imported(folder, deck)[1]
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("words", SIDES)
def test_what_is_said_of_one_deck_and_not_of_its_neighbour(tmp_path, words):
    """In the lists or in a refusal; the neighbour becomes a scene."""
    past, before = SIDES[words]
    assert words in said_of(tmp_path, past)
    assert words not in imported(tmp_path, before)[1]
