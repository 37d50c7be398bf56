"""Run the cases of a sweep one after another in one set of processes, and gather the results.

A case that fails is recorded, and the next one starts. Results are written case by case, so that processes that die
lose only the case that is running. Started again, the sweep goes on with the cases that have no results, those that
failed before last. An interrupted case continues from its checkpoint.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

from ddmpi.coupling.ranks import check_ranks
from ddmpi.errors import DdmpiError, InputError, InterruptionError, NotConvergedError, OutputError
from ddmpi.petsc.options import RunOptions
from ddmpi.petsc.versions import free_garbage
from ddmpi.results.folder import running
from ddmpi.run.run import run
from ddmpi.sweep.cases import Case
from ddmpi.sweep.plots import check_plots, draw_plots
from ddmpi.sweep.table import (
    check_sweep,
    check_table,
    claim_sweep,
    gather,
    identify,
    read_outcome,
    record_case,
    status_of,
)
from ddmpi.system.agreement import agreed
from ddmpi.system.files import CHECKPOINT
from ddmpi.system.logs import diverted, utc
from ddmpi.system.provenance import process_seconds

log = logging.getLogger("ddmpi")


@dataclass(frozen=True)
class Sweep:
    """What was asked for.

    Attributes
    ----------
    scene_path : the scene's file
    scene : its data, before anything is varied
    folder : of the sweep, with a folder for each case in it
    cases : all of them
    chosen : those to run now
    petsc : PETSc options of the command line
    figures : whether every case gets its pictures
    plots : RESULT:KEY, pictures of the gathered table
    """

    scene_path: str
    scene: dict
    folder: Path
    cases: list[Case]
    chosen: list[Case]
    petsc: list[str] = field(default_factory=list)
    figures: bool = False
    plots: list[str] = field(default_factory=list)

    def place(self, case: Case) -> Path:
        """The folder of a case."""
        return self.folder / case.folder

    @property
    def identity(self) -> dict:
        return identify(self.scene, self.petsc, self.cases, Path(self.scene_path).parent)


def list_cases(sweep: Sweep) -> None:
    """Print number, status and settings of the chosen cases. Not collective. Raises InputError as `run_sweep` does."""
    _check_options(sweep.cases, RunOptions())
    if sweep.folder.exists():
        check_sweep(sweep.folder, sweep.identity)
    for case in sweep.chosen:
        print(f"{case.number:5d}  {read_outcome(sweep.place(case)).status:13}  {case.label}")


def run_sweep(world: MPI.Comm, sweep: Sweep) -> None:
    """Run the chosen cases that are not finished; gather the table where all were chosen. Collective.

    Raises
    ------
    InputError
        before any work: another sweep's folder, a table that would lose cases, a wrong number of ranks, an impossible
        plot, varied PETSc options that are also given
    NotConvergedError
        at the end, where a chosen case has no certified answer; a single case raises its own error
    OutputError
        at the end, where table or plots cannot be written, and where a record cannot. A plot for which there is
        nothing to draw is a warning
    InterruptionError
        when a signal ends the case that is running, and the sweep with it

    The same on all ranks.
    """
    start_up = process_seconds()
    check_ranks(world, sweep.cases[0].scene)
    options, error, failed = RunOptions(), None, 0
    order: list[int] = []
    with agreed(world):
        _check_options(sweep.cases, options)
        if world.rank == 0:
            check_plots(sweep.plots, sweep.cases)
            check_table(sweep.folder, sweep.cases)
            claim_sweep(sweep.folder, sweep.identity, sweep.cases)
            order, failed = _pending(sweep)
    order, failed = world.bcast((order, failed))
    log.info("%d cases in %s: %d to run%s, %d finished", len(sweep.chosen), sweep.folder, len(order),
             f" ({failed} of them failed before)" if failed else "", len(sweep.chosen) - len(order))
    gc.collect()
    gc.freeze()  # the objects made so far stay, so the collection after each case need not look at them
    for done, number in enumerate(order, 1):
        case, taken, start = sweep.cases[number], "", time.perf_counter()
        with agreed(world):
            if world.rank == 0:
                taken = _taken(sweep.place(case))
        if world.bcast(taken):
            log.info("%d/%d  case %d  %s", done, len(order), number, taken)
            continue
        error = _run_case(world, sweep, case, options)
        if world.rank == 0:
            log.info("%d/%d  case %d  %s: %s, %.2f s", done, len(order), number, case.label,
                     _describe(sweep.place(case), error), time.perf_counter() - start)
        if isinstance(error, InterruptionError):
            log.info("the same command goes on with the sweep from here")
            raise error
    gc.unfreeze()
    options.reset()
    total = process_seconds()
    log.info("start-up %.1f s of %.1f s (%.0f %%)", start_up, total, 100 * start_up / total)
    unwritten = _gather(world, sweep) if len(sweep.chosen) == len(sweep.cases) else None
    if error and len(sweep.chosen) == 1:
        if unwritten:
            log.warning("%s", unwritten)
        raise error
    _judge(world, sweep, unwritten)


def gather_sweep(world: MPI.Comm, sweep: Sweep) -> None:
    """Write the table of all cases and the plots without a run. Raises what `run_sweep` does. Collective."""
    options = RunOptions()
    with agreed(world):
        _check_options(sweep.cases, options)
        if world.rank == 0:
            check_plots(sweep.plots, sweep.cases)
            check_sweep(sweep.folder, sweep.identity)
            check_table(sweep.folder, sweep.cases)
    _judge(world, sweep, _gather(world, sweep))


def _check_options(cases: list[Case], options: RunOptions) -> None:
    """InputError where a varied PETSc option is also given otherwise, which would win. Not collective."""
    for case in cases:
        varied = {key.partition(".")[2]: value for key, value in case.values.items() if key.startswith("petsc.")}
        for name, value in options.overrides(varied | case.values.get("petsc", {})).items():
            raise InputError(f"--vary petsc.{name}: -{name}{'' if value is None else f' {value}'} on the command line "
                             "or in PETSC_OPTIONS would win in every case; leave one of the two away")


def _pending(sweep: Sweep) -> tuple[list[int], int]:
    """Numbers of the chosen cases without results, those that failed last, and how many failed. Raises InputError."""
    fresh: list[int] = []
    failed: list[int] = []
    for case in sweep.chosen:
        outcome = read_outcome(sweep.place(case))
        if not outcome.finished:
            (fresh if outcome.status in ("not run", "interrupted") else failed).append(case.number)
    return [*fresh, *failed], len(failed)


def _taken(place: Path) -> str:
    """What another process has made of a case since this one started, in words; nothing where it is free."""
    if read_outcome(place).finished:
        return "has been finished by another process"
    owner = running(place)
    return f"is left to another process ({owner})" if owner else ""


def _run_case(world: MPI.Comm, sweep: Sweep, case: Case, options: RunOptions) -> DdmpiError | None:
    """Run one case; its error, where all ranks agree on it. Collective.

    Raises OutputError where folder or record of the case cannot be written.
    """
    place, started, error, restart = sweep.place(case), utc(), None, None
    own = world.Dup()  # no message of a failing case may reach the next one
    with contextlib.ExitStack() as stack:
        with agreed(world):
            if world.rank == 0:
                try:
                    place.mkdir(exist_ok=True)
                except OSError as failure:
                    raise OutputError(f"{place}: cannot be made: {failure.strerror}") from None
                record_case(place, case, None, "", started)
                restart = str(place) if os.path.exists(place / CHECKPOINT) else None
            stack.enter_context(diverted(place / "run.log" if world.rank == 0 else None))
        restart = world.bcast(restart)
        options.use(case.scene.petsc)
        try:
            run(own, case.scene, sweep.scene_path, str(place), case.scene.output.figures and sweep.figures, restart)
        except DdmpiError as failure:
            if not failure.agreed:
                raise
            error = failure
            if restart and isinstance(error, InputError) and CHECKPOINT in str(error):
                error.args = (f"{error}; to begin the case anew, remove the checkpoint",)
            traceback.clear_frames(error.__traceback__)  # they hold PETSc's objects
            log.error("ddmpi: %s: %s", error.kind, error)
    gc.collect()  # objects that refer to each other in a circle, such as solvers and their contexts
    free_garbage()
    own.Free()
    with agreed(world):
        if world.rank == 0:
            code, reason = (error.exit_code, str(error).split("\n")[0]) if error else (0, "")
            record_case(place, case, code, reason, started)
    return error


def _describe(place: Path, error: DdmpiError | None) -> str:
    """A case's end in one line."""
    summary = read_outcome(place).summary
    status, message = status_of(error.exit_code if error else 0), str(error).splitlines()[0] if error else ""
    end = message if message.startswith(status) else f"{status}: {message}" if message else status
    if not summary:
        return end
    unused = ", ".join(summary["options_unused"])
    return (f"{end}, {summary['outer_iterations']} outer iterations, n_A = {summary['n_A']}"
            f"{'; PETSc options that nothing used: ' + unused if unused else ''}")


