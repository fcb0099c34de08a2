"""Straight segments of an image: detection, disparities, and matches with the segments of the next image.

Detectors: LSD (Grompone von Gioi et al., LSD: A fast line segment detector with a false detection control, PAMI 2010),
and edges by Canny (PAMI 1986) with the probabilistic Hough transform (Matas et al., CVIU 2000), refined to the
sub-pixel here. Due to the aperture problem, a tracked point on a straight edge may slide along it. So points are only
used to identify the segment, and the measurement is the segment as an infinite line.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.klt import Klt
from ispom.features.row_search import PointSearch
from ispom.geometry import Array
from ispom.types import Image, TrackStatus

Detector = Literal["lsd", "hough"]
SAMPLES = np.linspace(0.06, 0.94, 9)
"""Relative positions of the points along a segment that are tracked; without its ends, which are often occluded."""
CANNY = 1.2
"""Upper threshold of Canny, in standard deviations of the gradient; the lower one is half of it."""
MIN_CANNY = 40.0
"""Least value of that threshold [grey levels, sum of Sobel's mask], above the gradients of noise."""
PROFILE_HALF_PX, PROFILE_SAMPLES = 2.0, 17
"""Half length and number of the samples across a segment of Hough's."""
FOLLOW = Klt(window_px=15, levels=4, max_forward_backward_px=2.0)
"""The tracker of points on edges. They slide by about a pixel, so its forward-backward check is wide."""
MAX_DISTANCE_PX, MAX_BEYOND_PX = 2.0, 6.0
"""Largest distance of a tracked point from its segment, across it, and beyond its ends."""
MIN_COSINE = np.cos(np.radians(8.0))
"""Least cosine of the angle between a segment and its tracked points. Directions have a sign, which differs between
both sides of a bar."""
MIN_VOTES = 4
"""Least number of points on a matched segment, which must also be more than half of the tracked ones."""
MIN_DISPARITIES = 4
"""Least number of points of a segment with a disparity."""
MAX_BEND_PX = 1.0
"""Largest deviation from a linear change of the disparity along a segment, which a straight line has."""


def detect_segments(
    grey: Image, detector: Detector = "lsd", min_length_px: float = 20.0, most: int = 400
) -> NDArray[np.float32]:
    """Returns the longest segments (N, 2, 2) [px], directed so that the darker side is always on the same side."""
    if detector == "lsd":
        found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)[0]
        uv = np.zeros((0, 2, 2)) if found is None else np.asarray(found, float).reshape(-1, 2, 2)
    else:
        uv = _hough(grey, min_length_px)
    length = np.linalg.norm(uv[:, 1] - uv[:, 0], axis=1)
    order = np.argsort(-length, kind="stable")[:most]
    return uv[order[length[order] >= min_length_px]].astype(np.float32)


def _hough(grey: Image, min_length_px: float) -> Array:
    """Returns segments (N, 2, 2) of Canny's edges, refined."""
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0), np.uint8)
    gradients = [cv2.Sobel(smooth, cv2.CV_32F, *axis) for axis in ((1, 0), (0, 1))]
    upper = max(MIN_CANNY, CANNY * float(np.hypot(*(g.std() for g in gradients))))
    edges = cv2.Canny(smooth, upper / 2, upper)
    found = cv2.HoughLinesP(edges, 1, np.pi / 360, round(0.7 * min_length_px), None, min_length_px, 3)
    if found is None:
        return np.zeros((0, 2, 2))
    return _refined(smooth, np.asarray(found, float).reshape(-1, 2, 2))


def _refined(smooth: Image, uv: Array) -> Array:
    """Returns segments (N, 2, 2) fitted to the largest gradient across them, and directed by its sign."""
    along = uv[:, 1] - uv[:, 0]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    reach = PROFILE_HALF_PX * np.linspace(-1, 1, PROFILE_SAMPLES)
    at = uv[:, None, 0] + SAMPLES[:, None] * along[:, None]
    places = (
        (at[:, :, None] + reach[:, None] * across[:, None, None]).astype(np.float32).reshape(-1, PROFILE_SAMPLES, 2)
    )
    light = cv2.remap(smooth.astype(np.float32), places[..., 0], places[..., 1], cv2.INTER_LINEAR)
    slope = np.diff(light.reshape(*at.shape[:2], PROFILE_SAMPLES).astype(float), axis=2)
    sign = np.where(slope.sum(axis=(1, 2)) >= 0, 1.0, -1.0)
    slope = np.maximum(sign[:, None, None] * slope, 0)
    middle = 0.5 * (reach[1:] + reach[:-1])
    offset = (slope * middle).sum(axis=2) / np.maximum(slope.sum(axis=2), 1e-9)
    fit = np.polynomial.polynomial.polyfit(SAMPLES, offset.T, 1) if len(uv) else np.zeros((2, 0))
    ends = uv + np.stack([fit[0], fit[0] + fit[1]], axis=1)[..., None] * across[:, None]
    return np.where((sign < 0)[:, None, None], ends[:, ::-1], ends)


def samples_of(uv: Array) -> Array:
    """Returns points (N, S, 2) along segments (N, 2, 2)."""
    return uv[:, None, 0] + SAMPLES[:, None] * (uv[:, None, 1] - uv[:, None, 0])


