"""Quadratic triangles: the answer, the work it takes, and the files.

Exactness on linear fields is in test_closed_forms, rates are in test_convergence.
"""

import numpy as np
import pytest
import scenes
from mpi4py import MPI
from problems.bodies import annulus
from problems.forms import lame_fit, plane_strain
from scenes import pinched_blocks, solve_scene

pytestmark = pytest.mark.slow


def blocks(N: int, order: int, law: str = "coulomb", **method) -> dict:
    """Pinched blocks whose nodes are those of squares of side 1/N."""
    scene = pinched_blocks(N // order, law, **method)
    for body in scene["body"]:
        body["mesh"]["order"] = order
    return scene


def test_more_for_the_same_work_than_linear_triangles():
    """With as many unknowns and products the strain energy, which errs with the square of the energy norm, is nearer to
    the limit; compliances by solves and by multigrid give the same forces."""
    linear, quadratic, fine, direct, iterative = (solve_scene(MPI.COMM_SELF, scene) for scene in (
        blocks(22, 1), blocks(22, 2), blocks(44, 2), blocks(22, 2, compliance="direct"),
        blocks(22, 2, compliance="iterative")))
    assert all(each["certified"] for each in (linear, quadratic, fine, direct, iterative))
    energies = [sum(each["energy"]) for each in (linear, quadratic, fine)]
    assert abs(energies[1] - energies[2]) < 0.5 * abs(energies[0] - energies[2])
    assert quadratic["n_A"] == direct["n_A"] <= min(230, 1.15 * linear["n_A"])
    assert fine["normal_force"].sum() == pytest.approx(1.1507844e8, rel=1e-3)  # linear triangles, N = 54
    for other, within in ((direct, 1e-8), (iterative, 1e-6)):
        size = np.linalg.norm(quadratic["normal_force"])
        assert np.linalg.norm(other["normal_force"] - quadratic["normal_force"]) <= within * size


@pytest.mark.mpi(ranks=2)
def test_all_methods_give_the_same_forces(comm):
    """Newton's method, the published iteration, and brute force."""
    from ddmpi.run.solve import solve

    assembly = scenes.prepare_scene(comm, blocks(12, 2))
    answer, exact = solve(assembly, assembly.scene.method), scenes.exact_forces(assembly)
    assert answer.certified
    size = np.linalg.norm(exact)
    assert np.linalg.norm(scenes.everywhere(assembly, answer.outer.forces) - exact) <= answer.limit * size
    published = solve_scene(comm, blocks(12, 2, outer="relaxation", tolerance=1e-6))
    forces = np.concatenate([published["normal_force"], published["tangential_force"][published["sliding"]]])
    assert published["certified"] and np.linalg.norm(forces - exact) <= 1e-3 * size


def test_means_over_sides_do_not_swing_on_a_curved_interface(tmp_path):
    bodies = [{"name": name, "mesh": annulus(radii, (24, 8), "2 straight", tmp_path.resolve()),
               "material": {"young": 2.1e11, "poisson": 0.3},
               "clamp": [{"on": "end", "x": 0.0}, {"on": "start", "y": 0.0}]}
              for name, radii in (("inner", (0.5, 1.0 + 1e-6)), ("outer", (1.0, 1.5)))]
    contact = {"bodies": ["inner", "outer"], "on": ["outer", "inner"], "friction": {"law": "none"}}
    scene = scenes.write_scene({"title": "Shrink fit", "body": bodies, "contact": [contact]}, tmp_path / "rings.toml")
    run = scenes.run_here(scene, tmp_path / "rings", "--no-figures")
    assert run.code == 0, run.output
    nodes, sides = (run.table(f"contact_inner-outer{end}.csv")["normal_stress"] for end in ("", "_sides"))
    exact = lame_fit(0.5, 1.0, 1.5, 1e-6, plane_strain(2.1e11, 0.3))
    assert np.abs(sides / exact - 1).max() < 1e-3 < 0.015 < np.abs(nodes / exact - 1).max()
