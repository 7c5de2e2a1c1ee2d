#!/usr/bin/env python3
"""field_figures.py TRUTH RESULT: figures of the field's benchmarks, computed with numpy from their published definitions.

Both files have a header and rows `frame ulx uly urx ury lrx lry llx lly`. The first frame does not count. Prints JSON. It
shares nothing with the program: polygons are clipped and homographies solved here.
"""
import json
import sys

import numpy as np


def load(path):
    rows = [line.split() for line in open(path) if line.strip()][1:]
    return {row[0]: np.array([float(x) for x in row[1:9]]).reshape(4, 2) for row in rows}


def area(p):
    x, y = p[:, 0], p[:, 1]
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def clip(subject, window):
    """Sutherland and Hodgman, both anticlockwise."""
    out = [np.asarray(p, float) for p in subject]
    for a, b in zip(window, np.roll(window, -1, axis=0)):
        points, out = out, []
        inside = lambda p: (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
        for p, q in zip(points, points[1:] + points[:1]):
            sp, sq = inside(p), inside(q)
            if sp >= 0:
                out.append(p)
            if sp * sq < 0:
                out.append(p + (q - p) * sp / (sp - sq))
        if not out:
            return np.zeros((0, 2))
    return np.array(out)


def iou(a, b):
    a = a if area(a) > 0 else a[::-1]
    b = b if area(b) > 0 else b[::-1]
    both = clip(a, b)
    inter = abs(area(both)) if len(both) > 2 else 0.0
    return inter / (abs(area(a)) + abs(area(b)) - inter)


def homography(a, b):
    rows = []
    for (x, y), (u, v) in zip(a, b):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y, -u])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y, -v])
    return np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)


def discrepancy(start, tracked, truth):
    between = homography(start, truth) @ np.linalg.inv(homography(start, tracked))
    square = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]], float)
    moved = np.c_[square, np.ones(4)] @ between.T
    return float(np.linalg.norm(square - moved[:, :2] / moved[:, 2:], axis=1).mean())


truth, result = load(sys.argv[1]), load(sys.argv[2])
names = list(truth)
start = truth[names[0]]
pairs = [(result[name], truth[name]) for name in names[1:]]
rms = lambda c, g: float(np.sqrt((np.linalg.norm(c - g, axis=1) ** 2).mean()))
al = np.array([rms(c, g) for c, g in pairs])
mcd = np.array([np.linalg.norm(c - g, axis=1).mean() for c, g in pairs])
cl = np.array([np.linalg.norm(c.mean(0) - g.mean(0)) for c, g in pairs])
overlap = np.array([iou(c, g) for c, g in pairs])
hd = np.array([discrepancy(start, c, g) for c, g in pairs])
best = np.array([min(rms(np.roll(c, -k, axis=0), g) for k in range(4)) for c, g in pairs])
relative = np.array([rms(c, g) / np.sqrt(abs(area(g))) for c, g in pairs])
normalised = np.array([np.linalg.norm((c.mean(0) - g.mean(0)) / np.ptp(g, axis=0)) for c, g in pairs])
share = lambda holds: float(np.mean(holds))
steps = lambda v, most, n: float(np.mean([np.mean(v <= most * k / n) for k in range(n + 1)]))
success = lambda n: float(np.mean([np.mean(overlap > k / n) for k in range(n + 1)]))
print(json.dumps({
    "summary": {
        "sr_1": share(al <= 1), "sr_5": share(al <= 5), "al_mean": float(np.minimum(al, 20).mean()),
        "al_median": float(np.median(al)), "mcd_mean": float(np.minimum(mcd, 20).mean()), "mcd_median": float(np.median(mcd)),
        "cl_median": float(np.median(cl)), "jaccard_mean": float((1 - overlap).mean()),
        "auc": float(np.mean([np.mean(al <= k / 5) for k in range(1, 101)])), "failures": int((al > 20).sum()),
    },
    "planartrack": {
        "P@5": share(al <= 5), "P@15": share(al <= 15), "S@30": share(hd <= 30), "best rotation P@5": share(best <= 5),
        "IoU > 0.8": share(overlap > 0.8), "IoU < 0.5": share(overlap < 0.5),
    },
    "pot": {
        "P@5": share(al <= 5), "P@15": share(al <= 15), "P area to 50": steps(al, 50, 50), "S@10": share(hd <= 10),
        "S area to 200": steps(hd, 200, 200),
    },
    "vot": {
        "average overlap": float(overlap.mean()), "accuracy": float(overlap.mean()), "failures per sequence": 0.0,
        "success area": success(100),
    },
    "tmt": {
        "SR@5": share(mcd <= 5), "SR@10": share(mcd <= 10), "SR area to 20": steps(mcd, 20, 100),
        "relative SR@0.1": share(relative <= 0.1),
    },
    "otb": {
        "success area": success(20), "precision@20": share(cl <= 20), "IoU > 0.5": share(overlap > 0.5),
        "normalised precision@0.2": share(normalised <= 0.2),
    },
}))
