"""ORB as ORB-SLAM extracts it (Mur-Artal et al. 2015): FAST corners of cells, by a lower threshold where one has few.

`ispom run sim:tiny --methods monocular --monocular.features orb-slam`, or `--methods stereo --stereo.features orb-slam`
"""

from dataclasses import dataclass

import cv2
import numpy as np

import ispom

FAST_THRESHOLDS = 20, 7
"""Grey levels: the second one in cells where the first one finds nothing."""
CELL_PX = 35
LEVELS, SCALE_FACTOR = 8, 1.2
MAX_BITS = 50
"""Of the 256 of a descriptor, that may differ between two images of a point."""
NO_POINTS = np.zeros((0, 2), np.float32)


@dataclass(frozen=True)
class CellCorners:
    """The strongest corner of each cell that has room for one."""

    def detect(self, grey, count, occupied, min_distance_px):
        if not grey.size:
            return NO_POINTS
        found = list[tuple[float, float, float]]()
        for top in range(0, grey.shape[0], CELL_PX):
            for left in range(0, grey.shape[1], CELL_PX):
                found += in_cell(grey, left, top)
        chosen = [tuple(point) for point in occupied]
        for _, u, v in sorted(found, key=lambda corner: -corner[0]):
            if len(chosen) >= count:
                break
            if all((u - x) ** 2 + (v - y) ** 2 >= min_distance_px**2 for x, y in chosen):
                chosen.append((u, v))
        return np.array(chosen[len(occupied) :], np.float32).reshape(-1, 2)


def in_cell(grey, left, top):
    """Returns strength and position [px] of the corners in a cell."""
    cell = np.ascontiguousarray(grey[max(top - 3, 0) : top + CELL_PX + 3, max(left - 3, 0) : left + CELL_PX + 3])
    for threshold in FAST_THRESHOLDS:
        if corners := cv2.FastFeatureDetector.create(threshold).detect(cell, None):
            at = max(left - 3, 0), max(top - 3, 0)
            return [(corner.response, corner.pt[0] + at[0], corner.pt[1] + at[1]) for corner in corners]
    return []


def create(count):
    return cv2.ORB.create(count, SCALE_FACTOR, LEVELS, fastThreshold=FAST_THRESHOLDS[1])


DESCRIPTOR = ispom.OpenCvFeatures(create, length=32, keypoint_px=31.0)
MATCHER = ispom.SimilarityMatcher(ispom.hamming_similarity, 1 - 2 * MAX_BITS / 256, max_ratio=0.8)
FRONT_END = ispom.FrontEnd(
    name="orb-slam",
    reference="Mur-Artal et al. 2015",
    detector=CellCorners(),
    tracker=ispom.DescriptorTracker(DESCRIPTOR, DESCRIPTOR, MATCHER),
    guided=ispom.DescriptorTracker(DESCRIPTOR, DESCRIPTOR, MATCHER, guided=True),
    descriptor=DESCRIPTOR,
    matcher=MATCHER,
)
