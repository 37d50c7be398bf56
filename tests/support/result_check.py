"""An independent check of what a run of an assembly wrote, in the plane and in space.

`violations` reads the files and knows nothing of how they were computed: the equilibrium of every body inside and as a
whole, by another program's stiffness, its clamps, and the laws of every contact. `feasible` says whether forces can
hold the bodies at all. Bodies are quadrilaterals, or boxes along the axes; a rigid partner is a plane.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from by_skfem import default_stiffness_of, load_of
from elsewhere import corners
from scipy.optimize import linprog
from skfem import LinearForm

from ddmpi.mesh.boundary import boundary_facets
from ddmpi.mesh.mesh import Mesh
from ddmpi.results.tables import Columns, Results, read_results
from ddmpi.scene.bodies import Material

Scene = dict

FACES = {
    2: {"bottom": (0, 1), "right": (1, 2), "top": (2, 3), "left": (3, 0)},
    3: {
        "left": (0, 3, 7, 4),
        "right": (1, 2, 6, 5),
        "front": (0, 1, 5, 4),
        "back": (3, 2, 6, 7),
        "bottom": (0, 1, 2, 3),
        "top": (4, 5, 6, 7),
    },
}
"""The corners of faces, around them."""

NOTHING = 1e-6
"""Forces below this fraction of the scene's are compared with it: bodies and contacts without forces have rounding."""

MOTIONS = {
    "penetration",
    "gap under pressure",
    "slip against friction",
    "slip of sticking",
    "opening of bonds",
    "clamps",
}
"""Violations that are displacements; the others are forces."""


# What was written


def factor(scene: Scene, name: str | None, time: float = np.inf) -> float:
    """Of a history."""
    return 1.0 if name is None else float(np.interp(time, *scene["history"][name].values()))


def face(body: dict, group: str) -> tuple[np.ndarray, np.ndarray]:
    """The corners (k, d) of a face of a body, and its outer normal (d,)."""
    at = corners(body["mesh"])
    on = at[list(FACES[at.shape[1]][group])]
    edges = on[1:] - on[0]
    normal = np.array([edges[0, 1], -edges[0, 0]]) if len(on) == 2 else np.cross(edges[0], edges[2])
    return on, normal / np.linalg.norm(normal) * np.sign(normal @ (on[0] - at.mean(axis=0)))


def turning(place: np.ndarray, force: np.ndarray) -> np.ndarray:
    """The moment (1,) or (3,) of a force about the origin."""
    return (
        np.cross(place, force)
        if len(place) == 3
        else np.array([place[0] * force[1] - place[1] * force[0]])
    )


def loads(scene: Scene, body: dict, time: float = np.inf) -> tuple[np.ndarray, np.ndarray, float]:
    """Force and moment about the origin of the loads on a body, and the sum of their sizes (N, in the plane N/m)."""
    at = corners(body["mesh"])
    if at.shape[1] == 2:
        a, b = at, np.roll(at, -1, axis=0)
        twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        size, middle = twice.sum() / 2, (twice @ (a + b)) / (3 * twice.sum())
    else:
        size, middle = np.prod(at[6] - at[0]), at.mean(axis=0)
    parts = [(size * np.array(body.get("volume_force", 0.0 * middle)), middle)]
    for each in body.get("traction", []):
        on, _ = face(body, each["on"])
        area = np.prod([np.linalg.norm(on[k] - on[0]) for k in (1, -1)[: len(middle) - 1]])
        parts.append(
            (
                area * factor(scene, each.get("history"), time) * np.array(each["value"]),
                on.mean(axis=0),
            )
        )
    return (
        sum(force for force, _ in parts),
        sum(turning(place, force) for force, place in parts),
        sum(np.linalg.norm(force) for force, _ in parts),
    )


