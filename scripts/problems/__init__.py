"""What the verification problems share: their form, scenes in few words, meshes drawn by gmsh, norms of errors.

The problems stand in flat.py, curved.py, supports.py and solids.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import experiment  # noqa: F401, with which the helpers of the tests can be imported
import numpy as np
from mpi4py import MPI
from scenes import to_toml

import ddmpi
from ddmpi.interface.state import ContactState
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import gmsh_session
from ddmpi.mesh.shapes import generate_annulus
from ddmpi.run.answer import Answer
from ddmpi.scene.bodies import MeshSpec

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


@dataclass(frozen=True)
class Curve:
    """What was computed along a contact, and what is exact, for the picture."""

    x: np.ndarray
    computed: np.ndarray
    exact_x: np.ndarray
    exact: np.ndarray
    xlabel: str
    ylabel: str
    known: str = "exact"


@dataclass(frozen=True)
class Found:
    """What one mesh gives: values by name, an answer to draw, a curve."""

    values: Mapping[str, Value]
    answer: Answer | None
    curve: Curve | None = None


@dataclass(frozen=True)
class Problem:
    """One section of the page.

    Attributes
    ----------
    name, title : short, and in words
    shows, scene, source : what the problem shows; its bodies; the formula, or where it is from
    measure : (n, order, folder) → what is found; meshes that gmsh draws go into the folder
    meshes : n of three meshes, the coarsest first; a test runs that one
    unit : what n counts
    orders : of the elements
    view : of the picture: x from, to, y from, to
    """

    name: str
    title: str
    shows: str
    scene: str
    source: str
    measure: Callable[[int, Order, Path], Found]
    meshes: tuple[int, ...]
    unit: str
    orders: tuple[Order, ...] = (1, 2)
    view: tuple[float, float, float, float] | None = None

    @property
    def in_space(self) -> bool:
        return self.measure.__module__.endswith("solids")


PROBLEMS: dict[str, Problem] = {}


def problem(name: str, title: str, meshes: tuple[int, ...], unit: str, **words) -> Callable[[Callable], Callable]:
    """Decorator: makes a Problem of a function `measure`, under its name in PROBLEMS."""
    def register(measure: Callable[[int, Order, Path], Found]) -> Callable[[int, Order, Path], Found]:
        PROBLEMS[name] = Problem(name, title, measure=measure, meshes=meshes, unit=unit, **words)
        return measure
    return register


# Scenes

def body(name: str, mesh: dict, young: float, poisson: float, clamp: Sequence[dict | str] = (),
         traction: Mapping[str, Sequence[float]] | None = None, **more) -> dict:
    """A body; tractions by group. Further keys go to the material."""
    return {"name": name, "mesh": mesh, "material": {"young": young, "poisson": poisson} | more,
            "clamp": list(clamp), "traction": [{"on": on, "value": list(value)} for on, value in
                                               (traction or {}).items()]}


def block(x: float, y: float, width: float, height: float, divisions: tuple[int, int], order: Order) -> dict:
    return {"shape": "rectangle", "origin": [x, y], "size": [width, height], "divisions": list(divisions),
            "order": number(order)}


def annulus(radii: tuple[float, float], divisions: tuple[int, int], order: Order, folder: Path,
            angles: tuple[float, float] = (0.0, 90.0)) -> dict:
    """A part of a ring; of order "2 straight" as a file of linear elements, which the program raises."""
    mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": list(radii), "angles": list(angles),
            "divisions": list(divisions)}
    if order == "2 straight":
        made = ring_of(radii, divisions, angles)
        return write(folder / f"ring_{radii[0]}_{radii[1]}.msh", made, made.groups, order)
    return mesh | {"order": number(order)}


def ring_of(radii: tuple[float, float], divisions: tuple[int, int], angles: tuple[float, float]) -> Mesh:
    return generate_annulus(MeshSpec(shape="annulus", center=(0.0, 0.0), radii=radii, angles=angles,
                                     divisions=divisions))


def write(path: Path, mesh: Mesh, groups: Mapping[str, np.ndarray], order: Order) -> dict:
    """A file of a linear mesh with the edges (k, 2) of its groups."""
    import meshio

    lines = np.concatenate(list(groups.values()))
    physical = np.repeat(np.arange(len(groups)) + 1, [len(each) for each in groups.values()])
    whole = np.full(len(mesh.triangles), len(groups) + 1)
    meshio.write(path, meshio.Mesh(
        np.column_stack([mesh.points, np.zeros(len(mesh.points))]), [("line", lines), ("triangle", mesh.triangles)],
        cell_data={key: [physical, whole] for key in ("gmsh:physical", "gmsh:geometrical")},
        field_data={name: np.array([k + 1, 1]) for k, name in enumerate(groups)}), file_format="gmsh22", binary=False)
    return {"file": str(path), "order": number(order)}


def number(order: Order) -> int:
    return order if isinstance(order, int) else 2


def contact(first: str, second: str, *on: str, **more) -> dict:
    return {"bodies": [first, second], "on": list(on)} | more


def coulomb(coefficient: float) -> dict:
    return {"law": "coulomb", "coefficient": coefficient}


def solved(bodies: list[dict], contacts: list[dict], rigid: Sequence[dict] = (), tolerance: float = 1e-8,
           **more) -> Answer:
    """The answer on this rank alone, of a scene with `more` tables. Stops with the reason where it is not certified."""
    scene = more | {"rigid": list(rigid), "body": bodies, "contact": contacts, "method": {"tolerance": tolerance}}
    answer = ddmpi.solve(to_toml(scene), MPI.COMM_SELF)
    if not answer.certified:
        raise RuntimeError(answer.reason)
    return answer


def draw(path: Path, corners: Mapping[str, tuple[float, float]], lines: Mapping[str, Sequence[str]], size: str,
         order: Order, groups: Mapping[str, Sequence[str]] | None = None) -> dict:
    """The mesh of a plane figure by gmsh.

    Parameters
    ----------
    corners : points by name
    lines : around the figure: straight from one point to another, or an arc from the first point around the second to
        the third; each is a group
    size : of the elements, as gmsh reads a formula in x and y; quadratic ones are twice as large
    groups : more groups, of several lines
    """
    with gmsh_session() as gmsh:
        geometry, field = gmsh.model.geo, gmsh.model.mesh.field
        points = {name: geometry.addPoint(x, y, 0.0) for name, (x, y) in corners.items()}
        drawn = {name: (geometry.addLine if len(ends) == 2 else geometry.addCircleArc)(*(points[end] for end in ends))
                 for name, ends in lines.items()}
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(list(drawn.values()))])
        geometry.synchronize()
        for name, some in ({name: [name] for name in lines} | dict(groups or {})).items():
            gmsh.model.addPhysicalGroup(1, [drawn[each] for each in some], name=name)
        gmsh.model.addPhysicalGroup(2, [surface], name="body")
        sizes = field.add("MathEval")
        field.setString(sizes, "F", f"{number(order)} * ({size})")
        field.setAsBackgroundMesh(sizes)
        for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    return {"file": str(path), "order": number(order)}


def lame_fit(a: float, b: float, c: float, fit: float, inner: tuple[float, float],
             outer: tuple[float, float] | None = None) -> float:
    """The pressure of rings a < b < c that overlap by `fit` at the radius b (Lamé), of one material or two.

    Materials are E and ν in plane stress, those of `plane_strain` in plane strain.
    """
    (E, nu), (F, mu) = inner, outer or inner
    return fit / b / (((b**2 + a**2) / (b**2 - a**2) - nu) / E + ((c**2 + b**2) / (c**2 - b**2) + mu) / F)


def plane_strain(young: float, poisson: float) -> tuple[float, float]:
    """The E and ν with which formulas of plane stress hold in plane strain."""
    return young / (1.0 - poisson**2), poisson / (1.0 - poisson)


def lame_ball(a: float, b: float, c: float, fit: float, young: float, poisson: float) -> float:
    """The same of a hollow ball in a shell of one material."""
    gives = [b / young * ((1 - 2 * poisson) * b**3 + (1 + poisson) * other**3 / 2) / abs(b**3 - other**3)
             for other in (a, c)]
    return fit / sum(gives)


# What is compared

@dataclass(frozen=True)
class SideMeans:
    """Mean pressures over the sides of elements along a contact: middles (k, 2), lengths (k,), pressures (k,)."""

    xy: np.ndarray
    length: np.ndarray
    pressure: np.ndarray = field(repr=False)


def side_means(state: ContactState) -> SideMeans:
    """Of nodal pressures: by Simpson's rule on quadratic sides, of both ends on linear ones."""
    interface, p = state.interface, state.pressure
    start, end, *middle = interface.facets.T
    mean = (p[start] + 4 * p[middle[0]] + p[end]) / 6 if middle else (p[start] + p[end]) / 2
    a, b = interface.xy[start], interface.xy[end]
    return SideMeans((a + b) / 2, np.linalg.norm(b - a, axis=1), mean)


