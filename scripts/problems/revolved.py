"""Meshes of bodies that turn about an axis in space, by gmsh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ddmpi.mesh.read import gmsh_session
from problems import Order
from problems.bodies import RADIUS, only_own_sizes

Test = Callable[[np.ndarray], np.ndarray]
"""Which of points (k, 3) lie on a surface."""


def flat(axis: int, at: float) -> Test:
    return lambda p: np.abs(p[:, axis] - at) < 1e-9


def round_(radius: float, axes: int) -> Test:
    """Around the axis z by two `axes`, around the origin by three."""
    return lambda p: np.abs(np.linalg.norm(p[:, :axes], axis=1) - radius) < 1e-7


def revolved(
    path: Path,
    profile: list[tuple[float, float]],
    arcs: Mapping[int, tuple[float, float]],
    turn: float,
    groups: Mapping[str, Test],
    size: Callable[[np.ndarray], float],
    order: Order,
) -> dict:
    """The mesh of a body that a profile in the plane y = 0 sweeps as it turns about z, by gmsh.

    Parameters
    ----------
    profile : corners (x, z), around it
    arcs : the centres (x, z) of the sides after some of the corners, by their number
    turn : degrees
    groups : tests of points on the surfaces, the first that holds counts
    size : of the elements at a point
    """
    with gmsh_session() as gmsh:
        occ = gmsh.model.occ
        corners = [occ.addPoint(x, 0.0, z) for x, z in profile]
        lines = []
        for k, (start, end) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
            centre = occ.addPoint(arcs[k][0], 0.0, arcs[k][1]) if k in arcs else None
            lines.append(
                occ.addLine(start, end) if centre is None else occ.addCircleArc(start, centre, end)
            )
        occ.revolve(
            [(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))],
            0,
            0,
            0,
            0,
            0,
            1,
            np.radians(turn),
        )
        occ.synchronize()
        found: dict[str, list[int]] = {}
        for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(3), oriented=False):
            low, high = gmsh.model.getParametrizationBounds(2, tag)
            at = [
                low + part * (high - low) for part in (np.array([0.3, 0.3]), np.array([0.7, 0.5]))
            ]
            points = np.reshape(gmsh.model.getValue(2, tag, np.concatenate(at)), (-1, 3))
            name = next((name for name, test in groups.items() if test(points).all()), None)
            if name:
                found.setdefault(name, []).append(tag)
        for name, tags in found.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="body")
        only_own_sizes(gmsh)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.model.mesh.setSizeCallback(
            lambda dim, tag, x, y, z, size_of: size(np.array([x, y, z]))
        )
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(int(order))
        gmsh.write(str(path))
    return {"file": str(path), "order": int(order)}


def half_ball(
    path: Path, a: float, h: float, order: Order, turn: float = 90.0, down: bool = False
) -> dict:
    """A part of a half ball that touches the plane z = 0 in the origin from above, or from below.

    Groups: contact, as far as 1.6 a; top, its flat face; start (y = 0) and, of a quarter, end (x = 0).
    """
    z, reach = -RADIUS if down else RADIUS, np.arcsin(1.6 * a / RADIUS)
    profile = [
        (0.0, 0.0),
        (RADIUS * np.sin(reach), z * (1.0 - np.cos(reach))),
        (RADIUS, z),
        (0.0, z),
    ]

    def sphere(p: np.ndarray) -> np.ndarray:
        return round_(RADIUS, 3)(p - [0.0, 0.0, z])

    groups = {
        "top": flat(2, z),
        "start": lambda p: flat(1, 0.0)(p) & (p[:, 0] > 0.0),
        "end": flat(0 if turn == 90.0 else 1, 0.0),
        "contact": lambda p: sphere(p) & (np.hypot(p[:, 0], p[:, 1]) < 1.6 * a + 1e-9),
        "outer": sphere,
    }
    return revolved(
        path,
        profile,
        dict.fromkeys((0, 1), (0.0, z)),
        turn,
        groups,
        lambda x: min(0.3, h + 0.35 * max(0.0, float(np.linalg.norm(x)) - 1.25 * a)),
        order,
    )


def tube(path: Path, inner: float, outer: float, h: float, order: Order) -> dict:
    """A quarter of a tube 0.2 m long, with groups inner, outer, bottom, top, start and end."""
    groups = {
        "bottom": flat(2, 0.0),
        "top": flat(2, 0.2),
        "start": flat(1, 0.0),
        "end": flat(0, 0.0),
        "inner": round_(inner, 2),
        "outer": round_(outer, 2),
    }
    profile = [(inner, 0.0), (outer, 0.0), (outer, 0.2), (inner, 0.2)]
    return revolved(path, profile, {}, 90.0, groups, lambda x: h, order)


def shell(path: Path, inner: float, outer: float, h: float, order: Order) -> dict:
    """An octant of a spherical shell, with groups inner, outer, start, end and bottom."""
    groups = {
        "bottom": flat(2, 0.0),
        "start": flat(1, 0.0),
        "end": flat(0, 0.0),
        "inner": round_(inner, 3),
        "outer": round_(outer, 3),
    }
    profile = [(inner, 0.0), (outer, 0.0), (0.0, outer), (0.0, inner)]
    return revolved(
        path, profile, dict.fromkeys((1, 3), (0.0, 0.0)), 90.0, groups, lambda x: h, order
    )