def violations(scene: Scene, folder: Path) -> dict[str, float]:
    """The largest violation of each law, relative to the largest force, moment or displacement."""
    results = read_results(folder)
    u = results.displacement()
    axes, largest = "xyz"[: u.shape[1]], np.abs(u).max() or 1.0
    found = dict.fromkeys(("force", "moment", "inside", "at nodes", "clamps"), 0.0)
    forces = {name: contact_forces(table, axes) for name, table in results.contacts.items()}
    size = (
        max(
            sum(loads(scene, body)[2] for body in scene["body"]),
            *(np.linalg.norm(each, axis=1).sum() for each in forces.values()),
        )
        or 1.0
    )
    arm = np.abs(results.points).max()
    for number, body in enumerate(scene["body"]):
        force, moment, _ = loads(scene, body)
        held = bool(body.get("clamp"))
        force = force + (
            np.array(results.summary["bodies"][body["name"]]["reaction"]) if held else 0.0
        )
        for contact in scene["contact"]:
            if body["name"] in contact["bodies"]:
                sign = 1.0 if contact["bodies"][0] == body["name"] else -1.0
                force = force + sign * forces[contact["name"]].sum(axis=0)
                moment = moment + sign * np.array(
                    results.summary["contacts"][contact["name"]]["moment"]
                )
        told = {
            "force": np.abs(force).max() / size,
            "moment": 0.0 if held else np.abs(moment).max() / (arm * size),
        }
        told |= _residual(scene, results, number, forces, u, NOTHING * size)
        told["clamps"] /= largest
        found = {law: max(value, float(told[law])) for law, value in found.items()}
    for contact in scene["contact"]:
        table, own = results.contacts[contact["name"]], forces[contact["name"]]
        for law, value in laws(contact, table, own, NOTHING * size).items():
            least = largest if law in MOTIONS else max(np.abs(own).max(), NOTHING * size) or 1.0
            found[law] = max(found.get(law, 0.0), value / least)
    return found


def normals(table: Columns, axes: str) -> np.ndarray:
    return np.stack([table[f"n{axis}"] for axis in axes], axis=1)


def along(table: Columns, axes: str, column: str) -> np.ndarray:
    """A tangential quantity (m, d) of a contact's table, in the plane a number along (−ny, nx)."""
    if len(axes) == 3:
        return np.stack([table[f"{column}_{axis}"] for axis in axes], axis=1)
    return table[column][:, None] * normals(table, axes)[:, ::-1] * [-1.0, 1.0]


def contact_forces(table: Columns, axes: str) -> np.ndarray:
    """(m, d) on the first body."""
    if len(axes) == 3:
        return along(table, axes, "force")
    return -table["normal_force"][:, None] * normals(table, axes) - along(
        table, axes, "tangential_force"
    )


def laws(contact: dict, table: Columns, force: np.ndarray, nothing: float) -> dict[str, float]:
    """Violations of the contact's laws at its nodes: forces (N) and displacements (m). Forces below `nothing` are none."""
    axes = "xyz"[: force.shape[1]]
    n, slip = normals(table, axes), along(table, axes, "slip")
    p = -np.einsum("md,md->m", force, n)
    t = force + p[:, None] * n
    if contact.get("kind") == "bonded":
        return {"opening of bonds": float(max(np.abs(table["gap"]).max(), np.abs(slip).max()))}
    law = contact.get("friction", {"law": "none"})
    bound = {
        "none": 0.0 * p,
        "coulomb": law.get("coefficient", 0.0) * p,
        "tresca": law.get("slip_bound", 0.0) * table["area" if "area" in table else "length"],
    }[law["law"]]
    found = {
        "tension": float(-p.min()),
        "penetration": float(-table["gap"].min()),
        "gap under pressure": float((np.maximum(p, 0.0) * table["gap"]).max())
        / (max(np.abs(p).max(), nothing) or 1.0),
    }
    size, moves = np.linalg.norm(t, axis=1), np.linalg.norm(slip, axis=1)
    found["friction bound"] = float((size - bound).max())
    sticks, slips = table["status"] == "stick", table["status"] == "slip"
    found["slip of sticking"] = float(moves[sticks].max(initial=0.0))
    if law["law"] != "none" and slips.any():
        direction = -t[slips] / np.maximum(size[slips], 1e-300)[:, None]
        off = slip[slips] - np.einsum("md,md->m", slip[slips], direction)[:, None] * direction
        back = np.minimum(0.0, np.einsum("md,md->m", slip[slips], direction))
        carries = size[slips] > 1e-9 * np.abs(force).max()
        found["slip against friction"] = float(
            (np.linalg.norm(off, axis=1) - back)[carries].max(initial=0.0)
        )
    return found