def distance(computed: np.ndarray, exact: np.ndarray | float, length: np.ndarray) -> float:
    """Of two functions on the contact, in L2, relative to the exact one."""
    exact = np.broadcast_to(exact, computed.shape)
    return float(np.sqrt(length @ (computed - exact) ** 2 / (length @ exact**2)))


def worst(state: ContactState, pressure: float, shear: float | None = 0.0) -> float:
    """The largest difference of nodal stresses from constant ones, relative to the larger of these.

    Where `shear` is None, tangential stresses do not count.
    """
    tangential = state.shear[state.interface.sliding] - (shear or 0.0)
    if shear is None:
        tangential, shear = np.zeros(0), 0.0
    return float(max(np.abs(state.pressure - pressure).max(), np.abs(tangential).max(initial=0.0))
                 / max(abs(pressure), abs(shear)))


def mean_pressure(state: ContactState) -> float:
    return float(state.normal_force.sum() / state.interface.area.sum())


def degrees(xy: np.ndarray) -> np.ndarray:
    """The angles (k,) of places (k, d) about the origin or the axis z, from x (degrees)."""
    return np.degrees(np.arctan2(xy[:, 1], xy[:, 0]))


def along(state: ContactState, exact: Callable[[np.ndarray], np.ndarray] | float,
          position: Callable[[np.ndarray], np.ndarray], xlabel: str, ylabel: str, limit: float = np.inf,
          values: np.ndarray | None = None) -> Curve:
    """The pressure (or other values) over a position of the nodes (k, d), up to a limit of it, and the exact one."""
    at = position(state.interface.xy)
    order = np.argsort(at)[np.sort(at) <= limit]
    x = np.linspace(at[order[0]], at[order[-1]], 400)
    known = exact(x) if callable(exact) else np.full(len(x), exact)
    return Curve(at[order], (state.pressure if values is None else values)[order], x, known, xlabel, ylabel)


