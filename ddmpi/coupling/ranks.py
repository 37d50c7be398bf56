"""Which rank holds what: at present one body each, in the order of the scene."""

from __future__ import annotations

from mpi4py import MPI

from ddmpi.errors import InputError
from ddmpi.scene.scene import Settled


def check_ranks(world: MPI.Comm, scene: Settled) -> None:
    """InputError, on all ranks, unless there is a rank for each body."""
    if world.size != len(scene.body):
        error = InputError(f"this scene has {len(scene.body)} bodies, each on a rank of its own; start it with "
                           f"mpirun -n {len(scene.body)} (started on {world.size})")
        error.agreed = True
        raise error


def ranks_beside(world: MPI.Comm) -> int:
    """How many ranks share this machine's memory, this one included. Collective."""
    node = world.Split_type(MPI.COMM_TYPE_SHARED)
    try:
        return node.size
    finally:
        node.Free()
