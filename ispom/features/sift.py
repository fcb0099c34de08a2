"""SIFT (Lowe 2004), as RootSIFT (Arandjelovic & Zisserman 2012): matches images that are metres apart."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.descriptors import MAX_RATIO, OpenCvFeatures, SimilarityMatcher, descriptor_front_end, dot_product

MIN_SIMILARITY = 0.8
"""Least dot product of the unit descriptors of a match."""


def _create(count: int) -> cv2.Feature2D:
    return cv2.SIFT.create(nfeatures=count, contrastThreshold=0.02)


def _root(descriptors: NDArray) -> NDArray[np.float32]:
    return np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9)).astype(np.float32)


SIFT = OpenCvFeatures(_create, 128, keypoint_px=6.0, normalised=_root)
SIFT_MATCHER = SimilarityMatcher(dot_product, MIN_SIMILARITY, MAX_RATIO**2)
FRONT_END = descriptor_front_end("sift", "Lowe 2004; Arandjelovic & Zisserman 2012", SIFT, SIFT_MATCHER)
