"""`ddmpi import`: decks become scenes with the same loads, supports and contacts; what is lost refuses the deck."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from decks import STEEL, grid, step
from mpi4py import MPI
from scenes import call

import ddmpi
from ddmpi.decks.scene import import_deck
from ddmpi.errors import InputError, TakenError
from ddmpi.scene.formulas import evaluate

SECTION = "*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n"
BOX = grid("A", (2, 2, 3), (1.0, 1.0, 3.0)) + STEEL + SECTION
ROLLERS = "*BOUNDARY\nA_Z0, 3\nA_X0, 1\nA_Y0, 2\n"
YOUNG = 210000.0


def imported(folder: Path, text: str, partial: bool = False) -> tuple[dict, str]:
    """The scene of a deck and the lists. Each deck has a new folder of its own in `folder`."""
    own = folder / f"{len([*folder.iterdir()])}"
    own.mkdir()
    (own / "deck.inp").write_text(text)
    lists = import_deck(own / "deck.inp", own / "deck", partial)
    return tomllib.loads((own / "deck" / "scene.toml").read_text()), lists


def solved(folder: Path, text: str):
    """The certified answer to a deck."""
    imported(folder, text)
    scene = max(folder.glob("*/deck/scene.toml"), key=lambda path: int(path.parts[-3]))
    answer = ddmpi.solve(str(scene), MPI.COMM_SELF)
    assert answer.certified, answer.reason
    return answer


def refused(folder: Path, text: str, partial: bool = False) -> str:
    before = len([*folder.glob("*/deck")])
    with pytest.raises(InputError) as caught:
        imported(folder, text, partial)
    assert len([*folder.glob("*/deck")]) == before
    return str(caught.value)


def test_a_bar_under_pressure(tmp_path):
    """A deck without contact: supports on sets, a positive pressure on faces presses, bricks stay bricks."""
    deck = BOX + ROLLERS + step("*DLOAD", *(f"{k}, P2, 21." for k in range(9, 13)))
    scene, lists = imported(tmp_path, deck)
    assert (
        scene["body"][0]["mesh"] == {"file": "A.inp", "order": 1, "integration": "full"}
        and "contact" not in scene
        and "time" not in scene
    )
    assert scene["body"][0]["clamp"] == [
        {"on": "A_X0", "x": 0.0},
        {"on": "A_Y0", "y": 0.0},
        {"on": "A_Z0", "z": 0.0},
    ]
    assert (
        "line 131: *BOUNDARY: clamps" in lists
        and "*DLOAD: pressure" in lists
        and "lost:\n  nothing\n" in lists
    )
    u = solved(tmp_path, deck).bodies["A"].displacement
    assert u.min(axis=0) == pytest.approx([0.0, 0.0, -21.0 * 3 / YOUNG], rel=1e-9, abs=1e-15)
    assert u[:, :2].max(axis=0) == pytest.approx([0.3 * 21 / YOUNG] * 2, rel=1e-9)


def test_loads_of_a_step_add(tmp_path):
    """At one place, of one keyword or of several, as in CalculiX."""
    faces = [f"{k}, P2, 10." for k in range(9, 13)]
    deck = (
        BOX
        + ROLLERS
        + step(
            "*DLOAD",
            *faces,
            *(face.replace("10.", "11.") for face in faces),
            "*CLOAD",
            "A_X1, 1, 2.",
            "A_X1, 1, -2.",
        )
    )
    reaction = solved(tmp_path, deck).summary["bodies"]["A"]["reaction"]
    assert reaction == pytest.approx([0.0, 0.0, 21.0], abs=1e-9)


def scattered(rng: np.random.Generator, nodes: list[int]) -> str:
    return (
        "*CLOAD\n"
        + "\n".join(f"{node}, {k}, {rng.normal():.6f}" for node in nodes for k in (1, 2, 3))
        + "\n"
    )


@pytest.mark.parametrize("nodes", [list(range(28, 37)), [28, 30], [28, 29, 31, 32]])
def test_nodal_forces_keep_their_resultant_and_moments(tmp_path, nodes):
    """Forces at nodes keep their resultant when spread over faces, and on whole faces their moment."""
    deck = (
        BOX
        + "*BOUNDARY\nA_Z0, 1, 3\n"
        + scattered(np.random.default_rng(1), nodes)
        + step("*DLOAD", "1, P1, 0.")
    )
    rows = [line.split(",") for line in deck.split("*CLOAD\n")[1].splitlines()[: 3 * len(nodes)]]
    places = {
        int(row[0]): [float(x) for x in row[1:]]
        for row in (line.split(",") for line in deck.split("*ELEMENT")[0].splitlines()[1:])
    }
    force, moment = np.zeros(3), np.zeros(3)
    for node, k, value in rows:
        one = np.eye(3)[int(k) - 1] * float(value)
        force, moment = force + one, moment + np.cross(places[int(node)], one)
    loads = solved(tmp_path, deck).summary["bodies"]["A"]["loads"]
    assert np.sum([load["force"] for load in loads.values()], axis=0) == pytest.approx(
        force, rel=1e-9
    )
    whole = len(nodes) in (4, 9)
    assert np.sum([load["moment"] for load in loads.values()], axis=0) == pytest.approx(
        moment, rel=1e-9 if whole else 0.3, abs=1e-9 if whole else 0.3
    )


def stack(card: str, more: str = "", gap: float = 0.0, first: str = "SLAVE, MASTER") -> str:
    """Two boxes with different meshes, the upper one pressed down; rollers around."""
    boxes = grid("A", (3, 2, 1), (1.0, 1.0, 1.0)) + grid(
        "B", (2, 2, 2), (1.0, 1.0, 1.0), [0.0, 0.0, 1.0 + gap], 101
    )
    sides = "".join(f"{name}_X0, 1\n{name}_X1, 1\n{name}_Y0, 2\n{name}_Y1, 2\n" for name in "AB")
    return (
        boxes
        + STEEL
        + SECTION
        + "*SOLID SECTION, ELSET=B, MATERIAL=STEEL\n*SURFACE, NAME=MASTER\nA, S2\n"
        "*SURFACE, NAME=SLAVE, TYPE=NODE\nB_Z0\n"
        + more
        + f"{card}\n{first}\n*BOUNDARY\nA_Z0, 3\n{sides}"
    )


def test_contact_friction_and_load_steps(tmp_path):
    """Surfaces of elements and of nodes, friction, and two steps: reactions are those of confined boxes."""
    law = "*SURFACE INTERACTION, NAME=I\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n1e6, 3.\n*FRICTION\n0.2, 5e4\n"
    deck = (
        stack("*CONTACT PAIR, INTERACTION=i, TYPE=SURFACE TO SURFACE", law)
        + step("*BOUNDARY", "B_Z1, 3, 3, -0.001", options=", NLGEOM")
        + step("*BOUNDARY", "B_Z1, 3, 3, -0.0004", time="1., 2.")
    )
    scene, lists = imported(tmp_path, deck)
    assert scene["contact"] == [
        {
            "name": "B-A",
            "bodies": ["B", "A"],
            "on": ["SLAVE", "MASTER"],
            "friction": {"law": "coulomb", "coefficient": 0.2},
            "softness": 1e-6,
            "slave": "B",
        }
    ]
    assert scene["time"] == {"points": [1.0, 3.0]}
    assert scene["history"] == {"h1": {"times": [0.0, 1.0, 3.0], "factors": [0.0, 1.0, 0.4]}}
    for words in ("stick slope", "warning: NLGEOM"):
        assert words in lists.split("changed:")[1]
    assert "a soft joint, without tension" in lists
    answer = solved(tmp_path, deck)
    modulus = YOUNG * 0.7 / 1.3 / 0.4
    assert [
        step["contacts"]["B-A"]["normal_force"]
        for step in answer.summary["steps"]
        if step["time"] in (1.0, 3.0)
    ] == pytest.approx(np.array([0.001, 0.0004]) / (2.0 / modulus + 1e-6), rel=1e-6)


def test_a_soft_joint_by_a_table(tmp_path):
    """Pressures over overclosures, of which the last two count; one that gets softer is lost."""
    law = LAW + "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=TABULAR\n0., 0.\n20., 1e-4\n200., 2e-4\n"
    deck = stack(PAIR, law) + step("*BOUNDARY", "B_Z1, 3, 3, -0.001")
    contact = solved(tmp_path, deck).contacts["B-A"]
    pressed = (0.001 - 1e-4 + 20.0 / 1.8e6) / (2.0 / (YOUNG * 0.7 / 1.3 / 0.4) + 1.0 / 1.8e6)
    assert contact.pressure == pytest.approx(np.full(len(contact.pressure), pressed), rel=1e-6)
    assert contact.gap == pytest.approx(-1e-4 - (pressed - 20.0) / 1.8e6, rel=1e-6)
    softer = deck.replace("200., 2e-4", "30., 2e-4")
    assert "*SURFACE BEHAVIOR: beyond a pressure of 20 the joint gets softer" in refused(
        tmp_path, softer
    )
    slope = LAW + "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n0., 3.\n"
    assert "the slope of pressure over overclosure must be positive" in refused(
        tmp_path, stack(PAIR, slope) + step("*BOUNDARY", "B_Z1, 3, 3, -0.001")
    )


def test_contact_laws_that_change(tmp_path):
    """Friction goes to its new coefficient over its step; another stiffness is that of the end, without friction."""
    press, law = step("*BOUNDARY", "B_Z1, 3, 3, -0.001"), LAW + "*FRICTION\n0.2\n"
    change = step("*CHANGE FRICTION, INTERACTION=I", "*FRICTION", "0.5")
    scene, lists = imported(tmp_path, stack(PAIR, law) + press + change + press)
    coefficient = scene["contact"][0]["friction"]["coefficient"]
    assert (
        coefficient["value"] == 0.5 and "friction goes to this coefficient over the step" in lists
    )
    assert scene["history"][coefficient["history"]] == {
        "times": [0.0, 1.0, 2.0, 3.0],
        "factors": [0.4, 0.4, 1.0, 1.0],
    }
    one = imported(
        tmp_path,
        stack(PAIR, law)
        + press.replace("*STATIC", "*STATIC\n*CHANGE FRICTION, INTERACTION=I\n*FRICTION\n0."),
    )[0]
    assert one["contact"][0]["friction"]["coefficient"]["value"] == 0.2
    soft = step(
        "*CHANGE SURFACE BEHAVIOR, INTERACTION=I",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        "1e5",
    )
    scene, lists = imported(tmp_path, stack(PAIR, LAW) + press + soft)
    assert scene["contact"][0]["softness"] == 1e-5 and "time" not in scene
    assert "a contact law that changes: only the state at the end" in lists
    assert "*CHANGE SURFACE BEHAVIOR: a contact law that changes" in refused(
        tmp_path, stack(PAIR, law) + press + soft
    )
    assert "there is no *SURFACE INTERACTION J" in refused(
        tmp_path, stack(PAIR, law) + press + change.replace("=I", "=J")
    )


def test_uneven_forces_are_no_double_load(tmp_path):
    """The even part and the rest are loads of groups of their own, without a warning of loads that add up."""
    deck = (
        BOX
        + "*BOUNDARY\nA_Z0, 1, 3\n"
        + step("*CLOAD", *(f"{28 + k}, 3, {1 + k}." for k in range(9)))
    )
    answer = solved(tmp_path, deck)
    loads = answer.summary["bodies"]["A"]["loads"]
    assert loads.keys() == {"loaded", "loaded_uneven"}
    assert loads["loaded"]["force"] == pytest.approx([0.0, 0.0, 45.0], abs=1e-9)
    assert loads["loaded_uneven"]["force"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert not [words for words in answer.summary["warnings"] if "times" in words]


def test_rotations_far_from_the_origin_keep_their_digits(tmp_path):
    """Supports that turn a face about its middle, 1000 km away, have the deck's values but for rounding."""
    far, turn = 1e6, 1e-3 / 3.0
    deck = grid("A", (2, 2, 3), (1.0, 1.0, 3.0), [far, 0.0, 0.0]) + STEEL + SECTION + ROLLERS
    x = far + np.array([0.0, 0.5, 1.0])
    rows = [f"{28 + k}, 3, 3, {turn * (x[k % 3] - far - 0.4)!r}" for k in range(9)]
    clamp = imported(tmp_path, deck + step("*BOUNDARY", *rows))[0]["body"][0]["clamp"]
    (moved,) = (entry["z"] for entry in clamp if isinstance(entry.get("z"), str))
    assert evaluate(moved, x) == pytest.approx(
        turn * (x - far - 0.4), rel=0.0, abs=2.0 * np.spacing(turn * far)
    )


