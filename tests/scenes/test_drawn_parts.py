"""The parts of docs/use/drawn_parts.md, drawn in gmsh, against closed forms and balances by hand; coarse targets."""

import numpy as np
import pytest
from scenes import ROOT, Run, run_here

pytestmark = pytest.mark.slow

TARGETS = {"wheel_on_rail": 0.05, "pin_in_lug": 0.04, "dovetail": 0.1, "snap_hook": 0.04, "wedge_in_slot": 0.1}
"""Coarser ones than those of the scenes."""

SHARP = {"wheel_on_rail": "rail", "dovetail": "disc", "wedge_in_slot": "block"}
"""The bodies whose largest stress stands at a corner that is drawn sharp."""


@pytest.fixture(scope="module")
def parts(tmp_path_factory) -> dict[str, Run]:
    folder = tmp_path_factory.mktemp("drawn")
    return {name: run_here(ROOT / "configs" / "drawn" / f"{name}.toml", folder / name, "--no-figures", "--set",
                           f"method.target_error={target}") for name, target in TARGETS.items()}


@pytest.mark.parametrize("name", TARGETS)
def test_drawn_part_is_certified_and_meets_its_target(parts, name):
    """A part drawn without a thought of nodes is certified, meets its target, and only sharp corners are warned of."""
    done = parts[name]
    assert done.code == 0, done.output
    assert done.summary["discretization_error"]["energy_norm"] <= 0.9 * TARGETS[name]
    assert [each.split(",")[0] for each in done.summary["warnings"]] == [
        f"body.{body}: the largest von Mises stress" for body in [SHARP.get(name)] if body]
    assert all("stands at a re-entrant corner at (" in each for each in done.summary["warnings"])
    for contact in done.summary["contacts"].values():
        assert contact["normal_force"] > 0.0


def test_wheel_on_rail_is_hertz(parts):
    """The pressure between wheel and rail is Hertz's at the force that was computed."""
    force = parts["wheel_on_rail"].summary["contacts"]["wheel-rail"]["force"][1]
    radius, modulus = 1 / (1 / 460 + 1 / 300), 210000 / (2 * (1 - 0.3**2))
    width, largest = np.sqrt(4 * force * radius / (np.pi * modulus)), np.sqrt(force * modulus / (np.pi * radius))
    sides = parts["wheel_on_rail"].table("contact_wheel-rail_sides.csv")
    x, p = np.array(sides["x"], float), np.array(sides["normal_stress"], float)
    inner = np.abs(x) < 0.8 * width
    slope, start = np.polyfit(x[inner] ** 2, p[inner] ** 2, 1)
    assert np.sqrt(start) == pytest.approx(largest, rel=0.02)
    assert np.sqrt(-start / slope) == pytest.approx(width, rel=0.03)


def test_pin_rests_in_its_hole(parts):
    """The pin that nothing holds but its hole hands its whole load to the lug, without a moment about its centre."""
    summary = parts["pin_in_lug"].summary
    contact = summary["contacts"]["pin-lug"]
    assert contact["force"] == pytest.approx([-2000.0, 0.0], rel=0.012, abs=1e-3)  # circles have straight sides
    assert abs(contact["moment"]) < 1e-4 * 2000 * 10
    assert summary["bodies"]["lug"]["reaction"] == pytest.approx(contact["force"], rel=1e-5, abs=1e-3)
    assert contact["pressure_max"] == pytest.approx(162.5, rel=0.03)  # of targets of 1 % and 0.5 %


def test_flanks_slide_in_balance(parts):
    """Dovetail, wedge and hook slide: the sideways force follows from slope, friction and load alone."""
    pull, friction = 600.0, 0.2
    root = parts["dovetail"].summary["contacts"]["root-disc"]
    assert root["force"] == pytest.approx([-pull * (1 - friction) / (1 + friction), -pull], rel=1e-4)
    angle, friction, push = np.deg2rad(15), 0.1, 20.0 * (10 + 80 * np.tan(np.deg2rad(15)))
    sideways = push / 2 * (np.cos(angle) - friction * np.sin(angle)) / (np.sin(angle) + friction * np.cos(angle))
    wedge = parts["wedge_in_slot"].summary["contacts"]
    assert wedge["right"]["force"] == pytest.approx([-sideways, push / 2], rel=1e-3)
    assert wedge["left"]["force"] == pytest.approx([sideways, push / 2], rel=1e-3)


def test_snap_hook_is_a_beam(parts):
    """The hook's forces are those of a sloping front, its stiffness that of a beam with a force beside its axis."""
    x, y = np.negative(parts["snap_hook"].summary["contacts"]["hook-catch"]["force"])
    angle, friction = np.pi / 6, 0.2
    assert x / y == pytest.approx((np.sin(angle) + friction * np.cos(angle))
                                  / (np.cos(angle) - friction * np.sin(angle)), rel=1e-3)
    length, height, lever, young = 40.0, 3.0, 2.5, 2400.0
    bending, shear = young * height**3 / 12, young / (2 * 1.35) * height / 1.2
    moment = x * lever  # of the push along the axis, at the front's upper end
    down = y * length**3 / (3 * bending) - moment * length**2 / (2 * bending) + y * length / shear
    turn = y * length**2 / (2 * bending) - moment * length / bending
    forth = 1.0 + turn * lever - x * length / (young * height)
    assert down == pytest.approx(np.tan(angle) * forth, rel=0.02)
