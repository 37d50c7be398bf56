"""The command with a fault: ``mpirun -n 2 python fault.py FAULTS ARGUMENTS``.

FAULTS is a JSON list of [rank, target, call, error, folder, more arguments]: on that rank the call-th
and every later call of the function or method `target`, as in ``ddmpi.problem.assemble``, raises
`error`, the name of a builtin exception or of one in `ddmpi.errors`. The command runs once for each,
with the arguments and ``--output folder``; a line after it names the exit codes of the ranks. The first
run that aborts ends it all.
"""

import builtins
import importlib
import itertools
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager

MESSAGE = "injected by a test"
END = "=== exit codes:"


@contextmanager
def injected(target: str, call: int, error: type[BaseException], here: bool) -> Iterator[None]:
    """Replace the target on all ranks, since to import it starts PETSc, which is collective; it fails `here`."""
    *path, name = target.split(".")
    owner = importlib.import_module(".".join(path[:2]))
    for part in path[2:]:
        owner = getattr(owner, part)
    original, calls = getattr(owner, name), itertools.count(1)

    def faulty(*arguments, **options):
        if here and next(calls) >= call:
            raise error(MESSAGE)
        return original(*arguments, **options)

    setattr(owner, name, faulty)
    yield
    setattr(owner, name, original)


def main() -> None:
    from mpi4py import MPI

    from ddmpi import cli, errors

    world = MPI.COMM_WORLD
    for rank, target, call, name, folder, more in json.loads(sys.argv[1]):
        error = getattr(errors, name, None) or getattr(builtins, name)
        code = None
        with injected(target, call, error, here=world.rank == rank):
            try:
                cli.main([*sys.argv[2:], "--output", folder, *more])
            except SystemExit as end:
                code = end.code
        codes = world.gather(code)
        if world.rank == 0:
            sys.stdout.flush()
            print(END, *codes, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
