"""Profiles along the arc length of a contact: from where they count, and which way."""

import numpy as np
import pytest
from boundaries import join, pair, rectangle, ring, side, touch, turned, uncovered_profile
from scenes import seldom

import ddmpi
from ddmpi.interface.interface import Interface
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.contacts import Coulomb, Plane, Profile, SignedProfile
from ddmpi.surface.side import Side

LENGTH = 3.0
RISING = Coulomb(coefficient=Profile(along="arc", points=[0.0, 9.0], values=[0.0, 9.0]))
GAP = SignedProfile(along="arc", points=[0.0, 9.0], values=[0.0, -9.0])
orders = pytest.mark.parametrize("order", [1, 2])
slaves = pytest.mark.parametrize("slave", [None, "left", "right"])


def columns(
    order: int,
    divisions: tuple[int, int] = (6, 6),
    angle: float = 0.0,
    lean: float = 0.0,
    clamped: tuple[str, ...] = (),
) -> list[Side]:
    """Two blocks side by side that touch along an upright line, which leans by `lean`, all turned by `angle`."""
    found = []
    for name, group, x, number in (
        ("left", "right", -1.0, divisions[0]),
        ("right", "left", 0.0, divisions[1]),
    ):
        mesh = rectangle((2, number), (1.0, LENGTH), (x, 0.0), order)
        mesh.points[:, 0] += lean * (1.0 - mesh.points[:, 1] / LENGTH)
        hold = {"where": lambda x, y: y == 0.0, "x": True, "y": True} if name in clamped else {}
        found.append(side(turned(mesh, angle), group, body=name, **hold))
    return found


def along(contact: Interface, angle: float = 0.0) -> np.ndarray:
    """How far up the contact nodes lie, before they are turned."""
    return contact.xy @ [-np.sin(angle), np.cos(angle)]


def check(contact: Interface, expected: np.ndarray, tolerance: float = 1e-9) -> None:
    """Arc lengths, the friction and the gap that follow from them."""
    assert contact.geometry.arc == pytest.approx(expected, abs=tolerance)
    assert contact.law.coefficient == pytest.approx(contact.geometry.arc[contact.sliding])
    assert contact.gap == pytest.approx(-contact.geometry.arc)


@pytest.mark.every(5)
@orders
@slaves
@pytest.mark.parametrize(
    ("angle", "lean"), [(0.4, -2e-16), (np.pi, 1e-3), seldom(0.4, 1e-3), seldom(np.pi, -2e-16)]
)
def test_arc_length_counts_along_the_first_body(angle, lean, slave, order):
    """From where its boundary starts with the body on the left, whatever the slave, the coordinates, or rounding."""
    for divisions in ((6, 6), (6, 9), (9, 6)):
        left, right = columns(order, divisions, angle, lean)
        pairing = None if slave is None else "mortar"
        contact = join(left, right, RISING, "seam", 1, GAP, pairing=pairing, slave=slave)
        check(contact, along(contact, angle), 2e-6)
        assert uncovered_profile(contact, RISING, GAP) == []
        contact = join(right, left, RISING, "seam", 1, GAP, pairing=pairing, slave=slave)
        check(contact, LENGTH - along(contact, angle), 2e-6)


@slaves
@pytest.mark.parametrize("clamped", [("left",), ("right",), ("left", "right")])
def test_clamps_do_not_move_the_origin(clamped, slave):
    """Friction and gap count from the start of the boundary, also where clamps hold its first node."""
    left, right = columns(1, clamped=clamped)
    contact = join(left, right, RISING, "seam", 1, GAP, pairing=slave and "mortar", slave=slave)
    check(contact, along(contact))
    assert contact.m == 7 - (len(clamped) == 2)
    assert contact.fixed.gap == pytest.approx([0.0] * (len(clamped) == 2))


@slaves
def test_what_does_not_face_the_partner_counts_as_well(slave):
    """The origin is that of the first body's boundary, not that of the contact."""
    first, second = (
        rectangle((2, 12), (1.0, LENGTH), (-1.0, 0.0)),
        rectangle((2, 5), (1.0, 1.0), (0.0, 1.3)),
    )
    contact = join(
        side(first, "right", body="left"),
        side(second, "left", body="right"),
        RISING,
        "seam",
        1,
        GAP,
        slave=slave,
    )
    places = np.clip(along(contact), 1.3, 2.3) if slave == "right" else along(contact)
    check(contact, places)


@pytest.mark.every(5)
@orders
@pytest.mark.parametrize("slave", ["shaft", "hub"])
@pytest.mark.parametrize(
    ("numbers", "begin"), [((12, 12), 0.0), ((12, 17), 1.0), ((17, 12), np.pi)]
)
def test_a_closed_chain_starts_where_the_mesh_starts(numbers, begin, slave, order):
    """A shaft counts counterclockwise from the first node of its group, a bore clockwise."""
    for nudge in (0.0, 1e-15, -1e-15):
        angles = [begin + np.linspace(0.0, 2 * np.pi, n + 1)[:-1] for n in numbers]
        shaft = side(ring(0.5, 1.0, angles[0], order), "outer", body="shaft")
        hub = side(ring(1.0, 2.0, angles[1] + nudge, order), "inner", body="hub")
        contact = join(shaft, hub, RISING, "fit", 1, GAP, pairing="mortar", slave=slave)
        for first, found, sign in (
            (shaft, contact, 1.0),
            (hub, join(hub, shaft, RISING, "fit", 1, GAP, pairing="mortar", slave=slave), -1.0),
        ):
            angle = sign * (np.arctan2(*found.xy.T[::-1]) - begin) % (2 * np.pi)
            angle[angle > 2 * np.pi - 1e-6] = 0.0
            perimeter = first.lengths.sum()
            check(found, perimeter * angle / (2 * np.pi), 0.02 * perimeter / min(numbers))
            assert (angle.min(), found.geometry.arc[np.argmin(angle)]) == pytest.approx(
                (0.0, 0.0), abs=1e-12
            )


