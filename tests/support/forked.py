"""In place of new processes that do a task apart, children of one that has imported already what they need: a drawing is
meshed in a tenth of the time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path

from ddmpi.system import interrupt

CONTEXT = multiprocessing.get_context("forkserver")
# The folder of the server's socket goes with the others of this run, which ranks and workers that end at once leave behind;
# it is none that the first test to start the server may have set.
multiprocessing.current_process()._config["tempdir"] = tempfile.mkdtemp(
    prefix="forked-", dir=os.environ.get("PYTEST_DEBUG_TEMPROOT")
)
CONTEXT.set_forkserver_preload(
    ["gmsh", "h5py", "meshio", "ddmpi.mesh.geometry", "ddmpi.system.hdf5"]
)


class Forked:
    """As much of `subprocess.Popen` as `interrupt.apart` wants of `interrupt._other`."""

    def __init__(self, folder: Path, said: int) -> None:
        theirs, self._alive = CONTEXT.Pipe(duplex=False)
        result, back = CONTEXT.Pipe(duplex=False)
        words = Connection(os.dup(said), readable=False)
        environment = interrupt._environment(folder)
        self._process = CONTEXT.Process(
            target=_begin, args=(theirs, back, words, folder, environment)
        )
        self._process.start()
        for end in (theirs, back, words):
            end.close()
        self.pid = self._process.pid
        self.stdout = os.fdopen(os.dup(result.fileno()), "rb")
        result.close()

    def __enter__(self) -> Forked:
        return self

    def __exit__(self, *_: object) -> None:
        self._alive.close()
        self.stdout.close()
        self._process.join()
        self._process.close()

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self) -> int | None:
        self._process.join()
        return self._process.exitcode


def _begin(
    alive: Connection, back: Connection, words: Connection, folder: Path, environment: dict
) -> None:
    """Become what `interrupt._other` starts, and do the task."""
    os.setpgid(0, 0)
    for number in interrupt.SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    for end, number in ((alive, 0), (back, 1), (words, 2)):
        os.dup2(end.fileno(), number)
        end.close()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    if "DDMPI_REACHED" in environment:
        from reached import write_apart

        write_apart(interrupt._serve)
    else:
        interrupt._serve()
