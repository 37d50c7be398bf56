"""Forces, supports along normals, heat and orthotropic materials in whole scenes, against closed forms and twins.

More closed forms are problems of the verification, which test_verification solves.
"""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI
from scenes import COULOMB, ROOT, STEEL, certified, pinched_blocks, rectangle, solve_scene
from solid_scenes import box

ALONE = MPI.COMM_SELF


@pytest.mark.mpi(ranks=2)
def test_force_is_the_stress_times_the_area(comm):
    """A scene loaded by total forces has the answer of the same scene loaded by stresses, on two ranks."""
    stresses, forces = pinched_blocks(4), pinched_blocks(4)
    for body in forces["body"]:
        for load in body["traction"]:
            area = 3.0 if load["on"] in ("top", "bottom") else 1.0
            load["force"] = [area * each for each in load.pop("value")]
    one, other = (solve_scene(comm, scene) for scene in (stresses, forces))
    assert one["certified"] and other["certified"]
    assert other["normal_force"] == pytest.approx(one["normal_force"], rel=1e-9, abs=1e-3)
    assert abs(other["n_A"] - one["n_A"]) <= 4  # rounding may decide one more product of each body
    assert np.abs(one["normal_force"]).max() > 1e6


@pytest.mark.parametrize("on_the_left", [[], [{"on": "left", "x": 0.0}]], ids=["loose", "held"])
@pytest.mark.parametrize("d", [2, 3])
def test_a_body_whose_nodes_are_all_clamped_is_an_obstacle(d, on_the_left):
    """It has no unknowns and does not move, and what is pressed on it has its reaction."""
    make, unit, cells = (rectangle, (1.0, 1.0), (1, 1)) if d == 2 else (box, (1.0,) * 3, (1,) * 3)
    up = np.eye(d)[-1]
    scene = {"body": [make("lower", (0.0,) * d, unit, cells, clamp=["bottom", "top"]),
                      make("upper", up.tolist(), unit, cells, clamp=on_the_left,
                           traction=[{"on": "top", "value": (-1e6 * up).tolist()}])],
             "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": COULOMB}]}
    answer = certified(scene)
    force = answer.contacts["upper-lower"].force
    assert force[-1] == pytest.approx(1e6)
    assert answer.summary["bodies"]["lower"]["reaction"] == pytest.approx(force, abs=1e-3)
    scene["body"].append(make("alone", (9.0,) * d, unit, cells, clamp=["bottom", "top"]))  # without a contact
    assert certified(scene).contacts["upper-lower"].force == pytest.approx(force)
    assert answer.summary["bodies"]["lower"]["n"] == 0 and not answer.bodies["lower"].displacement.any()


# Heat


def rings() -> dict:
    """A loose ring that is heated in another whose rim is held."""
    def ring(name: str, radii: list[float], **more) -> dict:
        return {"name": name, "material": STEEL | {"expansion": 1.25e-5}, "mesh": {
            "shape": "annulus", "center": [0.0, 0.0], "radii": radii, "angles": [0.0, 360.0], "divisions": [36, 3]}
            } | more

    return {"body": [ring("inner", [0.6, 1.0], temperature=8.0), ring("outer", [1.0, 1.5], clamp=["outer"])],
            "contact": [{"bodies": ["inner", "outer"], "on": ["outer", "inner"],
                         "friction": {"law": "coulomb", "coefficient": 0.2}}], "method": {"tolerance": 1e-10}}


def heated_stack(n: int, order: int) -> dict:
    """Two blocks between walls on all sides; the lower one is heated, then the upper one pressed and moved."""
    def block(name: str, y: float, clamp: list, **more) -> dict:
        return rectangle(name, (0, y), (2, 1), (2 * n, n), order, clamp=clamp, **{"material": STEEL} | more)

    sides = [{"on": "left", "x": 0.0}, {"on": "right", "x": 0.0}]
    return {"body": [block("upper", 1.0, [{"on": "top", "x": 1e-3, "y": -2e-4, "history": "press"}]),
                     block("lower", 0.0, [*sides, {"on": "bottom", "x": 0.0, "y": 0.0}],
                           material=STEEL | {"expansion": 1.2e-5},
                           temperature={"value": "50 + 10*x", "history": "day"})],
            "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"],
                         "friction": {"law": "coulomb", "coefficient": 0.3}}],
            "history": {"day": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 1.0, 1.0, 0.3]},
                        "press": {"times": [0.0, 1.0, 2.0], "factors": [0.2, 0.3, 1.0]}},
            "time": {"points": [1.0, 2.0, 3.0], "steps": 2}, "method": {"tolerance": 1e-10}}


@pytest.mark.parametrize("order", [1, 2])
def test_energy_balances_while_temperatures_change(order):
    """Work of supports and heat is strain energy, less what friction takes; strain energy is that of the stresses."""
    answer = certified(heated_stack(3, order))
    energy, bodies = answer.summary["energy"], answer.summary["bodies"]
    assert energy["residual"] <= 1e-9
    assert energy["external_work"] == pytest.approx(energy["strain_energy"] + energy["interface_work"], rel=1e-9)
    assert energy["dissipated"] > 0.01 * energy["strain_energy"]
    assert energy["strain_energy"] == pytest.approx(sum(each["energy"] for each in bodies.values()), rel=1e-9)


