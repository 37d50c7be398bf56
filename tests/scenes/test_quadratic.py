"""Quadratic triangles: the answer, the work it takes, and the files.

Exactness on linear fields is in test_closed_forms, rates are in test_convergence.
"""

import numpy as np
import pytest
import scenes
from mpi4py import MPI
from scenes import pinched_blocks, solve_scene
from true_errors import Rings

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
    """Pressures at nodes show the corners of straight sides; their means over sides do not."""
    rings = Rings()
    rings.write_meshes(tmp_path, 8)
    bodies = [{"name": name, "mesh": {"file": f"rings_{name}_8.msh", "order": 2},
               "material": {"young": rings.material(name).young, "poisson": rings.material(name).poisson},
               "clamp": [{"on": "left", "x": 0.0}, {"on": "bottom", "y": 0.0}]} for name in ("inner", "outer")]
    scene = {"body": bodies, "contact": [{"bodies": ["inner", "outer"], "on": ["outside", "inside"]}]}
    run = scenes.run_here(scenes.write_scene(scene, tmp_path / "rings.toml"), tmp_path / "rings", "--no-figures")
    assert run.code == 0, run.output
    nodes, sides = (run.table(f"contact_inner-outer{end}.csv")["normal_stress"] for end in ("", "_sides"))
    assert np.abs(sides / rings.pressure - 1).max() < 1e-3 < 0.02 < np.abs(nodes / rings.pressure - 1).max()


def test_bodies_of_different_order_are_refused(tmp_path):
    """Before anything is written."""
    scene = blocks(12, 2)
    scene["body"][0]["mesh"]["order"] = 1
    run = scenes.run_here(scenes.write_scene(scene, tmp_path / "mixed.toml"), tmp_path / "mixed")
    assert run.code == 2
    assert "mesh.order 1 and 2" in run.output and run.files == set()