PAIR, LAW = "*CONTACT PAIR, INTERACTION=I", "*SURFACE INTERACTION, NAME=I\n"


def test_odd_order_case_and_continued_lines(tmp_path):
    """Order, case, blanks, continued keywords, generated and nested sets, includes, D exponents: the same scene."""
    plain = BOX + ROLLERS + step("*CLOAD", "A_Z1, 3, 100.")
    nodes, rest = grid("A", (2, 2, 3), (1.0, 1.0, 3.0)).split("*NSET", 1)
    (tmp_path / "nodes.inp").write_text(nodes)
    odd = (
        "** a comment\n*Heading\nno keyword, really\n*solid section ,material = steel,\nelset=a\n*Boundary\na_z0,3\n"
        "a_x0 , 1,1\na_y0,2,2,0.\n*include,\ninput=../nodes.inp\n*NSET"
        + rest
        + "*NSET, NSET=part, GENERATE\n28, 36\n*NSET, NSET=LOADED\npart\n*material,\nname=Steel\n*elastic,type="
        "isotropic\n2.1D5, 3.d-1\n*step, inc=1000\n*STATIC\n*Cload , op=mod\nloaded,3,1.E+2\n*NODE PRINT, "
        "NSET=A_Z1\nU\n*endstep\n"
    )
    one, two = imported(tmp_path, plain)[0], imported(tmp_path, odd)[0]
    assert one == two
    assert len({path.read_text() for path in tmp_path.glob("*/deck/A.inp")}) == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(", ", ",\t"),
        lambda text: text.replace(ROLLERS, "*BOUNDARY\nA_Z0, 3\n*INCLUDE, INPUT=../more.inc\n"),
        lambda text: text.replace(ROLLERS, "*BOUNDARY, INPUT=../more.inc\nA_Z0, 3\n"),
    ],
)
def test_files_of_other_programs(tmp_path, change):
    """Marks of UTF-8, ends of lines of Windows, tabs, data lines in files by INCLUDE or INPUT: no difference."""
    plain = BOX + ROLLERS + step("*CLOAD", "A_Z1, 3, 100.")
    (tmp_path / "more.inc").write_text("A_X0, 1\nA_Y0, 2\n")
    one, two = imported(tmp_path, plain)[0], imported(tmp_path, change(plain))[0]
    assert change(plain) != plain and one == two


def test_names_that_differ_by_one_umlaut(tmp_path):
    """Names in the older encoding of Windows are told apart."""
    deck = (
        BOX.replace("A_Z1", "Träger").replace("A_X1", "Tröger")
        + ROLLERS
        + step("*CLOAD", "Träger, 3, 1.")
    )
    (tmp_path / "deck.inp").write_bytes(deck.encode("latin-1"))
    import_deck(tmp_path / "deck.inp", tmp_path / "out")
    scene = tomllib.loads((tmp_path / "out" / "scene.toml").read_text())
    assert scene["body"][0]["traction"][0]["force"] == [0.0, 0.0, 9.0]


@pytest.mark.parametrize(
    "load",
    [
        "*CLOAD\nA_Y1, 3, 1.",
        "*DLOAD\nA, GRAV, 9810., 0., 0., -1.",
        "*DLOAD\nA, BZ, 1.",
        "*DLOAD\nA, CENTRIF, 9., 0., 0., 0., 0., 1., 1.",
        "*DSLOAD\nT, TRVEC, 5., 0., 1., 1.",
    ],
)
def test_loads_out_of_the_plane_are_lost(tmp_path, load):
    """They have no place in a scene in the plane; around an axis neither has a rotation about another one."""
    deck = (
        grid("A", (2, 2), (1.0, 1.0), (1.0, 0.0))
        + STEEL
        + SECTION
        + ("*SURFACE, NAME=T\n3, S3\n4, S3\n*BOUNDARY\nA_Y0, 1, 2\n")
    )
    assert "a load out of the plane" in refused(tmp_path, deck + step(load))
    about = step("*DLOAD", "A, CENTRIF, 9., 0., 0., 0., 1., 0., 0.")
    assert "another axis than that of the body" in refused(
        tmp_path, deck.replace("CPE4", "CAX4") + about
    )
    assert imported(tmp_path, deck + about)[0]["body"][0]["volume_force"][0] == 0.0


def test_perturbation_steps(tmp_path):
    """A single one without contact is linear as well; beside others its loads would not add to theirs."""
    pull = step("*CLOAD", "A_Z1, 3, 1.")
    alone = pull.replace("*STEP", "*STEP, PERTURBATION")
    assert (
        imported(tmp_path, BOX + ROLLERS + alone)[0] == imported(tmp_path, BOX + ROLLERS + pull)[0]
    )
    assert "*STEP: its parameter PERTURBATION" in refused(tmp_path, BOX + ROLLERS + pull + alone)


def test_amplitudes(tmp_path):
    """One step has the values at its end, less the delay; several follow tables, until OP=NEW removes a load."""
    ramp = "*AMPLITUDE, NAME=UP\n0., 0., 1., 0.5, 2., 3.\n*AMPLITUDE, NAME=ALL, TIME=TOTAL TIME\n0., 1., 4., 0.\n"
    end = step("*CLOAD, AMPLITUDE=UP, TIME DELAY=0.5", "A_Z1, 3, 9.", time="0.1, 2.")
    load = imported(tmp_path, BOX + ROLLERS + ramp + end)[0]["body"][0]["traction"]
    assert load == [{"on": "loaded", "force": [0.0, 0.0, 9 * 9.0 * 1.75]}]
    more = step(
        "*CLOAD, AMPLITUDE=ALL", "A_Z1, 3, 9.", "*DLOAD, AMPLITUDE=UP", "9, P2, 4.", time="0.1, 2."
    ) + step("*CLOAD, OP=NEW", "A_X1, 1, 1.")
    scene = imported(tmp_path, BOX + ROLLERS + ramp + more)[0]
    loads = {
        history.get("pressure", 0.0) or tuple(history["force"]): scene["history"][
            history["history"]
        ]
        for history in scene["body"][0]["traction"]
    }
    assert loads[12.0] == {
        "times": [0.0, 1.0, 2.0, 3.0],
        "factors": [0.0, pytest.approx(1 / 6), 1.0, 1.0],
    }
    assert loads[0.0, 0.0, 81.0] == {
        "times": [0.0, 0.002, 2.0, 3.0],
        "factors": [0.0, 1.0, 0.5, 0.0],
    }
    assert loads[12.0, 0.0, 0.0] == {"times": [0.0, 2.0, 3.0], "factors": [0.0, 0.0, 1.0]}
    assert scene["time"] == {"points": [2.0, 3.0], "steps": 1}


