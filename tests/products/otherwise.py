"""Scenes of the matrix said otherwise: with lists in another order, cut by a bond whose lower part is a copy, in other
units, turned and elsewhere.

What a scene promises does not change; `Seen` brings the answer back to the words of the promise.
"""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from kinds import Kind, turned

LENGTH, STRESS = 1000.0 / 25.4, 1.45e-4
"""Other units: so many inches are a metre, and so many psi a pascal."""

SHIFT = np.array([117.3, -61.9, 43.7])
"""Another place, in the other length; around an axis along the axis alone."""

TURN = {2: turned(37.0)[:2, :2], 3: turned(37.0, (0.3, -0.5, 0.8))}

FOOT = "foot"
"""The lower part of a block that is cut."""

PARTS, ONE = ("block", FOOT), " of one"


@dataclass
class Seen:
    """How the answer of a scene that is said otherwise is read.

    Attributes
    ----------
    length, force, stress : units; moments are products of the first two
    turn : (d, d) from the promise to the scene
    shift : (d,) where the origin of the promise is, in lengths of the scene
    cut : whether the block has a foot
    """

    length: float = 1.0
    force: float = 1.0
    stress: float = 1.0
    turn: np.ndarray | None = None
    shift: np.ndarray | None = None
    cut: bool = False

    def units(self, key: str) -> float:
        match key.rpartition(".")[2]:
            case "open" | "stick" | "utilisation":
                return 1.0
            case "displacement" | "offset":
                return self.length
            case "moment":
                return self.force * self.length
        return self.force

    def value(self, summary: dict, key: str) -> Any:
        """What the promise calls `key`."""
        of_both = key == "bodies.block.reaction" or key.startswith("bodies.block.loads.right")
        if self.cut and of_both and not key.endswith(ONE):
            both = (self.value(summary, key.replace("block", name, 1) + ONE) for name in PARTS)
            return np.sum([*both], axis=0)
        key = key.removesuffix(ONE)
        if self.cut and key.startswith("bodies.block.reactions.bottom"):
            key = key.replace("block", FOOT)
        found: Any = summary
        for part in key.split("."):
            found = found[part]
        found = np.atleast_1d(found)
        if self.shift is not None and key.endswith(".moment") and found.any():
            force: Any = summary
            for part in key.replace(".moment", ".force").split("."):
                force = force[part]
            found = found - np.cross(self.shift, force)
        found = found / self.units(key)
        vector = self.turn is not None and len(found) == len(self.turn)
        return self.turn.T @ found if vector else found

    def points(self, points: np.ndarray) -> np.ndarray:
        return self.vectors(points if self.shift is None else points - self.shift)

    def vectors(self, points: np.ndarray) -> np.ndarray:
        """Of lengths."""
        return (points if self.turn is None else points @ self.turn) / self.length


def permuted(scene: dict) -> dict:
    """Bodies, partners, contacts, clamps and loads from the last to the first."""
    scene = copy.deepcopy(scene)
    for table in (scene, *scene["body"]):
        for value in table.values():
            if isinstance(value, list) and all(isinstance(each, dict) for each in value):
                value.reverse()
    return scene


# Cut


def cut(scene: dict, kind: Kind) -> dict | None:
    """The block in two, bonded at half its height; None where sides, depth or motion keep it whole, and where springs along
    a surface or heat alone move it without stress: all forces of the bond would be rounding, and so would its
    certificate."""
    if "temperature" in scene["body"][0] and scene["body"][0]["clamp"] == kind.guides():
        return None
    if any("tangential" in springs for springs in scene["body"][0].get("foundation", [])):
        return None
    if scene.get("time", {}).get("motions") == "far":
        return None
    if kind.name == "plate" or scene["body"][0]["name"] != "block" or len(scene["body"]) > 1:
        return None
    if scene["body"][0]["mesh"]["shape"] not in ("rectangle", "box"):
        return None
    if any(contact["on"] not in (["top"], ["bottom"]) for contact in scene.get("contact", [])):
        return None
    scene = copy.deepcopy(scene)
    (block,) = scene["body"]
    foot = copy.deepcopy(block) | {"name": FOOT}
    half = 0.5 * block["mesh"]["size"][-1]
    for body, side in ((block, "top"), (foot, "bottom")):
        body["mesh"]["size"][-1] = half
        if kind.d == 2:
            body["mesh"]["divisions"][-1] //= 2
        for key in ("clamp", "traction", "foundation"):
            if key in body:
                body[key] = [one for one in body[key] if belongs(one, side)]
    block["mesh"]["origin"][-1] += half
    for contact in scene.setdefault("contact", []):
        contact["name"] = "-".join(contact["bodies"])
        if contact["on"] == ["bottom"]:
            contact["bodies"][0] = FOOT
    bond = {"bodies": ["block", FOOT], "on": ["bottom", "top"], "kind": "bonded"}
    scene["contact"].append(bond)
    scene["body"].append(foot)
    return scene


