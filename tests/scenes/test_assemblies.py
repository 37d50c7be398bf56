"""Assemblies with known answers: the shipped ones, and scenes such as a new user would write."""

import numpy as np
import pytest
import scenes
from scenes import FLOOR, ROOT, rectangle
from scipy.optimize import linprog

import ddmpi
from ddmpi.run.answer import Answer

pytestmark = pytest.mark.slow

two_ranks = pytest.mark.mpi(ranks=2)

YOUNG, POISSON = 2.0e10, 0.25
MATERIAL = {"young": YOUNG, "poisson": POISSON}
PLANE_MODULUS = YOUNG / (1 - POISSON**2)
WEIGHT = [0.0, -2.0e4]

DISPLACEMENT = {"wall": 5.3563296e-6, "arch": 5.00089917e-3}
"""Largest displacements of shipped scenes (m), from the independent code in tests/support/assemblies.py."""


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


def coulomb(coefficient: float) -> dict:
    return {"law": "coulomb", "coefficient": coefficient}


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


def statics(joints: list, weights: np.ndarray, places: np.ndarray, most: bool = False) -> float:
    """The least or largest thrust of half an arch with these joints from the crown down, by linear programming.

    The thrust H passes the crown at the height h: unknown are H and H h. At the joint k the line of action of H and of
    the weight of all above must pass between the inner and the outer end.
    """
    rows, right = [], []
    for k, (inner, outer) in enumerate(joints):
        V, Vx = weights[:k].sum(), weights[:k] @ places[:k]
        for (x, y), sign in ((inner, 1.0), (outer, -1.0)):  # H (h − y) − Σ V (x − x_V): no tipping about either end
            rows.append([sign * y, -sign])
            right.append(-sign * (V * x - Vx))
    found = linprog([-1.0 if most else 1.0, 0.0], A_ub=rows, b_ub=right, bounds=[(0, None), (None, None)])
    assert found.status == 0
    return float(found.x[0])


def half_arch(count: int = 5) -> tuple[list, np.ndarray, np.ndarray]:
    """Joints, weights and centres of the right half of the shipped arch."""
    angle = np.pi / 2 - np.arange(count + 1) * np.pi / 10
    rays = np.column_stack([np.cos(angle), np.sin(angle)])
    joints = [(4 * ray, 5 * ray) for ray in rays]
    weights, places = np.empty(count), np.empty(count)
    for k in range(count):
        corners = np.array([joints[k][0], joints[k][1], joints[k + 1][1], joints[k + 1][0]])
        (x, y), (x2, y2) = corners.T, np.roll(corners, -1, axis=0).T
        cross = x * y2 - x2 * y
        weights[k] = 2.0e4 * abs(cross.sum()) / 2
        places[k] = ((x + x2) * cross).sum() / (3 * cross.sum())
    return joints, weights, places


def test_the_thrust_of_a_spread_arch_is_the_least(comm):
    """Statics leaves the thrust of an arch a choice; springings that give way make it the least: Couplet, Heyman."""
    least, most = (statics(*half_arch(), most) for most in (False, True))
    assert most > 1.2 * least
    thrusts = {}
    for spread in (0.005, 0.0):
        answer = shipped(comm, "arch", **{"rigid.right.displacement": [spread, 0.0]})
        assert answer.certified and answer.summary["warnings"] == []
        crown = answer.summary["contacts"]["v5-v6"]
        thrusts[spread] = -crown["force"][0]
        left, right = (answer.summary["contacts"][name]["force"] for name in ("v1-left", "v10-right"))
        assert (left[0], -right[0]) == pytest.approx((thrusts[spread], thrusts[spread]), rel=1e-6)
        assert left[1] + right[1] == pytest.approx(2 * half_arch()[1].sum(), rel=1e-6)
        if spread:  # at the back of the crown
            assert crown["moment"] / thrusts[spread] == pytest.approx(5.0, abs=1e-3)
            assert answer.summary["displacement_max"] == pytest.approx(DISPLACEMENT["arch"], rel=1e-6)
    assert thrusts[0.005] == pytest.approx(least, rel=1e-5)
    assert 1.02 * least < thrusts[0.0] < most


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
    done = scenes.run_command(name, tmp_path / "out")
    assert done.code == 3
    assert "no equilibrium: second, third and fourth would move most at (" in done.stderr
    assert (tmp_path / "out" / "mechanism.png").exists() and not (tmp_path / "out" / "bodies.png").exists()
    text = name.read_text()
    head, *tables = text.split("\n[[")
    (tmp_path / "three.toml").write_text("\n[[".join([head, *(each for each in tables if "fourth" not in each)]))
    assert scenes.run_command(tmp_path / "three.toml", tmp_path / "three", "--no-figures").code == 0


