"""Scenes of the matrix as decks of Abaqus and CalculiX: one block, or two that touch, are tied or rub.

Elements are quadrilaterals and bricks of first order, which the import cuts into cells of one or two orders.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from decks import grid, step
from kinds import Kind

SETS = {
    2: {"left": "X0", "right": "X1", "bottom": "Y0", "top": "Y1"},
    3: {"left": "X0", "right": "X1", "front": "Y0", "back": "Y1", "bottom": "Z0", "top": "Z1"},
}
"""Groups of a block as `grid` names sets of nodes."""

FACES = {2: {"bottom": 1, "right": 2, "top": 3, "left": 4}, 3: {"bottom": 1, "top": 2}}
"""Sides of an element: in the plane in the order of its nodes."""


def as_deck(scene: dict, kind: Kind) -> str | None:
    """None where the scene has anything else."""
    known = {"body", "contact", "output", "axisymmetric"}
    if kind.steps or not scene.keys() <= known or len(scene.get("contact", [])) > 1:
        return None
    parts, loads = "", []
    for k, body in enumerate(scene["body"]):
        found = block(body, kind, first=1 + 1000 * k)
        if found is None:
            return None
        parts, loads = parts + found[0], loads + found[1]
    for contact in scene.get("contact", []):
        if "image" in contact:
            return None
        joined = pair(contact, scene, kind)
        if joined is None:
            return None
        parts += joined
    return parts + step(*loads)


def block(body: dict, kind: Kind, first: int) -> tuple[str, list[str]] | None:
    """Nodes, elements, material and supports of a block, and the cards of its loads."""
    name, mesh, d = body["name"].upper(), body["mesh"], kind.d
    if mesh["shape"] not in ("rectangle", "box"):
        return None
    n, low, size = mesh["divisions"], mesh["origin"], mesh["size"]
    element = {"strain": "CPE4", "axis": "CAX4", "space": "C3D8"}.get(kind.name, "CPS4")
    text = grid(name, n, size, low, first, element)
    text += f"*NSET, NSET={name}_ALL, GENERATE\n{first}, {first + int(np.prod(np.add(n, 1))) - 1}\n"
    card = material(body["material"], name)
    if card is None or body.keys() - {
        "name", "mesh", "material", "clamp", "traction", "volume_force", "temperature"
    }:  # fmt: skip
        return None
    text += card + f"*SOLID SECTION, ELSET={name}, MATERIAL={name}\n"
    if kind.name == "plate":
        text += f"{kind.thick!r}\n"
    top = range(first + int(np.prod(n)) - int(np.prod(n[:-1])), first + int(np.prod(n)))
    loads = []
    for clamp in body.get("clamp", []):
        held = support(clamp, name, d)
        if held is None:
            return None
        loads += held
    for load in body.get("traction", []):
        *aside, up = load.get("value", [0.0, None])
        pressure = load.get("pressure", -up if isinstance(up, float) else None)
        if load["on"] != "top" or any(aside) or pressure is None:
            return None
        face = f"P{FACES[d]['top']}"
        loads += ["*DLOAD", *(f"{one}, {face}, {pressure!r}" for one in top)]
    if any(
        isinstance(one, str) for one in (*body.get("volume_force", []), body.get("temperature"))
    ):
        return None
    if "volume_force" in body:  # of the density 1
        *aside, up = body["volume_force"]
        way = ["0."] * 3
        way[d - 1] = "1."
        loads += ["*DLOAD", f"{name}, GRAV, {up!r}, {', '.join(way)}"]
    if "temperature" in body:
        loads += ["*TEMPERATURE", f"{name}_ALL, {body['temperature']!r}"]
    return text, loads


def material(given: dict, name: str) -> str | None:
    """Its cards."""
    numbers = [np.atleast_1d(given.get(key, 0.0)).tolist() for key in ("young", "poisson", "shear")]
    if "axes" in given or (len(numbers[2]) == 1 and numbers[2][0]):
        return None  # in the plane a deck has three shear moduli, and a scene has one
    card = f"*MATERIAL, NAME={name}\n*DENSITY\n1.\n"
    if len(numbers[0]) == 3:
        every = [repr(value) for values in numbers for value in values]
        card += "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n"
        card += f"{', '.join(every[:8])},\n{every[8]}\n"
    else:
        card += f"*ELASTIC\n{numbers[0][0]!r}, {numbers[1][0]!r}\n"
    if "expansion" in given:
        if isinstance(given["expansion"], list):
            return None  # which the import refuses
        card += f"*EXPANSION\n{given['expansion']!r}\n"
    return card


def support(clamp: Any, name: str, d: int) -> list[str] | None:
    """The card of a clamp of a side; that of an edge, which only keeps the block where it is, becomes that of a side."""
    if isinstance(clamp, str):
        return ["*BOUNDARY", f"{name}_{SETS[d][clamp]}, 1, {d}"]
    on = "front" if "front" in clamp["on"] else clamp["on"].partition(" ")[0]
    given = {key: clamp[key] for key in "xyz" if key in clamp}
    if len(given) != 1 or not all(isinstance(value, float) for value in given.values()):
        return None
    ((axis, value),) = given.items()
    number = "xyz".index(axis) + 1
    return ["*BOUNDARY", f"{name}_{SETS[d][on]}, {number}, {number}, {value!r}"]


def pair(contact: dict, scene: dict, kind: Kind) -> str | None:
    """The upper block on the lower one, tied or in contact."""
    names = [name.upper() for name in contact["bodies"]]
    if contact.keys() - {"bodies", "on", "friction", "kind"} or len(names) < 2:
        return None
    friction, bonded = contact.get("friction", {}), contact.get("kind") == "bonded"
    if not isinstance(friction.get("coefficient", 0.0), float):
        return None
    if friction.get("law", "coulomb") != "coulomb" or contact.get("kind") == "guided":
        return None
    if contact["on"] != ["bottom", "top"] or len(scene["body"]) != 2:
        return None
    faces = [FACES[kind.d][on] for on in contact["on"]]
    text = "".join(
        f"*SURFACE, NAME=OF_{name}\n{name}_ENDS, S{face}\n"
        for name, face in zip(names, faces, strict=True)
    )
    for k, (name, body) in enumerate(zip(names, scene["body"], strict=True)):
        n = body["mesh"]["divisions"]
        row, begin = int(np.prod(n[:-1])), 1 + 1000 * k
        begin += 0 if k == 0 else int(np.prod(n)) - row
        text = f"*ELSET, ELSET={name}_ENDS, GENERATE\n{begin}, {begin + row - 1}\n" + text
    surfaces = ", ".join(f"OF_{name}" for name in names)
    if bonded:
        return text + f"*TIE, NAME=T\n{surfaces}\n"
    text += "*SURFACE INTERACTION, NAME=I\n"
    if friction:
        text += f"*FRICTION\n{friction['coefficient']!r}\n"
    return text + f"*CONTACT PAIR, INTERACTION=I\n{surfaces}\n"
