#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""What the compliance of a contact costs beside a plain factorization: operations, entries, bytes, processor seconds.

A pinched block of 3N × N squares. `alone` is MUMPS's Cholesky factorization in the program's order of elimination and a
solve, `with C` the same of [A Bᵀ; B 0] with the compliance C of the contact. Both are called in the same way, in turns;
seconds are the least of --repetitions. Products are those of a run of two such blocks with the C of one of them, of
which each reads a triangle. Prints a table; one rank, a minute.
"""

import logging
import time

import numpy as np
from experiment import ROOT, arguments, table
from mpi4py import MPI

import ddmpi
from ddmpi.body import solver
from ddmpi.petsc.mumps import Factors

COLUMNS = ("N", "dofs", "k, rows of C", "operations (10⁹): alone", "with C", "2k³/3", "entries (10⁶): alone", "with C",
           "seconds: with C / alone", "products", "of C read by them (MB)")


def count(*given) -> tuple[float, float, float]:
    """Operations (10⁹), entries (10⁶) and processor seconds of factors and a solve."""
    start = time.process_time()
    factors = Factors(*given)
    factors.solve(np.ones(given[0].size[0]))
    spent, data = time.process_time() - start, factors._data
    entries = data.infog[28] if data.infog[28] > 0 else -1e6 * data.infog[28]  # MUMPS gives large ones in millions
    operations = data.rinfog[2]
    factors.destroy()
    return operations / 1e9, entries / 1e6, spent


def measure(N: int, repetitions: int) -> list:
    caught, scene = [], (ROOT / "configs" / "pinched_blocks.toml").read_text(encoding="utf-8")

    class Caught(Factors):
        def __init__(self, *given) -> None:
            caught[:] = given
            super().__init__(*given)

    solver.Factors = Caught
    summary = ddmpi.solve(scene, MPI.COMM_SELF, overrides={f"body.{name}.mesh.divisions": [3 * N, N]
                                                           for name in ("upper", "lower")}).summary
    solver.Factors = Factors
    A, B, order = caught
    k, runs = B.shape[0], [(count(A, B[:1], order), count(A, B, order)) for _ in range(repetitions)]  # 1 row: alone
    alone, condensed = (min(each, key=lambda run: run[2]) for each in zip(*runs, strict=True))
    products = summary["n_A"] // 2
    return [N, f"{A.size[0]:,}", k, f"{alone[0]:.2f}", f"{condensed[0]:.2f}", f"{2e-9 * k**3 / 3:.2f}",
            f"{alone[1]:.1f}", f"{condensed[1]:.1f}", f"{condensed[2] / alone[2]:.2f}", products,
            f"{4e-6 * k**2 * products:.0f}"]


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--sizes", nargs="+", type=int, default=(86, 200, 320), metavar="N")
    parser.add_argument("--repetitions", type=int, default=5)
    options = parser.parse_args()
    logging.getLogger("ddmpi").setLevel(logging.ERROR)
    print("\n".join(table(COLUMNS, [measure(N, options.repetitions) for N in options.sizes])))


if __name__ == "__main__":
    main()
