"""Points of the left image that the reference's left image shows as well, and the cloud of those with a depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.stereo.state import Cloud
from ispom.features.interfaces import Features
from ispom.features.klt import Klt
from ispom.features.row_search import RowSearch
from ispom.features.shi_tomasi import detect_corners
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.types import Image, Rig, TrackStatus

Matching = Literal["sift", "klt"]
REFINE = Klt(window_px=15, levels=0, max_forward_backward_px=0.3)
"""Detectors place a point anew in every image, tenths of a pixel beside itself; this finds the same place again."""
MATCHER = replace(SIFT_MATCHER, max_ratio=0.9**2)
"""Takes more of the ambiguous matches than usual: RANSAC finds the motion, and matches must fit it in depth, too."""
MAX_REFINEMENT_PX = 1.0
"""A detector is off by tenths of a pixel: what is found farther away is another place."""

MIN_DISPARITY_PX = 1.0
"""A smaller disparity says no more than that the point is far."""


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Points of one left image, and how they go on from the reference."""

    features: Features
    ids: NDArray[np.int64]
    previous: NDArray[np.int64]
    """(N,) index in the reference cloud, or -1."""
    ended: NDArray[np.uint8]
    """Of each reference point: ALIVE where found again, or why not."""
    next_id: int


def correspondences(
    reference: Cloud | None, left: Image, matching: Matching, most: int, next_id: int
) -> Correspondences:
    """Of at most about `most` points of the left image; those that are new get ids from `next_id` on."""
    find = _described if matching == "sift" else _tracked
    features, previous, ended = find(reference, left, most)
    known = previous >= 0
    ids = np.full(len(previous), -1, np.int64)
    if reference is not None:
        ids[known] = reference.ids[previous[known]]
    ids[~known] = next_id + np.arange((~known).sum())
    return Correspondences(features, ids, previous, ended, next_id + int((~known).sum()))


def _described(
    reference: Cloud | None, left: Image, most: int
) -> tuple[Features, NDArray[np.int64], NDArray[np.uint8]]:
    """SIFT features, matched and refined; points that were tracked, and have no descriptors, are tracked once more."""
    features = SIFT.detect_and_describe(left, most)
    if reference is not None and not reference.features.described:
        return _followed(reference, left, lambda _: features)
    previous = np.full(len(features), -1, np.int64)
    if reference is None:
        return features, previous, np.zeros(0, np.uint8)
    pairs, ended = MATCHER.match(reference.features, features), np.full(len(reference), TrackStatus.UNMATCHED, np.uint8)
    previous[pairs[:, 1]] = pairs[:, 0]
    ended[pairs[:, 0]] = TrackStatus.ALIVE
    return _refined(reference, left, features, pairs), previous, ended


def _tracked(reference: Cloud | None, left: Image, most: int) -> tuple[Features, NDArray[np.int64], NDArray[np.uint8]]:
    """Points tracked by KLT, and new corners between them."""

    def between(uv: NDArray[np.float32]) -> Features:
        fresh = detect_corners(left, most - len(uv), uv)
        return Features(fresh, np.zeros((len(fresh), 0), np.float32))

    return _followed(reference, left, between)


def _followed(
    reference: Cloud | None, left: Image, between: Callable[[NDArray[np.float32]], Features]
) -> tuple[Features, NDArray[np.int64], NDArray[np.uint8]]:
    """The reference's points as KLT finds them, then new ones that are chosen knowing those."""
    uv, ended, previous = np.zeros((0, 2), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.int64)
    if reference is not None:
        uv, ended = Klt(levels=4).track(reference.grey, left, reference.features.uv)
        previous = np.flatnonzero(ended == TrackStatus.ALIVE)
        uv = uv[previous]
    fresh = between(uv)
    return fresh.after(uv), np.concatenate([previous, np.full(len(fresh), -1, np.int64)]), ended


def _refined(reference: Cloud, left: Image, features: Features, pairs: NDArray[np.int64]) -> Features:
    """The features with matched ones moved to where the patch about their partner is found, if that is near."""
    detected = features.uv[pairs[:, 1]]
    found, status = REFINE.track(reference.grey, left, reference.features.uv[pairs[:, 0]], detected)
    near = (status == TrackStatus.ALIVE) & (np.linalg.norm(found - detected, axis=1) < MAX_REFINEMENT_PX)
    uv = features.uv.copy()
    uv[pairs[near, 1]] = found[near]
    return replace(features, uv=uv)


def triangulated(rig: Rig, left: Image, right: Image, found: Correspondences) -> tuple[Cloud, NDArray[np.bool_]]:
    """The cloud, and which (N,) of the points are in it."""
    disparity, _ = RowSearch().disparity(left, right, found.features.uv)
    has_depth = disparity >= MIN_DISPARITY_PX
    features = found.features[has_depth]
    xyz = points_from_disparity(rig.camera("left"), rig.baseline_m, features.uv, disparity[has_depth])
    return Cloud(left, found.ids[has_depth], features, disparity[has_depth], xyz), has_depth
