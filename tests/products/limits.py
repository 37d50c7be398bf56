"""Loads whose limit is that of friction, in each kind of scene, and of each the factor that statics tells."""

from __future__ import annotations

import numpy as np
from kinds import Kind
from promises import LOAD


def pushed(kind: Kind) -> tuple[dict, str, float]:
    """A block that is pressed on a floor and pushed along it, around an axis a ring that is pushed through a tight bore:
    the scene, the load that is multiplied, and its factor at the limit."""
    share, friction = 0.023, {"law": "coulomb", "coefficient": 0.19}
    push = {"on": "top" if kind.axis else "bottom"}
    pressed, factor = [{"on": "top", "pressure": LOAD}], 0.19 / share
    partner = kind.floor()
    contact = {"bodies": ["block", "floor"], "on": ["bottom"]}
    if kind.axis:
        wall, height = kind.low[0] + kind.size[0], kind.size[1]
        partner |= {"point": [float(wall), 0.0], "normal": [-1.0, 0.0]}
        contact |= {"on": ["right"], "gap": -1.7e-4}
        friction = {"law": "tresca", "slip_bound": 0.08 * LOAD}
        factor = 0.08 / share * 2 * np.pi * wall * height / kind.area()
        pressed = []
    force = share * LOAD * (kind.up if kind.axis else kind.aside)
    if kind.order == 1:
        push["value"] = force.tolist()
    else:
        push["force"] = (kind.area() * force).tolist()
    scene = kind.scene(
        kind.block(traction=[push, *pressed]),
        rigid=[partner],
        contact=[contact | {"friction": friction}],
        grows=True,
    )
    if not kind.steps:
        return scene, "body.block.traction.0", factor
    # what presses the block has another history, which its end does not change
    scene["history"]["push"] = {"times": [0.0, 1.0, 2.3], "factors": [0.0, 0.2, -0.6]}
    scene["body"][0]["traction"][0]["history"] = "push"
    return scene, "push", factor
