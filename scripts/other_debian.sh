#!/usr/bin/env bash
# The two commands of the README on a bare Debian of another release: scripts/other_debian.sh trixie [pytest arguments]
# Wants root and debootstrap. The release goes into a folder (OTHER_DEBIAN, default .venv-RELEASE) and stays there; what
# is committed is cloned into it anew each time. pip gets this machine's settings (PIP_…, /etc/pip.conf, certificates).
# MIRROR names another mirror than this machine's. Not part of scripts/test.sh.
set -euo pipefail
ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
case "${1:-}" in "" | -*) sed -n '2,5s/^# *//p' "$0" >&2; exit 2 ;; esac
RELEASE=$1
shift
SYSTEM=${OTHER_DEBIAN:-$ROOT/.venv-$RELEASE}
PATH=$PATH:/usr/sbin:/sbin
[ "$(id -u)" = 0 ] && command -v debootstrap >/dev/null || { echo "$0: wants root and debootstrap" >&2; exit 1; }
if [ ! -e "$SYSTEM/complete" ]; then
    mirror=${MIRROR:-$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' 'Component: main' | head -n 1)}
    debootstrap --variant=minbase --include=git "$RELEASE" "$SYSTEM" "$mirror"
    for file in /etc/hosts /etc/pip.conf; do [ ! -e "$file" ] || cp "$file" "$SYSTEM$file"; done
    touch "$SYSTEM/complete"
fi
rm -rf "$SYSTEM/ddmpi"
git clone --quiet --no-hardlinks "$ROOT" "$SYSTEM/ddmpi"
mapfile -t -d '' settings < <(env -0 | grep -z '^PIP_' || true)
if [ -e /etc/ssl/certs/ca-certificates.crt ]; then # the new system's own are not there yet, or are not this machine's
    cp /etc/ssl/certs/ca-certificates.crt "$SYSTEM/pip.crt"
    settings+=(PIP_CERT=/pip.crt)
fi
# Mounts and processes of its own: nothing is left of them.
exec unshare --mount --pid --fork --kill-child bash -euo pipefail -c '
system=$1
shift
mount --make-rprivate /
mount -t proc proc "$system/proc"
mount --rbind /dev "$system/dev"
mount --rbind /sys "$system/sys"
chroot "$system" "$@"' - "$SYSTEM" \
    env -i HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "${settings[@]}" \
    bash -euo pipefail -c 'cd /ddmpi; cat /etc/debian_version; scripts/run.sh; scripts/test.sh "$@"' - "$@"
