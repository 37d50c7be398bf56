"""One run of one peer: a process with a time limit, its seconds from start to end, and its peak memory."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from case import Answer, Case

LAUNCHER = Path(__file__).with_name("launch.py")


@dataclass(frozen=True)
class Peer:
    """A program, or a way to write one.

    Attributes
    ----------
    title : what the tables call it
    scenes : that it can do
    missing : what is not there, or None
    command : from folder and number of processes or threads
    write : its input; not timed
    read : its answer
    processes : whether two means processes, not threads
    """

    title: str
    scenes: Collection[str]
    missing: Callable[[], str | None]
    command: Callable[[Path, int], list[str]]
    read: Callable[[Case, Path], Answer]
    write: Callable[[Case, Path], object] = lambda case, folder: None
    processes: bool = False


@dataclass(frozen=True)
class Result:
    """Seconds, peak memory of the largest process (MiB), and the answer or why there is none."""

    seconds: float
    memory: float
    answer: Answer | None
    failure: str = ""


def measure(peer: Peer, case: Case, folder: Path, count: int, limit: float,
            environment: Mapping[str, str]) -> Result:
    """Run a peer on `count` processes or threads, for at most `limit` seconds."""
    peer.write(case, folder)
    threads = str(1 if peer.processes else count)
    environment = {**environment, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
    command = [sys.executable, "-S", str(LAUNCHER), "found.json", *peer.command(folder, count)]
    with open(folder / "output.txt", "w+", encoding="utf-8", errors="replace") as output:
        child = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, stdout=output,
                                 stderr=subprocess.STDOUT)
        try:
            child.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)  # the session that it leads
            child.wait()
            return Result(limit, math.nan, None, f"more than {limit:.0f} s")
        found = json.loads((folder / "found.json").read_text(encoding="utf-8"))
        seconds, memory = found["seconds"], found["memory"]
        if found["code"]:
            output.seek(0)
            last = [line.strip() for line in output if line.strip()][-1:] or [f"exit code {found['code']}"]
            return Result(seconds, memory, None, last[0][:200].replace("|", "/"))
    try:
        return Result(seconds, memory, peer.read(case, folder))
    except (OSError, ValueError, RuntimeError) as error:
        return Result(seconds, memory, None, str(error)[:200])
