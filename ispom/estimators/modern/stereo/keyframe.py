"""Decides when a frame becomes a keyframe, and finds its new points; detects exchanged left and right images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.localise import LocalisedFrame
from ispom.estimators.modern.stereo.pair import PairPoints, Setup, StereoImages, TrackingResult
from ispom.estimators.modern.stereo.state import ModernStereoState, StereoMap
from ispom.features.row_search import PointSearch
from ispom.features.shi_tomasi import at_subpixel
from ispom.geometry import Array
from ispom.numerics.places import common
from ispom.numerics.reductions import lengths, median
from ispom.types import Decision, TrackStatus

CORNER_DISTANCE_PX = 8.0
"""Least distance [px] of a new corner from other points: patches of 11 pixels would show nearly the same."""
CANDIDATES = 1.8
"""Number of corners detected, relative to those needed: nearly half have a match that is less accurate than most."""
MAX_OVER_MEDIAN = 1.3
"""Largest standard deviation of a new disparity, and largest difference of its patches, relative to the median. The
predicted deviations agree with the errors from 0.03 px to ten times that. A patch that shows two surfaces is biased
towards the nearer one, and differs by more than the sensor's noise. All points get the same weight and covariance, so
their accuracy must be similar."""
ALIKE_GREY = 2.0
"""Difference of patches [grey levels] below which all count as equally good: the noise of a camera at its best."""
ALIKE_PX = 0.03
"""Standard deviation [px] below which matches count as equally good: noise-free images would keep only their best."""
CORNER_RADIUS_PX, CORNER_STEPS = 3, 5
"""Radius [px] and number of steps of the sub-pixel refinement of a corner."""
CLEAR_PX = 1.0
"""Least absolute disparity [px] that counts: that of far points may have the wrong sign, as rectification is no
better."""
DOUBTED_SHARE = 0.5
"""Share of points with a positive disparity below which a localised frame is checked. Ordinary frames have more, and
those with half of the right image covered mostly do."""


def keyframe_tests(setup: Setup, world: StereoMap, points: PairPoints) -> tuple[Decision, ...]:
    """Returns the checks for a keyframe: large displacement, few of the last keyframe's points left; none at first."""
    if not world.keys:
        return ()
    last, camera = world.keys[-1], setup.camera
    old, new = common(last.ids, points.ids)
    flow = (camera.normalise(points.uv[new]) - last.seen[old, :2]) * camera.fx
    displacement = median(lengths(flow)) if len(new) else 0.0
    share = len(new) / max(len(last.ids), 1)
    return (
        checks.DISPLACEMENT.of(displacement, setup.min_parallax_px),
        checks.POINTS_LEFT.of(share, setup.min_share),
    )


def corners(setup: Setup, images: StereoImages, points: PairPoints, share: float = 1.0) -> NDArray[np.float32]:
    """Detects corners (N, 2) [px] in the left image, which complete the points to `share` times `max_tracks`."""
    count = int(share * setup.max_tracks)
    found = setup.front_end.detector.detect(images.left, count, points.uv, CORNER_DISTANCE_PX)
    return at_subpixel(images.left, found, CORNER_RADIUS_PX, CORNER_STEPS)


def new_points(setup: Setup, state: ModernStereoState, frame: LocalisedFrame) -> PairPoints:
    """Detects corners between the present points, and keeps those with an accurate disparity."""
    images, uv = frame.images, corners(setup, frame.images, frame.points, CANDIDATES)
    matches = PointSearch().search(images.left, images.right, uv, images.halves)
    found = np.flatnonzero(np.isfinite(matches.disparity_px))
    if len(found) > setup.min_inliers:
        accurate = _similar_to_most(matches.deviations_px[found], ALIKE_PX)
        found = found[accurate & _similar_to_most(matches.differences[found], ALIKE_GREY)]
    found = found[: max(setup.max_tracks - len(frame.points), 0)]
    ids = state.next_id + np.arange(len(found))
    return PairPoints(ids, uv[found], matches.disparity_px[found], matches.slants[found])


def _similar_to_most(values: Array, least: float) -> NDArray[np.bool_]:
    """Returns a mask (N,) of the values that do not much exceed the median, or `least`."""
    return np.asarray(values <= MAX_OVER_MEDIAN * max(median(values), least))


def start_obstacles(setup: Setup, images: StereoImages, count: int) -> tuple[Decision, ...]:
    """Returns why a frame with `count` new points cannot start a map; empty if it can."""
    wrong = exchanged(setup, images)
    few = checks.DEPTH_POINTS.of(count, setup.min_inliers, "waiting for the next pair")
    return (wrong,) if wrong is not None else (few,) if few.failed else ()


def exchanged(setup: Setup, images: StereoImages) -> Decision | None:
    """Returns the failed check if left and right are exchanged, else None.

    In ordinary frames the ratio of negative to positive disparities is 0.01 to 0.06, by chance; in exchanged ones it is
    17 or more.
    """
    uv, width = corners(setup, images, PairPoints()), images.left.shape[1]
    mirrored = uv.copy()
    mirrored[:, 0] = width - 1 - uv[:, 0]
    left, right = (np.ascontiguousarray(image[:, ::-1]) for image in (images.left, images.right))
    behind, before = _clear(left, right, mirrored), _clear(images.left, images.right, uv)
    found = checks.IMAGES_EXCHANGED.of(behind, before)
    return found if behind >= setup.min_inliers and found.failed else None


def exchanged_since(setup: Setup, images: StereoImages, tracked: TrackingResult) -> Decision | None:
    """Checks a localised frame like `exchanged`, if few disparities are positive.

    Such a frame was localised by its left image only, so its pose would be that of the right camera.
    """
    alive = tracked.status == TrackStatus.ALIVE
    judged = alive | (tracked.status == TrackStatus.REPROJECTION)
    fits = int((alive & (tracked.disparity_px > 0)).sum())
    return exchanged(setup, images) if fits < DOUBTED_SHARE * int(judged.sum()) else None


def _clear(left: NDArray[np.uint8], right: NDArray[np.uint8], uv: NDArray[np.float32]) -> int:
    """Returns the number of points (N, 2) [px] of the left image with a disparity of at least CLEAR_PX."""
    return int((PointSearch().search(left, right, uv).disparity_px >= CLEAR_PX).sum())
