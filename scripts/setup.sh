# Sourced by run.sh and test.sh: brings this machine to a working state and sets
#   PYTHON   an interpreter that imports all that pyproject.toml names
#   MPIRUN   how to start a run on several ranks, and BARE_SIGNALS for scripts/attend.sh
#   and the environment that Open MPI and OpenBLAS want; MPICH wants none.
# It looks, in this order, at DDMPI_PYTHON, at the .venv of an earlier set-up, at the python3 on PATH
# (conda, modules, Spack), and last at Debian's packages, which it installs where it may.
# A set-up that is there costs one file comparison.

ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
VENV=${DDMPI_VENV:-$ROOT/.venv}
STAMP=$VENV/ddmpi-setup
DEBIAN_PACKAGES="python3-venv python3-petsc4py python3-mpi4py python3-h5py python3-h5py-mpi python3-scipy
    python3-matplotlib openmpi-bin libopenblas0-pthread libgl1 libglu1-mesa libxrender1 libxcursor1
    libxft2 libxinerama1 libxfixes3"
MODULES="numpy scipy mpi4py petsc4py h5py gmsh meshio msgspec matplotlib skfem pytest pytest_isolate_mpi"
MODULES+=" mkdocs jsonschema"
CLARABEL="clarabel>=0.11" # not needed, so not among MODULES

say() { printf 'ddmpi set-up: %s\n' "$*" >&2; }
give_up() { say "$*"; exit 1; }

# Does this interpreter really import everything, and is there an mpirun?
complete() {
    command -v mpirun >/dev/null 2>&1 || return 1
    "$1" -P - $MODULES <<'PY' >/dev/null 2>&1
import importlib, sys
assert sys.version_info >= (3, 11)
for name in sys.argv[1:]:
    importlib.import_module(name)
from petsc4py import PETSc  # the library behind the binding
PY
}

# What the set-up depends on: a change of these makes it run again.
wanted() { cat "$ROOT/pyproject.toml" "$ROOT/scripts/setup.sh"; readlink -f /usr/bin/python3; }

ready() {
    wanted | cmp -s - "$STAMP" && { [ -x "$VENV/bin/python" ] || [ -x "$VENV/bin/python.found" ]; }
}

missing_packages() {
    local package
    for package in $DEBIAN_PACKAGES; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q '^install ok installed' || echo "$package"
    done
}

install_packages() {
    local missing root_command=""
    missing=$(missing_packages | tr '\n' ' ')
    [ -z "${missing// /}" ] && return 0
    if [ "$(id -u)" != 0 ]; then
        if sudo -n true 2>/dev/null; then root_command="sudo -n"
        else give_up "these packages are missing and this account may not install them; ask for
    apt-get install --no-install-recommends $missing
or name a Python that has $MODULES in DDMPI_PYTHON (conda-forge has them all)."; fi
    fi
    say "installing Debian packages (about a minute): $missing"
    root_command="$root_command env DEBIAN_FRONTEND=noninteractive"
    # What an interrupted set-up left half-installed is mended first (here, and --fix-broken below).
    $root_command dpkg --configure -a >"$LOG" 2>&1 || true
    $root_command apt-get update -qq >&2 || say "apt-get update failed; going on with the package lists there are"
    $root_command apt-get install -y -qq --no-install-recommends --fix-broken -o DPkg::Lock::Timeout=300 $missing \
        >"$LOG" 2>&1 || { tail -n 20 "$LOG" >&2; give_up "apt-get could not install them (above)"; }
}