# Ten scenes of a new user; docs/studies/assemblies_tried.md


def feet() -> dict:
    """A half ring stands on a beam with both feet: two contacts of the same two bodies."""
    ring = {"name": "ring", "material": MATERIAL, "volume_force": WEIGHT, "mesh": {
        "shape": "annulus", "center": [0.0, 0.0], "radii": [1.0, 1.5], "angles": [0, 180], "divisions": [32, 4]}}
    return {"rigid": [FLOOR | {"point": [0.0, -0.5]}],
            "body": [ring, block("beam", -2.0, -0.5, 4.0, 0.5)],
            "contact": [contact("ring", "beam", "start", "top", name="right", friction=coulomb(0.6)),
                        contact("ring", "beam", "end", "top", name="left", friction=coulomb(0.6)),
                        contact("beam", "floor", "bottom", friction=coulomb(0.6))]}


def brick_on_two() -> dict:
    """A loaded brick lies across the joint of two others."""
    return {"rigid": [FLOOR], "body": [
        block("a", 0.0, 0.0, 1.0, 0.5), block("b", 1.0, 0.0, 1.0, 0.5),
        block("top", 0.5, 0.5, 1.0, 0.5, volume_force=WEIGHT, traction=[{"on": "top", "value": [0.0, -1.0e5]}])],
        "contact": [contact("a", "floor", "bottom", friction=coulomb(0.5)),
                    contact("b", "floor", "bottom", friction=coulomb(0.5)),
                    contact("a", "b", "right", "left", friction=coulomb(0.5)),
                    contact("top", "a", "bottom", "top", friction=coulomb(0.5)),
                    contact("top", "b", "bottom", "top", friction=coulomb(0.5))]}


def roller(approach: float = 0.02) -> dict:
    """A roller between two rigid plates without friction."""
    mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": [0.05, 0.5], "angles": [0, 360], "divisions": [320, 24]}
    return {"rigid": [FLOOR | {"point": [0.0, -0.5]},
                      {"name": "plate", "shape": "plane", "point": [0.0, 0.5], "normal": [0.0, -1.0],
                       "displacement": [0.0, -approach]}],
            "body": [{"name": "roller", "material": MATERIAL, "mesh": mesh}],
            "contact": [contact("roller", "floor", "outer"), contact("roller", "plate", "outer")]}


def wedge(friction: float = 0.3, slope: float = 0.2) -> dict:
    """A wedge is driven by 5 mm under a block that rests on it and leans against nothing but rollers."""
    return {"rigid": [FLOOR], "body": [
        {"name": "wedge", "material": MATERIAL, "clamp": [{"on": "left", "x": 0.005}], "mesh": {
            "shape": "quadrilateral", "corners": [[0, 0], [2, 0], [2, 0.4], [0, 0.4 + 2 * slope]],
            "divisions": [16, 6]}},
        {"name": "block", "material": MATERIAL, "clamp": [{"on": "right", "x": 0.0}],
         "traction": [{"on": "top", "value": [0.0, -1.0e6]}], "mesh": {
             "shape": "quadrilateral", "corners": [[0, 0.4 + 2 * slope], [2, 0.4], [2, 1.8], [0, 1.8]],
             "divisions": [16, 8]}}],
        "contact": [contact("wedge", "floor", "bottom"),
                    contact("block", "wedge", "bottom", "top", friction=coulomb(friction))]}


