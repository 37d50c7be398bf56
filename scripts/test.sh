#!/usr/bin/env bash
# All tests: scripts/test.sh [pytest arguments]. Sets up the machine first where needed.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$ROOT"
export OMPI_MCA_rmaps_base_oversubscribe=1 PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe MPLBACKEND=agg
"$PYTHON" -m ruff check .
exec "$PYTHON" -m pytest "$@"