def test_local_directions(tmp_path):
    """*TRANSFORM turns forces and supports; only a node on the axis of a cylinder has no direction."""
    turned = "*TRANSFORM, NSET=A_X1, TYPE=R\n0., 0., 1., 0., 1., 0.\n"
    scene = imported(tmp_path, BOX + ROLLERS + turned + step("*CLOAD", "A_X1, 1, 2."))[0]
    assert scene["body"][0]["traction"][0]["force"] == pytest.approx([0.0, 0.0, 24.0])
    points = np.array(
        [[np.cos(a) * r, np.sin(a) * r] for r in (1.0, 2.0) for a in np.linspace(0.0, np.pi / 2, 5)]
    )
    ring = "*NODE\n" + "\n".join(
        f"{k}, {x!r}, {y!r}" for k, (x, y) in enumerate(points.tolist(), 1)
    )
    ring += "\n*ELEMENT, TYPE=CPE4, ELSET=A\n" + "\n".join(
        f"{k}, {k}, {k + 5}, {k + 6}, {k + 1}" for k in range(1, 5)
    )
    ring += f"\n*NSET, NSET=IN, GENERATE\n1, 5\n*TRANSFORM, NSET=IN, TYPE=C\n0, 0, 0, 0, 0, 1\n{STEEL}{SECTION}"
    scene = imported(tmp_path, ring + "*BOUNDARY\nIN, 1\n1, 2\n" + step("*DLOAD", "1, P2, 1."))[0]
    radial = {"along": ["0.0 + (1.0) * x", "0.0 + (1.0) * y"], "value": 0.0}
    assert [radial.items() <= clamp.items() for clamp in scene["body"][0]["clamp"]] == [False, True]
    on_axis = ring.replace("0, 0, 0, 0, 0, 1", "1, 0, 0, 1, 0, 1")
    assert "*BOUNDARY: a direction of *TRANSFORM at a node on its axis" in refused(
        tmp_path, on_axis + "*BOUNDARY\nIN, 1\n" + step("*DLOAD", "1, P2, 1.")
    )
    imported(tmp_path, on_axis + "*BOUNDARY\n1, 1, 2\n2, 1\n" + step("*DLOAD", "1, P2, 1."))


def turned_nodes(deck: str, R: np.ndarray) -> str:
    """A deck whose nodes (x, y, z) are turned by R."""

    def turned(line: str) -> str:
        node, *at = line.split(",")
        return f"{node}, " + ", ".join(map(repr, (R @ [float(x) for x in at]).tolist()))

    head, rest = deck.split("*ELEMENT", 1)
    first, *lines = head.strip().splitlines()
    return "\n".join([first, *map(turned, lines)]) + "\n*ELEMENT" + rest


def test_a_turned_deck_in_directions_of_its_own_is_its_twin(tmp_path):
    """Nodes turned by R whose *TRANSFORM turns supports and forces move as the others do, turned by R."""
    e = np.array([1.0, 2.0, -2.0]) / 3.0
    R = 2.0 * np.outer(e, e) - np.eye(3)
    a, b = R[:, 0], R[:, 1]
    every = "*NSET, NSET=EVERY, GENERATE\n1, 36\n"
    rest = "*BOUNDARY\nA_Z0, 3\nA_X0, 1\nA_Y0, 2\nA_Z1, 2, 2, -0.001\n"
    rest += step("*CLOAD", "A_X1, 1, 2.", "A_X1, 3, 5.", "*DLOAD", "1, P1, 3.")
    way = "*TRANSFORM, NSET=EVERY\n" + ", ".join(map(repr, [*a.tolist(), *(a + 3 * b).tolist()]))
    u = solved(tmp_path, BOX + every + rest).bodies["A"].displacement
    scene, lists = imported(tmp_path, turned_nodes(BOX, R) + every + way + "\n" + rest)
    assert "lost:\n  nothing\n" in lists
    clamps = scene["body"][0]["clamp"]
    assert sum("along" in clamp for clamp in clamps) == 4
    # with the corner that is held in all directions these are whole faces
    assert {"A_X0", "A_Z0", "A_Z1"} <= {clamp["on"] for clamp in clamps}
    v = solved(tmp_path, turned_nodes(BOX, R) + every + way + "\n" + rest).bodies["A"].displacement
    assert v @ R == pytest.approx(u, abs=1e-10 * np.abs(u).max())


@pytest.mark.parametrize("component, value", [(1, 2e-3), (2, 2e-3), (2, 0.0), (3, 1e-3)])
def test_directions_of_a_cylinder_anywhere(tmp_path, component, value):
    """Nodes are held along the radius, around and along an axis aslant through (0, 2, 3), from node to node."""
    on, axis = np.array([0.0, 2.0, 3.0]), np.array([2.0, -1.0, 2.0]) / 3.0
    ends = ", ".join(map(repr, [*on.tolist(), *(on + 5.0 * axis).tolist()]))
    way = f"*TRANSFORM, NSET=A_X1, TYPE=C\n{ends}\n*BOUNDARY\nA_X0, 1, 3\n"
    held = f"A_X1, {component}, {component}, {value!r}\n"
    fields = solved(tmp_path, BOX + way + held + step("*DLOAD", "9, P2, 10.")).bodies["A"]
    some = np.isclose(fields.points[:, 0], 1.0) & (fields.points * 2.0 % 1.0 < 1e-9).all(axis=1)
    off = fields.points[some] - on
    off -= np.outer(off @ axis, axis)
    radial = off / np.linalg.norm(off, axis=1)[:, None]
    ways = radial, np.cross(axis, radial), np.tile(axis, (len(off), 1))
    moved = [(fields.displacement[some] * along).sum(axis=1) for along in ways]
    assert moved.pop(component - 1) == pytest.approx(np.full(len(off), value), abs=1e-14)
    assert all(np.ptp(other) > 1e-6 for other in moved)


def test_directions_out_of_the_plane(tmp_path):
    """What points out of the plane holds nothing there, unless it is moved; a direction aslant to it is lost."""
    plate = grid("A", (2, 2), (1.0, 1.0)) + STEEL + SECTION + "*BOUNDARY\nA_X0, 1, 2\n"
    up, aslant = "0., 0., 1., 0., 1., 0.", "0., 1., 1., 1., 0., 0."
    for way, value, words in (
        (up, 0.0, ""),
        (up, 1.0, "a displacement out of the plane"),
        (aslant, 0.0, "a support aslant to the plane"),
    ):
        held = f"*TRANSFORM, NSET=A_X1\n{way}\n*BOUNDARY\nA_X1, 1, 1, {value}\n"
        deck = plate + held + step("*CLOAD", "A_Y1, 2, 1.")
        if words:
            assert words in refused(tmp_path, deck)
        else:
            assert len(imported(tmp_path, deck)[0]["body"][0]["clamp"]) == 1


def test_heat(tmp_path):
    """An expansion by temperature is one coefficient where that is uniform; linear temperatures are formulas."""
    table = STEEL.replace("1.2e-5", "1.0e-5, 0.\n2.0e-5, 100.").replace(
        "*EXPANSION", "*EXPANSION, ZERO=20."
    )
    body = grid("A", (2, 2, 3), (1.0, 1.0, 3.0)) + table + SECTION + ROLLERS
    body += "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nA_ALL, 20.\n"
    body = body.replace("*NODE\n", "*NODE, NSET=A_ALL\n")
    answer = solved(tmp_path, body + step("*TEMPERATURE", "A_ALL, 100."))
    assert answer.bodies["A"].displacement.max(axis=0) == pytest.approx(
        np.array([1.0, 1.0, 3.0]) * 2e-5 * 80.0, rel=1e-9
    )
    steel = body.replace("1.0e-5, 0.\n2.0e-5, 100.", "1.2e-5")
    rows = [f"{1 + 9 * k + j}, {20.0 + 30.0 * k}" for k in range(4) for j in range(9)]
    scene = imported(tmp_path, steel + step("*TEMPERATURE", *rows))[0]
    assert scene["body"][0]["temperature"] == "0.0 + (30.0) * z"
    scene = imported(tmp_path, steel + step("*TEMPERATURE", "A_Z1, 50."))[0]
    assert "max(0, z - (2.0))" in scene["body"][0]["temperature"]
    assert "no linear function" in refused(tmp_path, steel + step("*TEMPERATURE", "1, 50."))


@pytest.mark.parametrize("orthotropic", [False, True])
def test_heat_by_direction(tmp_path, orthotropic):
    """Expansions are along the axes of the section, of any elasticity; the same factor of temperature for all or lost."""
    elastic = "*ELASTIC\n210000., 0.3"
    if orthotropic:
        given = "200000., 100000., 50000., 0.3, 0.2, 0.1, 40000., 30000.,\n20000."
        elastic = f"*ELASTIC, TYPE=ENGINEERING CONSTANTS\n{given}"
    heat = "*EXPANSION, TYPE=ORTHO, ZERO=20.\n"
    rows = "1e-5, 2e-5, 4e-5, 20.\n2e-5, 4e-5, 8e-5, 100.\n"
    turned = "*ORIENTATION, NAME=TURNED\n0., 1., 0., -1., 0., 0.\n"  # axis 1 is y
    body = grid("A", (2, 2, 3), (1.0, 1.0, 3.0)).replace("*NODE\n", "*NODE, NSET=A_ALL\n")
    body += STEEL.replace("*ELASTIC\n210000., 0.3", elastic).replace(
        "*EXPANSION\n1.2e-5\n", heat + rows
    )
    section = SECTION.replace("MATERIAL=", "ORIENTATION=TURNED, MATERIAL=")
    body += turned + section + ROLLERS
    body += "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nA_ALL, 20.\n"
    end = step("*TEMPERATURE", "A_ALL, 100.")
    found = solved(tmp_path, body + end).bodies["A"].displacement.max(axis=0)
    assert found == pytest.approx(np.array([4e-5, 2e-5, 3 * 8e-5]) * 80.0, rel=1e-9)
    other = body.replace("2e-5, 4e-5, 8e-5, 100.", "2e-5, 4e-5, 9e-5, 100.")
    assert "change with the temperature in different ways" in refused(tmp_path, other + end)
    sheared = body.replace("TYPE=ORTHO, ", "TYPE=ANISO, ").replace(
        rows, "1e-5, 1e-5, 1e-5, 1e-6, 0., 0.\n"
    )
    assert "shear by heat" in refused(tmp_path, sheared + end)


