# Sourced by run.sh and by the batch scripts:
#   attend COMMAND   runs it and passes signals on; sets `code`, its exit code, and `caught`, the last signal or nothing
#   explain          says what a `code` means that is not ddmpi's own: a quiet mpirun does not
# Signals that ask a run for a checkpoint, Ctrl-C and a closed terminal among them, are passed on as SIGUSR1, which mpirun
# hands to the ranks, whose exit code it then returns. At SIGTERM or Ctrl-C mpirun would itself kill the ranks after a
# second or two and return 1, so it runs in a session of its own, which a terminal sends nothing. The file DDMPI_SIGNAL
# holds the name of the signal, for the message. A second Ctrl-C, or Ctrl-\, does not wait for a checkpoint.
# Where a pipe is read, as by head or a pager, mpirun writes to `relay` instead: a reader that has seen enough would else
# end mpirun and with it the run.
# BARE_SIGNALS says that mpirun returns the bare number of a signal that has ended a rank; our own codes end at 6.
attend() {
    local came last=0 signal out=1 err=2 relays="" number
    caught="" hurried=""
    export DDMPI_SIGNAL
    DDMPI_SIGNAL=$(mktemp -t ddmpi-signal.XXXXXX 2>/dev/null) || DDMPI_SIGNAL=/dev/null
    if [ -p /dev/stdout ] || [ -S /dev/stdout ]; then
        exec {out}> >(relay)
        relays=$!
    fi
    if [ -n "$relays" ] && [ /dev/stdout -ef /dev/stderr ]; then
        err=$out
    elif [ -p /dev/stderr ] || [ -S /dev/stderr ]; then
        exec {err}> >(relay >&2)
        relays+=" $!"
    fi
    setsid "$@" <&0 >&"$out" 2>&"$err" &
    child=$!
    for signal in TERM INT USR1 HUP QUIT; do trap "came=yes; pass_on $signal" "$signal"; done
    [ "$err" = 2 ] || [ "$err" = "$out" ] || exec {err}>&-
    [ "$out" = 1 ] || exec {out}>&-
    while :; do
        came=""
        code=0
        wait "$child" 2>/dev/null || code=$? # what ends mpirun itself, bash would name by its command
        [ -n "$came" ] || break # else it is the signal that has ended the wait
        last=$code
    done
    [ "$code" != 127 ] || code=$last # the signal came when the command had ended
    if [ -n "${BARE_SIGNALS:-}" ] && [ "$code" -gt 6 ] && [ "$code" -lt 32 ]; then code=$((code + 128)); fi
    [ -z "$hurried" ] || [ "$code" = 6 ] || code=130
    trap - TERM INT USR1 HUP QUIT
    trap "" PIPE # what is said from here on may have no reader any more
    for number in {1..20}; do # seconds/10; a reader that takes longer gets the rest later
        kill -0 $relays 2>/dev/null || break
        sleep 0.1
    done
    [ "$DDMPI_SIGNAL" = /dev/null ] || rm -f "$DDMPI_SIGNAL"
}

relay() { # hands on what it reads, to the end, also when nobody takes it any more
    trap "" PIPE TERM INT USR1 HUP QUIT
    cat 2>/dev/null || cat >/dev/null
}

pass_on() {
    case "$caught $1" in
        "INT INT" | *" QUIT") hurried=yes; echo "ddmpi: ending at once, without waiting for a checkpoint" >&2 ;;
    esac
    caught=$1
    if [ -n "$hurried" ]; then
        kill_session
    else
        { echo "SIG$1" >"$DDMPI_SIGNAL"; kill -s USR1 "$child"; } 2>/dev/null || true
    fi
}

kill_session() { # Open MPI 5 leaves the ranks of this machine behind where its mpirun alone is killed
    local entry line
    kill -KILL "$child" 2>/dev/null || true # it may not have a session of its own yet
    for entry in /proc/[0-9]*; do
        { read -r line <"$entry/stat"; } 2>/dev/null || continue
        set -- ${line##*) } # state, parent, group, session
        [ "${4:-}" != "$child" ] || kill -KILL "${entry#/proc/}" 2>/dev/null || true
    done
}

explain() {
    local name
    if [ -n "$hurried" ]; then
        return
    elif [ -n "$caught" ] && [ "$code" = $((128 + $(kill -l USR1))) ]; then # a command that has nothing to save
        echo "ddmpi: error: interrupted by SIG$caught" >&2
    elif [ "$code" -gt 128 ] && name=$(kill -l "$code" 2>/dev/null); then # 9: out of memory, or kill
        echo "ddmpi: error: a rank was ended by signal $((code - 128)) ($name)" >&2
    elif [ "$code" -gt 6 ] && [ "$code" != 59 ]; then # 59: PETSc has said which signal
        echo "ddmpi: error: the launcher ended the run (exit code $code), most likely because a host was lost; if there is" \
            "a checkpoint, --restart goes on from it" >&2
    fi
}
