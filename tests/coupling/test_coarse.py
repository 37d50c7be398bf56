"""The coarse problem of many bodies: its factors stay sparse, however unlike its motions are."""

from types import SimpleNamespace

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


def test_nodes_give_way_to_the_forces_of_contacts_on_all_ranks():
    """As the first of two ranks has it, whose contact `a` is one of three: its body also has `b`, which the second rank
    owns with `c`, and a body there has `c` and `a`."""
    rng = np.random.default_rng(5)
    first, second = rng.standard_normal((3, 2)), rng.standard_normal((5, 1))
    rest, layers, w = rng.uniform(0.1, 1.0, (3, 6))
    B = np.zeros((6, 3))  # the rows of a, b and c
    B[:3, :2], B[[3, 4, 5, 0, 1], 2:] = first, second
    K = B @ B.T + np.diag(rest + layers)

    body = SimpleNamespace(
        parts={"a": (slice(0, 2), 0), "b": (slice(2, 3), 0)},
        at_cross_points=lambda: (sparse.csr_matrix(first), np.zeros(3)),
    )
    theirs = iter(
        [
            (
                {"b": slice(0, 1), "c": slice(1, 4)},
                rest[2:],
                [([("c", 3), ("a", 2)], sparse.csr_matrix(second))],
            ),
            (sparse.identity(4), layers[2:]),
        ]
    )
    space = SimpleNamespace(
        comm=MPI.COMM_SELF,
        parts={"a": slice(0, 2)},
        gather=lambda ours: [ours, next(theirs)],
        any=np.any,
        solve_joined=lambda ours, solve: solve(np.append(ours, w[2:]))[:2],
    )
    exchange = SimpleNamespace(total=lambda parts, about: rest[:2])
    crossing = ddmpi.coupling.coarse.CrossPoints([body], exchange, space)
    correct = crossing.corrector(
        sparse.identity(2, format="csr"), layers[:2], np.array([True, True])
    )
    wanted = np.diag(K) * np.linalg.solve(K, w)
    assert np.abs(correct(w[:2]) - wanted[:2]).max() < 1e-12
