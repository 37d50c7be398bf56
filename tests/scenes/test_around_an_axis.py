"""Scenes around an axis: elsewhere and on several ranks, all methods and laws, load steps, files, words."""

import copy
import csv
import json

import numpy as np
import pytest
from mpi4py import MPI
from scenes import COULOMB, FLOOR, certified, rectangle, run_command, to_toml
from scipy.spatial import cKDTree

import ddmpi
from ddmpi.run.answer import Answer

pytestmark = pytest.mark.slow

SAME = 1e-9
TIGHT = {"method": {"tolerance": 1e-12}}


def disc(name: str, y: float, divisions: tuple[int, int], order: int = 1, inner: float = 0.0, **more) -> dict:
    """A disc 1 m high from the radius `inner` to 2 m, with its bottom at y."""
    return rectangle(name, (inner, y), (2.0 - inner, 1.0), divisions, order, **more)


def pressed(order: int = 1, matching: bool = False, law: dict | None = None, loose: bool = False, inner: float = 0.0,
            **contact) -> dict:
    """Two discs of unlike stiffness, the upper one pressed at its rim; the lower one held, or loose on a floor."""
    lower = {} if loose else {"clamp": ["bottom"]}
    scene = {"axisymmetric": True, "body": [
        disc("upper", 1.0, (6, 3), order, inner, traction=[{"on": "top", "pressure": "1e6 * x"}]),
        disc("lower", 0.0, (6, 3) if matching else (7, 4), order, inner, **lower)]}
    scene["body"][1]["material"] = {"young": 3e9, "poisson": 0.2}
    scene["contact"] = [{"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": law or COULOMB} | contact]
    if loose:
        scene["rigid"] = [FLOOR]
        scene["contact"].append({"bodies": ["lower", "floor"], "on": ["bottom"], "friction": COULOMB})
    return scene


def on_cone(order: int = 2) -> dict:
    """A ring that is pushed onto a rigid cone."""
    return {"axisymmetric": True, "body": [{
        "name": "ring", "material": {"young": 1e9, "poisson": 0.3},
        "mesh": {"shape": "quadrilateral", "corners": [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.6, 1.0]],
                 "divisions": [5, 5], "order": order}, "traction": [{"on": "top", "pressure": 1e6}]}],
        "rigid": [{"name": "cone", "shape": "plane", "point": [1.0, 0.0], "normal": [1.0, 0.4]}],
        "contact": [{"bodies": ["ring", "cone"], "on": ["left"], "friction": COULOMB}]}


SCENES = {"pairs": lambda: pressed(matching=True), "pairs of order 2": lambda: pressed(2, matching=True),
          "mortar": pressed, "mortar of order 2": lambda: pressed(2),
          "Tresca": lambda: pressed(law={"law": "tresca", "slip_bound": 1e5}),
          "no friction": lambda: pressed(2, law={"law": "none"}),
          "bonded": lambda: pressed(2, kind="bonded", law={"law": "none"}),
          "loose": lambda: pressed(loose=True), "loose, order 2": lambda: pressed(2, loose=True),
          "rings": lambda: pressed(2, inner=0.7, loose=True), "cone": on_cone}


def moved(scene: dict, up: float = 0.0, length: float = 1.0, stress: float = 1.0) -> dict:
    """The scene `up` along the axis, in units of `length` m and `stress` Pa."""
    scene = copy.deepcopy(scene)
    for body in scene["body"]:
        mesh = body["mesh"]
        if "corners" in mesh:
            mesh["corners"] = [[x / length, (y + up) / length] for x, y in mesh["corners"]]
        else:
            mesh["origin"] = [mesh["origin"][0] / length, (mesh["origin"][1] + up) / length]
            mesh["size"] = [each / length for each in mesh["size"]]
        body["material"]["young"] /= stress
        for each in body.get("traction", []):
            each["pressure"] = f"({each['pressure']}) / {stress}".replace("x", f"{length} * x")
    for rigid in scene.get("rigid", []):
        rigid["point"] = [rigid["point"][0] / length, (rigid["point"][1] + up) / length]
    for contact in scene["contact"]:
        if "slip_bound" in contact["friction"]:
            contact["friction"]["slip_bound"] /= stress
    return scene


def compare(one: Answer, other: Answer, up: float = 0.0, length: float = 1.0, stress: float = 1.0) -> None:
    """The second answer is the first one, `up` along the axis and in other units."""
    largest = one.summary["displacement_max"]
    for name, body in other.bodies.items():
        far, node = cKDTree(one.bodies[name].points).query(body.points * length - [0.0, up])
        assert far.max() < 1e-9
        assert np.abs(body.displacement * length - one.bodies[name].displacement[node]).max() <= SAME * largest
    for name, contact in one.summary["contacts"].items():
        found = other.summary["contacts"][name]
        assert [found[key] for key in ("open", "slip", "stick")] == [contact[key] for key in ("open", "slip", "stick")]
        size = np.abs(contact["force"]).max()
        assert np.array(found["force"]) * stress * length**2 == pytest.approx(contact["force"], abs=SAME * size)


@pytest.mark.parametrize("name", SCENES)
def test_elsewhere(name):
    """Along the axis, in mm and MPa, and with bodies and contacts in another order, scenes have the same answers."""
    scene = SCENES[name]() | TIGHT
    one = certified(scene)
    compare(one, certified(moved(scene, up=-3.0)), up=-3.0)
    compare(one, certified(moved(scene, length=1e-3, stress=1e6)), length=1e-3, stress=1e6)
    compare(one, certified(scene | {"body": scene["body"][::-1], "contact": scene["contact"][::-1]}))


@pytest.mark.mpi(ranks=3)
@pytest.mark.parametrize("name", ["mortar", "loose, order 2", "cone"])
def test_three_ranks(comm, name):
    """On more ranks than bodies the answer is that of one rank."""
    scene = SCENES[name]() | TIGHT
    compare(certified(scene), certified(scene, comm))


@pytest.mark.parametrize("compliance", ["explicit", "direct", "iterative"])
@pytest.mark.parametrize("name", ["mortar of order 2", "loose"])
def test_compliances(name, compliance):
    """The compliance by any means; multigrid has the motions that cost little energy."""
    scene = SCENES[name]()
    one, other = certified(scene | TIGHT), certified(scene | {"method": {"tolerance": 1e-10, "compliance": compliance}})
    largest = one.summary["displacement_max"]
    for body, found in other.bodies.items():
        assert np.abs(found.displacement - one.bodies[body].displacement).max() <= 1e-6 * largest


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("name", ["pairs", "pairs of order 2", "mortar of order 2", "Tresca", "no friction"])
def test_published_iteration(comm, name):
    """The published iteration and its Anderson form find what Newton's method finds."""
    scene = SCENES[name]()
    scene["body"][0]["clamp"] = [{"on": "top", "y": -1e-3, "x": 0.0}]
    one = certified(scene | TIGHT)
    for method in ({"outer": "relaxation", "theta": 0.2}, {"outer": "anderson"}):
        other = certified(scene | {"method": method | {"tolerance": 1e-8}}, comm)
        force = one.summary["contacts"]["upper-lower"]["force"]
        assert other.summary["contacts"]["upper-lower"]["force"] == pytest.approx(force, rel=1e-4)


def test_a_fit_by_heat_is_one_by_interference():
    """A shaft that is warmer than its hub presses as one that is too thick, at free ends; it grows along the axis."""
    steel = {"young": 2e11, "poisson": 0.3, "expansion": 1.2e-5}
    scene = {"axisymmetric": True, "body": [
        rectangle(name, (x, 0), (0.05, 0.05), (5, 5), 2, clamp=[{"on": "bottom", "y": 0.0}], material=steel)
        for name, x in (("shaft", 0.0), ("hub", 0.05))],
        "contact": [{"bodies": ["shaft", "hub"], "on": ["right", "left"], "pairing": "nodes"}]} | TIGHT
    scene["body"][0]["temperature"] = 50.0
    warm = certified(scene)
    del scene["body"][0]["temperature"]
    scene["body"][0]["material"] = scene["body"][1]["material"] = {"young": 2e11, "poisson": 0.3}
    scene["contact"][0]["gap"] = -1.2e-5 * 50.0 * 0.05
    thick = certified(scene)
    one, other = (each.contacts["shaft-hub"].pressure for each in (warm, thick))
    assert one == pytest.approx(other, rel=1e-9)
    exact = 3e-5 * 2e11 / 2 / 0.05 * (1.0 - 0.05**2 / 0.1**2)
    assert one.mean() == pytest.approx(exact, rel=2e-3)


