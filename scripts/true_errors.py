"""How far is an answer from the exact one? The errors that users mean.

Two scenes have an exact solution: pinched blocks, by a solution on a fine mesh that holds those on the coarser ones,
and two rings, by a closed form. Both give the same `Errors`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ddmpi.body.estimate import estimate_error, relative_error
from ddmpi.body.stress import components, energy_density, stress_at
from ddmpi.coupling.assembly import Assembly, prepare
from ddmpi.mesh.elements import RULES
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import gmsh_session
from ddmpi.run.solve import Solution, solve
from ddmpi.scene.bodies import Material, MeshSpec
from ddmpi.scene.reader import read_scene
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import merged

# Two rings
#
# A shrink fit with a closed form: two rings a < b < c whose radii overlap by delta at r = b press each other with
#
#     p = delta / (b [(1/E_o) ((c² + b²)/(c² − b²) + nu_o) + (1/E_i) ((b² + a²)/(b² − a²) − nu_i)]),
#
# plane strain by E → E/(1 − nu²), nu → nu/(1 − nu); in each ring σ_r = A − B/r², σ_φ = A + B/r² (Lamé; Timoshenko and
# Goodier, Theory of Elasticity, art. 28). A quarter is solved, with rollers on the planes of symmetry.

INNER, OUTER = "inner", "outer"
STEEL, BRONZE = Material(young=2.1e11, poisson=0.3), Material(young=1.1e11, poisson=0.34)


@dataclass(frozen=True)
class Rings:
    """Radii (m), overlap (m; so small against them that linear theory is exact) and materials.

    By default a bronze ring around a hollow steel shaft.
    """

    a: float = 0.5
    b: float = 1.0
    c: float = 1.5
    overlap: float = 1e-6
    inner: Material = STEEL
    outer: Material = BRONZE

    def material(self, body: str) -> Material:
        return {INNER: self.inner, OUTER: self.outer}[body]

    def radii(self, body: str) -> tuple[float, float]:
        """Inner and outer radius (m) of a body before it is pressed."""
        return {INNER: (self.a, self.b + self.overlap / 2), OUTER: (self.b - self.overlap / 2, self.c)}[body]

    @property
    def pressure(self) -> float:
        """Contact pressure p (Pa)."""
        a2, b2, c2 = self.a**2, self.b**2, self.c**2
        (Ei, ni), (Eo, no) = (_plane(m) for m in (self.inner, self.outer))
        return self.overlap / (self.b * (((c2 + b2) / (c2 - b2) + no) / Eo + ((b2 + a2) / (b2 - a2) - ni) / Ei))

    @property
    def normal_force(self) -> float:
        """Resultant of the pressure over a quarter of the interface (N per metre of depth)."""
        return self.pressure * self.b * np.pi / 2

    def _lame(self, body: str) -> tuple[float, float]:
        """A (Pa) and B (N) of σ_r = A − B/r²: σ_r = −p at r = b, zero on the ring's other side."""
        free = {INNER: self.a, OUTER: self.c}[body] ** 2
        B = self.pressure / (1 / self.b**2 - 1 / free)
        return B / free, B

    def displacement(self, body: str, points: np.ndarray) -> np.ndarray:
        """Exact displacement (k, 2) in metres at points (k, 2)."""
        E, nu = _plane(self.material(body))
        A, B = self._lame(body)
        r2 = (points**2).sum(axis=-1, keepdims=True)
        return points * ((1 - nu) * A + (1 + nu) * B / r2) / E

    def stress(self, body: str, points: np.ndarray) -> np.ndarray:
        """Exact σ_xx, σ_yy, σ_xy (…, 3) in Pa at points (…, 2)."""
        A, B = self._lame(body)
        x, y = points[..., 0], points[..., 1]
        r2 = x**2 + y**2
        twist = B / r2**2
        return np.stack([A - twist * (x**2 - y**2), A + twist * (x**2 - y**2), -2 * twist * x * y], axis=-1)

    def energy(self, body: str) -> float:
        """Squared energy norm, twice the strain energy, of a quarter of the body (J per metre of depth)."""
        normal = np.array([[1.0, 0.0]])
        moved = float((self.displacement(body, self.b * normal) @ normal.T)[0, 0])
        return (-1.0 if body == INNER else 1.0) * self.normal_force * moved

    def scene(self, folder: Path, N: int, order: int, *settings: str) -> Settled:
        """The frictionless scene; other `settings` are KEY=VALUE. The meshes are those of `write_meshes`."""
        def body(name: str) -> str:
            material = self.material(name)
            return (f'[[body]]\nname = "{name}"\nmesh = {{ file = "{mesh_path(folder, name, N)}", order = {order} }}\n'
                    f"material = {{ young = {material.young!r}, poisson = {material.poisson!r} }}\n"
                    'clamp = [{ on = "left", x = 0.0 }, { on = "bottom", y = 0.0 }]\n')

        contact = (f'[[contact]]\nbodies = ["{INNER}", "{OUTER}"]\non = ["outside", "inside"]\n'
                   'friction = { law = "none" }\n')
        text = f'title = "Shrink fit, N = {N}"\n{body(INNER)}{body(OUTER)}{contact}'
        return read_scene("scene of two rings", text, list(settings))

    def write_meshes(self, folder: Path, N: int) -> None:
        """Two structured meshes that match at the interface: N divisions along the radius, 3 N along the quarter.

        Not collective.
        """
        folder.mkdir(parents=True, exist_ok=True)
        for body in (INNER, OUTER):
            _write_quarter(mesh_path(folder, body, N), *self.radii(body), (3 * N, N))


