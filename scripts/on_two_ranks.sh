#!/usr/bin/env bash
# A Python script on two ranks: scripts/on_two_ranks.sh SCRIPT.py [its arguments]
# Sets up the machine first where needed. The scripts beside this one start it by themselves.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
exec $MPIRUN -n 2 "$PYTHON" -m mpi4py "$@"