def copied(scene: dict) -> None:
    """Write the foot as a copy of the block, which has the same size."""
    named = {body["name"]: body for body in scene["body"]}
    one, other = (named[name].get("mesh") for name in PARTS)
    key = "corners" if "corners" in one else "origin"
    shift = np.atleast_2d(np.subtract(other[key], one[key]))[0]
    named[FOOT]["copy"] = {"of": "block", "shift": shift.tolist()}
    del named[FOOT]["mesh"], named[FOOT]["material"]


def belongs(entry: Any, side: str) -> bool:
    """Whether a clamp or a load is on a part, of which one side is the whole block's."""
    on = entry if isinstance(entry, str) else entry["on"]
    return side in on or not ("top" in on or "bottom" in on)


# Other units


def scaled(value: Any, factor: float, length: float = 1.0) -> Any:
    """A number, a list, a formula, a profile, or a table with a value and a history."""
    if isinstance(value, dict) and "points" in value:
        points, values = scaled(value["points"], length), scaled(value["values"], factor)
        return value | {"points": points, "values": values}
    if isinstance(value, dict):
        return value | {"value": scaled(value["value"], factor, length)}
    if isinstance(value, list | tuple):
        return [scaled(each, factor, length) for each in value]
    if isinstance(value, str):
        places = re.sub(r"\b([xyz])\b", rf"(\1 / {length})", value)
        return f"{factor} * ({places})"
    return value * factor


def in_units(scene: dict, kind: Kind, L: float, S: float) -> dict:
    """Metres times L and pascals times S; in the plane forces are per unit of depth, whose number stays."""
    F = S * L if kind.d == 2 and not kind.axis else S * L**2
    scene = copy.deepcopy(scene)

    def scale(table: dict, **factors: float) -> None:
        for key, factor in factors.items():
            if key in table:
                table[key] = scaled(table[key], factor, L)

    for body in scene["body"]:
        scale(body["mesh"], origin=L, size=L, corners=L, center=L, radii=L, height=L)
        scale(body["material"], young=S, shear=S)
        scale(body, volume_force=S / L, temperature=1.0)
        scale(body.get("motion", {}), shift=L)
        for clamp in body.get("clamp", []):
            if isinstance(clamp, dict):
                scale(clamp, x=L, y=L, z=L, normal=L, value=L, along=1.0)
        for load in body.get("traction", []):
            scale(load, value=S, pressure=S, force=F, moment=F * L)
        for springs in body.get("foundation", []):
            scale(springs, normal=S / L, tangential=S / L)
    for rigid in scene.get("rigid", []):
        scale(rigid, point=L, center=L, pivot=L, displacement=L, radius=L, force=F, moment=F * L)
        scale(rigid.get("motion", {}), force=F)
    for contact in scene.get("contact", []):
        scale(contact, gap=L)
        if isinstance(contact.get("softness"), dict):
            scale(contact["softness"], pressure=S, closure=L)
        else:
            scale(contact, softness=L / S)
        scale(contact.get("friction", {}), slip_bound=S, coefficient=1.0)
        scale(contact.get("pretension", {}), force=F)
        scale(contact.get("image", {}), shift=L)
    return scene


def moved(scene: dict, shift: np.ndarray) -> dict:
    """Everything elsewhere, also in formulas."""
    scene = copy.deepcopy(scene)

    def move(table: dict, *keys: str) -> None:
        for key in keys:
            if key in table:
                table[key] = (np.array(table[key]) + shift).tolist()

    def places(value: Any) -> Any:
        if isinstance(value, list):
            return [places(each) for each in value]
        if isinstance(value, dict):
            return value | {"value": places(value["value"])}
        if not isinstance(value, str):
            return value
        return re.sub(r"\b[xyz]\b", lambda at: f"({at[0]} - ({shift['xyz'.index(at[0])]}))", value)

    for body in scene["body"]:
        move(body["mesh"], "origin", "corners", "center")
        loads = [
            one
            for one in (*body.get("clamp", []), *body.get("traction", []))
            if isinstance(one, dict)
        ]
        for table in (body, *loads):
            for key in ("x", "y", "z", "value", "along", "pressure", "volume_force", "temperature"):
                if key in table:
                    table[key] = places(table[key])
    for contact in scene.get("contact", []):
        if isinstance(profile := contact.get("friction", {}).get("slip_bound"), dict):
            along = shift["xyz".index(profile["along"])]
            profile["points"] = [point + along for point in profile["points"]]
        for key, value in contact.get("friction", {}).items():
            if key != "law" and isinstance(value, str):
                contact["friction"][key] = places(value)
    for rigid in scene.get("rigid", []):
        move(rigid, "point", "center", "pivot")
    return scene


