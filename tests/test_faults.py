"""Errors, signals, broken numbers and full disks on one rank: the whole run ends in time, with one message.

A selection of what scripts/fault_injection.py tries, which has every fault in every phase on either rank.
"""

from concurrent.futures import ThreadPoolExecutor

import fault
import pytest
import scenes
from fault_cases import Ground, Outcome, all_cases, run_in_one_go
from scenes import Run, pinched_blocks

LIMIT = 60.0
RELAXATION = ("--set", "method.outer=relaxation")

SHORT = [
    "mesh: RuntimeError on rank 1", "assemble: SIGKILL on rank 0", "factor: SIGSEGV on rank 1",
    "outer: RuntimeError on rank 0", "outer: SIGKILL on rank 1", "outer, published: KeyboardInterrupt on rank 1",
    "conclude: full on rank 0", "output: RuntimeError on rank 1", "output: SIGKILL on rank 0", "output: gone on rank 0",
    "writing a checkpoint: SIGKILL", "publishing: SIGKILL between two files", "NaN in the stiffness on rank 1",
    "zero pivot on rank 0", "NaN from a product on rank 1", "an error of PETSc on rank 1",
]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory) -> dict[str, Outcome]:
    cases = {case.name: case for case in all_cases()}
    ground = Ground(tmp_path_factory.mktemp("faults"))
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(SHORT, pool.map(ground.try_case, [cases[name] for name in SHORT]), strict=True))


@pytest.mark.parametrize("name", SHORT)
def test_the_run_ends_and_nothing_is_lost(outcomes, name):
    outcome = outcomes[name]
    assert not outcome.faults, outcome.output


def test_there_are_more_than_a_hundred_cases_and_each_once():
    names = [case.name for case in all_cases()]
    assert len(names) > 100
    assert len(set(names)) == len(names)
    assert set(SHORT) <= set(names)


# Our own errors

PHASES = {
    # phase: target, call, more arguments
    "mesh": ("ddmpi.problem.build_mesh", 1, ()),
    "assemble": ("ddmpi.problem.assemble", 1, ()),
    "factor": ("ddmpi.solvers.StiffnessSolver.__init__", 1, ()),
    "outer": ("ddmpi.compliance.Compliance.mult", 12, ()),  # within GMRES of the Newton method
    "outer, published": ("ddmpi.body.Body.neumann", 3, RELAXATION),
    "output": ("ddmpi.run.write_fields", 1, ()),
    "end of output": ("ddmpi.run.write_summary", 2, ()),  # by rank 0 alone, when all else is there
}
CASES = [(phase, rank) for phase in PHASES for rank in (0, 1) if (phase, rank) != ("end of output", 1)]
KINDS = {"SolverError": 4, "OutputError": 5}
"""Exit codes of our own errors."""


@pytest.fixture(scope="module")
def own_errors(tmp_path_factory) -> dict[tuple, list[Run]]:
    """By case, for each kind of error; they end in an orderly way, so that one child does all of a kind."""
    here = tmp_path_factory.mktemp("own errors")
    scene = scenes.write_scene(pinched_blocks(2), here / "scene.toml")
    runs = [run_in_one_go([(rank, *PHASES[phase][:2], error, str(here / f"{phase} {rank} {error}"), PHASES[phase][2])
                           for phase, rank in CASES], "run", str(scene), "--no-figures", limit=2 * LIMIT)
            for error in KINDS]
    return dict(zip(CASES, map(list, zip(*runs, strict=True)), strict=True))


@pytest.mark.parametrize(("phase", "rank"), CASES)
def test_own_error_on_one_rank_is_raised_on_all(own_errors, phase, rank):
    for run, (error, code) in zip(own_errors[phase, rank], KINDS.items(), strict=True):
        kept = error == "OutputError" and phase not in ("mesh", "assemble", "factor")
        assert run.code == code
        assert len(run.messages) == 1
        assert run.messages[0].startswith(f"ddmpi: error: {fault.MESSAGE}")
        assert run.stderr.strip() == run.messages[0]
        assert (f"--restart {run.folder} goes on" in run.messages[0]) == kept
        assert run.files == ({"checkpoint.h5"} if kept else set())  # nor a folder in which results are made
