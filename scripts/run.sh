#!/usr/bin/env bash
# The main job on two ranks: scripts/run.sh [SCENE.toml] [arguments of `ddmpi run` and PETSc options]
# Without a scene: the pinched blocks with Coulomb friction. Sets up the machine first where needed.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
case "${1:-}" in
    "" | -*) set -- "$ROOT/configs/pinched_blocks_coulomb.toml" "$@" ;;
esac
exec $MPIRUN -n "${DDMPI_RANKS:-2}" "$PYTHON" -m ddmpi run "$@"