def mesh_path(folder: Path, body: str, N: int) -> Path:
    return folder.resolve() / f"rings_{body}_{N}.msh"


def _plane(material: Material) -> tuple[float, float]:
    """Young's modulus and Poisson's ratio with which plane stress reads as plane strain."""
    nu = material.poisson
    return material.young / (1 - nu**2), nu / (1 - nu)


def _write_quarter(path: Path, inside: float, outside: float, divisions: tuple[int, int]) -> None:
    """A quarter of a ring by gmsh, with groups inside, outside, left (x = 0) and bottom (y = 0)."""
    with gmsh_session() as gmsh:
        geometry = gmsh.model.geo
        centre = geometry.addPoint(0.0, 0.0, 0.0)
        points = [geometry.addPoint(x, y, 0.0) for x, y in ((inside, 0), (outside, 0), (0, outside), (0, inside))]
        lines = {"bottom": geometry.addLine(points[0], points[1]),
                 "outside": geometry.addCircleArc(points[1], centre, points[2]),
                 "left": geometry.addLine(points[2], points[3]),
                 "inside": geometry.addCircleArc(points[3], centre, points[0])}
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(list(lines.values()))])
        for name, line in lines.items():
            geometry.mesh.setTransfiniteCurve(line, divisions[name in ("bottom", "left")] + 1)
        geometry.mesh.setTransfiniteSurface(surface, "Right")
        geometry.synchronize()
        for name, line in lines.items():
            gmsh.model.addPhysicalGroup(1, [line], name=name)
        gmsh.model.addPhysicalGroup(2, [surface], name="ring")
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))


# Errors

SHORT = 0.01
"""Zones shorter than this part of the interface consist of single nodes, as at a singular corner, and do not count."""


@dataclass(frozen=True)
class Errors:
    """Errors of a solution, relative except for the last two; nan where there is nothing to compare.

    Attributes
    ----------
    energy : energy norm of the displacement's error, both bodies, over the energy norm of the exact one
    pressure, shear : contact pressure and tangential contact stress at the nodes, in L2 along the interface
    side_pressure : means of the contact pressure over the elements' sides, in L2
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
    """What happens at the contact nodes, in their order.

    Attributes
    ----------
    xy : (m, 2) positions (m)
    length : (m,) nodal lengths (m)
    middle : (m,) bool, whether a node is the middle of a side
    pressure, shear : (m,) in Pa
    status : (m,) "open", "slip" or "stick"
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


def contact_of(assembly: Assembly, solution: Solution) -> Contact:
    """The contact nodes of a solution with one contact, on all ranks. Collective."""
    (state,) = merged(assembly.world, solution.states).values()
    interface = state.interface
    middle = np.isin(np.arange(interface.m), interface.facets[:, 2:])
    return Contact(interface.xy, interface.area, middle, state.pressure, state.shear[:, 0], state.status)


