#!/usr/bin/env bash
# The main job on two ranks: scripts/run.sh [SCENE.toml] [arguments of `ddmpi run` and PETSc options]
# Without a scene: configs/pinched_blocks.toml by the default method. Sets up the machine first where needed.
# The other commands as well: scripts/run.sh sweep SCENE.toml --vary …, scripts/run.sh info; --help names them all.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
. "$ROOT/scripts/attend.sh"
case "${1:-}" in
    run | verify | sweep | sweep-plot | figures | info | -h | --help | --version) ;;
    "" | -*) set -- run "$ROOT/configs/pinched_blocks.toml" "$@" ;;
    *) set -- run "$@" ;;
esac

attend $MPIRUN -n "${DDMPI_RANKS:-2}" "$PYTHON" -m ddmpi "$@"
# A quiet mpirun does not say that a signal has ended a rank (9: out of memory, or kill).
[ "$code" -le 128 ] || echo "ddmpi: error: a rank was ended by signal $((code - 128)) ($(kill -l "$code"))" >&2
exit "$code"
