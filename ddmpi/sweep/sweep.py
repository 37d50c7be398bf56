"""Run the cases of a sweep one after another in one set of processes, and gather what came out.

Each case has a folder of its own, written by whoever runs it; a failing case is recorded and the next
one starts. What a dying process leaves behind is the complete results of the cases before; started
again, the sweep goes on with those that are missing, the ones that failed before last. A case that was
interrupted continues from its checkpoint.
"""

from __future__ import annotations

import contextlib
import gc
import itertools
import logging
import os
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

from ddmpi.coupling.ranks import check_ranks
from ddmpi.errors import DdmpiError, HeldError, InputError, InterruptionError, NotConvergedError, OutputError
from ddmpi.petsc.options import RunOptions
from ddmpi.petsc.versions import free_garbage
from ddmpi.run.run import run
from ddmpi.sweep.cases import Case
from ddmpi.sweep.plots import check_plots, draw_plots
from ddmpi.sweep.table import (
    Outcome,
    case_identity,
    check_table,
    foreign,
    gather,
    read_outcome,
    record_case,
    refuse_others,
    status_of,
)
from ddmpi.system import interrupt
from ddmpi.system.agreement import agreed
from ddmpi.system.files import CHECKPOINT, is_locked
from ddmpi.system.logs import diverted, utc
from ddmpi.system.provenance import process_seconds, whereabouts

log = logging.getLogger("ddmpi")


@dataclass(frozen=True)
class Sweep:
    """What was asked for.

    Attributes
    ----------
    scene_path : the scene's file
    folder : of the sweep, with a folder for each case in it
    cases : all of them
    chosen : those to run now
    petsc : PETSc options of the command line
    figures : whether every case gets its pictures
    plots : RESULT:KEY, pictures of the gathered table
    """

    scene_path: str
    folder: Path
    cases: list[Case]
    chosen: list[Case]
    petsc: list[str] = field(default_factory=list)
    figures: bool = False
    plots: list[str] = field(default_factory=list)

    def place(self, case: Case) -> Path:
        """The folder of a case."""
        return self.folder / case.folder

    def identity(self, case: Case) -> dict:
        return case_identity(case, self.petsc, Path(self.scene_path).parent)


def list_cases(sweep: Sweep) -> None:
    """Print number, status and settings of the chosen cases. Not collective. Raises InputError as `run_sweep` would."""
    _check_options(sweep.cases, RunOptions())
    for case in sweep.chosen:
        outcome = read_outcome(sweep.place(case))
        status = "another sweep" if foreign(outcome, sweep.identity(case)) else outcome.status
        print(f"{case.number:5d}  {status:13}  {case.label}")
    if not sweep.chosen:
        print(_no_case(sweep))


