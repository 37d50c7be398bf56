"""Faults for every phase of a run on either rank, and the judge of how each ended.

Every run writes a checkpoint after each iteration, beside the results of an earlier run. Whatever happens, it
must end in time, by an exit code other than zero and one message, or else with the right results; what stands
in its folder must be a whole set of results or none, and a checkpoint only if it is whole; and where one must
be there, the run that goes on from it must end with the results of the run that had no fault.

    scripts/study fault_injection [WORDS …]      # all cases, or those whose names have all the words, and a tally
"""

from __future__ import annotations

import collections
import hashlib
import json
import re
import sys
import tempfile
import time
from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import fault
import h5py
import scenes

from ddmpi.results.tables import read_fields

RESULTS = scenes.DATA
TRACES = ("seconds", "hosts", "run", "started", "command", "working_folder", "slurm")
"""What summary.json says of when, where and how fast."""

METHODS = {"newton": {}, "published": {"theta": 0.2, "tolerance": 1e-3}}

# Calls of the outer iteration are within GMRES, some iterations on.
PHASES = {
    # phase: method, target, call
    "mesh": ("newton", "ddmpi.coupling.parts.build_mesh", 1),
    "assemble": ("newton", "ddmpi.coupling.parts.assemble", 1),
    "factor": ("newton", "ddmpi.body.solver.StiffnessSolver.__init__", 1),
    "outer": (
        "newton",
        "ddmpi.body.compliance.Compliance.mult",
        30,
    ),
    "outer, published": ("published", "ddmpi.published.published.Subproblem.neumann", 5),
    "conclude": ("newton", "ddmpi.coupling.member.Member.displacement", 1),
    "output": ("newton", "ddmpi.system.files.put", 1),
}
KEPT = ("outer, published", "conclude", "output")
"""In these a checkpoint must be there; Newton's method keeps nothing within a load step."""

KINDS = {
    # fault: exit codes; None: any but zero, which is the operating system's or mpirun's business
    "RuntimeError": {1},
    "SystemExit": {1},
    "KeyboardInterrupt": {1},
    "SolverError": {4},
    "SIGTERM": {6},
    "SIGUSR1": {6},
    "SIGKILL": None,
    "SIGSEGV": None,
    "full": {5},
    "little room": {5},
    "gone": {5},
}


@dataclass(frozen=True)
class Case:
    """A fault at the call-th call of `target` on `rank`; without a target, a run as the arguments say.

    `codes` are the exit codes that are right (None: any but zero), `whole` says that complete results are
    right too, `kept` that without them a checkpoint must be there, `torn` that the run is killed between the
    appearances of its results, when all may be there but the summary, which says that they are results. `folder`
    names another folder than the case's own.
    """

    name: str
    method: str = "newton"
    rank: int = 0
    target: str = ""
    call: int = 1
    fault: str = ""
    codes: frozenset[int] | None = None
    whole: bool = False
    kept: bool = False
    torn: bool = False
    ranks: int = 2
    folder: str = ""
    more: tuple[str, ...] = ()


