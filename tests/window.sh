#!/usr/bin/env bash
# Opens `dash view RUN` on a display of its own, uses it by keys and mouse, and leaves screenshots to look at in OUT. Fails where the
# window closes early, or memory grows while a clip plays.
#
#   tests/window.sh DASH RUN OUT [SECONDS OF PLAYING] [DEVICE]
#
# Needs Xvfb, xdotool, ImageMagick and a Vulkan driver (Debian: xvfb xdotool imagemagick mesa-vulkan-drivers).
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,8s/^# \{0,1\}//p' "$0"; exit 2; }
dash=$1 run=$2 out=$3 play=${4:-30} device=${5:-flex}
mkdir -p "$out"

export DISPLAY=:${DISPLAY_NUMBER:-97}
Xvfb "$DISPLAY" -screen 0 1300x820x24 >"$out/xvfb.log" 2>&1 &
server=$!
trap 'kill $(jobs -p) 2>/dev/null || true' EXIT
sleep 2
"$dash" view "$run" --device "$device" >"$out/dash.log" 2>&1 &
window=$!

shot() { sleep "${2:-2}"; import -window root "$out/$1.png"; }
resident() { awk '/VmRSS/ { print $2 }' "/proc/$window/status"; }

for _ in $(seq 60); do
    xdotool search --name "dash view" >/dev/null 2>&1 && break
    sleep 1
done
shot opened 5
xdotool mousemove 500 300
xdotool windowfocus "$(xdotool search --name "dash view" | head -n 1)" || true
xdotool key space key Home
for layer in 1 2 3 4 5 6 7; do
    xdotool key "$layer"
    shot "layer$layer"
done
xdotool key 1
for view in beside slider difference; do
    xdotool key m
    shot "$view"
done
xdotool key m key c
xdotool mousemove 500 300 mousedown 1 mousemove 600 340 mousemove 640 360 mouseup 1
xdotool click 5 click 5 click 5
shot cameras
xdotool key c key question
shot keys
xdotool key question key r key k key d key k shift+p p
shot written
xdotool key space
sleep 5
before=$(resident)
sleep "$play"
after=$(resident)
shot playing 0
kill -0 "$window" || { echo "the window closed early:"; cat "$out/dash.log"; exit 1; }
echo "memory while playing for $play s: $before kB, $after kB"
[ "$after" -le $((before + before / 20)) ] || { echo "memory grew"; exit 1; }
kill "$window" "$server"
