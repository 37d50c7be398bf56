#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""What the compliance of a contact costs beside a plain factorization: operations, processor seconds, bytes.

A pinched block of 3N × N squares. `alone` is MUMPS's Cholesky factorization in the program's order of elimination and a
solve, `with C` the same of [A Bᵀ; B 0] with the compliance C of the contact. Both are called in the same way, in turns;
seconds are the least of five. Products are those of a run of two such blocks with the C of one of them, of
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


def count(*given) -> tuple[float, float]:
    """Operations (10⁹) and processor seconds of factors and a solve."""
    start, factors = time.process_time(), Factors(*given)
    factors.solve(np.ones(given[0].size[0]))
    return factors._data.rinfog[2] / 1e9, time.process_time() - start


def measure(N: int) -> list:
    caught, scene = [], (ROOT / "configs" / "pinched_blocks.toml").read_text(encoding="utf-8")
    solver.Factors = lambda *given: caught.append(given) or Factors(*given)
    summary = ddmpi.solve(scene, MPI.COMM_SELF, overrides={f"body.{name}.mesh.divisions": [3 * N, N]
                                                           for name in ("upper", "lower")}).summary
    solver.Factors = Factors
    A, B, order = caught[0]
    k, runs = B.shape[0], [(count(A, B[:1], order), count(A, B, order)) for _ in range(5)]  # 1 row: alone
    alone, condensed = (min(each, key=lambda run: run[1]) for each in zip(*runs, strict=True))
    products = summary["n_A"] // 2
    return [N, k, f"{alone[0]:.2f}", f"{condensed[0]:.2f}", f"{condensed[1] / alone[1]:.2f}", products,
            f"{4e-6 * k**2 * products:.0f}"]


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--sizes", nargs="+", type=int, default=(86, 200, 320), metavar="N")
    options = parser.parse_args()
    logging.getLogger("ddmpi").setLevel(logging.ERROR)
    print("\n".join(table(("N", "k, rows of C", "operations (10⁹): alone", "with C", "seconds: with C / alone",
                           "products", "of C read by them (MB)"), map(measure, options.sizes))))


if __name__ == "__main__":
    main()
