#!/bin/sh
# Draws the book's figures with the program: docs/figures.sh FOLDER. Needs `dash` and `ffmpeg` on the PATH, and a few minutes.
set -eu
work=$1
images=$(cd "$(dirname "$0")/src/images" && pwd)
frame=0012

# beside OUT PICTURE..: pictures of one height side by side, with a palette of their own.
beside() {
    out=$1
    shift
    n=$#
    for picture in "$@"; do set -- "$@" -i "$picture"; done
    shift "$n"
    ffmpeg -loglevel error -y "$@" -filter_complex \
        "hstack=inputs=$n,format=rgb24,split[a][b];[a]palettegen=max_colors=128[p];[b][p]paletteuse=dither=none" \
        -frames:v 1 "$out"
}
# small WIDTH FROM TO: a picture of that width, with a palette of its own.
small() {
    ffmpeg -loglevel error -y -i "$2" -filter_complex \
        "scale=$1:-1:flags=area,format=rgb24,split[a][b];[a]palettegen=max_colors=64[p];[b][p]paletteuse=dither=none" \
        -frames:v 1 "$3"
}
# larger FILE.json: the same cameras with pictures of twice the size, one camera.
larger() {
    python3 -c '
import json, sys
cameras = json.load(open(sys.argv[1]))
camera = cameras[len(cameras) // 3]
for key in ("width", "height", "fx", "fy", "cx", "cy"):
    camera[key] = camera[key] * 2
camera.pop("time", None)
json.dump([camera], open(sys.argv[2], "w"))' "$1" "$2"
}

mkdir -p "$work" && cd "$work"
[ -d room ] || dash synth room --scene bounce
[ -f run/results.json ] || dash train room --out run --preset quick --curve 12
rm -rf test spiral novel times report
dash render run --cameras test --layers full,static,dynamic,depth --out test
dash render run --cameras spiral --frames 12 --out spiral
larger spiral/cameras.json one.json
dash render run --cameras one.json --time 0.55 --layers full,static,dynamic --out novel
dash render run --cameras one.json --frames 4 --out times

captured=room/cam00/images/$frame.png
beside "$images/layers.png" "$captured" "test/full/${frame}_cam00.png" "test/static/${frame}_cam00.png" \
    "test/dynamic/${frame}_cam00.png" "test/depth/${frame}_cam00.png"
beside "$images/motion.png" "$captured" "room/motion_masks/cam00/$frame.png" "test/dynamic/${frame}_cam00.png"
beside "$images/decomposition.png" novel/full/*.png novel/static/*.png novel/dynamic/*.png
beside "$images/times.png" times/full/*.png
dash doctor room --no-timing --picture doctor.png
small 800 doctor.png "$images/doctor.png"
dash bench --out growth.json --ops growth --sizes 90000 --no-stiffness --device flex
dash report growth.json --out growth
small 900 growth/kernels-growth.png "$images/growth.png"
# The upper half: PSNR and PSNR on moving pixels.
dash report run --out report
ffmpeg -loglevel error -y -i report/quality-steps.png -vf "crop=iw:ih/2:0:0" -frames:v 1 steps.png
small 800 steps.png "$images/run.png"
