"""An independent check of what a run of bodies that touch themselves or images, or stand on skew supports, wrote.

`violations` reads the files: the equilibrium of all bodies by another program's stiffness, with contact forces on both
sides of each pair of nodes, turned back where the second is an image; gaps and slips by the displacements; clamps along
any direction; the laws of contact and friction; and sums over a wheel. `feasible` says whether forces at the nodes of
clamps and contacts can hold the bodies at all. Sides are straight.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import result_check
from by_skfem import default_stiffness_of, load_of
from result_check import (
    NOTHING,
    SIDES,
    along,
    contact_forces,
    factor,
    has_forces,
    normals,
    turning,
)
from skfem import LinearForm

from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.results.tables import Results, read_results
from ddmpi.scene.bodies import BodySpec, Material

Scene = dict

REACH = 0.0
"""Forces act at nodes: no other reach is asked."""


def mesh_of(scene: Scene, body: dict) -> Mesh:
    """The mesh of a body with nodal groups of all that acts on it."""
    ends = [
        on
        for contact in scene["contact"]
        for name, on in zip(contact["bodies"], contact["on"], strict=False)
        if name == body["name"]
    ]
    return build_mesh(msgspec.convert(body, BodySpec), contacts=sorted(set(ends)))


class Motion:
    """Where a contact's second side is met: x at Q (x − pivot) + pivot + shift."""

    def __init__(self, image: dict | None, d: int) -> None:
        image = image or {}
        turn = np.radians(image.get("turn", 0.0))
        self.Q = np.eye(d)
        self.Q[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        self.pivot = np.array(image.get("pivot", [0.0] * d))
        self.shift = np.array(image.get("shift", [0.0] * d))

    def of(self, places: np.ndarray) -> np.ndarray:
        return (places - self.pivot) @ self.Q.T + self.pivot + self.shift

    def back(self, places: np.ndarray) -> np.ndarray:
        return (places - self.shift - self.pivot) @ self.Q + self.pivot


def loads(mesh: Mesh, body: dict, scene: Scene, time: float = np.inf) -> np.ndarray:
    """Nodal forces (nv, d) of the loads on a body."""
    d = mesh.dimension
    acting = [(None, body.get("volume_force", [0.0] * d))]
    for each in body.get("traction", []):
        size = factor(scene, each.get("history"), time)
        acting.append((mesh.groups[each["on"]], [size * value for value in each["value"]]))

    def at(value, w) -> np.ndarray:
        places = dict(zip("xyz", w.x, strict=False))
        return eval(value, {}, places) if isinstance(value, str) else value

    total = np.zeros(mesh.points.size)
    for on, value in acting:
        form = LinearForm(
            lambda v, w, value=value: sum(at(q, w) * v[k] for k, q in enumerate(value))
        )
        total += load_of(mesh, form, on=on)
    return total.reshape(-1, d)


def supports(mesh: Mesh, body: dict, scene: Scene) -> list[tuple[int, np.ndarray, float]]:
    """Clamped nodes, unit directions (d,) and displacements along them."""
    d, found = mesh.dimension, []
    for clamp in body.get("clamp", []):
        fixed = [{"on": clamp, "along": axis, "value": 0.0} for axis in np.eye(d)]
        for each in fixed if isinstance(clamp, str) else [clamp]:
            for node in np.unique(mesh.groups[each["on"]]):
                places = dict(zip("xyz", mesh.points[node], strict=False))
                a = np.array(
                    [eval(q, {}, places) if isinstance(q, str) else q for q in each["along"]]
                )
                size = factor(scene, each.get("history"))
                found.append((int(node), a / np.linalg.norm(a), size * each["value"]))
    return found


def violations(scene: Scene, folder: Path) -> dict[str, float]:
    """The largest violation of each law, relative to the largest force, moment or displacement."""
    results = read_results(folder)
    u = results.displacement()
    d = u.shape[1]
    forces = {name: contact_forces(table, "xyz"[:d]) for name, table in results.contacts.items()}
    bodies, start = {}, 0
    for body in scene["body"]:
        mesh = mesh_of(scene, body)
        own = slice(start, start + len(mesh.points))
        assert np.abs(results.points[own] - mesh.points).max() < 1e-9
        bodies[body["name"]] = mesh, u[own]
        start = own.stop
    largest = np.abs(u).max() or 1.0
    acting = {body["name"]: loads(bodies[body["name"]][0], body, scene) for body in scene["body"]}
    size = max(
        *(np.abs(each).sum() for each in acting.values()),
        *(np.abs(each).sum() for each in forces.values()),
    )
    size = size or 1.0
    found: dict[str, float] = {}

    def told(law: str, value: float) -> None:
        found[law] = max(found.get(law, 0.0), float(value))

    sides = _sides(scene, results, bodies)
    for body in scene["body"]:
        mesh, own = bodies[body["name"]]
        K = default_stiffness_of(mesh, Material(**body["material"]))
        residual = acting[body["name"]] - (K @ own.ravel()).reshape(-1, d)
        scale = max(np.abs(residual).max(), NOTHING * size)
        _balance(scene, results, body, acting[body["name"]], forces, size, told)
        exact, touched = True, np.zeros(len(mesh.points), bool)
        for name, side, nodes, all_of_it, motion in sides:
            if side != body["name"]:
                continue
            touched[all_of_it] = True
            exact &= nodes is not None
            if nodes is not None:
                on_it = forces[name] if motion is None else -forces[name] @ motion.Q
                contact = next(each for each in scene["contact"] if each["name"] == name)
                residual += _at_nodes(mesh, contact, nodes, all_of_it, on_it)
        held = supports(mesh, body, scene)
        for node, direction, value in held:
            told("clamps", abs(own[node] @ direction - value) / largest)
        reaction = np.zeros(d)
        for node in {node for node, *_ in held}:
            span = np.array([a for other, a, _ in held if other == node]).T
            holds = span @ np.linalg.lstsq(span, residual[node], rcond=None)[0]
            reaction -= holds
            residual[node] -= holds
        told("inside", np.abs(residual[~touched]).max(initial=0.0) / scale)
        if exact:
            told("at nodes", np.abs(residual).max() / scale)
            there = np.array(results.summary["bodies"][body["name"]]["reaction"])
            told("reaction", np.abs(reaction - there).max() / size)
    _motions(scene, results, bodies, largest, told)
    for contact in scene["contact"]:
        table, own = results.contacts[contact["name"]], forces[contact["name"]]
        for law, value in _laws(scene, contact, table, own, NOTHING * size).items():
            least = (
                largest if law in result_check.MOTIONS else max(np.abs(own).max(), NOTHING * size)
            )
            told(law, value / (least or 1.0))
    _whole(scene, results, forces, size, told)
    return found


def _at_nodes(
    mesh: Mesh, contact: dict, rows: np.ndarray, side: np.ndarray, force: np.ndarray
) -> np.ndarray:
    """Nodal forces (nv, d) of those at rows, which stand at nodes.

    A bond of quadratic facets in space has forces for b = λ_i² at corners and 2 λ_i λ_j at middles; shape functions are
    b_i − ½ Σ b_ij at a corner and 2 b_ij at a middle.
    """
    total = np.zeros(mesh.points.shape)
    np.add.at(total, rows, force)
    if mesh.dimension == 2 or mesh.order == 1 or contact.get("kind") != "bonded":
        return total
    forms = total.copy()
    edges = np.sort(mesh.triangles[:, mesh.cell.edges].reshape(-1, 3), axis=1)  # middles are last
    edges = np.unique(edges, axis=0)
    for start, end, middle in edges[np.isin(edges, side).all(axis=1)]:
        total[middle] = 2.0 * forms[middle]
        for corner in np.intersect1d([start, end], rows):
            total[corner] -= 0.5 * forms[middle]
    return total


def _sides(scene: Scene, results: Results, bodies: dict) -> list[tuple]:
    """Of each side of each contact: its name, body, the node of each row or None, all its nodes, and the motion to the
    first side, of the first None."""
    found = []
    for contact in scene["contact"]:
        name, table = contact["name"], results.contacts[contact["name"]]
        d = results.points.shape[1]
        places = np.stack([table[axis] for axis in "xyz"[:d]], axis=1)
        paired = results.summary["contacts"][name]["pairing"] == "nodes"
        motion = Motion(contact.get("image"), d)
        for k, (body, on) in enumerate(zip(contact["bodies"], contact["on"], strict=False)):
            mesh = bodies[body][0]
            nodes = np.unique(mesh.groups[on])
            at = mesh.points[nodes] if k == 0 else motion.of(mesh.points[nodes])
            apart = np.linalg.norm(at[:, None] - places[None], axis=2)
            # rows of quadratic sides in space are of several nodes, but for bonds
            flat = d == 2 or mesh.order == 1 or contact.get("kind") == "bonded"
            paired &= flat and (k == 1 or bool(apart.min(axis=0).max() < 1e-9))
            rows = nodes[apart.argmin(axis=0)] if paired else None
            found.append((name, body, rows, nodes, motion if k else None))
    return found


def _balance(scene, results, body, acting, forces, size, told) -> None:
    """Resultants of one body by its tables; moments where nothing holds it."""
    mesh = mesh_of(scene, body)
    d = mesh.dimension
    arm = np.abs(mesh.points).max()
    force = acting.sum(axis=0) + np.array(results.summary["bodies"][body["name"]]["reaction"])
    moment = sum(turning(x, f) for x, f in zip(mesh.points, acting, strict=True))
    slack = 0.0
    for contact in scene["contact"]:
        table, own = results.contacts[contact["name"]], forces[contact["name"]]
        motion = Motion(contact.get("image"), d)
        places = np.stack([table[axis] for axis in "xyz"[:d]], axis=1)
        if contact["bodies"][0] == body["name"]:
            force = force + own.sum(axis=0)
            moment = moment + sum(turning(x, f) for x, f in zip(places, own, strict=True))
        if contact["bodies"][1] == body["name"]:
            back = -own @ motion.Q
            force = force + back.sum(axis=0)
            at = motion.back(places)
            moment = moment + sum(turning(x, f) for x, f in zip(at, back, strict=True))
        slack += results.summary["contacts"][contact["name"]]["moment_imbalance"]
    told("force", np.abs(force).max() / size)
    if not body.get("clamp"):
        told("moment", max(0.0, np.abs(moment).max() - slack) / (arm * size))


def _motions(scene, results, bodies, largest, told) -> None:
    """Gaps and slips of pairs of nodes by the displacements of both, and bonds of others roughly."""
    sides = _sides(scene, results, bodies)
    for contact in scene["contact"]:
        table, d = results.contacts[contact["name"]], results.points.shape[1]
        n = normals(table, "xyz"[:d])
        both = [each for each in sides if each[0] == contact["name"]]
        if both[0][2] is None:
            continue
        nodes = both[0][2]
        own = bodies[both[0][1]][1]
        moved = own[nodes]
        if len(both) == 2:
            _, name, partners, _, motion = both[1]
            u = bodies[name][1]
            moved = moved - u[partners] @ motion.Q.T
        closing = table["initial_gap"] - table["gap"] - np.einsum("md,md->m", n, moved)
        told("gap by displacements", np.abs(closing).max() / largest)
        if contact.get("kind") == "guided" or not contact.get("friction", contact.get("kind")):
            continue
        aside = moved - np.einsum("md,md->m", n, moved)[:, None] * n
        slip = along(table, "xyz"[:d], "slip") if "time" not in scene else None
        if slip is not None:
            told("slip by displacements", np.abs(aside - slip).max() / largest)
        else:
            told(
                "slip by displacements",
                np.abs(np.linalg.norm(aside, axis=1) - np.abs(table["slip_total"])).max() / largest,
            )


def _laws(scene: Scene, contact: dict, table, force: np.ndarray, nothing: float) -> dict:
    """Those of result_check, with a joint that gives way and a coefficient that changes."""
    plain = dict(contact)
    area = table["area" if "area" in table else "length"]
    if "softness" in contact:
        p = -np.einsum("md,md->m", force, normals(table, "xyz"[: force.shape[1]]))
        closure = contact["softness"] * np.maximum(p, 0.0) / area
        table = dict(table) | {"gap": table["gap"] + closure}
    coefficient = contact.get("friction", {}).get("coefficient")
    if isinstance(coefficient, dict):
        now = coefficient["value"] * factor(scene, coefficient["history"])
        plain["friction"] = contact["friction"] | {"coefficient": now}
    if contact.get("kind") == "guided":
        axes = "xyz"[: force.shape[1]]
        n = normals(table, axes)
        aside = force - np.einsum("md,md->m", force, n)[:, None] * n
        return {
            "opening of bonds": float(np.abs(table["gap"]).max()),
            "friction bound": float(np.abs(aside).max()),
        }
    return result_check.laws(plain, table, force, nothing)


def _whole(scene, results, forces, size, told) -> None:
    """Sums over all sectors."""
    for contact in scene["contact"]:
        image = contact.get("image", {})
        if "turn" not in image:
            continue
        count = round(360.0 / image["turn"])
        told("sectors", abs(results.summary["whole"]["sectors"] - count))
        Q = Motion(image, results.points.shape[1]).Q
        every = sum(np.linalg.matrix_power(Q, k) for k in range(count))
        for name, whole in results.summary["whole"]["contacts"].items():
            total = np.array(whole["force"]) - every @ forces[name].sum(axis=0)
            told("force of all sectors", np.abs(total).max() / (count * size))
        return


def feasible(scene: Scene, reach: float = 0.0) -> bool:
    """Whether forces within the cones of friction at the nodes of clamps and contacts hold all bodies at all times.

    Where they do not there is no equilibrium. `reach` means nothing here.
    """
    times = np.arange(1.0, 3.1, 0.25) if "time" in scene else [np.inf]
    meshes = {body["name"]: mesh_of(scene, body) for body in scene["body"]}
    return all(_feasible(scene, meshes, float(time)) for time in times)


def _feasible(scene: Scene, meshes: dict[str, Mesh], time: float) -> bool:
    """The same at one time, by linear programming."""
    d = next(iter(meshes.values())).dimension
    k = d * (d + 1) // 2
    rows = {name: slice(k * i, k * i + k) for i, name in enumerate(meshes)}
    columns: list[np.ndarray] = []
    lowest: list[float] = []
    wanted = np.zeros(k * len(meshes))

    def wrench(*parts: tuple[str, np.ndarray, np.ndarray]) -> np.ndarray:
        column = np.zeros(k * len(meshes))
        for name, place, force in parts:
            if name in rows:
                column[rows[name]] += np.concatenate([force, turning(place, force)])
        return column

    capped, most = [], []
    for body in scene["body"]:
        mesh = meshes[body["name"]]
        for place, force in zip(mesh.points, loads(mesh, body, scene, time), strict=True):
            wanted -= wrench((body["name"], place, force))
        for node, direction, _ in supports(mesh, body, scene):
            columns.append(wrench((body["name"], mesh.points[node], direction)))
            lowest.append(-np.inf)
    for contact in scene["contact"]:
        motion = Motion(contact.get("image"), d)
        for place, n, area in _places(meshes, contact, motion):

            def on_both(force, contact=contact, motion=motion, place=place) -> np.ndarray:
                first, second = contact["bodies"]
                return wrench(
                    (first, place, force), (second, motion.back(place), -force @ motion.Q)
                )

            law = contact.get("friction", {"law": "none"})
            tangents = np.linalg.svd(n[None])[2][1:]
            angles = 2 * np.pi * np.arange(SIDES) / SIDES if d == 3 else np.array([0.0, np.pi])
            round_it = np.column_stack([np.cos(angles), np.sin(angles)])[:, : d - 1] @ tangents
            around = 1.0 / np.cos(np.pi / SIDES) if d == 3 else 1.0
            kind = contact.get("kind")
            if kind in ("bonded", "guided"):
                for axis in (n, *tangents) if kind == "bonded" else (n,):
                    columns.append(on_both(axis))
                    lowest.append(-np.inf)
            elif law["law"] == "coulomb":
                mu = law["coefficient"]
                if isinstance(mu, dict):
                    mu = mu["value"] * factor(scene, mu["history"], time)
                columns += [on_both(-n + around * mu * t) for t in round_it]
                lowest += [0.0] * len(round_it)
            else:
                columns.append(on_both(-n))
                lowest.append(0.0)
                if law["law"] == "tresca":
                    capped.append(range(len(columns), len(columns) + len(round_it)))
                    most.append(around * law["slip_bound"] * area)
                    columns += [on_both(t) for t in round_it]
                    lowest += [0.0] * len(round_it)
    scale = np.abs(wanted).max() or 1.0
    limits = [(low, None) for low in lowest]
    return has_forces(columns, limits, capped, np.array(most) / scale, wanted / scale)


def _places(meshes: dict[str, Mesh], contact: dict, motion: Motion):
    """Nodes of the first side that face the second one, its outer normal, and their lengths or areas."""
    mesh = meshes[contact["bodies"][0]]
    d = mesh.dimension
    facets = mesh.groups[contact["on"][0]][:, :d]
    corners = mesh.points[facets]
    edges = corners[:, 1:] - corners[:, :1]
    if d == 2:
        n = np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
        size = np.linalg.norm(n, axis=1)
    else:
        n = np.cross(edges[:, 0], edges[:, 1])
        size = np.linalg.norm(n, axis=1) / 2
    n = n.sum(axis=0)
    n /= np.linalg.norm(n)
    middle = mesh.points[mesh.triangles[:, : d + 1]].mean(axis=(0, 1))
    n *= np.sign(n @ (corners.mean(axis=(0, 1)) - middle))
    nodes = np.unique(facets)
    area = np.bincount(facets.ravel(), np.repeat(size / d, d), len(mesh.points))[nodes]
    places = mesh.points[nodes]
    if contact["bodies"][1] in meshes:
        other = meshes[contact["bodies"][1]]
        there = motion.of(other.points[np.unique(other.groups[contact["on"][1]])])
        low, high = there.min(axis=0) - 1e-2, there.max(axis=0) + 1e-2
        inside = ((places >= low) & (places <= high)).all(axis=1)
        ends = _ends(places, there)
        share = area.sum() / max(len(ends) + inside.sum(), 1)
        return [(x, n, share) for x in (*places[inside], *ends)]
    return [(x, n, a) for x, a in zip(places, area, strict=True)]


def _ends(places: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Nodes of the other side within the box of this one."""
    low, high = places.min(axis=0) - 1e-2, places.max(axis=0) + 1e-2
    return there[((there >= low) & (there <= high)).all(axis=1)]
