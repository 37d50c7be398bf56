"""Meshes of tetrahedra, and bodies of them."""

import numpy as np

from ddmpi.body.elasticity import assemble
from ddmpi.body.solver import StiffnessSolver
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import bend, raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec

STEEL = Material(young=2.1e11, poisson=0.3)
SIDES = ("left", "right", "front", "back", "bottom", "top")


def body(material=STEEL, **rest) -> BodySpec:
    return BodySpec(
        **(
            {
                "name": "block",
                "mesh": MeshSpec(file="unused.msh"),
                "material": material,
                "volume_force": (0.0, 0.0, 0.0),
            }
            | rest
        )
    )


def solve(mesh: Mesh, spec: BodySpec) -> np.ndarray:
    """The displacement (nv, 3) of a body that clamps hold (m)."""
    problem = assemble(mesh, spec)
    u = problem.b.duplicate()
    StiffnessSolver(problem.A, spec.name).solve(problem.b, u)
    return problem.expand(u)


def hold(on: str, *values: float | str | None) -> Clamp:
    return Clamp(on=on, **dict(zip("xyz", values, strict=True)))


def grid(divisions: tuple[int, int, int]) -> Mesh:
    """The unit cube, each cell of a grid cut into six tetrahedra."""
    return generate_rectangle(
        MeshSpec(shape="box", origin=(0.0,) * 3, size=(1.0,) * 3, divisions=divisions)
    )


def box(divisions=(3, 2, 2), size=(1.0, 1.0, 1.0), order=1, jitter=0.0) -> Mesh:
    """A box whose inner nodes are moved at random by up to `jitter` of a cell."""
    mesh = grid(divisions)
    inner = ((mesh.points > 0.0) & (mesh.points < 1.0)).all(axis=1)
    mesh.points[inner] += (
        jitter * np.random.default_rng(1).uniform(-1, 1, (inner.sum(), 3)) / divisions
    )
    mesh = Mesh(mesh.points * size, mesh.triangles, mesh.groups)
    return raise_order(mesh, "mesh") if order == 2 else mesh


def wavy() -> Mesh:
    """A cube of order 2 of which some edges, on the boundary and inside, are bent in all directions."""
    mesh = box((2, 2, 2), order=2, jitter=0.1)
    at = mesh.points[mesh.triangles[:, 4:]]
    bends = 0.02 * np.sin(
        at @ np.array([[11.0, 7.0, 3.0], [5.0, 13.0, 2.0], [1.0, 4.0, 9.0]]) + [0.3, 1.1, 0.7]
    )
    return bend(mesh, np.where(at[..., :1] > 0.4, bends, 0.0))


def shell(n: int, radii=(0.5, 1.0), order=2) -> Mesh:
    """An octant of a hollow ball, of three blocks around its diagonal; groups inner, outer, x, y, z (planes)."""
    cube = grid((max(n // 2, 1), n, n))
    cube = raise_order(cube, "mesh") if order == 2 else cube
    (r, y, z), ones = cube.points.T, np.ones(len(cube.points))
    directions = np.stack([ones, np.tan(np.pi / 4 * y), np.tan(np.pi / 4 * z)], axis=1)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = (radii[0] + (radii[1] - radii[0]) * r)[:, None] * directions
    both = np.concatenate([np.roll(points, k, axis=1) for k in range(3)])
    _, first, number = np.unique(np.round(both, 9), axis=0, return_index=True, return_inverse=True)
    number = number.reshape(3, -1)
    groups = {
        name: np.concatenate([part[cube.groups[side]] for part in number])
        for name, side in (("inner", "left"), ("outer", "right"))
    }
    for k, name in enumerate("xyz"):
        groups[name] = np.concatenate(
            [number[(k - 1) % 3][cube.groups["front"]], number[(k - 2) % 3][cube.groups["bottom"]]]
        )
    return Mesh(both[first], np.concatenate([part[cube.triangles] for part in number]), groups)
