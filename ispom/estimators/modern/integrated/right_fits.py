"""Checks that a pair measures depth: most of its points must have a consistent match in the right image."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.integrated import checks
from ispom.types import Decision, Step, Tracks, TrackStatus

MIN_SHARE = 1 / 3
"""Least share of points with a consistent right match. Ordinary pairs have 0.5 and more, those with half of the right
image covered mostly 0.4 to 0.7. An empty right image, or one of another time or camera, leaves 0 to 0.25."""
FEWEST = 30
"""Least number of points over which the share is computed: a few remaining ones agree by chance."""


def right_fits(part: Step) -> Decision:
    """Checks the pair of a Step of the stereo method.

    Without a right match a point constrains the motion, but not its length: a window of such pairs has no scale, and
    wrong matches give it a wrong one.
    """
    tracks = part.tracks.get("left", Tracks.of(np.zeros(0), np.zeros((0, 2))))
    matched, new = tracks.disparity_px > 0, tracks.status == TrackStatus.NEW
    old = tracks.status == TrackStatus.ALIVE
    judged = int((old | (tracks.status == TrackStatus.REPROJECTION)).sum())
    if judged:
        return checks.RIGHT_FITS.of(float((matched & old).sum() / max(judged, FEWEST)), MIN_SHARE)
    # Where stereo begins, all points are new: there is nothing else to compare with.
    return checks.RIGHT_FITS.of(float((matched & new).sum() > 0), MIN_SHARE)
