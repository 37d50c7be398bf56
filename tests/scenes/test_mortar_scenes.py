"""Whole scenes whose meshes do not match, against closed forms."""

import numpy as np
import pytest
from scenes import certified, pinched_blocks, rectangle

from ddmpi.errors import InputError

YOUNG, POISSON, PRESSURE = 1e9, 0.3, 1e6
orders = pytest.mark.parametrize("order", [1, 2])


def solved(bodies: list[dict], contacts: list[dict], tolerance: float = 1e-12):
    return certified({"body": bodies, "contact": contacts, "method": {"tolerance": tolerance}})


def body(
    name: str, mesh: dict, clamp: list, traction: dict | None = None, young: float = YOUNG
) -> dict:
    loads = [] if traction is None else [traction]
    return {
        "name": name,
        "mesh": mesh,
        "material": {"young": young, "poisson": POISSON},
        "clamp": clamp,
        "traction": loads,
    }


def quadrilateral(
    x: float, y: float, width: float, divisions: tuple[int, int], order: int, slope: float = 0.0
) -> dict:
    """Of height one at (x, y), above or below y = 1 + slope x."""
    low, high = (0.0, slope) if y == 0.0 else (slope, 0.0)
    corners = [
        [x, y + low * x],
        [x + width, y + low * (x + width)],
        [x + width, y + 1.0 + high * (x + width)],
        [x, y + 1.0 + high * x],
    ]
    return {
        "shape": "quadrilateral",
        "corners": corners,
        "divisions": list(divisions),
        "order": order,
    }


def press(group: str = "top") -> dict:
    return {"on": group, "value": [0.0, -PRESSURE]}


@pytest.mark.slow
@orders
@pytest.mark.parametrize("held", ["clamps", "bonds"])
def test_two_leaves_held_at_one_end(held, order):
    """Whatever the meshes, they bend as on matching ones, and so does the moment of their pressure about that end.

    Pressure next to the end has no lever, so that its sum says less, with linear elements a third.
    """
    wall = {"name": "wall", "shape": "plane", "point": [0.0, 0.0], "normal": [1.0, 0.0]}

    def found(upper: int, lower: int) -> list[float]:
        bodies = [
            rectangle(
                name,
                (0, y),
                (length, 6),
                (n, 4),
                order,
                2.06e5,
                clamp=["left"] * (held == "clamps"),
            )
            for name, y, length, n in (("upper", 6.0, 100.0, upper), ("lower", 0.0, 80.0, lower))
        ]
        bodies[0]["traction"] = [{"on": "top", "value": [0.0, -1.0]}]
        bonds = [
            {"bodies": [name, "wall"], "on": ["left"], "kind": "bonded"}
            for name in ("upper", "lower")
        ]
        scene = {
            "body": bodies,
            "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"]}],
        }
        if held == "bonds":
            scene = {"rigid": [wall], "body": bodies, "contact": bonds + scene["contact"]}
        answer = certified(scene)
        force, x = (
            answer.contacts["upper-lower"].normal_force,
            answer.contacts["upper-lower"].interface.xy[:, 0],
        )
        return [
            answer.summary["bodies"][name]["displacement_max"] for name in ("upper", "lower")
        ] + [force @ x, force.sum()]

    right, within = found(50, 40), [(0.07, 0.07, 0.07, 0.4), (1e-3, 1e-3, 5e-3, 0.08)][order - 1]
    for sides in (48, 36), (30, 48):
        for value, matching, most in zip(found(*sides), right, within, strict=True):
            assert value == pytest.approx(matching, rel=most)


