"""Detects exchanged left and right images: their disparities are negative."""

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
"""Least absolute disparity [px] that counts: that of far points may have the wrong sign, as rectification is no
better."""
DOUBTED_SHARE = 0.5
"""Share of points with a positive disparity below which a localised frame is checked. Ordinary frames have more, and
those with half of the right image covered mostly do."""


def exchanged(setup: Setup, new: NewPair) -> Decision | None:
    """Returns the failed check if left and right are exchanged, else None.

    In ordinary frames the ratio of negative to positive disparities is 0.01 to 0.06, by chance; in exchanged ones it is
    17 or more.
    """
    uv, width = corners(setup, new, PairPoints()), new.left.shape[1]
    mirrored = uv.copy()
    mirrored[:, 0] = width - 1 - uv[:, 0]
    left, right = (np.ascontiguousarray(image[:, ::-1]) for image in (new.left, new.right))
    behind, before = _clear(left, right, mirrored), _clear(new.left, new.right, uv)
    found = checks.IMAGES_EXCHANGED.of(behind, before)
    return found if behind >= setup.min_inliers and found.failed else None


def exchanged_since(setup: Setup, new: NewPair, sighting: TrackingResult) -> Decision | None:
    """Checks a localised frame like `exchanged`, if few disparities are positive.

    Such a frame was localised by its left image only, so its pose would be that of the right camera.
    """
    alive = sighting.status == TrackStatus.ALIVE
    judged = alive | (sighting.status == TrackStatus.REPROJECTION)
    fits = int((alive & (sighting.disparity_px > 0)).sum())
    return exchanged(setup, new) if fits < DOUBTED_SHARE * int(judged.sum()) else None


def _clear(left: NDArray[np.uint8], right: NDArray[np.uint8], uv: NDArray[np.float32]) -> int:
    """Returns the number of points (N, 2) [px] of the left image with a disparity of at least CLEAR_PX."""
    return int((PointSearch().search(left, right, uv).disparity_px >= CLEAR_PX).sum())
