"""Verification problems of quadrilaterals and hexahedra, each beside the same mesh cut into triangles or tetrahedra."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.run.answer import Answer
from ddmpi.scene.bodies import MeshSpec
from problems import (
    ANGLE,
    Curve,
    Order,
    Results,
    along,
    mean_pressure,
    nodes_off,
    problem,
    side_means,
)
from problems.bodies import (
    FLOOR,
    QUARTER,
    RADIUS,
    annulus,
    body,
    contact,
    held,
    number,
    plane,
    solved,
)
from problems.forms import hertz_values, lame_fit, plane_strain
from problems.supports import bolt, tightened

Place = Callable[[np.ndarray], np.ndarray]
"""Where points of the unit square or cube are (k, d)."""

KINDS = {2: ("quadrilaterals", "triangles"), 3: ("hexahedra", "tetrahedra")}
"""Words for bricks and for what they are cut into, by dimension."""


def mapped(divisions: tuple[int, ...], place: Place, order: Order, cut: bool) -> dict:
    """A mesh of bricks, as arrays: those of the unit square or cube at their places, or cut there."""
    d = len(divisions)
    spec = MeshSpec(
        shape="rectangle" if d == 2 else "box",
        origin=(0.0,) * d,
        size=(1.0,) * d,
        divisions=divisions,
        elements="bricks",
    )
    mesh = raise_order(generate_rectangle(spec), "", number(order))
    arrays = {"points": place(mesh.points), "cells": mesh.triangles, "groups": mesh.groups}
    return arrays | ({"cut": True} if cut else {})


def unknowns(answer: Answer) -> int:
    return sum(each["n"] for each in answer.summary["bodies"].values())


def beside(of: Callable[[bool], tuple[Mapping[str, tuple], Answer]], d: int, by: str) -> dict:
    """The values of bricks and of what they are cut into, how many unknowns bricks have for one of the others, and how
    large their error `by` is beside that of the others."""
    values, errors, numbers = {}, [], []
    for cut, kind in enumerate(KINDS[d]):
        found, answer = of(bool(cut))
        values |= {f"{name}, {kind}": each for name, each in found.items()}
        computed, *exact, _ = found[by]
        errors.append(abs(computed / exact[0] - 1.0) if exact else computed)
        numbers.append(unknowns(answer))
    return values | {
        "unknowns over those of simplices": (numbers[0] / numbers[1], 1.02),
        f"error over that of simplices: {by}": (errors[0] / errors[1], 1.15),
    }


@problem(
    "Two rings with interference, of quadrilaterals",
    (12, 24, 48),
    "sides on a quarter of the inner ring",
)
def brick_rings(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, E, nu = 0.5, 1.0, 1.5, 1e-5, 1e9, 0.3
    exact, drawn = lame_fit(a, b, c, fit, plane_strain(E, nu)), []

    def of(cut: bool) -> tuple[Mapping[str, tuple], Answer]:
        elements = {} if cut else {"elements": "bricks"}
        shaft = annulus((a, b + fit), (n, n // 2), order, folder) | elements
        hub = annulus((b, c), (5 * n // 4, n // 2), order, folder) | elements
        answer = solved(
            [body("shaft", shaft, E, nu, QUARTER), body("hub", hub, E, nu, QUARTER)],
            [contact("shaft", "hub", "outer", "inner")],
        )
        drawn.append(answer)
        means = side_means(answer.contacts["shaft-hub"])
        allowed = 2e-2 if order == 1 else 2e-3
        return {
            "mean pressure (Pa)": (means.mean, exact, allowed),
            "side means": (means.off(exact), allowed),
        }, answer

    values = beside(of, 2, "side means")
    return values, drawn[0], along(drawn[0].contacts["shaft-hub"], exact, ANGLE)


@problem(
    "A ball on a rigid plane, of hexahedra",
    (4, 6),
    "nodes on a, of tetrahedra",
    in_space=True,
    tested=3,
)
def brick_hertz(n: int, order: Order, folder: Path) -> Results:
    a, width, height, poisson, drawn = 0.06, 0.5, 0.6, 0.3, []

    def mesh(finer: float, cut: bool) -> dict:
        cells = finer * n / number(order)
        marks = [spacings(a, end, cells) for end in (width, width, height)]

        def place(unit: np.ndarray) -> np.ndarray:
            x, y, z = (
                np.interp(at * (len(each) - 1), np.arange(len(each)), each)
                for at, each in zip(unit.T, marks, strict=True)
            )
            low = RADIUS - np.sqrt(RADIUS**2 - x**2 - y**2)
            return np.column_stack([x, y, low + z / height * (height - low)])

        return mapped(tuple(len(each) - 1 for each in marks), place, order, cut)

    modulus, clamp = plane_strain(1.0, poisson)[0], held(left="x", front="y", top={"z": -0.0042})

    def press(finer: float, cut: bool) -> tuple[dict, Answer, Curve]:
        ball = body("ball", mesh(finer, cut), 1.0, poisson, clamp)
        answer = solved([ball], [contact("ball", "floor", "bottom")], [FLOOR])
        state = answer.contacts["ball-floor"]
        values, curve = hertz_values(state, 4, modulus, RADIUS, (0.06, 0.06 if n > 3 else 0.08))
        at = np.linalg.norm(state.interface.xy[:, :2], axis=1)
        known = np.interp(at, curve.exact_x, curve.exact, right=0.0)
        return values | {"nodal pressures": (nodes_off(state, known), 0.2)}, answer, curve

    def of(cut: bool) -> tuple[Mapping[str, tuple], Answer]:
        finer = 1.2 if order == 2 and not cut else 1.0  # for as many unknowns
        # Errors depend on where the contact ends between two nodes.
        meshes = (1.0, 1.08, 1.16) if n > 3 else (1.08,)
        found = [press(finer * more, cut) for more in meshes]
        values, answer, curve = found[0]
        drawn.append((answer, curve))
        errors = [each["nodal pressures"][0] for each, _, _ in found]
        mean = float(np.sqrt(np.mean(np.square(errors))))
        return values | {"nodal pressures of three meshes": (mean, 0.2)}, answer

    values = beside(of, 3, "nodal pressures of three meshes")
    return values, *drawn[0]


def spacings(a: float, end: float, n: float) -> np.ndarray:
    """Coordinates from 0 to `end`, n cells on a, as wide up to 1.5 a, then each 1.4 times as wide as the one before."""
    marks = [0.0]
    while marks[-1] < end:
        step = a / n if marks[-1] < 1.5 * a else 1.4 * (marks[-1] - marks[-2])
        marks.append(marks[-1] + step)
    return np.array(marks) * end / marks[-1]


@problem(
    "Two tubes with interference, of hexahedra", (3, 6), "elements across the wall", in_space=True
)
def brick_tubes(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, E, nu = 0.3, 0.6, 0.9, 6e-5, 2e11, 0.3
    exact, drawn = lame_fit(a, b, c, fit, plane_strain(E, nu)), []

    def tube(inner: float, outer: float, sides: int, cut: bool) -> dict:
        def place(unit: np.ndarray) -> np.ndarray:
            r, angle = inner + (outer - inner) * unit[:, 0], np.pi / 2.0 * unit[:, 1]
            return np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.2 * unit[:, 2]])

        return mapped((n, sides, max(n // 2, 2)), place, order, cut)

    def of(cut: bool) -> tuple[Mapping[str, tuple], Answer]:
        ends = held(front="y", back="x", bottom="z", top="z")
        answer = solved(
            [
                body("inner", tube(a, b + fit, 4 * n, cut), E, nu, ends),
                body("outer", tube(b, c, 5 * n, cut), E, nu, ends),
            ],
            [contact("inner", "outer", "right", "left")],
        )
        drawn.append(answer)
        state = answer.contacts["inner-outer"]
        mean, nodes = {1: (0.12, 0.7), 2: (0.03, 0.5)}[number(order)]
        return {
            "mean pressure (Pa)": (mean_pressure(state), exact, mean),
            "nodes, in L2": (nodes_off(state, exact), nodes),
        }, answer

    values = beside(of, 3, "nodes, in L2")
    return values, drawn[0], along(drawn[0].contacts["inner-outer"], exact, ANGLE)


@problem("A bolted joint, of bricks")
def brick_bolt(n: int, order: Order, folder: Path) -> Results:
    turned, answer, curve = bolt(n, order, elements="bricks")

    def piece(name: str, x: float, low: float, width: float, height: float, across: int) -> dict:
        """A box 10 mm deep."""
        mesh = {
            "shape": "box",
            "origin": [x, 0.0, low],
            "size": [width, 10.0, height],
            "divisions": [across * n, n, 3 * n],
            "order": number(order),
            "elements": "bricks",
        }
        young = 7e4 if name == "tube" else 2.1e5
        return body(name, mesh, young, 0.0, held(bottom="z") if low == 0.0 else [])

    pieces = [
        piece("lower", 0.0, 0.0, 10.0, 50.0, 2),
        piece("upper", 0.0, 50.0, 10.0, 50.0, 3),
        piece("tube", 15.0, 0.0, 20.0, 100.0, 2),
    ]
    head = plane("head", (0.0, 0.0, 100.0), (0.0, 0.0, -1.0))
    boxes, _ = tightened(pieces, head, 2.1e5 * 100.0 / 100.0, 7e4 * 200.0 / 100.0)
    values = {
        f"{name.replace(' (', f', {kind} (')}": each
        for kind, found in (("quadrilaterals around an axis", turned), ("hexahedra", boxes))
        for name, each in found.items()
    }
    return values, answer, curve
