#!/bin/sh
# Installs what the tests need and cargo can't bring: ffmpeg, which writes and reads videos, and a
# Vulkan driver that plays a GPU in software, which the wgpu tests run on where there is no GPU. `tests/prepare.sh ci`
# installs Chromium, too, for tests/browser.py, pip, for tests/readers.py, and Slurm, for tests/slurm.sh.
set -eu

as_root=""
[ "$(id -u)" -eq 0 ] || as_root=sudo
missing=""
ffmpeg -version >/dev/null 2>&1 || missing="ffmpeg"
ls /usr/share/vulkan/icd.d/*.json >/dev/null 2>&1 || missing="$missing mesa-vulkan-drivers"
# The library through which programs find Vulkan drivers.
ldconfig -p | grep -q libvulkan.so.1 || missing="$missing libvulkan1"
if [ "${1:-}" = ci ]; then
    command -v chromium >/dev/null || missing="$missing chromium"
    python3 -m pip --version >/dev/null 2>&1 || missing="$missing python3-pip"
    command -v pgrep >/dev/null || missing="$missing procps"
    for daemon in slurmctld slurmd munged; do
        command -v "$daemon" >/dev/null || missing="$missing slurmctld slurmd slurm-client munge"
    done
fi
[ -n "$missing" ] || exit 0
$as_root apt-get update -qq
# Reinstalled, because a package may be recorded as installed although its files are gone.
# shellcheck disable=SC2086
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends --reinstall $missing
ffmpeg -version >/dev/null