# Clamps along normals


def wedge(d: int, angle: float, order: int, pairing: str, law: str = "coulomb") -> dict:
    """Two blocks on symmetry planes at the left and, in space, in front, the lower one at its bottom as well; pressed
    together and sheared. All of it is turned about z by an angle (degrees), symmetry planes by clamps along normals."""
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))

    def turn(x: float, y: float, *z: float) -> list[float]:
        return [c * x - s * y, s * x + c * y, *z]

    def block(name: str, bottom: float, top: float, divisions: list[int], **more) -> dict:
        corners = [(0.0, bottom), (2.0, bottom), (2.0, top), (0.0, top)]
        mesh = {"shape": "quadrilateral", "corners": [turn(*at) for at in corners]} if d == 2 else {
            "shape": "hexahedron", "corners": [turn(*at, z) for z in (0.0, 1.0) for at in corners]}
        return {"name": name, "mesh": mesh | {"divisions": divisions, "order": order},
                "material": {"young": 2.1e11, "poisson": 0.3}} | more

    planes = [{"on": "left", "normal": 0.0}, *([{"on": "bottom", "normal": 0.0}] if d == 3 else [])]
    lower_top, upper_bottom, floor, top = ("top", "bottom", "bottom", "top") if d == 2 else (
        "back", "front", "front", "back")
    aside = [3e7, -1e8, 2e7][:d]
    fine = 1 if pairing == "nodes" else 2
    n = [4, 3, 2][:d]
    return {"body": [block("lower", 0.0, 1.0, n, clamp=[*planes, {"on": floor, "normal": 0.0}]),
                     block("upper", 1.0, 1.5, [n[0] * fine, *n[1:]], clamp=planes,
                           traction=[{"on": top, "value": turn(*aside)}, {"on": "right", "value": turn(
                               *[5e6, 1e6, 0.0][:d])}])],
            "contact": [{"bodies": ["lower", "upper"], "on": [lower_top, upper_bottom], "pairing": pairing,
                         "friction": {"law": law, "coefficient": 0.2} if law == "coulomb" else {"law": law}}],
            "method": {"tolerance": 1e-11}}


@pytest.mark.parametrize(("d", "order", "pairing"), [(2, 1, "nodes"), (2, 2, "nodes"), (3, 1, "nodes"),
                                                     (3, 1, "mortar"), (3, 2, "mortar")])
def test_an_inclined_sector_is_its_turned_twin(d, order, pairing):
    """A scene on planes of symmetry at any angle has the answer of the scene along the axes, turned."""
    upright, inclined = (solve_scene(ALONE, wedge(d, angle, order, pairing)) for angle in (0.0, 33.0))
    assert upright["certified"] and inclined["certified"]
    assert upright["n"] == inclined["n"] and upright["m"] == inclined["m"]
    size = np.abs(upright["normal_force"]).max()
    assert np.abs(inclined["normal_force"] - upright["normal_force"]).max() <= 1e-9 * size > 0.0
    assert inclined["status"] == upright["status"] and {"slip", "stick"} & set(upright["status"])
    c, s = np.cos(np.deg2rad(33.0)), np.sin(np.deg2rad(33.0))
    R = np.eye(d)
    R[:2, :2] = [[c, -s], [s, c]]
    for name, (_, u) in upright["body"].items():
        assert np.abs(inclined["body"][name][1] - u @ R.T).max() <= 1e-9 * np.abs(u).max()
    assert inclined["energy"] == pytest.approx(upright["energy"], rel=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_energy_balances_on_inclined_planes(d):
    """So it does where an inclined plane moves along its normal while a body is heated, both by histories."""
    scene = wedge(d, 33.0, 1, "nodes")
    scene["body"][0]["clamp"][-1] |= {"normal": -1e-4, "history": "up"}
    scene["body"][1]["material"] |= {"expansion": 1e-5}
    scene["body"][1] |= {"temperature": {"value": "30 + x", "history": "warm"}}
    scene |= {"time": {"points": [1.0, 2.0], "steps": 2},
              "history": {"up": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]},
                          "warm": {"times": [0.0, 2.0], "factors": [0.0, 1.0]}}}
    answer = certified(scene)
    energy, bodies = answer.summary["energy"], answer.summary["bodies"]
    assert energy["residual"] <= 1e-10 and energy["dissipated"] > 0.0
    assert energy["strain_energy"] == pytest.approx(sum(each["energy"] for each in bodies.values()), rel=1e-9)


