"""Random assemblies of solids, the same for the same seed, and an independent check of their result files.

The boxes of a scene are loose or clamped, offset, of unlike stiffness, on meshes that match or not, held together by
friction, bonds or nothing but chance. `violations` reads what a run wrote and knows nothing of how it was computed: the
equilibrium of every body inside and as a whole, and the laws of every contact.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from by_skfem import load_of, stiffness_of
from scipy.optimize import linprog
from skfem import LinearForm
from solid_scenes import HELD, NORMALS, box

from ddmpi.mesh.boundary import boundary_facets
from ddmpi.mesh.mesh import Mesh
from ddmpi.results.tables import Columns, Results, read_results
from ddmpi.scene.bodies import Material

Scene = dict
FAMILIES = ("tower", "row", "bench", "wall")


class Maker:
    """Collects the tables of a scene. Lengths are those of a box, about one."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.order = int(rng.choice([1, 1, 2]))
        self.stress = float(10 ** rng.uniform(4, 6))
        self.contrast = 10 ** rng.uniform(0, 3) if rng.random() < 0.6 else 1.0
        self.matching = rng.random() < 0.3
        self.most = 3 if self.order == 2 else 4
        self.law = str(rng.choice(["coulomb", "coulomb", "mixed", "tresca", "none"], p=[0.4, 0.25, 0.2, 0.1, 0.05]))
        self.coefficient = float(10 ** rng.uniform(-1, np.log10(2.0)))
        self.steps = rng.random() < 0.35
        self.tables: dict[str, list[dict]] = {"body": [], "rigid": [], "contact": []}

    def body(self, origin, size, held: str | None = None, weight: bool = True) -> str:
        """Adds a box; held at one of its faces."""
        rng, name = self.rng, f"b{len(self.tables['body'])}"
        n = (2, 2, 2) if self.matching else rng.integers(1, self.most + 1, 3)
        young = 1e4 * self.stress * self.contrast ** rng.random()
        clamp = {"clamp": [{"on": held} | HELD]} if held else {}
        load = {"volume_force": [0.0, 0.0, -float(self.stress * rng.uniform(0.05, 0.3))]} if weight else {}
        self.tables["body"].append(box(name, origin, size, n, self.order, young, float(rng.uniform(0.0, 0.4)),
                                       traction=[], **clamp, **load))
        return name

    def load(self, name: str, on: str, normal: float, shear: float) -> None:
        """Pressure and shear of random direction, in units of `stress`, with a history in scenes of steps."""
        n, turn = np.array(NORMALS[on], float), self.rng.uniform(0, 2 * np.pi)
        first = np.roll(n, 1)
        along = np.cos(turn) * first + np.sin(turn) * np.cross(n, first)
        (body,) = (each for each in self.tables["body"] if each["name"] == name)
        body["traction"].append({"on": on, "value": (-normal * self.stress * n).tolist()})
        body["traction"].append({"on": on, "value": (shear * self.stress * along).tolist()}
                                | ({"history": "shear"} if self.steps else {}))

    def contact(self, first: str, second: str, on: str, other: str | None = None, bonds: bool = True) -> None:
        law = str(self.rng.choice(["coulomb", "tresca", "none", "bonded" if bonds else "coulomb"])
                  ) if self.law == "mixed" else self.law
        laws = {"bonded": {"kind": "bonded"}, "none": {}, "coulomb": {"friction": {
            "law": "coulomb", "coefficient": self.coefficient}}, "tresca": {"friction": {
                "law": "tresca", "slip_bound": float(self.stress * self.rng.uniform(0.05, 0.5))}}}
        pairing = {"pairing": "mortar"} if self.rng.random() < 0.2 and other else {}
        self.tables["contact"].append({"name": f"c{len(self.tables['contact'])}", "bodies": [first, second],
                                       "on": [on, *([other] if other else [])]} | laws[law] | pairing)

    def floor(self, at: float = 0.0) -> str:
        self.tables["rigid"].append({"name": "floor", "shape": "plane", "point": [0.0, 0.0, at],
                                     "normal": [0.0, 0.0, 1.0]})
        return "floor"

    def base(self, lower: str, size: tuple[float, float]) -> tuple[str, str | None]:
        """What stands below: a rigid floor, or a clamped slab; and its face."""
        if self.rng.random() < 0.5:
            return self.floor(), None
        return self.body((-0.5, -0.5, -0.5), (size[0] + 1.0, size[1] + 1.0, 0.5), "bottom"), "top"

    def scene(self, title: str) -> Scene:
        tables: dict = {"title": title} | {key: value for key, value in self.tables.items() if value}
        if self.steps:
            tables["history"] = {"shear": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 0.0, 1.0, -0.5]}}
            tables["time"] = {"points": [1.0, 2.0, 3.0], "steps": 2}
        return tables