def plates(seed: int) -> dict:
    """Four plates around a point, on the ground, whose meshes do not match; the diagonal ones have no contact."""
    rng = np.random.default_rng(seed)
    at = np.array(
        [[[i, j] + 0.1 * rng.uniform(-1, 1, 2) * [1, j > 0] for j in range(3)] for i in range(3)]
    )
    bodies = [
        {
            "name": f"b{i}{j}",
            "material": {"young": float(10 ** rng.uniform(9, 10)), "poisson": 0.3},
            "mesh": {
                "shape": "quadrilateral",
                "divisions": rng.integers(3, 9, 2).tolist(),
                "corners": [at[i + a, j + b].tolist() for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))],
            },
            **({"traction": [{"on": "top", "pressure": 6e4}]} if j else {"clamp": ["bottom"]}),
        }
        for i in (0, 1)
        for j in (0, 1)
    ]
    pairs = (
        ("b00", "b10", "right", "left"),
        ("b01", "b11", "right", "left"),
        ("b00", "b01", "top", "bottom"),
        ("b10", "b11", "top", "bottom"),
    )
    kinds = [{"kind": "bonded"}, {"friction": {"law": "coulomb", "coefficient": 0.6}}]
    return {
        "body": bodies,
        "contact": [
            {"bodies": [a, b], "on": [on, facing], **kinds[int(rng.integers(0, 2))]}
            for a, b, on, facing in pairs
        ],
    }


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_bodies_that_meet_at_a_point_do_not_run_through_each_other(seed):
    """Diagonally across a point of four bodies, their corners overlap as the meshes of its contacts do."""
    answer = certified(plates(seed))
    assert [each for each in answer.summary["warnings"] if "penetrate" in each] == []


@pytest.mark.slow
@pytest.mark.parametrize("law", ["none", "coulomb"])
def test_a_clamped_end_costs_no_iterations(law):
    """Where a clamp holds the end of the slave, a solve takes no more multiplications than on matching meshes."""
    counts = []
    for sides in (48, 40):
        scene = pinched_blocks(16, law)
        scene["body"][0]["mesh"]["divisions"] = [sides, 16]
        counts.append(certified(scene).summary["n_A"])
    assert counts[1] <= 1.2 * counts[0]


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"slave": "uper"}, "did you mean 'upper'"),
        ({"slave": "lower", "pairing": "nodes"}, "does not go with"),
        ({"pairing": "node"}, "did you mean 'nodes'"),
        ({"pairing": "nodes"}, "match node by node"),
    ],
)
def test_wrong_keys(keys, words):
    """A mistake in the keys of a pairing names what would have been right."""
    bodies = [
        body("upper", quadrilateral(0.0, 1.0, 2.0, (4, 2), 1), ["top"]),
        body("lower", quadrilateral(0.0, 0.0, 2.0, (5, 2), 1), ["bottom"]),
    ]
    with pytest.raises(InputError) as error:
        solved(bodies, [{"bodies": ["upper", "lower"], "on": ["bottom", "top"]} | keys])
    assert words in str(error.value)


@pytest.mark.parametrize(
    "slave, moved", [(None, 2.3e-16), (None, -2.3e-16), ("left", 0.0), ("right", 2.3e-16)]
)
def test_friction_along_the_arc_is_the_same_whatever_the_slave(slave, moved):
    """Of an upright contact, of which rounding decides whose corner is farther to the left; bodies swapped as well."""
    sizes = {"left": (0.0, 1.0 + moved), "right": (1.0, 2.0)}
    bodies = [
        body(
            name,
            {
                "shape": "quadrilateral",
                "corners": [[a, 0.0], [b, 0.0], [a + 1.0, 3.0], [a, 3.0]],
                "divisions": [4, number],
            },
            clamp,
            load,
        )
        for (name, (a, b)), number, clamp, load in zip(
            sizes.items(),
            (12, 12 if slave is None else 10),
            (["left"], ["bottom"]),
            (
                {"on": "top", "value": [0.0, -PRESSURE]},
                {"on": "right", "value": [-PRESSURE, 0.3 * PRESSURE]},
            ),
            strict=True,
        )
    ]
    forces = []
    for turn, values in ((1, [0.0, 0.0, 0.8]), (-1, [0.8, 0.0, 0.0])):
        friction = {
            "law": "coulomb",
            "coefficient": {"along": "arc", "points": [0.0, 1.5, 3.0], "values": values},
        }
        contact = {
            "name": "seam",
            "bodies": ["left", "right"][::turn],
            "on": ["right", "left"][::turn],
            "friction": friction,
        } | ({} if slave is None else {"pairing": "mortar", "slave": slave})
        forces.append(turn * solved(bodies, [contact], 1e-8).contacts["seam"].force)
    assert forces[0] == pytest.approx(forces[1], rel=1e-6)
    assert forces[0] == pytest.approx([-2.5e6, 4.0e5], rel=0.02)
