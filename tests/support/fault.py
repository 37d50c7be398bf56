"""The command with a fault: ``mpirun -n 2 python fault.py FAULTS ARGUMENTS``.

FAULTS is a JSON list of [rank, target, call, fault, folder, more arguments]: on that rank the function or
method `target`, as in ``ddmpi.coupling.parts.assemble``, has the `fault` from its call-th call on. A fault is

* the name of an exception, a builtin one, one in `ddmpi.errors` or ``PETSc.Error``: every call raises it;
* the name of a signal, SIGTERM or SIGKILL, say: the process sends it to itself, once;
* ``dead host``, ``cut host``: the host, one of scripts/local_hosts.sh, ends with all on it, or has no network any more;
* ``nan``, ``singular``: every call spoils what it computes;
* ``full``: no file can grow any more, ``little room``: none beyond 6000 bytes, so that it breaks off within one;
  ``gone``: the folder of the results is no longer there; once.

The command runs once for each, with the arguments and ``--output folder``; without a target just so. A line
after it, on stdout and stderr, names the exit codes of the ranks. The first run that aborts ends it all.
"""

import builtins
import importlib
import itertools
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

MESSAGE = "injected by a test"
END = "=== exit codes:"


def exception(fault: str) -> Exception | None:
    from petsc4py import PETSc

    from ddmpi import errors

    if fault == "PETSc.Error":
        return PETSc.Error(77)
    kind = getattr(errors, fault, None) or getattr(builtins, fault, None)
    return kind(MESSAGE) if kind else None


def fill_with_nan(value: object) -> object:
    """Not a number wherever there is one; arrays and PETSc's vectors and matrices in place."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        value[...] = np.nan
    elif isinstance(value, float):
        return float("nan")
    elif isinstance(value, tuple):
        return tuple(fill_with_nan(entry) for entry in value)
    elif hasattr(value, "A") and hasattr(value, "b"):  # ddmpi.body.elasticity.Elasticity
        value.A.scale(float("nan"))
    elif type(value).__name__ == "Vec":
        value.set(float("nan"))
    return value


def make_singular(elasticity: object) -> object:
    """Nothing holds the first degree of freedom."""
    elasticity.A.zeroRowsColumns([0], diag=0.0)
    return elasticity


def act(fault: str, folder: str) -> None:
    """What happens once, before the call."""
    if hasattr(signal, fault):
        os.kill(os.getpid(), getattr(signal, fault))
    elif fault == "dead host":
        os.kill(1, signal.SIGTERM)
        time.sleep(60)
    elif fault == "cut host":
        subprocess.run(["ip", "link", "set", "eth0", "down"], check=True)
    elif fault in ("full", "little room"):
        resource.setrlimit(
            resource.RLIMIT_FSIZE, (0 if fault == "full" else 6000, resource.RLIM_INFINITY)
        )
    elif fault == "gone":
        while os.path.exists(folder):  # the other rank may be writing there
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def injected(target: str, call: int, fault: str, folder: str, here: bool) -> Iterator[None]:
    """Replace the target on all ranks, since to import it starts PETSc, which is collective; it fails `here`."""
    if not target:
        yield
        return
    *path, name = target.split(".")
    owner = importlib.import_module(".".join(path[:3]))
    for part in path[3:]:
        owner = getattr(owner, part)
    original, calls = getattr(owner, name), itertools.count(1)

    def faulty(*arguments, **options):
        number = next(calls) if here else 0
        if number == call:
            act(fault, folder)
        if number < call or not number:
            return original(*arguments, **options)
        error = exception(fault)
        if error:
            raise error
        result = original(*arguments, **options)
        if fault == "nan":
            # Results are the arguments after (self, in), or what is returned.
            outputs = (arguments[2:], result) if result is None else (result,)
            result = [fill_with_nan(value) for value in outputs][-1]
        elif fault == "singular":
            result = make_singular(result)
        return result

    setattr(owner, name, faulty)
    yield
    setattr(owner, name, original)


def main() -> None:
    from mpi4py import MPI

    from ddmpi.cli import main as cli
    from ddmpi.system import interrupt

    world = MPI.COMM_WORLD
    for rank, target, call, fault, folder, more in json.loads(sys.argv[1]):
        code = None
        with injected(target, call, fault, folder, here=world.rank == rank):
            try:
                cli.main([*sys.argv[2:], "--output", folder, *more])
            except SystemExit as end:
                code = end.code
        interrupt._received.clear()
        codes = world.gather(code)
        if world.rank == 0:
            for stream in (sys.stdout, sys.stderr):
                # Lines are written whole, see ddmpi.system.logs.
                stream.write(" ".join([END, *map(str, codes)]) + "\n")
                stream.flush()


if __name__ == "__main__":
    main()
