"""How far is an answer from the exact one? Errors that users mean, against what is taken for exact.

Two scenes have such: pinched blocks, by a solution on a fine mesh that holds those on the coarser ones, and two
rings (rings.py), by a closed form. Both give the same `Errors`.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI
from rings import Rings

from ddmpi.body.estimate import QUADRATURE, energy_density, estimate_error, relative_error, stress_at
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.coupling.assembly import Problem, prepare
from ddmpi.mesh.elements import ELEMENTS
from ddmpi.mesh.mesh import Mesh, signed_double_areas
from ddmpi.run.solve import Answer, solve
from ddmpi.scene.bodies import Material, MeshSpec
from ddmpi.scene.scene import Scene
from ddmpi.system.agreement import agreed

SHORT = 0.01
"""Zones shorter than this part of the interface are a matter of single nodes, as at a singular corner, and are not
counted."""


@dataclass(frozen=True)
class Errors:
    """Errors of an answer, relative but for the last two; nan where there is nothing to compare.

    Attributes
    ----------
    energy : energy norm of the displacement's error, both bodies, over the energy norm of the exact one
    pressure, shear : contact pressure and tangential contact stress at the nodes, in L2 along the interface
    side_pressure : means of the contact pressure over the elements' sides, in L2; exact are those over the same sides
    normal_force, tangential_force : resultants
    contact_end, stick_end : largest distance (m) of an end of a contact zone, of a stick zone, from its true
        place; nan where there are more or fewer ends than there should be
    """

    energy: float
    pressure: float
    shear: float
    side_pressure: float
    normal_force: float
    tangential_force: float
    contact_end: float
    stick_end: float


@dataclass(frozen=True)
class Contact:
    """What happens at the contact nodes, in their order: arrays (m,).

    ``xy`` (m, 2) and ``length`` of the nodes (m), ``middle`` whether a node is the middle of a side, ``pressure`` and
    ``shear`` (Pa), ``status`` open, slip or stick.
    """

    xy: np.ndarray
    length: np.ndarray
    middle: np.ndarray
    pressure: np.ndarray
    shear: np.ndarray
    status: np.ndarray

    @property
    def x(self) -> np.ndarray:
        return self.xy[:, 0]

    def side_pressures(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x of the middle, mean pressure (Pa) and width (m) of the elements' sides whose nodes all carry forces."""
        x, p, k = self.x, self.pressure, np.flatnonzero(self.middle[1:-1]) + 1
        if len(k):
            width = np.linalg.norm(self.xy[k + 1] - self.xy[k - 1], axis=1)
            return x[k], (p[k - 1] + 4 * p[k] + p[k + 1]) / 6, width
        return (x[:-1] + x[1:]) / 2, (p[:-1] + p[1:]) / 2, np.linalg.norm(np.diff(self.xy, axis=0), axis=1)

    @property
    def normal_force(self) -> float:
        return float(self.pressure @ self.length)

    @property
    def tangential_force(self) -> float:
        return float(self.shear @ self.length)

    @property
    def contact_ends(self) -> np.ndarray:
        return zone_ends(self.x, self.status != "open")

    @property
    def stick_ends(self) -> np.ndarray:
        return zone_ends(self.x, self.status == "stick")


def contact_of(problem: Problem, answer: Answer) -> Contact:
    """The contact nodes of an answer. Not collective."""
    interface, state = problem.interface, answer.state
    return Contact(interface.xy, interface.length, interface.middle, state.normal_force / interface.length,
                   state.tangential_force / interface.length, state.status)


