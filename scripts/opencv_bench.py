"""Times OpenCV's planar trackers on a folder of frames with groundtruth.txt, and prints lines of JSON as
`mtf-eval bench --against` reads them.

    python opencv_bench.py FOLDER [PASSES]

Both get gray frames with a Gaussian blur of 5x5, sigma 3, made beforehand like those of `mtf-eval bench`; only the search
is timed, the least over the passes for each frame, on one thread, in time of the processor. ECC: findTransformECC with a
50x50 template, searching the surroundings of the object only, which is several times faster than searching the whole
frame. LK: 10x10 points by calcOpticalFlowPyrLK and RANSAC, from frame to frame.
"""

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

ITERATIONS, EPSILON = 30, 1e-4
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ITERATIONS, EPSILON)
SIDE = 50
AROUND = 40  # px around the object that ECC searches


def load(folder):
    frames, truth = [], []
    for line in (Path(folder) / "groundtruth.txt").read_text().splitlines()[1:]:
        name, *numbers = line.split()
        gray = cv2.imread(str(Path(folder) / name), cv2.IMREAD_GRAYSCALE)
        frames.append(cv2.GaussianBlur(gray, (5, 5), 3))
        truth.append(np.array(numbers, float).reshape(4, 2))
    return frames, truth


def square(side):
    return np.float32([[0, 0], [side, 0], [side, side], [0, side]])


def move(homography, points):
    return cv2.perspectiveTransform(points.reshape(-1, 1, 2).astype(float), homography).reshape(-1, 2)


class Ecc:
    tracker, name = "falk/zncc/homography", "findTransformECC 50x50"

    def __init__(self, frame, corners):
        self.warp = cv2.getPerspectiveTransform(square(SIDE - 1), corners.astype(np.float32))
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        self.template = cv2.warpPerspective(frame, self.warp, (SIDE, SIDE), flags=flags)
        self.corners = corners

    def update(self, frame):
        height, width = frame.shape
        left, top = np.maximum(self.corners.min(0) - AROUND, 0).astype(int)
        right, bottom = np.minimum(self.corners.max(0) + AROUND, [width, height]).astype(int)
        shift = np.array([[1, 0, left], [0, 1, top], [0, 0, 1]], float)
        start = (np.linalg.inv(shift) @ self.warp).astype(np.float32)
        part = frame[top:bottom, left:right]
        _, found = cv2.findTransformECC(self.template, part, start, cv2.MOTION_HOMOGRAPHY, CRITERIA, None, 1)
        self.warp = shift @ found
        self.corners = move(self.warp, square(SIDE - 1))
        return self.corners


class Flow:
    tracker, name = "grid(flow)", "calcOpticalFlowPyrLK 10x10, RANSAC"

    def __init__(self, frame, corners):
        self.frame, self.corners = frame, corners

    def update(self, frame):
        at = np.linspace(0.05, 0.95, 10)
        unit = np.stack(np.meshgrid(at, at), -1).reshape(-1, 2)
        to_image = cv2.getPerspectiveTransform(square(1), self.corners.astype(np.float32))
        points = move(to_image, unit).astype(np.float32)
        moved, found, _ = cv2.calcOpticalFlowPyrLK(
            self.frame, frame, points, None, winSize=(21, 21), maxLevel=3, criteria=CRITERIA
        )
        good = found.ravel() == 1
        step, _ = cv2.findHomography(points[good], moved[good], cv2.RANSAC, 2.0)
        if step is None:
            raise cv2.error("no homography")
        self.frame, self.corners = frame, move(step, self.corners)
        return self.corners


def measure(kind, frames, truth, passes):
    best = np.full(len(frames) - 1, np.inf)
    for index in range(passes + 1):  # the first one warms up
        tracker = kind(frames[0], truth[0])
        good = done = 0
        for i, (frame, true) in enumerate(zip(frames[1:], truth[1:])):
            try:
                begin = time.thread_time()
                corners = tracker.update(frame)
                seconds = time.thread_time() - begin
            except cv2.error as error:  # it has lost the object: the rest are failures
                print(f"{kind.name}, frame {i + 1}: {error}", file=sys.stderr)
                break
            done += 1
            good += np.sqrt(((corners - true) ** 2).sum() / 4) <= 5
            if index > 0:
                best[i] = min(best[i], seconds)
    if done == 0:
        return
    times = 1e6 * best[:done]
    row = {
        "tracker": kind.tracker,
        "program": f"OpenCV {cv2.__version__} {kind.name}",
        "frames": done,
        "us_per_frame": times.mean(),
        "us_median": np.median(times),
        "us_p95": np.quantile(times, 0.95),
        "fps": 1e6 / times.mean(),
        "sr_5": good / (len(frames) - 1),
    }
    print(json.dumps(row, default=float), flush=True)


def main():
    cv2.setNumThreads(1)
    frames, truth = load(sys.argv[1])
    passes = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    for kind in (Ecc, Flow):
        measure(kind, frames, truth, passes)


main()
