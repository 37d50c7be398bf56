#!/usr/bin/env bash
# All tests: scripts/test.sh [pytest arguments]. Sets up the machine first where needed.
# The tests of the batch scripts (-m slurm) want Debian's Slurm: it is installed when they are among those asked for and
# that can be done here. Where it cannot, these tests are skipped, and say so.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$ROOT"

install_slurm() {
    PATH=$PATH:/usr/sbin:/sbin command -v slurmctld >/dev/null && return
    case "$("$PYTHON" -P -m pytest --collect-only "$@" 2>&1)" in *test_slurm.py*) ;; *) return ;; esac
    if ! command -v apt-get >/dev/null; then
        say "there is no Slurm here and no apt-get to install it; the tests of the batch scripts will be skipped"
        return
    fi
    # RUNLEVEL: the packages' own daemons shall not start; the tests start theirs.
    (DEBIAN_PACKAGES="slurm-wlm munge libpmix-dev" LOG=$(mktemp) && export RUNLEVEL=1 && install_packages) ||
        say "Slurm could not be installed (above); the tests of the batch scripts will be skipped"
}

export MPLBACKEND=agg
install_slurm "$@"
exec "$PYTHON" -P -m pytest "$@"
