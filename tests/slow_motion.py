"""Slow motion is motion: slow_motion.py DASH [FRAMES..].

A square moves 0.2 px a frame before a textured wall, seen by six cameras with sensor noise; in a second clip it rests. `doctor` and a short run of
`quick` must find the motion, and nothing where there is none, whatever the number of frames (24, 60, 120 and 240: a second at so
many frames). Needs numpy and pillow.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image

dash = str(pathlib.Path(sys.argv[1]).resolve())
counts = [int(n) for n in sys.argv[2:]] or [24, 60, 120, 240]
WIDTH, HEIGHT, FOCAL, NOISE = 96, 72, 90.0, 4.0
WALL, SQUARE = 4.0, 3.2  # Depths.
OVERSAMPLED = 3
CAMERAS = [(-0.5, -0.25), (0.5, -0.25), (-0.5, 0.25), (0.5, 0.25), (0.0, 0.0), (0.0, 0.4)]


def texture(seed, scale):
    """Smooth random colours at points of a plane."""
    grid = np.random.default_rng(seed).random((64, 64, 3))

    def at(x, y):
        x, y = x * scale, y * scale
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        u, v = (x - i)[..., None], (y - j)[..., None]
        knot = lambda i, j: grid[j % 64, i % 64]
        low = knot(i, j) * (1 - u) + knot(i + 1, j) * u
        high = knot(i, j + 1) * (1 - u) + knot(i + 1, j + 1) * u
        return low * (1 - v) + high * v

    return at


def write(folder, n_frames, speed):
    """A clip; the speed in pixels a frame."""
    rng, wall, square = np.random.default_rng(1), texture(2, 4.0), texture(3, 9.0)
    rows, columns = np.mgrid[0 : HEIGHT * OVERSAMPLED, 0 : WIDTH * OVERSAMPLED]
    dx = ((columns + 0.5) / OVERSAMPLED - WIDTH / 2) / FOCAL
    dy = ((rows + 0.5) / OVERSAMPLED - HEIGHT / 2) / FOCAL
    frames = []
    for camera, (cx, cy) in enumerate(CAMERAS):
        images = folder / f"images/cam{camera:02}"
        images.mkdir(parents=True)
        behind = wall(cx + dx * WALL + 8, cy + dy * WALL + 8)
        for k in range(n_frames):
            x = cx + dx * SQUARE - speed * (k - (n_frames - 1) / 2) * SQUARE / FOCAL
            y = cy + dy * SQUARE
            inside = (np.abs(x) < 0.35) & (np.abs(y) < 0.35)
            fine = np.where(inside[..., None], square(x + 8, y + 8), behind)
            picture = fine.reshape(HEIGHT, OVERSAMPLED, WIDTH, OVERSAMPLED, 3).mean((1, 3))
            picture = 255 * picture + rng.normal(0, NOISE, picture.shape)
            Image.fromarray(np.clip(np.round(picture), 0, 255).astype(np.uint8)).save(images / f"{k:06}.png")
        # OpenGL's axes: y up, z backward.
        pose = [[1, 0, 0, cx], [0, -1, 0, cy], [0, 0, -1, 0], [0, 0, 0, 1]]
        lens = dict(fl_x=FOCAL, fl_y=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2, w=WIDTH, h=HEIGHT)
        frames.append(dict(file_path=f"cam{camera:02}", transform_matrix=pose, **lens))
    (folder / "transforms.json").write_text(json.dumps(dict(camera_model="OPENCV", frames=frames)))


def call(*args):
    return subprocess.run([dash, *map(str, args), "--device", "flex"], capture_output=True, text=True)


failed = False
work = pathlib.Path(tempfile.mkdtemp(prefix="slow-motion-"))
for n_frames in counts:
    for speed in (0.2, 0.0):
        clip, run = work / f"{n_frames}-{speed}", work / f"run-{n_frames}-{speed}"
        write(clip, n_frames, speed)
        told = call("doctor", clip, "--no-timing").stdout
        says_static = "the scene is static" in told
        done = call("train", clip, "--out", run, "--preset", "quick", "--iterations", 1200, "-q")
        if done.returncode != 0:
            sys.exit(done.stderr)
        n_dynamic = json.loads((run / "results.json").read_text())["n_dynamic"]
        sound = (n_dynamic > 0) == (speed > 0) and says_static == (speed == 0)
        failed |= not sound
        print(f"{n_frames} frames, {speed} px: {n_dynamic} dynamic Gaussians, doctor says {'static' if says_static else 'motion'}", flush=True)
sys.exit(failed)
