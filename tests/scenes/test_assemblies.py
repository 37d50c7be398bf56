"""Assemblies with known answers: the shipped ones, and scenes such as a new user would write."""

import tomllib

import numpy as np
import pytest
import scenes
from scenes import COULOMB, FLOOR, ROOT, rectangle

import ddmpi
from ddmpi.run.answer import Answer

pytestmark = pytest.mark.slow

two_ranks = pytest.mark.mpi(ranks=2)

MATERIAL = {"young": 2.0e10, "poisson": 0.25}

DISPLACEMENT = {"wall": 5.3563296e-6, "arch": 5.00089917e-3}
"""Largest displacements of shipped scenes (m), from an independent code by dense factorisations."""


def solve(comm, scene: dict, certified: bool = True) -> Answer:
    answer = ddmpi.solve(scene, comm)
    assert answer.certified is certified, answer.reason
    assert answer.summary["warnings"] == []
    return answer


def shipped(comm, name: str, **overrides) -> Answer:
    return ddmpi.solve(ROOT / "configs" / f"{name}.toml", comm, overrides)


def block(name: str, x: float, y: float, width: float, height: float, N: int = 8, **more) -> dict:
    divisions = round(width * N), round(height * N)
    return rectangle(name, (x, y), (width, height), divisions, **{"material": MATERIAL} | more)


def contact(first: str, second: str, *on: str, **more) -> dict:
    return {"bodies": [first, second], "on": list(on)} | more


# The shipped scenes


def test_the_floor_bears_the_wall(comm):
    """Weight, load and push are the floor's reactions, with their moment: 12 kN at 0.42 m, 42.912 kN at 0.36 m."""
    answer = shipped(comm, "wall")
    assert answer.certified and answer.summary["warnings"] == [] and answer.summary["undetermined"] == []
    floor = [each for name, each in answer.summary["contacts"].items() if name.endswith("floor")]
    push, weight = 1.0e5 * 0.12, 5.0e4 * 0.72 + 2.0e4 * 0.72 * 0.48
    assert np.sum([each["force"] for each in floor], axis=0) == pytest.approx([-push, weight], rel=1e-6)
    assert sum(each["moment"] for each in floor) == pytest.approx(weight * 0.36 + push * 0.42, rel=1e-6)
    counts = [sum(each[status] for each in answer.summary["contacts"].values()) for status in ("open", "slip", "stick")]
    assert answer.summary["m"] == sum(counts) == 167 and min(counts) > 0
    assert answer.summary["displacement_max"] == pytest.approx(DISPLACEMENT["wall"], rel=1e-6)


def test_springings_that_give_way_make_the_thrust_of_an_arch_the_least(comm):
    """It passes the back of the crown (Couplet, Heyman): 40.194 kN by statics; springings bear the weight."""
    answer = shipped(comm, "arch", **{"rigid.right.displacement": [0.005, 0.0]})
    assert answer.certified and answer.summary["warnings"] == []
    contacts = answer.summary["contacts"]
    thrust = -contacts["v5-v6"]["force"][0]
    assert thrust == pytest.approx(4.0194e4, rel=1e-4)
    assert contacts["v5-v6"]["moment"] / thrust == pytest.approx(5.0, abs=1e-3)
    assert answer.summary["displacement_max"] == pytest.approx(DISPLACEMENT["arch"], rel=1e-6)
    left, right = (contacts[name]["force"] for name in ("v1-left", "v10-right"))
    assert (left[0], -right[0]) == pytest.approx((thrust, thrust), rel=1e-6)
    assert left[1] + right[1] == pytest.approx(10 * 2.0e4 * (5**2 - 4**2) * np.sin(np.pi / 10) / 2, rel=1e-6)


@two_ranks
def test_the_hub_bears_the_shaft(comm):
    """The hub's force is the weight, its moment the torque, both exactly: those of the polygons that are meshed."""
    answer = shipped(comm, "shaft_in_hub")
    assert answer.certified and answer.summary["warnings"] == [] and answer.summary["undetermined"] == []
    sector = np.sin(2 * np.pi / 120) * 120 / 2
    weight = 7.58e7 * sector * (0.05**2 - 0.02**2)
    side, apothem = 2 * 0.02 * np.sin(np.pi / 120), 0.02 * np.cos(np.pi / 120)
    torque = 120 * 4.0e7 * side * (apothem**2 + side**2 / 12)  # traction k (−y, x) along sides
    for name in ("shaft-bush", "bush-hub"):
        found = answer.summary["contacts"][name]
        assert found["force"] == pytest.approx([0.0, weight], rel=1e-6, abs=1e-6 * weight)
        assert found["moment"] == pytest.approx(-torque, rel=1e-6)
    hub, bush = (answer.summary["contacts"][name] for name in ("bush-hub", "shaft-bush"))
    assert (hub["open"], hub["slip"]) == (0, 0)
    assert bush["open"] > 40 and bush["slip"] > 40 and bush["stick"] > 0


def test_a_bonded_block_is_one_block(comm):
    """Four bonded blocks move as one with the same mesh, which touches nothing: a floor is far below."""
    parts = shipped(comm, "bonded_block")
    assert parts.certified and parts.summary["warnings"] == []
    loads = [{"on": "top", "value": [0.0, -2.0e6]}, {"on": "right", "value": [0.0, -1.0e6]}]
    one = scenes.certified({
        "body": [rectangle("one", (0, 0), (2, 1), (32, 16), young=2.1e11, clamp=["left"], traction=loads)],
        "rigid": [FLOOR | {"point": [0.0, -1.0]}], "contact": [contact("one", "floor", "bottom")]}, comm)
    everything = [(body.points, body.displacement) for rank in comm.allgather(
        [*parts.bodies.values()]) for body in rank]
    whole = next(rank["one"] for rank in comm.allgather(dict(one.bodies)) if rank)
    at = {tuple(np.round(point, 9)): u for point, u in zip(whole.points, whole.displacement, strict=True)}
    largest = np.abs(whole.displacement).max()
    for points, displacement in everything:
        expected = np.array([at[tuple(np.round(point, 9))] for point in points])
        assert np.abs(displacement - expected).max() <= 1e-8 * largest


