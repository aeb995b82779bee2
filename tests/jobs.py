"""Kills plan, work and join at random moments and looks at what they leave: jobs.py DASH [KILLS [SEED [compare|windows]]].

The tasks are the runs of a comparison, or a clip's windows of time and their room. One of the three at a time gets SIGKILL after a random time, until so many were killed (200), while another worker goes on. After each kill the
plan must be whole or absent, no checkpoint broken, and join must tell which tasks are missing, and no others. At the end the
scenes must have the bits of those of one process that nobody killed.
"""

import json
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

dash = shutil.which(sys.argv[1]) or str(pathlib.Path(sys.argv[1]).resolve())
n_kills = int(sys.argv[2]) if len(sys.argv) > 2 else 200
rng = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
HARDWARE = ["--threads", "1", "--device", "flex", "-q"]
TINY = ["--set", "checkpoint_interval=7", "--set", "initial_points=[0, 300]"]
COMPARED = ["compare", "room", "--methods", "dash,hexplane", "--seeds", "8", "--curve", "0", "--iterations", "150", *TINY]
WINDOWS = ["train", "room", "--window", "5", "--overlap", "2", "--room", "yes", "--preset", "quick", "--iterations", "90", *TINY]
# What is planned, the frames of the clip, and where the tasks' runs are.
KINDS = {"compare": (COMPARED, "3", ["*/seed-*"]), "windows": (WINDOWS, "38", ["room", "window-*"])}
PLANNED, N_FRAMES, RUNS = KINDS[sys.argv[4] if len(sys.argv) > 4 else "compare"]

# The longest time before each is killed.
MOST_SECS = {"plan": 0.03, "work": 0.6, "join": 0.03}

work = pathlib.Path(tempfile.mkdtemp(prefix="jobs-"))
shared = work / "shared"


def run(*args, expected=(0,)):
    done = subprocess.run([dash, *args, *HARDWARE], cwd=work, capture_output=True, text=True)
    if done.returncode not in expected:
        sys.exit(f"dash {' '.join(args)}: exit code {done.returncode}: {done.stderr}")
    return done


def start(args):
    return subprocess.Popen([dash, *args, *HARDWARE], cwd=work, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def files(folder, name):
    """Of each task's run."""
    return sorted(path for run in RUNS for path in folder.glob(f"{run}/{name}"))


def broken():
    """What is half-written."""
    plan = shared / "plan.json"
    if plan.is_file():
        json.loads(plan.read_text())
    wrong = []
    for results in files(shared, "results.json"):
        try:
            json.loads(results.read_text())
        except ValueError as error:
            wrong.append(f"{results}: {error}")
    for state in files(shared, "checkpoints/[0-9]*"):
        for name in ("state.json", "optimizer.safetensors", "scene/scene.json", "scene/scene.safetensors"):
            # A worker that goes on removes old ones.
            if state.is_dir() and not (state / name).is_file() and state.is_dir():
                wrong.append(f"{state}: no {name}")
    return wrong


def told_by_join():
    """How many tasks are missing, or 0 where join succeeds."""
    done = run("join", "shared", expected=(0, 1))
    if done.returncode == 0:
        return 0
    return int(done.stderr.split(" missing:")[0].rsplit(" ", 1)[1])


def scored():
    return len(files(shared, "results.json"))


run("synth", "room", "--cameras", "4", "--frames", N_FRAMES, "--size", "32x24")
run(*PLANNED, "--out", "whole")
n_tasks = len(files(work / "whole", "results.json"))
run("plan", *PLANNED, "--out", "shared")

problems = []
n_stopped = dict.fromkeys(("plan", "work", "join"), 0)
kill = 0
while sum(n_stopped.values()) < n_kills:
    kill += 1
    name = rng.choice(["plan", "work", "work", "work", "join"])
    args = {"plan": ["plan", *PLANNED, "--out", "shared"], "work": ["work", "shared"], "join": ["join", "shared"]}[name]
    other = start(["work", "shared", "--task", str(rng.randrange(n_tasks))]) if rng.random() < 0.3 else None
    child = start(args)
    time.sleep(rng.random() * MOST_SECS[name])
    child.send_signal(signal.SIGKILL)
    n_stopped[name] += child.wait() == -9
    wrong = broken()
    if other:
        other.wait()
    before, missing, after = n_tasks - scored(), told_by_join(), n_tasks - scored()
    if not after <= missing <= before:
        wrong.append(f"join tells of {missing} missing tasks, of which there are {after}")
    while n_tasks - scored() < 3:
        # Nearly all done: one is to be done again.
        shutil.rmtree(rng.choice(files(shared, "results.json")).parent)
    problems += [f"kill {kill}, {name}: {what}" for what in wrong]

run("work", "shared")
run("join", "shared")
for whole in files(work / "whole", "scene/scene.safetensors"):
    path = whole.relative_to(work / "whole")
    if (shared / path).read_bytes() != whole.read_bytes():
        problems.append(f"{path} has other bits")
left = [str(p) for p in shared.rglob("*") if p.name.startswith(".") or p.name.endswith(".partial")]
problems += [f"{path} is left" for path in left]
told = ", ".join(f"{n} of {name}" for name, n in n_stopped.items())
print(f"killed: {told}, in {kill} tries; {n_tasks} tasks; {len(problems)} problems")
print("\n".join(problems[:20]))
shutil.rmtree(work)
sys.exit(bool(problems))
