"""What must hold of an answer beyond its iteration: certificates that do not flatter, runs that go on."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from mpi4py import MPI
from scenes import everywhere, exact_forces

import ddmpi.methods.newton
from ddmpi.errors import SolverError
from ddmpi.judge.certificate import Certificate, ContactResiduals
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import no_report
from ddmpi.run.solve import Iteration, Solution, solve
from ddmpi.run.steps import March
from ddmpi.system.clock import Clock

two_ranks = pytest.mark.mpi(ranks=2)


def approach() -> dict:
    """A block that is moved across a gap far wider than what it is then strained by."""
    moved = [{"on": "right", "x": -0.01001, "y": 2e-6}]
    return {
        "body": [
            scenes.rectangle("left", (0, 0), (1, 1), (8, 8), clamp=["left"]),
            scenes.rectangle("right", (1.01, 0), (1, 1), (8, 8), young=3e9, clamp=moved),
        ],
        "contact": [
            {"bodies": ["left", "right"], "on": ["right", "left"], "friction": scenes.COULOMB}
        ],
    }


@pytest.mark.slow
@two_ranks
@pytest.mark.parametrize("method", [{"theta": 0.2}, {}], ids=["relaxation", "newton"])
def test_certificate_is_not_flattered_by_a_rigid_approach(comm, method):
    assembly = scenes.prepare_scene(comm, approach() | {"method": method})
    answer, exact = solve(assembly, assembly.scene.method), exact_forces(assembly)
    forces, mismatch = (
        everywhere(assembly, each) for each in (answer.outer.forces, answer.outer.mismatch)
    )
    mismatch = np.linalg.norm(mismatch)
    assert answer.certified and np.linalg.norm(forces - exact) <= answer.limit * np.linalg.norm(
        exact
    )
    assert answer.certificate.worst()["force_mismatch"][0] == pytest.approx(
        mismatch / np.linalg.norm(forces), rel=0.1
    )


def test_newton_that_goes_on_knows_its_gaps():
    """It settles its forces on their bounds when it stops; going on, the gaps must belong to these forces."""
    assembly = scenes.prepare_scene(MPI.COMM_SELF, scenes.pinched_blocks(6))
    newton = Newton(assembly.joint, 500)
    assert newton.run(0.1) == "converged"
    assert newton.run(1e-10) == "converged"
    exact = exact_forces(assembly)
    assert np.linalg.norm(newton.forces - exact) <= 1e-8 * np.linalg.norm(exact)


@pytest.mark.parametrize(
    "worst, rounds",
    [
        ((3e-6, 5e-6, 4e-8), 3),
        ((3e-6, 5e-6, 2.9e-6), 3),
        ((3e-6, 1e-6, 9e-8), 5),
        ((3e-6, 5e-6, 2e-6, 3e-6, 1e-6, 1e-8), 6),
    ],
)
def test_one_useless_round_is_not_the_last(monkeypatch, worst, rounds):
    """Where the certificate fails, the tolerance tightens until two rounds in a row gain nothing."""
    assembly = scenes.prepare_scene(MPI.COMM_SELF, scenes.pinched_blocks(2, tolerance=1e-9))
    solved, values = (
        solve(assembly, assembly.scene.method),
        [*worst, *itertools.repeat(worst[-1], 9)],
    )
    iteration = Iteration(assembly, assembly.scene.method, no_report, Clock())

    def run(tolerance: float) -> str:
        iteration.outer.history.append(solved.outer.history[-1])
        return "converged"

    def conclude(*_) -> Solution:
        residuals = ContactResiduals(0.0, values[len(iteration.outer.history) - 1], 0.0, 0.0)
        return replace(solved, certificate=Certificate({"upper-lower": residuals}, {"upper": 0.0}))

    monkeypatch.setattr(iteration.outer, "run", run)
    monkeypatch.setattr(iteration, "conclude", conclude)
    answer = iteration.solve(None)
    assert len(iteration.outer.history) == rounds
    assert answer.certified == (values[rounds - 1] <= answer.limit)


@pytest.mark.slow
@two_ranks
def test_fallback_that_fails_on_one_rank_ends_on_both(comm, monkeypatch):
    monkeypatch.setattr(ddmpi.methods.newton, "PATIENCE", 0)
    assembly = scenes.prepare_scene(comm, scenes.pinched_blocks(6))
    if comm.rank == 1:
        C, mult, calls = assembly.member.C, assembly.member.C.mult, itertools.count(1)

        def fail(x, y, purpose, *arguments):
            if (
                purpose == "newton" and next(calls) == 9
            ):  # within a linear problem of the third stage
                raise SolverError("this rank alone")
            mult(x, y, purpose, *arguments)

        monkeypatch.setattr(C, "mult", fail)
    with pytest.raises(SolverError, match=r"^this rank alone$") as error:
        solve(assembly, assembly.scene.method)
    assert error.value.agreed


@pytest.mark.slow
@two_ranks
@pytest.mark.parametrize("contrast", [1e-4, 1e4])
def test_methods_agree(comm, contrast):
    """The accelerated map, whichever body is the softer one, against the coupled problem; Newton in test_extremes."""
    scene = scenes.pinched_blocks(6)
    scene["body"][0]["material"]["young"] *= contrast
    assembly = scenes.prepare_scene(comm, scene | {"method": {"outer": "anderson"}})
    answer, exact = solve(assembly, assembly.scene.method), exact_forces(assembly)
    assert answer.certified
    assert np.linalg.norm(
        everywhere(assembly, answer.outer.forces) - exact
    ) <= 1e-5 * np.linalg.norm(exact)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-2])
def test_what_is_hopeless_leaves_more_than_the_tolerance(monkeypatch, tolerance):
    """A mechanism ends Newton's method where it leaves more of the loads than the tolerance."""
    asked: list[float] = []
    monkeypatch.setattr(Iteration, "_past_meshes", lambda self, least: asked.append(least))
    scene = scenes.pinched_blocks(2, tolerance=tolerance)
    assembly = scenes.prepare_scene(MPI.COMM_SELF, scene)
    iteration = Iteration(assembly, assembly.scene.method, no_report, Clock())
    assert not iteration.outer.hopeless()
    assert asked == [tolerance]


