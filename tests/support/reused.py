"""Random changes of a scene, and whether two answers are the same to the bit: for tests and the study of prepared
models."""

from __future__ import annotations

import fnmatch
import random
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

CHANCE = {"seconds", "started", "run", "command", "reused", "memory_mib", "started_from"}
"""Entries of a summary that differ from run to run."""

Change = Callable[[random.Random, dict], dict[str, Any]]

SCALED = {
    "friction": ("contact.*.friction.coefficient", "contact.*.friction.slip_bound"),
    "gap": ("contact.*.gap",),
    "load": ("body.*.traction.*.value", "body.*.traction.*.pressure", "body.*.traction.*.force"),
    "clamp": ("body.*.clamp.*.[xyz]",),
    "partner": ("rigid.*.displacement", "rigid.*.force"),
    "history": ("history.*.factors",),
    "modulus": ("body.*.material.young",),
    "foundation": ("body.*.foundation.*.normal", "body.*.foundation.*.tangential"),
    "heat": ("body.*.temperature",),
}
"""Keys whose numbers are multiplied by a factor."""


def places(scene: dict, *patterns: str) -> dict[str, Any]:
    """What stands at the keys of a scene that match patterns, * in the place of numbers and names."""
    found: dict[str, Any] = {}
    for pattern in patterns:
        some: dict[str, Any] = {"": scene}
        for part in pattern.split("."):
            some = {
                f"{key}.{name}".lstrip("."): entry
                for key, value in some.items()
                for name, entry in (
                    value.items()
                    if isinstance(value, dict)
                    else enumerate(value)
                    if isinstance(value, list)
                    else ()
                )
                if fnmatch.fnmatch(str(name), part)
            }
        found |= some
    return found


def _number(rng: random.Random) -> float:
    return round(rng.uniform(0.5, 1.5), 3)


def _scaled(value: Any, factor: float) -> Any:
    return (
        [_scaled(entry, factor) for entry in value] if isinstance(value, list) else value * factor
    )


def scale(kind: str, rng: random.Random, scene: dict) -> dict[str, Any]:
    """One of the numbers, or lists of numbers, at the keys of a kind."""
    some = {
        key: value
        for key, value in places(scene, *SCALED[kind]).items()
        if isinstance(value, float | int | list)
    }
    key = rng.choice([*some]) if some else ""
    return {key: _scaled(some[key], _number(rng))} if some else {}


def _contact(
    value: Callable[[random.Random], dict[str, Any]], rng: random.Random, scene: dict
) -> dict[str, Any]:
    """Another friction or gap of a contact that is no bond and has no gap yet."""
    k, contact = rng.choice([*enumerate(scene["contact"])])
    given = {
        f"contact.{k}.{key}": entry
        for key, entry in value(rng).items()
        if not (key in contact and key == "gap")
    }
    return {} if contact.get("kind") == "bonded" else given


def _one(
    pattern: str,
    kind: type,
    value: Callable[[random.Random, Any], Any],
    rng: random.Random,
    scene: dict,
) -> dict[str, Any]:
    """Another value in the place of one of a kind."""
    some = {key: entry for key, entry in places(scene, pattern).items() if isinstance(entry, kind)}
    key = rng.choice([*some]) if some else ""
    return {key: value(rng, some[key])} if some else {}


def _solver(rng: random.Random, scene: dict) -> dict[str, Any]:
    return rng.choice(
        [
            {"method.compliance": "direct"},
            {"method.compliance": "iterative"},
            {"method.compliance": "explicit"},
            {"petsc.body_mat_mumps_icntl_7": 0},
            {"petsc.newton_ksp_max_it": 200},
            {"method.tolerance": 1e-7},
        ]
    )


CHANGES: tuple[Change, ...] = (
    partial(_contact, lambda rng: {"gap": -1e-7 * _number(rng)}),
    *(partial(scale, kind) for kind in SCALED),
    partial(
        _contact, lambda rng: {"friction": {"law": "coulomb", "coefficient": 0.2 * _number(rng)}}
    ),
    partial(_contact, lambda rng: {"friction": {"law": "none"}}),
    partial(_contact, lambda rng: {"softness": 1e-13 * _number(rng)}),
    # rollers in place of a clamp in all directions: other dofs
    partial(_one, "body.*.clamp.*", str, lambda rng, clamp: {"on": clamp, "x": 0.0}),
    partial(_one, "body.*.material.poisson", float, lambda rng, _: 0.25 + 0.05 * _number(rng)),
    partial(
        _one,
        "body.*.mesh.divisions",
        list,
        lambda rng, numbers: [n + rng.choice([0, 1]) for n in numbers],
    ),
    _solver,
)


def changes(rng: random.Random, scene: dict) -> dict[str, Any]:
    """One to three random changes of a scene, at least one value."""
    found: dict[str, Any] = {}
    while not found:
        for change in rng.sample(CHANGES, rng.choice([1, 1, 2, 3])):
            found |= change(rng, scene)
    # no key within another one
    return {
        key: value
        for key, value in found.items()
        if not any(other != key and key.startswith(f"{other}.") for other in found)
    }


def differences(one: Any, other: Any, key: str = "") -> list[str]:
    """Where two tables, lists, arrays or objects of arrays differ in a bit."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        same = (
            isinstance(one, np.ndarray)
            and isinstance(other, np.ndarray)
            and one.dtype == other.dtype
            and (one.shape == other.shape)
            and one.tobytes() == other.tobytes()
        )
        return [] if same else [key]
    if isinstance(one, dict) and isinstance(other, dict):
        if [*one] != [*other]:
            return [f"{key}: {[*one]} and {[*other]}"]
        return [
            place
            for name in one
            if name not in CHANCE
            for place in differences(one[name], other[name], f"{key}.{name}")
        ]
    if isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        return [
            place
            for k, pair in enumerate(zip(one, other, strict=True))
            for place in differences(*pair, f"{key}.{k}")
        ]
    return [] if repr(one) == repr(other) else [f"{key}: {one!r} and {other!r}"]


def content(answer: Any) -> dict[str, Any]:
    """Everything that an answer says, on this rank."""
    states = {
        name: {
            key: getattr(state, key)
            for key in (
                "normal_force",
                "tangential_force",
                "gap",
                "slip",
                "status",
                "between",
                "before",
                "resistance",
            )
        }
        for name, state in answer.contacts.items()
    }
    fields = {name: vars(field) for name, field in answer.bodies.items()}
    return {
        "summary": {key: value for key, value in answer.summary.items() if key not in CHANCE},
        "contacts": states,
        "fields": fields,
    }