def along_x(xy: np.ndarray) -> np.ndarray:
    return xy[:, 0]


def hertz_values(state: ContactState, parts: int, modulus: float, radius: float,
                 allowed: tuple[float, float]) -> tuple[dict[str, Value], Curve]:
    """The greatest pressure and the radius of a contact of which 1/`parts` is modelled, beside those of its force.

    The pressure by least squares of p² over r² up to 0.8 a, the radius by the second moment, Σ s r² = 2/5 P a².
    """
    def from_axis(xy: np.ndarray) -> np.ndarray:
        return np.hypot(*xy[:, :2].T) if xy.shape[1] == 3 else xy[:, 0]

    force, r, p = float(state.normal_force.sum()), from_axis(state.interface.xy), state.pressure
    a = (3.0 * parts * force * radius / (4.0 * modulus)) ** (1 / 3)
    top = 3.0 * parts * force / (2.0 * np.pi * a**2)
    near = r < 0.8 * a
    _, square = np.polyfit(r[near] ** 2, p[near] ** 2, 1)
    second = np.sqrt(2.5 * float(state.normal_force @ r**2) / force)
    values = {"p₀ (Pa)": Value(float(np.sqrt(max(square, 0.0))), top, allowed[0]),
              "a (m)": Value(float(second), a, allowed[1])}
    return values, along(state, lambda x: top * np.sqrt(np.maximum(1.0 - (x / a) ** 2, 0.0)), from_axis, "r (m)",
                         "pressure (Pa)", 1.3 * a)
