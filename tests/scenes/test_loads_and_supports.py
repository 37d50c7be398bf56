"""Forces, supports along normals, heat and orthotropic materials in whole scenes, against closed forms and twins."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import pinched_blocks, solve_scene, to_toml

import ddmpi

COMM = MPI.COMM_WORLD


@pytest.mark.mpi(ranks=2)
def test_force_is_the_stress_times_the_area():
    """A scene loaded by total forces has the answer of the same scene loaded by stresses, on two ranks."""
    stresses, forces = pinched_blocks(4), pinched_blocks(4)
    for body in forces["body"]:
        for load in body["traction"]:
            area = 3.0 if load["on"] in ("top", "bottom") else 1.0
            load["force"] = [area * each for each in load.pop("value")]
    one, other = (solve_scene(COMM, scene) for scene in (stresses, forces))
    assert one["certified"] and other["certified"]
    assert other["normal_force"] == pytest.approx(one["normal_force"], rel=1e-9, abs=1e-3)
    assert other["n_A"] == one["n_A"]
    assert np.abs(one["normal_force"]).max() > 1e6


# Heat


def rings(order: int, heat: float | None, plane: str) -> dict:
    """A loose ring in another whose rim is held; the inner one is heated, or 1.3e-4 of its radius too large."""
    def ring(name: str, radii: tuple[float, float], expansion: dict, **more) -> dict:
        return {"name": name, "material": {"young": 2.1e11, "poisson": 0.3, "plane": plane} | expansion,
                "mesh": {"shape": "annulus", "center": [0.0, 0.0], "radii": list(radii), "angles": [0.0, 360.0],
                         "divisions": [36, 3], "order": order}} | more

    inner = ring("inner", (0.6, 1.0), {"expansion": 1.25e-5}, temperature=heat) if heat else ring(
        "inner", (0.6, 1.0), {})
    return {"body": [inner, ring("outer", (1.0, 1.5), {}, clamp=["outer"])],
            "contact": [{"bodies": ["inner", "outer"], "on": ["outer", "inner"],
                         "friction": {"law": "coulomb", "coefficient": 0.2}} | ({} if heat else {"gap": -1.3e-4})],
            "method": {"tolerance": 1e-10}}


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("plane", "heat"), [("strain", 8.0), ("stress", 10.4)])
def test_shrink_fit_by_heat_is_that_by_interference(order, plane, heat):
    """A shaft that is heated presses as one that is too large by (1 + ν) α T r, in plane stress by α T r."""
    heated, large = (solve_scene(COMM, rings(order, each, plane)) for each in (heat, None))
    assert heated["certified"] and large["certified"]
    assert heated["normal_force"] == pytest.approx(large["normal_force"], rel=1e-8)
    E, nu = (2.1e11 / (1 - 0.3**2), 0.3 / 0.7) if plane == "strain" else (2.1e11, 0.3)
    a, c = 0.6, 1.5
    exact = 1.3e-4 * E / ((c**2 - 1) * (1 - nu**2) / (1 + nu + (1 - nu) * c**2) + (1 + a**2) / (1 - a**2) - nu)
    assert heated["normal_force"].sum() / heated["length"].sum() == pytest.approx(exact, rel=0.02 / order**4)


def heated_stack(n: int, order: int) -> dict:
    """Two blocks between walls on all sides; the lower one is heated, then the upper one pressed and moved."""
    def block(name: str, y: float, clamp: list, **more) -> dict:
        return {"name": name, "clamp": clamp, "material": {"young": 2.1e11, "poisson": 0.3} | more.pop("material", {}),
                "mesh": {"shape": "rectangle", "origin": [0.0, y], "size": [2.0, 1.0], "divisions": [2 * n, n],
                         "order": order}} | more

    sides = [{"on": "left", "x": 0.0}, {"on": "right", "x": 0.0}]
    return {"body": [block("upper", 1.0, [{"on": "top", "x": 1e-3, "y": -2e-4, "history": "press"}]),
                     block("lower", 0.0, [*sides, {"on": "bottom", "x": 0.0, "y": 0.0}],
                           material={"expansion": 1.2e-5}, temperature={"value": "50 + 10*x", "history": "day"})],
            "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"],
                         "friction": {"law": "coulomb", "coefficient": 0.3}}],
            "history": {"day": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 1.0, 1.0, 0.3]},
                        "press": {"times": [0.0, 1.0, 2.0], "factors": [0.2, 0.3, 1.0]}},
            "time": {"points": [1.0, 2.0, 3.0], "steps": 2}, "method": {"tolerance": 1e-10}}


@pytest.mark.parametrize("order", [1, 2])
def test_energy_balances_while_temperatures_change(order):
    """Work of supports and heat is strain energy, less what friction takes; strain energy is that of the stresses."""
    answer = ddmpi.solve(to_toml(heated_stack(3, order)), MPI.COMM_SELF)
    assert answer.certified
    energy, bodies = answer.summary["energy"], answer.summary["bodies"]
    assert energy["residual"] <= 1e-9
    assert energy["external_work"] == pytest.approx(energy["strain_energy"] + energy["interface_work"], rel=1e-9)
    assert energy["dissipated"] > 0.01 * energy["strain_energy"]
    assert energy["strain_energy"] == pytest.approx(sum(each["energy"] for each in bodies.values()), rel=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_heat_closes_a_gap_in_space(order):
    """A confined bar that is heated closes a gap and presses: p = ((1 + ν)/(1 − ν) α T H₁ − g) / Σ (H / M)."""
    young, nu, gap = 2.1e11, 0.3, 4e-4
    modulus = young * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    sides = [{"on": on, axis: 0.0} for on, axis in (("left", "x"), ("right", "x"), ("front", "y"), ("back", "y"))]

    def bar(name: str, z: float, **more) -> dict:
        return {"name": name, "clamp": [*sides, "top" if z else "bottom"],
                "material": {"young": young, "poisson": nu} | ({} if z else {"expansion": 1.2e-5}),
                "mesh": {"shape": "box", "origin": [0.0, 0.0, z], "size": [1.0, 1.0, 1.0], "divisions": [2, 2, 2],
                         "order": order}} | more

    answer = ddmpi.solve(to_toml({"body": [bar("lower", 0.0, temperature=60.0), bar("upper", 1.0 + gap)], "contact": [
        {"bodies": ["lower", "upper"], "on": ["top", "bottom"]}], "method": {"tolerance": 1e-10}}), MPI.COMM_SELF)
    assert answer.certified
    exact = ((1 + nu) / (1 - nu) * 1.2e-5 * 60.0 - gap) / (2.0 / modulus)
    assert answer.contacts["lower-upper"].pressure == pytest.approx(exact, rel=1e-9)