def test_lists_are_in_the_order_of_the_deck(tmp_path):
    """Also where a file is included; a keyword that is lost is not listed as taken."""
    (tmp_path / "law.inp").write_text(f"** a comment\n{STEEL}")
    inner = "*CLOAD\n14, 3, 1.\n"  # a force at a node inside of the box
    deck = (
        grid("A", (2, 2, 3), (1.0, 1.0, 3.0))
        + "*INCLUDE, INPUT=../law.inp\n"
        + SECTION
        + ROLLERS
        + step("*DLOAD", "9, P2, 1.", "*CLOAD", "36, 3, 1.", "*CLOAD", "35, 3, 1.", inner.strip())
    )
    _, lists = imported(tmp_path, deck, partial=True)
    taken = " ".join(
        line.split(": ")[1] for line in lists.split("changed:")[0].splitlines()[1:] if line
    )
    assert taken == "*ELEMENT *ELASTIC *DENSITY *EXPANSION *SOLID SECTION *BOUNDARY *DLOAD *CLOAD"
    line = deck[: deck.index(inner)].count("\n") + 1
    assert f"lines {line - 4}, {line - 2}: *CLOAD: forces\n" in lists
    assert (
        f"line {line}: *CLOAD: a force at a node that is not on the boundary\n"
        in lists.split("lost:")[1]
    )


def test_gravity_and_rotation(tmp_path):
    """*DLOAD GRAV and CENTRIF are forces per volume along directions of any length; the reaction is the weight."""
    deck = (
        BOX
        + ROLLERS
        + step("*DLOAD", "A, GRAV, 9810., 0., 0., -2.", "A, CENTRIF, 4., 1., 0., 0., 0., 0., 1.")
    )
    answer = solved(tmp_path, deck)
    assert answer.summary["bodies"]["A"]["reactions"]["A_Z0"]["force"][2] == pytest.approx(
        7.8e-9 * 9810 * 3, rel=1e-9
    )
    assert imported(tmp_path, deck)[0]["body"][0]["volume_force"][0].startswith(
        "-3.12e-08 + (3.12e-08) * x"
    )


@pytest.mark.parametrize("order", [(1, 2, 0), (1, 0, 2)])
def test_axes_of_orthotropic_materials(tmp_path, order):
    """Axes of a material along x, y and z in another order: a bar has the modulus along it."""
    axes = np.eye(3)[list(order)]
    young, nu = np.array([1e5, 2e5, 4e5]), [0.1, 0.2, 0.15]
    steel = (
        f"*MATERIAL, NAME=STEEL\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n{', '.join(map(str, young))}, "
        f"{', '.join(map(str, nu))}, 3e4, 4e4,\n5e4\n*ORIENTATION, NAME=O\n{', '.join(map(str, axes[0]))}, "
        f"{', '.join(map(str, axes[1]))}\n"
    )
    deck = (
        grid("A", (1, 1, 1), (1.0, 1.0, 1.0))
        + steel
        + SECTION.replace("=STEEL", "=STEEL, ORIENTATION=O")
        + ROLLERS
    )
    answer = solved(tmp_path, deck + step("*CLOAD", "A_Z1, 3, 25."))
    along = order.index(2)
    ratios = {(0, 1): 0.1, (0, 2): 0.2, (1, 2): 0.15}
    u = answer.bodies["A"].displacement
    assert u[:, 2].max() == pytest.approx(100.0 / young[along], rel=1e-9)
    for k, axis in enumerate(order):
        if k != along:
            ratio = ratios.get((along, k), ratios.get((k, along), 0) * young[along] / young[k])
            assert u[:, axis].min() == pytest.approx(-ratio * 100.0 / young[along], rel=1e-9)


LOST = [
    (
        "*EQUATION\n2\n2, 1, 1., 3, 1, -1.",
        "*EQUATION: pairs of nodes that are no whole faces",
    ),
    (
        "*INITIAL CONDITIONS, TYPE=STRESS\n1, 1, 1., 1., 1., 1., 1., 1.",
        "*INITIAL CONDITIONS: initial stress",
    ),
    ("*NONSENSE, OF=ANY\n1, 2", "*NONSENSE: this keyword is not known"),
    ("*ADD\n1, 2", "*ADD: this keyword is not known"),
    ("*BOUNDARY\nA_Z0, 3\n*PLASTIC\n200., 0.", "*PLASTIC: plasticity"),
    ("*ELEMENT, TYPE=SPRINGA, ELSET=K\n90, 1, 2", "*ELEMENT: elements of type SPRINGA"),
    (
        "*ELEMENT, TYPE=S4, ELSET=K\n90, 1, 2, 5, 4\n*SHELL SECTION, ELSET=K, MATERIAL=STEEL\n0.1",
        "*ELEMENT: elements of type S4",
    ),
    ("*ELEMENT, TYPE=R3D4, ELSET=K\n90, 1, 2, 5, 4", "*ELEMENT: elements of type R3D4"),
    ("*RESTART, READ, STEP=1", "*RESTART: its parameter READ is not possible"),
    ("*SURFACE, NAME=S, TYPE=SEGMENTS\nSTART, 0., 0.", "*SURFACE: TYPE=SEGMENTS is not possible"),
    ("*TEMPERATURE, A_Z0\nA_X0, 1.", "*TEMPERATURE: its parameter A_Z0 is not possible"),
    (
        "*SURFACE INTERACTION, NAME=I\n*FRICTION, ANISOTROPIC\n0.3, 0.1",
        "*FRICTION: its parameter ANISOTROPIC is",
    ),
    (
        "*SURFACE INTERACTION, NAME=I\n*FRICTION\n0.3, , , 20.\n0.1, , , 100.",
        "*FRICTION: friction other than Coulom",
    ),
]

LOST_IN_STEP = [
    ("*DLOAD\n1, P9, 1.", "a pressure on a face that is not on a boundary"),
    ("*DLOAD\n1, P2, 1.", "a pressure on a face that is not on a boundary"),
    ("*DLOAD\nA, P2NU, 1.", "*DLOAD: the load P2NU"),
    ("*CLOAD\n14, 3, 1.", "*CLOAD: a force at a node that is not on the boundary"),
    ("*CLOAD\n1, 5, 1.", "*CLOAD: moments at nodes"),
    ("*BOUNDARY, FIXED\n1, 1", "*BOUNDARY: displacements of another model"),
    ("*MODEL CHANGE, TYPE=ELEMENT, REMOVE\nA", "*MODEL CHANGE: parts that are removed or added"),
    ("*DLOAD\n9, P2NP, 36", "*DLOAD: a pressure that is not given at node 36"),
    (
        "*CLOAD, AMPLITUDE=OWN\n36, 1, 1.\n*AMPLITUDE, NAME=OWN, USER",
        "no table of factors; --amplitude OWN=0,0,1,1",
    ),
    ("*TEMPERATURE, FILE=x.frd", "*TEMPERATURE: temperatures of a file"),
    ("*CLOAD, OP=ADD\n36, 1, 0.", "*CLOAD: OP=ADD is not possible"),
    ("*CLOAD, TIME DELAY=0.1\n36, 1, 0.", "*CLOAD: TIME DELAY without an AMPLITUDE"),
    (
        "*INITIAL CONDITIONS, TYPE=TEMPERATURE\n1, 5.",
        "*INITIAL CONDITIONS: it stands in a *STEP, and not before the first one",
    ),
    ("*STATIC, RIKS", "*STATIC: its parameter RIKS is not possible"),
]


@pytest.mark.parametrize(
    "cards, words",
    [
        *((f"{card}\n" + step("*CLOAD", "A_Z1, 3, 1."), words) for card, words in LOST),
        *((step("*CLOAD", "A_Z1, 3, 1.", card), words) for card, words in LOST_IN_STEP),
    ],
)
def test_what_is_lost_refuses_the_deck(tmp_path, cards, words):
    """A keyword that is not possible is named with its line, and nothing is written, unless --partial."""
    message = refused(tmp_path, BOX + ROLLERS + cards)
    scene, lists = imported(tmp_path, BOX + ROLLERS + cards, partial=True)
    if words.startswith("*"):
        line = max(
            k
            for k, text in enumerate((BOX + ROLLERS + cards).splitlines(), 1)
            if text.startswith(words.split(":")[0])
        )
        words = f"line {line}: {words}"
    assert words in message and "--partial" in message
    assert words in lists.split("lost:")[1] and scene["body"][0]["traction"][0]["force"] == [
        0.0,
        0.0,
        9.0,
    ]


def test_what_changes_between_steps_leaves_the_end(tmp_path):
    """Without friction the scene is that of a deck with the last step alone; with friction the changes are lost."""
    law, moved = LAW, ("*BOUNDARY, OP=NEW", "A_Z0, 3", "A_X0, 1", "A_Y0, 2", "B_Z0, 1, 3")
    deck = stack(PAIR, law) + STEEL.replace("STEEL", "SOFT").replace("210000.", "105000.")
    change = (
        "*CHANGE SOLID SECTION, ELSET=A, MATERIAL=SOFT",
        "*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE",
        "SLAVE, MASTER",
    )
    force = ("*CLOAD", "A_Z1, 3, -70.")
    scene, lists = imported(
        tmp_path, deck + step("*BOUNDARY", "B_Z1, 3, 3, -0.001") + step(*change, *moved, *force)
    )
    assert (
        "contact" not in scene
        and "time" not in scene
        and scene["body"][0]["material"]["young"] == 105000.0
    )
    for words in (
        "a support that ends before",
        "a support that begins",
        "a material that",
        "a contact that is",
    ):
        assert words in lists.split("changed:")[1].split("lost:")[0]
    alone = deck.replace("MATERIAL=STEEL", "MATERIAL=SOFT", 1)
    plain = imported(
        tmp_path,
        alone[: alone.index("*BOUNDARY")].replace(f"{PAIR}\nSLAVE, MASTER\n", "")
        + STEEL.replace("STEEL", "SOFT").replace("210000.", "105000.")
        + step(*moved, *force),
    )[0]
    assert plain == scene
    rough = deck.replace(law, f"{law}*FRICTION\n0.1\n") + step("*CLOAD", "1, 1, 1.") + step(*moved)
    assert "a support that ends before a later step\n" in refused(tmp_path, rough) + "\n"


