"""Traces: the displacement of a body at its contact nodes, along normals and tangents."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ddmpi.body.elasticity import Elasticity
from ddmpi.interface.interface import Interface


def trace(interface: Interface, role: int, body: Elasticity) -> PETSc.Mat:
    """B = [N; T] of the body in `role` (1 or 2) as a PETSc matrix (m + mt, columns of A).

    Collective on A's communicator. Components that are clamped have no entry; what they contribute
    to the trace is constant, and `displacement_trace` of the prescribed displacement gives it.
    """
    sign, nodes = _role(interface, role)
    place = np.full(len(body.free), -1, dtype=PETSc.IntType)
    place[body.nodes] = np.arange(len(body.nodes))
    s = interface.sliding
    directions = sign * np.concatenate([interface.normal, interface.tangent[s]])
    rows = np.concatenate([nodes, nodes[s]])
    columns = (2 * np.maximum(place[rows], 0)[:, None] + [0, 1]).astype(PETSc.IntType)  # clamped: no entry anywhere
    values = np.where(body.free[rows], directions, 0.0)
    indptr = 2 * np.arange(len(rows) + 1, dtype=PETSc.IntType)
    return PETSc.Mat().createAIJWithArrays((len(rows), body.A.size[1]), (indptr, columns.ravel(), values.ravel()),
                                           comm=body.A.comm)


def displacement_trace(interface: Interface, role: int, u: np.ndarray) -> np.ndarray:
    """[N; T] u (m + mt,) in metres, of a displacement (nv, 2) of all nodes. Not collective."""
    sign, nodes = _role(interface, role)
    s = interface.sliding
    return sign * np.concatenate([np.einsum("ij,ij->i", u[nodes], interface.normal),
                                  np.einsum("ij,ij->i", u[nodes[s]], interface.tangent[s])])


def _role(interface: Interface, role: int) -> tuple[int, np.ndarray]:
    return (1 if role == 1 else -1), interface.nodes[role - 1]
