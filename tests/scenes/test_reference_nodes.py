"""Rigid partners without a surface: faces of several bodies that are bonded to one reference node."""

import numpy as np
import pytest
from scenes import assert_refused, certified, rectangle
from solid_scenes import box

YOUNG = 1e9
PIVOT, FORCE, MOMENT = np.array([11.3, 0.9]), np.array([300.0, -500.0]), 800.0


def angle(**node) -> dict:
    """A beam along x and one along y, without Poisson's effect, whose ends are bonded to one node."""
    beams = [
        rectangle("a", (0.0, 0.0), (10.0, 1.0), (20, 2), 2, YOUNG, 0.0, clamp=["left"]),
        rectangle("b", (12.0, -8.0), (1.0, 8.0), (2, 16), 2, YOUNG, 0.0, clamp=["bottom"]),
    ]
    bonds = [
        {"bodies": ["a", "joint"], "on": ["right"], "kind": "bonded"},
        {"bodies": ["b", "joint"], "on": ["top"], "kind": "bonded"},
    ]
    acting = {"pivot": PIVOT.tolist(), "force": FORCE.tolist(), "moment": MOMENT} | node
    return {"body": beams, "rigid": [{"name": "joint", "shape": "node"} | acting], "contact": bonds}


def stiffness(end: tuple[float, float], along: tuple[float, float], length: float) -> np.ndarray:
    """(3, 3) of a clamped beam of Timoshenko, 1 by 1, for shifts and turn of the pivot, rigidly joined to its end."""
    bending, shear = YOUNG / 12.0, 5.0 / 6.0 * YOUNG / 2.0
    across = length**3 / (3.0 * bending) + length / shear
    yields = np.array(
        [
            [length / YOUNG, 0.0, 0.0],
            [0.0, across, length**2 / (2.0 * bending)],
            [0.0, length**2 / (2.0 * bending), length / bending],
        ]
    )
    t = np.array(along)
    turned = np.eye(3)
    turned[:2, :2] = [t, [-t[1], t[0]]]
    arm = np.array(end) - PIVOT
    moved = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]], [0.0, 0.0, 1.0]])
    return moved.T @ turned.T @ np.linalg.inv(yields) @ turned @ moved


@pytest.mark.slow
def test_two_beams_at_one_node():
    """The node moves and turns as the sum of the stiffnesses of both beams says; the clamps bear its load once."""
    K = stiffness((10.0, 0.5), (1.0, 0.0), 10.0) + stiffness((12.5, 0.0), (0.0, 1.0), 8.0)
    *shift, turn = np.linalg.solve(K, [*FORCE, MOMENT])
    summary = certified(angle()).summary
    node = summary["rigid"]["joint"]
    assert node["displacement"] == pytest.approx(shift, rel=5e-3)
    assert node["turn"] == pytest.approx(turn, rel=5e-3)
    assert node["force"] == pytest.approx(-FORCE, rel=1e-9)
    reactions = np.sum([body["reaction"] for body in summary["bodies"].values()], axis=0)
    assert reactions == pytest.approx(-FORCE, rel=1e-8)


@pytest.mark.slow
def test_bonded_faces_move_as_one_rigid_body():
    """In space, on a flat end and a round bore: the displacement of the nodes of both is u + θ × (x − p)."""
    pivot = [2.0, 0.5, 0.5]
    ends = {"x": 0.0, "y": 0.0, "z": 0.0}
    scene = {
        "body": [
            box(
                "a",
                (0, 0, 0),
                (1.0, 1.0, 1.0),
                (2, 2, 2),
                1,
                YOUNG,
                0.3,
                clamp=[{"on": "left"} | ends],
            ),
            {
                "name": "ring",
                "mesh": {
                    "shape": "cylinder",
                    "center": [4.0, 0.5, 0.0],
                    "axis": [0.0, 0.0, 1.0],
                    "radii": [0.5, 1.5],
                    "height": 1.0,
                    "size": 0.5,
                    "order": 1,
                },
                "material": {"young": YOUNG, "poisson": 0.3},
                "clamp": [{"on": "outer"} | ends],
            },
        ],
        "rigid": [
            {
                "name": "joint",
                "shape": "node",
                "pivot": pivot,
                "force": [1e3, 2e3, -3e3],
                "moment": [500.0, 0.0, 800.0],
            }
        ],
        "contact": [
            {"bodies": ["a", "joint"], "on": ["right"], "kind": "bonded"},
            {"bodies": ["ring", "joint"], "on": ["inner"], "kind": "bonded"},
        ],
    }
    answer = certified(scene)
    node = answer.summary["rigid"]["joint"]
    for name, on in (
        ("a", lambda x: x[:, 0] > 1.0 - 1e-9),
        (
            "ring",
            lambda x: np.hypot(x[:, 0] - 4.0, x[:, 1] - 0.5) < 0.5 + 1e-9,
        ),
    ):
        body = answer.bodies[name]
        x, u = body.points[on(body.points)], body.displacement[on(body.points)]
        assert len(x) > 8
        rigid = node["displacement"] + np.cross(node["turn"], x - pivot)
        assert u == pytest.approx(rigid, abs=1e-6 * np.abs(rigid).max())


def test_a_node_has_bonds_alone():
    """It has no surface that could be touched."""
    scene = angle()
    del scene["contact"][1]["kind"]
    assert_refused(scene, "contact.b-joint.kind: 'joint' is a node, which has no surface")