def pushed(push: float, law: dict | None, weight: float = 2.0e4) -> dict:
    """Two blocks on a floor, the upper one pushed at its side; the laws of both contacts are the same."""
    side = [{"on": "left", "value": [push, 0.0]}] if push else []
    friction = {"friction": law} if law else {}
    return {"rigid": [FLOOR], "body": [block("lower", 0.0, 0.0, 2.0, 0.5, volume_force=[0.0, -weight]),
                                       block("upper", 0.0, 0.5, 2.0, 0.5, volume_force=[0.0, -weight], traction=side)],
            "contact": [contact("lower", "floor", "bottom", **friction),
                        contact("upper", "lower", "bottom", "top", **friction)]}


def ring_in_bore(interference: float = 1e-4) -> dict:
    mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": [0.3, 0.5], "angles": [0, 360], "divisions": [96, 16]}
    return {"rigid": [{"name": "bore", "shape": "circle", "center": [0.0, 0.0], "radius": 0.5, "inside": True}],
            "body": [{"name": "ring", "material": MATERIAL, "mesh": mesh}],
            "contact": [contact("ring", "bore", "outer", friction=coulomb(0.2), gap=-interference)]}


def lap(approach: float = 1e-3) -> dict:
    """Three plates, the middle one soft, pressed between a floor and a press that comes down."""
    plates = [block(name, 0.0, 0.25 * k, 2.0, 0.25) | {"material": {"young": YOUNG / stiff, "poisson": POISSON}}
              for k, (name, stiff) in enumerate((("low", 1.0), ("soft", 10.0), ("high", 2.0)))]
    press = {"name": "press", "shape": "plane", "point": [0.0, 0.75], "normal": [0.0, -1.0],
             "displacement": [0.0, -approach]}
    return {"rigid": [FLOOR, press], "body": plates, "contact": [
        contact("low", "floor", "bottom"), contact("soft", "low", "bottom", "top"),
        contact("high", "soft", "bottom", "top"), contact("high", "press", "top")]}


def chain(pull: float = 1.0e6, kind: str = "bonded") -> dict:
    """Four bars in a row, held at the left end only, pulled at the right end."""
    bars = [block(f"bar{k}", float(k), 0.0, 1.0, 0.25) for k in range(4)]
    bars[0]["clamp"] = [{"on": "left", "x": 0.0}]
    bars[3]["traction"] = [{"on": "right", "value": [pull, 0.0]}]
    return {"body": bars, "contact": [contact(f"bar{k}", f"bar{k + 1}", "right", "left", kind=kind) for k in range(3)]}


def test_both_feet_bear_half_of_a_ring(comm):
    contacts = solve(comm, feet()).summary["contacts"]
    half = 2.0e4 * (1.5**2 - 1.0**2) * np.sin(np.pi / 32) * 32 / 4
    (fx, fy), (gx, gy) = contacts["left"]["force"], contacts["right"]["force"]
    assert (fy, gy) == pytest.approx((half, half), rel=1e-3)  # triangles are not symmetric
    assert fy + gy == pytest.approx(2 * half, rel=1e-6)
    assert fx == pytest.approx(-gx, rel=1e-6) and fx > 0.0  # the feet are kept from sliding outward


def test_two_bricks_bear_half_of_the_third(comm):
    contacts = solve(comm, brick_on_two()).summary["contacts"]
    half = (1.0e5 + 0.5 * 2.0e4) / 2
    for name in ("top-a", "top-b"):
        assert contacts[name]["force"][1] == pytest.approx(half, rel=0.01)  # triangles are not symmetric
    total = np.add(contacts["top-a"]["force"], contacts["top-b"]["force"])
    assert total == pytest.approx([0.0, 2 * half], rel=1e-6, abs=1e-6 * half)


