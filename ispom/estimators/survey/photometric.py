"""The relative pose of two images from their intensities, for the methods `direct` and `hybrid`.

Points of a reference image have a depth. A pose carries the small patches around them into another image, where their
intensities should be those of the reference, up to one gain and one offset of the whole image. Gauss-Newton finds the
pose from coarse to fine over an image pyramid: inverse compositional (Baker and Matthews 2004), with the weights of a
t-distribution whose scale is measured in each iteration (Kerl, Sturm and Cremers 2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.kernels import kernel, part, read_only
from ispom.numerics.reductions import median
from ispom.numerics.robust import MAD
from ispom.types import Camera, Image

SMALLEST_SIDE_PX = 20
"""Shorter side of the smallest image of a pyramid, at least."""
MAX_LEVELS = 6
FREEDOM = 5.0
"""Degrees of freedom of the t-distribution of residuals: Kerl 2013 measured this on real images."""
LEAST_SCALE = 1.0
"""Least standard deviation of a residual [grey levels]: noise of the camera and of interpolation."""
START_SCALE = 20.0
"""Width of the loss [grey levels] by which guesses are compared: the contrast of a contour of the scene."""
LEAST_SEEN = 0.3
"""Share of the reference's pixels that must lie inside of the image: a pose that sees fewer is no candidate."""
GAINS = 0.3, 3.0
"""Smallest and largest gain: beyond, one of the images is saturated or black."""
MIN_CORRELATION = 0.7
"""Least correlation of a patch with the image at its predicted position. With less, the patch is occluded, or shows
something else."""
GOOD, FOLLOWED = 0.6, 3
"""Share of similar patches from which no other guess is tried, and the number of those that are followed to the end."""
FORWARD = (-0.1, -0.03, 0.03, 0.1)
"""Displacements along the optical axis that are tried besides the predicted one, as a share of the median depth."""
TURNS_RAD = 0.06
"""Rotations to the sides that are tried."""
CONVERGED = 1e-3
"""Step of the largest part of a twist, relative to the resolution of an image pixel, at which the iteration ends."""


def pyramid(grey: Image) -> tuple[Image, ...]:
    """Returns the image and its halvings; pixel p of a level is pixel 2 p of the level below."""
    levels = [grey]
    while len(levels) < MAX_LEVELS and min(levels[-1].shape) >= 2 * SMALLEST_SIDE_PX:
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), np.uint8))
    return tuple(levels)


def square_patch(side_px: int) -> Array:
    """Returns the offsets (side^2, 2) [px] of the pixels of a patch from its middle."""
    along = np.arange(side_px) - (side_px - 1) / 2
    return np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)


def guesses_around(predicted: Pose, last: Pose, depth: Array) -> tuple[Pose, ...]:
    """Returns guesses of image_from_reference: the predicted one, the `last` one, and others around that, along the
    optical axis by shares of the median of the depths (N,), and rotated to the sides."""
    ahead = np.array([0.0, 0.0, float(np.median(depth))])
    others = [Pose(translation=-share * ahead) for share in FORWARD]
    others += [Pose.from_rotvec(turn * axis, np.zeros(3)) for axis in np.eye(3)[:2] for turn in (-TURNS_RAD, TURNS_RAD)]
    return predicted, last, *(other @ last for other in others)


@dataclass(frozen=True, eq=False)
class Alignment:
    """The alignment of the reference with another image: N points with patches of P pixels."""

    pose: Pose
    """image_from_reference."""
    gain: float
    offset: float
    """An intensity of the image is gain * reference + offset."""
    uv: Array
    """(N, 2) the points in the image [px]; NaN where they are not in it."""
    correlation: Array
    """(N,) normalised correlation of each patch with the image, -1..1; -1 where it is not inside."""
    scale: float
    """Standard deviation of the residuals, robust [grey levels]."""

    @property
    def similar(self) -> NDArray[np.bool_]:
        """(N,) whether each patch looks the same in the image."""
        return self.correlation >= MIN_CORRELATION

    def moved(self, camera: Camera, uv: Array, depth: Array, image: Image, pose: Pose) -> Alignment:
        """Returns the alignment for a pose nearby, from the points uv (N, 2) [px] of the reference with depths (N,) and
        the image. The correlations are unchanged."""
        return replace(self, pose=pose, uv=_places(camera, uv, depth, image, pose))


@dataclass(frozen=True, eq=False)
class Level:
    """The reference on one level of the pyramid, ready to be compared. K = N P pixels."""

    number: int
    xyz: Array
    """(K, 3) in the reference camera."""
    intensity: Array
    """(K,) NaN outside of the image."""
    jacobian: Array
    """(K, 6) of the intensity by a twist on the left of the reference's points."""


def align(
    camera: Camera,
    reference: tuple[Image, ...],
    uv: Array,
    depth: Array,
    image: tuple[Image, ...],
    guesses: Sequence[Pose],
    patch: Array,
    iterations: int = 12,
) -> Alignment | None:
    """Returns image_from_reference of two pyramids, from points at uv (N, 2) [px] of the reference with depths (N,).

    The first guess is the prediction. Where it leads to no pose under which GOOD of the patches are similar, the others
    are followed on the smallest images, and the best ones of them on all; the pose with most similar patches counts.
    `patch` (P, 2) [px] is the same on every level, so that it covers more on the smaller ones. None where no guess sees
    enough of the reference.
    """
    if not len(uv):
        return None
    last = min(len(reference), len(image))
    levels = [_level(camera, reference, uv, depth, patch, number) for number in range(last)]
    best = _through(camera, levels, image, guesses[0], uv, depth, iterations)
    if best is not None and best.similar.mean() >= GOOD:
        return best
    coarse = [_coarse(camera, levels[-1], image[last - 1], guess, iterations) for guess in guesses[1:]]
    for _, pose in sorted(coarse, key=lambda found: found[0])[:FOLLOWED]:
        other = _through(camera, levels, image, pose, uv, depth, iterations)
        if other is not None and (best is None or other.similar.sum() > best.similar.sum()):
            best = other
    return best


def _coarse(camera: Camera, level: Level, image: Image, guess: Pose, iterations: int) -> tuple[float, Pose]:
    """Returns the cost of a guess after one level, and its pose there."""
    start = _brightness(camera, level, image, guess)
    if start is None:
        return np.inf, guess
    found = _descend(camera, level, image, guess, *start, iterations)
    return _cost(camera, level, image, *found), found[0]


def _through(
    camera: Camera, levels: list[Level], image: tuple[Image, ...], guess: Pose, uv: Array, depth: Array, iterations: int
) -> Alignment | None:
    """Returns the pose from one guess through all levels; None where it sees too little."""
    start = _brightness(camera, levels[-1], image[len(levels) - 1], guess)
    if start is None:
        return None
    pose, gain, offset = guess, *start
    for level in reversed(levels):
        pose, gain, offset = _descend(camera, level, image[level.number], pose, gain, offset, iterations)
    values = _values(camera, levels[0], image[0], pose)
    residuals = np.abs(gain * levels[0].intensity + offset - values)
    seen = np.isfinite(residuals)
    if seen.mean() < LEAST_SEEN:
        return None
    places = _places(camera, uv, depth, image[0], pose)
    correlation = correlations(levels[0].intensity.reshape(len(uv), -1), values.reshape(len(uv), -1))
    scale = max(LEAST_SCALE, MAD * median(residuals[seen]))
    return Alignment(pose, gain, offset, places, correlation, scale)


def _places(camera: Camera, uv: Array, depth: Array, image: Image, pose: Pose) -> Array:
    """Returns where a pose sees the points [px]; NaN outside of the image."""
    places = camera.project(pose.apply(depth[:, None] * rays_of(camera, uv)))
    return np.where(np.isfinite(sample(image, places))[:, None], places, np.nan)


