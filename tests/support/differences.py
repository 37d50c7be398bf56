"""Derivatives of an answer compared with central differences of fresh answers."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np
from scenes import rectangle

import ddmpi
from ddmpi.mesh.build import kind_of_files
from ddmpi.scene.reader import read_scene

KINDS = ("moment", "pressure", "dissipated", "displacement")
"""Results in other units than forces, by a part of their names."""

TIGHT = {"method.tolerance": 1e-12}


def plain(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with all defaults, as data without None; clamps in the long form."""

    def filled(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: filled(entry) for key, entry in value.items() if entry is not None}
        return [filled(entry) for entry in value] if isinstance(value, list | tuple) else value

    data = filled(read_scene("scene", scene, file_kind=kind_of_files("scene")).resolved())
    for body in data["body"]:
        still = dict(zip("xyz", [0.0] * len(body["volume_force"]), strict=False))
        body["clamp"] = [
            {"on": clamp} | still if isinstance(clamp, str) else clamp for clamp in body["clamp"]
        ]
    return data


def _numbers(value: Any, key: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, dict | list):
        for name, entry in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _numbers(entry, f"{key}.{name}" if key else str(name))
    elif isinstance(value, float | int):
        yield key, float(value)


def nulls(value: Any, key: str = "") -> Iterator[str]:
    """The names of results of an entry of ``derivatives`` that are null."""
    if isinstance(value, dict | list):
        for name, entry in value.items() if isinstance(value, dict) else enumerate(value):
            yield from nulls(entry, f"{key}.{name}" if key else str(name))
    elif value is None:
        yield key


def results(summary: dict[str, Any]) -> dict[str, float]:
    """The numbers of an answer that have derivatives, by their names in an entry of ``derivatives``."""
    contacts = {
        name: {
            key: contact[key]
            for key in (
                "force",
                "moment",
                "normal_force",
                "tangential_force",
                "pressure_max",
                "dissipated",
            )
        }
        for name, contact in summary["contacts"].items()
    }
    bodies = {name: {"reaction": body["reaction"]} for name, body in summary["bodies"].items()}
    return dict(_numbers({"contacts": contacts, "rigid": summary["rigid"], "bodies": bodies}))


def _scaled(value: Any, factor: float) -> Any:
    """A load, a clamp or a profile times a factor."""
    if isinstance(value, dict):
        return {
            key: entry if key in ("on", "history", "points", "along") else _scaled(entry, factor)
            for key, entry in value.items()
        }
    if isinstance(value, list):
        return [_scaled(entry, factor) for entry in value]
    return f"({value}) * {factor!r}" if isinstance(value, str) else value * factor


def changed(data: dict[str, Any], key: str, by: float | None) -> tuple[dict[str, Any], float]:
    """A plain scene with a key of ``output.derivatives`` changed `by` something, and what stood there, 1 for a factor."""
    data = copy.deepcopy(data)
    kind, name, *rest = key.split(".")
    place: Any = next(entry for entry in data[kind] if entry["name"] == name)
    for part in rest[:-1]:
        place = place[int(part) if part.isdigit() else part]
    last: Any = int(rest[-1]) if rest[-1].isdigit() else rest[-1]
    if (
        last in ("gap", "temperature")
        and isinstance(place[last], dict)
        and isinstance(place[last].get("value"), float)
    ):
        place, last = place[last], "value"
    value = place[last]
    if isinstance(value, float | int):
        place[last] = value + (by or 0.0)
        return data, float(value)
    place[last] = _scaled(value, 1.0 + (by or 0.0))
    return data, 1.0


