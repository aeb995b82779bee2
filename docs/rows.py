#!/usr/bin/env python3
"""Rows of a table of the book from runs: docs/rows.py [--cameras 0,10] RUN..

Prints a Markdown row for each run: its folder, PSNR and PSNR on moving pixels (dB, means over the test views), both with the captured pictures'
exposure, SSIM, Gaussians, seconds of training. With --cameras, of the test views of these cameras only.
"""
import json, os, sys

runs = sys.argv[1:]
cameras = None
if runs[:1] == ["--cameras"]:
    cameras = {int(c) for c in runs[1].split(",")}
    runs = runs[2:]


def number(camera):
    return int("".join(c for c in camera if c.isdigit()) or -1)


print("| run | PSNR | moving | corrected | moving, corrected | SSIM | static | dynamic | s |")
print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
for run in runs:
    with open(os.path.join(run, "results.json")) as file:
        results = json.load(file)
    views = [v for v in results["per_view"] if cameras is None or number(v["camera"]) in cameras]

    def mean(key, digits):
        values = [v[key] for v in views if v.get(key) is not None]
        return f"{sum(values) / len(values):.{digits}f}" if values else "-"

    scores = [mean("psnr", 2), mean("psnr_dynamic", 2), mean("psnr_corrected", 2), mean("psnr_dynamic_corrected", 2), mean("ssim", 3)]
    counts = [f"{results[key]:,}" for key in ("n_static", "n_dynamic")]
    name = os.path.basename(run.rstrip("/"))
    print("| " + " | ".join([f"`{name}`", *scores, *counts, f"{results['train_seconds']:.0f}"]) + " |")
