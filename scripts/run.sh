#!/usr/bin/env bash
# The main job: scripts/run.sh [SCENE.toml] [arguments of `ddmpi run` and PETSc options]
# Without a scene: configs/pinched_blocks.toml by the default method. Sets up the machine first where needed.
# Starts one rank per body, at most the larger of two and the number of cores; DDMPI_RANKS=R says otherwise.
# The other commands as well: scripts/run.sh sweep SCENE.toml --vary …, scripts/run.sh info; --help names them all.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
. "$ROOT/scripts/attend.sh"

# One rank per [[body]] line of the scene, the first of the arguments that is a file with such lines; without them two.
choose_ranks() {
    local argument bodies=2 found most
    for argument in "$@"; do
        if [ -f "$argument" ] && found=$(grep -sc '^[[:blank:]]*\[\[[[:blank:]]*body[[:blank:]]*\]\]' -- "$argument"); then
            bodies=$found
            break
        fi
    done
    most=$(env -u OMP_NUM_THREADS -u OMP_THREAD_LIMIT nproc 2>/dev/null || echo 2) # nproc would obey these
    [ "$most" -ge 2 ] || most=2
    echo $((bodies < most ? bodies : most))
}

case "${1:-}" in
    run | converge | check | limit | sweep | sweep-plot | figures | path | report | view | import | info | schema | -h | --help | --version) ;;
    "" | -*) set -- run "$ROOT/configs/pinched_blocks.toml" "$@" ;;
    *) set -- run "$@" ;;
esac

attend $MPIRUN -n "${DDMPI_RANKS:-$(choose_ranks "$@")}" "$PYTHON" -P -m ddmpi "$@"
explain
exit "$code"
