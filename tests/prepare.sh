#!/bin/sh
# Installs what the tests need and cargo can't bring: ffmpeg, which writes and reads videos.
set -eu

ffmpeg -version >/dev/null 2>&1 && exit 0
as_root=""
[ "$(id -u)" -eq 0 ] || as_root=sudo
$as_root apt-get update -qq
# Reinstalled, because the package may be recorded as installed although its program is gone.
$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends --reinstall ffmpeg
ffmpeg -version >/dev/null
