"""Run the cases of a sweep one after another in one set of processes, and gather the results.

A case that fails is recorded, and the next one starts. Started again, the sweep goes on with the cases that have no
results, those that failed last; an interrupted case continues from its checkpoint.
"""

import contextlib
import functools
import gc
import logging
import os
import time
import traceback
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from ddmpi.errors import (
    DdmpiError,
    InputError,
    InternalError,
    InterruptionError,
    NotConvergedError,
    OutputError,
)
from ddmpi.petsc.options import RunOptions
from ddmpi.petsc.versions import free_garbage
from ddmpi.results.folder import running
from ddmpi.run.run import Cases
from ddmpi.sweep.cases import Case
from ddmpi.sweep.plots import draw_plot
from ddmpi.sweep.table import check_sweep, claim_sweep, gather, read_outcome, record_case
from ddmpi.system.agreement import agreed, from_first
from ddmpi.system.clock import Clock
from ddmpi.system.files import CHECKPOINT, UNFINISHED, writing
from ddmpi.system.logs import diverted, utc
from ddmpi.system.numbers import counted
from ddmpi.system.provenance import whereabouts

log = logging.getLogger("ddmpi")


@dataclass(frozen=True)
class Sweep:
    """A sweep by its command line."""

    scene_path: str
    identity: dict
    folder: Path
    cases: list[Case]
    chosen: list[Case]  # those to run now
    figures: bool  # of every case
    plots: list[str]  # RESULT:KEY

    def place(self, case: Case) -> Path:
        """The folder of a case."""
        return self.folder / case.folder


def list_cases(sweep: Sweep) -> None:
    """Print number, status and settings of the chosen cases. Not collective. Raises InputError as `run_sweep` does."""
    if sweep.folder.exists():
        check_sweep(sweep.folder, sweep.identity)
    for case in sweep.chosen:
        print(f"{case.number:5d}  {read_outcome(sweep.place(case)).status:13}  {case.label}")


def gather_sweep(sweep: Sweep) -> None:
    """Write the table of all cases and the plots without a run. Not collective. Raises what `run_sweep` does."""
    check_sweep(sweep.folder, sweep.identity)
    _gather(sweep)
    _judge(sweep)


def run_sweep(world: MPI.Comm, sweep: Sweep) -> None:
    """Run the chosen cases that are not finished; gather the table where all were chosen. Collective.

    Raises InputError before any work: another sweep's folder, a wrong number of ranks, a varied PETSc option that is
    also given; OutputError where a record, the table or a plot cannot be written; InterruptionError when a signal ends
    the case that is running, and the sweep with it; at the end what `_judge` raises, of a single case its own error.
    """
    options, error = RunOptions(), None
    order, cases = from_first(world, lambda: _pending(sweep, options)), Cases(world, survive=True)
    log.info(
        "%d cases in %s: %d to run, %d finished",
        len(sweep.chosen),
        sweep.folder,
        len(order),
        len(sweep.chosen) - len(order),
    )
    for done, number in enumerate(order, 1):
        case, start = sweep.cases[number], time.perf_counter()
        if taken := from_first(world, functools.partial(_taken, sweep.place(case))):
            log.info("%d/%d  case %d  %s", done, len(order), number, taken)
            continue
        error = _run_case(world, sweep, case, options, cases)
        if world.rank == 0:
            log.info(
                "%d/%d  case %d  %s: %s, %.2f s",
                done,
                len(order),
                number,
                case.label,
                _describe(sweep.place(case)),
                time.perf_counter() - start,
            )
        if isinstance(error, InterruptionError):
            log.info("the same command goes on with the sweep from here")
            raise error
    cases.end()
    options.use({})
    if len(sweep.chosen) == len(sweep.cases):
        from_first(world, lambda: _gather(sweep))
    if error and len(sweep.chosen) == 1:
        raise error
    from_first(world, lambda: _judge(sweep))


def _pending(sweep: Sweep, options: RunOptions) -> list[int]:
    """Claim the folder; numbers of the chosen cases without results, those that failed last. Raises InputError."""
    for key in sweep.cases[0].settings:
        if key.startswith("petsc.") and options.given(key.removeprefix("petsc.")):
            raise InputError(
                f"--vary {key}: this option is on the command line or in PETSC_OPTIONS, too, which "
                "would override it; leave one of them out"
            )
    claim_sweep(sweep.folder, sweep.identity, sweep.cases)
    outcomes = {case.number: read_outcome(sweep.place(case)) for case in sweep.chosen}
    left = [number for number, outcome in outcomes.items() if outcome.summary is None]
    return sorted(
        left, key=lambda number: outcomes[number].status not in ("not run", "interrupted")
    )


