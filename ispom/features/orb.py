"""ORB (Rublee et al. 2011): corners of an image pyramid with binary descriptors, compared by Hamming distance."""

from __future__ import annotations

import cv2

from ispom.features.descriptors import (
    MAX_RATIO,
    OpenCvFeatures,
    SimilarityMatcher,
    descriptor_front_end,
    hamming_similarity,
)

BITS, MAX_BITS = 256, 50
"""Number of bits of a descriptor, and the largest Hamming distance of a match (TH_LOW of ORB-SLAM, Mur-Artal et al.
2015)."""
FAST_THRESHOLD = 10
"""Threshold of the FAST detector [grey levels]: between the 20 and the 7 that ORB-SLAM2 tries in turn (Mur-Artal and
Tardos 2017)."""


def _create(count: int) -> cv2.Feature2D:
    return cv2.ORB.create(nfeatures=count, fastThreshold=FAST_THRESHOLD)


ORB = OpenCvFeatures(_create, BITS // 8, keypoint_px=31.0)
ORB_MATCHER = SimilarityMatcher(hamming_similarity, 1 - 2 * MAX_BITS / BITS, MAX_RATIO)
FRONT_END = descriptor_front_end("orb", "Rublee et al. 2011", ORB, ORB_MATCHER)