def run_sweep(world: MPI.Comm, sweep: Sweep) -> None:
    """Run the chosen cases that are not finished; gather the table where all were chosen. Collective.

    Raises
    ------
    InputError
        before any work: cases of another sweep in the folder or its table, a wrong number of ranks, an impossible
        plot, varied PETSc options that are also given; later, when another sweep comes into the folder meanwhile
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
    fresh: list[int] = []
    tried: list[int] = []
    options, error = RunOptions(), None
    with agreed(world):
        _check_options(sweep.cases, options)
        if world.rank == 0:
            check_plots(sweep.plots, sweep.cases)
            fresh, tried = _pending(sweep)
    fresh, tried = world.bcast((fresh, tried))
    log.info("%d cases in %s: %d to run%s, %d finished", len(sweep.chosen), sweep.folder, len(fresh) + len(tried),
             f" ({len(tried)} of them failed before)" if tried else "", len(sweep.chosen) - len(fresh) - len(tried))
    gc.collect()
    gc.freeze()  # what is there now stays; so that the collection after each case is quick
    by_number = {case.number: case for case in sweep.chosen}
    order, held, done = [*fresh, *tried], [], 0
    for turn, number in enumerate(itertools.chain(order, held)):  # `held` grows meanwhile
        case = by_number[number]
        with agreed(world):
            state = _look(sweep, case, wait=turn >= len(order)) if world.rank == 0 else ""
        state = world.bcast(state)
        start = time.perf_counter()
        failure = None if state else _run_case(world, sweep, case, options)
        if state == "held" or isinstance(failure, HeldError):
            log.info("case %d is being run by another process; it comes last", number)
            held.append(number)
            continue
        done += 1
        if state == "finished":
            log.info("case %d has been finished by another process meanwhile", number)
            continue
        error = failure
        if world.rank == 0:
            log.info("%d/%d  case %d  %s: %s, %.2f s", done, len(order), number, case.label,
                     _describe(sweep, case, error), time.perf_counter() - start)
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


def _look(sweep: Sweep, case: Case, wait: bool) -> str:
    """Whether another process has "finished" the case or has it "held", or else ""; after its end, with `wait`.

    Raises InputError where it is a case of another sweep, the InterruptionError that is due. Not collective.
    """
    while (held := is_locked(sweep.place(case))) and wait:
        interrupt.check()
        time.sleep(0.2)
    finished = _outcome(sweep, case).finished
    return "held" if held else "finished" if finished else ""


def gather_sweep(world: MPI.Comm, sweep: Sweep) -> None:
    """Write the table of all cases and the plots without a run. Raises what `run_sweep` does. Collective."""
    options = RunOptions()
    with agreed(world):
        _check_options(sweep.cases, options)
        if world.rank == 0:
            check_plots(sweep.plots, sweep.cases)
            try:
                os.scandir(sweep.folder).close()
            except OSError as error:
                raise InputError(f"--output {sweep.folder}: nothing to gather there: {error.strerror}") from None
            check_table(sweep.folder, sweep.cases)
    _judge(world, sweep, _gather(world, sweep))


def _gather(world: MPI.Comm, sweep: Sweep) -> OutputError | None:
    """Write table and plots; why they could not all be written, on rank 0.

    Raises InputError, on all ranks, where a case is one of another sweep. Collective.
    """
    with agreed(world):
        if world.rank == 0:
            for case in sweep.cases:
                what = foreign(read_outcome(sweep.place(case)), sweep.identity(case))
                if what:
                    raise InputError(f"{sweep.place(case)}: {what}")
            try:
                table, _ = gather(sweep.folder, sweep.cases)
            except OutputError as error:
                return error
            log.info("table in %s", table)
            return _draw(sweep)
    return None


def _draw(sweep: Sweep) -> OutputError | None:
    """Draw the plots that can be drawn; why one could not be written. Not collective."""
    failure = None
    for plot in sweep.plots:
        try:
            for path in draw_plots(sweep.folder, [plot]):
                log.info("plot in %s", path)
        except InputError as error:
            log.warning("not drawn: %s", error)
        except OutputError as error:
            failure = failure or error
        except Exception as error:  # matplotlib raises what it likes
            failure = failure or OutputError(f"--plot {plot}: could not be drawn ({type(error).__name__}: {error})")
    return failure


def _check_options(cases: list[Case], options: RunOptions) -> None:
    """InputError where a varied PETSc option is given otherwise, too, which would win. Not collective."""
    for case in cases:
        varied: dict = {}
        for key, value in case.values.items():
            table, _, name = key.strip().partition(".")
            if table == "petsc":
                varied |= {name: value} if name else value
        winning = options.overrides(varied)
        if winning:
            name, value = next(iter(winning.items()))
            raise InputError(f"--vary petsc.{name}: -{name}{'' if value is None else f' {value}'} on the command line "
                             "or in PETSC_OPTIONS would win in every case; leave one of the two away")


def _pending(sweep: Sweep) -> tuple[list[int], list[int]]:
    """Numbers of the chosen cases that were never tried or were interrupted, and of those that failed."""
    try:
        sweep.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--output {sweep.folder}: cannot be made: {error.strerror}") from None
    check_table(sweep.folder, sweep.cases)
    fresh, tried = [], []
    for case in sweep.chosen:
        outcome = _outcome(sweep, case)
        if not outcome.finished:
            (fresh if outcome.status in ("not run", "interrupted") else tried).append(case.number)
    return fresh, tried


def _outcome(sweep: Sweep, case: Case) -> Outcome:
    """How the case ended so far; InputError where what is there is not of this sweep. Not collective."""
    outcome = read_outcome(sweep.place(case))
    refuse_others(sweep.place(case), outcome, sweep.identity(case))
    return outcome


def _run_case(world: MPI.Comm, sweep: Sweep, case: Case, options: RunOptions) -> DdmpiError | None:
    """Run one case; its error, where all ranks agree on it. Collective.

    Raises OutputError where the record of the case cannot be written, InputError where another sweep has come first:
    then there is no use in going on.
    """
    place, started, error = sweep.place(case), utc(), None
    own = world.Dup()  # no message of a failing case may reach the next one
    with contextlib.ExitStack() as stack:
        with agreed(world):
            if world.rank == 0:
                _record(place, case, sweep, None, "", started)
            stack.enter_context(diverted(place / "run.log" if world.rank == 0 else None))
        restart = world.bcast(str(place) if world.rank == 0 and os.path.exists(place / CHECKPOINT) else None)
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
    if isinstance(error, OutputError) and world.bcast(world.rank == 0 and _done_by_another(sweep, case)):
        error = None
        if world.rank == 0:
            (place / CHECKPOINT).unlink(missing_ok=True)  # ours, which has become useless
    gc.collect()  # what refers to itself in a circle, such as solvers and their contexts
    free_garbage()
    own.Free()
    if isinstance(error, HeldError):
        return error  # the record is the other's
    with agreed(world):
        if world.rank == 0:
            code, reason = (error.exit_code, str(error).split("\n")[0]) if error else (0, "")
            _record(place, case, sweep, code, reason, started)
    return error


def _done_by_another(sweep: Sweep, case: Case) -> bool:
    """Whether another process of this sweep has put certified results there, while this one was at the same case."""
    outcome = read_outcome(sweep.place(case))
    return (outcome.status == "certified" and not foreign(outcome, sweep.identity(case))
            and not outcome.summary["run"].endswith(f" {whereabouts()}"))


def _record(place: Path, case: Case, sweep: Sweep, code: int | None, reason: str, started: str) -> None:
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{place}: cannot be made: {error.strerror}") from None
    record_case(place, case, sweep.identity(case), code, reason, started)


def _describe(sweep: Sweep, case: Case, error: DdmpiError | None) -> str:
    """A case's end in one line."""
    summary = read_outcome(sweep.place(case)).summary
    status, told = status_of(error.exit_code if error else 0), str(error).splitlines()[0] if error else ""
    said = told if told.startswith(status) else f"{status}: {told}" if told else status
    if not summary:
        return said
    unused = ", ".join(summary["options_unused"])
    return (f"{said}, {summary['outer_iterations']} outer iterations, n_A = {summary['n_A']}"
            f"{'; PETSc options that nothing used: ' + unused if unused else ''}")


def _judge(world: MPI.Comm, sweep: Sweep, failure: OutputError | None) -> None:
    """NotConvergedError unless all chosen cases have a certified answer; the `failure` before that. Collective."""
    with agreed(world):
        if world.rank == 0:
            counts = Counter(read_outcome(sweep.place(case)).status for case in sweep.chosen)
            certified = counts.pop("certified", 0)
            rest = ", ".join(f"{number} {status}" for status, number in counts.most_common())
            verdict = (f"{certified} of {len(sweep.chosen)} cases in {sweep.folder} have a certified answer; {rest}"
                       if rest else _no_case(sweep) or f"all {certified} cases have a certified answer")
            if failure:
                raise OutputError(f"{failure}; {verdict}")
            if rest:
                raise NotConvergedError(verdict)
            log.info("%s", verdict)


def _no_case(sweep: Sweep) -> str:
    """That nothing was to be done, if so."""
    return "" if sweep.chosen else f"none of the {len(sweep.cases)} cases falls to this share; nothing to do"
