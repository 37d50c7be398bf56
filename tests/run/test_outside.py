"""An outer method from outside the package: docs/examples/projected.py, and classes that are none."""

import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scenes import call, pinched_blocks, run_here, write_scene

import ddmpi
from ddmpi.errors import InputError, SolverError
from ddmpi.methods.outer import Outer

EXAMPLES = Path(__file__).parents[2] / "docs/examples"


@pytest.fixture
def projected(monkeypatch):
    """The class of the example."""
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.delitem(sys.modules, "projected", raising=False)
    import projected

    return projected.Projected


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_an_outside_method_has_newtons_answer(comm, projected):
    scene = pinched_blocks(1, max_iterations=20_000, tolerance=1e-6)
    wanted = ddmpi.solve(scene, comm, only="contacts").contacts["upper-lower"].forces
    answer = ddmpi.solve(scene, comm, only="contacts", outer=projected)
    assert answer.certified and answer.summary["outer"] == "projected:Projected", answer.reason
    assert answer.contacts["upper-lower"].forces == pytest.approx(
        wanted, abs=2e-5 * np.abs(wanted).max()
    )
    few = ddmpi.solve(scene, comm, {"method.max_iterations": 3}, outer=projected)
    assert not few.certified and "max_iterations is reached" in few.reason


@pytest.mark.mpi(ranks=2)
def test_what_one_rank_cannot_import_is_refused_on_both(comm, projected, monkeypatch):
    if comm.rank:
        monkeypatch.delitem(sys.modules, "projected")
        monkeypatch.setattr(sys, "path", sys.path[1:])  # without its folder
    with pytest.raises(
        InputError, match='"projected:Projected" cannot be imported: ModuleNotFoundError'
    ):
        ddmpi.solve(pinched_blocks(2), comm, outer="projected:Projected")


@pytest.mark.slow
def test_a_run_writes_results_of_an_outside_method(tmp_path, projected):
    scene = write_scene(pinched_blocks(2, max_iterations=20_000), tmp_path / "scene.toml")
    run = run_here(
        scene, tmp_path / "out", "--no-figures", "--set", "method.outer=projected:Projected"
    )
    assert run.code == 0 and "projected:Projected, not of ddmpi, update below 1e-08" in run.output


def test_no_scene_starts_code(tmp_path, monkeypatch):
    """A class that a scene names is refused before its module is imported, with how to give it, by all that read one."""
    (tmp_path / "here.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()")
    monkeypatch.syspath_prepend(tmp_path)
    named = pinched_blocks(2, outer="here:Class")
    scene = write_scene(named, tmp_path / "scene.toml")
    for command in ("run", "check"):
        run = call(command, str(scene), "--output", str(tmp_path / "out"))
        assert run.code == 2 and "--set method.outer=here:Class" in run.messages[0]
    swept = call(
        "sweep",
        str(scene),
        "--vary",
        "method.tolerance=1e-4,1e-5",
        "--output",
        str(tmp_path / "out"),
    )
    assert swept.code == 2 and "no scene may start" in swept.messages[0]
    for given in (scene, scene.read_text(), named):
        with pytest.raises(InputError, match="no scene may start"):
            ddmpi.solve(given)
    assert not (tmp_path / "ran").exists()
    other = run_here(scene, tmp_path / "out", "--no-figures", "--set", "method.outer=newton")
    assert other.code == 0, other.messages


@pytest.mark.parametrize(
    "outer, message",
    [
        ("no.such.package:Class", "cannot be imported: ModuleNotFoundError"),
        ("json:Class", "cannot be imported: AttributeError"),
        ("math:pi", "is no class that is based on ddmpi.methods.outer.Outer"),
        ("json:JSONDecoder", "is no class that is based on ddmpi.methods.outer.Outer"),
        (
            "ddmpi.methods.outer:Outer",
            "has no run, forces, bound, body_forces, refresh, state, restore of its own",
        ),
    ],
)
def test_what_is_no_method_is_refused(outer, message):
    with pytest.raises(InputError, match=f'scene: method.outer = "{outer}" {message}'):
        ddmpi.solve(pinched_blocks(2), overrides={"method.outer": outer})


def test_what_a_class_does_not_keep_is_refused(projected):
    def variant(**changes):
        return type("Variant", (projected,), changes)

    def solve(outer, scene=None):
        scene = scene or pinched_blocks(1, max_iterations=20_000)
        return ddmpi.solve(scene, MPI.COMM_SELF, only="contacts", outer=outer)

    with pytest.raises(InputError, match=r"has no state of its own, see docs/use/methods\.md"):
        solve(variant(state=Outer.state))
    with pytest.raises(InputError, match="is not made by Class"):
        solve(variant(__init__=lambda self, joint: None))
    with pytest.raises(InputError, match="is no value of a scene"):
        solve(3.0 + 1j)
    with pytest.raises(SolverError, match="its run returns 'done', none of converged"):
        solve(variant(run=lambda self, tolerance: projected.run(self, tolerance) and "done"))
    with pytest.raises(SolverError, match="it reports no step"):
        solve(variant(run=lambda self, tolerance: "converged"))
    with pytest.raises(InputError, match=r"time: method\.outer = .* solves a single load step"):
        solve(projected, pinched_blocks(2) | {"time": {"points": [1.0], "steps": 2}})
    # bodies in balance under forces that are not those of the contact
    double = variant(forces=property(lambda self: 2.0 * self.s))
    answer = solve(double)
    assert not answer.certified and answer.summary["certificate"]["force_mismatch"] > 0.1
    wrong = variant(run=lambda self, tolerance: projected.run(self, 0.1) and "converged")
    assert not solve(wrong).certified
