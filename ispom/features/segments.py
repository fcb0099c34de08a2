"""Straight segments of an image: detection, disparities, and matches with the segments of the next image.

Detectors: LSD (Grompone von Gioi et al., LSD: A fast line segment detector with a false detection control, PAMI 2010);
edges by Canny (PAMI 1986) with the probabilistic Hough transform (Matas et al., CVIU 2000); and the same edges, whose
chains are split into straight pieces (Douglas and Peucker 1973). The last two are refined to the sub-pixel here. Due to
the aperture problem, a tracked point on a straight edge may slide along it. So points are only used to identify the
segment, and the measurement is the segment as an infinite line.
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

Detector = Literal["lsd", "hough", "canny"]
SAMPLES = np.linspace(0.06, 0.94, 9)
"""Relative positions of the points along a segment that are tracked; without its ends, which are often occluded."""
CANNY = 1.2
"""Upper threshold of Canny, in standard deviations of the gradient; the lower one is half of it."""
MIN_CANNY = 40.0
"""Least value of that threshold [grey levels, sum of Sobel's mask], above the gradients of noise."""
PROFILE_HALF_PX, PROFILE_SAMPLES = 2.0, 17
"""Half length and number of the samples of the light across a segment, by which it is refined."""
EDGE_POINTS = np.linspace(0.03, 0.97, 33)
"""Relative positions of the points along a segment at which the edge is measured; corners are at its ends."""
REFINEMENTS = 4
"""Times that a segment is measured: each leaves about two fifths of the offset, four a fortieth of it."""
OFF_EDGE_PX = 0.7
"""A point so far from the others' median is not on the edge: something covers it, or another edge is near."""
VOTES = 0.7
"""Least share of a segment's pixels that are on an edge."""
MIN_COSINE_ACROSS = np.cos(np.radians(22.5))
"""Least cosine between the gradient on an edge and the direction across it: LSD takes the same angle."""
HOUGH_GAP_PX = 6
"""Largest gap between edge pixels on a line of Hough's. An edge of whole pixels has steps, and leaves the line that is
followed: of 160 sides of drawn, turned quadrangles 14 are missed with 3 px, and one with 6 or 8."""
CHAIN_PX = 1.5
"""Largest distance of a chain of edge pixels from its straight pieces; whole pixels are off by half of one."""
SAME_PX = 1.0
"""Segments nearer than this are of one edge: a chain of pixels runs along both of its sides."""
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
        uv = _of_edges(grey, detector, min_length_px)
    length = np.linalg.norm(uv[:, 1] - uv[:, 0], axis=1)
    order = np.argsort(-length, kind="stable")[:most]
    return uv[order[length[order] >= min_length_px]].astype(np.float32)


def _of_edges(grey: Image, detector: Detector, min_length_px: float) -> Array:
    """Returns segments (N, 2, 2) of Canny's edges, refined."""
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0), np.uint8)
    gradients = [np.asarray(cv2.Sobel(smooth, cv2.CV_32F, *axis), np.float32) for axis in ((1, 0), (0, 1))]
    upper = max(MIN_CANNY, CANNY * float(np.hypot(*(g.std() for g in gradients))))
    edges = np.asarray(cv2.Canny(smooth, upper / 2, upper), np.uint8)
    if detector == "canny":
        found = _pieces(edges, min_length_px)
    else:
        votes = round(VOTES * min_length_px)
        lines = cv2.HoughLinesP(edges, 1, np.pi / 360, votes, None, min_length_px, HOUGH_GAP_PX)
        found = np.zeros((0, 2, 2)) if lines is None else np.asarray(lines, float).reshape(-1, 2, 2)
    refined = _refined(smooth, found)
    # Canny adds both components of the gradient, which is up to sqrt(2) times its length.
    return _once(refined[_on_edge(gradients, refined, upper / 2 / 2**0.5)])


def _on_edge(gradients: list[NDArray[np.float32]], uv: Array, least: float) -> NDArray[np.bool_]:
    """Checks which segments (N, 2, 2) lie along an edge: the gradient of at least VOTES of their points is `least` or
    more, and points across the segment to the same side. A line of Hough's may join edge pixels of a texture."""
    along = uv[:, 1] - uv[:, 0]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    at = (uv[:, None, 0] + EDGE_POINTS[:, None] * along[:, None]).astype(np.float32)
    gradient = np.stack([_remapped(g, at) for g in gradients], axis=2).astype(float)
    beside = np.einsum("npi,ni->np", gradient, across)
    steep = (beside >= least) & (beside >= MIN_COSINE_ACROSS * np.linalg.norm(gradient, axis=2))
    return steep.mean(axis=1) >= VOTES


