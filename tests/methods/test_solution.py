"""What must hold of an answer beyond its iteration: certificates that do not flatter, runs that go on."""

import numpy as np
import pytest
import scenes

import ddmpi.methods.newton
from ddmpi.errors import SolverError
from ddmpi.judge.brute_force import solve_coupled
from ddmpi.methods.newton import InterfaceNewton
from ddmpi.run.solve import solve
from ddmpi.scene.method import Method

two_ranks = pytest.mark.mpi(ranks=2, timeout=60, unit="s")


def approach() -> dict:
    """A block that is moved across a gap far wider than what it is then strained by."""
    def block(name, x, clamp, young):
        return {"name": name, "clamp": clamp, "material": {"young": young, "poisson": 0.3},
                "mesh": {"shape": "rectangle", "origin": [x, 0.0], "size": [1.0, 1.0], "divisions": [8, 8]}}
    return {"body": [block("left", 0.0, ["left"], 1e9),
                     block("right", 1.01, [{"on": "right", "x": -0.01001, "y": 2e-6}], 3e9)],
            "contact": [{"bodies": ["left", "right"], "on": ["right", "left"],
                         "friction": {"law": "coulomb", "coefficient": 0.3}}]}


@two_ranks
def test_certificate_is_not_flattered_by_a_rigid_approach(comm):
    for method in ({"theta": 0.2}, {}):
        problem = scenes.prepare_scene(comm, approach() | {"method": method})
        answer, outer = solve(problem, problem.scene.method)
        exact = solve_coupled(problem.body, problem.friction, problem.exchange)
        distance = np.linalg.norm(outer.forces - exact) / np.linalg.norm(exact)
        assert answer.certified
        assert distance <= answer.limit
        assert answer.certificate.force_mismatch == pytest.approx(
            np.linalg.norm(outer.s1 - outer.s2) / max(np.linalg.norm(outer.s1), np.linalg.norm(outer.s2)))


@two_ranks
def test_newton_that_goes_on_knows_its_gaps(comm):
    """It settles its forces on their bounds when it stops; going on, the gaps must belong to these forces."""
    problem = scenes.prepare_scene(comm, scenes.pinched_blocks(6))
    newton = InterfaceNewton(problem.body, problem.friction, problem.exchange, Method().resolved(), 1.15e11)
    assert newton.run(0.1) == "converged"
    assert newton.run(1e-10) == "converged"
    exact = solve_coupled(problem.body, problem.friction, problem.exchange)
    assert np.linalg.norm(newton.forces - exact) <= 1e-8 * np.linalg.norm(exact)


@two_ranks
def test_fallback_that_fails_on_one_rank_ends_on_both(comm, monkeypatch):
    monkeypatch.setattr(ddmpi.methods.newton, "PATIENCE", 0)
    problem = scenes.prepare_scene(comm, scenes.pinched_blocks(6))
    if comm.rank == 1:
        def fail(*arguments):
            raise SolverError("this rank alone")
        monkeypatch.setattr(ddmpi.methods.newton.QPSolver, "solve", fail)
    with pytest.raises(SolverError) as error:
        solve(problem, problem.scene.method)
    assert error.value.agreed


@two_ranks
def test_fallback_reaches_the_same_answer(comm, monkeypatch):
    exact = None
    for patience in (ddmpi.methods.newton.PATIENCE, 0):
        monkeypatch.setattr(ddmpi.methods.newton, "PATIENCE", patience)
        problem = scenes.prepare_scene(comm, scenes.pinched_blocks(6))
        answer, outer = solve(problem, problem.scene.method)
        assert answer.certified
        if exact is None:
            exact = solve_coupled(problem.body, problem.friction, problem.exchange)
        assert np.linalg.norm(outer.forces - exact) <= 1e-7 * np.linalg.norm(exact)


@two_ranks
@pytest.mark.parametrize("contrast", [1e-4, 1.0, 1e4])
def test_methods_agree(comm, contrast):
    """Newton and the accelerated map, whichever body is the softer one, against the coupled problem."""
    scene = scenes.pinched_blocks(6)
    scene["body"][0]["material"]["young"] *= contrast
    for outer in ("newton", "anderson"):
        problem = scenes.prepare_scene(comm, scene | {"method": {"outer": outer}})
        answer, found = solve(problem, problem.scene.method)
        exact = solve_coupled(problem.body, problem.friction, problem.exchange)
        assert answer.certified
        assert np.linalg.norm(found.forces - exact) <= 1e-5 * np.linalg.norm(exact)
