"""Scenes of solids that tests and studies share: published ones with their answers, two boxes, patches of constant
stress."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from elsewhere import corners

PUBLIC = {
    each["scene"]["title"]: each
    for each in json.loads(
        Path(__file__).with_name("public_solids.json").read_text(encoding="utf-8")
    )
}
"""Scenes by title, each with its answer: of the corners 0 and 6 of bodies the displacements (m); of each load step and
contact nodes by status, force and moment on the first body (N, N m), and how many nodes other contacts share."""

NORMALS = {
    "left": (-1, 0, 0),
    "right": (1, 0, 0),
    "front": (0, -1, 0),
    "back": (0, 1, 0),
    "bottom": (0, 0, -1),
    "top": (0, 0, 1),
}
"""Outer normals of the groups of a box."""

HELD = {"x": 0.0, "y": 0.0, "z": 0.0}


def box(
    name: str,
    origin: Sequence[float],
    size: Sequence[float],
    divisions: Sequence[int],
    order: int = 1,
    young: float = 2e9,
    poisson: float = 0.3,
    **more,
) -> dict:
    """A body that is a box; `more` are its other keys."""
    mesh = {
        "shape": "box",
        "origin": [float(x) for x in origin],
        "size": [float(x) for x in size],
        "divisions": [int(n) for n in divisions],
        "order": order,
    }
    return {"name": name, "mesh": mesh, "material": {"young": young, "poisson": poisson}} | more


def two_boxes(
    N: int, M: int | None = None, order: int = 1, law: dict | None = None, **more
) -> dict:
    """The model scene in space: boxes 3 × 1 × 1 of N and M cells a unit; `more` are keys of the contact."""
    steel = {"young": 2.119e11, "poisson": 0.277, "clamp": [{"on": "left"} | HELD]}
    return {
        "body": [
            box(
                "upper",
                (0, 1, 0),
                (3, 1, 1),
                (3 * N, N, N),
                order,
                **steel,
                traction=[
                    {"on": "back", "value": [0.0, -6e7, 0.0]},
                    {"on": "right", "value": [2e7, 3e7, 1.5e7]},
                ],
            ),
            box(
                "lower",
                (0, 0, 0),
                (3, 1, 1),
                (3 * (M or N), M or N, M or N),
                order,
                **steel,
                traction=[{"on": "front", "value": [0.0, 4e7, 0.0]}],
            ),
        ],
        "contact": [
            {
                "name": "upper-lower",
                "bodies": ["upper", "lower"],
                "on": ["front", "back"],
                "friction": law or {"law": "coulomb", "coefficient": 0.3},
            }
            | more
        ],
    }


# Patches of constant stress

STRESS = np.array([[3.0, 0.4, -0.3], [0.4, -5.0, 0.6], [-0.3, 0.6, -4.0]]) * 1e6
"""Pressure on every plane along the axes, and shear of all kinds (Pa)."""

YOUNG, POISSON = 2e9, 0.3
STRAIN = ((1 + POISSON) * STRESS - POISSON * np.trace(STRESS) * np.eye(3)) / YOUNG

Box = tuple[Sequence[float], Sequence[float], Sequence[int]]
"""Origin, size and divisions."""

Touch = tuple[tuple[int, str], tuple[int, str]]
"""The numbers of two boxes, each with the face that touches the other."""


def patch(
    boxes: Sequence[Box],
    touching: Sequence[Touch],
    order: int,
    bonded: bool = False,
    open_part: dict[tuple[int, str], str] | None = None,
    **more,
) -> dict:
    """Boxes under a constant stress: what has x = 0 is clamped there to the exact displacement, across the contacts;
    tractions act on all other faces that touch nothing.

    `open_part` are formulas of the part of a face that does touch something, where the traction of the constant stress
    acts. `more` are keys of the contacts.
    """
    exact = {
        axis: dict(zip(("x_slope", "y_slope", "z_slope"), map(float, row), strict=True))
        for axis, row in zip("xyz", STRAIN, strict=True)
    }
    busy = {each for touch in touching for each in touch}
    bodies = []
    for number, (origin, size, divisions) in enumerate(boxes):
        held = origin[0] == 0.0
        traction = []
        for group, normal in NORMALS.items():
            part = (open_part or {}).get((number, group))
            stress = [float(t) for t in STRESS @ np.array(normal)]
            if part:
                traction.append({"on": group, "value": [f"{t!r} * ({part})" for t in stress]})
            elif (number, group) not in busy and not (held and group == "left"):
                traction.append({"on": group, "value": stress})
        clamp = {"clamp": [{"on": "left"} | exact]} if held else {}
        bodies.append(
            box(
                f"b{number}",
                origin,
                size,
                divisions,
                order,
                YOUNG,
                POISSON,
                traction=traction,
                **clamp,
            )
        )
    law = {"kind": "bonded"} if bonded else {"friction": {"law": "coulomb", "coefficient": 5.0}}
    contacts = [
        {"bodies": [f"b{a}", f"b{b}"], "on": [on, other], "pairing": "mortar"} | law | more
        for (a, on), (b, other) in touching
    ]
    return {"body": bodies, "contact": contacts, "method": {"tolerance": 1e-12}}


def beyond(at: float, start: float, end: float, axis: str = "x") -> str:
    """A formula for a load on the part of a face beyond the coordinate `at`, which is between `start` and `end`, where
    facets begin and end: 0 before, 1 after them, between them a cubic with the moments of a step at `at`.

    So the nodal loads of linear and quadratic facets are those of the step, by Gauss's rule on whole facets.
    """
    t = (at - start) / (end - start)
    k = np.arange(4)
    mass = 1.0 / (k[:, None] + k + 1)
    c = np.linalg.solve(mass, (1.0 - t ** (k + 1)) / (k + 1))
    s = f"(({axis} - {start!r}) / {end - start!r})"
    cubic = " + ".join(f"{value!r} * {s}**{power}" for power, value in enumerate(c.tolist()))
    return f"where({axis} < {start!r}, 0, where({axis} > {end!r}, 1, {cubic}))"


def two_patches(
    upper: Sequence[int], lower: Sequence[int], order: int, covered: float = 1.0, **more
) -> dict:
    """A box on another one, which ends at x = `covered` of the upper one's lower face."""
    boxes = [((0, 0, 1), (1, 1, 1), upper), ((0, 0, 0), (covered, 1, 1), lower)]
    cell = np.floor(covered * upper[0] + 1e-12)
    rest = (
        {}
        if covered == 1.0
        else {(0, "bottom"): beyond(covered, float(cell / upper[0]), float((cell + 1) / upper[0]))}
    )
    return patch(boxes, [((0, "bottom"), (1, "top"))], order, open_part=rest, **more)