def test_an_accuracy_target_is_met_with_heat_and_inclined_planes():
    """Meshes are refined by the error of the thermal stress; a target that one mesh misses is met by finer ones."""
    scene = tomllib.loads((ROOT / "configs" / "heated_bush.toml").read_text(encoding="utf-8"))
    del scene["time"], scene["history"]
    for body in scene["body"]:
        body["temperature"] = 120.0
        body["mesh"] |= {"divisions": [8, 3], "order": 1}
    error = certified(scene | {"method": {"target_error": 0.1}}).summary["discretization_error"]
    assert error["energy_norm"] <= 0.1 < error["levels"][0]["error"]


# Orthotropic materials

PLY = {"young": [1.4e11, 1.0e10, 2.0e10], "poisson": [0.3, 0.25, 0.4]}


def plies() -> dict:
    """Two plies of fibres at 30° with free sides, pressed by a millimetre."""
    material = PLY | {"shear": 5e9, "angle": 30.0, "plane": "stress"}
    return {"body": [rectangle("upper", (0, 1), (2, 1), (4, 2), 2, material=material,
                               clamp=[{"on": "top", "normal": -1e-3}]),
                     rectangle("lower", (0, 0), (2, 1), (6, 2), 2, material=material,
                               clamp=[{"on": "bottom", "normal": 0.0}])],
            "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"],
                         "friction": {"law": "coulomb", "coefficient": 0.3}}], "method": {"tolerance": 1e-10}}


def orthotropic_solids(order: int) -> dict:
    """Two orthotropic boxes with free sides, pressed along axis 2 by a millimetre."""
    def block(name: str, y: float, clamp: dict) -> dict:
        return box(name, (0, y, 0), (1, 1, 1), (2, 2, 2), order, clamp=[clamp],
                   material=PLY | {"shear": [5e9, 7e9, 3e9]})

    return {"body": [block("upper", 1.0, {"on": "back", "normal": -1e-3}),
                     block("lower", 0.0, {"on": "front", "normal": 0.0})],
            "contact": [{"bodies": ["upper", "lower"], "on": ["front", "back"],
                         "friction": {"law": "coulomb", "coefficient": 0.3}}], "method": {"tolerance": 1e-10}}


@pytest.mark.parametrize("order", [1, 2])
def test_orthotropic_solids_are_pressed_together(order):
    """p = δ E2 / Σ H."""
    found = solve_scene(ALONE, orthotropic_solids(order))
    assert found["certified"]
    assert found["normal_force"] / found["length"] == pytest.approx(1e-3 / 2.0 * PLY["young"][1], rel=1e-8)


# Clamps on all nodes


@pytest.mark.parametrize("make", [rectangle, box])
@pytest.mark.parametrize("strain", [0.0, -1e-3])
def test_a_body_whose_nodes_are_all_clamped_is_like_a_rigid_one(make, strain):
    """What is pressed on it has the answer of a rigid plane; the clamps carry the force, whatever strains the body."""
    d = 2 if make is rectangle else 3
    up, away = "xyz"[d - 1], [0.0] * (d - 1)
    lower = make("lower", [0.0] * d, [1.0] * d, [1] * d, clamp=[
        {"on": on, up: moved} | dict.fromkeys("xyz"[:d - 1], 0.0) for on, moved in (("bottom", strain), ("top", 0.0))])
    upper = make("upper", [*away, 1.0], [1.0] * d, [1] * d, traction=[{"on": "top", "pressure": 1e3}])
    contact = {"name": "c", "bodies": ["upper", "lower"], "on": ["bottom", "top"],
               "friction": {"law": "coulomb", "coefficient": 0.1}}
    plane = {"name": "lower", "shape": "plane", "point": [*away, 1.0], "normal": [*away, 1.0]}
    one = certified({"body": [upper, lower], "contact": [contact]})
    other = certified({"body": [upper], "rigid": [plane], "contact": [contact | {"on": ["bottom"]}]})
    assert one.contacts["c"].forces == pytest.approx(other.contacts["c"].forces, rel=1e-6, abs=1e-3)
    moved = {name: answer.bodies["upper"].displacement for name, answer in (("one", one), ("other", other))}
    assert moved["one"] == pytest.approx(moved["other"], rel=1e-5, abs=1e-12)
    found = one.summary["bodies"]["lower"]
    assert sum(each["force"][d - 1] for each in found["reactions"].values()) == pytest.approx(1e3)
    assert (found["von_mises_max"] > 0.0) == (strain != 0.0)


# Ranks

SCENES = {"heat": rings, "planes": lambda: wedge(2, 33.0, 2, "mortar"),
          "planes in space": lambda: wedge(3, 33.0, 1, "nodes"), "plies": plies,
          "orthotropic solids": lambda: orthotropic_solids(1)}


@pytest.mark.mpi(ranks=2)
def test_two_ranks(comm):
    """On a rank each, bodies have the answer that they have on one rank."""
    for name, scene in SCENES.items():
        one, other = (solve_scene(each, scene()) for each in (ALONE, comm))
        assert one["certified"] and other["certified"], name
        assert other["status"] == one["status"], name
        size = np.abs(one["normal_force"]).max()
        for force in ("normal_force", "tangential_force"):
            assert np.abs(other[force] - one[force]).max() <= 1e-9 * size, name