@pytest.mark.clarabel
def test_a_tower_tips_and_stands(tmp_path):
    """The command ends with exit code 3, names the bodies, and draws how they tip; with a block less they stand."""
    name = ROOT / "configs" / "tipping_tower.toml"
    done = scenes.run_here(name, tmp_path / "out")
    assert done.code == 3
    assert "no equilibrium: second, third and fourth would move most at (" in done.stderr
    assert (tmp_path / "out" / "mechanism.png").exists() and not (tmp_path / "out" / "bodies.png").exists()
    scene = tomllib.loads(name.read_text(encoding="utf-8"))
    scene["body"] = [each for each in scene["body"] if each["name"] != "fourth"]
    scene["contact"] = [each for each in scene["contact"] if "fourth" not in each["bodies"]]
    assert scenes.certified(scene).summary["undetermined"] == []


# Scenes of a new user; docs/studies/assemblies_tried.md has more of them


ROUGH = COULOMB | {"coefficient": 0.6}


def feet() -> dict:
    """A half ring stands on a beam with both feet: two contacts of the same two bodies."""
    ring = {"name": "ring", "material": MATERIAL, "volume_force": [0.0, -2.0e4], "mesh": {
        "shape": "annulus", "center": [0.0, 0.0], "radii": [1.0, 1.5], "angles": [0, 180], "divisions": [32, 4]}}
    return {"rigid": [FLOOR | {"point": [0.0, -0.5]}],
            "body": [ring, block("beam", -2.0, -0.5, 4.0, 0.5)],
            "contact": [contact("ring", "beam", "start", "top", name="right", friction=ROUGH),
                        contact("ring", "beam", "end", "top", name="left", friction=ROUGH),
                        contact("beam", "floor", "bottom", friction=ROUGH)]}


def pushed(push: float, law: dict) -> dict:
    """Two blocks of 20 kN on a floor, the upper one pushed at its side by so many newtons."""
    weight, side = [0.0, -2.0e4], [{"on": "left", "value": [push / 0.5, 0.0]}]
    return {"rigid": [FLOOR], "body": [block("lower", 0.0, 0.0, 2.0, 0.5, volume_force=weight),
                                       block("upper", 0.0, 0.5, 2.0, 0.5, volume_force=weight, traction=side)],
            "contact": [contact("lower", "floor", "bottom", friction=law),
                        contact("upper", "lower", "bottom", "top", friction=law)]}


def chain(pull: float = 1.0e6, kind: str = "bonded") -> dict:
    """Four bars in a row, held at the left end only, pulled at the right end."""
    bars = [block(f"bar{k}", float(k), 0.0, 1.0, 0.25) for k in range(4)]
    bars[0]["clamp"] = [{"on": "left", "x": 0.0}]
    bars[3]["traction"] = [{"on": "right", "value": [pull, 0.0]}]
    return {"body": bars, "contact": [contact(f"bar{k}", f"bar{k + 1}", "right", "left", kind=kind) for k in range(3)]}


def test_both_feet_bear_half_of_a_ring(comm):
    """Two contacts of the same two bodies have an answer each."""
    contacts = solve(comm, feet()).summary["contacts"]
    half = 2.0e4 * (1.5**2 - 1.0**2) * np.sin(np.pi / 32) * 32 / 4
    (fx, fy), (gx, gy) = contacts["left"]["force"], contacts["right"]["force"]
    assert (fy, gy) == pytest.approx((half, half), rel=1e-3)  # triangles are not symmetric
    assert fy + gy == pytest.approx(2 * half, rel=1e-6)
    assert fx == pytest.approx(-gx, rel=1e-6) and fx > 0.0  # the feet are kept from sliding outward


@two_ranks
@pytest.mark.clarabel
@pytest.mark.parametrize("law, bears", [(COULOMB | {"coefficient": 0.5}, 1.0e4),
                                        ({"law": "tresca", "slip_bound": 5.0e3}, 1.0e4)], ids=["coulomb", "tresca"])
def test_a_block_is_pushed_up_to_its_friction(comm, law, bears):
    """Friction holds 0.5 of the upper block's weight, or the slip bound times the length; a larger push is refused."""
    for each in solve(comm, pushed(0.98 * bears, law)).summary["contacts"].values():
        assert each["force"][0] == pytest.approx(-0.98 * bears, rel=1e-6)
    assert "no equilibrium: upper would move along x" in solve(comm, pushed(1.02 * bears, law), certified=False).reason


@two_ranks
@pytest.mark.clarabel
def test_a_chain_of_bars(comm):
    """Bonds bear the pull, and the end moves by σ L/E'; without bonds nothing holds the last bar."""
    answer = solve(comm, chain())
    for each in answer.summary["contacts"].values():
        assert each["normal_force"] == pytest.approx(-0.25e6, rel=1e-6)
    ends = [body.displacement[:, 0].max() for rank in comm.allgather(list(answer.bodies.values())) for body in rank]
    assert max(ends) == pytest.approx(4.0 * 1.0e6 * (1 - 0.25**2) / 2.0e10, rel=1e-6)
    assert "no equilibrium" in solve(comm, chain(kind="unilateral"), certified=False).reason
