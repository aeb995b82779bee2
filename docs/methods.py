#!/usr/bin/env python3
"""Tables of the book from comparisons: docs/methods.py OUT..

Each OUT is a folder of `dash compare`, and a column. Prints Markdown tables with a row for each method: PSNR on moving pixels and on all pixels in
dB, median over seeds with the least and the most; then steps.
"""
import json, pathlib, statistics, sys

folders = [pathlib.Path(name) for name in sys.argv[1:]]


def results(folder, method):
    return [json.loads(path.read_text()) for path in sorted(folder.glob(f"{method}/seed-*/results.json"))]


def of_seeds(key, digits):
    def cell(runs):
        values = sorted(run[key] for run in runs if run.get(key) is not None)
        if not values:
            return "-"
        least, middle, most = (f"{v:.{digits}f}" for v in (values[0], statistics.median(values), values[-1]))
        return middle if least == most else f"{middle} ({least} to {most})"

    return cell


def table(title, cell):
    print(f"{title}\n\n| method | " + " | ".join(f"`{folder.name}`" for folder in folders) + " |")
    print("| --- " * (len(folders) + 1) + "|")
    for method in methods:
        print(f"| `{method}` | " + " | ".join(cell(results(folder, method)) for folder in folders) + " |")
    print()


methods = sorted({path.parent.parent.name for folder in folders for path in folder.glob("*/seed-*/results.json")})
table("Moving pixels:", of_seeds("psnr_dynamic", 2))
table("All pixels:", of_seeds("psnr", 2))
table("Steps:", of_seeds("iterations", 0))