T_JUNCTION = (
    [
        ((0, 0, 1), (1, 1, 1), (3, 4, 3)),
        ((0, 0, 0), (1, 0.45, 1), (4, 3, 4)),
        ((0, 0.45, 0), (1, 0.55, 1), (3, 4, 5)),
    ],
    [((0, "bottom"), (1, "top")), ((0, "bottom"), (2, "top")), ((1, "back"), (2, "front"))],
)
CROSS = (
    [
        ((0, 0, 0), (1, 0.5, 0.5), (3, 3, 3)),
        ((0, 0.5, 0), (1, 0.5, 0.5), (4, 4, 4)),
        ((0, 0, 0.5), (1, 0.5, 0.5), (4, 3, 4)),
        ((0, 0.5, 0.5), (1, 0.5, 0.5), (3, 4, 3)),
    ],
    [
        ((0, "back"), (1, "front")),
        ((2, "back"), (3, "front")),
        ((0, "top"), (2, "bottom")),
        ((1, "top"), (3, "bottom")),
    ],
)


def between_planes(
    stress: np.ndarray,
    planes: Sequence[str],
    Q: np.ndarray,
    divisions: Sequence[Sequence[int]],
    order: int,
    **more,
) -> dict:
    """Two cubes under a constant stress (3, 3) in MPa, turned by Q (3, 3): clamps along the normal hold the `planes`,
    groups on which the stress has no shear; the lower one's bottom moves as it must; tractions act elsewhere. `more`
    are keys of the contact."""
    stress = Q @ (stress * 1e6) @ Q.T
    strain = ((1 + POISSON) * stress - POISSON * np.trace(stress) * np.eye(3)) / YOUNG
    exact = {
        axis: dict(zip(("x_slope", "y_slope", "z_slope"), map(float, row), strict=True))
        for axis, row in zip("xyz", strain, strict=True)
    }
    bodies = []
    for name, z, face, cells in (
        ("upper", 1.0, "bottom", divisions[0]),
        ("lower", 0.0, "top", divisions[1]),
    ):
        places = corners({"shape": "box", "origin": [0.0, 0.0, z], "size": [1.0, 1.0, 1.0]}) @ Q.T
        mesh = {
            "shape": "hexahedron",
            "corners": places.tolist(),
            "divisions": list(cells),
            "order": order,
        }
        clamps, traction = [{"on": "bottom"} | exact] if name == "lower" else [], []
        for group, normal in NORMALS.items():
            n = Q @ np.array(normal)
            if (
                group in planes
            ):  # of a plane through the origin the displacement along the normal is 0, else constant
                along = float(n @ strain @ n) if group in ("right", "back") else 0.0
                if np.array_equal(Q, np.eye(3)):
                    axis = int(np.abs(n).argmax())
                    clamps.append({"on": group, "xyz"[axis]: along * float(n[axis])})
                else:
                    clamps.append({"on": group, "normal": along})
            elif group != face and not (name == "lower" and group == "bottom"):
                traction.append({"on": group, "value": (stress @ n).tolist()})
        bodies.append(
            {
                "name": name,
                "mesh": mesh,
                "material": {"young": YOUNG, "poisson": POISSON},
                "clamp": clamps,
                "traction": traction,
            }
        )
    return {
        "body": bodies,
        "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"]} | more],
        "method": {"tolerance": 1e-12},
    }