def zone_ends(x: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Where zones begin and end: halfway between neighbours x (m,) of which one is `inside` (m,) and one is not.

    Zones, and breaks in them, of less than SHORT are left out, the shortest first.
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
        place = (at - np.array(spec.origin or 0.0)) / spec.size * (nx, ny)
        cell = np.clip(np.floor(place).astype(int), 0, (nx - 1, ny - 1))
        inside = place - cell
        return 2 * (cell[:, 1] * nx + cell[:, 0]) + (inside[:, 1] > inside[:, 0])

    corners = mesh.points[mesh.triangles[:, :3]]
    triangle = np.empty(2 * nx * ny, dtype=np.int64)
    triangle[find(corners.mean(axis=1))] = np.arange(len(corners))
    owner = triangle[find(points)]
    a, b, c = corners[owner].swapaxes(0, 1)
    second, third = np.linalg.solve(np.stack([b - a, c - a], axis=2), (points - a)[:, :, None])[..., 0].T
    barycentric = np.column_stack([1 - second - third, second, third])
    shapes = mesh.cell.shapes(barycentric)
    return np.einsum("ki,kic->kc", shapes, u[mesh.triangles[owner]])


@dataclass(frozen=True)
class FineSolution:
    """The solution of a scene of generated rectangles on a fine mesh, as one rank holds it.

    Attributes
    ----------
    mesh, material, u : of the own body
    contact : of both bodies
    size : squared energy norm of both bodies (J per metre of depth)
    own_error : estimated error of this solution, relative in the energy norm

    A mesh whose divisions are a whole multiple of a coarser one's, with an order at least as high, holds the
    coarser one's solutions exactly. The error of the fine solution is orthogonal to its distance from them (except
    for what the contact conditions change), so both squares add up to that of the error of the coarse one.
    """

    mesh: Mesh
    material: Material
    u: np.ndarray
    contact: Contact
    size: float
    own_error: float

    def errors(self, assembly: Assembly, solution: Solution) -> Errors:
        """Of a solution of the same scene on a coarser mesh. Collective."""
        (body,) = assembly.bodies
        coarse = interpolate(body.mesh, body.spec.mesh, solution.displacements[body.spec.name], self.mesh.points)
        distance = assembly.world.allreduce(energy(self.mesh, self.material, self.u - coarse))
        found, exact = contact_of(assembly, solution), self.contact

        def along(values: np.ndarray) -> np.ndarray:
            return np.interp(exact.x, found.x, values)

        return Errors(
            energy=float(np.hypot(np.sqrt(distance / self.size), self.own_error)),
            pressure=difference(along(found.pressure), exact.pressure, exact.length),
            shear=difference(along(found.shear), exact.shear, exact.length),
            side_pressure=side_difference(found, exact),
            normal_force=relative(found.normal_force, exact.normal_force),
            tangential_force=relative(found.tangential_force, exact.tangential_force),
            contact_end=end_error(found.contact_ends, exact.contact_ends),
            stick_end=end_error(found.stick_ends, exact.stick_ends))


def solve_reference(world: MPI.Comm, scene: Settled) -> FineSolution:
    """The solution of `scene`.

    Raises the errors of `ddmpi.run.solve.solve`, and RuntimeError for a solution that is not certified; the same on
    all ranks. Collective.
    """
    assembly = prepare(world, scene)
    solution = solve(assembly, scene.method)
    if not solution.certified:
        raise RuntimeError(f"the reference solution: {solution.reason}")
    mesh, material, u = own_body(assembly, solution)
    estimate = estimate_error(mesh, material, u)
    error, size = world.allreduce(estimate.total), world.allreduce(estimate.energy)
    return FineSolution(mesh, material, u, contact_of(assembly, solution), size, relative_error(error, size))


@dataclass(frozen=True)
class ClosedForm:
    """The exact solution of the rings."""

    rings: Rings

    def errors(self, assembly: Assembly, solution: Solution) -> Errors:
        """Of a solution on meshes of the rings, whose straight sides cut corners of the true domain. Collective."""
        rings, world, body = self.rings, assembly.world, assembly.bodies[0].spec.name
        distance = world.allreduce(stress_error(*own_body(assembly, solution),
                                                lambda points: rings.stress(body, points)))
        found = contact_of(assembly, solution)
        exact = np.full(len(found.x), rings.pressure)
        _, means, widths = found.side_pressures()
        return Errors(
            energy=float(np.sqrt(distance / world.allreduce(rings.energy(body)))),
            pressure=difference(found.pressure, exact, found.length), shear=np.nan,
            side_pressure=difference(means, exact[:len(means)], widths),
            normal_force=relative(found.normal_force, rings.normal_force), tangential_force=np.nan,
            contact_end=end_error(found.contact_ends, np.empty(0)), stick_end=np.nan)


def own_body(assembly: Assembly, solution: Solution) -> tuple[Mesh, Material, np.ndarray]:
    """Mesh, material and displacement of the only body of this rank."""
    (body,) = assembly.bodies
    return body.mesh, body.spec.material, solution.displacements[body.spec.name]


def energy(mesh: Mesh, material: Material, u: np.ndarray) -> float:
    """Squared energy norm (J per metre of depth) of the displacement `u` (nv, 2) of a body. Not collective."""
    return stress_error(mesh, material, u, lambda points: np.zeros((*points.shape[:-1], 3)))


def stress_error(mesh: Mesh, material: Material, u: np.ndarray, stress: Callable[[np.ndarray], np.ndarray]) -> float:
    """Squared energy norm (J per metre of depth) of the error of `u` (nv, 2), whose exact stress is known.

    ``stress(points)`` gives σ_xx, σ_yy, σ_xy (…, 3) in Pa at points (…, 2). By quadrature; not collective.
    """
    barycentric, weights = RULES[2]
    points = np.einsum("qi,tid->qtd", barycentric, mesh.points[mesh.corners])
    exact = np.moveaxis(stress(points), -1, 0)[[0, 2, 1]]  # in the order of components
    density = energy_density(material, components(stress_at(mesh, material, u, barycentric)) - exact)
    return float(weights @ density @ mesh.measures())
