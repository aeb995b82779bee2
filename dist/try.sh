#!/usr/bin/env bash
# Tries a release archive in a bare Debian root, without Rust or a compiler: dist/try.sh ARCHIVE [SUITE]. Needs root and
# debootstrap.
set -euo pipefail

archive=$1 suite=${2:-bookworm}
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
debootstrap --variant=minbase "$suite" "$root" > /dev/null
cp "$archive" "$root/root"
SECONDS=0
# A mount namespace of its own: nothing stays mounted.
unshare --mount bash -euc "
    mount -t proc proc '$root/proc'
    chroot '$root' bash -euc 'cd /root && tar -xzf *.tar.gz && cd dash-*/ && ./dash --version && ./dash quickstart'
"
test -s "$root"/root/dash-*/out/quickstart/run/overview.png
echo "from unpacking to pictures: $SECONDS s"
