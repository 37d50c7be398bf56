"""The scenes of the comparison: as ddmpi reads them, and, from its own meshes, as a Case for everybody else."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from case import Case

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

from problem import draw  # which makes the scenes of the tests known
from scenes import pinched_blocks, to_toml, tower

from ddmpi.mesh.boundary import boundary_group
from ddmpi.mesh.build import build_mesh
from ddmpi.scene.reader import read_scene

RADIUS, LOAD, YOUNG, POISSON = 50.0, 17500.0, 210e3, 0.3
"""Half of a steel roller: mm, N/mm, MPa."""

WIDTH = float(np.sqrt(8 * LOAD * RADIUS * (1 - POISSON**2) / np.pi / YOUNG))
"""Hertz's half width of the contact with a rigid plane (mm)."""

SUMMIT = 4 * LOAD / np.pi / WIDTH
"""Hertz's largest pressure (MPa)."""


def frictionless(N: int, folder: Path) -> dict:
    return pinched_blocks(N, "none")


def blocks(N: int, folder: Path) -> dict:
    return pinched_blocks(N)


def hertz(N: int, folder: Path) -> dict:
    """N/2 nodes on the half width; the plane is rigid, so that nodes meet points."""
    size = f"{2 * WIDTH / N} + 0.25 * Max(0, Sqrt(x * x + y * y) - {2 * WIDTH})"
    mesh = draw(folder / "roller.msh", {"o": (0.0, 0.0), "b": (RADIUS, RADIUS), "c": (0.0, RADIUS)},
                {"rim": ("o", "c", "b"), "cut": ("b", "c"), "axis": ("c", "o")}, size, 1)
    return {"title": f"Roller on a rigid plane, {N} sides on the half width twice",
            "rigid": [{"name": "plane", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}],
            "body": [{"name": "roller", "mesh": mesh, "material": {"young": YOUNG, "poisson": POISSON},
                      "clamp": [{"on": "axis", "x": 0.0}],
                      "traction": [{"on": "cut", "value": [0.0, -LOAD / RADIUS]}]}],
            "contact": [{"bodies": ["roller", "plane"], "on": ["rim"]}]}


def stack(N: int, folder: Path) -> dict:
    """Pushed so hard that its lower joints open and slide in part; nothing but contacts holds the upper three."""
    scene = tower(4, N // 2)
    scene["body"][-1]["traction"] = [{"on": "top", "value": [1.0e7, -6.0e7]}]
    return scene


SCENES: dict[str, tuple[Callable[[int, Path], dict], tuple[float, float]]] = {
    "frictionless": (frictionless, (3.0, 2.0)), "blocks": (blocks, (3.0, 2.0)), "hertz": (hertz, (0.0, RADIUS)),
    "stack": (stack, (3.0, 4.0))}
"""By name: the scene on a mesh, and the point whose displacement is compared (m, of the roller mm)."""


def write_case(name: str, N: int, folder: Path) -> Case:
    """scene.toml for ddmpi and the same as a Case, both in the folder."""
    make, watched = SCENES[name]
    scene = make(N, folder)
    (folder / "scene.toml").write_text(to_toml(scene), encoding="utf-8")
    case = case_of(scene, watched)
    case.save(folder)
    return case


def case_of(scene: dict, watched: tuple[float, float]) -> Case:
    """The Case of a scene of straight contacts whose nodes match, or of one with the rigid plane y = 0."""
    meshes = {body.name: build_mesh(body) for body in read_scene("a scene of peers", to_toml(scene)).body}
    counts = [len(mesh.points) for mesh in meshes.values()]
    starts = dict(zip(meshes, np.cumsum([0, *counts[:-1]]), strict=True))
    points = np.concatenate([mesh.points for mesh in meshes.values()])

    def edges_of(name: str, group: str) -> tuple[np.ndarray, np.ndarray]:
        """The edges (k, 2) of a group and their lengths."""
        edges = starts[name] + boundary_group(meshes[name], group, "mesh")
        return edges, np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)

    clamped, load = [], np.zeros((len(points), 2))
    for body in scene["body"]:
        for clamp in body["clamp"]:
            clamp = {"on": clamp, "x": 0.0, "y": 0.0} if isinstance(clamp, str) else clamp
            nodes = np.unique(edges_of(body["name"], clamp["on"])[0])
            clamped += [2 * nodes + c for c, component in enumerate("xy") if component in clamp]
        for traction in body["traction"]:
            edges, lengths = edges_of(body["name"], traction["on"])
            for ends in edges.T:
                np.add.at(load, ends, lengths[:, None] / 2 * np.array(traction["value"]))
    held = np.unique(np.concatenate(clamped))

    parts = []
    for number, contact in enumerate(scene["contact"]):
        (first, second), on = contact["bodies"], contact["on"]
        edges, lengths = edges_of(first, on[0])
        nodes = np.unique(edges)
        nodes = nodes[np.argsort(points[nodes, 0])]
        length = np.bincount(edges.ravel(), np.repeat(lengths / 2, 2), len(points))[nodes]
        partner = np.full(len(nodes), -1)
        if second in meshes:
            facing = np.unique(edges_of(second, on[1])[0])
            partner = facing[np.argsort(points[facing, 0])]
            if np.abs(points[nodes] - points[partner]).max() > 1e-9:
                raise ValueError(f"the nodes of {first} and {second} do not match")
        pairs = np.column_stack([nodes, partner])
        moves = ~(np.isin(2 * pairs, held) & np.isin(2 * pairs + 1, held)).all(axis=1)
        gap = np.where(partner < 0, points[nodes, 1], 0.0)
        parts.append([each[moves] for each in (pairs, gap, length, np.full(len(nodes), number))])
    pairs, gap, length, numbers = (np.concatenate(each) for each in zip(*parts, strict=True))
    material, friction = scene["body"][0]["material"], scene["contact"][0].get("friction", {})
    return Case(points, np.concatenate([starts[name] + mesh.triangles for name, mesh in meshes.items()]),
                np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes.values()]),
                material["young"], material["poisson"], held, load.ravel(), pairs,
                np.tile([0.0, -1.0], (len(pairs), 1)), gap, length, numbers, friction.get("coefficient", 0.0),
                int(np.linalg.norm(points - watched, axis=1).argmin()))