def all_cases() -> list[Case]:
    """More than a hundred."""
    cases = []
    for phase, (method, target, call) in PHASES.items():
        for kind, codes in KINDS.items():
            for rank in (0, 1):
                after = phase in KEPT
                # A signal while files are written waits until they are finished.
                over = phase == "output" and kind in (
                    "SIGTERM",
                    "SIGUSR1",
                )
                # Rank 0 is the one that makes files grow.
                harmless = kind in ("full", "little room") and rank == 1
                cases.append(
                    Case(
                        f"{phase}: {kind} on rank {rank}",
                        method,
                        rank,
                        target,
                        call,
                        kind,
                        None if codes is None else frozenset(codes),
                        whole=over or harmless,
                        kept=after and kind != "gone",
                    )
                )
    for rank in (0, 1):

        def numbers(
            name: str,
            target: str,
            call: int,
            kind: str,
            method: str = "newton",
            codes=(3, 4),
            whole=False,
            kept=False,
            rank=rank,
        ) -> None:
            cases.append(
                Case(
                    f"{name} on rank {rank}",
                    method,
                    rank,
                    target,
                    call,
                    kind,
                    frozenset(codes),
                    whole=whole,
                    kept=kept,
                )
            )

        numbers("NaN in the stiffness", "ddmpi.coupling.parts.assemble", 1, "nan")
        numbers("zero pivot", "ddmpi.coupling.parts.assemble", 1, "singular")
        numbers(
            "NaN from the first product",
            "ddmpi.body.compliance.Compliance.mult",
            1,
            "nan",
            whole=True,
        )
        numbers(
            "NaN from a product", "ddmpi.body.compliance.Compliance.mult", 30, "nan", whole=True
        )
        numbers(
            "NaN from a product, published",
            "ddmpi.body.compliance.Compliance.mult",
            40,
            "nan",
            "published",
            whole=True,
        )
        numbers(
            "NaN from a Neumann problem",
            "ddmpi.published.published.Subproblem.neumann",
            5,
            "nan",
            "published",
            whole=True,
        )
        numbers("NaN from a solve", "ddmpi.body.solver.StiffnessSolver._solve", 1, "nan")
        numbers(
            "NaN from the last solve",
            "ddmpi.body.solver.StiffnessSolver._solve",
            2,
            "nan",
            whole=True,
        )
        numbers(
            "NaN in the displacement",
            "ddmpi.coupling.member.Member.displacement",
            1,
            "nan",
            whole=True,
        )
        numbers(
            "an error of PETSc",
            "ddmpi.body.solver.StiffnessSolver._set_up",
            1,
            "PETSc.Error",
            codes=(4,),
        )
    for kind, codes in KINDS.items():  # where files are renamed, on rank 0
        codes = None if codes is None else frozenset(codes)
        signal = kind in ("SIGTERM", "SIGUSR1")
        if kind not in ("full", "little room", "gone"):
            cases.append(
                Case(
                    f"writing a checkpoint: {kind}",
                    "published",
                    target="ddmpi.system.files.os.replace",
                    call=3,
                    fault=kind,
                    codes=codes,
                    kept=True,
                )
            )
        # A summary still fits.
        cases.append(
            Case(
                f"end of output: {kind}",
                target="ddmpi.run.gather.write_summary",
                call=1,
                fault=kind,
                codes=codes,
                kept=kind != "gone",
                whole=signal or kind == "little room",
            )
        )
    cases += [
        Case(
            "publishing: SIGKILL between two files",
            target="ddmpi.system.files.os.rename",
            call=3,
            fault="SIGKILL",
            kept=True,
            torn=True,
        ),
        Case(
            "one rank for two bodies of the published iteration",
            "published",
            ranks=1,
            codes=frozenset({2}),
        ),
        Case("folder below a file", folder="a file/results", codes=frozenset({2})),
        Case("folder with results", folder="earlier", codes=frozenset({2})),
        Case("no checkpoint to go on from", more=("--restart", "nowhere"), codes=frozenset({2})),
    ]
    return cases


def run_in_one_go(
    faults: list[tuple], *arguments: str, cwd: Path | None = None, ranks: int = 2
) -> list[scenes.Run]:
    """The command once for each of the `faults` (see fault.py) that end in an orderly way, all in the same
    processes. The codes of all ranks must be the same.
    """
    everything = scenes.run_python([fault.__file__, json.dumps(faults), *arguments], ranks, cwd=cwd)
    assert everything.code == 0, everything.output
    *stdout, _ = re.split(rf"^{fault.END} .*\n", everything.stdout, flags=re.MULTILINE)
    *stderr, _ = re.split(rf"^{fault.END} .*\n", everything.stderr, flags=re.MULTILINE)
    codes = [
        set(line.split())
        for line in re.findall(rf"^{fault.END} (.*)\n", everything.stderr, re.MULTILINE)
    ]
    assert all(len(each) == 1 for each in codes), f"the ranks ended with {codes}"
    return [
        scenes.Run(int(*code), *said, Path(entry[4]))
        for code, *said, entry in zip(codes, stdout, stderr, faults, strict=True)
    ]


