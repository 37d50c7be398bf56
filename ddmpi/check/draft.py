"""A first scene from an assembly that a CAD program has written: its parts, equal ones as copies, contacts where they
touch, and its bolts."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from ddmpi.check.bolts import Bolt, find_bolts, is_of_shank
from ddmpi.check.nearby import Boundaries, Boundary, Missing, find_missing, free_name
from ddmpi.mesh.alike import Drawn, list_drawn
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.reader import write_toml
from ddmpi.system.files import refuse_taken

STEEL = {"young": 210000.0, "poisson": 0.3}
"""The material of all parts until a user says otherwise (MPa); gmsh reads CAD files in millimetres."""

NAMELESS = "Open CASCADE STEP translator"  # beginning of the labels of parts to which nobody has given a name
FINE = 10.0  # a part's extent over the size of its elements, which are quadratic, and half as large at contacts
LONGEST = 80  # characters of a name

MISSING_FORCE = "  # to be filled in: force = …, the tension of the bolt (N)"


def draft_scene(assembly: str | Path, output: str | Path) -> str:
    """Write ``scene.toml`` for a .step or .brep file into a folder: a body for each part, those that are equal as copies
    of the first one, a contact where two face each other closely, and bonded threads of bolts, whose pretension is to be
    filled in. What was taken, what was assumed and what is to be added, in words. Not collective.

    Raises InputError for a file that gmsh cannot read or mesh, and TakenError where a scene would be overwritten.
    """
    path = Path(assembly).resolve()
    folder = Path(output)
    target = folder / "scene.toml"
    refuse_taken(target)
    dimension, parts = list_drawn(path, path.name)
    bodies, words = _bodies(parts, os.path.relpath(path, folder.resolve()))
    boundaries = _boundaries(parts, bodies, path, dimension)
    missing = [
        lack for lack in find_missing(boundaries, [], []) if lack.bodies[0] != lack.bodies[1]
    ]
    bolts = find_bolts(boundaries, missing)
    missing = [lack for lack in missing if not is_of_shank(lack, bolts)]
    units = {"length_unit": "mm", "stress_unit": "MPa"}
    text = write_toml({"title": path.stem, "body": bodies, "output": units})
    taken = set[str]()
    contacts = list[str]()
    for lack in missing:
        contacts.append(lack.lines(taken))
        words.append(f"  contact of {' and '.join(lack.bodies)}: on = {lack.sides}")
    for bolt in bolts:
        thread = _thread(bolt, boundaries)
        pull = bolt.pretension
        lines = thread.lines(taken, f"{bolt.bodies[1]}-thread", kind="bonded", pretension=pull)
        contacts.append(lines + MISSING_FORCE * bool(pull))
        words.append(f"  thread of {bolt.bodies[1]} in {bolt.bodies[0]}: on = {thread.sides}")
    folder.mkdir(parents=True, exist_ok=True)
    target.write_text(
        "# assumed: steel, MPa and mm; to be added: clamps, loads, friction, forces of bolts\n"
        + "\n".join([text, *(f"{lines}\n" for lines in contacts)]),
        encoding="utf-8",
    )
    forces = ", forces of bolts (# to be filled in)" * any(bolt.pretension for bolt in bolts)
    return "\n".join(
        [
            "taken:",
            *words,
            "assumed:",
            f"  young = {STEEL['young']:g} MPa, poisson = {STEEL['poisson']:g}, lengths in mm",
            "to be added:",
            f"  materials, clamps, loads and friction{forces}; faces and their words: ddmpi check {target}",
            f"{target}: {len(bodies)} bodies, {len(contacts)} contacts",
        ]
    )


def _bodies(parts: Sequence[Drawn], geometry: str) -> tuple[list[dict], list[str]]:
    """The bodies of a scene, and words about them."""
    labels = [part.label for part in parts]
    bodies = list[dict]()
    words = list[str]()
    names = dict[int, str]()
    taken = set[str]()
    for part in parts:
        alone = labels.count(part.label) == 1 and bool(part.label)
        alone &= not part.label.startswith(NAMELESS)
        name = names[part.number] = free_name(_name(part, alone), taken)
        if part.copy:
            of = names[int(part.copy.of)]
            copy = msgspec.structs.replace(part.copy, of=of)
            bodies.append({"name": name, "copy": {"of": of} | msgspec.to_builtins(copy)})
            words.append(f"  part {part.number}: {name}, a copy of {of}")
            continue
        size = float(f"{part.extent / FINE:.1g}")
        mesh = {"geometry": geometry, "part": part.label if alone else part.number, "size": size}
        mesh |= {"contact_size": size / 2, "order": 2}
        bodies.append({"name": name, "mesh": mesh, "material": STEEL})
        words.append(f"  part {part.number}: {name}, quadratic elements of {size:g} mm")
    return bodies, words


def _name(part: Drawn, alone: bool) -> str:
    """A name of letters, digits and dashes for a part, with its number unless its label is its `alone`."""
    label = "part" if part.label.startswith(NAMELESS) else part.label
    name = re.sub(r"[^\w-]+", "_", label)[:LONGEST].strip("_") or "part"
    return name if alone and name != "part" else f"{name}_{part.number}"


def _boundaries(
    parts: Sequence[Drawn], bodies: Sequence[dict], path: Path, dimension: int
) -> dict[str, Boundary]:
    """The boundaries of bodies by name; of equal ones one is meshed."""
    meshes = dict[str, Mesh]()
    boundaries = dict[str, Boundary]()
    for part, body in zip(parts, bodies, strict=True):
        if part.copy:
            frame = part.copy.frame(1.0, dimension)
            mesh = meshes[body["copy"]["of"]].turned(frame.turned).shifted(frame.shift.tolist())
        else:
            drawn = body | {"mesh": body["mesh"] | {"geometry": str(path), "order": 1}}
            mesh = build_mesh(msgspec.convert(drawn, BodySpec).settled(1, dimension))
        meshes[body["name"]] = mesh
        boundaries[body["name"]] = Boundary.of(mesh)
    return boundaries


def _thread(bolt: Bolt, boundaries: Boundaries) -> Missing:
    """The contact of a bolt's thread."""
    on = tuple("+".join(faces) for faces in bolt.on)
    faces = [boundaries[name].faces for name in bolt.bodies]
    return Missing(bolt.bodies, on, np.empty((0, 3, 3)), (0.0, 0.0), faces)
