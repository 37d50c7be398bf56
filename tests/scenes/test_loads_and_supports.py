"""Forces, supports along normals, heat and orthotropic materials in whole scenes, against closed forms and twins.

More closed forms are problems of the verification, which test_verification solves.
"""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI
from scenes import ROOT, certified, rectangle, seldom, solve_scene
from solid_scenes import box

ALONE = MPI.COMM_SELF


# Heat


# Clamps along normals


def wedge(d: int, angle: float, order: int, pairing: str, law: str = "coulomb") -> dict:
    """Two blocks on symmetry planes at the left and, in space, in front, the lower one at its bottom as well; pressed
    together and sheared. All of it is turned about z by an angle (degrees), symmetry planes by clamps along normals."""
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))

    def turn(x: float, y: float, *z: float) -> list[float]:
        return [c * x - s * y, s * x + c * y, *z]

    def block(name: str, bottom: float, top: float, divisions: list[int], **more) -> dict:
        corners = [(0.0, bottom), (2.0, bottom), (2.0, top), (0.0, top)]
        mesh = (
            {"shape": "quadrilateral", "corners": [turn(*at) for at in corners]}
            if d == 2
            else {
                "shape": "hexahedron",
                "corners": [turn(*at, z) for z in (0.0, 1.0) for at in corners],
            }
        )
        return {
            "name": name,
            "mesh": mesh | {"divisions": divisions, "order": order},
            "material": {"young": 2.1e11, "poisson": 0.3},
        } | more

    planes = [{"on": "left", "normal": 0.0}, *([{"on": "bottom", "normal": 0.0}] if d == 3 else [])]
    lower_top, upper_bottom, floor, top = (
        ("top", "bottom", "bottom", "top") if d == 2 else ("back", "front", "front", "back")
    )
    aside = [3e7, -1e8, 2e7][:d]
    fine = 1 if pairing == "nodes" else 2
    n = [4, 3, 2][:d]
    return {
        "body": [
            block("lower", 0.0, 1.0, n, clamp=[*planes, {"on": floor, "normal": 0.0}]),
            block(
                "upper",
                1.0,
                1.5,
                [n[0] * fine, *n[1:]],
                clamp=planes,
                traction=[
                    {"on": top, "value": turn(*aside)},
                    {"on": "right", "value": turn(*[5e6, 1e6, 0.0][:d])},
                ],
            ),
        ],
        "contact": [
            {
                "bodies": ["lower", "upper"],
                "on": [lower_top, upper_bottom],
                "pairing": pairing,
                "friction": {"law": law, "coefficient": 0.2} if law == "coulomb" else {"law": law},
            }
        ],
        "method": {"tolerance": 1e-11},
    }


@pytest.mark.parametrize(
    ("d", "order", "pairing"), [seldom(2, 2, "nodes"), (3, 1, "nodes"), seldom(3, 2, "mortar")]
)
def test_an_inclined_sector_is_its_turned_twin(d, order, pairing):
    """A scene on planes of symmetry at any angle has the answer of the scene along the axes, turned."""
    upright, inclined = (
        solve_scene(ALONE, wedge(d, angle, order, pairing)) for angle in (0.0, 33.0)
    )
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


@pytest.mark.parametrize("d", [2, seldom(3)])
def test_energy_balances_on_inclined_planes(d):
    """So it does where an inclined plane moves along its normal while a body is heated, both by histories."""
    scene = wedge(d, 33.0, 1, "nodes")
    scene["body"][0]["clamp"][-1] |= {"normal": -1e-4, "history": "up"}
    scene["body"][1]["material"] |= {"expansion": 1e-5}
    scene["body"][1] |= {"temperature": {"value": "30 + x", "history": "warm"}}
    scene |= {
        "time": {"points": [1.0, 2.0], "steps": 2},
        "history": {
            "up": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]},
            "warm": {"times": [0.0, 2.0], "factors": [0.0, 1.0]},
        },
    }
    answer = certified(scene)
    energy, bodies = answer.summary["energy"], answer.summary["bodies"]
    assert energy["residual"] <= 1e-10 and energy["dissipated"] > 0.0
    assert energy["strain_energy"] == pytest.approx(
        sum(each["energy"] for each in bodies.values()), rel=1e-9
    )