def correlations(a: Array, b: Array) -> Array:
    """Returns normalised correlations (N,) of patches (N, P); -1 where one has no texture, or a pixel is NaN."""
    a, b = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=1, keepdims=True)
    product, power = (a * b).sum(axis=1), (a * a).sum(axis=1) * (b * b).sum(axis=1)
    return np.where(power > 1e-6, product / np.sqrt(np.maximum(power, 1e-6)), -1.0)


def rays_of(camera: Camera, uv: Array) -> Array:
    """Returns rays (N, 3) of length 1 along the optical axis."""
    return np.column_stack([camera.normalise(uv), np.ones(len(uv))])


def _level(camera: Camera, reference: tuple[Image, ...], uv: Array, depth: Array, patch: Array, number: int) -> Level:
    pixels = (uv[:, None] / 2**number + patch).reshape(-1, 2)
    xyz = np.repeat(depth, len(patch))[:, None] * rays_of(camera, 2**number * pixels)
    image = reference[number]
    step = np.array([[1.0, 0.0], [0.0, 1.0]])
    gradient = [0.5 * (sample(image, pixels + s) - sample(image, pixels - s)) for s in step]
    by_xyz = np.einsum("ni,nij->nj", np.stack(gradient, axis=1), camera.project_jacobian(xyz)) / 2**number
    jacobian = np.concatenate([by_xyz, np.asarray(np.cross(xyz, by_xyz), float)], axis=1)
    intensity = sample(image, pixels)
    bad = ~np.isfinite(jacobian).all(axis=1)
    intensity[bad], jacobian[bad] = np.nan, 0.0
    return Level(number, xyz, intensity, np.ascontiguousarray(jacobian))


def _values(camera: Camera, level: Level, image: Image, pose: Pose) -> Array:
    """Returns the intensities (K,) of the image where a pose sees the pixels of the reference; NaN outside."""
    return sample(image, camera.project(pose.apply(level.xyz)) / 2**level.number)


def _brightness(camera: Camera, level: Level, image: Image, pose: Pose) -> tuple[float, float] | None:
    """Returns gain and offset from the medians at a guess; None where it sees too little."""
    values = _values(camera, level, image, pose)
    seen = np.isfinite(values) & np.isfinite(level.intensity)
    if seen.mean() < LEAST_SEEN:
        return None
    return 1.0, median(values[seen]) - median(level.intensity[seen])


def _cost(camera: Camera, level: Level, image: Image, pose: Pose, gain: float, offset: float) -> float:
    """Returns the mean robust cost. A pixel outside of the image costs as much as a residual of one loss width."""
    residuals = (gain * level.intensity + offset - _values(camera, level, image, pose)) / START_SCALE
    seen = np.isfinite(residuals)
    if seen.mean() < LEAST_SEEN:
        return np.inf
    return float(np.log1p(np.where(seen, residuals, 1.0) ** 2).mean())


def _descend(
    camera: Camera, level: Level, image: Image, pose: Pose, gain: float, offset: float, iterations: int
) -> tuple[Pose, float, float]:
    """Returns pose, gain and offset after Gauss-Newton on one level; the last ones whose cost did not grow."""
    best, lowest = (pose, gain, offset), np.inf
    depth = median(level.xyz[:, 2])
    resolution = 2**level.number / camera.fx
    for _ in range(iterations):
        values = _values(camera, level, image, pose)
        residuals = gain * level.intensity + offset - values
        seen = np.isfinite(residuals)
        if seen.mean() < LEAST_SEEN:
            return best
        cost = float(np.log1p((np.where(seen, residuals, START_SCALE) / START_SCALE) ** 2).mean())
        if cost > lowest:
            return best
        best, lowest = (pose, gain, offset), cost
        width = max(LEAST_SCALE, MAD * median(np.abs(residuals[seen])))
        h, g = normal_equations(level.intensity, level.jacobian, residuals, gain, width)
        scale = 1 / np.sqrt(np.maximum(np.diag(h), 1e-12))
        h = h * scale[:, None] * scale + 1e-6 * np.eye(8)
        step = -scale * np.linalg.solve(h, scale * g)
        pose = pose @ Pose.exp(step[:6]).inverse()
        gain, offset = float(np.clip(gain + step[6], *GAINS)), offset + float(step[7])
        if max(np.abs(step[:3]).max() / depth, np.abs(step[3:6]).max()) < CONVERGED * resolution:
            break
    values = _values(camera, level, image, pose)
    residuals = gain * level.intensity + offset - values
    seen = np.isfinite(residuals)
    cost = float(np.log1p((np.where(seen, residuals, START_SCALE) / START_SCALE) ** 2).mean())
    return (pose, gain, offset) if seen.mean() >= LEAST_SEEN and cost <= lowest else best


def sample(image: Image, uv: Array) -> Array:
    """Returns intensities (N,) at uv (N, 2) [px], bilinear; NaN outside of the image."""
    return _sample(read_only(image), read_only(np.asarray(uv, np.float64)))


@kernel()
def _sample(image, uv):
    height, width = image.shape
    out = np.full(len(uv), np.nan)
    for n in range(len(uv)):
        u, v = uv[n, 0], uv[n, 1]
        if not (0.0 <= u <= width - 1.0 and 0.0 <= v <= height - 1.0):
            continue
        x, y = min(int(u), width - 2), min(int(v), height - 2)
        a, b = u - x, v - y
        above = (1.0 - a) * image[y, x] + a * image[y, x + 1]
        below = (1.0 - a) * image[y + 1, x] + a * image[y + 1, x + 1]
        out[n] = (1.0 - b) * above + b * below
    return out


def normal_equations(intensity: Array, jacobian: Array, residuals: Array, gain: float, width: float) -> tuple:
    """Returns the information (8, 8) on twist, gain and offset, and the gradient (8,); NaN residuals count nothing."""
    h, g = np.zeros((8, 8)), np.zeros(8)
    _accumulate(read_only(intensity), read_only(jacobian), read_only(residuals), gain, width, h, g)
    return h + np.triu(h, 1).T, g


@part
def _t_weight(residual, width):
    return (FREEDOM + 1.0) / (FREEDOM + (residual / width) ** 2)


@kernel()
def _accumulate(intensity, jacobian, residuals, gain, width, h, g):
    row = np.empty(8)
    for k in range(len(residuals)):
        if not np.isfinite(residuals[k]):
            continue
        weight = _t_weight(residuals[k], width)
        for i in range(6):
            row[i] = gain * jacobian[k, i]
        row[6], row[7] = intensity[k], 1.0
        for i in range(8):
            weighted = weight * row[i]
            g[i] += weighted * residuals[k]
            for j in range(i, 8):
                h[i, j] += weighted * row[j]


def cell_side(grey: Image, count: int) -> int:
    """Returns the side [px] of the square cells of which the image has about `count`."""
    return max(2, round(np.sqrt(grey.size / max(count, 1))))


def textured(grey: Image, count: int, least_gradient: float, border_px: int) -> NDArray[np.float32]:
    """Returns about `count` pixels (N, 2), one in each cell of a grid: that with the steepest gradient.

    Cells whose steepest gradient is below `least_gradient` [grey levels per px] have none.
    """
    height, width = grey.shape
    blurred = cv2.GaussianBlur(grey, (3, 3), 0)
    dx, dy = (cv2.Sobel(blurred, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1)))
    steepness = dx * dx + dy * dy
    steepness[:border_px], steepness[height - border_px :] = 0, 0
    steepness[:, :border_px], steepness[:, width - border_px :] = 0, 0
    side = cell_side(grey, count)
    rows, columns = height // side, width // side
    cells = steepness[: rows * side, : columns * side].reshape(rows, side, columns, side).swapaxes(1, 2)
    cells = cells.reshape(rows, columns, side * side)
    steepest = cells.argmax(axis=2)
    good = np.take_along_axis(cells, steepest[..., None], axis=2)[..., 0] >= max(least_gradient, 1e-3) ** 2
    row, column = np.nonzero(good)
    within = steepest[row, column]
    return np.column_stack([column * side + within % side, row * side + within // side]).astype(np.float32)