def _pieces(edges: Image, min_length_px: float) -> Array:
    """Returns the straight pieces (N, 2, 2) of the chains of edge pixels."""
    chains, _ = cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    found = [np.zeros((0, 2, 2))]
    for chain in chains:
        if len(chain) >= min_length_px:
            corners = cv2.approxPolyDP(chain, CHAIN_PX, True).reshape(-1, 2).astype(float)
            pieces = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            found.append(pieces[np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1) >= min_length_px])
    return np.concatenate(found)


def _once(uv: Array) -> Array:
    """Returns the segments (N, 2, 2) without those that lie on a longer one of the same direction."""
    length = np.linalg.norm(uv[:, 1] - uv[:, 0], axis=1)
    order = np.argsort(-length, kind="stable")
    uv, length = uv[order], length[order]
    ahead = (uv[:, 1] - uv[:, 0]) / length[:, None]
    apart = uv[None] - uv[:, None, None, 0]
    along = np.einsum("ijek,ik->ije", apart, ahead)
    across = np.abs(apart[..., 0] * ahead[:, None, None, 1] - apart[..., 1] * ahead[:, None, None, 0])
    on = (across < SAME_PX) & (along > -MAX_BEYOND_PX) & (along < length[:, None, None] + MAX_BEYOND_PX)
    same = on.all(axis=2) & (ahead @ ahead.T > MIN_COSINE)
    return uv[~np.triu(same, 1).any(axis=0)]


def _refined(smooth: Image, uv: Array) -> Array:
    """Returns segments (N, 2, 2) fitted by least squares to the points where the light changes most across them, and
    directed by the sign of that change.

    What is measured on both sides of a segment is cut off at the same distance, so that a segment beside its edge is
    pulled only a part of the way: it is measured again from there.
    """
    for _ in range(REFINEMENTS):
        uv = _measured(smooth, uv)
    return uv


def _measured(smooth: Image, uv: Array) -> Array:
    """Returns the segments (N, 2, 2) as measured once."""
    along = uv[:, 1] - uv[:, 0]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    reach = PROFILE_HALF_PX * np.linspace(-1, 1, PROFILE_SAMPLES)
    at = uv[:, None, 0] + EDGE_POINTS[:, None] * along[:, None]
    places = at[:, :, None] + reach[:, None] * across[:, None, None]
    flat = places.astype(np.float32).reshape(-1, PROFILE_SAMPLES, 2)
    light = _remapped(smooth.astype(np.float32), flat)
    slope = np.diff(light.reshape(*at.shape[:2], PROFILE_SAMPLES).astype(float), axis=2)
    sign = np.where(slope.sum(axis=(1, 2)) >= 0, 1.0, -1.0)
    slope = np.maximum(sign[:, None, None] * slope, 0)
    middle = 0.5 * (reach[1:] + reach[:-1])
    offset = (slope * middle).sum(axis=2) / np.maximum(slope.sum(axis=2), 1e-9)
    fit = _straight(offset)
    ends = uv + fit[..., None] * across[:, None]
    return np.where((sign < 0)[:, None, None], ends[:, ::-1], ends)


def _straight(offset: Array) -> Array:
    """Returns the offsets (N, 2) at both ends of the lines through offsets (N, P) at EDGE_POINTS."""
    weight = (np.abs(offset - np.median(offset, axis=1, keepdims=True)) < OFF_EDGE_PX).astype(float)
    base = np.stack([1 - EDGE_POINTS, EDGE_POINTS], axis=1)
    normal = np.einsum("np,pi,pj->nij", weight, base, base) + 1e-9 * np.eye(2)
    return np.linalg.solve(normal, np.einsum("np,pi,np->ni", weight, base, offset)[..., None])[..., 0]


def _remapped(image: NDArray[np.float32], places: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns values (R, S) at places (R, S, 2), bilinear. OpenCV takes maps of at most 32767 rows."""
    parts = [np.zeros((0, places.shape[1]), np.float32)]
    for start in range(0, len(places), 30_000):
        part = places[start : start + 30_000]
        parts.append(np.asarray(cv2.remap(image, part[..., 0], part[..., 1], cv2.INTER_LINEAR), np.float32))
    return np.concatenate(parts)


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
