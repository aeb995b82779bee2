"""Reads what dash writes with programs that are not ours: readers.py DASH RUN DATASET PACKAGES.

A clip (.4dgs) by the format's Python package, at the times of files that dash wrote of the same scene; event files by TensorBoard.
PACKAGES is where `pip install --target PACKAGES fourdgs tensorboard` put them.
"""

import json
import pathlib
import struct
import subprocess
import sys
import tempfile

dash, run, dataset, packages = sys.argv[1:]
dash = str(pathlib.Path(dash).resolve())
run, dataset = pathlib.Path(run).resolve(), pathlib.Path(dataset).resolve()
sys.path.insert(0, packages)
work = pathlib.Path(tempfile.mkdtemp(prefix="readers-"))


def call(*args):
    done = subprocess.run([dash, *map(str, args), "--device", "flex", "-q"], cwd=work, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"dash {' '.join(map(str, args))}: {done.stderr}")
    return done.stdout


def columns(path):
    """The columns of a binary PLY of floats."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode().split("\n")
    names = [line.split()[2] for line in lines if line.startswith("property float ")]
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    table = np.frombuffer(body, "<f4", count * len(names)).reshape(count, len(names))
    return {name: table[:, k] for k, name in enumerate(names)}


def clip():
    """Every Gaussian of a frame is where dash has it, within the stated error."""
    share, n_frames, rate = 0.0005, 24, 12.0
    told = call("export", run, "--out", "clip.4dgs", "--frames", n_frames, "--fps", rate, "--max-error", share)
    print(told.strip())
    call("export", run, "--frames", n_frames, "--out", "plys")
    scene = fourdgs.read(work / "clip.4dgs")
    assert scene.header.attributes["dash.frames"] == str(n_frames)
    report = validate((work / "clip.4dgs").read_bytes())
    assert not report.findings, [str(finding) for finding in report.findings]
    worst = 0.0
    for frame in range(0, n_frames, 3):
        exact = columns(work / "plys" / f"{frame:04}.ply")
        own = np.stack([exact["x"], exact["y"], exact["z"]], 1).astype(np.float64)
        # As the file states it: the box of the first frame without the outermost twentieth.
        if frame == 0:
            n = len(own)
            cut = int(0.05 * n)
            ordered = np.sort(own, 0)
            diagonal = np.linalg.norm(ordered[n - 1 - cut] - ordered[cut])
            rounding = 3 * scene.quantization.step_pos
        state = scene.gaussians.state_at(frame / rate, scene.header.cutoff)
        centers = state["centers"]
        assert len(centers) == len(own), (len(centers), len(own))
        # In both directions, as neither file has the other's order.
        for a, b in ((centers, own), (own, centers)):
            for block in np.array_split(a, max(1, len(a) // 500)):
                near = np.sqrt(((block[:, None] - b[None]) ** 2).sum(2)).min(1)
                worst = max(worst, float(near.max()))
    bound = share * diagonal + rounding
    print(f"clip: {worst:.2e} world units off at most, {bound:.2e} allowed")
    assert worst <= bound


def events():
    """TensorBoard finds the run's log."""
    call("train", dataset, "--out", "run", "--preset", "quick", "--iterations", 120, "--curve", 2, "--tensorboard", "events")
    found = event_accumulator.EventAccumulator(str(work / "events"))
    found.Reload()
    tags = found.Tags()["scalars"]
    lines = [json.loads(line) for line in (work / "run/log.jsonl").read_text().splitlines()]
    for tag, key in (("loss", "loss"), ("psnr/training", "train_psnr"), ("gaussians/static", "n_static")):
        points = [(point.step, point.value) for point in found.Scalars(tag)]
        expected = [(line["step"], struct.unpack("f", struct.pack("f", line[key]))[0]) for line in lines]
        assert points == expected, (tag, points, expected)
    curve = [json.loads(line) for line in (work / "run/curve.jsonl").read_text().splitlines()]
    steps = [point.step for point in found.Scalars("psnr/test")]
    assert steps == [line["step"] for line in curve], (steps, curve)
    print(f"events: {len(lines)} lines of the log, {len(curve)} of the curve, tags {', '.join(tags)}")


import numpy as np  # noqa: E402
import fourdgs  # noqa: E402
from fourdgs.validate import validate  # noqa: E402
from tensorboard.backend.event_processing import event_accumulator  # noqa: E402

clip()
events()
