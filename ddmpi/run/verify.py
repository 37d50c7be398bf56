"""A run compared with brute force."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.ranks import check_ranks
from ddmpi.errors import NotConvergedError
from ddmpi.judge.brute_force import check_size, solve_coupled
from ddmpi.run.report import tell_plan, tell_step
from ddmpi.run.run import _prepare, log
from ddmpi.run.solve import solve
from ddmpi.scene.scene import Scene
from ddmpi.system.agreement import agreed


def verify(world: MPI.Comm, scene: Scene, scene_path: str) -> None:
    """Solve `scene`, and again as the coupled problem by brute force; compare the two. Collective.

    Writes nothing. Raises what `run` raises, and NotConvergedError when the answers differ by more than
    the certificate promises.
    """
    check_ranks(world, scene)
    problem = _prepare(world, scene, scene_path)
    with agreed(world):
        check_size(problem.interface)
    tell_plan(problem, figures=False)
    if scene.method.target_error:
        log.info("method.target_error is left aside: what is compared is the answer on the meshes as given")
    answer, outer = solve(problem, scene.method, tell_step)
    exact = solve_coupled(problem.body, problem.friction, problem.exchange)
    size = np.linalg.norm(exact)
    distance = float(np.linalg.norm(outer.forces - exact) / size) if size else float(np.linalg.norm(outer.forces))
    log.info("%s; contact forces differ from those of the coupled problem by %.1e, relatively", answer.reason, distance)
    with agreed(world):
        if not (answer.certified and distance <= answer.limit):
            raise NotConvergedError(f"{answer.reason}, and the contact forces differ from those of the coupled problem "
                                    f"by {distance:.1e}; {answer.limit:.0e} is the limit")