def test_what_double_precision_makes_of_displacements_where_nodes_are_open():
    """By body ε ‖C‖ ‖s‖ / ‖C s‖, with C column by column; forces of open nodes are zero."""
    assembly = scenes.prepare_scene(MPI.COMM_SELF, scenes.pinched_blocks(3))
    iteration = Iteration(assembly, assembly.scene.method, no_report, Clock())
    iteration.solve(None)
    expected = {}
    for body, s in zip(assembly.bodies, iteration.outer.body_forces(), strict=True):
        columns = np.eye(body.member.size)
        C = np.zeros_like(columns)
        for unit, column in zip(columns, C, strict=True):
            body.member.mult(unit, column, "certificate")
        assert not s.all()
        size = np.linalg.norm(C, 2) * np.linalg.norm(s)
        expected[body.spec.name] = np.finfo(float).eps * size / np.linalg.norm(C @ s)
    assert iteration._rounding() == pytest.approx(expected, rel=1e-3, abs=0.0)


@pytest.mark.parametrize(("begin", "given"), [(0.0, 5.0), (1.0, 0.0)])
def test_energy_that_loads_give_at_once_is_that_of_the_first_leg(begin, given):
    """What friction may dissipate beyond the work of contacts: a load that acts at once gives some, at time 0 alone."""
    asked: list[float] = []

    def excess(noted: int, more: float) -> float:
        asked.append(more)
        return 0.0

    march = SimpleNamespace(
        _now=SimpleNamespace(change_since=lambda *_: 0.0),
        _forces=lambda mark: None,
        _base=SimpleNamespace(time=begin),
        log=SimpleNamespace(excess=excess),
        assembly=SimpleNamespace(space=None),
        _too_short=lambda: 0.0,
        _given=5.0,
        _tolerance=0.1,
        _changed=np.nan,
        **dict.fromkeys(("_coarse", "_largest", "_noted"), 0),
        _end=2.0,
        _number=4,
    )
    assert March._agree(march)
    assert asked == [given]
