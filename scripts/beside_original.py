#!/usr/bin/env python3
"""Accuracy beside the C++ original: the paper's forms and this program's own, on the same sequences.

    scripts/beside_original.py REFERENCE.csv DATA [--program mtf-eval] [--out FOLDER]

REFERENCE.csv holds what the original scored, a row for a tracker on a sequence, with the columns sm, am, ssm (short names
of the original), seq, gap (every gap-th frame), sr2, sr5, mean_al_cap20 (mean alignment error, each frame capped at 20 px;
the first frame is not counted). DATA is the folder of these sequences. Both forms of each tracker run, `--paper`
and default, with 50x50 samples, at most 30 iterations and a Gaussian of 5x5, as there. Prints a Markdown table of means
over sequences, grouped by search method and by appearance model.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

# The original's names of what is called otherwise here. Its shipped `lms` and `ransac` track points by pyramidal flow.
METHODS = {"pysm": "pyes", "lms": "flow, lmeds", "ransac": "flow, ransac"}
WARPS = {
    "2": "translation", "3": "isometry", "3s": "ist", "4": "similitude", "4s": "ast", "5": "asrt", "6": "affine",
    "8": "homography", "c8": "cbh", "l6": "lieaffine", "l8": "liehomography", "sl3": "sl3",
}  # fmt: skip
FIGURES = ("SR@2", "SR@5", "AL")


def reference(path):
    """Figures of the original by (sm, am, ssm) in our names, then by sequence."""
    rows = defaultdict(dict)
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            if row["gap"] == "1":
                tracker = METHODS.get(row["sm"], row["sm"]), row["am"], WARPS[row["ssm"]]
                figures = row["sr2"], row["sr5"], row["mean_al_cap20"]
                rows[tracker][row["seq"]] = [float(f) for f in figures]
    return rows


def expression(tracker):
    sm, am, ssm = tracker
    if sm.startswith("flow, "):
        return f"flow{{ssm={ssm},estimator={sm[6:]}}}"
    return f"{sm}/{am}/{ssm}"


def key(name):
    """The (sm, am, ssm) of a tracker's name in our tables."""
    if name.startswith("flow"):
        return "flow, lmeds" if "lmeds" in name else "flow, ransac", "ssd", "homography"
    return tuple(name.split("{")[0].split("/"))


def ours(program, data, trackers, out, paper):
    """Figures of this program, as those of `reference`."""
    command = [program, "run", data, "--out", out, "--quiet", "--frame-logs", "none"]
    command += ["--paper"] if paper else []
    for tracker in trackers:
        command += ["--tracker", expression(tracker)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL)
    if done.returncode not in (0, 20):
        sys.exit(f"the run in {out} ended with {done.returncode}")
    rows = defaultdict(dict)
    with open(Path(out) / "sequences.csv", newline="") as file:
        for row in csv.DictReader(file):
            figures = row["sr_2"], row["sr_5"], row["al_mean"]
            rows[key(row["tracker"])][row["sequence"]] = [float(f) if f else 0.0 for f in figures]
    return rows


def mean(rows, trackers, sequences):
    figures = [rows[t][s] for t in trackers for s in sequences if s in rows[t]]
    if not figures:
        return "| - " * len(FIGURES)
    means = [sum(column) / len(figures) for column in zip(*figures)]
    return "".join(f"| {m:.3f} " for m in means[:-1]) + f"| {means[-1]:.2f} "


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("reference")
    parser.add_argument("data")
    parser.add_argument("--program", default="target/release/mtf-eval")
    parser.add_argument("--out", help="folder of the two runs [default: a temporary one]")
    args = parser.parse_args()
    original = reference(args.reference)
    trackers = sorted(original)
    sequences = sorted({s for rows in original.values() for s in rows})
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(args.out or temporary)
        paper = ours(args.program, args.data, trackers, str(out / "paper"), True)
        own = ours(args.program, args.data, trackers, str(out / "own"), False)
    groups = [(f"`{sm}`", [t for t in trackers if t[0] == sm]) for sm in dict.fromkeys(t[0] for t in trackers)]
    lucas_kanade = [t for t in trackers if t[0] in ("esm", "fclk", "falk", "iclk") and t[2] == "homography"]
    groups += [
        (f"`{am}`, ESM FCLK FALK ICLK", [t for t in lucas_kanade if t[1] == am])
        for am in sorted({t[1] for t in lucas_kanade})
    ]
    groups += [
        (f"`{ssm}`, ESM ICLK, ncc ssd", [t for t in trackers if t[2] == ssm and t[0] in ("esm", "iclk") and t[1] in ("ncc", "ssd")])
        for ssm in sorted({t[2] for t in trackers})
    ]
    forms = ("original", "paper's form", "default")
    print("| trackers | |" + "".join(f" {form}: {f} |" for form in forms for f in FIGURES))
    print("|---|--:|" + "--:|" * (len(forms) * len(FIGURES)))
    for name, members in groups:
        cells = "".join(mean(rows, members, sequences) for rows in (original, paper, own))
        print(f"| {name} | {len(members)} {cells}|")


main()