def _taken(place: Path) -> str:
    """The state of a case that another process has taken since this one started, in words; empty for a free case."""
    if read_outcome(place).summary:
        return "has been finished by another process"
    owner = running(place)
    return (
        owner
        and f"is left to another process ({owner}); if that was killed, remove {place / UNFINISHED}"
    )


def _run_case(
    world: MPI.Comm, sweep: Sweep, case: Case, options: RunOptions, cases: Cases
) -> DdmpiError | None:
    """Run one case, with what the `cases` before have left; its error, if all ranks agree on it. Collective. Raises
    OutputError."""
    place, error, restart = sweep.place(case), None, None
    with contextlib.ExitStack() as stack:
        with agreed(world):
            if world.rank == 0:
                if place.is_symlink():
                    raise OutputError(f"{place}: is a link, and no case is written elsewhere")
                with writing(place):
                    place.mkdir(exist_ok=True)
                record_case(place, case, None, f"started {utc()} on {whereabouts()}")
                restart = str(place) if os.path.exists(place / CHECKPOINT) else None
            stack.enter_context(diverted(place / "run.log" if world.rank == 0 else None))
        restart = world.bcast(restart)
        options.use(case.scene.petsc)
        try:
            cases.compute(
                case.scene,
                sweep.scene_path,
                Clock(),
                output=str(place),
                figures=case.scene.output.figures and sweep.figures,
                restart=restart,
            )
        except DdmpiError as failure:
            if not failure.agreed:
                raise
            error = failure
            if error.__cause__:  # a mistake of the program
                log.error("%s", "".join(traceback.format_exception(error.__cause__)))
                traceback.clear_frames(error.__cause__.__traceback__)
            traceback.clear_frames(error.__traceback__)  # they hold PETSc's objects
            log.error("ddmpi: %s: %s", error.kind, error)
        except Exception as mistake:  # of this rank alone: all processes end, and the next start leaves it to the last
            record_case(
                place,
                case,
                1,
                f"internal error on rank {world.rank}: {type(mistake).__name__}: {mistake}",
            )
            raise
    gc.collect()  # objects that refer to each other in a circle, such as solvers and their contexts
    free_garbage()
    code, words = (error.exit_code, str(error).split("\n")[0]) if error else (0, "")
    from_first(world, lambda: record_case(place, case, code, words))
    return error


def _describe(place: Path) -> str:
    """The outcome of a case in one line."""
    outcome = read_outcome(place)
    end = f"{outcome.status}: {outcome.reason}"
    if outcome.summary:
        end += f", {counted(outcome.summary['outer_iterations'], 'outer iteration')}, n_A = {outcome.summary['n_A']}"
        if unused := outcome.summary["options_unused"]:
            end += f"; PETSc options that nothing used: {', '.join(unused)}"
        if warnings := len(outcome.warnings) - bool(unused):
            end += f"; {warnings} warning{'s' * (warnings > 1)}"
    return end


def _gather(sweep: Sweep) -> None:
    """Write table and plots. Not collective. Raises OutputError."""
    log.info("table in %s", gather(sweep.folder, sweep.cases))
    for plot in sweep.plots:
        try:
            log.info("plot in %s", draw_plot(sweep.folder, plot))
        except InputError as error:
            log.warning("not drawn: %s", error)


def _judge(sweep: Sweep) -> None:
    """Count the chosen cases by outcome, and those with warnings. Not collective.

    Raises NotConvergedError unless all are certified; OutputError where results of one could not be written,
    InternalError where a mistake of the program ended one.
    """
    outcomes = [read_outcome(sweep.place(case)) for case in sweep.chosen]
    if warning := [outcome.warnings for outcome in outcomes if outcome.warnings]:
        log.warning(
            "%d of %d cases warn, each in its run.log; the first: %s",
            len(warning),
            len(outcomes),
            warning[0][0],
        )
    counts = Counter(outcome.status for outcome in outcomes)
    verdict = f"{counts.pop('certified', 0)} of {len(sweep.chosen)} cases in {sweep.folder} have a certified answer"
    if counts:
        rest = ", ".join(f"{number} {status}" for status, number in counts.most_common())
        exits = {outcome.exit for outcome in outcomes}
        worst = next(
            (kind for kind in (InternalError, OutputError) if kind.exit_code in exits),
            NotConvergedError,
        )
        raise worst(f"{verdict}; {rest}")
    log.info("%s", verdict)
