#!/usr/bin/env bash
"exec" "bash" "-c" '. "${0%/*}/setup.sh"; exec "$PYTHON" "$0" "$@"' "$0" "$@"  # to Python, a string

__doc__ = """The published iteration beyond two bodies: where its linear part converges.

Where all nodes stick, an iteration takes θ/2 · C S e from the error e of the interfaces' displacements. C and S are
sums over the bodies: of their contact compliances C_a, and of the inverses of these. Prints for stacks of K clamped
blocks the ends of the spectrum of C S / 4, the θ at which the iteration ceases to converge, and its best rate: as it
is, and with three displacements of each interface, two translations and a rotation, solved for exactly each time.
"""

import argparse
import sys

import numpy as np
from experiment import ROOT, table
from mpi4py import MPI
from named_assemblies import stack

from ddmpi.coupling.assembly import Assembly

sys.path.insert(0, str(ROOT / "tests"))

from scenes import prepare_scene


def operators(assembly: Assembly) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """C, S and the displacements Z (size, 3 per interface) that a coarse problem takes."""
    space = assembly.space
    C, S, columns = np.zeros((space.size, space.size)), np.zeros((space.size, space.size)), []
    for body in assembly.bodies:
        own, member = body.member.dense(), body.member
        at = np.concatenate([np.arange(space.size)[space.parts[name]] for name in member.parts])
        C[np.ix_(at, at)] += own
        S[np.ix_(at, at)] += np.linalg.inv(own)
    for interface, part in space.each():
        along = np.linalg.norm(interface.xy - interface.xy[0], axis=1)
        Z = np.zeros((space.size, 3))
        Z[part.start:part.start + interface.m, :2] = np.stack([np.ones(interface.m), along], axis=1)
        Z[part.start + interface.m:part.stop, 2] = 1.0
        columns.append(Z)
    return C, S, np.hstack(columns)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", nargs="+", type=int, default=[2, 3, 4, 6, 10], metavar="K")
    parser.add_argument("--divisions", type=int, default=6, metavar="N")
    options = parser.parse_args()
    rows = []
    for K in options.bodies:
        C, S, Z = operators(prepare_scene(MPI.COMM_SELF, stack(K, True, options.divisions)))
        P = np.eye(len(C)) - Z @ np.linalg.solve(Z.T @ S @ Z, Z.T @ S)
        for what, T in (("none", C @ S / 4), ("3 displacements", P @ C @ S / 4)):
            found = np.sort(np.linalg.eigvals(T).real)
            low, high = found[0 if what == "none" else Z.shape[1]], found[-1]
            rows.append([K, what, f"{low:.2f}", f"{high:.1f}", f"{1 / high:.3f}", f"{(high - low) / (high + low):.3f}"])
    print("\n".join(table(["bodies", "coarse correction", "smallest", "largest", "θ below", "best rate"], rows)))


if __name__ == "__main__":
    main()
