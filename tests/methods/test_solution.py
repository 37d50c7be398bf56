"""What must hold of an answer beyond its iteration: certificates that do not flatter, runs that go on."""

import itertools

import numpy as np
import pytest
import scenes
from scenes import everywhere, exact_forces

import ddmpi.methods.newton
from ddmpi.errors import SolverError
from ddmpi.methods.newton import Newton
from ddmpi.run.solve import solve

pytestmark = pytest.mark.slow

two_ranks = pytest.mark.mpi(ranks=2)


def approach() -> dict:
    """A block that is moved across a gap far wider than what it is then strained by."""
    moved = [{"on": "right", "x": -0.01001, "y": 2e-6}]
    return {"body": [scenes.rectangle("left", (0, 0), (1, 1), (8, 8), clamp=["left"]),
                     scenes.rectangle("right", (1.01, 0), (1, 1), (8, 8), young=3e9, clamp=moved)],
            "contact": [{"bodies": ["left", "right"], "on": ["right", "left"], "friction": scenes.COULOMB}]}


@two_ranks
def test_certificate_is_not_flattered_by_a_rigid_approach(comm):
    for method in ({"theta": 0.2}, {}):
        assembly = scenes.prepare_scene(comm, approach() | {"method": method})
        answer = solve(assembly, assembly.scene.method)
        outer = answer.outer
        exact = exact_forces(assembly)
        forces = everywhere(assembly, outer.forces)
        distance = np.linalg.norm(forces - exact) / np.linalg.norm(exact)
        assert answer.certified
        assert distance <= answer.limit
        assert answer.certificate.worst()["force_mismatch"][0] == pytest.approx(
            np.linalg.norm(everywhere(assembly, outer.mismatch)) / np.linalg.norm(forces), rel=0.1)


def test_newton_that_goes_on_knows_its_gaps(comm):
    """It settles its forces on their bounds when it stops; going on, the gaps must belong to these forces."""
    assembly = scenes.prepare_scene(comm, scenes.pinched_blocks(6))
    newton = Newton(assembly.joint, 500)
    assert newton.run(0.1) == "converged"
    assert newton.run(1e-10) == "converged"
    exact = exact_forces(assembly)
    assert np.linalg.norm(everywhere(assembly, newton.forces) - exact) <= 1e-8 * np.linalg.norm(exact)


@two_ranks
def test_fallback_that_fails_on_one_rank_ends_on_both(comm, monkeypatch):
    monkeypatch.setattr(ddmpi.methods.newton, "PATIENCE", 0)
    assembly = scenes.prepare_scene(comm, scenes.pinched_blocks(6))
    if comm.rank == 1:
        C, mult, calls = assembly.member.C, assembly.member.C.mult, itertools.count(1)

        def fail(x, y, purpose, *arguments):
            if purpose == "newton" and next(calls) == 9:  # within a linear problem of the third stage
                raise SolverError("this rank alone")
            mult(x, y, purpose, *arguments)
        monkeypatch.setattr(C, "mult", fail)
    with pytest.raises(SolverError, match=r"^this rank alone$") as error:
        solve(assembly, assembly.scene.method)
    assert error.value.agreed


@two_ranks
@pytest.mark.parametrize("contrast", [1e-4, 1.0, 1e4])
def test_methods_agree(comm, contrast):
    """Newton and the accelerated map, whichever body is the softer one, against the coupled problem."""
    scene = scenes.pinched_blocks(6)
    scene["body"][0]["material"]["young"] *= contrast
    for outer in ("newton", "anderson"):
        assembly = scenes.prepare_scene(comm, scene | {"method": {"outer": outer}})
        answer = solve(assembly, assembly.scene.method)
        found = answer.outer
        exact = exact_forces(assembly)
        assert answer.certified
        assert np.linalg.norm(everywhere(assembly, found.forces) - exact) <= 1e-5 * np.linalg.norm(exact)
