"""Scenes of bolts with a pretension, of which closed forms are known: without Poisson's effect stresses are uniform."""

from __future__ import annotations

import numpy as np
from scenes import rectangle
from solid_scenes import box

YOUNG, FORCE, HEIGHT = 1e9, 1e5, 4.0
AREAS = {"plane": (1.0, 2.0), "axis": (np.pi, 12.0 * np.pi), "space": (1.0, 2.0)}
"""Of the shank and the sleeve of a `joint` (m²)."""

HISTORY = {
    "tighten": {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
    "work": {"times": [1.0, 2.0, 3.0], "factors": [0.0, 1.0, 4.0]},
}


def bar(d: int = 2, order: int = 1, n: int = 2, **pretension) -> dict:
    """Two halves of a bar of length 3 along x, clamped at its ends, with a pretension in the bond between them."""
    ends = [[{"on": on} | {axis: 0.0 for axis in "xyz"[:d]}] for on in ("left", "right")]
    if d == 2:
        bodies = [
            rectangle("one", (0.0, 0.0), (1.0, 1.0), (2, 2), order, YOUNG, 0.0, clamp=ends[0]),
            rectangle("two", (1.0, 0.0), (2.0, 1.0), (2 * n, n), order, YOUNG, 0.0, clamp=ends[1]),
        ]
    else:
        bodies = [
            box("one", (0, 0, 0), (1, 1, 1), (2, 2, 2), order, YOUNG, 0.0, clamp=ends[0]),
            box("two", (1, 0, 0), (2, 1, 1), (n, n, n), order, YOUNG, 0.0, clamp=ends[1]),
        ]
    return {
        "body": bodies,
        "contact": [
            {
                "name": "cut",
                "bodies": ["one", "two"],
                "on": ["right", "left"],
                "kind": "bonded",
                "pretension": {"force": FORCE, "along": [1.0] + [0.0] * (d - 1)} | pretension,
            }
        ],
    }


def joint(
    kind: str = "plane",
    order: int = 1,
    n: int = 4,
    steps: int = 1,
    poisson: float = 0.0,
    law: dict | None = None,
) -> dict:
    """A shank, cut in the middle, and a sleeve beside or around it, under a rigid head that a load lifts.

    The bolt is tightened until time 1 by `FORCE`. Then half of it lifts the head until time 2, and twice of it until
    time 3, when the sleeve has parted from the head. The `kind` is one of `AREAS`.
    """
    up = [0.0, 0.0, 1.0] if kind == "space" else [0.0, 1.0]
    clamp = [{"on": "bottom"} | dict.fromkeys("y" if kind == "axis" else "xyz"[: len(up)], 0.0)]

    def body(name: str, x: float, width: float, y: float, height: float, k: int, **more) -> dict:
        if kind == "space":
            return box(
                name, (x, 0.0, y), (width, 1.0, height), (2, 2, k), order, YOUNG, poisson, **more
            )
        return rectangle(name, (x, y), (width, height), (2, k), order, YOUNG, poisson, **more)

    bodies = [
        body("lower", 0.0, 1.0, 0.0, 2.0, 4, clamp=clamp),
        body("upper", 0.0, 1.0, 2.0, 2.0, n),
        body("sleeve", 2.0, 2.0, 0.0, HEIGHT, 4, clamp=clamp),
    ]
    head = {
        "name": "head",
        "shape": "plane",
        "point": [HEIGHT * x for x in up],
        "normal": [-x for x in up],
        "force": [0.5 * FORCE * x for x in up],
        "history": "work",
    }
    contacts = [
        {
            "name": "cut",
            "bodies": ["lower", "upper"],
            "on": ["top", "bottom"],
            "kind": "bonded",
            "pretension": {"force": FORCE, "along": up, "history": "tighten"},
        },
        {"bodies": ["upper", "head"], "on": ["top"], "kind": "bonded"},
        {"bodies": ["sleeve", "head"], "on": ["top"]} | ({"friction": law} if law else {}),
    ]
    if n != 4 and kind != "space":
        bodies[1]["mesh"]["divisions"][0] = 3
    return {
        "body": bodies,
        "rigid": [head],
        "contact": contacts,
        "history": HISTORY,
        "time": {"points": [1.0, 2.0, 3.0], "steps": steps},
    } | ({"axisymmetric": True} if kind == "axis" else {})


def of_joint(kind: str, time: float) -> tuple[float, float]:
    """The force in the shank and the offset of the cut at a time: the load counts by the part k_b/(k_b + k_s) of the
    stiffnesses until the sleeve parts, then in full."""
    shank, sleeve = (YOUNG * area / HEIGHT for area in AREAS[kind])
    tight, load = min(time, 1.0) * FORCE, np.interp(time, [1.0, 2.0, 3.0], [0.0, 0.5, 2.0]) * FORCE
    return max(tight + load * shank / (shank + sleeve), load), tight / shank + tight / sleeve
