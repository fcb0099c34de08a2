"""Whether a pair measures depth: it is taken where most of its points have a match in the right image that fits."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.integrated import checks
from ispom.types import Decision, Step, Tracks, TrackStatus

MIN_SHARE = 1 / 3
"""Ordinary pairs have 0.5 and more, those with half of the right image covered mostly 0.4 to 0.7. A right camera that
shows nothing, another moment, or what the left one should, leaves 0 to 0.25: points far away, and wrong matches."""
FEWEST = 30
"""The share is one of so many points at least: where nearly all are gone, those left agree by chance."""


def right_fits(part: Step) -> Decision:
    """Of a pair by the stereo method's Step.

    Without a right match a point says where the rig is, but not how far it went: a window of such pairs has no unit,
    and wrong matches give it one.
    """
    tracks = part.tracks.get("left", Tracks.of(np.zeros(0), np.zeros((0, 2))))
    matched, new = tracks.disparity_px > 0, tracks.status == TrackStatus.NEW
    old = tracks.status == TrackStatus.ALIVE
    judged = int((old | (tracks.status == TrackStatus.REPROJECTION)).sum())
    if judged:
        return checks.RIGHT_FITS.of(float((matched & old).sum() / max(judged, FEWEST)), MIN_SHARE)
    # Where stereo begins all points are new ones: nothing else is known that they could fit.
    return checks.RIGHT_FITS.of(float((matched & new).sum() > 0), MIN_SHARE)
