"""What table.py and ablation.py share: the sequences in groups, a run of `best` over them, means over a group."""

import csv
import os
import resource
import subprocess
import tempfile
from pathlib import Path

EMBEDDED = ["occlusion", "weak", "fast", "scale", "bending"]
HARDEST = ["nine-all", "nine-all-small", "nine-outside"]
FIGURES = ["sr_5", "sr_2", "error", "ms", "cpu_ms"]


def rendered(folder):
    return sorted(p.name for p in (Path(folder) / "hard").iterdir() if p.is_dir())


def groups(folder):
    """Names of the rows of the table, and the sequences of each."""
    names = rendered(folder)
    rows = {f"embedded {name}": [name] for name in EMBEDDED}
    rows["nine rendered"] = [n for n in names if n.startswith("nine")]
    rows["the three hardest of them"] = [n for n in names if n in HARDEST]
    rows["six others"] = [n for n in names if n.startswith("other")]
    return {row: members for row, members in rows.items() if members}


def track(program, folder, tracker="best", max_frames=None, threads=1, constants=""):
    """Figures of each sequence: frames, shares within 5 and 2 px, mean error (RMS corner distance, px), ms per frame.

    `cpu_ms` is the processor's time per frame of the whole run, decoding included: the same for all sequences.
    """
    with tempfile.TemporaryDirectory() as out:
        command = [program, "run", str(Path(folder) / "hard"), "builtin", "--tracker", tracker]
        command += ["--frame-logs", "none", "--progress", "none", "-q", "-j", str(threads), "--out", f"{out}/run"]
        for name in rendered(folder) + EMBEDDED:
            command += ["--seq", name]
        if max_frames:
            command += ["--max-frames", str(max_frames)]
        environment = os.environ | {"MTF_BEST_CONSTANTS": constants}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        read = lambda name: list(csv.DictReader(open(f"{out}/run/{name}")))
        figures = {}
        for row in read("sequences.csv"):
            figures[row["sequence"]] = {
                "frames": int(row["frames"]),
                "sr_5": float(row["sr_5"]),
                "sr_2": float(row["sr_2"]),
                "error": float(row["al_mean"]),
            }
        for row in read("timing.csv"):
            if row["sequence"] == "pooled":
                continue
            figures[row["sequence"]]["ms"] = 1e3 * float(row["seconds"]) / int(row["frames"])
        frames = sum(f["frames"] for f in figures.values())
        return {n: f | {"cpu_ms": 1e3 * seconds / frames} for n, f in figures.items()}


def mean(figures, names):
    """Means over all frames of some sequences."""
    frames = sum(figures[n]["frames"] for n in names)
    return {f: sum(figures[n][f] * figures[n]["frames"] for n in names) / frames for f in FIGURES}