def _residual(
    scene: Scene,
    results: Results,
    number: int,
    forces: dict[str, np.ndarray],
    u: np.ndarray,
    nothing: float,
) -> dict[str, float]:
    """What elasticity leaves of a body, by another program's stiffness, over its largest nodal force or `nothing`.

    Inside, at nodes of no clamp and no contact; and, where all of its contacts have pairs of nodes, also at those of
    its contacts. And how far its clamped nodes are from where clamps hold them.
    """
    body, d = scene["body"][number], u.shape[1]
    cells = results.fields["cells"][results.fields["body"] == number]
    nodes, cells = np.unique(cells, return_inverse=True)
    mesh = Mesh(results.points[nodes], cells.reshape(-1, results.fields["cells"].shape[1]), {})
    at = corners(body["mesh"])
    near = 1e-9 * (np.abs(at).max() + np.ptp(at, axis=0).max())
    on = {
        group: np.abs((mesh.points - place[0]) @ normal) < near
        for group in FACES[d]
        for place, normal in [face(body, group)]
    }
    residual = -(default_stiffness_of(mesh, Material(**body["material"])) @ u[nodes].ravel())
    acting = [(None, body.get("volume_force", [0.0] * d))]
    acting += [
        (each["on"], factor(scene, each.get("history")) * np.array(each["value"]))
        for each in body.get("traction", [])
    ]
    facets = boundary_facets(mesh.triangles, d)[0]
    for group, value in acting:
        form = LinearForm(lambda v, w, value=value: sum(q * v[k] for k, q in enumerate(value)))
        part = None if group is None else facets[on[group][facets].all(axis=1)]
        residual += load_of(mesh, form, on=part)
    residual = residual.reshape(-1, d)
    exact, largest, touched = (
        mesh.order == 1,
        max(np.abs(residual).max(), nothing) or 1.0,
        np.zeros(len(nodes), bool),
    )
    clamped, off = np.zeros(len(nodes), bool), 0.0
    for clamp in body.get("clamp", []):
        clamp = {"on": clamp} | dict.fromkeys("xyz"[:d], 0.0) if isinstance(clamp, str) else clamp
        clamped |= on[clamp["on"]]
        for k, axis in enumerate("xyz"[:d]):
            if axis in clamp:
                given = factor(scene, clamp.get("history")) * clamp[axis]
                off = max(off, np.abs(u[nodes[on[clamp["on"]]], k] - given).max(initial=0.0))
    for contact in scene["contact"]:
        if body["name"] not in contact["bodies"]:
            continue
        touched |= on[contact["on"][contact["bodies"].index(body["name"])]]
        exact &= results.summary["contacts"][contact["name"]]["pairing"] == "nodes"
        if exact:
            table, sign = (
                results.contacts[contact["name"]],
                1.0 if contact["bodies"][0] == body["name"] else -1.0,
            )
            places = np.stack([table[axis] for axis in "xyz"[:d]], axis=1)
            node = np.linalg.norm(mesh.points[:, None] - places[None], axis=2).argmin(axis=0)
            np.add.at(residual, node, sign * forces[contact["name"]])
    return {
        "inside": np.abs(residual[~clamped & ~touched]).max(initial=0.0) / largest,
        "at nodes": np.abs(residual[~clamped]).max(initial=0.0) / largest if exact else 0.0,
        "clamps": off,
    }


# Whether forces at the corners of contacts can hold the bodies

SIDES = 16
"""Of the pyramids around cones of friction in space; in the plane two rays are the cone."""

GRID = (np.arange(4) + 0.5) / 4
"""Where Tresca's friction acts along each side of what faces cover of each other."""

REACH = 0.6
"""Part of a cell by which the nodes of a mesh may bear beyond the edge of a contact, or end before it: rows that cover
less than 15 % of their area are shared with their neighbours."""


def feasible(scene: Scene, reach: float = 0.0, times: tuple[float, ...] | None = None) -> bool:
    """Whether forces within the cones of friction, where faces cover each other, hold all bodies at all times.

    Where they do not there is no equilibrium. Pressure acts at the corners; `reach` is the part of a cell by which they
    lie farther out, as nodes of meshes do that do not match.
    """
    if times is None:
        times = tuple(np.arange(1.0, 3.1, 0.25)) if "time" in scene else (np.inf,)
    return all(_feasible(scene, time, reach) for time in times)