def test_clamping_the_axis_is_needless():
    """With and without a clamp at x = 0 the answer is the same, to the last bit, and that clamp bears nothing."""
    scene = pressed(2)
    one = certified(scene)
    scene["body"][0]["clamp"] = [{"on": "left", "x": 0.0}]
    other = certified(scene)
    assert np.array_equal(one.bodies["upper"].displacement, other.bodies["upper"].displacement)
    assert other.summary["bodies"]["upper"]["reactions"]["left"]["force"] == [0.0, 0.0]


def test_a_clamp_along_the_normal_is_a_cone_without_friction():
    """A ring that slides on a cone by a clamp along the normal moves as on a rigid cone that it is pressed onto."""
    scene = on_cone() | TIGHT
    scene["contact"][0]["friction"] = {"law": "none"}
    one = certified(scene)
    assert one.summary["contacts"]["ring-cone"]["open"] == 0
    scene["body"][0]["clamp"] = [{"on": "left", "normal": 0.0}]
    scene["rigid"], scene["body"] = [], [*scene["body"], disc("other", 5.0, (2, 2), 2, 3.0, clamp=["bottom"])]
    scene["body"][1]["mesh"] |= {"origin": [3.0, 5.0], "size": [1.0, 1.0]}
    scene["body"].append(disc("third", 6.0, (2, 2), 2, 3.0))
    scene["body"][2]["mesh"] |= {"origin": [3.0, 6.0], "size": [1.0, 1.0]}
    scene["contact"] = [{"bodies": ["other", "third"], "on": ["top", "bottom"], "kind": "bonded"}]
    other = certified(scene)
    found = other.bodies["ring"].displacement
    assert found == pytest.approx(one.bodies["ring"].displacement, abs=1e-9 * np.abs(found).max())
    reaction = other.summary["bodies"]["ring"]["reactions"]["left"]["force"]
    assert reaction == pytest.approx(one.summary["contacts"]["ring-cone"]["force"], rel=1e-8)
    assert other.summary["bodies"]["ring"]["reaction"] == pytest.approx(reaction)


def test_load_steps_keep_the_energy():
    """A shaft with interference is pushed through a hub: all friction acts, and the energy balance closes."""
    scene = {"axisymmetric": True, "body": [
        rectangle("shaft", (0, -0.02), (0.05, 0.09), (5, 9), 2, young=2e11,
                  clamp=[{"on": "top", "y": -2e-4, "history": "push"}]),
        rectangle("hub", (0.05, 0), (0.05, 0.05), (5, 6), 2, young=2e11, clamp=[{"on": "bottom", "y": 0.0}])],
        "contact": [{"bodies": ["shaft", "hub"], "on": ["right", "left"], "gap": -5e-5,
                     "friction": {"law": "coulomb", "coefficient": 0.2}}],
        "history": {"push": {"times": [1.0, 2.0], "factors": [0.0, 1.0]}}, "time": {"points": [1.0, 2.0], "steps": 4}}
    answer = certified(scene)
    contact = answer.summary["contacts"]["shaft-hub"]
    assert contact["stick"] == 0 and contact["slip"] > 5
    assert abs(contact["force"][1]) == pytest.approx(0.2 * contact["normal_force"], rel=1e-6)
    assert answer.summary["bodies"]["hub"]["reactions"]["bottom"]["force"] == pytest.approx(
        [0.0, contact["force"][1]], abs=1e-6 * contact["normal_force"])
    assert answer.summary["bodies"]["hub"]["reaction"][0] == pytest.approx(0.0, abs=1e-9 * contact["normal_force"])
    assert abs(answer.summary["energy"]["residual"]) < 1e-9 * answer.summary["energy"]["external_work"]
    assert contact["dissipated"] > 0.0


def test_target_error_refines_the_meshes():
    """An accuracy target is met by meshes that stay around the axis."""
    scene = pressed(2, law={"law": "none"}) | {"method": {"target_error": 0.003}}
    scene["body"][1]["clamp"] = [{"on": "bottom", "y": 0.0}]
    answer = certified(scene)
    assert answer.summary["discretization_error"]["energy_norm"] <= 0.003
    assert len(answer.summary["discretization_error"]["levels"]) > 1
    assert answer.summary["contacts"]["upper-lower"]["normal_force"] == pytest.approx(2 * np.pi * 8 / 3 * 1e6)