def difference(
    scene: dict[str, Any],
    key: str,
    entry: dict[str, Any],
    step: float = 1e-4,
    size: float | None = None,
    only: str = "",
) -> tuple[float, str]:
    """The largest difference of an `entry` of ``derivatives`` and central differences, over the largest derivative of
    its kind, with its name.

    The differences are over `step` times the number, or times its `size`, and stay within ``until``; at one of its ends
    they are those of the other side. With `only`, results whose names have this word are compared.
    """
    data = plain(scene)
    _, value = changed(data, key, None)
    low, high = (
        end if end is not None else sign * np.inf
        for end, sign in zip(entry["until"], (-1, 1), strict=True)
    )
    h, room = step * (size or abs(value)), (value - low, high - value)

    def at(shift: float) -> dict[str, float]:
        return results(ddmpi.solve(changed(data, key, shift)[0], overrides=TIGHT).summary)

    if min(room) < 1e-3 * h:
        sign = 1.0 if room[1] > room[0] else -1.0
        h = min(h, 0.2 * max(room))
        here, near, far = at(0.0), at(sign * h), at(2.0 * sign * h)
        exact = {
            name: sign * (4.0 * near[name] - 3.0 * here[name] - far[name]) / (2.0 * h)
            for name in here
        }
    else:
        h = min(h, 0.3 * min(room))
        here, below = at(h), at(-h)
        exact = {name: (here[name] - below[name]) / (2.0 * h) for name in here}
    found = dict(_numbers({name: entry[name] for name in ("contacts", "bodies", "rigid")}))
    lost = set(nulls({name: entry[name] for name in ("contacts", "bodies", "rigid")}))
    assert exact.keys() <= found.keys() | lost
    exact = {name: value for name, value in exact.items() if name not in lost}
    groups: dict[str, list[str]] = {}
    for name in (name for name in exact if only in name):
        groups.setdefault(next((kind for kind in KINDS if kind in name), "force"), []).append(name)
    worst = [(0.0, "")]
    for names in groups.values():
        # answers to 1e-12 over 1e-4 of a number tell derivatives to 1e-8 of the results, 1e-5 of a thousandth
        largest = max(
            max(abs(exact[name]), abs(found[name]), 1e-3 * abs(here[name]) / (size or abs(value)))
            for name in names
        )
        worst += [(abs(found[name] - exact[name]) / largest, name) for name in names if largest]
    return max(worst)


def with_derivatives(scene: dict[str, Any], keys: list[str]) -> dict[str, Any]:
    """The plain scene that asks for derivatives."""
    return plain(scene) | {"output": plain(scene)["output"] | {"derivatives": keys}}


def vice() -> dict[str, Any]:
    """A loose block between a moved and a pushed plane, in millimetres."""
    sides = [
        {
            "name": "fixed",
            "shape": "plane",
            "point": [0.0, 0.0],
            "normal": [1.0, 0.0],
            "displacement": [1e-3, 0.0],
        },
        {
            "name": "ram",
            "shape": "plane",
            "point": [40.0, 0.0],
            "normal": [-1.0, 0.0],
            "force": [-200.0, 0.0],
        },
    ]
    friction = {"law": "coulomb", "coefficient": 0.3}
    return {
        "body": [
            rectangle(
                "part",
                (0, 0),
                (40, 20),
                (6, 4),
                young=7e4,
                traction=[{"on": "top", "value": [0.0, -1.5]}],
            )
        ],
        "rigid": sides,
        "contact": [
            {"bodies": ["part", "fixed"], "on": ["left"], "friction": friction},
            {"bodies": ["part", "ram"], "on": ["right"], "friction": friction},
        ],
    }


def rubbed(**time: int) -> dict[str, Any]:
    """A block that is pressed onto another one through a gap, rubbed to and fro, and warmed."""
    history = {
        "press": {"times": [0, 1], "factors": [0, 1]},
        "rub": {"times": [0, 1, 2, 3], "factors": [0, 0, 1, -0.6]},
    }
    steel = {"young": 2.1e5, "poisson": 0.3}
    return {
        "body": [
            rectangle(
                "pad",
                (1, 4),
                (4, 2),
                (4, 2),
                young=2.1e5,
                clamp=[
                    {"on": "top", "x": 0.004, "history": "rub"},
                    {"on": "top", "y": -0.01, "history": "press"},
                ],
            ),
            {
                "name": "base",
                "material": steel,
                "clamp": ["bottom"],
                "mesh": {"shape": "rectangle", "size": [6, 4], "divisions": [6, 4]},
            },
        ],
        "contact": [
            {
                "name": "fit",
                "bodies": ["pad", "base"],
                "on": ["bottom", "top"],
                "gap": "5e-4 * (x - 1)**2",
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
        ],
        "history": history,
        "time": {"points": [1.0, 2.0, 3.0]} | time,
    }


def ring(warm: float = 40.0) -> dict[str, Any]:
    """A heated ring that is shrunk onto a shaft and pushed along it, around an axis, in millimetres."""
    mesh = {"shape": "rectangle", "origin": [20.0, 5.0], "size": [10.0, 12.0], "divisions": [3, 5]}
    steel = {"young": 2.1e5, "poisson": 0.3, "expansion": 1.2e-5}
    return {
        "axisymmetric": True,
        "body": [
            rectangle("shaft", (0, 0), (20, 22), (4, 8), young=2.1e5, clamp=["bottom"]),
            {
                "name": "ring",
                "mesh": mesh,
                "material": steel,
                "temperature": warm,
                "traction": [{"on": "top", "value": [0.0, -5.0]}],
            },
        ],
        "contact": [
            {
                "name": "fit",
                "bodies": ["ring", "shaft"],
                "on": ["left", "right"],
                "gap": -0.03,
                "friction": {"law": "coulomb", "coefficient": 0.2},
            }
        ],
    }
