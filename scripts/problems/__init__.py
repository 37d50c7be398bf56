"""What the verification problems share: their form, and what is compared.

docs/tables/verification.md says what each problem shows, what its scene is, and where the exact values are from. They
stand in flat.py, curved.py, supports.py, images.py, around_axis.py, moving.py, solids.py and bricks.py; bodies.py and
revolved.py have what their scenes are made of, forms.py the closed forms that some share.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import experiment  # noqa: F401, with which the helpers of the tests can be imported
import numpy as np

from ddmpi.interface.state import ContactState
from ddmpi.run.answer import Answer

Order = int | str
"""1, 2, or "2 straight": quadratic elements whose sides are straight, wherever the boundary is curved."""


@dataclass(frozen=True)
class Value:
    """A number that was computed, the exact one, and how far apart they may be on any of the meshes.

    `allowed` counts relative to `exact`, or as it is where `exact` is zero: the value is an error itself.
    """

    computed: float
    exact: float
    allowed: float

    @property
    def error(self) -> float:
        return self.computed - self.exact if self.exact == 0.0 else self.computed / self.exact - 1.0

    @property
    def met(self) -> bool:
        return abs(self.error) <= self.allowed


class Curve(NamedTuple):
    """What was computed along a contact, and what is exact, for the picture."""

    x: np.ndarray
    computed: np.ndarray
    exact_x: np.ndarray
    exact: np.ndarray
    xlabel: str
    ylabel: str = "pressure (Pa)"
    known: str = "exact"


@dataclass(frozen=True)
class Found:
    """What one mesh gives: values by name, an answer to draw, a curve."""

    values: Mapping[str, Value]
    answer: Answer | None
    curve: Curve


@dataclass(frozen=True)
class Problem:
    """One section of the page.

    Attributes
    ----------
    name, title : short, and in words, which are the heading in the page
    measure : (n, order, folder) → what is found; meshes that gmsh draws go into the folder
    meshes : n of three meshes, the coarsest first
    tested : n of the mesh that a test runs: the coarsest one, or one that the page does not show
    unit : what n counts
    orders : of the elements
    view : of the picture: x from, to, y from, to
    in_space : whether its bodies are solids
    """

    name: str
    title: str
    measure: Callable[[int, Order, Path], Found]
    meshes: tuple[int, ...]
    tested: int
    unit: str
    orders: tuple[Order, ...]
    view: tuple[float, float, float, float] | None
    in_space: bool


PROBLEMS: dict[str, Problem] = {}

Results = tuple[dict[str, tuple], Answer, Curve]
"""What a problem's function gives: by name (computed, exact, allowed) or (error, allowed); what to draw."""


def problem(
    title: str,
    meshes: tuple[int, ...] = (1, 2, 4),
    unit: str = "times finer than the coarsest meshes",
    orders: tuple[Order, ...] = (1, 2),
    view: tuple[float, ...] | None = None,
    in_space: bool = False,
    tested: int | None = None,
) -> Callable:
    """Decorator: makes a Problem in PROBLEMS of a function (n, order, folder) → `Results`, with - for _ in its name."""

    def register(
        function: Callable[[int, Order, Path], Results],
    ) -> Callable[[int, Order, Path], Found]:
        @functools.wraps(function)
        def measure(n: int, order: Order, folder: Path) -> Found:
            values, answer, curve = function(n, order, folder)
            return Found(
                {
                    name: Value(float(computed), float(exact[0]) if exact else 0.0, allowed)
                    for name, (computed, *exact, allowed) in values.items()
                },
                answer,
                curve,
            )

        name = function.__name__.replace("_", "-")
        solid = in_space or function.__module__.endswith("solids")
        coarsest = meshes[0] if tested is None else tested
        PROBLEMS[name] = Problem(name, title, measure, meshes, coarsest, unit, orders, view, solid)
        return measure

    return register


# What is compared


