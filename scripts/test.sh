#!/usr/bin/env bash
# All tests: scripts/test.sh [pytest arguments]. Sets up the machine first where needed.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$ROOT"
export MPLBACKEND=agg
"$PYTHON" -m ruff check .
exec "$PYTHON" -m pytest "$@"
