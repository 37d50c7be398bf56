"""Rigid motions of a body: which of them its clamps leave free, and all of them for multigrid."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ddmpi.body.stiffness import Stiffness
from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh


def _refuse_rigid_motion(mesh: Mesh, K: Stiffness, free: np.ndarray, name: str) -> None:
    """The clamped components must determine both translations and the rotation of each connected piece."""
    pieces, piece = K.connected()
    for k in range(pieces):
        members = piece == k
        centre = mesh.points[members].mean(axis=0)
        members &= ~free.all(axis=1)
        x, y = ((mesh.points[members] - centre) / mesh.extent).T
        modes = np.stack([np.stack([np.ones_like(x), np.zeros_like(x), -y], 1),
                          np.stack([np.zeros_like(x), np.ones_like(x), x], 1)], 1)  # (k, 2, 3)
        held = modes[~free[members]]
        values, vectors = np.linalg.eigh(held.T @ held)
        if values[0] <= 1e-16 * max(values[-1], 1.0) * max(len(held), 1):
            tx, ty, rotation = np.abs(vectors[:, 0])
            loose = "rotate" if rotation > 0.5 else "move along x" if tx > ty else "move along y"
            part = "the body" if pieces == 1 else f"a piece of the body (there are {pieces} that hang not together)"
            raise InputError(f"body.{name}.clamp: {part} is not held: it can still {loose} as a rigid body; "
                             "clamp a boundary group, or more components of one")


def _rigid_motions(points: np.ndarray, free: np.ndarray, comm) -> PETSc.NullSpace:
    """Translations and rotation, orthonormal, for algebraic multigrid."""
    x, y = (points - points.mean(axis=0)).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    modes = np.stack([np.column_stack([one, zero]), np.column_stack([zero, one]), np.column_stack([-y, x])])
    Q, _ = np.linalg.qr((modes * free).reshape(3, -1).T)
    vectors = [PETSc.Vec().createWithArray(np.ascontiguousarray(q), bsize=2, comm=comm) for q in Q.T]
    return PETSc.NullSpace().create(vectors=vectors, comm=comm)
