#!/usr/bin/env bash
# The main job on two ranks: scripts/run.sh [SCENE.toml] [arguments of `ddmpi run` and PETSc options]
# Without a scene: the pinched blocks with Coulomb friction. Sets up the machine first where needed.
# The other commands as well: scripts/run.sh sweep SCENE.toml --vary …, scripts/run.sh info
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
case "${1:-}" in
    run | verify | sweep | sweep-plot | figures | info) ;;
    "" | -*) set -- run "$ROOT/configs/pinched_blocks_coulomb.toml" "$@" ;;
    *) set -- run "$@" ;;
esac

# Signals are passed on, and where one has ended a rank (9: out of memory, or kill) it is said: a quiet mpirun does not.
$MPIRUN -n "${DDMPI_RANKS:-2}" "$PYTHON" -m ddmpi "$@" <&0 &
child=$!
for signal in TERM INT USR1; do trap "kill -$signal $child 2>/dev/null" "$signal"; done
code=128
while [ "$code" -ge 128 ] && kill -0 "$child" 2>/dev/null; do code=0; wait "$child" || code=$?; done
[ "$code" -le 128 ] || echo "ddmpi: error: a rank was ended by signal $((code - 128)) ($(kill -l "$code"))" >&2
exit "$code"
