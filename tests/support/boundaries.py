"""Meshes and their boundaries for the tests of interfaces, and what bodies give way, densely."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from ddmpi.body.elasticity import Elasticity, assemble
from ddmpi.body.loads import Supports
from ddmpi.interface import matching, rows
from ddmpi.interface import mortar as mortars
from ddmpi.interface.interface import Interface
from ddmpi.mesh.mesh import Mesh, turn_outward
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec
from ddmpi.scene.contacts import SettledContact
from ddmpi.surface.boundary import contact_side
from ddmpi.surface.side import Side

YOUNG, POISSON = 1e9, 0.3


def rectangle(divisions, size, origin=(0.0, 0.0), order: int = 1) -> Mesh:
    mesh = generate_rectangle(
        MeshSpec(shape="rectangle", origin=origin, size=size, divisions=divisions)
    )
    return raise_order(mesh, "mesh") if order == 2 else mesh


def write_msh(path: Path, mesh: Mesh, surfaces: Mapping[str, np.ndarray] | None = None) -> str:
    """A file of a plane mesh of order 1, of version 2.2, with its groups and, by name, cells of surfaces; its path."""
    import meshio

    number = np.full(len(mesh.triangles), 99)
    names = {name: np.array([k, 1]) for k, name in enumerate(mesh.groups, start=1)}
    for k, (name, cells) in enumerate((surfaces or {}).items(), start=11):
        number[cells], names[name] = k, np.array([k, 2])
    tags = [
        *(np.full(len(lines), k) for k, lines in enumerate(mesh.groups.values(), start=1)),
        number,
    ]
    cells = [*(("line", lines) for lines in mesh.groups.values()), ("triangle", mesh.triangles)]
    meshio.Mesh(
        np.pad(mesh.points, ((0, 0), (0, 1))),
        cells,
        field_data=names,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
    ).write(path, file_format="gmsh22", binary=False)
    return str(path)


def ring(
    inner: float, outer: float, angles: np.ndarray, order: int = 1, closed: bool = True
) -> Mesh:
    """A ring of one layer of quadrilaterals cut in two; groups ``inner`` and ``outer``."""
    n = len(angles)
    points = np.concatenate(
        [r * np.column_stack([np.cos(angles), np.sin(angles)]) for r in (inner, outer)]
    )
    a = np.arange(n if closed else n - 1)
    b = (a + 1) % n
    triangles = np.concatenate([np.column_stack([a, b + n, b]), np.column_stack([a, a + n, b + n])])
    mesh = Mesh(
        points, triangles, {"inner": np.column_stack([a, b]), "outer": np.column_stack([a, b]) + n}
    )
    return raise_order(mesh, "mesh") if order == 2 else mesh


def side(
    mesh: Mesh,
    *groups: str,
    body: str = "body",
    where=None,
    x: bool = False,
    y: bool = False,
    z: bool = False,
) -> Side:
    """The boundary `groups`; nodes for which `where` holds are clamped along those of x, y and z."""
    clamps = np.full(mesh.points.shape, -1)
    if where is not None:
        clamps[np.ix_(where(*mesh.points.T), [x, y, z][: mesh.dimension])] = 0
    edges = np.concatenate([mesh.groups[group] for group in groups])
    return contact_side(
        mesh, turn_outward(mesh, edges), holding(clamps), body, YOUNG / (1 - POISSON**2)
    )


def holding(clamps: np.ndarray, *displacements: tuple[str | None, np.ndarray]) -> Supports:
    """Clamps of the components (nv, d) that are not −1, with displacements (nv, d) by history."""
    return Supports(clamps, directions(clamps < 0), dict(displacements))


def directions(free: np.ndarray) -> np.ndarray:
    """Projections (nv, d, d) onto the directions of free components (nv, d) bool."""
    return free[:, :, None] * np.eye(free.shape[1])


def body_side(mesh: Mesh, body: Elasticity, group: str, name: str = "body") -> Side:
    return contact_side(mesh, mesh.facets(group), body.supports, name, YOUNG / (1 - POISSON**2))


def elastic(mesh: Mesh, clamp: list, **loads) -> Elasticity:
    return assemble(
        mesh,
        BodySpec(
            name="body",
            mesh=MeshSpec(file="unused.msh"),
            clamp=clamp,
            material=Material(young=YOUNG, poisson=POISSON),
            **loads,
        ),
    )


def stiffness(body: Elasticity) -> sparse.csc_matrix:
    indptr, indices, values = body.A.getValuesCSR()
    return sparse.csc_matrix(sparse.csr_matrix((values, indices, indptr), shape=body.A.size))


def respond(body: Elasticity, forces: np.ndarray | float = 0.0) -> np.ndarray:
    """Displacement (nv, 2) under the load and further forces (columns of A,), clamps included."""
    u = body.A.createVecRight()
    u.array[:] = spsolve(stiffness(body), body.b.array_r + forces)
    return body.expand(u)


def compliance(body: Elasticity, B: np.ndarray) -> np.ndarray:
    """B A⁻¹ Bᵀ, dense."""
    return B @ spsolve(stiffness(body), B.T)


def joined(contact: Interface) -> np.ndarray:
    """(m − 1,) bool, whether a row and the next one are neighbours."""
    return contact.geometry.laplacian.diagonal(1) != 0.0


def turned(mesh: Mesh, angle: float = 0.0, mirrored: bool = False) -> Mesh:
    """The mesh mirrored at the y axis and turned."""
    c, s = np.cos(angle), np.sin(angle)
    points, triangles = mesh.points.copy(), mesh.triangles
    if mirrored:
        points[:, 0] *= -1.0
        triangles = triangles[:, [0, 2, 1] if triangles.shape[1] == 3 else [0, 2, 1, 5, 4, 3]]
    return Mesh(points @ np.array([[c, s], [-s, c]]), triangles, mesh.groups)


def held_beside(contact: Interface) -> np.ndarray:
    """(m,) inverse distances to neighbours that are fixed, summed."""
    return contact.geometry.laplacian @ np.ones(contact.m)


def asked(
    friction, name: str = "seam", gap=None, kind: str = "unilateral", sides=(), **how
) -> SettledContact:
    """What a scene says of a contact, of bodies with the names of its `sides` where these differ."""
    names = tuple(side.body for side in sides)
    bodies = names if len(set(names)) == 2 else ("one", "other")
    return SettledContact(
        name=name,
        bodies=bodies,
        on=("on", "on"),
        friction=friction,
        gap=gap,
        kind=kind,
        **how,
    )


def pair(first: Side, second: Side, friction, name: str, refinement: int = 1, **how) -> Interface:
    return matching.pair(
        first, second, asked(friction, name, sides=(first, second), **how), refinement
    )


def touch(
    boundary: Side, rigid, friction, name: str, gap=None, kind: str = "unilateral"
) -> Interface:
    return matching.face_rigid(boundary, rigid, asked(friction, name, gap, kind))


def mortar(first: Side, second: Side, friction, name: str, **how) -> Interface:
    return mortars.mortar(first, second, asked(friction, name, sides=(first, second), **how))


def join(
    first: Side, second: Side, friction, name: str, refinement: int = 1, gap=None, **how
) -> Interface:
    return mortars.connect(
        first, second, asked(friction, name, gap, sides=(first, second), **how), refinement
    )


def uncovered_profile(contact: Interface, friction, gap=None) -> list[str]:
    return rows.uncovered_profile(contact, asked(friction, gap=gap))
