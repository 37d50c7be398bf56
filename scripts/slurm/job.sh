# Sourced by the batch scripts of this folder, in a job that Slurm has started:
#   launch ARGUMENTS   how a Python program starts on the job's ranks: by mpirun, or by srun with DDMPI_LAUNCH=srun
#   requeue_or_exit    puts the job back into the queue where it was the time that ran out
# Environment: DDMPI_LAUNCH (mpirun), DDMPI_MPI (pmix, for srun), DDMPI_REQUEUES (50, most times a job goes back),
# DDMPI_RANKS (the job's tasks, as after sbatch --ntasks).

. "$ROOT/scripts/setup.sh"
. "$(dirname "${BASH_SOURCE[0]}")/../attend.sh"
cd "$SLURM_SUBMIT_DIR"
echo "job $SLURM_JOB_ID on $SLURM_JOB_NODELIST, start number $((${SLURM_RESTART_COUNT:-0} + 1)), $(date -u +%FT%TZ)"

# SIGUSR1 announces the end of the time limit (#SBATCH --signal), SIGTERM that the job is cancelled or preempted.
launch() {
    local ranks=${DDMPI_RANKS:-${SLURM_NTASKS:-2}}
    saved=$(checkpoint)
    case "${DDMPI_LAUNCH:-mpirun}" in
        mpirun) attend $MPIRUN -n "$ranks" "$PYTHON" -P "$@" ;;
        srun) attend srun --mpi="${DDMPI_MPI:-pmix}" -n "$ranks" "$PYTHON" -P "$@" ;;
        *) echo "DDMPI_LAUNCH is mpirun or srun, not $DDMPI_LAUNCH" >&2; exit 2 ;;
    esac
}

# The number of the file with the checkpoint of a run into `output`; another one is written to another file.
checkpoint() { ls -i "${output:-/nowhere}/checkpoint.h5" 2>/dev/null || true; }

# Exit code 6 says: interrupted, to be continued; so is what the signal itself has ended, before Python could listen to
# it, unless `output`, where it is set, holds results. Slurm requeues preempted jobs by itself, and a cancelled one is
# not to come back.
requeue_or_exit() {
    local again=""
    if [ "$code" = 6 ] && [ "$caught" = USR1 ] && [ -n "${output:-}" ] && [ "$(checkpoint)" = "${saved:-}" ]; then
        echo "the time is up, and nothing new is saved: a load step takes longer than this job's time limit; submit it" \
            "again with a longer one (sbatch --time)" >&2
    elif [ "$code" = 6 ]; then
        again=yes
    elif [ "$code" -gt 128 ] && ! [ -e "${output:-/nowhere}/summary.json" ]; then
        again=yes
    fi
    if [ -n "$again" ] && [ "$caught" = USR1 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "${DDMPI_REQUEUES:-50}" ]; then
        echo "the time is up: back into the queue, to go on from here"
        scontrol requeue "$SLURM_JOB_ID" || echo "Slurm does not requeue this job; submit it again to go on" >&2
    fi
    explain
    exit "$code"
}