def _feasible(scene: Scene, time: float, reach: float) -> bool:
    """The same at one time, by linear programming."""
    bodies = {body["name"]: body for body in scene["body"]}
    loose = [name for name, body in bodies.items() if not body.get("clamp")]
    d = len(corners(scene["body"][0]["mesh"])[0])
    k = d * (d + 1) // 2
    rows = {name: slice(k * i, k * i + k) for i, name in enumerate(loose)}
    columns, signed, capped, most = [], [], [], []
    for contact in scene["contact"]:
        places, axes, area, normal = _patch(contact, bodies, reach)
        angles = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES if d == 3 else np.array([0.0, np.pi])
        tangents = np.column_stack([np.cos(angles), np.sin(angles)])[:, : d - 1] @ axes
        around = 1.0 / np.cos(np.pi / SIDES) if d == 3 else 1.0  # the pyramid is around the cone
        law = contact.get("friction", {"law": "none"})
        if contact.get("kind") == "bonded":
            rays = [(place, force, True) for place in places for force in (normal, *axes)]
        elif law["law"] == "coulomb":
            rays = [
                (place, -normal + around * law["coefficient"] * t, False)
                for place in places
                for t in tangents
            ]
        else:
            rays = [(place, -normal, False) for place in places]
        if law["law"] == "tresca":
            spans = places[[1, 3][: d - 1]] - places[0]
            for shares in itertools.product(GRID, repeat=d - 1):
                start = len(columns) + len(rays)
                capped.append(range(start, start + len(tangents)))
                most.append(around * law["slip_bound"] * area / len(GRID) ** (d - 1))
                rays += [(places[0] + np.array(shares) @ spans, t, False) for t in tangents]
        for place, force, free in rays:
            column = np.zeros(k * len(loose))
            for name, sign in zip(contact["bodies"], (1.0, -1.0), strict=True):
                if name in rows:
                    column[rows[name]] += sign * np.concatenate([force, turning(place, force)])
            columns.append(column)
            signed.append((None if free else 0, None))
    wanted = np.zeros(k * len(loose))
    for name in loose:
        wanted[rows[name]] = -np.concatenate(loads(scene, bodies[name], time)[:2])
    scale = np.abs(wanted).max(initial=0.0)
    if scale == 0.0:
        return True
    return has_forces(columns, signed, capped, np.array(most) / scale, wanted / scale)


def has_forces(
    columns: Sequence[np.ndarray],
    limits: Sequence[tuple[float | None, None]],
    capped: Sequence[Iterable[int]],
    most: np.ndarray,
    wanted: np.ndarray,
) -> bool:
    """Whether factors of `columns` within `limits` add up to `wanted`, sums of those `capped` at `most`."""
    bounds = np.zeros((len(capped), len(columns)))
    for row, some in zip(bounds, capped, strict=True):
        row[list(some)] = 1.0
    found = linprog(
        np.zeros(len(columns)),
        bounds if capped else None,
        most if capped else None,
        np.array(columns).T,
        wanted,
        limits,
        method="highs",
    )
    return found.status == 0


def _patch(
    contact: dict, bodies: dict, reach: float
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Of what the faces of a contact have in common: its corners (2 or 4, d), which lie farther out by `reach` of a
    cell, the axes (d − 1, d) along it, its length or area, and the first body's normal."""
    first, second = (bodies.get(name) for name in contact["bodies"])
    on, normal = face(first, contact["on"][0])
    axes = np.stack([on[k] - on[0] for k in (1, -1)[: len(normal) - 1]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    low, high = ((bound((on - on[0]) @ axes.T, axis=0)) for bound in (np.min, np.max))
    if second:
        other = (face(second, contact["on"][1])[0] - on[0]) @ axes.T
        low, high = np.maximum(low, other.min(axis=0)), np.minimum(high, other.max(axis=0))
    area = float(np.prod(high - low))
    if second and reach:
        cell = np.max(
            [
                np.abs(np.ptp(corners(each["mesh"]), axis=0) / each["mesh"]["divisions"] @ axes.T)
                for each in (first, second)
            ],
            axis=0,
        )
        more = np.maximum(reach * cell, -(high - low) / 2)
        low, high = low - more, high + more
    ends = (
        np.array([[low[0]], [high[0]]])
        if len(low) == 1
        else np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    )
    return on[0] + ends @ axes, axes, area, normal