@dataclass
class Outcome:
    """How a case ended; `faults` are in the words of TALLY."""

    case: Case
    code: int | None
    seconds: float
    faults: list[str] = field(default_factory=list)
    output: str = ""


TALLY = (
    "hangs",
    "lost results",
    "half-written results",
    "wrong results",
    "exit code zero",
    "wrong exit code",
    "no message",
    "several messages",
    "earlier results touched",
    "leftovers",
)


class Ground:
    """A folder with the scenes, the results of an earlier run, and those that runs without a fault have.

    Parameters
    ----------
    here : an empty folder
    """

    def __init__(self, here: Path) -> None:
        self.here, self.reference = here, {}
        (here / "a file").write_text("not a folder")
        faults = []
        for name, method in METHODS.items():
            scene = scenes.pinched_blocks(2, **method)
            scene |= {"checkpoint": {"iterations": 1}, "output": {"figures": False}}
            path = scenes.write_scene(scene, here / f"{name}.toml")
            folder = here / ("earlier" if name == "newton" else name)
            faults.append((0, "", 0, "", str(folder), [str(path)]))
        for name, run in zip(METHODS, run_in_one_go(faults, "run"), strict=True):
            assert run.code == 0 and run.files == set(RESULTS), run.output
            self.reference[name] = contents(run.folder)
        self.earlier = digest(here / "earlier")

    def folder_of(self, case: Case) -> Path:
        return self.here / (case.folder or re.sub(r"\W+", "-", case.name))

    def try_case(self, case: Case) -> Outcome:
        """Run a case and judge it, but for the run that goes on from it."""
        folder = self.folder_of(case)
        arguments = ["run", str(self.here / f"{case.method}.toml")]
        if case.target:
            faults = [[case.rank, case.target, case.call, case.fault, str(folder), list(case.more)]]
            command = [fault.__file__, json.dumps(faults), *arguments]
        else:
            command = ["-m", "ddmpi", *arguments, "--output", str(folder), *case.more]
        start = time.monotonic()
        try:
            run = scenes.run_python(command, case.ranks, folder, self.here, quiet=False)
        except AssertionError as late:
            return Outcome(case, None, scenes.LIMIT, ["hangs"], str(late))
        outcome = Outcome(case, run.code, time.monotonic() - start, output=run.output)
        self._judge(outcome, run)
        return outcome

    def try_together(self, cases: list[Case]) -> list[Outcome]:
        """Run cases of Newton's method that end in an orderly way, and judge them as `try_case` does."""
        faults = [
            (
                case.rank,
                case.target,
                case.call,
                case.fault,
                str(self.folder_of(case)),
                [],
            )
            for case in cases
        ]
        runs = run_in_one_go(faults, "run", str(self.here / "newton.toml"), cwd=self.here)
        outcomes = [
            Outcome(case, run.code, 0.0, output=run.output)
            for case, run in zip(cases, runs, strict=True)
        ]
        for outcome, run in zip(outcomes, runs, strict=True):
            self._judge(outcome, run)
        return outcomes

    def _judge(self, outcome: Outcome, run: scenes.Run) -> None:
        case, faults = outcome.case, outcome.faults
        # Where the launcher went on the end is orderly.
        ends = re.search(rf"^{fault.END} (.*)\n", run.stderr, re.MULTILINE)
        codes = {int(code) for code in ends[1].split()} if ends else {run.code}
        code = outcome.code = max(codes, key=abs)
        there = run.files & set(RESULTS) if case.folder != "earlier" else set()
        whole = there == set(RESULTS)
        if len(codes) > 1:
            faults.append("wrong exit code")
        if there and not whole and not (case.torn and "summary.json" not in there):
            faults.append("half-written results")
        if code == 0:
            if not (case.whole and whole):
                faults.append("exit code zero")
            elif contents(run.folder) != self.reference[case.method]:
                faults.append("wrong results")
        else:
            if case.codes is not None and code not in case.codes:
                faults.append("wrong exit code")
            if whole and (not case.whole or run.summary["converged"]):
                faults.append("wrong results")
            if len(messages(run)) != 1:
                faults.append("several messages" if messages(run) else "no message")
        if digest(self.here / "earlier") != self.earlier:
            faults.append("earlier results touched")
        # Rank 0 has no time to clear up then; the next run does it.
        killed = case.codes is None or run.code == 1
        left = {name for name in run.files if not (name in (*RESULTS, "checkpoint.h5") or killed)}
        if left and case.folder != "earlier":
            faults.append("leftovers")

    def go_on(self, outcomes: list[Outcome]) -> None:
        """Go on where a checkpoint must be, in processes that all these cases share, and judge the results."""
        kept = [one for one in outcomes if one.case.kept and one.code not in (0, None)]
        faults = []
        for case in (one.case for one in kept):
            folder = str(self.folder_of(case))
            given = [str(self.here / f"{case.method}.toml"), "--restart", folder]
            faults.append((0, "", 0, "", folder, given))
        try:
            runs = run_in_one_go(faults, "run") if kept else []
        except AssertionError as error:
            runs = [scenes.Run(1, "", str(error), self.folder_of(one.case)) for one in kept]
        for outcome, again in zip(kept, runs, strict=True):
            if again.code != 0 or contents(again.folder) != self.reference[outcome.case.method]:
                outcome.faults.append("lost results")
                outcome.output += "\nand with --restart:\n" + again.output
            elif again.files != RESULTS:
                outcome.faults.append("leftovers")


