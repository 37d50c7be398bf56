"""Quadratic triangles: the answer, the work it takes, and the files.

Exactness on linear fields is in test_closed_forms, rates are in test_convergence.
"""

import numpy as np
import pytest
import scenes
from scenes import pinched_blocks, solve_scene

pytestmark = pytest.mark.slow


def blocks(N: int, order: int, law: str = "coulomb", **method) -> dict:
    """Pinched blocks whose nodes are those of squares of side 1/N."""
    scene = pinched_blocks(N // order, law, **method)
    for body in scene["body"]:
        body["mesh"]["order"] = order
    return scene


@pytest.mark.mpi(ranks=2)
def test_all_methods_give_the_same_forces(comm):
    """Newton's method, the published iteration, and brute force."""
    from ddmpi.run.solve import solve

    assembly = scenes.prepare_scene(comm, blocks(6, 2))
    answer, exact = solve(assembly, assembly.scene.method), scenes.exact_forces(assembly)
    assert answer.certified
    size = np.linalg.norm(exact)
    assert (
        np.linalg.norm(scenes.everywhere(assembly, answer.outer.forces) - exact)
        <= answer.limit * size
    )
    published = solve_scene(comm, blocks(6, 2, outer="relaxation", tolerance=1e-6))
    forces = np.concatenate(
        [published["normal_force"], published["tangential_force"][published["sliding"]]]
    )
    assert published["certified"] and np.linalg.norm(forces - exact) <= 1e-3 * size
