"""Random changes of a scene, and whether two answers are the same to the bit: for tests and the study of prepared
models."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import numpy as np

CHANCE = {"seconds", "started", "run", "command", "reused", "memory_mib", "started_from"}
"""Entries of a summary that differ from run to run."""

Change = Callable[[random.Random, dict], dict[str, Any]]


def _number(rng: random.Random) -> float:
    return round(rng.uniform(0.5, 1.5), 3)


def _scaled(value: Any, factor: float) -> Any:
    """A load, a clamp or a displacement times a factor."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float):
        return value * factor
    if isinstance(value, list | tuple):
        return [_scaled(entry, factor) for entry in value]
    return value


def _friction(rng: random.Random, scene: dict) -> dict[str, Any]:
    k, contact = rng.choice([*enumerate(scene["contact"])])
    law, key = contact.get("friction", {"law": "none"}), f"contact.{k}.friction"
    if contact.get("kind") == "bonded":
        return {}
    for name in "coefficient", "slip_bound":
        if isinstance(law.get(name), float | int):
            return {f"{key}.{name}": law[name] * _number(rng)}
    return {key: {"law": "coulomb", "coefficient": 0.2 * _number(rng)}}


def _frictionless(rng: random.Random, scene: dict) -> dict[str, Any]:
    k, contact = rng.choice([*enumerate(scene["contact"])])
    return {} if contact.get("kind") == "bonded" else {f"contact.{k}.friction": {"law": "none"}}


def _gap(rng: random.Random, scene: dict) -> dict[str, Any]:
    k, contact = rng.choice([*enumerate(scene["contact"])])
    given = contact.get("gap")
    if isinstance(given, float | int) and given:
        return {f"contact.{k}.gap": given * _number(rng)}
    return {} if given is not None or contact.get("kind") == "bonded" else {f"contact.{k}.gap": -1e-7 * _number(rng)}


def _load(rng: random.Random, scene: dict) -> dict[str, Any]:
    places = [(b, k, key, load[key]) for b, body in enumerate(scene["body"])
              for k, load in enumerate(body.get("traction", []))
              for key in ("value", "pressure", "force") if key in load]
    if not places:
        return {}
    b, k, key, value = rng.choice(places)
    return {f"body.{b}.traction.{k}.{key}": _scaled(value, _number(rng))}


def _clamp(rng: random.Random, scene: dict) -> dict[str, Any]:
    """The value of a clamp that has one, or a small one."""
    places = [(b, k, clamp) for b, body in enumerate(scene["body"]) for k, clamp in enumerate(body.get("clamp", []))]
    moved = [(b, k, {axis: _scaled(clamp[axis], _number(rng)) for axis in ("x", "y", "z") if axis in clamp})
             for b, k, clamp in places if isinstance(clamp, dict)]
    return {f"body.{b}.clamp.{k}.{axis}": value for b, k, values in [rng.choice(moved)]
            for axis, value in values.items()} if moved else {}


def _held_otherwise(rng: random.Random, scene: dict) -> dict[str, Any]:
    """Rollers in place of a clamp in all directions: other dofs."""
    places = [(b, k, clamp) for b, body in enumerate(scene["body"]) for k, clamp in enumerate(body.get("clamp", []))
              if isinstance(clamp, str)]
    if not places:
        return {}
    b, k, clamp = rng.choice(places)
    return {f"body.{b}.clamp.{k}": {"on": clamp, "x": 0.0}}


def _partner(rng: random.Random, scene: dict) -> dict[str, Any]:
    places = [(k, key, rigid[key]) for k, rigid in enumerate(scene.get("rigid", []))
              for key in ("displacement", "force") if key in rigid]
    if not places:
        return {}
    k, key, value = rng.choice(places)
    return {f"rigid.{k}.{key}": _scaled(value, _number(rng))}


def _history(rng: random.Random, scene: dict) -> dict[str, Any]:
    if not scene.get("history"):
        return {}
    name = rng.choice([*scene["history"]])
    factor = _number(rng)
    return {f"history.{name}.factors": [factor * value for value in scene["history"][name]["factors"]]}