def test_amplitudes_on_the_command_line(tmp_path):
    """They stand for those of a user's routine; others than the deck's are refused."""
    path = tmp_path / "own.inp"
    path.write_text(
        BOX
        + ROLLERS
        + "*AMPLITUDE, NAME=Own, USER\n"
        + step("*CLOAD, AMPLITUDE=OWN", "A_Z1, 3, 1.")
    )
    with pytest.raises(InputError, match="no table of factors"):
        import_deck(path, tmp_path / "none")
    with pytest.raises(InputError, match=r"--amplitude ON=0,1: it has no \*AMPLITUDE ON"):
        import_deck(path, tmp_path / "none", amplitudes=["ON=0,1"])
    with pytest.raises(InputError, match='"x" is not a number'):
        import_deck(path, tmp_path / "none", amplitudes=["OWN=0,x"])
    assert (
        call(
            "import", str(path), "--output", str(tmp_path / "out"), "--amplitude", "own=0,0,1,4"
        ).code
        == 0
    )
    scene = tomllib.loads((tmp_path / "out" / "scene.toml").read_text())
    assert scene["body"][0]["traction"][0]["force"] == [0.0, 0.0, 36.0]


RING = grid("A", (2, 2), (1.0, 1.0), (1.0, 0.0), kind="CAX4") + STEEL + SECTION
BAD = [
    (BOX + ROLLERS, "it has no *STATIC step (is it cut off?)"),
    (
        BOX + step("*CLOAD", "1, 1, 1.").replace("STATIC", "FREQUENCY"),
        "its first step, on line 131, is *FREQUENCY",
    ),
    (BOX + step("*CLOAD", "NONE, 1, 1."), "*CLOAD: there is no set NONE"),
    (BOX + step("*CLOAD", "1, 1, one"), '*CLOAD: "one" is not a number'),
    (BOX + step("*CLOAD", "1, 1, nan"), '*CLOAD: "nan" is not a number'),
    (
        BOX.replace("*NODE\n", "*NODE\n99, 0, zero\n") + step(),
        'line 1 of deck.inp: *NODE: "zero" is not a number',
    ),
    (BOX + "*ELEMENT, TYPE=C3D4\n99, 1, 2, x, 4\n" + step(), '*ELEMENT: "x" is not an integer'),
    (BOX + "*ELSET, ELSET=S, GENERATE\n1\n" + step(), "*ELSET: a data line is too short"),
    (
        BOX + "*ELSET, ELSET=S, GENERATE\n1, 5, 0\n" + step(),
        "*ELSET: numbers are generated by steps of 1 or more",
    ),
    (BOX + "*NSET\n1\n" + step(), "*NSET: it lacks NSET"),
    (BOX + "*NSET, NSET=S, INSTANCE=far\n1\n" + step(), "*NSET: there is no instance far"),
    (BOX + "*INCLUDE\n" + step(), "*INCLUDE: it lacks INPUT"),
    (
        BOX + "*AMPLITUDE, NAME=N\n0., 0., 1.\n" + step("*CLOAD, AMPLITUDE=N", "1, 1, 1."),
        "*AMPLITUDE: it needs pairs",
    ),
    (
        BOX + "*RIGID BODY, NSET=A_Z1, REF NODE=A_Z0\n" + step(),
        "*RIGID BODY: A_Z0 has 9 nodes; one is needed",
    ),
    (BOX + "*RIGID BODY, NSET=A_Z1, REF NODE=999\n" + step(), "*RIGID BODY: there is no node 999"),
    (
        BOX + "*SURFACE, NAME=S\nA, S2\n*PRE-TENSION SECTION, SURFACE=S, NODE=77\n" + step(),
        "there is no node 77",
    ),
    (BOX + step("*CLOAD, AMPLITUDE=N", "1, 1, 1."), "*CLOAD: there is no *AMPLITUDE N"),
    (
        BOX.replace("MATERIAL=STEEL", "MATERIAL=GOLD") + step("*CLOAD", "1, 1, 1."),
        "there is no *MATERIAL GOLD",
    ),
    (BOX.replace(SECTION, "") + step("*CLOAD", "1, 1, 1."), "element 1 of A has no *SOLID SECTION"),
    (
        BOX + step("*CLOAD", "1, 1, 1.").replace("*END STEP\n", ""),
        "the step that begins here does not end; is th",
    ),
    (
        BOX.replace("2, 0.5, 0.0, 0.0\n", "") + step("*CLOAD", "1, 1, 1."),
        "has node 2, which is not there",
    ),
    (BOX + "*CONTACT PAIR, INTERACTION=I\nX, Y\n" + step(), "there is no *SURFACE INTERACTION I"),
    (stack("*TIE", first="SLAVE, NOWHERE") + step(), "*TIE: there is no surface NOWHERE"),
    (
        "*ELEMENT, TYPE=S4, ELSET=A\n1, 1, 2, 3, 4\n" + step(),
        "it has no elements that a scene may have",
    ),
    (BOX + "*NSET, NSET=LOOP\nLOOP\n" + step("*CLOAD", "1, 1, 1."), "the set LOOP contains itself"),
    (BOX + step("*CLOAD", "A_Z1, 0, 1."), "*CLOAD: there is no component 0"),
    (
        RING.replace("1.0, 0.0\n", "1.0, 0.0, 0.1\n", 1) + step(),
        "*ELEMENT: its nodes have different z",
    ),
    (RING.replace("1, 1.0", "1, -1.0", 1) + step(), "*ELEMENT: a node has the radius -1"),
    (BOX + "*BOUNDARY\nA_Z0, 3, 1\n" + step(), "*BOUNDARY: it gives the components 3 to 1"),
    (BOX + "*NSET, NSET=S\n" + step("*CLOAD", "S, 1, 4."), "*CLOAD: the set S is empty"),
    (BOX + step("*DLOAD", ", BZ, 1."), "*DLOAD: the name of a set is missing"),
    (BOX + "*EQUATION\n0\n" + step(), "*EQUATION: an equation has one term or more"),
    (
        "*NODE\n900, 0., 0., 0.\n*ELEMENT, TYPE=SPRINGA, ELSET=K\n9, 900, 900\n*SURFACE, NAME=S\nK, S1\n"
        "*COUPLING, REF NODE=900, SURFACE=S\n*KINEMATIC\n" + step(),
        "the surface S has faces that its elements do not have",
    ),
    (BOX + "*MPC\nTIE, 3\n" + step(), "*MPC: a data line is too short"),
    (BOX + step("*DLOAD", "A, GRAV, 9810."), "*DLOAD: a direction is zero"),
    (
        BOX + "*TRANSFORM, NSET=A_Z0\n1., 0., 0., 2., 0., 0.\n" + step(),
        "*TRANSFORM: axes are those of two vectors",
    ),
    (BOX + "*ORIENTATION, NAME=O\n" + step(), "*ORIENTATION: axes are those of two vectors"),
    (BOX.replace("*NODE\n", "*NODE, SYSTEM=C\n", 1) + step(), "*NODE: its SYSTEM is not supported"),
    (
        BOX + "*ELEMENT, TYPE=C3D8\n1, 1, 2, 5, 4, 10, 11, 14, 13\n" + step(),
        "it has the element 1 twice",
    ),
    (BOX + "*FRICTION\n0.3\n" + step(), "*FRICTION: it does not follow *SURFACE INTERACTION"),
    (
        BOX + "*MATERIAL, NAME=Steel\n*ELASTIC\n1., 0.\n" + step(),
        "*MATERIAL: there are two of the name STEEL",
    ),
    (BOX + step(time="1., -1."), "*STATIC: the time of a step is not positive"),
    (
        BOX + "*AMPLITUDE, NAME=N\n1., 1., 0., 0.\n" + step("*CLOAD, AMPLITUDE=N", "1, 1, 1."),
        "its times must not fall",
    ),
    (BOX.replace(SECTION, SECTION + "-2.\n") + step(), "*SOLID SECTION: the thickness is negative"),
    (
        stack("*CONTACT PAIR, INTERACTION=I", LAW, first="") + step(),
        "*CONTACT PAIR: a data line is too short",
    ),
    (BOX + "*INCLUDE, INPUT=none.inp\n" + step(), "*INCLUDE: no such file: none.inp"),
    ("1, 2.\n" + BOX + step(), "line 1 of deck.inp: data without a keyword"),
    ("", "it has no keyword"),
    ("hello\n", "data without a keyword"),
    ("*NODE, NSET\n*STEP\n", ""),
]


@pytest.mark.parametrize("deck, words", BAD)
def test_bad_decks(tmp_path, deck, words):
    """Each mistake is one message with the file, and where it can be, the line."""
    message = refused(tmp_path, deck, partial=True)
    assert (
        words in message
        and message.startswith(str(tmp_path / "0" / "deck.inp"))
        and "\n" not in message
    )


def test_a_deck_cut_off_anywhere(tmp_path):
    """A deck that ends in the middle, at any place, is refused in words."""
    law = "*SURFACE INTERACTION, NAME=I\n*FRICTION\n0.2, 5e4\n"
    text = stack(PAIR, law) + step("*BOUNDARY", "B_Z1, 3, 3, -0.001", "*TEMPERATURE", "A_Z0, 5.")
    for end in range(0, len(text) - len("END STEP\n"), 41):
        refused(tmp_path, text[:end])


def test_the_command(tmp_path):
    """The lists end the command; nothing is overwritten; what is lost is exit 2."""
    path = tmp_path / "deck.inp"
    path.write_text(BOX + ROLLERS + step("*CLOAD", "A_Z1, 3, 1."))
    run = call("import", str(path), "--output", str(tmp_path / "out"))
    assert run.code == 0 and run.stdout.endswith("scene.toml: 1 body, no contacts\n")
    assert [run.stdout.index(f"{word}:\n") for word in ("taken", "changed", "lost")] == sorted(
        run.stdout.index(f"{word}:\n") for word in ("taken", "changed", "lost")
    )
    before = (tmp_path / "out" / "scene.toml").read_bytes()
    with pytest.raises(TakenError, match=r"scene\.toml is there already; nothing is overwritten"):
        import_deck(path, tmp_path / "out")
    again = call("import", str(path), "--output", str(tmp_path / "out"))
    assert (
        again.code == TakenError.exit_code
        and (tmp_path / "out" / "scene.toml").read_bytes() == before
    )
    assert call("import", str(tmp_path / "none.inp"), "--output", str(tmp_path / "x")).code == 2
    taken = call("import", str(path), "--output", str(path))  # a file, not a folder
    assert (
        taken.code == 5
        and "could not be written" in taken.stderr
        and "Traceback" not in taken.stderr
    )
    path.write_text(path.read_text().replace("*STEP", "*CREEP\n*STEP"))
    lost = call("import", str(path), "--output", str(tmp_path / "y"))
    assert lost.code == 2 and "*CREEP" in lost.stderr and not (tmp_path / "y").exists()
    assert call("import", str(path), "--output", str(tmp_path / "y"), "--partial").code == 0


