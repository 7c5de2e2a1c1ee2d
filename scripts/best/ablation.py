"""Halves and doubles every constant and parameter of `best`, and tells what changes.

    python ablation.py FOLDER --program target/ablation/release/mtf-eval --constants constants.jsonl --out ablation.jsonl

The program is built with the feature `ablation`, which lets an environment variable override constants; the list of these
comes from the example `best_constants`. Each line of the output has one variant: its name and value, the
figures over all frames, and which sequences changed. What is there already is not done again; the table of all that is
there is printed in the end. Times are of the processor, decoding included, which all variants do alike.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from common import FIGURES, mean, track



def parameters(program):
    """The parameters of `best`, which users may choose, and their values."""
    text = subprocess.run([program, "list", "params", "--format", "json"], capture_output=True, text=True).stdout
    prefix = "composite.best."
    own = [p for p in json.loads(text) if p["parameter"].startswith(prefix)]
    return {p["parameter"].removeprefix(prefix): p["default"] for p in own}


def variants(constants, own):
    """Names, factors, values: half and twice of each."""
    plain = [(c["name"], c["value"], c["whole"]) for c in constants]
    plain += [(name, value, "." not in value) for name, value in own.items()]
    for name, value, whole in plain:
        for factor in (0.5, 2):
            changed = max(1, int(int(value) * factor)) if whole else float(value) * factor
            if changed != float(value):
                yield name, factor, changed


def key(row):
    return f"{row['name']} {row['factor']}"


def run(args, own, name, factor, value):
    tracker, constants = "best", ""
    if name in own:
        tracker = f"best{{{name}={value}}}"
    elif name:
        constants = f"{name}={value}"
    figures = track(args.program, args.folder, tracker, args.max_frames, args.threads, constants)
    return {"name": name, "factor": factor, "value": value, "each": figures} | mean(figures, list(figures))


def changed(row, plain):
    """Sequences whose figures differ in any digit; times apart."""
    same = lambda n: all(row["each"][n][f] == plain["each"][n][f] for f in FIGURES[:3])
    return [n for n in plain["each"] if not same(n)]


def table(rows, values):
    plain = rows[" 1"]
    yield f"{len(plain['each'])} sequences, {sum(f['frames'] for f in plain['each'].values())} frames: " + ", ".join(
        [f"{plain['sr_5']:.1%} within 5 px, {plain['sr_2']:.1%} within 2 px", f"mean error {plain['error']:.2f} px"]
        + [f"{plain['cpu_ms']:.1f} ms a frame with decoding"]
    )
    yield ""
    yield "| constant | value | half: 5 px, 2 px, error, ms, sequences | twice: 5 px, 2 px, error, ms, sequences |"
    yield "|---|---|---|---|"
    for name in dict.fromkeys(r["name"] for r in rows.values() if r["name"]):
        cells = []
        for factor in (0.5, 2):
            row = rows.get(f"{name} {factor}")
            if row is None:
                cells.append("")
                continue
            where = changed(row, plain)
            if not where:
                cells.append(f"{row['value']:g}: nothing changes")
                continue
            sr_5, sr_2 = (100 * (row[f] - plain[f]) for f in FIGURES[:2])
            error, ms = row["error"] - plain["error"], row["cpu_ms"] / plain["cpu_ms"] - 1
            cells.append(f"{row['value']:g}: {sr_5:+.1f}, {sr_2:+.1f}, {error:+.2f}, {ms:+.0%}, {len(where)}")
        yield f"| {name} | {values[name]} | {cells[0]} | {cells[1]} |"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--program", default="target/ablation/release/mtf-eval")
    parser.add_argument("--constants", default="constants.jsonl")
    parser.add_argument("--out", default="ablation.jsonl")
    parser.add_argument("--max-frames", type=int)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--only", nargs="*", help="names")
    args = parser.parse_args()
    out = Path(args.out)
    rows = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    rows = {key(row): row for row in rows}
    constants = [json.loads(line) for line in Path(args.constants).read_text().splitlines()]
    own = parameters(args.program)
    todo = [("", 1, None), *variants(constants, own)]
    for name, factor, value in todo:
        wanted = not args.only or not name or name in args.only
        if wanted and f"{name} {factor}" not in rows:
            try:
                row = run(args, own, name, factor, value)
            except RuntimeError as error:  # a parameter out of its range
                print(error, file=sys.stderr)
                continue
            rows[key(row)] = row
            with out.open("a") as file:
                file.write(json.dumps(row) + "\n")
    values = own | {c["name"]: c["value"] for c in constants}
    print("\n".join(table(rows, values)))


main()
