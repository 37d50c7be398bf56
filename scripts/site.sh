#!/usr/bin/env bash
# Builds the pages of docs/ as a site in site/; a link to nowhere is an error.
#   scripts/site.sh [arguments of mkdocs build]
set -eu
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$ROOT"
"$PYTHON" -P -c "import mkdocs" 2>/dev/null || {
    say "installing mkdocs"
    "$PYTHON" -P -m pip install --quiet --disable-pip-version-check "mkdocs>=1.6" || give_up "install mkdocs for $PYTHON"
}
exec "$PYTHON" -P -m mkdocs build --strict "$@"
