#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""What the compliance of a contact costs beside a plain factorization: operations, entries, bytes, processor seconds.

A pinched block of 3N × N squares. `plain` is MUMPS's Cholesky factorization in its own order, `own` the same in the
program's order of elimination, `with C` that of [A Bᵀ; B 0] with the compliance C of the contact. Seconds
are of processors, with a solve, the least of --repetitions in turns. Prints a table; one rank, a minute.
"""

import logging
import time
from collections.abc import Callable

import numpy as np
from experiment import ROOT, arguments, table
from mpi4py import MPI
from petsc4py import PETSc

import ddmpi
from ddmpi.body import solver
from ddmpi.petsc.mumps import Factors

COLUMNS = ("N", "dofs", "rows of C", "operations (10⁹): plain", "own", "with C", "inverse of a k × k matrix, 2k³/3",
           "entries (10⁶): plain", "with C", "C read in all products (MB)", "seconds: with C / plain",
           "outer / with C")


def plain(A: PETSc.Mat) -> tuple[float, float]:
    """Operations (10⁹) and entries (10⁶) of the factors in the order that MUMPS chooses, after one solve."""
    A.setOption(PETSc.Mat.Option.SPD, True)
    pc = PETSc.PC().create(A.comm)
    pc.setOperators(A)
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType("mumps")
    pc.setUp()
    factors, (x, b) = pc.getFactorMatrix(), A.createVecs()
    b.set(1.0)
    pc.apply(b, x)
    found = factors.getMumpsRinfog(3) / 1e9, millions(factors.getMumpsInfog(29))
    pc.destroy()
    return found


def millions(entries: int) -> float:
    return -entries if entries < 0 else entries / 1e6  # MUMPS gives large numbers negative, in millions


def timed(work: Callable[[], object], so_far: float) -> float:
    start = time.process_time()
    work()
    return min(so_far, time.process_time() - start)


def measure(N: int, repetitions: int) -> list:
    caught, scene = [], (ROOT / "configs" / "pinched_blocks.toml").read_text(encoding="utf-8")

    class Caught(Factors):
        def __init__(self, *given) -> None:
            caught[:] = given
            super().__init__(*given)

    solver.Factors = Caught
    answer = ddmpi.solve(scene, MPI.COMM_SELF, overrides={f"body.{name}.mesh.divisions": [3 * N, N]
                                                          for name in ("upper", "lower")})
    solver.Factors = Factors
    A, B, order = caught
    (n, _), k, seconds = A.size, B.shape[0], [np.inf, np.inf]
    least = plain(A)
    for _ in range(repetitions):
        seconds = [timed(lambda: Factors(A, B, order).solve(np.ones(n)), seconds[0]),
                   timed(lambda: plain(A), seconds[1])]
    alone, condensed = Factors(A, B[:1], order)._data, Factors(A, B, order)._data  # alone but for one row
    products = answer.summary["n_A"] / 2
    return [N, f"{n:,}", k, f"{least[0]:.2f}", f"{alone.rinfog[2] / 1e9:.2f}", f"{condensed.rinfog[2] / 1e9:.2f}",
            f"{2e-9 * k**3 / 3:.2f}", f"{least[1]:.1f}", f"{millions(condensed.infog[28]):.1f}",
            f"{4e-6 * k**2 * products:.0f}", f"{seconds[0] / seconds[1]:.2f}",
            f"{answer.summary['seconds']['outer'] / 2 / seconds[0]:.2f}"]


def main() -> None:
    parser = arguments(__doc__, "operations")
    parser.add_argument("--sizes", nargs="+", type=int, default=(86, 200, 320), metavar="N")
    parser.add_argument("--repetitions", type=int, default=5)
    options = parser.parse_args()
    logging.getLogger("ddmpi").setLevel(logging.ERROR)
    print("\n".join(table(COLUMNS, [measure(N, options.repetitions) for N in options.sizes])))


if __name__ == "__main__":
    main()