def _gather(world: MPI.Comm, sweep: Sweep) -> OutputError | None:
    """Write table and plots; on rank 0 the error where one of them could not be written. Collective."""
    failure = None
    with agreed(world):
        if world.rank == 0:
            try:
                log.info("table in %s", gather(sweep.folder, sweep.cases))
                for plot in sweep.plots:
                    failure = _draw(sweep, plot) or failure
            except OutputError as error:
                failure = error
    return failure


def _draw(sweep: Sweep, plot: str) -> OutputError | None:
    """Draw a plot if it can be drawn; the error where it could not be written. Not collective."""
    try:
        for path in draw_plots(sweep.folder, [plot]):
            log.info("plot in %s", path)
    except InputError as error:
        log.warning("not drawn: %s", error)
    except OutputError as error:
        return error
    except Exception as error:  # matplotlib raises what it likes
        return OutputError(f"--plot {plot}: could not be drawn ({type(error).__name__}: {error})")
    return None


def _judge(world: MPI.Comm, sweep: Sweep, failure: OutputError | None) -> None:
    """NotConvergedError unless all chosen cases have a certified answer; the `failure` before that. Collective."""
    with agreed(world):
        if world.rank == 0:
            counts = Counter(read_outcome(sweep.place(case)).status for case in sweep.chosen)
            certified = counts.pop("certified", 0)
            rest = ", ".join(f"{number} {status}" for status, number in counts.most_common())
            verdict = (f"{certified} of {len(sweep.chosen)} cases in {sweep.folder} have a certified answer; {rest}"
                       if rest else f"all {certified} cases have a certified answer" if sweep.chosen else
                       f"none of the {len(sweep.cases)} cases falls to this share; nothing to do")
            if failure:
                raise OutputError(f"{failure}; {verdict}")
            if rest:
                raise NotConvergedError(verdict)
            log.info("%s", verdict)