@pytest.mark.parametrize("free", ["heat", "clamp"])
def test_energies_of_what_strains_and_moves_freely_balance(free):
    """A plate that heats without constraint, or that its clamp carries along, stores rounding alone."""
    material = {"young": 2.1e11, "poisson": 0.3, "plane": "stress"}
    body = {"name": "plate", "mesh": {"shape": "rectangle", "size": [1, 1], "divisions": [4, 4]}}
    if free == "heat":
        body["material"] = material | {"expansion": 1e-5}
        body["temperature"] = {"value": 100.0, "history": "both"}
        body["clamp"] = [{"on": "left", "x": 0.0}, {"on": "bottom", "y": 0.0}]
    else:
        body["material"] = material
        body["clamp"] = [{"on": "left", "x": 1e-3, "y": 2e-3, "history": "both"}]
    scene = {
        "body": [body],
        "time": {"points": [1.0, 2.0]},
        "history": {"both": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
    }
    energy = certified(scene).summary["energy"]
    assert abs(energy["strain_energy"]) < 1e-6 and energy["residual"] <= 1e-9


@pytest.mark.slow
def test_an_accuracy_target_is_met_with_heat_and_inclined_planes():
    """Meshes are refined by the error of the thermal stress; a target that one mesh misses is met by finer ones."""
    scene = tomllib.loads((ROOT / "configs" / "heated_bush.toml").read_text(encoding="utf-8"))
    del scene["time"], scene["history"]
    for body in scene["body"]:
        body["temperature"] = 120.0
        body["mesh"] |= {"divisions": [8, 3], "order": 1}
    error = certified(scene | {"method": {"target_error": 0.1}}).summary["discretization_error"]
    assert error["energy_norm"] <= 0.1 < error["levels"][0]["error"]


# Clamps on all nodes


@pytest.mark.every(3)
@pytest.mark.parametrize("make", [rectangle, box])
@pytest.mark.parametrize("strain", [0.0, -1e-3])
def test_a_body_whose_nodes_are_all_clamped_is_like_a_rigid_one(make, strain):
    """What is pressed on it has the answer of a rigid plane; the clamps carry the force, whatever strains the body."""
    d = 2 if make is rectangle else 3
    up, away = "xyz"[d - 1], [0.0] * (d - 1)
    lower = make(
        "lower",
        [0.0] * d,
        [1.0] * d,
        [1] * d,
        clamp=[
            {"on": on, up: moved} | dict.fromkeys("xyz"[: d - 1], 0.0)
            for on, moved in (("bottom", strain), ("top", 0.0))
        ],
    )
    upper = make(
        "upper", [*away, 1.0], [1.0] * d, [1] * d, traction=[{"on": "top", "pressure": 1e3}]
    )
    contact = {
        "name": "c",
        "bodies": ["upper", "lower"],
        "on": ["bottom", "top"],
        "friction": {"law": "coulomb", "coefficient": 0.1},
    }
    plane = {"name": "lower", "shape": "plane", "point": [*away, 1.0], "normal": [*away, 1.0]}
    one = certified({"body": [upper, lower], "contact": [contact]})
    other = certified(
        {"body": [upper], "rigid": [plane], "contact": [contact | {"on": ["bottom"]}]}
    )
    assert one.contacts["c"].forces == pytest.approx(other.contacts["c"].forces, rel=1e-6, abs=1e-3)
    moved = {
        name: answer.bodies["upper"].displacement
        for name, answer in (("one", one), ("other", other))
    }
    assert moved["one"] == pytest.approx(moved["other"], rel=1e-5, abs=1e-12)
    found = one.summary["bodies"]["lower"]
    assert sum(each["force"][d - 1] for each in found["reactions"].values()) == pytest.approx(1e3)
    assert (found["von_mises_max"] > 0.0) == (strain != 0.0)
