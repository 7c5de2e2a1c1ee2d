"""Prints the table of `best` in Markdown, and of OpenCV's SIFT beside it.

    python table.py FOLDER [--program target/release/mtf-eval] [--tracker best] [--no-peer] [--each]
"""

import argparse
from pathlib import Path

from common import groups, mean, rendered, track


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--program", default="target/release/mtf-eval")
    parser.add_argument("--tracker", default="best")
    parser.add_argument("--no-peer", action="store_true")
    parser.add_argument("--each", action="store_true", help="a row for each rendered sequence, too")
    args = parser.parse_args()
    columns = [(args.tracker, track(args.program, args.folder, args.tracker))]
    if not args.no_peer:
        import sift

        folders = {n: Path(args.folder) / "hard" / n for n in rendered(args.folder)}
        columns.append(("SIFT", {n: sift.track(f) for n, f in folders.items()}))
    heads = [f"{name}: {what}" for name, _ in columns for what in ("≤ 5 px", "≤ 2 px", "error, px", "ms")]
    print("| | " + " | ".join(heads) + " |")
    print("|---" * (len(heads) + 1) + "|")
    rows = groups(args.folder)
    if args.each:
        rows |= {n: [n] for n in rendered(args.folder)}
    for row, names in rows.items():
        cells = []
        for _, figures in columns:
            if all(n in figures for n in names):
                m = mean(figures, names)
                cells += [f"{m['sr_5']:.0%}", f"{m['sr_2']:.0%}", f"{m['error']:.2f}", f"{m['ms']:.1f}"]
            else:
                cells += [""] * 4
        print(f"| {row} | " + " | ".join(cells) + " |", flush=True)


main()