def test_every_chain_counts_from_its_own_start():
    """So their order makes no difference: two feet of a table on one floor."""
    feet = [rectangle((4, 1), (1.0, 1.0), (x, 1.0)) for x in (2.0, 0.0)]
    size = len(feet[0].points)
    both = Mesh(
        np.concatenate([foot.points for foot in feet]),
        np.concatenate([foot.triangles + k * size for k, foot in enumerate(feet)]),
        {
            "soles": np.concatenate(
                [foot.groups["bottom"] + k * size for k, foot in enumerate(feet)]
            )
        },
    )
    soles = side(both, "soles", body="table")
    ground = side(rectangle((12, 1), (3.0, 1.0)), "top", body="ground")
    for contact in (
        pair(soles, ground, RISING, "stand", gap=GAP),
        join(soles, ground, RISING, "stand", 1, GAP, pairing="mortar", slave="ground"),
        touch(
            soles, Plane(name="ground", point=(0.0, 1.0), normal=(0.0, 1.0)), RISING, "stand", GAP
        ),
    ):
        inside = np.abs(contact.xy[:, 0] - 1.5) >= 0.5
        expected = np.where(contact.xy[:, 0] < 1.5, contact.xy[:, 0], contact.xy[:, 0] - 2.0)
        assert contact.m - inside.sum() <= 2
        assert contact.geometry.arc[inside] == pytest.approx(expected[inside])


@orders
def test_the_order_of_nodes_does_not_depend_on_rounding(order):
    """Tables of an upright contact begin at its lower end."""
    for lean in (0.0, 1e-16, -1e-16, 3e-16):
        for found in columns(order, lean=lean):
            assert found.xy[0, 1] == 0.0


@pytest.mark.parametrize("law", ["tresca", "coulomb"])
def test_friction_that_follows_a_history_dissipates_by_the_bounds_of_both_ends(law):
    """½ (g_n + g_n-1) |u_t| of the last step, in which the friction falls from 0.8 to 0.2 of what is given."""
    key, given = ("slip_bound", 1e6) if law == "tresca" else ("coefficient", "0.2 + 0.1 * x")
    block = {
        "name": "block",
        "mesh": {"shape": "rectangle", "size": [3.0, 1.0], "divisions": [6, 2]},
        "material": {"young": 2e9, "poisson": 0.0},
        "clamp": [
            {"on": "top", "x": 5e-2, "history": "push"},
            {"on": "top", "y": -1e-2},
        ],
    }
    scene = {
        "body": [block],
        "rigid": [{"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}],
        "contact": [
            {
                "bodies": ["block", "floor"],
                "on": ["bottom"],
                "friction": {"law": law, key: {"value": given, "history": "wear"}},
            }
        ],
        "history": {
            "push": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 2.0]},
            "wear": {"times": [1.0, 2.0], "factors": [0.8, 0.2]},
        },
        "time": {"points": [1.0, 2.0], "steps": 1},
        "output": {"figures": False},
    }
    answer = ddmpi.solve(scene)
    assert answer.certified, answer.reason
    state, first = answer.contacts["block-floor"], answer.summary["steps"][0]
    assert state.count("slip") == 7 == first["contacts"]["block-floor"]["slip"]
    now = np.abs(state.tangential_force[:, 0])
    bound = 2e5 * state.interface.area
    if law == "coulomb":
        bound = 0.2 * (0.2 + 0.1 * state.interface.xy[:, 0]) * state.normal_force
    assert now == pytest.approx(bound, rel=1e-6)
    # without Poisson's ratio pressures stay nearly the same while the shear goes
    before = 4.0 * now
    rubbed = float(0.5 * (now + before) @ np.abs(state.slip[:, 0]))
    assert state.dissipated == pytest.approx(rubbed, rel=1e-9 if law == "tresca" else 5e-2)
    energy = answer.summary["energy"]
    assert law == "tresca" or energy["dissipated"] == pytest.approx(
        energy["interface_work"], rel=2e-2
    )


@pytest.mark.parametrize("law", ["tresca", "coulomb"])
def test_friction_is_that_of_the_place_where_bodies_are(law):
    """Blocks that are drawn elsewhere have friction there, also where the formula is no number around the origin."""
    key, size = ("slip_bound", 1e5) if law == "tresca" else ("coefficient", 0.3)

    def forces(start: float, formula: str) -> np.ndarray:
        bodies = [
            {
                "name": name,
                "mesh": {
                    "shape": "rectangle",
                    "origin": [start, low],
                    "size": [2.0, 1.0],
                    "divisions": [4, 2],
                },
                "material": {"young": 1e9, "poisson": 0.3},
            }
            for name, low in (("upper", 0.0), ("lower", -1.0))
        ]
        bodies[0] |= {"clamp": [{"on": "top", "x": 1e-3, "y": -1e-3}]}
        bodies[1] |= {"clamp": ["bottom"]}
        contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"]}
        contact |= {"friction": {"law": law, key: formula}}
        answer = ddmpi.solve({"body": bodies, "contact": [contact]})
        assert answer.certified and answer.contacts["upper-lower"].count("slip")
        return answer.contacts["upper-lower"].forces

    here, there = forces(0.0, f"{size} * log(2 + x)"), forces(5.0, f"{size} * log(x - 3)")
    assert there == pytest.approx(here, rel=1e-7, abs=1e-7 * np.abs(here).max())
