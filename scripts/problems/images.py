"""Verification problems of bodies that touch themselves, and of sectors and cells, which touch their images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from boundaries import rectangle
from slits import write

from ddmpi.mesh.mesh import Mesh
from ddmpi.run.answer import Answer
from problems import AROUND, Order, Results, X, along, off, problem
from problems.bodies import annulus, body, contact, coulomb, number, plane, solved

YOUNG, POISSON = 2e11, 0.3

MODULUS = YOUNG / (1.0 - POISSON**2)

EDGE = 12.0
"""Half of the plate's sides, over half of the crack."""


def graded(fine: float, size: float, growth: float, far: float) -> np.ndarray:
    """Places from 0 to `far`, of a `size` as far as `fine`, and then growing."""
    places, step = list(np.arange(round(fine / size) + 1) * size), size
    start = places[-1]
    while places[-1] < far:
        step *= growth
        places.append(places[-1] + step)
    x = np.array(places)
    beyond = x > start
    x[beyond] = start + (x[beyond] - start) * (far - start) / (x[-1] - start)
    return x


def plate(n: int, cracked: bool) -> Mesh:
    """A square plate with a crack from −1 to 1 on y = 0, of n cells on its half; groups low and up are its sides."""
    x = graded(1.25, 1.0 / n, 1.25, EDGE)
    y = graded(0.0, 1.0 / n, 1.25, EDGE)
    x, y = np.concatenate([-x[:0:-1], x]), np.concatenate([-y[:0:-1], y])
    columns, rows = len(x), len(y)
    points = np.column_stack([np.tile(x, rows), np.repeat(y, columns)])
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    quads = np.column_stack([corner, corner + 1, corner + columns + 1, corner + columns])
    middle = points[quads].mean(axis=1)
    twin = np.arange(len(points))
    if cracked:
        inside = (points[:, 1] == 0.0) & (np.abs(points[:, 0]) < 1.0 - 1e-9)
        twin[inside] = len(points) + np.arange(inside.sum())
        points = np.concatenate([points, points[inside]])
    lips = (points[: len(twin), 1] == 0.0) & (np.abs(points[: len(twin), 0]) < 1.0 + 1e-9)
    on_lips = np.flatnonzero(lips)
    low = np.column_stack([on_lips[:-1], on_lips[1:]])
    above = middle[:, 1] > 0.0
    quads[above] = twin[quads[above]]
    # diagonals are alike about the middle
    forward = middle[:, 0] * middle[:, 1] > 0.0
    cut = np.where(forward[:, None], quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [0, 1, 3, 1, 2, 3]])

    def line(nodes: np.ndarray) -> np.ndarray:
        return np.column_stack([nodes[:-1], nodes[1:]])

    numbers = np.arange(rows * columns).reshape(rows, columns)
    groups = {
        "bottom": line(numbers[0]),
        "top": line(numbers[-1]),
        "left": line(numbers[:, 0]),
        "right": line(numbers[:, -1]),
    }
    if cracked:
        groups |= {"low": low, "up": twin[low]}
    return Mesh(points, cut.reshape(-1, 3), groups)


