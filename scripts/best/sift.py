"""OpenCV's SIFT with a homography by RANSAC, as a peer: the object of the first frame is found anew in every frame."""

import time

import cv2
import numpy as np

RATIO = 0.75  # of the nearest to the second nearest descriptor (Lowe 2004)
THRESHOLD = 3.0  # px


class Sift:
    def __init__(self, frame, corners):
        self.sift, self.matcher = cv2.SIFT_create(), cv2.BFMatcher(cv2.NORM_L2)
        mask = np.zeros_like(frame)
        cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 255)
        points, self.descriptors = self.sift.detectAndCompute(frame, mask)
        self.points = np.float32([p.pt for p in points])
        self.first = self.corners = corners

    def update(self, frame):
        """Corners in the frame; where they were when the object is not found."""
        points, descriptors = self.sift.detectAndCompute(frame, None)
        if self.descriptors is None or descriptors is None or len(points) < 2:
            return self.corners
        pairs = self.matcher.knnMatch(self.descriptors, descriptors, k=2)
        good = [a for a, b in pairs if a.distance < RATIO * b.distance]
        if len(good) >= 4:
            start = self.points[[m.queryIdx for m in good]]
            end = np.float32([points[m.trainIdx].pt for m in good])
            found, _ = cv2.findHomography(start, end, cv2.RANSAC, THRESHOLD)
            if found is not None:
                self.corners = cv2.perspectiveTransform(self.first[None].astype(float), found)[0]
        return self.corners


def track(folder):
    """Figures of a folder of frames with groundtruth.txt, as those of common.track."""
    cv2.setNumThreads(1)
    rows = [line.split() for line in (folder / "groundtruth.txt").read_text().splitlines()[1:]]
    truth = np.array([r[1:9] for r in rows], float).reshape(-1, 4, 2)
    read = lambda name: cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
    tracker = Sift(read(rows[0][0]), truth[0])
    errors, seconds = [], 0.0
    for row, true in zip(rows[1:], truth[1:]):
        frame = read(row[0])
        begin = time.thread_time()
        corners = tracker.update(frame)
        seconds += time.thread_time() - begin
        errors.append(np.sqrt(((corners - true) ** 2).sum() / 4))
    errors = np.array(errors)
    return {
        "frames": len(errors),
        "sr_5": float((errors <= 5).mean()),
        "sr_2": float((errors <= 2).mean()),
        "error": float(errors.mean()),
        "ms": 1e3 * seconds / len(errors),
        "cpu_ms": 1e3 * seconds / len(errors),
    }