def zone_ends(x: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Where zones begin and end: halfway between neighbours x (m,) of which one is `inside` (m,) and one is not.

    Zones, and breaks in them, of less than SHORT are passed over, the shortest first.
    """
    change = np.flatnonzero(inside[1:] != inside[:-1])
    bounds = [x[0], *((x[change] + x[change + 1]) / 2), x[-1]]
    while len(bounds) > 2:
        widths = np.abs(np.diff(bounds))
        k = int(np.argmin(widths))
        if widths[k] >= SHORT * abs(x[-1] - x[0]):
            break
        del bounds[max(k, 1):min(k + 2, len(bounds) - 1)]
    return np.array(bounds[1:-1])


def end_error(ends: np.ndarray, exact: np.ndarray) -> float:
    """The largest distance (m) of an end from its true place; nan where their numbers differ, zero without any."""
    return float(np.abs(ends - exact).max(initial=0.0)) if len(ends) == len(exact) else np.nan


def difference(values: np.ndarray, exact: np.ndarray, length: np.ndarray) -> float:
    """Distance of nodal `values` (m,) from the `exact` ones in L2, relatively; nan where those are zero."""
    size = np.sqrt(length @ exact**2)
    return float(np.sqrt(length @ (values - exact) ** 2) / size) if size else np.nan


def side_difference(found: Contact, exact: Contact) -> float:
    """Distance of the side means of the pressure from the exact ones over the same sides, in L2, relatively.

    Along x; the ends of `found`'s sides are among those of `exact`'s.
    """
    (x, mean, width), (fine, exact_mean, fine_width) = found.side_pressures(), exact.side_pressures()
    ends = np.append(fine - fine_width / 2, fine[-1] + fine_width[-1] / 2)
    force = np.concatenate([[0.0], np.cumsum(exact_mean * fine_width)])
    left, right = (np.interp(x + side * width / 2, ends, force) for side in (-1, 1))
    return difference(mean, (right - left) / width, width)


def relative(value: float, exact: float) -> float:
    """|value − exact| / |exact|; nan where that is zero."""
    return abs(value - exact) / abs(exact) if exact else np.nan


def interpolate(mesh: Mesh, spec: MeshSpec, u: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The displacement `u` (nv, 2) of a generated rectangle at other points (k, 2) of it, (k, 2) in metres.

    `spec` is what `mesh` was generated from, order 1 or 2. Not collective.
    """
    nx, ny = spec.divisions

    def find(at: np.ndarray) -> np.ndarray:
        """Number of the place: two to a square, the one below its diagonal first."""
        place = (at - spec.origin) / spec.size * (nx, ny)
        cell = np.clip(np.floor(place).astype(int), 0, (nx - 1, ny - 1))
        inside = place - cell
        return 2 * (cell[:, 1] * nx + cell[:, 0]) + (inside[:, 1] > inside[:, 0])

    corners = mesh.points[mesh.triangles[:, :3]]
    triangle = np.empty(2 * nx * ny, dtype=np.int64)
    triangle[find(corners.mean(axis=1))] = np.arange(len(corners))
    owner = triangle[find(points)]
    a, b, c = corners[owner].swapaxes(0, 1)

    def area(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (r[:, 0] - p[:, 0]) * (q[:, 1] - p[:, 1])

    barycentric = np.stack([area(points, b, c), area(a, points, c), area(a, b, points)], axis=1)
    barycentric /= area(a, b, c)[:, None]
    shapes = ELEMENTS[mesh.triangles.shape[1]].shapes(barycentric)
    return np.einsum("ki,kic->kc", shapes, u[mesh.triangles[owner]])


class EnergyNorm:
    """The energy norm of displacements of one body's mesh, by its stiffness."""

    def __init__(self, mesh: Mesh, material: Material) -> None:
        size = 2 * len(mesh.points)
        indptr, indices, data = sum_stiffness(mesh, material).to_csr(np.ones_like(mesh.points, dtype=bool))
        self._K = sparse.csr_matrix((data, indices, indptr), (size, size))

    def squared(self, u: np.ndarray) -> float:
        """uᵀ K u (J per metre of depth) of a displacement (nv, 2)."""
        return float(u.ravel() @ (self._K @ u.ravel()))


@dataclass(frozen=True)
class FineSolution:
    """The solution of a scene of generated rectangles on a fine mesh, as one rank holds it.

    Attributes
    ----------
    mesh, u, norm : of the own body
    contact : of both
    energy : squared energy norm of both bodies (J per metre of depth)
    own_error : its own error, estimated, relative in the energy norm

    A mesh whose divisions are a whole multiple of a coarser one's, with an order at least as high, holds the
    coarser one's solutions exactly. The error of the fine solution is orthogonal to its distance from them (but
    for what the contact conditions change), so both squares add up to that of the error of the coarse one.
    """

    mesh: Mesh
    u: np.ndarray
    norm: EnergyNorm
    contact: Contact
    energy: float
    own_error: float

    def errors(self, problem: Problem, answer: Answer) -> Errors:
        """Of an answer to the same scene on a coarser mesh. Collective."""
        coarse = interpolate(problem.mesh, problem.spec.mesh, answer.displacement, self.mesh.points)
        distance = problem.world.allreduce(self.norm.squared(self.u - coarse))
        found, exact = contact_of(problem, answer), self.contact

        def along(values: np.ndarray) -> np.ndarray:
            return np.interp(exact.x, found.x, values)

        return Errors(
            energy=float(np.hypot(np.sqrt(distance / self.energy), self.own_error)),
            pressure=difference(along(found.pressure), exact.pressure, exact.length),
            shear=difference(along(found.shear), exact.shear, exact.length),
            side_pressure=side_difference(found, exact),
            normal_force=relative(found.normal_force, exact.normal_force),
            tangential_force=relative(found.tangential_force, exact.tangential_force),
            contact_end=end_error(found.contact_ends, exact.contact_ends),
            stick_end=end_error(found.stick_ends, exact.stick_ends))


def solve_reference(world: MPI.Comm, scene: Scene, path: Path) -> FineSolution:
    """The solution of `scene`, which is kept in the file `path`, npz, and read from there the next time.

    Raises what `ddmpi.run.solve.solve` does, and RuntimeError for an answer without certificate; the same on all
    ranks. Collective.
    """
    identity = json.dumps([scene.resolved(), *Contact.__dataclass_fields__], sort_keys=True)
    kept = None
    with agreed(world):
        if path.exists():
            with np.load(path) as file:
                kept = dict(file) if str(file["identity"]) == identity else None
    if not all(world.allgather(kept is not None)):
        kept = _solve(world, scene) | {"identity": identity}
        with agreed(world):
            if world.rank == 0:
                path.parent.mkdir(parents=True, exist_ok=True)
                unfinished = path.with_suffix(".unfinished.npz")
                np.savez(unfinished, **kept)
                os.replace(unfinished, path)
    spec = scene.body[world.rank]
    mesh = Mesh(kept[f"points_{world.rank}"], kept[f"triangles_{world.rank}"], {})
    norm, u = EnergyNorm(mesh, spec.material), kept[f"u_{world.rank}"]
    contact = Contact(*(kept[name] for name in Contact.__dataclass_fields__))
    return FineSolution(mesh, u, norm, contact, world.allreduce(norm.squared(u)), float(kept["own_error"]))


def _solve(world: MPI.Comm, scene: Scene) -> dict[str, np.ndarray]:
    problem = prepare(world, scene)
    answer, _ = solve(problem, scene.method)
    with agreed(world):
        if not answer.certified:
            raise RuntimeError(f"the reference solution: {answer.reason}")
    mesh = problem.mesh
    estimate = estimate_error(mesh, problem.spec.material, answer.displacement)
    found = {"own_error": np.array(relative_error(world.allreduce(estimate.total), world.allreduce(estimate.energy)))}
    for rank, arrays in enumerate(world.allgather((mesh.points, mesh.triangles, answer.displacement))):
        found |= {f"{name}_{rank}": array for name, array in zip(("points", "triangles", "u"), arrays, strict=True)}
    return found | vars(contact_of(problem, answer))


@dataclass(frozen=True)
class ClosedForm:
    """The exact solution of the rings."""

    rings: Rings

    def errors(self, problem: Problem, answer: Answer) -> Errors:
        """Of an answer to the scene of the rings, whose straight sides cut corners of the true domain. Collective."""
        rings, world, body = self.rings, problem.world, problem.spec.name
        distance = world.allreduce(stress_error(problem.mesh, problem.spec.material, answer.displacement,
                                                lambda points: rings.stress(body, points)))
        found = contact_of(problem, answer)
        exact = np.full(len(found.x), rings.pressure)
        _, means, widths = found.side_pressures()
        return Errors(
            energy=float(np.sqrt(distance / world.allreduce(rings.energy(body)))),
            pressure=difference(found.pressure, exact, found.length), shear=np.nan,
            side_pressure=difference(means, exact[:len(means)], widths),
            normal_force=relative(found.normal_force, rings.normal_force), tangential_force=np.nan,
            contact_end=end_error(found.contact_ends, np.empty(0)), stick_end=np.nan)


def stress_error(mesh: Mesh, material: Material, u: np.ndarray, stress) -> float:
    """Squared energy norm (J per metre of depth) of the error of `u` (nv, 2), whose exact stress is known.

    ``stress(points)`` gives σ_xx, σ_yy, σ_xy (…, 3) in Pa at points (…, 2). By quadrature; not collective.
    """
    barycentric, weights = QUADRATURE[2]
    points = np.einsum("qi,tid->tqd", barycentric, mesh.points[mesh.triangles[:, :3]])
    error = stress_at(mesh, material, u, barycentric) - stress(points)
    density = energy_density(material, error.reshape(-1, 3)).reshape(points.shape[:2])
    return float(signed_double_areas(mesh.points, mesh.triangles) / 2 @ density @ weights)