class SideMeans(NamedTuple):
    """Mean pressures over the sides of elements along a contact: middles (k, 2), lengths (k,), pressures (k,)."""

    xy: np.ndarray
    length: np.ndarray
    pressure: np.ndarray

    def off(self, exact: np.ndarray | float) -> float:
        """Of the exact pressure, in L2."""
        return distance(self.pressure, exact, self.length)

    @property
    def mean(self) -> float:
        return float(self.length @ self.pressure / self.length.sum())


def side_means(state: ContactState) -> SideMeans:
    """Of nodal pressures: by Simpson's rule on quadratic sides, of both ends on linear ones."""
    interface, p = state.interface, state.pressure
    start, end, *middle = interface.geometry.facets.T
    mean = (p[start] + 4 * p[middle[0]] + p[end]) / 6 if middle else (p[start] + p[end]) / 2
    a, b = interface.xy[start], interface.xy[end]
    return SideMeans((a + b) / 2, np.linalg.norm(b - a, axis=1), mean)


def distance(computed: np.ndarray, exact: np.ndarray | float, length: np.ndarray) -> float:
    """Of two functions on the contact, in L2, relative to the exact one."""
    exact = np.broadcast_to(exact, computed.shape)
    return float(np.sqrt(length @ (computed - exact) ** 2 / (length @ exact**2)))


def nodes_off(state: ContactState, exact: np.ndarray | float) -> float:
    """The distance of nodal pressures from exact ones."""
    return distance(state.pressure, exact, state.interface.area)


def off(values: np.ndarray, exact: np.ndarray | float) -> float:
    """The largest difference of values or vectors from exact ones, relative to the largest of these."""
    return float(np.abs(values - exact).max() / np.abs(exact).max())


def worst(state: ContactState, pressure: float, shear: float | None = 0.0) -> float:
    """The largest difference of nodal stresses from constant ones, relative to the larger of these.

    Where `shear` is None, tangential stresses do not count.
    """
    tangential = state.shear[state.interface.sliding] - (shear or 0.0)
    if shear is None:
        tangential, shear = np.zeros(0), 0.0
    return float(
        max(np.abs(state.pressure - pressure).max(), np.abs(tangential).max(initial=0.0))
        / max(abs(pressure), abs(shear))
    )


def mean_pressure(state: ContactState) -> float:
    return float(state.normal_force.sum() / state.interface.area.sum())


class Position(NamedTuple):
    """A coordinate of places (k, d), and its name."""

    of: Callable[[np.ndarray], np.ndarray]
    label: str

    def __call__(self, places: np.ndarray) -> np.ndarray:
        return self.of(places)


X, Y = (Position(lambda xy, k=k: xy[:, k], f"{'xy'[k]} (m)") for k in (0, 1))
ANGLE = Position(lambda xy: np.degrees(np.arctan2(xy[:, 1], xy[:, 0])), "angle (°)")
"""About the origin or the axis z, from x."""

AROUND = X._replace(label="r (m)")
AWAY = Position(lambda xy: np.hypot(*xy[:, :2].T), "r (m)")
"""Distances from the axis: of the plane of an axisymmetric scene, and in space."""


def along(
    state: ContactState,
    exact: Callable[[np.ndarray], np.ndarray] | float,
    position: Position,
    ylabel: str = "pressure (Pa)",
    limit: float = np.inf,
    values: np.ndarray | None = None,
) -> Curve:
    """The pressure (or other values) over a position of the nodes (k, d), up to a limit of it, and the exact one."""
    at = position(state.interface.xy)
    order = np.argsort(at)[np.sort(at) <= limit]
    x = np.linspace(at[order[0]], at[order[-1]], 400)
    known = exact(x) if callable(exact) else np.full(len(x), exact)
    return Curve(
        at[order],
        (state.pressure if values is None else values)[order],
        x,
        known,
        position.label,
        ylabel,
    )