def test_a_roller_has_the_pressure_of_hertz(comm):
    """p₀ = √(P E'/(π R)) at both plates, on 320 elements around; what one plate pushes the other one bears."""
    contacts = solve(comm, roller()).summary["contacts"]
    P = contacts["roller-floor"]["force"][1]
    assert contacts["roller-plate"]["force"][1] == pytest.approx(-P, rel=1e-6)
    for each in contacts.values():
        assert each["pressure_max"] == pytest.approx(np.sqrt(P * PLANE_MODULUS / (np.pi * 0.5)), rel=0.05)


@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_a_driven_wedge_pushes_at_the_angle_of_friction(comm, mu):
    contacts = solve(comm, wedge(mu)).summary["contacts"]
    x, y = contacts["block-wedge"]["force"]
    assert contacts["block-wedge"]["stick"] == 0
    assert y == pytest.approx(2.0e6, rel=1e-6)
    assert x / y == pytest.approx((mu + 0.2) / (1 - mu * 0.2), rel=1e-6)


@pytest.mark.clarabel
def test_a_stack_with_a_slip_bound(comm):
    """The bounds hold pushes up to bound × length; a larger push is refused."""
    bound = {"law": "tresca", "slip_bound": 2.0e4}
    contacts = solve(comm, pushed(6.0e4, bound)).summary["contacts"]
    for each in contacts.values():
        assert each["force"][0] == pytest.approx(-3.0e4, rel=1e-6)
    assert "no equilibrium" in solve(comm, pushed(9.0e4, bound), certified=False).reason


def test_a_frictionless_stack_stays_where_it_is(comm):
    """Sideways motions are undetermined, and named; the weights are borne, and nothing moves far."""
    answer = solve(comm, pushed(0.0, None))
    assert len(answer.summary["undetermined"]) == 2 and "move along x" in answer.summary["undetermined"][0]
    assert answer.summary["contacts"]["lower-floor"]["force"] == pytest.approx([0.0, 4.0e4], rel=1e-6, abs=1e-2)
    assert answer.summary["displacement_max"] < 1e-5


@two_ranks
@pytest.mark.parametrize("push, holds", [(0.49, True), (0.51, False)])
@pytest.mark.clarabel
def test_a_block_is_pushed_up_to_its_friction(comm, push, holds):
    """Friction holds 0.5 of the upper block's weight, 20 kN."""
    answer = solve(comm, pushed(push * 2.0e4 / 0.5, coulomb(0.5)), certified=holds)
    assert holds or "no equilibrium: upper would move along x" in answer.reason


def test_a_ring_in_a_rigid_bore(comm):
    """p = δ E'/(b ((b² + a²)/(b² − a²) − ν/(1 − ν))) on all nodes."""
    pressure = solve(comm, ring_in_bore()).contacts["ring-bore"].pressure
    a, b = 0.3, 0.5
    expected = 1e-4 * PLANE_MODULUS / (b * ((b**2 + a**2) / (b**2 - a**2) - POISSON / (1 - POISSON)))
    assert np.abs(pressure / expected - 1).max() < 0.01


def test_plates_in_a_press(comm):
    """p = δ / Σ H/E', each interface the same."""
    p = 1e-3 / (0.25 * (1 + 10 + 2) / PLANE_MODULUS)
    answer = solve(comm, lap())
    for state in answer.contacts.values():
        assert state.pressure == pytest.approx(np.full(len(state.pressure), p), rel=1e-6)


@two_ranks
@pytest.mark.clarabel
def test_a_chain_of_bars(comm):
    """Bonds bear the pull, and the end moves by σ L/E'; without bonds nothing holds the last bar."""
    answer = solve(comm, chain())
    for each in answer.summary["contacts"].values():
        assert each["normal_force"] == pytest.approx(-0.25e6, rel=1e-6)
    ends = [body.displacement[:, 0].max() for rank in comm.allgather(list(answer.bodies.values())) for body in rank]
    assert max(ends) == pytest.approx(4.0 * 1.0e6 / PLANE_MODULUS, rel=1e-6)
    assert "no equilibrium" in solve(comm, chain(kind="unilateral"), certified=False).reason