def random_scene(seed: int) -> Scene:
    """A scene as a dict with the keys of its TOML file; its title begins with its family."""
    make, family = Maker(seed), FAMILIES[seed % len(FAMILIES)]
    rng = make.rng

    def shift() -> float:
        return 0.0 if make.matching else float(rng.uniform(-0.3, 0.3))

    shear = float(rng.uniform(0.0, 0.3)) * (0.05 if make.law == "none" else 1.0)
    if family == "tower":
        below, face = make.base("", (1.0, 1.0))
        z, x, y = 0.0, 0.0, 0.0
        for _ in range(rng.integers(2, 5)):
            height = 0.5 if make.matching else float(rng.uniform(0.4, 1.0))
            name = make.body((x, y, z), (1.0, 1.0, height))
            make.contact(name, below, "bottom", face)
            below, face, z, x, y = name, "top", z + height, x + shift(), y + shift()
        make.load(name, "top", float(rng.uniform(0.2, 1.0)), shear)
    elif family == "row":
        count = int(rng.integers(2, 5))
        names = []
        for k in range(count):
            held = {0: "left", count - 1: None if rng.random() < 0.7 else "right"}.get(k)
            names.append(make.body((float(k), shift(), shift()), (1.0, 1.0, 1.0), held, weight=rng.random() < 0.3))
        for a, b in pairwise(names):
            make.contact(a, b, "right", "left")
        if len(make.tables["body"][-1].get("clamp", [])) == 0:
            make.load(names[-1], "right", float(rng.uniform(0.5, 1.5)), shear)
        else:
            make.load(names[count // 2], "top", 0.3, shear)
    elif family == "bench":
        slab, face = make.base("", (2.0, 1.0))
        split = 1.0 if make.matching else float(rng.uniform(0.7, 1.3))
        legs = [make.body((0.0, 0.0, 0.0), (split, 1.0, 1.0)), make.body((split, 0.0, 0.0), (2.0 - split, 1.0, 1.0))]
        top = make.body((shift(), shift(), 1.0), (2.0, 1.0, 0.5))
        for leg in legs:
            make.contact(leg, slab, "bottom", face)
            make.contact(top, leg, "bottom", "top")
        make.contact(*legs, "right", "left")
        make.load(top, "top", float(rng.uniform(0.2, 1.0)), shear)
    else:
        floor = make.floor()
        lower = [make.body((k, 0.0, 0.0), (1.0, 1.0, 0.6)) for k in range(2)]
        upper = [make.body((0.5 * k + min(0.0, shift()), 0.0, 0.6), (1.0 - 0.5 * k, 1.0, 0.6)) for k in range(1)]
        upper.append(make.body((1.0, 0.0, 0.6), (1.0 if make.matching else 0.9, 1.0, 0.6)))
        for name in lower:
            make.contact(name, floor, "bottom")
        make.contact(lower[0], lower[1], "right", "left")
        make.contact(upper[0], lower[0], "bottom", "top")
        make.contact(upper[1], lower[1], "bottom", "top")
        for name in upper:
            make.load(name, "top", float(rng.uniform(0.2, 1.0)), shear / 2)
    return make.scene(f"{family} {seed}, {make.law}, order {make.order}")


# What was written

def factor(scene: Scene, name: str | None, time: float = np.inf) -> float:
    """Of a history."""
    return 1.0 if name is None else float(np.interp(time, *scene["history"][name].values()))


def loads(scene: Scene, body: dict, time: float = np.inf) -> tuple[np.ndarray, np.ndarray, float]:
    """Force and moment about the origin of the loads on a body that is a box, and the sum of their sizes (N)."""
    origin, size = np.array(body["mesh"]["origin"]), np.array(body["mesh"]["size"])
    middle = origin + size / 2
    parts = [(np.prod(size) * np.array(body.get("volume_force", [0.0] * 3)), middle)]
    for each in body["traction"]:
        n = np.array(NORMALS[each["on"]])
        area = np.prod(size[n == 0])
        parts.append((area * factor(scene, each.get("history"), time) * np.array(each["value"]), middle + n * size / 2))
    return (sum(force for force, _ in parts), sum(np.cross(at, force) for force, at in parts),
            sum(np.linalg.norm(force) for force, _ in parts))


def violations(scene: Scene, folder: Path) -> dict[str, float]:
    """The largest violation of each law, relative to the largest force, moment or displacement."""
    results = read_results(folder)
    u = results.displacement()
    largest = np.abs(u).max() or 1.0
    found = {"force": 0.0, "moment": 0.0, "inside": 0.0, "at nodes": 0.0, "apart": 0.0}
    forces = {name: np.stack([table[f"force_{axis}"] for axis in "xyz"], axis=1)
              for name, table in results.contacts.items()}
    size = sum(loads(scene, body)[2] for body in scene["body"])
    size = max(size, *(np.linalg.norm(each, axis=1).sum() for each in forces.values())) or 1.0
    arm = np.abs(results.points).max()
    for number, body in enumerate(scene["body"]):
        force, moment, _ = loads(scene, body)
        held = "clamp" in body
        force = force + (np.array(results.summary["bodies"][body["name"]]["reaction"]) if held else 0.0)
        for contact in scene["contact"]:
            if body["name"] in contact["bodies"]:
                sign = 1.0 if contact["bodies"][0] == body["name"] else -1.0
                force = force + sign * forces[contact["name"]].sum(axis=0)
                moment = moment + sign * np.array(results.summary["contacts"][contact["name"]]["moment"])
        found["force"] = max(found["force"], float(np.abs(force).max()) / size)
        if not held:
            found["moment"] = max(found["moment"], float(np.abs(moment).max()) / (arm * size))
        inside, at_nodes = _residual(scene, results, number, forces, u)
        found["inside"], found["at nodes"] = max(found["inside"], inside), max(found["at nodes"], at_nodes)
    for contact in scene["contact"]:
        table, own = results.contacts[contact["name"]], forces[contact["name"]]
        for law, value in _laws(contact, table, own).items():
            found[law] = max(found.get(law, 0.0), value / (largest if law in MOTIONS else np.abs(own).max() or 1.0))
    return found


MOTIONS = {"penetration", "gap under pressure", "slip against friction", "slip of sticking", "opening of bonds"}
"""Violations that are displacements; the others are forces."""


def _laws(contact: dict, table: Columns, force: np.ndarray) -> dict[str, float]:
    """Violations of the contact's laws at its nodes: forces (N) and displacements (m)."""
    n = np.stack([table[f"n{axis}"] for axis in "xyz"], axis=1)
    slip = np.stack([table[f"slip_{axis}"] for axis in "xyz"], axis=1)
    p = -np.einsum("md,md->m", force, n)
    t = force + p[:, None] * n
    if contact.get("kind") == "bonded":
        return {"opening of bonds": float(max(np.abs(table["gap"]).max(), np.abs(slip).max()))}
    law = contact.get("friction", {"law": "none"})
    bound = {"none": 0.0 * p, "coulomb": law.get("coefficient", 0.0) * p,
             "tresca": law.get("slip_bound", 0.0) * table["area"]}[law["law"]]
    found = {"tension": float(-p.min()), "penetration": float(-table["gap"].min()),
             "gap under pressure": float((np.maximum(p, 0.0) / (np.abs(p).max() or 1.0) * table["gap"]).max())}
    size, moves = np.linalg.norm(t, axis=1), np.linalg.norm(slip, axis=1)
    found["friction bound"] = float((size - bound).max())
    sticks, slips = table["status"] == "stick", table["status"] == "slip"
    found["slip of sticking"] = float(moves[sticks].max(initial=0.0))
    if law["law"] != "none" and slips.any():
        direction = -t[slips] / np.maximum(size[slips], 1e-300)[:, None]
        off = slip[slips] - np.einsum("md,md->m", slip[slips], direction)[:, None] * direction
        back = np.minimum(0.0, np.einsum("md,md->m", slip[slips], direction))
        carries = size[slips] > 1e-9 * np.abs(force).max()
        found["slip against friction"] = float((np.linalg.norm(off, axis=1) - back)[carries].max(initial=0.0))
    return found


def _residual(scene: Scene, results: Results, number: int, forces: dict[str, np.ndarray],
              u: np.ndarray) -> tuple[float, float]:
    """What elasticity leaves of a body, by another program's stiffness, over the largest nodal force: at nodes of no
    clamp and no contact; and, where all of its contacts have pairs of nodes, at those of its contacts."""
    body = scene["body"][number]
    cells = results.fields["cells"][results.fields["body"] == number]
    nodes, cells = np.unique(cells, return_inverse=True)
    mesh = Mesh(results.points[nodes], cells.reshape(-1, results.fields["cells"].shape[1]), {})
    origin, size = np.array(body["mesh"]["origin"]), np.array(body["mesh"]["size"])
    near = 1e-9 * (np.abs(origin).max() + size.max())
    on = {group: np.abs((mesh.points - origin - size * (np.array(n) > 0))[:, np.argmax(np.abs(n))]) < near
          for group, n in NORMALS.items()}
    residual = -(stiffness_of(mesh, Material(**body["material"])) @ u[nodes].ravel())
    weight = np.array(body.get("volume_force", [0.0] * 3))
    residual += load_of(mesh, LinearForm(lambda v, w: sum(q * v[k] for k, q in enumerate(weight))))
    facets = boundary_facets(mesh.triangles)[0]
    for each in body["traction"]:
        value = factor(scene, each.get("history")) * np.array(each["value"])
        residual += load_of(mesh, LinearForm(lambda v, w, value=value: sum(q * v[k] for k, q in enumerate(value))),
                            on=facets[on[each["on"]][facets].all(axis=1)])
    residual = residual.reshape(-1, 3)
    free, exact, largest = np.ones(len(nodes), bool), mesh.order == 1, np.abs(residual).max() or 1.0
    for clamp in body.get("clamp", []):
        free &= ~on[clamp["on"]]
    touched = np.zeros(len(nodes), bool)
    for contact in scene["contact"]:
        if body["name"] not in contact["bodies"]:
            continue
        touched |= on[contact["on"][contact["bodies"].index(body["name"])]]
        exact &= results.summary["contacts"][contact["name"]]["pairing"] == "nodes"
        if exact:
            table, sign = results.contacts[contact["name"]], 1.0 if contact["bodies"][0] == body["name"] else -1.0
            places = np.stack([table[axis] for axis in "xyz"], axis=1)
            node = np.linalg.norm(mesh.points[:, None] - places[None], axis=2).argmin(axis=0)
            np.add.at(residual, node, sign * forces[contact["name"]])
    inside = np.abs(residual[free & ~touched]).max(initial=0.0) / largest
    return float(inside), float(np.abs(residual[free]).max(initial=0.0) / largest) if exact else 0.0


# Whether forces at the corners of contacts can hold the bodies

SIDES = 16

GRID = (np.arange(4) + 0.5) / 4
"""Where Tresca's friction acts along each side of what faces cover of each other."""

REACH = 0.6
"""Part of a cell by which the nodes of a mesh may bear beyond the edge of a contact, or end before it: rows that cover
less than 15 % of their area are shared with their neighbours."""


def feasible(scene: Scene, reach: float = 0.0) -> bool:
    """Whether forces within the cones of friction, where faces cover each other, hold all bodies at all times.

    Where they do not there is no equilibrium. Pressure acts at the corners; `reach` is the part of a cell by which they
    lie farther out, as nodes of meshes do that do not match. Cones are pyramids of 16 sides around discs.
    """
    return all(_feasible(scene, time, reach) for time in np.arange(1.0, 3.1, 0.25 if "time" in scene else 3.0))


def _feasible(scene: Scene, at: float, reach_of_nodes: float) -> bool:
    """The same at one time."""
    boxes = {body["name"]: body for body in scene["body"]}
    loose = [name for name, body in boxes.items() if "clamp" not in body]
    rows = {name: slice(6 * k, 6 * k + 6) for k, name in enumerate(loose)}
    angles = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    reach = 1.0 / np.cos(np.pi / SIDES)
    columns, signed = [], []
    capped: list[tuple[list[int], float]] = []
    for contact in scene["contact"]:
        first, n = boxes[contact["bodies"][0]], np.array(NORMALS[contact["on"][0]], float)
        places, area = _overlap(first, boxes.get(contact["bodies"][1]), n, reach_of_nodes)
        axes = np.eye(3)[n == 0]
        law = contact.get("friction", {"law": "none"})
        bonded = contact.get("kind") == "bonded"
        round_about = [np.cos(a) * axes[0] + np.sin(a) * axes[1] for a in angles]
        if bonded:
            rays = [(place, force, True) for place in places for force in (n, *axes)]
        elif law["law"] == "coulomb":
            rays = [(place, -n + reach * law["coefficient"] * t, False) for place in places for t in round_about]
        else:
            rays = [(place, -n, False) for place in places]
        if law["law"] == "tresca":
            for u in GRID:
                for v in GRID:
                    start = len(columns) + len(rays)
                    capped.append((list(range(start, start + SIDES)), reach * law["slip_bound"] * area / len(GRID)**2))
                    middle = places[0] + u * (places[1] - places[0]) + v * (places[3] - places[0])
                    rays += [(middle, along, False) for along in round_about]
        for place, force, free in rays:
            column = np.zeros(6 * len(loose))
            for name, sign in zip(contact["bodies"], (1.0, -1.0), strict=True):
                if name in rows:
                    column[rows[name]] += sign * np.concatenate([force, np.cross(place, force)])
            columns.append(column)
            signed.append((None if free else 0, None))
    wanted = np.zeros(6 * len(loose))
    for name in loose:
        force, moment, _ = loads(scene, boxes[name], at)
        wanted[rows[name]] = -np.concatenate([force, moment])
    bounds = np.zeros((len(capped), len(columns)))
    for k, (some, _) in enumerate(capped):
        bounds[k, some] = 1.0
    scale = np.abs(wanted).max(initial=0.0)
    if scale == 0.0:
        return True
    found = linprog(np.zeros(len(columns)), bounds if capped else None,
                    [most / scale for _, most in capped] if capped else None,
                    np.array(columns).T, wanted / scale, signed, method="highs")
    return found.status == 0


def _overlap(first: dict, second: dict | None, n: np.ndarray, reach: float) -> tuple[np.ndarray, float]:
    """The corners (4, 3) of what a face of a box with the normal n has in common with another box, and its area.

    The corners lie farther out by `reach` of a cell, or farther in.
    """
    low, size = np.array(first["mesh"]["origin"]), np.array(first["mesh"]["size"])
    high = low + size
    if second:
        other = np.array(second["mesh"]["origin"])
        far = other + np.array(second["mesh"]["size"])
    else:
        other, far = low, high
    start, end = np.maximum(low, other), np.minimum(high, far)
    k = int(np.argmax(np.abs(n)))
    start[k] = end[k] = high[k] if n[k] > 0 else low[k]
    i, j = (axis for axis in range(3) if axis != k)
    area = float((end[i] - start[i]) * (end[j] - start[j]))
    if second:
        cell = np.max([np.divide(each["mesh"]["size"], each["mesh"]["divisions"]) for each in (first, second)], axis=0)
        more = np.maximum(reach * cell * (n == 0), -(end - start) / 2)
        start, end = start - more, end + more
    places = np.array([start] * 4)
    places[1:3, i], places[2:, j] = end[i], end[j]
    return places, area