def test_an_assembly_with_parts(tmp_path):
    """Parts with their own numbers, moved in an assembly, with surfaces of both, *DSLOAD and traction vectors."""
    deck = (
        "*PART, NAME=Block\n"
        + grid("ALL", (1, 1, 1), (1.0, 1.0, 1.0))
        + "*Solid Section, elset=ALL, material=Steel\n*END PART\n*ASSEMBLY, NAME=Assembly\n*INSTANCE, NAME=low, "
        "PART=Block\n*END INSTANCE\n*INSTANCE, NAME=high, PART=block\n0., 0., 1.\n*END INSTANCE\n"
        "*NSET, NSET=base, INSTANCE=low\n1, 2, 3, 4\n*ELSET, ELSET=_t, INTERNAL, INSTANCE=high\n1\n"
        "*SURFACE, NAME=top\n_t, S2\n*SURFACE, NAME=up\nlow.ALL, S2\n*SURFACE, NAME=down\nhigh.ALL, S1\n"
        "*END ASSEMBLY\n"
        + STEEL
        + "*SURFACE INTERACTION, NAME=i\n1.,\n*CONTACT PAIR, INTERACTION=I\ndown, up\n*BOUNDARY\nbase, 3\n"
        "low.ALL_X0, 1\nlow.ALL_Y0, 2\nhigh.ALL_X0, XSYMM\nhigh.ALL_Y0, YSYMM\n"
        + step("*DSLOAD", "top, P, 5.", "top, TRVEC, 2., 0., 0., -3.")
    )
    scene, _ = imported(tmp_path, deck)
    assert [body["name"] for body in scene["body"]] == ["low", "high"]
    answer = solved(tmp_path, deck)
    assert answer.summary["bodies"]["low"]["reaction"][2] == pytest.approx(7.0, rel=1e-9)
    assert answer.bodies["high"].displacement[:, 2].min() == pytest.approx(
        -2.0 * 7.0 / YOUNG, rel=1e-9
    )
    assert "element 1 of low has no *SOLID SECTION" in refused(
        tmp_path, deck.replace("*Solid Section, elset=ALL, material=Steel\n", "")
    )
    assert "has node 8, which is not there" in refused(
        tmp_path, deck.replace("8, 1.0, 1.0, 1.0\n", "")
    )


@pytest.mark.parametrize("kind, area", [("CPS4", 1.0), ("CPE4", 1.0), ("CAX4", np.pi)])
def test_plane_and_axisymmetric_decks(tmp_path, kind, area):
    """A plane section's forces are per its thickness, those around an axis of the whole circumference."""
    deck = (
        grid("A", (2, 2), (1.0, 2.0), kind=kind)
        + STEEL
        + SECTION
        + ("0.5\n" if kind != "CAX4" else "")
    )
    deck += "*BOUNDARY\nA_Y0, 2\nA_X0, 1\n" + step("*DLOAD", "3, P3, -7.", "4, P3, -7.")
    scene, _ = imported(tmp_path, deck)
    assert scene.get("axisymmetric", False) == (kind == "CAX4")
    assert scene["body"][0]["material"].get("plane") == ("stress" if kind == "CPS4" else None)
    strain = 7.0 / YOUNG * (0.91 if kind == "CPE4" else 1.0)
    answer = solved(tmp_path, deck)
    assert answer.bodies["A"].displacement[:, 1].max() == pytest.approx(2.0 * strain, rel=1e-9)
    assert answer.summary["bodies"]["A"]["reaction"][1] == pytest.approx(-7.0 * area, rel=1e-9)
    pulled = deck.replace("*DLOAD\n3, P3, -7.\n4, P3, -7.", "*CLOAD\nA_Y1, 2, 3.")
    force = imported(tmp_path, pulled)[0]["body"][0]["traction"][0]["force"]
    assert force == pytest.approx([0.0, 9.0 / (1.0 if kind == "CAX4" else 0.5)])


@pytest.mark.parametrize(
    "kind, integration, words",
    [
        (
            "CPE4",
            "full",
            'full integration, which locks in bending; integration = "modes" does not',
        ),
        ("CPS4I", "modes", None),
        ("CPE4R", "modes", "incompatible modes in place of reduced integration"),
        ("CAX4R", None, "CAX4R as CAX4: full integration"),
    ],
)
def test_quadrilaterals_keep_their_integration(tmp_path, kind, integration, words):
    """Of order 1, and not cut; what differs is told. Elements of two kinds in one body have that of the first."""
    deck = (
        grid("A", (2, 2), (1.0, 2.0), kind=kind) + STEEL + SECTION + "0.5\n" * (kind[:3] != "CAX")
    )
    deck += "*BOUNDARY\nA_Y0, 2\nA_X0, 1\n" + step("*DLOAD", "3, P3, -7.", "4, P3, -7.")
    scene, lists = imported(tmp_path, deck)
    mesh = scene["body"][0]["mesh"]
    assert (mesh["order"], mesh.get("integration")) == (1, integration)
    assert words is None or words in str(lists)
    answer = solved(tmp_path, deck)
    assert answer.bodies["A"].cells.shape == (4, 4)
    two = deck.replace("4, 5, 6, 9, 8", "*ELEMENT, TYPE=CPS4, ELSET=A\n4, 5, 6, 9, 8")
    if two != deck and kind == "CPS4I":
        assert "as the other elements of its body" in str(imported(tmp_path, two)[1])


@pytest.mark.parametrize("kind", ["CPE4", "C3D8"])
def test_a_body_with_an_element_that_is_not_convex_is_cut(tmp_path, kind):
    """Beyond the plane of the neighbours of a corner: it was kept on paper, and its scene refused."""
    d = 2 if kind == "CPE4" else 3
    deck = grid("A", (1,) * d, (1.0,) * d, kind=kind) + STEEL + SECTION + "1.0\n" * (d == 2)
    deck += "*BOUNDARY\nA_X0, 1, 3\n" + step("*DLOAD", "1, P1, -7.")
    corner = re.search(rf"\d+, {', '.join(['1.0'] * d)}\n", deck).group().split(",")[0]
    least = 0.5 if d == 2 else 2.0 / 3.0
    for share, order in ((1.01, 1), (0.99, 2)):
        place = ", ".join([repr(share * least)] * d)
        text = re.sub(rf"{corner}, {', '.join(['1.0'] * d)}\n", f"{corner}, {place}\n", deck)
        scene, lists = imported(tmp_path, text)
        assert scene["body"][0]["mesh"]["order"] == order
        assert ("an element of its body is not convex, so that all are cut" in lists) == (
            order == 2
        )
        if d == 2:
            solved(tmp_path, text)


def test_several_materials_and_moved_supports(tmp_path):
    """One body with materials by sets; displacements linear in place are one clamp, others one for each value."""
    deck = (
        grid("A", (2, 2, 3), (1.0, 1.0, 3.0))
        + STEEL
        + STEEL.replace("STEEL", "SOFT").replace("210000.", "1000.")
    )
    deck += "*ELSET, ELSET=LOW, GENERATE\n1, 4\n*ELSET, ELSET=HIGH, GENERATE\n5, 12\n"
    deck += (
        "*SOLID SECTION, ELSET=LOW, MATERIAL=SOFT\n*SOLID SECTION, ELSET=HIGH, MATERIAL=STEEL\n"
        + ROLLERS
    )
    moved = [f"{28 + k}, 3, 3, {0.001 * (1 + k % 3)}" for k in range(9)]
    scene = imported(tmp_path, deck + step("*BOUNDARY", *moved))[0]["body"][0]
    assert [(part["on"], part["young"]) for part in scene["material"]] == [
        ("SOFT", 1000.0),
        ("STEEL", 210000.0),
    ]
    top = next(clamp for clamp in scene["clamp"] if isinstance(clamp.get("z"), str))
    assert top["on"] == "A_Z1"
    assert evaluate(top["z"], np.array([0.0, 1.0])) == pytest.approx([0.001, 0.003])
    odd = imported(tmp_path, deck + step("*BOUNDARY", *moved[:-1], "36, 3, 3, 0.9"))[0]["body"][0]
    held = sorted(clamp["z"] for clamp in odd["clamp"] if "z" in clamp)
    assert held == pytest.approx([0.0, 0.001, 0.002, 0.003, 0.9])
    answer = solved(tmp_path, deck + step("*BOUNDARY", "A_Z1, 3, 3, 0.01"))
    assert answer.bodies["A"].displacement[:, 2].max() == pytest.approx(0.01, rel=1e-12)


COUPLED = BOX + (
    "*NODE, NSET=REF\n900, 0.5, 0.5, 4.\n*ELSET, ELSET=UP, GENERATE\n9, 12\n*SURFACE, NAME=TOP\n"
    "UP, S2\n*BOUNDARY\nA_Z0, 1, 3\n"
)


@pytest.mark.parametrize(
    "card",
    [
        "*COUPLING, CONSTRAINT NAME=C, REF NODE=900, SURFACE=TOP\n*DISTRIBUTING\n",
        "*COUPLING, CONSTRAINT NAME=C, REF NODE=900, SURFACE=TOP\n*KINEMATIC\n1, 6\n",
        "*RIGID BODY, NSET=A_Z1, REF NODE=900\n",
    ],
)
def test_couplings_carry_force_and_moment(tmp_path, card):
    """The reaction has the force and moment at a reference node off the face, whether this is kept rigid or not."""
    deck = COUPLED + card + step("*CLOAD", "900, 1, 3.", "900, 3, -2.", "900, 5, 7.")
    answer = solved(tmp_path, deck)
    held = answer.summary["bodies"]["A"]["reactions"]["A_Z0"]
    force = np.array([3.0, 0.0, -2.0])
    assert held["force"] == pytest.approx(-force, rel=1e-6, abs=1e-6)
    assert held["moment"] == pytest.approx(
        -np.cross([0.5, 0.5, 4.0], force) - [0.0, 7.0, 0.0], rel=1e-6, abs=1e-6
    )


