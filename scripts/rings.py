"""A shrink fit with a closed form: an elastic ring pressed upon another by an initial overlap.

Two rings a < b < c whose radii overlap by delta at r = b press each other with

    p = delta / (b [(1/E_o) ((c² + b²)/(c² − b²) + nu_o) + (1/E_i) ((b² + a²)/(b² − a²) − nu_i)]),

plane strain by E → E/(1 − nu²), nu → nu/(1 − nu); in each ring σ_r = A − B/r², σ_φ = A + B/r² (Lamé's
solution; Timoshenko and Goodier, Theory of Elasticity, art. 28). A quarter of them is solved, with rollers
on the planes of symmetry.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ddmpi.scene.bodies import Material
from ddmpi.scene.reader import read_scene
from ddmpi.scene.scene import Settled

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
    import gmsh

    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
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
    finally:
        gmsh.finalize()
