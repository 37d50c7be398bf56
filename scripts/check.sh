#!/usr/bin/env bash
# The developers' checks, ruff and mypy, on one set of versions: the extra "dev" of pyproject.toml in a venv of its own,
# .venv-dev. With other versions they find other faults. scripts/test.sh needs neither.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$ROOT"
if ! cmp -s pyproject.toml .venv-dev/pyproject.toml; then
    say "making .venv-dev"
    rm -rf .venv-dev
    "$PYTHON" -P -m venv .venv-dev
    "$PYTHON" -P -c 'import tomllib
print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["dev"], sep="\n")' |
        .venv-dev/bin/python -P -m pip install --quiet --disable-pip-version-check -r /dev/stdin
    cp pyproject.toml .venv-dev/ # last: an interrupted set-up starts anew
fi
.venv-dev/bin/python -P -m ruff check .
.venv-dev/bin/python -P -m ruff format --check --diff .
PYTHONPATH="" .venv-dev/bin/python -P -m mypy
