#!/usr/bin/env python3
"""How well the embedded dataset tells trackers apart. Python's standard library alone.

    cargo build --release
    scripts/discriminate.py OUT [--real FOLDER] [--sample 300] [--seed 1] [--no-sweep]

OUT takes the run directories; what is there is not tracked again. Prints, as a Markdown table:

- of the sweep `--sm all --am all --ssm all` over the sequences tagged `quick`: the share of all trackers within 0.01 AUC of the
  best, the AUC of the best less that of the 20th, the standard deviation of the 50 best;
- on a seeded sample of the trackers and the 50 best of the sweep: Kendall's tau-b between `quick` and all embedded sequences;
  between each and the real sequences in FOLDER, tracked every 3rd and 6th frame; and, with the sequences drawn anew 200
  times (with replacement), the mean tau-b between a draw's ranking and the whole's.

AUC is pooled over frames throughout. A tracker that failed counts as it stands in the tables. `--no-sweep` takes `quick` from
the sample: fast, for a first look. The real sequences are not part of this repository: any folder that `mtf-eval run` takes.
"""
import argparse
import csv
import json
import os
import random
import statistics
import subprocess
import sys
from pathlib import Path

PROGRAM = os.environ.get("MTF_EVAL", str(Path(__file__).parent / "../target/release/mtf-eval"))


def program(*words):
    return subprocess.run([PROGRAM, *words], check=True, capture_output=True, text=True).stdout


def run(out, *words):
    """{tracker: {sequence: (frames, auc)}} of a run, tracked unless it is there."""
    if not (out / "sequences.csv").exists():
        print(f"tracking into {out}", file=sys.stderr)
        # Some units of a sweep may fail (20): they are in the tables.
        words = ["run", *words, "-q", "--frame-logs", "none", "--top", "1", "-o", str(out)]
        code = subprocess.run([PROGRAM, *words], stdout=subprocess.DEVNULL).returncode
        if code not in (0, 20):
            sys.exit(f"mtf-eval ended with code {code}")
    table = {}
    with open(out / "sequences.csv", newline="") as file:
        for row in csv.DictReader(file):
            name = row["sequence"] + ("@" + row["dataset"])
            value = (int(row["frames"] or 0), float(row["auc"] or 0))
            table.setdefault(row["tracker"], {})[name] = value
    return table


def valid():
    """All trackers without an illumination model."""
    rows = [line.split() for line in program("list", "trackers").splitlines()]
    names = [row[0] for row in rows if row[1:2] == ["yes"]]
    return [name for name in names if "+" not in name]


def auc(table, sequences=None):
    """{tracker: AUC pooled over the frames of `sequences`}, which may name one several times."""
    result = {}
    for tracker, row in table.items():
        cells = list(row.values()) if sequences is None else [row[s] for s in sequences if s in row]
        frames = sum(n for n, _ in cells)
        result[tracker] = sum(n * v for n, v in cells) / frames if frames else 0.0
    return result


def kendall(a, b):
    """Kendall's tau-b of two {tracker: value} over the trackers that both have."""
    names = [name for name in a if name in b]
    x, y = [a[n] for n in names], [b[n] for n in names]
    agree = tied_x = tied_y = 0
    for i in range(len(names)):
        for j in range(i):
            dx, dy = x[i] - x[j], y[i] - y[j]
            agree += (dx * dy > 0) - (dx * dy < 0)
            tied_x += dx == 0
            tied_y += dy == 0
    pairs = len(names) * (len(names) - 1) / 2
    scale = ((pairs - tied_x) * (pairs - tied_y)) ** 0.5
    return agree / scale if scale else 0.0


def stability(table, sequences, rng, draws=200):
    """Mean tau-b between the ranking on `sequences` and those on draws of as many with replacement."""
    whole = auc(table, sequences)
    best = sorted(whole, key=whole.get)[-100:]
    table = {name: table[name] for name in best}
    draw = lambda: auc(table, rng.choices(sequences, k=len(sequences)))
    return statistics.mean(kendall(draw(), whole) for _ in range(draws))


def main():
    arguments = argparse.ArgumentParser(usage=__doc__)
    arguments.add_argument("out", type=Path)
    arguments.add_argument("--real", type=Path)
    arguments.add_argument("--sample", type=int, default=300)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--no-sweep", action="store_true")
    a = arguments.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    rng = random.Random(a.seed)
    names = sorted(rng.sample(valid(), a.sample))
    lines = []
    if not a.no_sweep:
        every = ["--sm", "all", "--am", "all", "--ssm", "all"]
        sweep = auc(run(a.out / "quick", "--tag", "quick", *every))
        order = sorted(sweep.values(), reverse=True)
        near = sum(v >= order[0] - 0.01 for v in order)
        lines += [
            ("trackers of the sweep", f"{len(order)}"),
            ("within 0.01 of the best", f"{near} ({100 * near / len(order):.1f} %)"),
            ("AUC of the best", f"{order[0]:.3f} ({max(sweep, key=sweep.get)})"),
            ("best less 20th", f"{order[0] - order[19]:.3f}"),
            ("spread of the 50 best", f"{statistics.pstdev(order[:50]):.3f}"),
        ]
        top = sorted(sweep, key=sweep.get, reverse=True)[:50]
        names = sorted({*names, *top})
    trackers = [word for name in names for word in ("--tracker", name)]
    sample = run(a.out / "sample", *trackers)
    data = json.loads(program("data", "info", "builtin", "--format", "json"))["datasets"][0]["sequences"]
    quick = [row["sequence"] + "@builtin" for row in data if "quick" in row["tags"]]
    every = sorted(next(iter(sample.values())))
    lines.append(("tau of `quick` and all", f"{kendall(auc(sample, quick), auc(sample)):.3f}"))
    for what, of in (("`quick`", quick), ("all", every)):
        tau = stability(sample, of, rng)
        lines.append((f"tau of {what} and {what} with its sequences drawn anew, 100 best", f"{tau:.3f}"))
    for gap in (3, 6) if a.real else ():
        real = auc(run(a.out / f"real-{gap}", str(a.real), "--frame-gap", str(gap), *trackers))
        for what, of in (("`quick`", quick), ("all", every)):
            lines.append((f"tau of {what} and the real, gap {gap}", f"{kendall(auc(sample, of), real):.3f}"))
    print("| | |\n|---|--:|")
    for line in lines:
        print(f"| {line[0]} | {line[1]} |")


if __name__ == "__main__":
    main()
