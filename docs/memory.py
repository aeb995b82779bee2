#!/usr/bin/env python3
"""Resident memory of a training run, by steps: docs/memory.py dash train DATASET --out RUN ..

Prints a row of a table every 2,000 steps (--every N: every N): the step, static and dynamic Gaussians, and the most that
the process has held in memory since the last row, in MiB."""

import json
import subprocess
import sys
import time
from pathlib import Path

POLL_SECS = 0.2


def resident_mib(pid):
    """Resident memory of a process; None once it has ended."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return None
    for line in status.splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return None


def newest(log):
    """The last whole line of a run's log."""
    try:
        lines = log.read_text().splitlines()
    except OSError:
        return None
    for line in reversed(lines):
        try:
            return json.loads(line)
        except json.JSONDecodeError:
            continue
    return None


def main(args):
    every = 2000
    if args[:1] == ["--every"]:
        every, args = int(args[1]), args[2:]
    if "--out" not in args:
        sys.exit(__doc__)
    log = Path(args[args.index("--out") + 1]) / "log.jsonl"
    process = subprocess.Popen(args, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    print("| step | static | dynamic | MiB |\n| --- | --- | --- | --- |")
    due, most, runs = every, 0.0, True
    while runs:
        runs = process.poll() is None
        most = max(most, resident_mib(process.pid) or 0.0)
        line = newest(log)
        if line and line["step"] >= due:
            print(f"| {line['step']:,} | {line['n_static']:,} | {line['n_dynamic']:,} | {most:.0f} |", flush=True)
            due, most = due + every, 0.0
        time.sleep(POLL_SECS)
    sys.exit(process.returncode)


if __name__ == "__main__":
    main(sys.argv[1:])
