"""Towers of bodies with any compliance, and faults on a rank that is not next to rank 0."""

import pytest
import scenes
from elsewhere import assert_same, found
from fault_cases import contents, run_in_one_go
from scenes import tower

pytestmark = pytest.mark.slow


@pytest.mark.mpi(ranks=3)
@pytest.mark.parametrize("kind", ["direct", "iterative"])
def test_a_tower_has_one_answer_with_any_compliance(comm, kind):
    """By solves and by multigrid the answer is that of dense compliances."""
    assert_same(found(tower(3, 3), comm), found(tower(3, 3, compliance=kind), comm), within=1e-7)


KINDS = {"SolverError": 4, "OutputError": 5, "InputError": 2, "SIGTERM": 6}
PLACES = {"mesh": ("ddmpi.coupling.assembly.build_mesh", 1), "assemble": ("ddmpi.coupling.assembly.assemble", 1),
          "factor": ("ddmpi.body.solver.StiffnessSolver.__init__", 1),
          "outer": ("ddmpi.body.compliance.Compliance.mult", 12),
          "conclude": ("ddmpi.coupling.member.Member.displacement", 1)}
ITERATES = ("outer", "conclude")


def test_a_fault_on_the_last_of_three_ranks_ends_them_all_with_one_message(tmp_path):
    """A signal after the last iteration leaves a checkpoint, from which as many ranks go on to the same results."""
    scene = scenes.write_scene(tower(3, 2) | {"output": {"figures": False}}, tmp_path / "scene.toml")
    cases = [(place, kind) for place in PLACES for kind in KINDS if kind != "OutputError" or place in ITERATES]
    runs = run_in_one_go([(2, *PLACES[place], kind, str(tmp_path / f"{place} {kind}"), []) for place, kind in cases],
                         "run", str(scene), ranks=3)
    for (place, kind), run in zip(cases, runs, strict=True):
        assert run.code == KINDS[kind], (place, kind, run.output)
        assert len(run.messages) == 1, (place, kind, run.output)
        kept = place == "conclude" and kind in ("OutputError", "SIGTERM")
        assert run.files == ({"checkpoint.h5"} if kept else set()), (place, kind)
    (interrupted,) = (run for case, run in zip(cases, runs, strict=True) if case == ("conclude", "SIGTERM"))
    refused = scenes.run_here(scene, interrupted.folder, "--restart", str(interrupted.folder))
    assert refused.code == 2 and "mpirun -n 3" in refused.messages[0]
    again, usual = (scenes.run_command(scene, folder, *restart, ranks=3) for folder, restart in (
        (interrupted.folder, ["--restart", str(interrupted.folder)]), (tmp_path / "usual", [])))
    assert again.code == usual.code == 0, again.output
    files = usual.files - {"result.xdmf"}
    assert contents(again.folder, files) == contents(usual.folder, files) != {}
