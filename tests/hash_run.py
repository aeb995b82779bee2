"""Prints a hash of every parameter of a run's scene and of its test pictures: hash_run.py NAME RUN."""

import hashlib
import json
import pathlib
import sys

name, run = sys.argv[1], pathlib.Path(sys.argv[2])


def line(what, content):
    print(f"{name} {what} {hashlib.sha256(content).hexdigest()[:16]}")


data = (run / "scene" / "scene.safetensors").read_bytes()
n = int.from_bytes(data[:8], "little")
header = json.loads(data[8 : 8 + n])
for tensor, entry in sorted(header.items()):
    if tensor != "__metadata__":
        begin, end = entry["data_offsets"]
        about = f"{entry['dtype']}{entry['shape']}".replace(" ", "")
        line(f"{tensor} {about}", data[8 + n + begin : 8 + n + end])
pictures = sorted((run / "test").rglob("*.png"))
if not pictures:
    sys.exit(f"{name}: no pictures in {run / 'test'}")
line(f"{len(pictures)} pictures", b"".join(picture.read_bytes() for picture in pictures))
