"""Rigid motions of a body: all of them, as multigrid wants them, and those that its clamps leave free."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from petsc4py import PETSc

from ddmpi.body.stiffness import Stiffness
from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh

LOOSE = 1e-16
"""A motion is free if its squared size at the clamps is below this, relative to the largest, for each component."""


def rigid_motions(points: np.ndarray, centre: np.ndarray, size: float = 1.0) -> np.ndarray:
    """Translations, then rotations about `centre`, of `points` (k, d) as displacements (k, d, j).

    In the plane j = 3: along x, along y, rotation; in space j = 6. Distances are divided by `size`.
    """
    x = (points - centre) / size
    motions = [np.broadcast_to(axis, x.shape) for axis in np.eye(x.shape[1])]
    for i, j in combinations(range(x.shape[1]), 2):
        motions.append(np.zeros_like(x))
        motions[-1][:, i], motions[-1][:, j] = -x[:, j], x[:, i]
    return np.stack(motions, axis=-1)


def free_motions(motions: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Combinations (j, ·) of `motions` (k, d, j), orthonormal columns, that all components not `free` (k, d) allow."""
    held = motions[~free]
    values, vectors = np.linalg.eigh(held.T @ held)
    return vectors[:, values <= LOOSE * max(values[-1], 1.0) * max(len(held), 1)]


def refuse_rigid_motion(mesh: Mesh, K: Stiffness, free: np.ndarray, name: str) -> None:
    """Raise InputError if a connected piece of the body can still move as a rigid body. Not collective."""
    pieces, piece = K.connected()
    for k in range(pieces):
        members = piece == k
        groups = [name for name, edges in mesh.groups.items() if members[edges].any()]
        centre = mesh.points[members].mean(axis=0)
        members &= ~free.all(axis=1)
        left = free_motions(rigid_motions(mesh.points[members], centre, mesh.extent), free[members])
        if left.size:
            tx, ty, rotation = np.abs(left[:, 0])
            motion = "rotate" if rotation > 0.5 else "move along x" if tx > ty else "move along y"
            part = "the body" if pieces == 1 else f"a piece of the body (it has {pieces} that are not connected)"
            fix = (f'clamp one of its boundary groups, as in clamp = ["{groups[-1]}"], or more components of one '
                   f'({", ".join(groups)})' if groups else "it has no boundary group that could be clamped")
            raise InputError(f"body.{name}.clamp: {part} is not held: it can still {motion} as a rigid body; {fix}")


def near_null_space(points: np.ndarray, free: np.ndarray, comm) -> PETSc.NullSpace:
    """The rigid motions of `points` (k, 2), zero where not `free` (k, 2), orthonormal, for algebraic multigrid."""
    motions = rigid_motions(points, points.mean(axis=0)) * free[:, :, None]
    Q, _ = np.linalg.qr(motions.reshape(-1, motions.shape[2]))
    vectors = [PETSc.Vec().createWithArray(np.ascontiguousarray(q), bsize=points.shape[1], comm=comm) for q in Q.T]
    return PETSc.NullSpace().create(vectors=vectors, comm=comm)