@contextlib.contextmanager
def jittered(amount: float = 0.3, still: float = np.inf) -> Iterator[None]:
    """A context in which nodes of boxes are moved at random by up to `amount` of half a cell, those on a face within
    it. Nodes with x ≥ `still` on the lower face of a box stay where they are."""
    import ddmpi.coupling.parts as parts
    from ddmpi.mesh.mesh import Mesh

    build = parts.build_mesh

    def moved_mesh(body, *rest, **more) -> Mesh:
        mesh = build(body, *rest, **more)
        rng, ends = np.random.default_rng(len(mesh.points)), np.unique(mesh.corners)
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        cell = (high - low) / np.array(body.mesh.divisions)
        move = rng.uniform(-0.5, 0.5, mesh.points.shape) * amount * cell
        move[(mesh.points - low < 1e-9) | (high - mesh.points < 1e-9)] = 0.0
        move[(mesh.points[:, 0] >= still - 1e-9) & (mesh.points[:, 2] - low[2] < 1e-9)] = 0.0
        points = mesh.points.copy()
        points[ends] += move[ends]
        if mesh.order == 2:
            start, end, middle = mesh.triangles[:, mesh.cell.edges].reshape(-1, 3).T
            points[middle] = (points[start] + points[end]) / 2
        return replace(mesh, points=points)

    parts.build_mesh = moved_mesh
    try:
        yield
    finally:
        parts.build_mesh = build


def patch_errors(answer, stress: np.ndarray = STRESS) -> SimpleNamespace:
    """Of an answer to a `patch`: the largest errors of displacements and tractions, relative to the exact ones, of the
    bodies of this rank and of all contacts."""
    strain = ((1 + POISSON) * stress - POISSON * np.trace(stress) * np.eye(3)) / YOUNG
    u = max(
        (
            np.abs(body.displacement - body.points @ strain.T).max()
            / np.abs(body.points @ strain.T).max()
            for body in answer.bodies.values()
        ),
        default=0.0,
    )
    size = np.abs(stress).max()
    t = max(
        np.abs(state.forces / state.interface.area[:, None] - state.interface.normal @ stress).max()
        / size
        for state in answer.contacts.values()
    )
    return SimpleNamespace(displacement=float(u), traction=float(t))