def match_segments(
    before: Image, now: Image, old: Array, new: NDArray[np.float32], predicted: Array | None = None
) -> tuple[NDArray[np.int64], Array]:
    """Matches old segments (N, 2, 2) with new ones (M, 2, 2).

    Returns the index (N,) of the new segment, or -1, and the ends (N, 2, 2) of the tracked points' line, NaN where less
    than half of them were tracked. `predicted` (N, 2, 2): predicted ends; NaN where unknown.
    """
    match = np.full(len(old), -1)
    if not len(old):
        return match, np.zeros((0, 2, 2))
    count = len(SAMPLES)
    start = samples_of(old).reshape(-1, 2).astype(np.float32)
    expected = None if predicted is None else samples_of(predicted).reshape(-1, 2)
    guess = start if expected is None else np.where(np.isfinite(expected), expected, start).astype(np.float32)
    points, status = FOLLOW.track(before, now, start, guess)
    points = points.reshape(-1, count, 2).astype(float)
    alive = (status == TrackStatus.ALIVE).reshape(-1, count)

    ahead = new[:, 1] - new[:, 0].astype(float)
    length = np.linalg.norm(ahead, axis=1)
    ahead /= length[:, None]
    apart = points[:, None] - new[None, :, None, 0]
    beside = apart[..., 0] * ahead[:, None, 1] - apart[..., 1] * ahead[:, None, 0]
    within = apart[..., 0] * ahead[:, None, 0] + apart[..., 1] * ahead[:, None, 1]
    on = (
        (np.abs(beside) < MAX_DISTANCE_PX)
        & (within > -MAX_BEYOND_PX)
        & (within < length[:, None] + MAX_BEYOND_PX)
        & alive[:, None]
    )
    middle = np.where(alive[..., None], points, np.nan)
    followed = _fitted(middle)
    if not len(new):
        return match, followed
    chord = followed[:, 1] - followed[:, 0]
    chord /= np.maximum(np.linalg.norm(chord, axis=1), 1e-9)[:, None]
    straight = np.einsum("ni,mi->nm", chord, ahead) > MIN_COSINE
    votes = on.sum(axis=2) * straight
    off = np.where(on, np.abs(beside), 0).sum(axis=2) / np.maximum(votes, 1)
    score = np.where(
        (votes >= MIN_VOTES) & (2 * votes > alive.sum(axis=1)[:, None]), votes - off / MAX_DISTANCE_PX, -1.0
    )
    best = score.argmax(axis=1)
    rows = np.arange(len(old))
    mutual = (score.argmax(axis=0)[best] == rows) & (score[rows, best] > 0)
    return np.where(mutual, best, -1), followed


def _fitted(points: Array) -> Array:
    """Returns the ends (N, 2, 2) of lines fitted to points (N, S, 2), of which some are NaN; NaN where half of them
    are."""
    known = np.isfinite(points[..., 0])
    base = np.stack([1 - SAMPLES, SAMPLES], axis=1)
    normal = np.einsum("ns,si,sj->nij", known.astype(float), base, base) + 1e-9 * np.eye(2)
    side = np.einsum("si,nsj->nij", base, np.where(known[..., None], points, 0.0))
    return np.where((2 * known.sum(axis=1) > len(SAMPLES))[:, None, None], np.linalg.solve(normal, side), np.nan)


def disparity_along(left: Image, right: Image, uv: NDArray[np.float32]) -> tuple[Array, Array]:
    """Returns the disparities (N, 2) [px] at both ends of left segments (N, 2, 2), and their standard deviations.

    NaN where too few points of a segment are found in the right image, or where they are on no straight line.
    """
    ends, sigma = np.full((len(uv), 2), np.nan), np.full((len(uv), 2), np.nan)
    if not len(uv):
        return ends, sigma
    found = PointSearch().search(left, right, samples_of(uv).reshape(-1, 2).astype(np.float32))
    disparity = found.disparity_px.reshape(len(uv), -1).astype(float)
    error = np.maximum(found.deviations_px.reshape(len(uv), -1), 0.05)
    known = np.isfinite(disparity) & (disparity > 0) & np.isfinite(error)
    value = np.where(known, disparity, 0.0)
    weight = np.where(known, 1 / np.where(known, error, 1.0) ** 2, 0.0)
    base = np.stack([1 - SAMPLES, SAMPLES], axis=1)
    robust = weight
    for _ in range(5):
        normal = np.einsum("ns,si,sj->nij", robust, base, base) + 1e-9 * np.eye(2)
        fit = np.linalg.solve(normal, np.einsum("ns,si,ns->ni", robust, base, value)[..., None])[..., 0]
        residual = np.where(known, value - fit @ base.T, np.inf)
        robust = weight / (1 + np.minimum(np.abs(residual) / MAX_BEND_PX, 1e3) ** 4)
    on = np.abs(residual) < MAX_BEND_PX
    good = (on.sum(axis=1) >= MIN_DISPARITIES) & (2 * on.sum(axis=1) > known.sum(axis=1)) & np.all(fit > 0, axis=1)
    variance = np.diagonal(np.linalg.inv(normal), axis1=1, axis2=2)
    # Half of the points of a segment have the same errors, as neighbours share pixels.
    ends[good], sigma[good] = fit[good], np.sqrt(2 * variance[good])
    return ends, sigma
