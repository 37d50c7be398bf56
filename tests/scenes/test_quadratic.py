"""Quadratic triangles through the real command: the answer, the work it takes, and the files.

Exactness on linear fields is in test_closed_forms, rates are in test_convergence.
"""

import numpy as np
import pytest
import scenes
from scenes import pinched_blocks

pytestmark = pytest.mark.slow


def quadratic(scene: dict) -> dict:
    for body in scene["body"]:
        body["mesh"]["order"] = 2
    return scene


def blocks(N: int, order: int, law: str = "coulomb", **method) -> dict:
    """Pinched blocks whose nodes are those of squares of side 1/N."""
    scene = pinched_blocks(N // order, law, **method)
    return scene if order == 1 else quadratic(scene)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("quadratic")


@pytest.fixture(scope="module")
def done(folder) -> scenes.Run:
    scene = scenes.write_scene(blocks(22, 2), folder / "blocks.toml")
    run = scenes.run_here(scene, folder / "results")
    assert run.code == 0, run.output
    return run


@pytest.fixture(scope="module")
def solutions(folder) -> dict[str, dict]:
    cases = {"linear": blocks(22, 1)}
    cases |= {kind: blocks(22, 2, compliance=kind) for kind in ("explicit", "direct", "iterative")}
    cases |= {law: blocks(22, 2, law) for law in ("tresca", "none")}
    cases |= {"quadratic, fine": blocks(44, 2)}
    cases |= {"published": blocks(12, 2, outer="relaxation", tolerance=1e-6), "newton": blocks(12, 2)}
    return scenes.solve_all(cases, folder)


def test_size(done):
    """The same unknowns as linear triangles of half the side."""
    summary = done.summary
    assert summary["order"] == 2
    assert (summary["n"], summary["m"]) == (12 * 22 * 23, 3 * 22)
    assert summary["converged"] is True


@pytest.mark.parametrize("case", ["explicit", "tresca", "none", "iterative", "linear", "published"])
def test_certified(solutions, case):
    assert "error" not in solutions[case], solutions[case]["error"]
    assert solutions[case]["certified"], solutions[case]["reason"]
    assert (solutions[case]["length"] > 0).all()


def test_no_more_work_than_for_linear_triangles(solutions):
    assert solutions["explicit"]["n_A"] <= 1.15 * solutions["linear"]["n_A"]
    assert solutions["explicit"]["n_A"] <= 230


def test_all_compliances_and_methods_give_the_same(solutions):
    def distance(one, other):
        a, b = (np.concatenate([solutions[name]["normal_force"], solutions[name]["tangential_force"]])
                for name in (one, other))
        return np.linalg.norm(a - b) / np.linalg.norm(b)

    assert distance("direct", "explicit") <= 1e-8
    assert distance("iterative", "explicit") <= 1e-6
    assert distance("published", "newton") <= 1e-3
    assert solutions["direct"]["n_A"] == solutions["explicit"]["n_A"]


def test_nearer_to_the_limit_than_linear_triangles_with_as_many_unknowns(solutions):
    """By the strain energy, which errs with the square of the energy norm."""
    linear, quadratic, limit = (sum(solutions[name]["energy"]) for name in ("linear", "explicit", "quadratic, fine"))
    assert abs(quadratic - limit) < 0.5 * abs(linear - limit)
    normal = solutions["quadratic, fine"]["normal_force"].sum()
    assert normal == pytest.approx(1.1507844e8, rel=1e-3)  # linear triangles, N = 54 (design, section 3)


@pytest.mark.mpi(ranks=2)
def test_the_coupled_problem_has_the_same_forces(comm):
    from ddmpi.run.solve import solve

    assembly = scenes.prepare_scene(comm, blocks(12, 2))
    answer, exact = solve(assembly, assembly.scene.method), scenes.exact_forces(assembly)
    forces = scenes.everywhere(assembly, answer.outer.forces)
    assert answer.certified
    assert np.linalg.norm(forces - exact) <= answer.limit * np.linalg.norm(exact)


def test_bodies_of_different_order_are_refused(folder):
    scene = blocks(12, 2)
    scene["body"][0]["mesh"]["order"] = 1
    run = scenes.run_here(scenes.write_scene(scene, folder / "mixed.toml"), folder / "mixed")
    assert run.code == 2
    assert "bodies differ in mesh.order" in run.output and run.files == set()
