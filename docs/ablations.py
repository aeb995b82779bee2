#!/usr/bin/env python3
"""A table of the book from runs that each lack one thing: docs/ablations.py RUNS CAPTURE[:CAMERAS].. -- NAME..

RUNS holds a run's folder NAME-CAPTURE for each name and capture; the first name is that of the whole. Prints a Markdown row for each name and, for
each capture, PSNR / PSNR on moving pixels (dB) and SSIM, means over the test views, of some cameras only where CAMERAS (0,10) says so. Static and
dynamic Gaussians and seconds of training are those of the first capture.
"""
import json, os, sys

split = sys.argv.index("--")
folder, captures, names = sys.argv[1], sys.argv[2:split], sys.argv[split + 1 :]


def number(camera):
    return int("".join(c for c in camera if c.isdigit()) or -1)


def results(name, capture):
    with open(os.path.join(folder, f"{name}-{capture}", "results.json")) as file:
        return json.load(file)


def scores(name, capture):
    capture, _, cameras = capture.partition(":")
    wanted = {int(c) for c in cameras.split(",") if c}
    views = [v for v in results(name, capture)["per_view"] if not wanted or number(v["camera"]) in wanted]

    def mean(key, digits):
        values = [v[key] for v in views if v.get(key) is not None]
        return f"{sum(values) / len(values):.{digits}f}" if values else "-"

    return f"{mean('psnr', 2)} / {mean('psnr_dynamic', 2)}, {mean('ssim', 3)}"


print("| run | " + " | ".join(captures) + " | static | dynamic | s |")
print("| --- |" + " --- |" * (len(captures) + 3))
for name in names:
    first = results(name, captures[0].partition(":")[0])
    counts = [f"{first[key]:,}" for key in ("n_static", "n_dynamic")]
    cells = [scores(name, capture) for capture in captures]
    print("| " + " | ".join([f"`{name}`", *cells, *counts, f"{first['train_seconds']:.0f}"]) + " |")
