"""Products of small bodies together are those of each by itself, and count as many."""

import numpy as np
import pytest
import scenes
from mpi4py import MPI

import ddmpi.coupling.small


def joint_of_tower(comm: MPI.Comm, blocks: int = 20):
    """The joint of loose blocks on a clamped one, every other one stiffer."""
    scene = scenes.tower(blocks, 1)
    for k, body in enumerate(scene["body"]):
        body["mesh"]["divisions"] = [2, 2]
        body["material"]["young"] *= 1.0 + k % 2
    return scenes.prepare_scene(comm, scene).joint


def product(joint, x: np.ndarray, by=None) -> tuple[np.ndarray, list[int]]:
    """C x, and by how much the count of each body grows."""
    before = [member.C.count["test"] for member in joint.members]
    y = (by or joint.product)(x, "test")
    now = [member.C.count["test"] for member in joint.members]
    return y, [after - first for after, first in zip(now, before, strict=True)]


def compared(comm: MPI.Comm, monkeypatch, blocks: int = 20) -> list[int]:
    """The counts of a product of forces on a half of the blocks; together and one by one they and the product agree."""
    together, alone = joint_of_tower(comm, blocks), joint_of_tower(comm, blocks)
    x = np.random.default_rng(3).standard_normal(together.size)
    x[: together.size // 2] = 0.0
    y, counts = product(together, x)
    monkeypatch.setattr(ddmpi.coupling.small, "FEWEST", 1000)
    one_by_one, counted = product(alone, x)
    assert y == pytest.approx(one_by_one, abs=1e-13 * np.abs(one_by_one).max(initial=0.0))
    assert counts == counted
    return counts


def test_products_together_are_those_of_each(monkeypatch):
    """No product is counted of a body on which no force acts."""
    counts = compared(MPI.COMM_SELF, monkeypatch)
    assert set(counts) == {0, 1}


@pytest.mark.mpi(ranks=2)
def test_products_together_on_two_ranks(monkeypatch):
    monkeypatch.setattr(ddmpi.coupling.small, "FEWEST", 2)
    compared(MPI.COMM_WORLD, monkeypatch, 6)


def test_products_by_solves_are_not_together():
    """Solves do not have the rounding of dense compliances."""
    joint = joint_of_tower(MPI.COMM_SELF)
    x = np.random.default_rng(4).standard_normal(joint.size)
    (y, counts), (solved, again) = product(joint, x), product(joint, x, joint.solved)
    assert counts == again == [1] * len(joint.members)
    assert solved == pytest.approx(y, abs=1e-9 * np.abs(y).max())
    assert (solved != y).any()
