"""The scenes of peers, as ddmpi reads them and, from its own meshes, as a Case for everybody else."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from problems.bodies import QUARTER, coulomb, plane
from problems.revolved import half_ball
from scenes import to_toml
from scipy.spatial import cKDTree
from solid_scenes import box, two_boxes

from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import facet_shares
from ddmpi.scene.reader import read_scene
from peers import Case

POISSON = 0.3
BALL = 0.1
"""Hertz's radius of the contact of a ball of 1 m and 1 Pa with a rigid plane (m)."""

PRESSED = 4 * BALL**3 / 3 / (1 - POISSON**2)
"""The force on it (N)."""


def boxes(N: int, folder: Path, order: int) -> dict:
    """At order 2 with as many nodes, and meshes that do not match."""
    return two_boxes(N) if order == 1 else two_boxes(N // 2, round(0.85 * (N // 2)), 2)


def tall(N: int, folder: Path, order: int) -> dict:
    """Cubes on each other, pushed along both sides at the top; nothing but contacts holds the upper three."""
    n = N // order
    bodies = [
        box(f"cube{k}", (0, 0, k), (1, 1, 1), (n, n, n), order, 2.119e11, 0.277) for k in range(4)
    ]
    bodies[0]["clamp"] = ["bottom"]
    bodies[3]["traction"] = [{"on": "top", "value": [5.0e6, 2.5e6, -6.0e7]}]
    return {
        "body": bodies,
        "contact": [
            {
                "bodies": [f"cube{k + 1}", f"cube{k}"],
                "on": ["bottom", "top"],
                "friction": coulomb(0.3),
            }
            for k in range(3)
        ],
    }


def ball(N: int, folder: Path, order: int) -> dict:
    """A quarter of a half ball; N elements of order 1, or as many nodes, on the diameter of the contact."""
    mesh = half_ball(folder / "ball.msh", BALL, 2 * BALL * order / N, 2 if order == 2 else 1)
    return {
        "rigid": [plane("plane", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))],
        "body": [
            {
                "name": "ball",
                "mesh": mesh,
                "material": {"young": 1.0, "poisson": POISSON},
                "clamp": QUARTER,
                "traction": [{"on": "top", "force": [0.0, 0.0, -PRESSED / 4]}],
            }
        ],
        "contact": [{"bodies": ["ball", "plane"], "on": ["contact"]}],
    }


def wall(N: int, folder: Path, order: int) -> dict:
    """Fourteen bricks in running bond, N cells of order 1 on a quarter of a brick and its open joint."""
    cell, n = 0.03, N // order
    courses = [[(0, 7), (8, 7), (16, 7)], [(0, 3), (4, 7), (12, 7), (20, 3)]] * 2
    bodies, contacts = [], []
    for level, course in enumerate(courses):
        for k, (start, length) in enumerate(course):
            held = {"clamp": ["bottom"]} if level == 0 else {}
            pushed = (
                {"traction": [{"on": "top", "value": [1.5e4, 1.0e4, -5.0e4]}]} if level == 3 else {}
            )
            bodies.append(
                box(
                    f"brick{level}{k}",
                    (start * cell, 0, 2 * cell * level),
                    (length * cell, 4 * cell, 2 * cell),
                    (length * n, 4 * n, 2 * n),
                    order,
                    1e10,
                    0.2,
                    **held,
                    **pushed,
                )
            )
            contacts += [
                {
                    "bodies": [f"brick{level}{k}", f"brick{level - 1}{below}"],
                    "on": ["bottom", "top"],
                    "friction": coulomb(0.6),
                }
                for below, (at, size) in enumerate(courses[level - 1] if level else [])
                if at < start + length and start < at + size
            ]
    return {"body": bodies, "contact": sorted(contacts, key=lambda contact: contact["bodies"][1])}


FORCE, MOVED = ("normal", "tangential"), ("x", "y", "z")


@dataclass(frozen=True)
class Scene:
    """A scene by its fineness N; docs/tables/peers.md describes it under its title.

    Attributes
    ----------
    make : the scene for ddmpi from N, a folder and the order of the elements
    watched : the point whose displacement is shown, and compared where bodies are no boxes (m)
    sizes : how often each N is measured
    between : N of more answers of ddmpi of order 2
    fine : N of the fine answer of order 2
    compared : groups of columns of which the worst relative difference counts
    exact : known values, of the columns that they name
    contacts : how many contacts make up the force that is compared
    """

    title: str
    make: Callable[[int, Path, int], dict]
    watched: tuple[float, float, float]
    sizes: Mapping[int, int]
    fine: int
    compared: Collection[tuple[str, ...]] = (FORCE, MOVED)
    exact: Mapping[str, float] = field(default_factory=dict)
    contacts: int = 1
    between: Collection[int] = ()