def messages(run: scenes.Run) -> list[str]:
    """Where a message about the end begins: ours, PETSc's about a deadly signal, or else mpirun's about it."""
    ours = [
        line
        for line in run.output.splitlines()
        if re.match(
            r"ddmpi: (error|internal error|interrupted)|\[\d\]PETSC ERROR: Caught signal", line
        )
    ]
    # These are the words of Open MPI and of MPICH.
    return ours or re.findall(r"noticed that process rank \d|BAD TERMINATION OF ONE", run.output)


def contents(folder: Path, files: Collection[str] = RESULTS) -> dict:
    """All numbers of the results, without what depends on when, where and how long they were computed."""
    if not all((folder / name).exists() for name in files):
        return {}
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    for name in TRACES:
        del summary[name]
    for body in summary["bodies"].values():
        del body["memory_mib"]
    with h5py.File(folder / "result.h5") as file:
        fields = {name: data.tobytes() for name, data in read_fields(file).items()}
    return {
        "summary": summary,
        "fields": fields,
        **{
            name: (folder / name).read_text() for name in set(files) - {"result.h5", "summary.json"}
        },
    }


def digest(folder: Path) -> dict[str, str]:
    """What is in the files of a folder."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.iterdir())
    }


def show(outcomes: list[Outcome]) -> None:
    """The tally, and all about those that ended badly."""
    codes = collections.Counter(outcome.code for outcome in outcomes)
    print(f"\n{len(outcomes)} cases; slowest end {max(o.seconds for o in outcomes):.1f} s")
    print("exit codes: " + ", ".join(f"{code}: {codes[code]}" for code in sorted(codes, key=str)))
    for word in TALLY:
        print(f"{word:26} {sum(word in outcome.faults for outcome in outcomes)}")
    for outcome in outcomes:
        if outcome.faults:
            print(
                f"\n=== {outcome.case.name}: {', '.join(outcome.faults)} (exit code {outcome.code})"
            )
            print(outcome.output)


def main(words: list[str]) -> int:
    """Try the cases whose names have all these words; 1 if one of them ended as it must not."""
    cases = [case for case in all_cases() if all(word in case.name for word in words)]
    if not cases:
        sys.exit("no case has all these words in its name")
    outcomes = []
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        ground = Ground(Path(folder))

        def attempt(case: Case) -> Outcome:
            outcome = ground.try_case(case)
            ground.go_on([outcome])
            print(
                f"{case.name:50} {outcome.code!s:>5} {outcome.seconds:6.1f} s ",
                *outcome.faults,
                flush=True,
            )
            return outcome

        outcomes = list(pool.map(attempt, cases))
    show(outcomes)
    return int(any(outcome.faults for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
