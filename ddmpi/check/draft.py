"""A first scene from an assembly that a CAD program has written: its parts, and contacts where they touch."""

import os
import re
from pathlib import Path

import msgspec

from ddmpi.check.nearby import Boundary, find_missing
from ddmpi.errors import TakenError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.geometry import list_parts
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.reader import write_toml

STEEL = {"young": 210000.0, "poisson": 0.3}
"""The material of all parts until a user says otherwise (MPa); gmsh reads CAD files in millimetres."""

NAMELESS = "Open CASCADE STEP translator"
"""Beginning of the labels of parts to which nobody has given a name."""

FINE = 10.0
"""A part's extent over the size of its elements, which are quadratic, and half as large at contacts."""


def draft_scene(assembly: str | Path, output: str | Path) -> str:
    """Write ``scene.toml`` for a .step or .brep file into a folder: a body for each part, and a contact where two face
    each other closely. What was taken, what was assumed and what is to be added, in words. Not collective.

    Raises InputError for a file that gmsh cannot read or mesh, and TakenError where a scene would be overwritten.
    """
    path, folder = Path(assembly).resolve(), Path(output)
    target = folder / "scene.toml"
    if target.exists():
        raise TakenError(f"{target} is there already; nothing is overwritten; choose another --output")
    dimension, parts = list_parts(path, path.name)
    bodies, words, boundaries = list[dict](), list[str](), dict[str, Boundary]()
    labels = [label for _, label, _ in parts]
    for number, label, extent in parts:
        alone = labels.count(label) == 1 and bool(label) and not label.startswith(NAMELESS)
        name = re.sub(r"[.=/\s\x00-\x1f\x7f]+", "_", "part" if label.startswith(NAMELESS) else label)[:80].strip("_")
        name = name if alone and name and name not in boundaries else f"{name or 'part'}_{number}"
        size = float(f"{extent / FINE:.1g}")
        mesh = {"geometry": str(path), "part": label if alone else number, "size": size, "contact_size": size / 2,
                "order": 2}
        body = {"name": name, "mesh": mesh, "material": STEEL}
        boundaries[name] = Boundary.of(build_mesh(msgspec.convert(body, BodySpec).settled(1, dimension)))
        words.append(f"  part {number}: {name}, quadratic elements of {size:g} mm")
        bodies.append(body | {"mesh": mesh | {"geometry": os.path.relpath(path, folder.resolve())}})
    missing, taken = list(find_missing(boundaries, [], [])), set[str]()
    units = {"length_unit": "mm", "stress_unit": "MPa"}
    text = write_toml({"title": path.stem, "body": bodies, "output": units})
    contacts = "".join(f"\n{lack.lines(taken)}\n" for lack in missing)
    folder.mkdir(parents=True, exist_ok=True)
    target.write_text(f"# from {path.name}; assumed: steel, MPa and mm; to be added: clamps, loads, friction\n"
                      f"{text}{contacts}", encoding="utf-8")
    return "\n".join([
        "taken:", *words, *(f"  contact of {' and '.join(lack.bodies)}: on = {lack.sides}" for lack in missing),
        "assumed:", f"  young = {STEEL['young']:g} MPa, poisson = {STEEL['poisson']:g}, lengths in mm",
        "to be added:", f"  materials, clamps, loads and friction, on faces by their numbers: ddmpi check {target}",
        f"{target}: {len(bodies)} bodies, {len(missing)} contacts"])