def without_motion(points: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Displacements (k, 2) without the rigid motion that is nearest."""
    motions = np.zeros((len(points), 2, 3))
    motions[:, 0, 0] = motions[:, 1, 1] = 1.0
    motions[:, :, 2] = points[:, ::-1] * (-1.0, 1.0)
    R = motions.reshape(-1, 3)
    return u - (R @ np.linalg.lstsq(R, u.ravel(), rcond=None)[0]).reshape(-1, 2)


@problem("A crack that closes", (10, 20, 40), "cells on half of the crack")
def crack(n: int, order: Order, folder: Path) -> Results:
    pressed, sheared = 1e7, 8e6

    def loaded(cracked: bool, friction: float) -> Answer:
        file = write(folder / f"plate-{n}-{cracked}.msh", plate(n, cracked))
        shear = {"top": (sheared, 0.0), "bottom": (-sheared, 0.0)}
        shear |= {"right": (0.0, sheared), "left": (0.0, -sheared)}
        square = body(
            "plate", {"file": file, "order": number(order)}, YOUNG, POISSON, traction=shear
        )
        square["traction"] += [{"on": side, "pressure": pressed} for side in shear]
        lips = contact("plate", "plate", "low", "up", friction=coulomb(friction), name="lips")
        return solved([square], [lips] if cracked else [], tolerance=1e-11)

    whole, stuck, answer = loaded(False, 0.0), loaded(True, 0.9), loaded(True, 0.3)
    one, other = (each.bodies["plate"] for each in (stuck, whole))
    there = {tuple(point): u for point, u in zip(other.points, other.displacement, strict=True)}
    known = np.array([there[tuple(point)] for point in one.points])
    moved = without_motion(one.points, one.displacement)
    slid = answer.contacts["lips"]
    x, slip = slid.interface.xy[:, 0], np.abs(slid.slip.ravel())
    inner = np.abs(x) < 0.9
    driving = sheared - 0.3 * pressed
    # slip of a crack in an infinite plate: 4 τ √(a² − x²) / E', and K_II = τ √(π a)
    form = 4.0 / MODULUS * np.sqrt(np.maximum(1.0 - x**2, 0.0))
    factor = float(slip @ form / (form @ form)) * np.sqrt(np.pi)
    middle = float(slip[np.abs(x).argmin()])
    ratio = np.abs(slid.shear.ravel() / slid.pressure)[inner]
    return (
        {
            "displacement where it sticks, less the plate without a crack": (
                off(moved, without_motion(one.points, known)),
                1e-9,
            ),
            "worst pressure, to 0.9 of the crack": (
                off(slid.pressure[inner], np.full(inner.sum(), pressed)),
                1e-3,
            ),
            "worst friction over pressure": (off(ratio, np.full(len(ratio), 0.3)), 1e-8),
            "slip in the middle (m)": (middle, 4.0 * driving / MODULUS, 0.1),
            "K_II by slip (Pa √m)": (factor, driving * np.sqrt(np.pi), 0.15),
        },
        answer,
        along(
            slid,
            lambda x: driving * 4.0 / MODULUS * np.sqrt(np.maximum(1.0 - x**2, 0.0)),
            X,
            "slip (m)",
            values=slip,
        ),
    )


@problem("A split ring whose ears meet", (60, 120, 240), "sides around")
def split_ring(n: int, order: Order, folder: Path) -> Results:
    pressed = 3e6
    a, b, slit = 9.0, 10.0, 1.0

    def part(name: str, start: float, end: float, share: float, cells: int, **keys: Any) -> dict:
        mesh = annulus((a, b), (cells, 4), order, folder, (start, end))
        piece = body(name, mesh, YOUNG, POISSON) | keys
        # what the pressure would do on the ears' openings balances it
        left = -2.0 * share * pressed * b * np.sin(np.radians(slit))
        piece["traction"] = [
            {"on": "outer", "pressure": pressed},
            {"on": "outer", "force": [left, 0.0]},
        ]
        return piece

    def ears(*bodies: str) -> dict:
        return contact(*bodies, "start", "end", name="ears")

    one = solved(
        [part("ring", slit, 360.0 - slit, 1.0, n)], [ears("ring", "ring")], tolerance=1e-11
    )
    two = solved(
        [part("upper", slit, 180.0, 0.5, n // 2), part("lower", 180.0, 360.0 - slit, 0.5, n // 2)],
        [
            ears("upper", "lower"),
            contact("upper", "lower", "end", "start", kind="bonded", name="back"),
        ],
        tolerance=1e-11,
    )
    mirrored = solved(
        [part("ring", slit, 180.0, 0.5, n // 2, clamp=[{"on": "end", "y": 0.0}])],
        [contact("ring", "mirror", "start", name="ears")],
        [plane("mirror", (0.0, 0.0), (0.0, 1.0))],
    )
    forces = [each.summary["contacts"]["ears"]["normal_force"] for each in (one, mirrored)]
    ours, theirs = one.contacts["ears"], two.contacts["ears"]
    return (
        {
            "worst force, one body less two that are bonded": (
                off(ours.normal_force, theirs.normal_force),
                1e-8,
            ),
            "worst gap, one body less two that are bonded": (off(ours.gap, theirs.gap), 1e-8),
            "normal force (N/m), and that of a half on a mirror": (*forces, 1e-3),
        },
        one,
        along(ours, lambda x: np.interp(x, theirs.interface.xy[:, 0], theirs.pressure), X),
    )


@problem("A rotating disc as a sector", (1, 2, 4))
def rotating_sector(n: int, order: Order, folder: Path) -> Results:
    a, b, spin = 1.0, 4.0, 7.8e3 * 300.0**2

    def disc(start: float, end: float, cells: int) -> dict:
        mesh = annulus((a, b), (cells, 6 * n), order, folder, (start, end))
        piece = body("disc", mesh, YOUNG, POISSON, plane="stress")
        return piece | {"volume_force": [f"{spin} * x", f"{spin} * y"]}

    flanks = contact("disc", "disc", "end", "start", kind="bonded", name="flanks")
    one = solved([disc(0.0, 60.0, 4 * n)], [flanks | {"image": {"turn": 60.0}}], tolerance=1e-12)
    whole = solved([disc(0.0, 360.0, 24 * n)], [], tolerance=1e-12)

    def outward(answer: Answer) -> tuple[np.ndarray, np.ndarray]:
        found = answer.bodies["disc"]
        r = np.linalg.norm(found.points, axis=1)
        return r, (found.points * found.displacement).sum(axis=1) / r

    (r, u), (_, right) = outward(one), outward(whole)
    at = {tuple(np.round(point, 9)): k for k, point in enumerate(whole.bodies["disc"].points)}
    same = [at[tuple(np.round(point, 9))] for point in one.bodies["disc"].points]
    nu = POISSON
    # Timoshenko and Goodier, Theory of Elasticity, article 32
    exact = (
        spin
        * b
        / (8.0 * YOUNG)
        * ((1 - nu) * (3 + nu) * (a**2 + b**2) + (1 + nu) * (3 + nu) * a**2 - (1 - nu**2) * b**2)
    )
    state = one.contacts["flanks"]
    hoop = spin / 8.0 * (3 + nu)

    def across(x: np.ndarray) -> np.ndarray:
        return -hoop * (a**2 + b**2 + a**2 * b**2 / x**2 - (1 + 3 * nu) / (3 + nu) * x**2)

    return (
        {
            "worst radial displacement, sector less whole": (off(u, right[same]), 1e-9),
            "worst von Mises stress, sector less whole": (
                off(
                    np.sort(one.bodies["disc"].von_mises),
                    np.sort(whole.bodies["disc"].von_mises)[::6],
                ),
                1e-8,
            ),
            "radial displacement of the rim (m)": (u[np.abs(r - b) < 1e-9].mean(), exact, 0.03),
        },
        one,
        along(
            state,
            across,
            AROUND._replace(of=lambda xy: np.hypot(*xy.T)),
            "pressure on the flank (Pa)",
        ),
    )


@problem("A cell of a wavy face", (16, 32, 64), "cells on a wave")
def wave(n: int, order: Order, folder: Path) -> Results:
    length, amplitude, depth = 2.0, 1e-4, 4.0
    modulus = MODULUS
    full = np.pi * modulus * amplitude / length  # flattens the wave
    pressed = 0.5 * full

    def cell(start: float) -> Answer:
        mesh = rectangle((n, 3 * n // 2), (length, depth), (start, 0.0))
        points = mesh.points.copy()
        # finer towards the wave
        points[:, 1] = depth * (points[:, 1] / depth) ** 1.5
        fade = 1.0 - points[:, 1] / depth
        points[:, 1] += amplitude * (1.0 - np.cos(2 * np.pi * points[:, 0] / length)) * fade
        file = write(folder / f"wave-{n}-{start:g}.msh", Mesh(points, mesh.triangles, mesh.groups))
        layer = body("layer", {"file": file, "order": number(order)}, YOUNG, POISSON)
        layer["traction"] = [{"on": "top", "pressure": pressed}]
        image = {"shift": [-length, 0.0]}
        return solved(
            [layer],
            [
                contact(
                    "layer", "layer", "left", "right", kind="bonded", name="flank", image=image
                ),
                contact("layer", "floor", "bottom", name="base"),
            ],
            [plane("floor", (0.0, 0.0), (0.0, 1.0))],
            tolerance=1e-11,
        )

    centred, shifted = cell(-0.5 * length), cell(0.0)
    state, moved = centred.contacts["base"], shifted.contacts["base"]
    # both ends of a cell are one place
    forces = []
    for each in (state, moved):
        place = np.round(each.interface.xy[:, 0] % length, 9) % length
        at = np.unique(place, return_inverse=True)[1].ravel()
        forces.append(np.bincount(at, each.normal_force))

    def exact(x: np.ndarray) -> np.ndarray:
        # Westergaard 1939; Johnson, Contact Mechanics, 13.2: sin² (π a/λ) = p̄/p*
        limit, phase = pressed / full, np.pi * x / length
        inside = np.maximum(limit - np.sin(phase) ** 2, 0.0)
        return 2.0 * pressed * np.cos(phase) / limit * np.sqrt(inside)

    return (
        {
            "worst force, of a cell cut at troughs less one cut at crests": (
                off(*forces),
                1e-8 if number(order) == 1 else 5e-3,
            ),
            "largest pressure (Pa)": (
                float(state.pressure.max()),
                2.0 * pressed / np.sqrt(0.5),
                0.05,
            ),
        },
        centred,
        along(state, exact, X),
    )