make_venv() {
    local site
    say "making $VENV"
    [ ! -e "$VENV" ] || [ -z "$(ls -A "$VENV")" ] || [ -e "$VENV/pyvenv.cfg" ] || [ -e "$VENV/bin/python.found" ] ||
        give_up "$VENV is there, and no virtual environment; name another folder in DDMPI_VENV"
    rm -rf "$VENV"
    /usr/bin/python3 -m venv --system-site-packages "$VENV" || give_up "python3 -m venv failed"
    site=$("$VENV/bin/python" -P -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    # Debian keeps petsc4py inside the PETSc tree. And what `pip install --user` has left in the home
    # directory, a newer numpy say, must not come before Debian's.
    cat >"$site/ddmpi-debian.pth" <<'PTH'
import sys,glob; sys.path += glob.glob("/usr/lib/petscdir/petsc*/*-linux-gnu-real/lib/python3/dist-packages")
import site; site.ENABLE_USER_SITE = False
PTH
    # What Debian brings (MPI, PETSc, HDF5 and the bindings to them) must not come again from PyPI, and
    # nothing may replace the numpy that Debian's bindings were compiled for.
    "$VENV/bin/python" -P - "$ROOT/pyproject.toml" >"$VENV/requirements.txt" <<'PY'
import re, sys, tomllib
project = tomllib.load(open(sys.argv[1], "rb"))["project"]
from_debian = {"mpi4py", "petsc4py", "h5py", "numpy", "scipy", "matplotlib"}
optional = {"clarabel"}
for requirement in project["dependencies"] + project["optional-dependencies"]["test"]:
    if re.match(r"[\w-]+", requirement)[0] not in from_debian | optional:
        print(requirement)
PY
    "$VENV/bin/python" -P -c 'import numpy; print("numpy==" + numpy.__version__)' >"$VENV/constraints.txt"
    "$VENV/bin/python" -P -m pip install --quiet --disable-pip-version-check -r "$VENV/requirements.txt" \
        -c "$VENV/constraints.txt" >"$LOG" 2>&1 ||
        { tail -n 20 "$LOG" >&2; give_up "pip could not install the Python packages (above)"; }
    # Debian has no clarabel, and PyPI no wheel of it for every machine. A run does without.
    "$VENV/bin/python" -P -m pip install --quiet --disable-pip-version-check --only-binary clarabel "$CLARABEL" \
        -c "$VENV/constraints.txt" >"$LOG" 2>&1 ||
        say "pip could not install clarabel: whether loose bodies have an equilibrium is not asked, and tests of it skipped"
    printf '%s\n' "$ROOT" >"$site/ddmpi.pth" # the checkout itself; pip would write into it
}

set_up() {
    local found
    if found=$(command -v python3) && complete "$found"; then
        say "using $found, which has everything; nothing installed"
        mkdir -p "$VENV/bin" && ln -sf "$found" "$VENV/bin/python.found" && wanted >"$STAMP"
        return
    fi
    command -v apt-get >/dev/null 2>&1 || give_up "python3 lacks some of: $MODULES, or mpirun is missing.
Install them with your package manager (conda-forge has them all) and start again, or name a Python in DDMPI_PYTHON."
    LOG=$(mktemp)
    install_packages
    make_venv
    complete "$VENV/bin/python" || { "$VENV/bin/python" -P -c "import ${MODULES// /, }; from petsc4py import PETSc" >&2
        give_up "the set-up ended, but not everything can be imported (above)"; }
    rm -f "$LOG"
    wanted >"$STAMP" # last: an interrupted set-up leaves no stamp and starts anew
    say "done"
}

choose_python() {
    if [ -n "${DDMPI_PYTHON:-}" ]; then
        PYTHON=$DDMPI_PYTHON
        return
    fi
    if ! ready; then
        { mkdir -p "$(dirname "$VENV")" && true >>"$VENV.lock"; } 2>/dev/null ||
            give_up "cannot write $VENV; name a folder of yours in DDMPI_VENV"
        exec 9>"$VENV.lock" # two jobs that start at once set up once
        flock 9
        ready || set_up
        flock -u 9
        exec 9>&-
    fi
    PYTHON=$VENV/bin/python
    [ -x "$VENV/bin/python.found" ] && PYTHON=$(readlink "$VENV/bin/python.found")
    return 0
}

# An empty entry of PYTHONPATH, as after a colon at its end, is the current folder, and so may be anybody's; -P, in all
# these scripts, keeps the current folder out that Python itself would add.
PYTHONPATH=$(sed 's/::*/:/g; s/^://; s/:$//' <<<"${PYTHONPATH:-}")
choose_python
export PYTHON
export PYTHONPATH="$ROOT${PYTHONPATH:+:$PYTHONPATH}"
# Where Python is told to leave no bytecode in the sources, it goes beside the set-up: every start is faster by it.
[ -z "${PYTHONDONTWRITEBYTECODE:-}" ] || { unset PYTHONDONTWRITEBYTECODE; export PYTHONPYCACHEPREFIX="$VENV/bytecode"; }
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
# Two ranks also where there is one core; Open MPI 4 and 5.
export OMPI_MCA_rmaps_base_oversubscribe=1 PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe
# Open MPI 5 by default asks the routing table which addresses reach each other, finds that none reaches a
# rank on the same machine, and says so on stderr, though ranks there talk through memory anyway.
export OMPI_MCA_reachable=${OMPI_MCA_reachable:-weighted}
# Ranks on one node talk through memory; without looking for networks MPI starts in three quarters of the time.
if [ "${SLURM_JOB_NUM_NODES:-1}" = 1 ] && [ -z "${PBS_NODEFILE:-}${LSB_HOSTS:-}${PE_HOSTFILE:-}" ]; then
    export OMPI_MCA_pml=${OMPI_MCA_pml:-ob1}
fi
# Open MPI 4 can leave out its own words on a run that ends with an error; 5 and MPICH have no such option. MPICH's Hydra
# returns 9, say, for a rank that is ended by signal 9, and not 137.
MPIRUN=mpirun BARE_SIGNALS=""
case "$(mpirun --version 2>/dev/null)" in
    *"(Open MPI) 4."*) MPIRUN="mpirun --quiet" ;;
    *HYDRA*) BARE_SIGNALS=yes ;;
esac
export MPIRUN
if [ "$(id -u)" = 0 ]; then # Open MPI (4: OMPI, 5: PRTE) wants this said twice
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    export PRTE_ALLOW_RUN_AS_ROOT=1 PRTE_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi
