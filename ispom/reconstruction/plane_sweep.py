"""Dense depth of one camera's image from others of known pose: planes parallel to it, swept through the scene.

Collins 1996; each plane's homography maps the other images onto the reference, where the normalised correlation of
small windows measures their agreement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.cameras import resampling
from ispom.geometry import Array, Pose
from ispom.reconstruction.depth import Depth
from ispom.types import Camera, Image, as_grey

Float = NDArray[np.float32]


@dataclass(frozen=True)
class PlaneSweep:
    """Pixels without agreement of half of the other images, or with an ambiguous depth, are unknown."""

    planes: int = 96
    """At equal steps of inverse depth, from infinity on."""
    window_px: int = 7
    """Side of the windows that are compared."""
    min_correlation: float = 0.8
    unique: float = 0.03
    """Least difference of the correlation from that of planes that are not next to the best one."""
    min_contrast: float = 4.0
    """Standard deviation of a window [grey levels] below which a pixel is unknown."""
    sigma_px: float = 0.2
    """Standard deviation of a window's position, and"""
    max_error: float = 0.03
    """the share by which that may put a depth off: less parallax leaves a pixel unknown, as at the epipole."""

    def depth(
        self, image: Image, others: Sequence[tuple[Image, Pose]], camera: Camera, nearest_m: float, farthest_m: float
    ) -> Depth:
        """z (H, W) [m] of the image (H, W[, 3]) of a camera without distortion; `others` of the same camera, each with
        other_from_image."""
        inverse_depths = np.linspace(0, 1 / nearest_m, self.planes)  # farther surfaces need a plane, too
        reference = _Windows.of(as_grey(image).astype(np.float32), self.window_px)
        scores = np.empty((self.planes, *reference.mean.shape), np.float32)
        greys = [as_grey(other).astype(np.float32) for other, _ in others]
        for k, inverse_depth in enumerate(inverse_depths):
            each = [
                reference.correlation(_on_plane(grey, camera, pose, inverse_depth), self.window_px, self.min_contrast)
                for grey, (_, pose) in zip(greys, others, strict=True)
            ]
            # Half of the images may be occluded there.
            scores[k] = np.sort(np.stack(each), axis=0)[len(each) // 2 :].mean(axis=0)
        best, step = _peak(scores)
        good = (scores.max(axis=0) > self.min_correlation) & (reference.spread > self.min_contrast)
        good &= _rival(scores, best) < scores.max(axis=0) - self.unique
        best_inverse = (best + step) * inverse_depths[1]
        good &= (best_inverse > 1 / farthest_m) & (best < self.planes - 1)
        parallax = np.max([_px_per_inverse_depth(camera, pose, best_inverse) for _, pose in others], axis=0)
        good &= self.sigma_px < self.max_error * best_inverse * parallax
        return np.where(good, 1 / np.maximum(best_inverse, 1 / farthest_m), 0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Undistortion:
    """Makes images of a camera without distortion, with the same focal lengths and centre."""

    ideal: Camera
    """That camera."""
    maps: tuple[NDArray, NDArray]

    @staticmethod
    def of(camera: Camera) -> Undistortion:
        """Computes what all images of the camera share."""
        ideal = replace(camera, distortion=(), lens="opencv")
        return Undistortion(ideal, resampling(camera, ideal, np.eye(3)))

    def image(self, image: Image) -> Image:
        """Returns the image as the ideal camera has it."""
        return np.asarray(cv2.remap(image, *self.maps, cv2.INTER_LINEAR), np.uint8)


@dataclass(frozen=True, eq=False)
class _Windows:
    """An image with the mean and the standard deviation of the window around each pixel."""

    grey: Float
    mean: Float
    spread: Float

    @staticmethod
    def of(grey: Float, side: int) -> _Windows:
        mean = _blurred(grey, side)
        return _Windows(grey, mean, np.sqrt(np.maximum(_blurred(grey * grey, side) - mean * mean, 0)))

    def correlation(self, grey: Float, side: int, least: float) -> Float:
        """Returns the normalised correlation (H, W) of each window with that of another image; -1 where that is
        outside of it (NaN) or flat."""
        inside = np.isfinite(grey)
        other = _Windows.of(np.where(inside, grey, 0), side)
        both = _blurred(self.grey * other.grey, side) - self.mean * other.mean
        coefficient = both / np.maximum(self.spread * other.spread, least**2 / 4)
        whole = cv2.erode(inside.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        return np.where(whole, coefficient, -1).astype(np.float32)


def _on_plane(grey: Float, camera: Camera, other_from_image: Pose, inverse_depth: float) -> Float:
    """Returns the other image by a plane z = 1 / inverse depth of the reference; NaN outside."""
    k, r, t = camera.matrix, other_from_image.rotation, other_from_image.translation
    homography = k @ (r + inverse_depth * np.outer(t, [0, 0, 1.0])) @ np.linalg.inv(k)
    size, flags = (camera.width, camera.height), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpPerspective(grey, homography, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan),
        np.float32,
    )


def _peak(scores: Float) -> tuple[NDArray[np.int64], Float]:
    """Returns the best plane (H, W), and the offset of the maximum of the parabola through its neighbours, in steps."""
    best = scores.argmax(axis=0)
    inner = np.clip(best, 1, len(scores) - 2)[None]
    before, here, after = (np.take_along_axis(scores, inner + d, axis=0)[0] for d in (-1, 0, 1))
    bend = before - 2 * here + after
    return best, np.clip(0.5 * (before - after) / np.where(bend < -1e-6, bend, -1e-6), -0.5, 0.5)


def _rival(scores: Float, best: NDArray[np.int64]) -> Float:
    """Returns the highest score (H, W) two planes or more away from the best one."""
    out = np.full(best.shape, -1, np.float32)
    for k, plane in enumerate(scores):
        np.maximum(out, np.where(np.abs(best - k) > 2, plane, -1), out=out)
    return out


def _px_per_inverse_depth(camera: Camera, other_from_image: Pose, inverse_depth: Array) -> Array:
    """Returns the velocity (H, W) [px m] of a pixel's position in the other image with its inverse depth (H, W)."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    ray = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    t = other_from_image.translation
    q = ray @ other_from_image.rotation.T + inverse_depth[..., None] * t
    z = np.maximum(q[..., 2], 1e-6)
    along = (t[:2] - q[..., :2] / z[..., None] * t[2]) / z[..., None]
    return np.hypot(camera.fx * along[..., 0], camera.fy * along[..., 1])


def _blurred(values: Float, side: int) -> Float:
    return np.asarray(cv2.blur(values, (side, side)), np.float32)