def _modulus(rng: random.Random, scene: dict) -> dict[str, Any]:
    b, body = rng.choice([*enumerate(scene["body"])])
    material = body["material"]
    return {} if isinstance(material, list) else {
        f"body.{b}.material.young": _scaled(material["young"], _number(rng))}


def _poisson(rng: random.Random, scene: dict) -> dict[str, Any]:
    b, body = rng.choice([*enumerate(scene["body"])])
    material = body["material"]
    return {} if isinstance(material, list) or isinstance(material.get("poisson"), list) else {
        f"body.{b}.material.poisson": 0.25 + 0.05 * _number(rng)}


def _mesh(rng: random.Random, scene: dict) -> dict[str, Any]:
    places = [(b, body["mesh"]["divisions"]) for b, body in enumerate(scene["body"]) if "divisions" in body["mesh"]]
    if not places:
        return {}
    b, divisions = rng.choice(places)
    return {f"body.{b}.mesh.divisions": [number + rng.choice([0, 1]) for number in divisions]}


def _foundation(rng: random.Random, scene: dict) -> dict[str, Any]:
    places = [(b, k, key, entry[key]) for b, body in enumerate(scene["body"])
              for k, entry in enumerate(body.get("foundation", [])) for key in ("normal", "tangential") if key in entry]
    if not places:
        return {}
    b, k, key, value = rng.choice(places)
    return {f"body.{b}.foundation.{k}.{key}": _scaled(value, _number(rng))}


def _heat(rng: random.Random, scene: dict) -> dict[str, Any]:
    places = [(b, body["temperature"]) for b, body in enumerate(scene["body"])
              if isinstance(body.get("temperature"), float | int)]
    if not places:
        return {}
    b, value = rng.choice(places)
    return {f"body.{b}.temperature": _scaled(value, _number(rng))}


def _solver(rng: random.Random, scene: dict) -> dict[str, Any]:
    return rng.choice([{"method.compliance": "direct"}, {"method.compliance": "iterative"},
                       {"method.compliance": "explicit"}, {"petsc.body_mat_mumps_icntl_7": 0},
                       {"petsc.newton_ksp_max_it": 200}, {"method.tolerance": 1e-7}])


CHANGES: tuple[Change, ...] = (_friction, _frictionless, _gap, _load, _clamp, _held_otherwise, _partner, _history,
                               _modulus, _poisson, _mesh, _foundation, _heat, _solver)


def changes(rng: random.Random, scene: dict) -> dict[str, Any]:
    """One to three random changes of a scene, at least one value."""
    found: dict[str, Any] = {}
    while not found:
        for change in rng.sample(CHANGES, rng.choice([1, 1, 2, 3])):
            found |= change(rng, scene)
    # no key within another one
    return {key: value for key, value in found.items() if not any(
        other != key and key.startswith(f"{other}.") for other in found)}


def differences(one: Any, other: Any, key: str = "") -> list[str]:
    """Where two tables, lists, arrays or objects of arrays differ in a bit."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        same = isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.dtype == other.dtype and (
            one.shape == other.shape) and one.tobytes() == other.tobytes()
        return [] if same else [key]
    if isinstance(one, dict) and isinstance(other, dict):
        if [*one] != [*other]:
            return [f"{key}: {[*one]} and {[*other]}"]
        return [place for name in one if name not in CHANCE
                for place in differences(one[name], other[name], f"{key}.{name}")]
    if isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        return [place for k, pair in enumerate(zip(one, other, strict=True))
                for place in differences(*pair, f"{key}.{k}")]
    return [] if repr(one) == repr(other) else [f"{key}: {one!r} and {other!r}"]


def content(answer: Any) -> dict[str, Any]:
    """Everything that an answer says, on this rank."""
    states = {name: {key: getattr(state, key) for key in (
        "normal_force", "tangential_force", "gap", "slip", "status", "between", "before", "resistance")}
              for name, state in answer.contacts.items()}
    fields = {name: vars(field) for name, field in answer.bodies.items()}
    return {"summary": {key: value for key, value in answer.summary.items() if key not in CHANCE}, "contacts": states,
            "fields": fields}
