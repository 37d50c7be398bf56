"""Signals that ask a run to end in good order: SIGTERM and SIGUSR1, as batch systems send them, and Ctrl-C.

The handler only notes the signal. The run checks the note between phases of the set-up, at every multiplication by a
compliance, and at every exchange, which tells the other ranks. Long calls of libraries, such as gmsh, are made in
another process, `apart`, which a signal ends.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import re
import select
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ddmpi.errors import DdmpiError, InterruptionError
from ddmpi.system.logs import encodable

if TYPE_CHECKING:
    import subprocess

SIGNALS = (signal.SIGTERM, signal.SIGUSR1, signal.SIGINT)

_received: list[str] = []

_handlers: dict[int, Callable | signal.Handlers] = {}


def listen() -> None:
    """Note signals from now on, without ending the process. Not collective.

    Call it when the process starts, and again after PETSc's initialisation, which may install its own handler.
    """
    _handle(_note)


def leave() -> None:
    """Let signals end the process from now on, as nothing can be lost. Not collective."""
    _handle(signal.SIG_DFL)


def ignore() -> None:
    """Ignore signals from now on, as results are complete. Not collective."""
    _handle(signal.SIG_IGN)


def _handle(handler: Callable | signal.Handlers) -> None:
    heard = [
        number
        for number in SIGNALS
        if number in _handlers or signal.getsignal(number) != signal.SIG_IGN
    ]
    _handlers.update(
        dict.fromkeys(heard, handler)
    )  # a shell's job in the background ignores Ctrl-C
    listen_again()


def listen_again() -> None:
    """Install our handlers again after a library has installed its own (the PETSc within gmsh). Not collective."""
    for number, handler in _handlers.items():
        signal.signal(number, handler)


def _note(number: int, _frame: object) -> None:
    name = signal.Signals(number).name
    if number == signal.SIGUSR1:
        with contextlib.suppress(
            KeyError, OSError
        ):  # scripts/attend.sh hands others on as SIGUSR1, and says which
            name = Path(os.environ["DDMPI_SIGNAL"]).read_text().strip() or name
    _received.append(name)


def interruption() -> InterruptionError | None:
    """The error of a received signal, or None. Not collective."""
    return InterruptionError(_received[0]) if _received else None


def check() -> None:
    """Raise InterruptionError, on this rank alone, after a signal to it. Not collective."""
    error = interruption()
    if error:
        raise error


PATIENCE = 0.2
"""Seconds between two checks for signals while another process works."""

SILENT = 5.0
"""Seconds of such work before the first message; the next ones follow after twice, four times as many, and so on. Works
shorter than this count together."""

_waited = [0.0]
"""Seconds of such work since the last message."""

OF_RANKS = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "HYDRA_", "MPI_LOCAL")
"""Prefixes of the environment variables by which a launcher tells a process that it is a rank."""


def apart(folder: Path, work: Callable[..., Any], *arguments: Any, doing: str = "") -> Any:
    """The result of `work`, a function of a module, in a new process with current folder and home `folder`. If it takes
    long, the waiting rank prints what it is `doing` on standard error, and the last line of what the process says.

    The process is no rank and must not use MPI. It ends with this one, or with a signal to this one. Not collective.
    Raises InterruptionError, any DdmpiError of `work`, and ChildProcessError, with the way in which the process ended,
    if it did not return from `work`.
    """
    task = folder / "task"
    task.write_bytes(pickle.dumps((work, arguments)))
    with tempfile.TemporaryFile() as said, _other(folder, said.fileno()) as child:
        assert child.stdout
        try:
            begun = seen = time.monotonic()
            silent = SILENT
            while not select.select([child.stdout], [], [], PATIENCE)[0]:
                check()
                seen, before = time.monotonic(), seen
                _waited[0] += seen - before
                if doing and _waited[0] > silent:
                    _tell(said.fileno(), f"{doing}, for {seen - begun:.0f} s so far")
                    _waited[0], silent = 0.0, max(silent, seen - begun)
            returned = child.stdout.read()
            code = child.wait()
        finally:
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)
        check()
        if code or not returned:
            raise ChildProcessError(_end(code, said.fileno()))
    answer = pickle.loads(returned)
    if isinstance(answer, DdmpiError):
        raise answer
    return answer


def _other(folder: Path, said: int) -> subprocess.Popen:
    """A new process that does the task in a folder, and what it says goes to the file `said`."""
    import subprocess

    return subprocess.Popen(
        [sys.executable, "-P", "-c", "from ddmpi.system.interrupt import _serve; _serve()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=said,
        cwd=folder,
        env=_environment(folder),
        process_group=0,
    )


def _end(code: int, said: int) -> str:
    """How a process has ended that had to return something, and the last line in the file of what it has said."""
    os.lseek(said, 0, os.SEEK_SET)
    with os.fdopen(os.dup(said), "rb") as file:
        text = file.read().decode(errors="replace")
    lines = [line for line in text.strip().split("\n") if not line.startswith("Info ")]
    how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    return ": ".join(filter(None, (how, lines[-1] if lines else "")))


def _environment(folder: Path) -> dict[str, str]:
    """The environment of a process that is no rank, with this home and the modules of this process."""
    ours = str(Path(__file__).parents[2])  # may lie in the current folder, which is not on sys.path
    others = {name: value for name, value in os.environ.items() if not name.startswith(OF_RANKS)}
    path = os.pathsep.join(filter(None, [*sys.path, ours]))
    return others | {"HOME": str(folder), "PYTHONPATH": path}


def _tell(said: int, words: str) -> None:
    """Print the words, and the last line in the file of what the other process says."""
    # not by reading on, because the place in the file is the process's, too
    end = os.pread(said, 1000, max(os.fstat(said).st_size - 1000, 0)).strip()
    last = re.split(rb"[\r\n]+", end)[-1].decode(errors="replace").partition(": ")[2].strip()
    line = f"ddmpi: {words}" + f": {last}" * bool(last)
    print(encodable(line, sys.stderr), file=sys.stderr, flush=True)


def _serve() -> None:
    """The other process: do the work, and return its result on the former standard output."""
    back, parent = os.fdopen(os.dup(1), "wb"), os.dup(0)
    os.dup2(2, 1)  # for what libraries print
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # for what they ask
    threading.Thread(
        target=lambda: (os.read(parent, 1), os._exit(1)), daemon=True
    ).start()  # its end ends this one
    work, arguments = pickle.loads(Path("task").read_bytes())
    try:
        answer = work(*arguments)
    except DdmpiError as error:
        answer = error
    pickle.dump(answer, back)
    back.flush()
    os._exit(0)  # nothing that a library would still do
