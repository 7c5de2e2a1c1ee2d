"""Times OpenCV's planar trackers on a folder of frames with groundtruth.txt, and prints lines of JSON as
`mtf-eval bench --against` reads them.

    python opencv_bench.py FOLDER [PASSES]

Frames are gray and not filtered, because they are as all programs shall see them. Only the search is timed, the least over
the passes for each frame, on one thread, in time of the processor; a value of every cache line of the frame is read before.

ECC: findTransformECC with a 50x50 template, searching the surroundings of the object only, which is several times faster
than searching the whole frame. Its own rule stops it by the correlation. So that it does the same work as mtf-eval, each
frame is first tracked with 1, 2, 3, ... iterations from the same start, untimed, until the corners move by as little as
makes mtf-eval stop; that number is then timed. A second line is for ten iterations in every frame.

LK: 10x10 points by calcOpticalFlowPyrLK and RANSAC, from frame to frame, with OpenCV's stop rule for each point. Its
pyramids are made within the time.
"""

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

# As `max_iters` and `epsilon` of mtf-eval: px^2, summed over the eight coordinates of the corners.
ITERATIONS, STILL = 30, 1e-4
FIXED_ITERATIONS = 10
FLOW_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01)
SIDE = 50
AROUND = 40  # px around the object that ECC searches


def load(folder):
    frames, truth = [], []
    for line in (Path(folder) / "groundtruth.txt").read_text().splitlines()[1:]:
        name, *numbers = line.split()
        gray = cv2.imread(str(Path(folder) / name), cv2.IMREAD_GRAYSCALE)
        frames.append(gray)
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

    def iterations_to_stop(self, frame):
        start = self.warp, self.corners
        before = self.corners
        for n in range(1, ITERATIONS):
            self.warp, self.corners = start
            after = self.update(frame, n)
            self.warp, self.corners = start
            if ((before - after) ** 2).sum() < STILL:
                return n
            before = after
        return ITERATIONS

    def update(self, frame, iterations):
        height, width = frame.shape
        left, top = np.maximum(self.corners.min(0) - AROUND, 0).astype(int)
        right, bottom = np.minimum(self.corners.max(0) + AROUND, [width, height]).astype(int)
        shift = np.array([[1, 0, left], [0, 1, top], [0, 0, 1]], float)
        start = (np.linalg.inv(shift) @ self.warp).astype(np.float32)
        part = frame[top:bottom, left:right]
        criteria = (cv2.TERM_CRITERIA_COUNT, iterations, 0)
        _, found = cv2.findTransformECC(self.template, part, start, cv2.MOTION_HOMOGRAPHY, criteria, None, 1)
        self.warp = shift @ found
        self.corners = move(self.warp, square(SIDE - 1))
        return self.corners


class Flow:
    tracker, name = "grid(flow)", "calcOpticalFlowPyrLK 10x10, RANSAC"

    def __init__(self, frame, corners):
        self.frame, self.corners = frame, corners

    def update(self, frame, _iterations):
        at = np.linspace(0.05, 0.95, 10)
        unit = np.stack(np.meshgrid(at, at), -1).reshape(-1, 2)
        to_image = cv2.getPerspectiveTransform(square(1), self.corners.astype(np.float32))
        points = move(to_image, unit).astype(np.float32)
        moved, found, _ = cv2.calcOpticalFlowPyrLK(
            self.frame, frame, points, None, winSize=(21, 21), maxLevel=3, criteria=FLOW_CRITERIA
        )
        good = found.ravel() == 1
        step, _ = cv2.findHomography(points[good], moved[good], cv2.RANSAC, 2.0)
        if step is None:
            raise cv2.error("no homography")
        self.frame, self.corners = frame, move(step, self.corners)
        return self.corners


def touch(frame):
    return frame.reshape(-1)[::64].sum()


def measure(kind, frames, truth, passes, iterations):
    """Times `iterations` in every frame: `fixed`, `stop` for the stop rule, or None where the tracker has its own."""
    counts = np.full(len(frames) - 1, FIXED_ITERATIONS)
    best = np.full(len(frames) - 1, np.inf)
    for index in range(passes + 1):  # the first one warms up
        tracker = kind(frames[0], truth[0])
        errors = np.full(len(frames) - 1, np.inf)
        done = 0
        for i, (frame, true) in enumerate(zip(frames[1:], truth[1:])):
            try:
                if index == 0 and iterations == "stop":
                    counts[i] = tracker.iterations_to_stop(frame)
                touch(frame)
                begin = time.thread_time()
                corners = tracker.update(frame, int(counts[i]))
                seconds = time.thread_time() - begin
            except cv2.error as error:  # it has lost the object: the rest are failures
                print(f"{kind.name}, frame {i + 1}: {error}", file=sys.stderr)
                break
            done += 1
            errors[i] = np.sqrt(((corners - true) ** 2).sum() / 4)
            if index > 0:
                best[i] = min(best[i], seconds)
    if done == 0:
        return
    times = 1e6 * best[:done]
    row = {
        "tracker": kind.tracker + ("{epsilon=0,max_iters=10}" if iterations == "fixed" else ""),
        "program": f"OpenCV {cv2.__version__} {kind.name}",
        "frames": done,
        "us_per_frame": times.mean(),
        "us_median": np.median(times),
        "us_p95": np.quantile(times, 0.95),
        "fps": 1e6 / times.mean(),
        "sr_5": np.mean(errors <= 5),
    }
    if np.isfinite(np.median(errors)):
        row["al_median"] = np.median(errors)
    if iterations is not None:
        row["iterations"] = counts[:done].mean()
        row["us_per_iteration"] = times.sum() / counts[:done].sum()
    print(json.dumps(row, default=float), flush=True)


def blur(frames):
    """What a Gaussian of 5x5 costs here, which is not in any other time."""
    least = np.inf
    for frame in frames:
        touch(frame)
        begin = time.thread_time()
        cv2.GaussianBlur(frame, (5, 5), 3)
        least = min(least, time.thread_time() - begin)
    print(f"before the updates, a frame: OpenCV {cv2.__version__} filter 5x5 {1e6 * least:.0f} us", file=sys.stderr)


def main():
    cv2.setNumThreads(1)
    frames, truth = load(sys.argv[1])
    passes = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    blur(frames)
    measure(Ecc, frames, truth, passes, "stop")
    measure(Ecc, frames, truth, passes, "fixed")
    measure(Flow, frames, truth, passes, None)


main()
