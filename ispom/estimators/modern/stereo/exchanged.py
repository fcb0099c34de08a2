"""Whether left and right are exchanged: what both cameras see then lies farther right in the right image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.key_frame import corners
from ispom.estimators.modern.stereo.pair import NewPair, PairPoints, TrackingResult
from ispom.estimators.modern.stereo.setup import Setup
from ispom.features.row_search import PointSearch
from ispom.types import Decision, TrackStatus

CLEAR_PX = 1.0
"""Least disparity to either side: what is far away may lie on the wrong one, as no pair is rectified any better."""
DOUBTED_SHARE = 0.5
"""A pair located by points of which fewer have a match that fits is looked at: ordinary ones have more, and pairs with
half of the right image covered mostly do."""


def exchanged(setup: Setup, new: NewPair) -> Decision | None:
    """That left and right are exchanged; None where they are not.

    Of ordinary pairs 0.01 to 0.06 times as many corners have a match farther right as farther left, by chance; of
    exchanged ones 17 times and more.
    """
    uv, width = corners(setup, new, PairPoints()), new.left.shape[1]
    mirrored = uv.copy()
    mirrored[:, 0] = width - 1 - uv[:, 0]
    left, right = (np.ascontiguousarray(image[:, ::-1]) for image in (new.left, new.right))
    behind, before = _clear(left, right, mirrored), _clear(new.left, new.right, uv)
    found = checks.IMAGES_EXCHANGED.of(behind, before)
    return found if behind >= setup.min_inliers and found.failed else None


def exchanged_since(setup: Setup, new: NewPair, sighting: TrackingResult) -> Decision | None:
    """The same of a pair that was located: by its left image alone, so that its place is the right camera's."""
    alive = sighting.status == TrackStatus.ALIVE
    judged = alive | (sighting.status == TrackStatus.REPROJECTION)
    fits = int((alive & (sighting.disparity_px > 0)).sum())
    return exchanged(setup, new) if fits < DOUBTED_SHARE * int(judged.sum()) else None


def _clear(left: NDArray[np.uint8], right: NDArray[np.uint8], uv: NDArray[np.float32]) -> int:
    """How many points (N, 2) [px] of the left image are clearly found farther left in the right one."""
    return int((PointSearch().search(left, right, uv).disparity_px >= CLEAR_PX).sum())
