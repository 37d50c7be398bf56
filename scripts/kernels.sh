#!/usr/bin/env bash
# Tests with OpenBLAS's kernels for several processors, one after the other: scripts/kernels.sh [pytest arguments]
# Without arguments: the tests of the rooms that compute. KERNELS names other kernels (words of OPENBLAS_CORETYPE). One
# that this processor cannot run is left out. At the end a line for each kernel; exit code 1 where a test has failed.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$ROOT"
[ $# -gt 0 ] || set -- tests/body tests/interface tests/judge tests/methods tests/published
export MPLBACKEND=agg
code=0 summary=""
for OPENBLAS_CORETYPE in ${KERNELS:-SkylakeX Haswell Zen Sandybridge}; do
    export OPENBLAS_CORETYPE
    said="not run: this OpenBLAS does not use it here"
    if OPENBLAS_VERBOSE=2 "$PYTHON" -P -c "import numpy.linalg" 2>&1 | grep -qx "Core: $OPENBLAS_CORETYPE"; then
        printf '\n%s\n' "OPENBLAS_CORETYPE=$OPENBLAS_CORETYPE"
        log=$(mktemp)
        "$PYTHON" -P -m pytest "$@" | tee "$log" || code=1
        said=$(tail -n 1 "$log")
        rm "$log"
    fi
    summary+=$(printf '%-12s %s' "$OPENBLAS_CORETYPE" "$said")$'\n'
done
printf '\n%s' "$summary"
exit "$code"