def test_a_rigid_set_whose_motion_is_given(tmp_path):
    """A reference node with all six displacements moves its nodes as a rigid body of small turns."""
    deck = (
        COUPLED
        + "*RIGID BODY, NSET=A_Z1, REF NODE=900\n"
        + step("*BOUNDARY", "900, 1, 4", "900, 3, 3, -0.01", "900, 5, 5, 0.02", "900, 6, 6")
    )
    answer = solved(tmp_path, deck)
    top = answer.bodies["A"].displacement[answer.bodies["A"].points[:, 2] > 2.999]
    x = answer.bodies["A"].points[answer.bodies["A"].points[:, 2] > 2.999] - [0.5, 0.5, 4.0]
    assert top == pytest.approx(
        np.cross([0.0, 0.02, 0.0], x) - np.array([0.0, 0.0, 0.01]), abs=1e-12
    )


def bolt(kind: str = "") -> str:
    """A bar between two supports, cut at a section in its middle with a force at node 900."""
    head = grid("A", (1, 1, 4), (1.0, 1.0, 4.0), kind=kind) + STEEL + SECTION
    return head + (
        "*NODE\n900, 9., 9., 9.\n*SURFACE, NAME=CUT\n2, S2\n*PRE-TENSION SECTION, SURFACE=CUT, NODE=900\n"
        "*BOUNDARY\nA_Z0, 3\nA_Z1, 3\nA_X0, 1\nA_Y0, 2\n"
    )


def test_a_bolt_under_pretension(tmp_path):
    """A section cuts the body in two and pulls; fixed, it keeps its offset, and the force follows the load."""
    scene = imported(tmp_path, bolt() + step("*CLOAD", "900, 1, 50."))[0]
    assert scene["contact"][0]["pretension"] == {"force": 50.0, "along": [0.0, 0.0, 1.0]}
    moved = step("*BOUNDARY, FIXED", "900, 1, 1", "*BOUNDARY", "A_Z1, 3, 3, 0.001")
    fixed = bolt() + step("*CLOAD", "900, 1, 50.") + moved
    # a run would warn of a history that nothing follows
    assert len(imported(tmp_path, fixed)[0]["history"]) == 2
    answer = solved(tmp_path, fixed)
    (contact,) = answer.summary["contacts"].values()
    assert contact["pretension"]["offset"] == pytest.approx(50.0 * 4 / YOUNG, rel=1e-6)
    assert contact["pretension"]["force"] == pytest.approx(50.0 + 0.001 / 4 * YOUNG, rel=1e-6)


RIGID = "*NSET, NSET=CORNERS\n28, 30, 34, 36\n*RIGID BODY, NSET=CORNERS, REF NODE=900\n"
KINEMATIC = "*COUPLING, REF NODE=900, SURFACE=TOP\n*KINEMATIC\n1, "
PRESS = step("*BOUNDARY", "B_Z1, 3, 3, -0.001")
WARM = step("*TEMPERATURE", "A_Z1, 50.", "*DLOAD", "9, P2, 1.")

SCENES = {
    "ties are bonded": (stack("*TIE, NAME=T", gap=0.05) + PRESS, "contact.0.kind", "bonded", ""),
    "ties over a gap are told": (
        stack("*TIE, NAME=T", gap=0.3) + PRESS,
        "contact.0.kind",
        "bonded",
        "nodes 0.3 apart, beyond its tolerance, are tied",
    ),
    "tied contact is bonded": (
        stack(PAIR, f"{LAW}*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=TIED\n1e7\n") + PRESS,
        "contact.0.kind",
        "bonded",
        "tied contact: bonded, without stiffness",
    ),
    "a clearance is a gap": (
        stack(PAIR, f"{LAW}*CLEARANCE, SLAVE=slave, MASTER=MASTER, VALUE=0.02\n", 0.05) + PRESS,
        "contact.0.gap",
        0.02,
        "",
    ),
    "slaves are those of the deck": (stack(PAIR, LAW) + PRESS, "contact.0.slave", "B", ""),
    "unless supports hold them": (
        stack(PAIR, LAW).replace("*BOUNDARY\n", "*BOUNDARY\nB_Z0, 1, 3\n", 1) + PRESS,
        "contact.0.slave",
        None,
        "",
    ),
    "or they are rigid": (
        stack(
            PAIR,
            f"{LAW}*NODE\n900, 0., 0., 5.\n*RIGID BODY, NSET=B_Z0, REF NODE=900\n*BOUNDARY\n"
            "900, 1, 6\n",
        )
        + PRESS,
        "contact.0.slave",
        None,
        "",
    ),
    "*NSET, ELSET= has the nodes of elements": (
        BOX
        + "*ELSET, ELSET=LOW, GENERATE\n1, 4\n*NSET, NSET=HELD, ELSET=LOW\n*NSET, NSET=SAME, GENERATE\n1, 18\n"
        "*BOUNDARY\nSAME, 1, 3\n" + step("*CLOAD", "A_Z1, 3, 1."),
        "body.0.clamp",
        [{"on": "HELD", "x": 0.0, "y": 0.0, "z": 0.0}],
        "",
    ),
    "ENCASTRE holds the turns of a reference node": (
        COUPLED + KINEMATIC + "3\n*BOUNDARY\n900, ENCASTRE\n" + step("*DLOAD", "1, P3, 5."),
        "body.0.clamp.1",
        {"on": "rigid", "x": 0.0, "y": 0.0, "z": 0.0},
        "",
    ),
    "PINNED does not": (
        COUPLED + KINEMATIC + "3\n*BOUNDARY\n900, PINNED\n" + step("*DLOAD", "1, P3, 5."),
        "rigid.0",
        {
            "name": "rigid",
            "shape": "plane",
            "point": [0.0, 0.0, 3.0],
            "normal": [0.0, 0.0, -1.0],
            "displacement": [0.0, 0.0, 0.0],
            "pivot": [0.5, 0.5, 4.0],
            "turns": True,
        },
        "",
    ),
    "a moment is that of the rigid partner": (
        COUPLED + "*RIGID BODY, NSET=A_X0, REF NODE=900\n" + step("*CLOAD", "900, 4, 1."),
        "rigid.0.moment",
        [1.0, 0.0, 0.0],
        "a face that moves as a rigid one",
    ),
    "loads of rigid points are spread": (
        COUPLED + RIGID + step("*CLOAD", "900, 1, 3.", "900, 4, 5."),
        "body.0.traction",
        [
            {"on": "coupled", "force": [3.0, 0.0, 0.0]},
            {"on": "coupled", "moment": pytest.approx([5.0, 4.2, 0.0])},
        ],
        "points alone hold nothing in a solid",
    ),
    "without a moment of rounding": (
        COUPLED + RIGID + step("*CLOAD", "900, 3, 3.", "900, 6, 0."),
        "body.0.traction",
        [{"on": "coupled", "force": [0.0, 0.0, 3.0]}],
        "*RIGID BODY: forces spread over a face",
    ),
    "loads follow amplitudes of the total time in later steps": (
        BOX
        + ROLLERS
        + "*AMPLITUDE, NAME=ALL, TIME=TOTAL TIME\n0., 0., 2., 1.\n"
        + step("*CLOAD, AMPLITUDE=ALL", "A_Z1, 3, 9.")
        + 2 * step("*NODE PRINT, NSET=A_Z1", "U"),
        "history",
        {"h1": {"times": [0.0, 2.0, 3.0], "factors": [0.0, 1.0, 1.0]}},
        "",
    ),
    "the pressure of a fluid is that of a node": (
        "*NODE\n900, 9., 9., 9.\n"
        + BOX
        + ROLLERS
        + step("*DLOAD", "9, P2NP, 900", "*BOUNDARY", "900, 2, 2, 4."),
        "body.0.traction",
        [{"on": "pressed", "pressure": 4.0}],
        'full integration, which locks in bending; integration = "modes" does not\n\nlost:',
    ),
    "a support at no body changes nothing": (
        COUPLED + "*BOUNDARY\n900, 1\n" + step("*CLOAD", "36, 1, 1."),
        "rigid",
        None,
        "a support at a node of no body is left out",
    ),
    "forces at the section of a bolt act on the side without its surface": (
        bolt() + step("*CLOAD", "900, 1, 50.", "A_X1, 1, 1."),
        "body.1.traction",
        [{"on": "loaded", "force": [6.0, 0.0, 0.0]}],
        "",
    ),
    "names of sets stay on both sides of it": (
        bolt() + step("*CLOAD", "900, 1, 50."),
        "body.1.clamp",
        [{"on": "A_X0", "x": 0.0}, {"on": "A_Y0", "y": 0.0}, {"on": "A_Z1", "z": 0.0}],
        "",
    ),
    "temperatures are taken": (
        BOX + ROLLERS + WARM,
        "body.0.material.expansion",
        1.2e-5,
        "*TEMPERATURE: temperature\n",
    ),
    "without expansion they change nothing": (
        (BOX + ROLLERS + WARM).replace("*EXPANSION\n1.2e-5\n", ""),
        "body.0.temperature",
        None,
        "*TEMPERATURE: no thermal strain of A: its material has no *EXPANSION\n",
    ),
    "moduli of metals in MPa label mm and MPa": (
        BOX + ROLLERS + step("*DLOAD", "9, P2, 1."),
        "output",
        {"length_unit": "mm", "stress_unit": "MPa"},
        "units: those of the deck, by its moduli labelled mm and MPa",
    ),
    "others do not": (
        BOX.replace("210000.", "2.1e11") + ROLLERS + step("*DLOAD", "9, P2, 1."),
        "output",
        None,
        "units: those of the deck, labelled m and Pa",
    ),
    "nor those in ksi": (
        BOX.replace("210000.", "29000.") + ROLLERS + step("*DLOAD", "9, P2, 1."),
        "output",
        None,
        "",
    ),
}


