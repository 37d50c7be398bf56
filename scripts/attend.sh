# Sourced by run.sh and by the batch scripts:
#   attend COMMAND   runs it and passes signals on; sets `code`, its exit code, and `caught`, the last signal or nothing
#   explain          says what a `code` means that is not ddmpi's own: a quiet mpirun does not
# SIGTERM, SIGINT and SIGUSR1 all ask a run for a checkpoint. They are passed on as SIGUSR1, which mpirun hands to the
# ranks, whose exit code it then returns. At SIGTERM mpirun would kill the ranks after a second and return 1.
# BARE_SIGNALS says that mpirun returns the bare number of a signal that has ended a rank; our own codes end at 6.
# HAND_ON=TERM is for programs that handle no signal.
attend() {
    local came last=0 signal
    caught=""
    "$@" <&0 &
    child=$!
    for signal in TERM INT USR1; do
        trap "came=yes caught=$signal; kill -s ${HAND_ON:-USR1} $child 2>/dev/null || true" "$signal"
    done
    while :; do
        came=""
        code=0
        wait "$child" || code=$?
        [ -n "$came" ] || break # else it is the signal that has ended the wait
        last=$code
    done
    [ "$code" != 127 ] || code=$last # the signal came when the command had ended
    if [ -n "${BARE_SIGNALS:-}" ] && [ "$code" -gt 6 ] && [ "$code" -lt 32 ]; then code=$((code + 128)); fi
    trap - TERM INT USR1
}

explain() {
    local name
    if [ "$code" -gt 128 ] && name=$(kill -l "$code" 2>/dev/null); then # 9: out of memory, or kill
        echo "ddmpi: error: a rank was ended by signal $((code - 128)) ($name)" >&2
    elif [ "$code" -gt 6 ] && [ "$code" != 59 ]; then # 59: PETSc has said which signal
        echo "ddmpi: error: the launcher ended the run (exit code $code), most likely because a host was lost; if there is" \
            "a checkpoint, --restart goes on from it" >&2
    fi
}
