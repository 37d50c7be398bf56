"""The snap hook of docs/use/drawn_parts.md against beam theory. The gallery's test solves other drawn parts."""

import numpy as np
import pytest
from scenes import CLAMP_END, ROOT, run_here

pytestmark = pytest.mark.slow


def test_snap_hook_is_a_beam(tmp_path):
    """Its forces are those of a sloping front, its stiffness that of a beam with a force beside its axis."""
    done = run_here(
        ROOT / "configs" / "drawn" / "snap_hook.toml",
        tmp_path,
        "--no-figures",
        "--set",
        "method.target_error=0.04",
    )
    node, clamp = done.summary["warnings"]
    assert done.code == 0, done.output
    assert "closed at a single node" in node and CLAMP_END in clamp
    assert done.summary["discretization_error"]["energy_norm"] <= 0.9 * 0.04
    x, y = np.negative(done.summary["contacts"]["hook-catch"]["force"])
    angle, friction = np.pi / 6, 0.2
    assert x / y == pytest.approx(
        (np.sin(angle) + friction * np.cos(angle)) / (np.cos(angle) - friction * np.sin(angle)),
        rel=1e-3,
    )
    length, height, lever, young = 40.0, 3.0, 2.5, 2400.0
    bending, shear = young * height**3 / 12, young / (2 * 1.35) * height / 1.2
    moment = x * lever  # of the push along the axis, at the front's upper end
    down = y * length**3 / (3 * bending) - moment * length**2 / (2 * bending) + y * length / shear
    turn = y * length**2 / (2 * bending) - moment * length / bending
    forth = 1.0 + turn * lever - x * length / (young * height)
    assert down == pytest.approx(np.tan(angle) * forth, rel=0.02)