@pytest.mark.parametrize("deck, key, value, words", SCENES.values(), ids=SCENES)
def test_what_a_deck_becomes(tmp_path, deck, key, value, words):
    """A value of the scene, None where it has none, and what the lists say."""
    scene, lists = imported(tmp_path, deck)
    for part in key.split("."):
        scene = scene[int(part)] if isinstance(scene, list) else scene.get(part)
    assert scene == value and words in lists


LOST_LATER = [
    (
        BOX.replace(
            "*ELASTIC\n210000., 0.3",
            "*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n0., 0., 0., 0., 0., 1.\n*ELASTIC,"
            "TYPE=ENGINEERING CONSTANTS\n1e5, 1e5, 1e5, 0., 0., 0., 3e4, 3e4,\n3e4",
        ).replace(SECTION, f"{SECTION[:-1]}, ORIENTATION=O\n")
        + step(),
        "*ELASTIC: axes of a material that turn from place to",
    ),
    (
        COUPLED + RIGID + "*BOUNDARY\n900, 2\n" + step("*CLOAD", "900, 1, 1."),
        "*RIGID BODY: its nodes are no whole faces of one body",
    ),
    (
        COUPLED + KINEMATIC + "2\n" + step("*CLOAD", "900, 1, 1."),
        "*KINEMATIC: a coupling of some components only",
    ),
    (
        COUPLED + KINEMATIC + "3\n*BOUNDARY\n900, YSYMM\n" + step("*DLOAD", "1, P3, 5."),
        "some of its turns are given",
    ),
    (
        COUPLED + "*RIGID BODY, ELSET=A, REF NODE=900\n" + step("*CLOAD", "900, 1, 1."),
        "that are no set of nodes",
    ),
    (
        COUPLED
        + "*NODE\n901, 0., 0., 5.\n*RIGID BODY, NSET=A_X0, REF NODE=900, ROT NODE=901\n"
        + step("*CLOAD", "901, 5, 2."),
        "a node of rotations has components 1 to 3 alone",
    ),
    (
        COUPLED + "*BOUNDARY\n901, 1\n" + step("*CLOAD", "36, 1, 1."),
        "*BOUNDARY: there is no node 901",
    ),
    (COUPLED + step("*CLOAD", "900, 1, 1."), "*CLOAD: a force at a node of no body"),
    (
        bolt().replace("S2\n*PRE", "S6\n*PRE") + step("*CLOAD", "900, 1, 5."),
        "a section that does not cut a body in",
    ),
    (
        bolt().replace("2, S2\n*PRE", "99, S2\n*PRE") + step("*CLOAD", "900, 1, 5."),
        "*PRE-TENSION SECTION: the surface CUT is empty",
    ),
    (
        bolt().replace("SURFACE=CUT, ", "") + step("*CLOAD", "900, 1, 5."),
        "not of a section of solid elements",
    ),
    (
        bolt() + step("*CLOAD", "A_X1, 1, 1."),
        "a pre-tension whose node has neither a force nor a displacement",
    ),
    (
        stack("*TIE, NAME=T, POSITION TOLERANCE=0.1", gap=0.3) + step("*CLOAD", "B_Z1, 3, 1."),
        "a tie over a gap of 0.3",
    ),
    (
        stack(PAIR, LAW, first="SLAVE, SLAVE") + step("*CLOAD", "B_Z1, 3, 1."),
        "*CONTACT PAIR: contact of B with itself by one surface",
    ),
    (
        BOX
        + ROLLERS
        + "*AMPLITUDE, NAME=UP\n0., 0., 1., 1.\n"
        + step("*CLOAD", "A_Z1, 3, 1.", "*CLOAD, AMPLITUDE=UP", "A_Z1, 3, 2."),
        "a load beside another one of this step with",
    ),
    (
        BOX
        + ROLLERS
        + step("*DLOAD", "A, GRAV, 9., 0., 0., 1.")
        .replace("*STEP", "*ELSET, ELSET=S\n1\n*STEP")
        .replace("\nA,", "\nS,"),
        "*DLOAD: GRAV on a part of a body",
    ),
]


@pytest.mark.parametrize("deck, words", LOST_LATER)
def test_what_is_lost_of_bodies_and_what_joins_them(tmp_path, deck, words):
    """Rigid sets, bolts, ties and loads that have no place in the scene are named."""
    assert words in refused(tmp_path, deck)


def test_a_bolt_with_a_missing_node_is_refused(tmp_path):
    """The node is named, as in a deck without bolts."""
    deck = bolt().replace("13, 0.0, 0.0, 3.0\n", "") + step("*CLOAD", "900, 1, 5.")
    assert "has node 13, which is not there" in refused(tmp_path, deck)
    negative = re.sub(
        r"(\*ELEMENT.*\n\d+, )\d+", r"\1-1", BOX + step("*CLOAD", "1, 1, 5."), count=1
    )
    assert "which is not there" in refused(tmp_path, negative)


@pytest.mark.parametrize("normal", ["", "0., 0., -1.\n"])
def test_a_bolt_by_its_displacement(tmp_path, normal):
    """A displacement shortens the bolt: the bond is over a gap. The card's normal tells which sign pulls."""
    deck = bolt().replace("NODE=900\n", f"NODE=900\n{normal}")
    answer = solved(tmp_path, deck + step("*BOUNDARY", "900, 1, 1, 0.002"))
    pull = YOUNG * 0.002 / 4.0 * (-1.0 if "-" in normal else 1.0)
    assert [
        reaction["force"][2]
        for name, reaction in answer.summary["bodies"]["part1"]["reactions"].items()
        if name == "A_Z0"
    ] == pytest.approx([-pull], rel=1e-6)


def test_a_bolt_in_a_frame(tmp_path):
    """No section cuts a ring in two: elements at it are a body of their own. The other leg bears the opposite force."""
    deck = grid("A", (3, 1, 3), (3.0, 1.0, 3.0)) + STEEL + SECTION
    lines = deck.splitlines()
    hollow = (
        "\n".join(line for line in lines if not (line.startswith("5, ") and line.count(",") == 8))
        + "\n"
    )
    deck = hollow + (
        "*NODE\n900, 9., 9., 9.\n*SURFACE, NAME=CUT\n4, S2\n*PRE-TENSION SECTION, SURFACE=CUT, NODE=900\n"
        "*BOUNDARY\nA_Z0, 3\nA_Y0, 2\n1, 1\n"
    )
    scene, lists = imported(tmp_path, deck + step("*CLOAD", "900, 1, 50."))
    assert [contact.get("pretension", {}).get("force") for contact in scene["contact"]] == [
        50.0,
        None,
    ]
    assert "a body of their own" in lists
    answer = solved(tmp_path, deck + step("*CLOAD", "900, 1, 50."))
    first, second = answer.summary["contacts"].values()
    assert first["pretension"]["force"] == pytest.approx(50.0, rel=1e-9)
    assert first["force"][2] + second["force"][2] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("reach, force", [("0.06", 0.0005), ("0.04", 0.0)])
def test_adjusted_surfaces(tmp_path, reach, force):
    """ADJUST closes a gap that is no larger than it says."""
    deck = stack(f"{PAIR}, ADJUST={reach}", LAW, 0.05) + step("*BOUNDARY", "B_Z1, 3, 3, -0.001")
    answer = solved(tmp_path, deck)
    pressed = YOUNG * 0.7 / 1.3 / 0.4 * 0.001 / 2.0 if force else 0.0
    assert answer.summary["contacts"]["B-A"]["normal_force"] == pytest.approx(
        pressed, rel=1e-6, abs=1e-9
    )
    turned = deck.replace("*TRANSFORM", "").replace("101, 0.0, 0.0, 1.05", "101, 0.0, 0.0, 1.15")
    assert (
        "ADJUST that moves some of the nodes only" in refused(tmp_path, turned) if force else True
    )


def test_plates_of_different_thickness(tmp_path):
    """Two strips in series are bars with these sections under pressure, gravity and heat, which causes no stress."""
    plain = STEEL.replace("0.3", "0.0")
    deck = (
        grid("A", (2, 1), (2.0, 1.0), kind="CPS4")
        + plain
        + (
            "*ELSET, ELSET=L\n1\n*ELSET, ELSET=R\n2\n*SOLID SECTION, ELSET=L, MATERIAL=STEEL\n0.5\n*SOLID SECTION, "
            "ELSET=R, MATERIAL=STEEL\n0.2\n*BOUNDARY\nA_X0, 1\nA_Y0, 2\n"
        )
    )
    answer = solved(tmp_path, deck + step("*DLOAD", "2, P2, -7."))
    u, summary = answer.bodies["A"].displacement, answer.summary
    assert u[:, 0].max() == pytest.approx((7.0 * 0.2 / 0.5 + 7.0) / YOUNG, rel=1e-9)
    assert np.unique(np.round(answer.bodies["A"].stress[:, 0], 9)) == pytest.approx([2.8, 7.0])
    assert summary["bodies"]["A"]["reaction"] == pytest.approx([-7.0 * 0.2, 0.0], abs=1e-12)
    assert summary["discretization_error"]["energy_norm"] == pytest.approx(0.0, abs=1e-6)
    heavy = solved(tmp_path, deck + step("*DLOAD", "A, GRAV, 1000., 1., 0., 0.")).summary
    assert heavy["bodies"]["A"]["reaction"][0] == pytest.approx(-7.8e-9 * 1000.0 * 0.7, rel=1e-9)
    warm = solved(
        tmp_path, deck + step("*TEMPERATURE", *(f"{k}, 10." for k in range(1, 7)))
    ).bodies["A"]
    assert warm.displacement[:, 0].max() == pytest.approx(2.0 * 1.2e-5 * 10.0, rel=1e-9)
    assert np.abs(warm.stress).max() < 1e-9 * YOUNG
    assert "thick; plane strain, and bodies in contact, have one depth" in refused(
        tmp_path, deck.replace("CPS4", "CPE4") + step("*DLOAD", "2, P2, -7.")
    )
