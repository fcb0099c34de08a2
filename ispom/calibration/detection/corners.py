"""Corners to a fraction of a pixel, each with its spread.

At every pixel p near a corner q the image gradient g is orthogonal to p - q, or zero (Forstner and Gulch 1987, which
cv2.cornerSubPix solves): q follows by least squares, and its spread from the noise of g.
"""

from __future__ import annotations

import cv2
import numpy as np

from ispom.geometry import Array
from ispom.types import Image

LEAST_RADIUS_PX, MOST_RADIUS_PX = 2, 11
EDGE_LENGTH = 1.25
"""Of the edges in a window, weighted, in its radii."""
EDGE_SHARE = 0.012
"""Edges are found to this share of their width, whatever the noise: measured on simulated images."""


def refined(grey: Image, uv: Array, radius_px: float) -> Array:
    """(N, 2) corners near uv (N, 2), of windows that reach `radius_px` to each side."""
    if not len(uv):
        return uv
    radius = int(np.clip(round(radius_px), LEAST_RADIUS_PX, MOST_RADIUS_PX))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3)
    start = np.ascontiguousarray(uv, np.float32).reshape(-1, 1, 2)
    return np.asarray(cv2.cornerSubPix(grey, start, (radius, radius), (-1, -1), criteria), float).reshape(-1, 2)


def spreads_px(grey: Image, uv: Array, radius_px: float) -> Array:
    """(N,) standard deviations of corners at uv (N, 2): from the image's noise, and from how wide the edges are.

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
