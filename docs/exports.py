#!/usr/bin/env python3
"""A table of the book: what each kind of export takes and loses: docs/exports.py DASH RUN..

Prints a Markdown row for each run and kind: bytes, and how far pictures of the file are from the scene's own on held-out cameras. The run's
dataset has to be where it was.
"""
import os, re, subprocess, sys, tempfile

dash, runs = sys.argv[1], sys.argv[2:]
print("| run | file | holds | kB | dB |")
print("| --- | --- | --- | --- | --- |")
for run in runs:
    for kind in ("ply", "spz", "splat", "glb", "4dgs"):
        with tempfile.TemporaryDirectory() as folder:
            out = os.path.join(folder, "scene." + kind)
            instant = [] if kind == "4dgs" else ["--time", "0.5"]
            done = subprocess.run([dash, "export", run, "--out", out, *instant, "--device", "flex", "-q"], capture_output=True, text=True)
            if done.returncode != 0:
                sys.exit(done.stderr)
            size = os.path.getsize(out)
        db = re.search(r"own at ([0-9.]+) dB", done.stdout)
        if not db:
            sys.exit(f"dash export said no dB of {run}: {done.stdout}")
        holds = re.search(r": (\d+) frames", done.stdout)
        holds = f"{holds[1]} frames" if holds else "an instant"
        name = os.path.basename(run.rstrip("/"))
        print(f"| `{name}` | `.{kind}` | {holds} | {size / 1000:,.0f} | {db[1]} |")
