"""A run compared with brute force."""

from __future__ import annotations

import logging

from mpi4py import MPI

from ddmpi.coupling.ranks import on_working_ranks
from ddmpi.errors import InputError, NotConvergedError
from ddmpi.judge.brute_force import check_size, solve_coupled
from ddmpi.run.report import log_plan, log_step
from ddmpi.run.run import prepare_scene
from ddmpi.run.solve import solve
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed

log = logging.getLogger("ddmpi")


def verify(world: MPI.Comm, scene: Settled, scene_path: str) -> None:
    """Solve `scene`, and again as the coupled problem by brute force; compare the two. Collective.

    Writes nothing. Raises what `run` raises, and NotConvergedError when the answers differ by more than
    the certificate promises.
    """
    on_working_ranks(world, scene, lambda part: _verify(part, scene, scene_path))


def _verify(world: MPI.Comm, scene: Settled, scene_path: str) -> None:
    """`verify` on the ranks that hold bodies."""
    with agreed(world):
        if scene.time is not None:
            raise InputError(f"{scene_path}: time: verify compares one load step; leave [time] and all histories out")
    assembly = prepare_scene(world, scene, scene_path)
    with agreed(world):
        check_size(assembly)
    log_plan(assembly, figures=False)
    if scene.method.target_error:
        log.info("method.target_error is left aside: the answer is compared on the meshes as given")
    solution = solve(assembly, scene.method, log_step)
    exact, forces = solve_coupled(assembly), solution.outer.forces
    size, space = assembly.space.norm(exact), assembly.space
    distance = space.norm(forces - exact) / size if size else space.norm(forces)
    log.info("%s; contact forces differ from those of the coupled problem by %.1e, relatively", solution.reason,
             distance)
    with agreed(world):
        if not (solution.certified and distance <= solution.limit):
            raise NotConvergedError(f"{solution.reason}, and the contact forces differ from those of the coupled "
                                    f"problem by {distance:.1e}; {solution.limit:.2g} is the limit")
