"""A pair located: does one other rigid motion explain the points that its pose does not?"""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.motions import LEAST, MARKED, told
from ispom.estimators.modern.stereo.pair import PairPoints, Sighting
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.window import StereoMap
from ispom.solvers.multiview.resection import resect
from ispom.types import Decision, Tracks

INLIER = 4.0
"""A point agrees with the other motion within so many widths of the loss: 0.7 px at the default, where the pose lets
points be off by 2.5. What is off by little more than that, alike in a part of the image, is no thing that moves."""


def other_motion(
    setup: Setup, world: StereoMap, points: PairPoints, sighting: Sighting
) -> tuple[tuple[Decision, ...], Tracks | None]:
    """Whether one other motion carries those of the last pair's points (N,) that end here as no still ones, as the map
    had them, to where they are seen now; and those it explains, None where it is not told. Too few are not asked."""
    located = sighting.located
    if located is None:
        return (), None
    ended = sighting.took_part[~located.inliers]
    count = len(sighting.took_part)
    if len(ended) < max(LEAST, MARKED * count):
        return (), None
    x = setup.camera.normalise(sighting.uv[ended])
    found = resect(world.xyz[sighting.place[ended]], x, INLIER * setup.loss)
    explained = np.zeros(len(ended), bool) if found is None else found.inliers
    test, of = told(explained, count), ended[explained]
    moved = Tracks.of(points.ids[of], sighting.uv[of], uv_prev=points.uv[of], disparity_px=sighting.disparity_px[of])
    return (test,), None if test.passed else moved