SCENES = {
    "boxes": Scene(
        "Two boxes in space with Coulomb friction 0.3",
        boxes,
        (3.0, 2.0, 1.0),
        {8: 2, 16: 1, 22: 1},
        28,
        between=(10, 12, 14, 18, 20),
    ),
    "tall": Scene(
        "A loose stack of four cubes with Coulomb friction 0.3",
        tall,
        (1.0, 1.0, 4.0),
        {6: 2, 12: 1, 18: 1},
        24,
        between=(4, 8, 10, 14, 20),
    ),
    "ball": Scene(
        "A ball on a rigid plane",
        ball,
        (0.0, 0.0, 1.0),
        {10: 2, 20: 1, 40: 1},
        60,
        (("pressure",), MOVED),
        {"pressure": 2 * BALL / np.pi / (1 - POISSON**2)},
    ),
    "wall": Scene(
        "A wall of fourteen bricks with Coulomb friction 0.6",
        wall,
        (0.69, 0.12, 0.24),
        {2: 2, 4: 1},
        6,
        contacts=2,
    ),
}
"""By name."""


def write_case(name: str, N: int, folder: Path, order: int = 1) -> Case:
    """scene.toml for ddmpi and the same as a Case, both in the folder."""
    its = SCENES[name]
    scene = its.make(N, folder, order)
    (folder / "scene.toml").write_text(to_toml(scene), encoding="utf-8")
    case = case_of(scene, its.watched, its.contacts)
    case.save(folder)
    return case


def case_of(scene: dict, watched: tuple[float, float, float], contacts: int) -> Case:
    """The Case of a scene whose contacts are flat and whose nodes match, or of one with the rigid plane through the
    origin across the last axis. At order 2 nodes need not match."""
    meshes = {
        body.name: build_mesh(body) for body in read_scene("a scene of peers", to_toml(scene)).body
    }
    counts = [len(mesh.points) for mesh in meshes.values()]
    starts = dict(zip(meshes, np.cumsum([0, *counts[:-1]]), strict=True))
    points = np.concatenate([mesh.points for mesh in meshes.values()])
    order = next(iter(meshes.values())).order

    def facets_of(name: str, group: str) -> np.ndarray:
        return starts[name] + meshes[name].facets(group).nodes

    clamped, load = [], np.zeros(points.shape)
    for body in scene["body"]:
        for clamp in body.get("clamp", []):
            clamp = {"on": clamp} | dict.fromkeys("xyz") if isinstance(clamp, str) else clamp
            nodes = np.unique(facets_of(body["name"], clamp["on"]))
            clamped += [3 * nodes + c for c, component in enumerate("xyz") if component in clamp]
        for traction in body.get("traction", []):
            facets = facets_of(body["name"], traction["on"])
            shares = facet_shares(points[facets])
            value = (
                traction["value"]
                if "value" in traction
                else np.array(traction["force"]) / shares.sum()
            )
            np.add.at(load, facets, shares[:, :, None] * np.array(value))
    held = np.unique(np.concatenate(clamped))

    parts, shown = [], []
    for number, contact in enumerate(scene["contact"]):
        sides = [
            facets_of(name, on) for name, on in zip(contact["bodies"], contact["on"], strict=False)
        ]
        nodes = np.unique(sides[0])
        partner = np.full(len(nodes), -1)
        if len(sides) == 2:  # what matches; at order 2 everything, if nothing does
            facing = np.unique(sides[1])
            away, nearest = cKDTree(points[facing]).query(points[nodes])
            there = away < 1e-9
            covered = [
                np.isin(side, its).all(axis=1)
                for side, its in zip(sides, (nodes[there], facing[nearest[there]]), strict=True)
            ]
            if covered[0].any() and covered[1].any():
                sides = [side[its] for side, its in zip(sides, covered, strict=True)]
                there &= np.isin(nodes, sides[0])
            elif order == 1:
                raise ValueError(f"the nodes of {' and '.join(contact['bodies'])} do not match")
            nodes, partner = nodes[there], facing[nearest[there]]
        share = np.bincount(sides[0].ravel(), facet_shares(points[sides[0]]).ravel(), len(points))[
            nodes
        ]
        pairs = np.column_stack([nodes, partner])[: len(nodes) if order == 1 else 0]
        dofs = 3 * pairs[:, :, None] + np.arange(3)
        moves = ~np.isin(dofs, held).all(axis=(1, 2))
        gap = np.where(partner < 0, points[nodes, -1], 0.0)
        parts.append(
            [
                pairs[moves],
                *(each[: len(pairs)][moves] for each in (gap, share, np.full(len(nodes), number))),
            ]
        )
        shown += [(facets, (number, which)) for which, facets in enumerate(sides)]
    pairs, gap, area, numbers = (np.concatenate(each) for each in zip(*parts, strict=True))
    across = -1 if (pairs < 0).any() else int(np.ptp(points[shown[0][0]], axis=(0, 1)).argmin())
    material, friction = scene["body"][0]["material"], scene["contact"][0].get("friction", {})
    return Case(
        points,
        np.concatenate([starts[name] + mesh.triangles for name, mesh in meshes.items()]),
        np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes.values()]),
        material["young"],
        material["poisson"],
        held,
        load.ravel(),
        pairs,
        np.tile(-np.eye(3)[across], (len(pairs), 1)),
        gap,
        area,
        numbers,
        np.concatenate([facets for facets, _ in shown]),
        np.concatenate([np.tile(side, (len(facets), 1)) for facets, side in shown]),
        friction.get("coefficient", 0.0),
        int(np.linalg.norm(points - watched, axis=1).argmin()),
        contacts,
    )
