"""The coarse problem of many bodies: its factors stay sparse, however unlike its motions are."""

import numpy as np
import pytest
import scenes
import scipy.sparse as sparse
from mpi4py import MPI

import ddmpi.coupling.coarse
from ddmpi.methods.krylov import Linearised, LinearProblem, Preconditioner, Regularisation


def blocks(columns: int, rows: int) -> dict:
    """Loose blocks side by side and one above the other, the lowest ones clamped."""
    law = {"friction": {"law": "coulomb", "coefficient": 0.5}}
    body, contact = [], []
    for x, y in np.ndindex(columns, rows):
        block = scenes.rectangle(f"b{x}-{y}", (2.0 * x, float(y)), (2.0, 1.0), (2, 2), young=2e10)
        body.append(block if y else block | {"clamp": ["bottom"]})
        for right, up, on in ((x + 1, y, ["right", "left"]), (x, y + 1, ["top", "bottom"])):
            if right < columns and up < rows:
                contact.append({"bodies": [f"b{x}-{y}", f"b{right}-{up}"], "on": on} | law)
    return {"body": body, "contact": contact}


@pytest.mark.slow
def test_factors_of_many_blocks_are_sparse(monkeypatch):
    """Four times the entries of S. Smooth modes have other units than rigid motions, and pivots are compared: off the
    diagonal they would fill the factors, with eight times the entries here and 75 times with 1,000 bricks."""
    joint = scenes.prepare_scene(MPI.COMM_SELF, blocks(10, 12)).joint
    laws, factored = joint.space.laws, []

    def splu(S: sparse.csc_matrix, **how):
        factored.append((S.nnz, factor(S, **how)))
        return factored[-1][1]

    factor = ddmpi.coupling.coarse.splu
    monkeypatch.setattr(ddmpi.coupling.coarse, "splu", splu)
    preconditioner = Preconditioner(joint)
    assert preconditioner.coarse[0].size > joint.rigid.size > 300
    linearised = Linearised.of(laws.linearise(laws.sticking(np.ones(laws.m, bool))))
    problem = LinearProblem(
        joint, preconditioner, linearised, np.zeros(joint.size), Regularisation()
    )
    ((entries, factors),) = factored
    assert factors.L.nnz + factors.U.nnz < 4.0 * entries
    # and they are those of S: forces that balance loads along the rigid motions
    loads = np.random.default_rng(2).standard_normal(joint.rigid.size)
    y, alpha = problem.precondition(np.zeros(linearised.number), loads)
    left = loads - joint.rigid.sums(linearised.expand(y)) - preconditioner.springs * alpha
    assert np.abs(left).max() < 1e-9