def test_the_turned_sphere_is_the_solid_one(tmp_path):
    """Hertz's ball around an axis and as a quarter of a solid agree to 2 % in force, pressure and radius."""
    from problems import around_axis, solids

    solid = solids.hertz_solid(3, 2, tmp_path)
    mesh = around_axis.half_ball(tmp_path / "turned.msh", 0.088, 6, 2)
    answer = around_axis.turned([around_axis.body("ball", mesh, 1.0, 0.3, [{"on": "top", "y": -0.0075}])],
                                [around_axis.contact("ball", "floor", "contact")], around_axis.plane())
    state = answer.contacts["ball-floor"]
    values, _ = around_axis.hertz_values(state, 1.0 / 0.91, 1.0, 1.0)
    of_solid = solid.answer.contacts["ball-floor"]
    assert state.normal_force.sum() == pytest.approx(4 * of_solid.normal_force.sum(), rel=0.02)
    for key, value in values.items():
        assert value.computed == pytest.approx(solid.values[key].computed, rel=0.02 if key.startswith("a") else 0.04)


@pytest.mark.clarabel
def test_what_slides_along_the_axis_is_named():
    """A sleeve without friction on a shaft can move along y; a load along y then has no equilibrium."""
    scene = pressed(inner=0.5)
    scene["body"] = [disc("shaft", 0.0, (4, 4)), disc("sleeve", 0.0, (4, 4), inner=2.0)]
    scene["body"][0]["clamp"] = ["bottom"]
    scene["body"][1]["mesh"] |= {"origin": [2.0, 0.0], "size": [1.0, 1.0]}
    scene["contact"] = [{"bodies": ["shaft", "sleeve"], "on": ["right", "left"], "gap": -1e-4}]
    answer = certified(scene)
    assert answer.summary["undetermined"] == ["sleeve can move along y without any force"]
    scene["body"][1]["volume_force"] = [0.0, -1e3]
    failed = ddmpi.solve(scene, MPI.COMM_SELF)
    assert failed.reason == "no equilibrium: sleeve would move along -y"


@pytest.mark.parametrize("partner", [(24, 4), (19, 4), None], ids=["pairs", "mortar", "rigid"])
def test_rows_on_the_axis_are_merged(partner):
    """On arcs of order 2, where nodes on the axis have next to no area, they have the rows of the next nodes; the
    pressure between balls is constant up to the poles."""
    def shell(name, radii, divisions):
        return {"name": name, "material": {"young": 1e9, "poisson": 0.3}, "mesh": {
            "shape": "annulus", "center": [0.0, 0.0], "radii": radii, "angles": [-90, 90], "divisions": list(divisions),
            "order": 2}}

    scene = {"axisymmetric": True, "body": [shell("ball", [1.0, 2.0], (24, 4))]} | TIGHT
    contact = {"bodies": ["ball", "shell"], "on": ["outer", "inner"], "gap": -1e-4}
    if partner:
        scene["body"].append(shell("shell", [2.0, 3.0], partner))
    else:
        contact = {"bodies": ["ball", "shell"], "on": ["outer"], "gap": -1e-4}
        scene["rigid"] = [{"name": "shell", "shape": "circle", "center": [0.0, 0.0], "radius": 2.0, "inside": True}]
    scene["contact"] = [contact]
    state = certified(scene).contacts["ball-shell"]
    lines = state.interface.lines
    ends = np.flatnonzero(lines.xy[:, 0] == 0.0)
    assert len(ends) == 2 and len(lines.row) == state.interface.m + 2
    assert (np.bincount(lines.row)[lines.row[ends]] == 2).all()
    assert state.pressure[lines.row[ends]] == pytest.approx(state.pressure.mean(), rel=0.02)


@pytest.mark.parametrize("length", [1.0, 0.3, 1e-3, 1e3, 1e9])
def test_a_row_that_half_moves_is_kept_in_all_units(length):
    """The slave's node on the axis faces one that is held there and, half as far as its neighbour, one that is not."""
    scene = pressed(pairing="mortar", slave="lower")
    scene["body"][0]["mesh"]["divisions"], scene["body"][1]["mesh"]["divisions"] = [4, 2], [2, 1]
    assert certified(moved(scene, length=length)).summary["contacts"]["upper-lower"]["m"] == 3


