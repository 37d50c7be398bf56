"""Bodies that touch themselves: the answers of two bodies that are bonded beside the slit, and of those without one."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scenes import assert_refused, call, certified, seldom, write_scene
from slits import TIP, Slit, scene, write

import ddmpi

FRICTION = {"law": "coulomb", "coefficient": 0.3}

STEPS = {
    "history": {"load": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 1.0, -0.6, 0.8]}},
    "time": {"points": [1.0, 2.0, 3.0], "steps": 1},
}

FLAT, WIDE = Slit(gap=1e-3), Slit(3, (4, 1, 2), gap=1e-3)

LOAD, SOLID = [4e5, -2e6], [4e5, 1e5, -2e6]


def in_places(answer: Any) -> dict[tuple, list[np.ndarray]]:
    """The displacements of all nodes by their places."""
    found: dict[tuple, list[np.ndarray]] = {}
    for body in answer.bodies.values():
        for point, u in zip(body.points, body.displacement, strict=True):
            found.setdefault(tuple(np.round(point, 7)), []).append(u)
    return found


def are_alike(one: Any, other: Any, least: float = 1e-8) -> None:
    """Both have the same displacements, where a slit parts nodes of one place those of both sides."""
    first, second = in_places(one), in_places(other)
    assert first.keys() == second.keys()
    size = max(np.abs(u).max() for nodes in second.values() for u in nodes)
    for place, nodes in first.items():
        for u in nodes:
            assert min(np.abs(u - v).max() for v in second[place]) <= least * size


CASES = {
    "frictionless": (FLAT, 1, LOAD, {}),
    "with friction": (FLAT, 1, LOAD, {"friction": FRICTION}),
    "quadratic": (FLAT, 2, LOAD, {"friction": FRICTION}),
    "closed": (Slit(), 2, LOAD, {"friction": FRICTION}),
    "Tresca": (FLAT, 1, LOAD, {"friction": {"law": "tresca", "slip_bound": 2e5}}),
    "mortar": (FLAT._replace(aside=0.04), 1, LOAD, {"friction": FRICTION}),
    "quadratic mortar": (FLAT._replace(aside=0.04), 2, LOAD, {"friction": FRICTION}),
    "pulled open": (FLAT, 1, [4e5, 2e6], {"friction": FRICTION}),
    "solids": (WIDE, 1, SOLID, {"friction": FRICTION}),
    "around an axis": (FLAT._replace(inside=1.0), 2, LOAD, {"friction": FRICTION}),
    "given gap": (FLAT, 1, LOAD, {"gap": "2e-4 * x"}),
    "bonded": (FLAT, 1, LOAD, {"kind": "bonded"}),
    "bricks": (FLAT._replace(bricks=True), 1, LOAD, {"friction": FRICTION}),
    "quadratic bricks": (FLAT._replace(bricks=True), 2, LOAD, {"friction": FRICTION}),
    "solid bricks": (WIDE._replace(bricks=True), 1, SOLID, {"friction": FRICTION}),
    "bonded quadratic bricks": (WIDE._replace(bricks=True), 2, SOLID, {"kind": "bonded"}),
    "quadratic solid bricks": (WIDE._replace(bricks=True), 2, SOLID, {"friction": FRICTION}),
    "quadratic solids": (WIDE, 2, SOLID, {"friction": FRICTION}),
}


QUICK = "closed", "quadratic mortar", "pulled open"
"""The slow suite asks the others. A slit is a feature of the matrix, too (tests/products)."""


def by_turns() -> list:
    """All cases at once or in load steps by turns, of which the quick suite asks a few."""
    return [
        pytest.param(
            case,
            k % 2 == 0,
            id=f"{'once' if k % 2 else 'steps'}-{name}",
            marks=[] if name in QUICK else pytest.mark.slow,
        )
        for k, (name, case) in enumerate(CASES.items())
    ]


@pytest.mark.parametrize(("case", "steps"), by_turns())
def test_a_body_with_a_slit_is_two_that_are_bonded(tmp_path, case, steps):
    """Displacements, slip and statuses are those of the halves, which share the nodes beside the slit."""
    slit, order, load, keys = case
    more: dict[str, Any] = {"axisymmetric": slit.inside > 0.0, "method": {"tolerance": 1e-10}}
    traction: Any = load
    if steps:
        more |= STEPS
        traction = {"on": "top", "value": load, "history": "load"}
    one, two = (
        certified(scene(tmp_path, slit, order, traction, parted, **keys) | more)
        for parted in (False, True)
    )
    are_alike(one, two)
    mine, theirs = one.contacts["lips"], two.contacts["lips"]
    size = max(np.abs(body.displacement).max() for body in two.bodies.values())
    # the halves have a row at the tip, which the bond holds, too
    for at, status, gap, slip in zip(
        mine.interface.xy, mine.status, mine.gap, mine.slip, strict=True
    ):
        k = int(np.linalg.norm(theirs.interface.xy - at, axis=1).argmin())
        assert theirs.interface.xy[k] == pytest.approx(at, abs=1e-12)
        assert gap == pytest.approx(theirs.gap[k], abs=1e-8 * size)
        assert slip == pytest.approx(theirs.slip[k], abs=1e-8 * size)
        assert status == theirs.status[k]
    assert one.summary["bodies"]["block"]["energy"] == pytest.approx(
        sum(body["energy"] for body in two.summary["bodies"].values()), rel=1e-7
    )
    called = {None: None, "low": "first", "up": "second"}
    slaves = (answer.summary["contacts"]["lips"]["slave"] for answer in (one, two))
    assert next(slaves) == called[next(slaves)]


@pytest.mark.parametrize(
    ("slit", "order", "load"),
    [(Slit(), 1, LOAD), (Slit(), 2, LOAD), (WIDE._replace(gap=0.0), 1, SOLID)],
)
def test_a_closed_slit_that_sticks_is_none(tmp_path, slit, order, load):
    """Under pressure and shear that friction holds the body is the one without a slit."""
    stuck = scene(tmp_path, slit, order, load, friction={"law": "coulomb", "coefficient": 5.0})
    whole = scene(tmp_path, slit, order, load)
    whole["body"][0]["mesh"]["file"] = write(tmp_path / "uncut.msh", slit.welded(closed=True))
    del whole["contact"]
    answer = certified(stuck)
    are_alike(answer, certified(whole), 1e-9)
    assert (answer.contacts["lips"].status == "stick").all()
    assert TIP not in answer.contacts["lips"].interface.xy[:, 0]


def test_a_slit_bears_no_motion_of_its_body(tmp_path):
    """A ring that is pressed all around until its ears touch is loose, and stays where it is."""
    p = 3.0
    ring = {
        "name": "ring",
        "mesh": {
            "shape": "annulus",
            "center": [0.0, 0.0],
            "radii": [9.0, 10.0],
            "angles": [1.0, 359.0],
            "divisions": [120, 2],
            "order": 2,
        },
        "material": {"young": 2.1e5, "poisson": 0.3},
        "traction": [
            {"on": "outer", "pressure": p},
            {"on": "outer", "force": [-20.0 * p * np.sin(np.pi / 180.0), 0.0]},
        ],
    }
    half = ring | {"clamp": [{"on": "end", "y": 0.0}]}
    half["mesh"] = ring["mesh"] | {"angles": [1.0, 180.0], "divisions": [60, 2]}
    half["traction"] = [
        {"on": "outer", "pressure": p},
        {"on": "outer", "force": [-10.0 * p * np.sin(np.pi / 180.0), 0.0]},
    ]
    mirror = {"name": "mirror", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    right = certified(
        {
            "body": [half],
            "rigid": [mirror],
            "contact": [{"name": "ears", "bodies": ["ring", "mirror"], "on": ["start"]}],
        }
    ).summary["contacts"]["ears"]["normal_force"]
    for pairing in ("nodes", "mortar"):
        ears = {"name": "ears", "bodies": ["ring", "ring"], "on": ["start", "end"]}
        answer = certified({"body": [ring], "contact": [ears | {"pairing": pairing}]})
        found = answer.summary["contacts"]["ears"]
        assert found["normal_force"] == pytest.approx(right, rel=5e-5)
        assert answer.summary["outer_iterations"] <= 10
        # a moment of the gap's lever arms turns nothing: neither the mean motion nor the mean turn is of the order of 0.17
        u = answer.bodies["ring"].displacement
        arms = answer.bodies["ring"].points - answer.bodies["ring"].points.mean(axis=0)
        assert np.abs(u.mean(axis=0)).max() < 1e-10
        assert abs((arms[:, 0] * u[:, 1] - arms[:, 1] * u[:, 0]).sum()) < 1e-12 * (arms**2).sum()
        assert len(answer.summary["held_motions"]) == 3
        assert answer.summary["undetermined"] == []
    shown = call(
        "check",
        str(write_scene({"body": [ring], "contact": [ears]}, tmp_path / "ring.toml")),
        "--no-figures",
    ).output
    assert "\nring can move freely without any force, whatever touches" in shown
    turned = ring | {"traction": [*ring["traction"], {"on": "outer", "moment": 5.0}]}
    refused = ddmpi.solve({"body": [turned], "contact": [ears]}, MPI.COMM_SELF)
    assert "no equilibrium: ring would turn counterclockwise" in refused.reason


@pytest.mark.parametrize("slave", ["first", "second"])
def test_the_slave_is_called_by_its_side(tmp_path, slave):
    """Of one body the sides are called first and second."""
    slit = FLAT._replace(aside=0.04)
    answer = certified(scene(tmp_path, slit, 1, LOAD, slave=slave))
    assert answer.summary["contacts"]["lips"]["slave"] == slave
    at = answer.contacts["lips"].interface.xy
    nodes = slit.welded().points[slit.welded().groups[{"first": "low", "second": "up"}[slave]]]
    apart = np.linalg.norm(at[:, None] - nodes.reshape(-1, 2), axis=2).min(axis=1)
    assert apart.max() < 1e-12


def test_sides_of_a_slit_do_not_penetrate_each_other(tmp_path):
    """A body that closes its slit with a contact has no warning of itself; without the contact it is told to add one."""
    kept = scene(tmp_path, WIDE._replace(cells=(8, 2, 3)), 2, SOLID)
    answer = certified(kept)
    assert not any("penetrates itself" in warning for warning in answer.summary["warnings"])
    loose = {"body": kept["body"]}
    (warning,) = (one for one in certified(loose).summary["warnings"] if "penetrates itself" in one)
    assert 'add a contact with bodies = ["block", "block"]' in warning


@pytest.mark.slow
def test_a_body_that_moves_far_takes_its_slit_along(tmp_path):
    """The forces on the sides of a slit turn with the body, and stay what they are along its normals."""
    load = {"on": "top", "value": LOAD, "history": "load", "follows": True}
    far = scene(tmp_path, FLAT, 1, load, friction=FRICTION, pairing="mortar")
    far["body"][0]["motion"] = {"turn": 40.0, "history": "turn"}
    far |= {
        "history": {
            "load": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 1.0]},
            "turn": {"times": [1.0, 2.0], "factors": [0.0, 1.0]},
        },
        "time": {"points": [1.0, 2.0], "steps": 2, "motions": "far"},
    }
    still = deepcopy(far)
    del still["time"]["motions"], still["body"][0]["motion"], still["history"]["turn"]
    del still["body"][0]["traction"][0]["follows"]
    steps = [step["contacts"]["lips"] for step in certified(far).summary["steps"]]
    before, turned = steps[1], steps[3]
    size = np.linalg.norm(before["force"])
    angle = np.radians(40.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert turned["force"] == pytest.approx(turn @ before["force"], abs=1e-8 * size)
    assert turned["normal_force"] == pytest.approx(before["normal_force"], rel=1e-8)
    here = certified(still).contacts["lips"].normal_force.sum()
    assert before["normal_force"] == pytest.approx(here, rel=1e-5)


@pytest.mark.slow
def test_derivatives_and_bars_know_a_slit(tmp_path):
    """By the size of an interference, and by friction, forces change as by differences; forces have bars."""
    fit = scene(tmp_path, FLAT, 1, LOAD, friction=FRICTION, gap=-1e-4)
    fit["contact"][0]["friction"] = {"law": "coulomb", "coefficient": 0.1}
    fit["method"] = {"tolerance": 1e-12}
    keys = ["contact.lips.gap", "contact.lips.friction.coefficient"]
    asked = {"output": {"derivatives": keys, "errors": ["contacts.lips.normal_force"]}}
    answer = certified(fit | asked)
    for key, value in zip(keys, (-1e-4, 0.1), strict=True):
        ends = [_with(fit, key, value * (1.0 + k)) for k in (-1e-4, 1e-4)]
        change = (ends[1] - ends[0]) / (2e-4 * value)
        found = answer.summary["derivatives"][key]["contacts"]["lips"]["normal_force"]
        assert found == pytest.approx(change, rel=1e-5)
    assert answer.summary["errors"]["contacts.lips.normal_force"]["bar"] > 0.0


def _with(slit: dict, key: str, value: float) -> float:
    answer = ddmpi.solve(slit, MPI.COMM_SELF, {key: value})
    assert answer.certified
    return answer.summary["contacts"]["lips"]["normal_force"]


@pytest.mark.slow
def test_a_prepared_model_knows_a_slit(tmp_path):
    """Cases of a model have the answers of runs by themselves."""
    slit = scene(tmp_path, FLAT, 1, LOAD, friction=FRICTION)
    with ddmpi.prepare(slit, MPI.COMM_SELF) as model:
        for change in (
            {"contact.lips.friction.coefficient": 0.1},
            {"contact.lips.kind": "bonded", "contact.lips.friction": {"law": "none"}},
            {"contact.lips.pairing": "mortar"},
        ):
            case, alone = model.solve(change), ddmpi.solve(slit, MPI.COMM_SELF, change)
            assert case.contacts["lips"].forces == pytest.approx(
                alone.contacts["lips"].forces, rel=1e-12
            )


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("bodies", [1, seldom(2)])
def test_ranks_share_a_body_with_a_slit(tmp_path, bodies):
    """Of a body that two ranks share, and of two bodies on two ranks, the answers are those of one rank."""
    world = MPI.COMM_WORLD
    folder = Path(world.bcast(str(tmp_path)))
    alone = scene(folder, FLAT, 1, LOAD, friction=FRICTION)
    world.Barrier()
    upper = deepcopy(alone["body"][0]) | {"name": "upper", "copy": {"of": "block"}}
    upper["copy"]["shift"] = [0.0, 1.5]
    del upper["mesh"], upper["material"], upper["clamp"]
    lower = alone["body"][0] | {"traction": []}
    lips = [
        alone["contact"][0] | {"name": f"lips of {name}".replace(" ", "-"), "bodies": [name] * 2}
        for name in ("block", "upper")
    ]
    joint = {"bodies": ["upper", "block"], "on": ["bottom", "top"], "friction": FRICTION}
    stack = {"body": [lower, upper], "contact": [*lips, joint]}
    made = {1: alone, 2: stack}[bodies] | {"method": {"tolerance": 1e-10}}
    one, two = certified(made), certified(made, world)
    assert two.summary["ranks"] == 2
    for name, contact in one.contacts.items():
        size = np.abs(contact.forces).max()
        assert two.contacts[name].forces == pytest.approx(contact.forces, abs=1e-7 * size)


def test_one_surface_is_not_both_sides(tmp_path):
    """Groups of other names that have facets in common are refused."""
    mesh = FLAT.welded()
    mesh.groups["all"] = np.concatenate([mesh.groups["low"], mesh.groups["up"]])
    faced = scene(tmp_path, FLAT, 1, LOAD)
    faced["body"][0]["mesh"]["file"] = write(tmp_path / "all.msh", mesh)
    faced["contact"][0]["on"] = ["all", "up"]
    assert_refused(faced, "contact.lips.on: 'all' and 'up' have 4 lines in common")