# Turned


def turned_clamps(clamp: Any, R: np.ndarray) -> list[Any] | None:
    """A clamp of a turned body: its components are directions. None where it holds anything that is a formula."""
    if isinstance(clamp, str) or "normal" in clamp:
        return [clamp]
    if any(isinstance(value, str) for key, value in clamp.items() if key not in ("on", "history")):
        return None
    kept = {key: clamp[key] for key in ("on", "history") if key in clamp}
    ways = {axis: R[:, "xyz".index(axis)] for axis in "xyz" if axis in clamp}
    if "along" in clamp:
        ways["value"] = R @ clamp["along"]
    return [kept | {"along": way.tolist(), "value": clamp[key]} for key, way in ways.items()]


def turn_mesh(mesh: dict, R: np.ndarray) -> None:
    """A shape that is turned; a rectangle or a box by its corners."""
    for key in mesh.keys() & {"center", "axis"}:
        mesh[key] = (R @ mesh[key]).tolist()
    if "angles" in mesh:
        mesh["angles"] = (np.add(mesh["angles"], np.rad2deg(np.arctan2(R[1, 0], R[0, 0])))).tolist()
    if "origin" in mesh:
        low, size = np.array(mesh.pop("origin")), np.array(mesh.pop("size"))
        unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        if len(R) == 3:
            unit = np.vstack([np.c_[unit, np.zeros(4)], np.c_[unit, np.ones(4)]])
        mesh["shape"] = "quadrilateral" if len(R) == 2 else "hexahedron"
        mesh["corners"] = ((low + unit * size) @ R.T).tolist()


def plain(value: Any) -> Any:
    """The value of a table that has one."""
    return value["value"] if isinstance(value, dict) else value


def turn(scene: dict, kind: Kind, R: np.ndarray) -> dict | None:
    """Turned about the origin; None where a key is none of vectors and normals."""
    scene, d = copy.deepcopy(scene), kind.d
    if kind.axis:
        return None

    def rotate(table: dict, *keys: str) -> bool:
        """Whether these keys are numbers."""
        for key in keys:
            value = table.get(key)
            inner = value if isinstance(value, dict) else table
            name = "value" if isinstance(value, dict) else key
            if isinstance(inner.get(name), list):
                if any(isinstance(one, str) for one in inner[name]):
                    return False
                inner[name] = (R @ inner[name]).tolist()
        return True

    good = True
    for body in scene["body"]:
        material, mesh = body["material"], body["mesh"]
        if "axes" in material or "angle" in material:
            return None  # it turns aside under one stress, so that no side keeps its direction
        if "shear" in material:
            frame = {"angle": 37.0} if d == 2 else {"axes": R.T[:2].tolist()}
            body["material"] = material | frame
        turn_mesh(mesh, R)
        clamps = [turned_clamps(one, R) for one in body.get("clamp", [])]
        good &= None not in clamps
        body["clamp"] = [one for several in clamps for one in several or []]
        good &= rotate(body, "volume_force") and rotate(body.get("motion", {}), "shift")
        good &= not isinstance(plain(body.get("temperature")), str)
        for load in body.get("traction", []):
            good &= rotate(load, "value", "force", "moment")
            good &= not isinstance(load.get("pressure"), str)
    for rigid in scene.get("rigid", []):
        vectors = ("point", "center", "pivot", "axis", "normal", "displacement", "force", "moment")
        rotate(rigid, *vectors)
        good &= "motion" not in rigid  # axes that are free do not turn
    for contact in scene.get("contact", []):
        rotate(contact.get("pretension", {}), "along")
        rotate(contact.get("image", {}), "shift")
        friction = contact.get("friction", {})
        good &= all(isinstance(value, float) for key, value in friction.items() if key != "law")
    return scene if good else None


def otherwise(scene: dict, kind: Kind) -> tuple[dict, Seen]:
    """A scene with all of these changes that it may have, and how its answer is read."""
    seen = Seen()
    if parts := cut(scene, kind):
        scene, seen.cut = parts, True
    if (other := turn(scene, kind, TURN[kind.d])) is not None:
        # before units: corners of the turned block are scaled as the block is
        scene, seen.turn = other, TURN[kind.d]
    seen.shift = SHIFT[: kind.d] * (kind.up if kind.axis else 1.0)
    scene = moved(in_units(permuted(scene), kind, LENGTH, STRESS), seen.shift)
    if seen.cut:
        copied(scene)
    seen.length, seen.stress = LENGTH, STRESS
    seen.force = STRESS * (LENGTH if kind.d == 2 and not kind.axis else LENGTH**2)
    return scene, seen