@pytest.mark.parametrize("seed", range(12))
def test_random_scenes(seed):
    """Stacks of discs and rings of any stiffness, mesh and law, held or loose, are certified in any order of bodies,
    and obey all laws."""
    rng = np.random.default_rng(seed)
    order, number, scene = int(rng.integers(1, 3)), int(rng.integers(2, 5)), {"axisymmetric": True} | TIGHT
    laws = [{"law": "coulomb", "coefficient": 0.4}, {"law": "none"}, {"law": "tresca", "slip_bound": 1e5}]
    scene["body"] = [disc(f"b{k}", float(k), tuple(rng.integers(2, 8, 2).tolist()), order,
                          float(rng.choice([0.0, 0.4, 0.8]))) for k in range(number)]
    for body in scene["body"]:
        body["material"] = {"young": 1e9 * 10 ** rng.uniform(-1.5, 1.5), "poisson": rng.uniform(0.0, 0.45)}
    scene["body"][-1]["traction"] = [{"on": "top", "pressure": f"1e6 * (1 + {rng.uniform(-0.3, 0.5)} * x)"}]
    scene["contact"] = [{"bodies": [f"b{k}", f"b{k + 1}"], "on": ["top", "bottom"], "friction": laws[rng.integers(3)]}
                        for k in range(number - 1)]
    if rng.random() < 0.5:
        scene["body"][0]["clamp"] = ["bottom"]
    else:
        scene["rigid"] = [FLOOR]
        scene["contact"].append({"bodies": ["b0", "floor"], "on": ["bottom"], "friction": laws[rng.integers(3)]})
    answer = certified(scene)
    compare(answer, certified(scene | {"body": scene["body"][::-1], "contact": scene["contact"][::-1]}))
    load = answer.summary["bodies"][f"b{number - 1}"]["loads"]["top"]["force"][1]
    for contact in answer.summary["contacts"].values():
        sign = 1.0 if contact["force"][1] > 0.0 else -1.0
        assert contact["force"][1] == pytest.approx(-sign * load, rel=1e-8)
    for state in answer.contacts.values():
        normal, bound = state.normal_force, state.interface.law.bound_at(np.zeros(state.interface.size))
        assert normal.min() >= -1e-9 * abs(load) and state.gap.min() >= -1e-9
        assert (normal * state.gap).max() <= 1e-9 * abs(load)
        if state.interface.law.name == "coulomb":
            bound = 0.4 * normal[state.interface.sliding]
        if len(bound):
            assert (np.abs(state.tangential_force[state.interface.sliding, 0]) <= bound + 1e-9 * abs(load)).all()


def test_files(tmp_path):
    """Areas stand in the place of lengths, forces are in newtons, moments are zero, and pictures show the axis."""
    scene = pressed(2, loose=True) | {"output": {"mirrored": True}}
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene), encoding="utf-8")
    child = run_command(path, tmp_path / "out", ranks=2)
    assert child.code == 0, child.output
    assert "N on upper" in child.output and "N/m" not in child.output
    with open(tmp_path / "out" / "contact_upper-lower.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:5] == ["x", "y", "nx", "ny", "area"]
    assert sum(float(row["area"]) for row in rows) == pytest.approx(4 * np.pi)
    assert rows[0]["x"] == "0.0" and float(rows[0]["area"]) == pytest.approx(0.0, abs=1e-12)
    assert rows[0]["normal_stress"] == rows[1]["normal_stress"]  # merged
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["units"]["force"] == "N" and summary["units"]["energy"] == "J"
    force = 2 * np.pi * 8 / 3 * 1e6
    for contact in summary["contacts"].values():
        assert contact["normal_force"] == pytest.approx(force) and contact["moment"] == 0.0
    assert summary["bodies"]["upper"]["loads"]["top"]["force"] == pytest.approx([0.0, -force], abs=1e-6 * force)
    assert (tmp_path / "out" / "bodies.png").stat().st_size > 10_000
    again = ddmpi.solve(summary["scene"] | {"output": {"figures": False}}, MPI.COMM_SELF)
    assert again.summary["contacts"]["upper-lower"]["force"][1] == pytest.approx(force)
