"""Stops commands at random moments and counts what they leave: interrupt.py DASH [MOMENTS [SEED [COMMAND..]]].

Each of train, render, video, synth, rig, prepare and export gets SIGINT, SIGTERM, SIGHUP and SIGKILL at so many moments each
(100), spread over the time that it takes. Fails if anything is left that is neither whole nor a checkpoint that can be
loaded, if a program that it started goes on, or if the exit code is another one. What SIGKILL leaves must be gone, and
the output whole, after the same command was run again.
"""

import hashlib
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
n_moments = int(sys.argv[2]) if len(sys.argv) > 2 else 100
rng = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
wanted = sys.argv[4:]
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL]
HARDWARE = ["--threads", "1", "--device", "flex", "-q"]

work = pathlib.Path(tempfile.mkdtemp(prefix="interrupt-"))


def run(*args):
    done = subprocess.run([dash, *args, *HARDWARE], cwd=work, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"dash {' '.join(args)}: {done.stderr}")


TINY = ["--preset", "quick", "--iterations", "40", "--set", "checkpoint_interval=7", "--set", "initial_points=[0, 300]"]
run("synth", "room", "--cameras", "4", "--frames", "3", "--size", "32x24")
run("synth", "rig", "--layout", "rig", "--cameras", "3", "--frames", "20", "--size", "160x120")
run("train", "room", "--out", "run", *TINY)

# Arguments, and what the command writes.
COMMANDS = {
    "train": (["train", "room", "--out", "out", *TINY], "out"),
    "render": (["render", "run", "--cameras", "spiral", "--frames", "200", "--out", "out"], "out"),
    "video": (["render", "run", "--cameras", "spiral", "--frames", "300", "--out", "out.mp4"], "out.mp4"),
    "synth": (["synth", "out", "--cameras", "4", "--frames", "8", "--size", "96x72"], "out"),
    "rig": (["synth", "out", "--layout", "rig", "--cameras", "3", "--frames", "12", "--size", "96x72"], "out"),
    "prepare": (
        ["prepare", "rig/videos", "out", "--poses", "rig/transforms.json", "--random-points", "100"],
        "out",
    ),
    "export": (["export", "run", "--time", "0.5", "--out", "out.ply"], "out.ply"),
}


def files(path):
    """Every file below a path, with its content."""
    if path.is_file():
        return {".": path.read_bytes()}
    return {str(f.relative_to(path)): f.read_bytes() for f in path.rglob("*") if f.is_file()}


def digest(path):
    """What makes an output whole: of a run its scene, beside which are clocks; of all else every byte."""
    scene = path / "scene"
    content = files(scene if scene.is_dir() else path)
    return {name: hashlib.sha256(content).hexdigest() for name, content in content.items()}


def hidden():
    return [str(p.relative_to(work)) for p in work.rglob("*") if p.name.startswith(".") or p.name.endswith(".partial")]


def going_on(session):
    """Programs of a session that still run."""
    found = []
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(stat.parent.name)
    return found


def broken_checkpoint(path):
    """What is wrong with a checkpoint's files: JSON that ends early, tensors that are cut off."""
    for name in ("state.json", "optimizer.safetensors", "statistics.safetensors", "scene/scene.json", "scene/scene.safetensors"):
        if not (path / name).is_file():
            return f"{path.name}/{name} is missing"
    for name, content in files(path).items():
        if name.endswith(".json"):
            json.loads(content)
        else:
            length = int.from_bytes(content[:8], "little")
            header = json.loads(content[8 : 8 + length])
            ends = [entry["data_offsets"][1] for key, entry in header.items() if key != "__metadata__"]
            if len(content) != 8 + length + max(ends, default=0):
                return f"{path.name}/{name} is cut off"
    return None


def remove(path):
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def left_wrong(name, out, whole):
    """What of the output is neither whole nor a checkpoint."""
    if name != "train":
        return [] if not out.exists() or digest(out) == whole else [f"{out.name} is not whole"]
    wrong = [broken_checkpoint(path) for path in sorted(out.glob("checkpoints/[0-9]*"))]
    return [w for w in wrong if w]


def again(name, args, out, whole):
    """Runs the command to its end on what is left."""
    if name == "train" and (out / "config.toml").is_file():
        run(*args, "--resume")
    else:
        if name != "train":
            remove(out)
        run(*args)
    return [] if digest(out) == whole else [f"{out.name} differs from that of a run that was not stopped"]


print(f"{'command':8} {'signal':8} moments  stopped  exit code  hidden  programs  not whole")
failed = False
for name, (args, out) in COMMANDS.items():
    if wanted and name not in wanted:
        continue
    out = work / out
    takes = float("inf")
    # The first run warms caches.
    for _ in range(2):
        remove(out)
        start = time.monotonic()
        run(*args)
        takes = min(takes, time.monotonic() - start)
    whole = digest(out)
    for sig in SIGNALS:
        counts = dict.fromkeys(("stopped", "exit", "hidden", "programs", "wrong"), 0)
        for _ in range(n_moments):
            remove(out)
            child = subprocess.Popen(
                [dash, *args, *HARDWARE],
                cwd=work,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,
                preexec_fn=lambda: [signal.signal(s, signal.SIG_DFL) for s in SIGNALS[:3]],
            )
            moment = rng.random() * takes
            time.sleep(moment)
            child.send_signal(sig)
            words = child.communicate()[1].decode()
            code = child.returncode
            stopped = code != 0
            counts["stopped"] += stopped
            expected = (0, -9) if sig == signal.SIGKILL else (0, 128 + sig)
            problems = []
            # Before its first line a program can't have asked for signals yet.
            if code not in expected and not (code == -sig and moment < 0.2):
                counts["exit"] += 1
                problems.append(f"exit code {code}: {words}")
            if sig != signal.SIGKILL:
                left = hidden()
                counts["hidden"] += bool(left)
                problems += left
            time.sleep(0.02 if sig == signal.SIGKILL else 0)
            programs = going_on(child.pid) if sig != signal.SIGKILL else []
            counts["programs"] += bool(programs)
            problems += [f"program {p} goes on" for p in programs]
            wrong = left_wrong(name, out, whole)
            if stopped and (sig == signal.SIGKILL or name == "train"):
                wrong += again(name, args, out, whole)
                wrong += [f"{path} is left after the same command" for path in hidden()]
            counts["wrong"] += bool(wrong)
            problems += wrong
            for problem in problems:
                failed = True
                print(f"{name}, {sig.name}: {problem}")
            for path in hidden():
                remove(work / path)
        print(
            f"{name:8} {sig.name:8} {n_moments:7}  {counts['stopped']:7}  {counts['exit']:9}  {counts['hidden']:6}  "
            f"{counts['programs']:8}  {counts['wrong']:9}",
            flush=True,
        )
    remove(out)
shutil.rmtree(work)
sys.exit(failed)
