"""Levels the pair where its right image finds few matches: at the start, and again where that fails later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ispom.estimators.modern.stereo.keyframe import corners
from ispom.estimators.modern.stereo.level import LEVEL_ROWS_PX, Measured, levelled, measured
from ispom.estimators.modern.stereo.pair import PairPoints, Setup, StereoImages
from ispom.estimators.modern.stereo.state import ModernStereoState, Outcome
from ispom.features.images import has_contrast
from ispom.features.row_search import PointSearch
from ispom.numerics.reductions import median
from ispom.types import TrackStatus

MATCHED_SHARE = 0.5
"""Least share of points with a right match in a pair that is taken for level without measuring its features. Level
pairs have more, and those with half of the right image covered mostly do."""
DOUBTED_ROWS_PX = LEVEL_ROWS_PX / 2
"""Median row offset [px] of the matches at the start up to which a pair is taken for level without measuring that."""


def on_level_pair(
    setup: Setup,
    state: ModernStereoState,
    given: StereoImages,
    advance: Callable[[ModernStereoState, StereoImages], Outcome],
) -> tuple[Outcome, StereoImages]:
    """Runs the algorithm (`advance`) on the level pair; where its right image does not fit, measures and corrects it.

    Returns the outcome, and the images from which it is.
    """
    images = levelled(setup, given, state.level)
    if not setup.self_calibration:
        return advance(state, images), images
    begun = bool(state.map.keys)
    outcome = advance(state, images) if begun else None
    fits = _start_fits(setup, images) if outcome is None else _fits(setup, outcome)
    level, decisions = (state.level.agreeing(), ()) if fits else state.level.after(_measured(setup, state, images))
    if (level.terms != state.level.terms).any():
        images, outcome = levelled(setup, given, level), None
    if outcome is None:
        outcome = advance(replace(state, level=level), images)
    outcome = replace(outcome, state=replace(outcome.state, level=level), decisions=(*decisions, *outcome.decisions))
    return outcome, images


def _measured(setup: Setup, state: ModernStereoState, images: StereoImages) -> Measured | None:
    """Returns the corrections that the features of a pair show; None if either image has no contrast, or if it is not
    due."""
    light = has_contrast(images.left, state.last.left) and has_contrast(images.right, images.left)
    return measured(setup, images, state.map.extra) if state.level.is_due and light else None


def _start_fits(setup: Setup, images: StereoImages) -> bool:
    """Returns whether most corners of a pair have a match on their row in the right image."""
    uv = corners(setup, images, PairPoints())
    lower_px = PointSearch().search(images.left, images.right, uv, images.halves).lower_px
    found = lower_px[np.isfinite(lower_px)]
    few = len(found) < max(MATCHED_SHARE * len(uv), setup.min_inliers)
    return not few and median(np.abs(found)) <= DOUBTED_ROWS_PX


def _fits(setup: Setup, outcome: Outcome) -> bool:
    """Returns whether a frame was localised, and most of its points have a right match."""
    tracked = outcome.tracked
    alive = tracked.status == TrackStatus.ALIVE
    judged = int((alive | (tracked.status == TrackStatus.REPROJECTION)).sum())
    matched = int((alive & np.isfinite(tracked.disparity_px)).sum())
    return tracked.inliers >= setup.min_inliers and matched >= MATCHED_SHARE * judged
