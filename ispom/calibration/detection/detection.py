"""The detected points of a target in one image, and their refinement to a fraction of a pixel.

At every pixel p near a corner q the image gradient g is orthogonal to p - q, or zero (Forstner and Gulch 1987, which
cv2.cornerSubPix solves): q follows by least squares, and its standard deviation from the noise of g. Corners of a black
quadrilateral follow from its four edges: blur rounds a corner, and leaves the edges in place.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Image


@dataclass(frozen=True, eq=False)
class Detection:
    """The target's points in one image; without any where `reason` explains why the image is not used."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) increasing indices of the target's points."""
    uv: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) [px]."""
    sigma_px: Array = field(default_factory=lambda: np.zeros(0))
    """(N,) standard deviation of each coordinate, from the consistency of the edges around the corner."""
    reason: str = ""
    """Why nothing of the image is used; empty where it is."""
    rejected: tuple[tuple[int, str], ...] = ()
    """(id, reason) of single points that were detected and are not used."""

    def __len__(self) -> int:
        return len(self.ids)

    def only(self, keep: NDArray[np.bool_], reason: str = "") -> Detection:
        """Without the points where `keep` (N,) is false, which are rejected for `reason`."""
        more = tuple((int(i), reason) for i in self.ids[~keep])
        return Detection(self.ids[keep], self.uv[keep], self.sigma_px[keep], self.reason, self.rejected + more)

    @staticmethod
    def of(ids: NDArray[np.integer], uv: Array, sigma_px: Array) -> Detection:
        """Ordered by id."""
        order = np.argsort(ids)
        return Detection(np.asarray(ids, np.int64)[order], np.asarray(uv, float)[order], sigma_px[order])


LEAST_RADIUS_PX, MOST_RADIUS_PX = 2, 11
EDGE_LENGTH = 1.25
"""Weighted length of the edges in a window, in its radii."""
EDGE_SHARE = 0.012
"""Edges are found to this share of their width, whatever the noise: measured on simulated images."""


def refined(grey: Image, uv: Array, radius_px: float) -> Array:
    """Refines corners uv (N, 2) in windows that reach `radius_px` to each side."""
    if not len(uv):
        return uv
    radius = int(np.clip(round(radius_px), LEAST_RADIUS_PX, MOST_RADIUS_PX))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3)
    start = np.ascontiguousarray(uv, np.float32).reshape(-1, 1, 2)
    return np.asarray(cv2.cornerSubPix(grey, start, (radius, radius), (-1, -1), criteria), float).reshape(-1, 2)


def spreads_px(grey: Image, uv: Array, radius_px: float) -> Array:
    """Returns standard deviations (N,) of corners at uv (N, 2): from the image's noise, and from the width of the
    edges.

    Infinite where the image is flat.
    """
    if not len(uv):
        return np.zeros(0)
    radius = int(np.clip(round(radius_px), LEAST_RADIUS_PX, MOST_RADIUS_PX))
    reach = np.arange(-radius, radius + 1)
    dx, dy = (d.ravel() for d in np.meshgrid(reach, reach))
    centre = np.round(uv).astype(int)
    x, y = (centre[:, :1] + dx).clip(1, grey.shape[1] - 2), (centre[:, 1:] + dy).clip(1, grey.shape[0] - 2)
    image = grey.astype(np.float32)
    gx, gy = (image[y, x + 1] - image[y, x - 1]) / 2, (image[y + 1, x] - image[y - 1, x]) / 2
    weight = np.exp(-(dx**2 + dy**2) / radius**2)
    xx, xy, yy = ((weight * g).sum(1) for g in (gx * gx, gx * gy, gy * gy))
    # Noise n of a gradient pulls the corner by g (n (p - q)).
    lever = (weight**2) * ((x - uv[:, :1]) ** 2 + (y - uv[:, 1:]) ** 2)
    pull_xx, pull_xy, pull_yy = ((lever * g).sum(1) for g in (gx * gx, gx * gy, gy * gy))
    determinant = np.maximum(xx * yy - xy * xy, 1e-9)
    trace = (yy**2 + xy**2) * pull_xx - 2 * xy * (xx + yy) * pull_xy + (xx**2 + xy**2) * pull_yy
    noise_px = noise_level(grey) * np.sqrt(trace / 4) / determinant
    # An edge of contrast c and width e has the gradient c / e over e pixels.
    contrast = np.percentile(image[y, x], 95, axis=1) - np.percentile(image[y, x], 5, axis=1)
    weakest = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    edge_px = contrast**2 * EDGE_LENGTH * radius / np.maximum(weakest, 1e-9)
    return np.where(contrast > 4 * noise_level(grey), np.hypot(noise_px, EDGE_SHARE * edge_px), np.inf)


def noise_level(grey: Image) -> float:
    """Standard deviation of an image's noise [grey levels], by the median of what a Laplacian leaves (Immerkaer 1996),
    0.5 at least: that of rounding, and of what compression hides."""
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    left = cv2.filter2D(grey, cv2.CV_32F, kernel)[1:-1, 1:-1]
    return max(0.5, float(np.median(np.abs(left[::2, ::2]))) / 0.6745 / 6)


PROFILES = 14
"""Cuts across each edge,"""
FROM, TO = 0.06, 0.5
"""along this part of it, from the corner on: a lens bends the whole of it too much for a line,"""
REACH = 0.1
"""this far to each side, of the shorter side: within the tag's black border."""
STEP_PX = 0.5
"""Distance of samples of a cut."""
PEAK_PX = 2.0
"""Distance from its steepest position within which an edge is used."""
ROUNDS = 3


def outlined(grey: Image, corners: Array) -> Array:
    """(4, 2) where lines through the edges of the quadrilateral near corners (4, 2) meet."""
    for _ in range(ROUNDS):
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        reach = max(2.0, REACH * float(sides.min()))
        around = [(corners[i], corners[i - 1], corners[(i + 1) % 4]) for i in range(4)]
        corners = np.array([_meeting(_edge(grey, at, a, reach), _edge(grey, at, b, reach)) for at, a, b in around])
        if not np.isfinite(corners).all():
            return np.full((4, 2), -1.0)
    return corners


def _edge(grey: Image, start: Array, end: Array, reach: float) -> tuple[Array, Array]:
    """Returns a point (2,) and the direction (2,) of the line between dark and light near the first half of start to
    end."""
    along = end - start
    normal = np.array([along[1], -along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
    offsets = np.arange(-reach, reach + STEP_PX / 2, STEP_PX)
    feet = start + np.linspace(FROM, TO, PROFILES)[:, None] * along
    places = (feet[:, None] + offsets[:, None] * normal).astype(np.float32)
    cut = cv2.remap(grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slope, between = np.abs(np.diff(cut.astype(float), axis=1)), (offsets[1:] + offsets[:-1]) / 2
    steepest = between[slope.argmax(axis=1)]
    weight = np.where(np.abs(between - steepest[:, None]) <= PEAK_PX, slope, 0)
    total = weight.sum(1)
    good = total > 0.3 * np.median(total)
    if good.sum() < 4:
        return np.full(2, np.nan), along
    points = feet[good] + (((weight * between).sum(1) / np.maximum(total, 1e-9))[good, None]) * normal
    vx, vy, x, y = np.ravel(cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01)).tolist()
    return np.array([x, y]), np.array([vx, vy])


def _meeting(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """(2,) where two lines cross; not finite where they do not."""
    matrix = np.column_stack([one[1], -other[1]])
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-6:
        return np.full(2, np.nan)
    return one[0] + np.linalg.solve(matrix, other[0] - one[0])[0] * one[1]
