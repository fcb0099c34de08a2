"""SURF (Bay, Ess, Tuytelaars and Van Gool 2008): blobs and their description by box filters on an integral image.

The steps, in the order of the paper and of this file:

1. Fast Hessian (sections 3.2 to 3.4): box filters of growing size approximate second derivatives of Gaussians; peaks of
   the Hessian's determinant over place and scale are refined by a quadratic (Brown and Lowe 2002).
2. Orientation (4.1): the direction of most Haar wavelet responses around the point.
3. Descriptor (4.2): sums of Haar wavelet responses, and of their magnitudes, in 4 x 4 parts of a rotated square.

Any box of any size costs four look-ups. Between pixels the integral image is interpolated, which is the exact sum of a
box with fractional sides. The sign of the Laplacian is not compared: it saves time only. Each call computes all scales;
it takes about as long as SIFT.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.descriptors import MAX_RATIO, OpenCvFeatures, SimilarityMatcher, descriptor_front_end, dot_product
from ispom.geometry import Array
from ispom.types import Image

FILTER_SIDES_PX = (9, 15, 21, 27), (15, 27, 39, 51), (27, 51, 75, 99)
"""Sides [px] of the box filters by octave; each octave is sampled half as densely as the one before (section 3.3 of
the paper)."""
SCALE = 1.2 / 9
"""Scale s (sigma of the approximated Gaussian) of a filter, relative to its side."""
CROSS = 0.9
"""Weight of the mixed derivative that balances the approximation (equation 3)."""
MIN_DETERMINANT = 10.0
"""Least determinant [(grey levels)^2]; noise of one grey level has 3 at the smallest filter."""
SECTORS, WINDOW = 72, 12
"""Number of directions that are tried for the orientation, and the width of the sliding window: 60 degrees, as in the
paper (4.1)."""
MIN_SIMILARITY = 0.9
"""Least dot product of the unit descriptors of a match: 95 % of right ones of neighbouring frames have 0.95 and more,
95 % of unrelated ones 0.89 and less."""
GRID = np.arange(-9.5, 10)
"""Samples along a side of the square of 20 s, in s."""
MIN_NORM = 1e-9
"""Least norm that is divided by, which avoids a division by zero."""


@dataclass(frozen=True)
class Integral:
    """Sums of the pixels above and to the left; of all, the mean was subtracted first."""

    table: Array
    """(H + 1, W + 1)."""

    @staticmethod
    def of(grey: Image) -> Integral:
        centred = grey.astype(np.float32) - np.float32(grey.mean())
        return Integral(np.asarray(cv2.integral(centred, sdepth=cv2.CV_64F), np.float64))

    def sampled(self, step: int, reach: int) -> Callable[[int, int], Array]:
        """Returns a function of an offset (rows, columns), up to `reach`, from every `step`-th pixel: its sums."""
        rows, columns = (n - 1 for n in self.table.shape)
        padded = np.pad(self.table, reach, mode="edge")

        def sums(top: int, left: int) -> Array:
            return padded[reach + top : reach + top + rows : step, reach + left : reach + left + columns : step]

        return sums

    def at(self, u: Array, v: Array) -> Array:
        """Returns the sum left of and above positions [px] (N, K), pixel centres being whole numbers."""
        shape = self.table.shape
        x, y = (np.clip(p + 0.5, 0, n - 1) for p, n in ((u, shape[1]), (v, shape[0])))
        column, row = (np.minimum(p.astype(np.int64), n - 2) for p, n in ((x, shape[1]), (y, shape[0])))
        a, b, flat = x - column, y - row, self.table.ravel()
        first = row * shape[1] + column
        upper = flat[first] + a * (flat[first + 1] - flat[first])
        first += shape[1]
        return upper + b * (flat[first] + a * (flat[first + 1] - flat[first]) - upper)

    def wavelets(self, u: Array, v: Array, half: Array) -> tuple[Array, Array]:
        """Returns the Haar wavelet responses along x and y (N, K) at positions [px], of the sides 2 `half` (N, 1)."""
        corner = {(i, j): self.at(u + i * half, v + j * half) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j}
        whole = corner[1, 1] - corner[-1, 1] - corner[1, -1] + corner[-1, -1]
        left = corner[0, 1] - corner[-1, 1] - corner[0, -1] + corner[-1, -1]
        upper = corner[1, 0] - corner[-1, 0] - corner[1, -1] + corner[-1, -1]
        return whole - 2 * left, whole - 2 * upper


@dataclass(frozen=True)
class Surf:
    """Detects and describes keypoints as OpenCV's features do; a keypoint's size is the side of its filter."""

    count: int
    """Number of keypoints, the strongest ones."""
    threshold: float = MIN_DETERMINANT

    def detect(self, grey: Image, mask: None = None) -> list[cv2.KeyPoint]:
        """Returns keypoints without orientation, strongest first."""
        found = fast_hessian(Integral.of(grey), self.threshold)
        found = found[np.argsort(-found[:, 3], kind="stable")][: self.count]
        return [cv2.KeyPoint(u, v, side, -1.0, response) for u, v, side, response in found.tolist()]

    def compute(self, grey: Image, keypoints: Sequence[cv2.KeyPoint]) -> tuple[Sequence[cv2.KeyPoint], NDArray]:
        """Returns the keypoints and descriptors (N, 64); finds the orientation of those that have none."""
        integral = Integral.of(grey)
        places = np.array([(*k.pt, k.size * SCALE) for k in keypoints]).reshape(-1, 3)
        angles = np.radians([k.angle for k in keypoints])
        without = np.flatnonzero(angles < 0)
        angles[without] = orientations(integral, places[without])
        for i in without.tolist():
            keypoints[i].angle = float(np.degrees(angles[i]))
        return keypoints, descriptors(integral, places, angles)

    def detectAndCompute(self, grey: Image, mask: None = None) -> tuple[Sequence[cv2.KeyPoint], NDArray]:
        """Returns keypoints, strongest first, and their descriptors (N, 64)."""
        return self.compute(grey, self.detect(grey))


# Step 1: Fast Hessian


def fast_hessian(integral: Integral, threshold: float) -> Array:
    """Returns x, y, filter side [px] and determinant of blobs (N, 4)."""
    found: list[Array] = [np.zeros((0, 4))]
    for octave, sides in enumerate(FILTER_SIDES_PX):
        step = 2**octave
        if min(integral.table.shape) <= sides[-1]:
            break
        layers = np.stack([determinant(integral, side, step) for side in sides])
        found.append(_peaks(layers, sides, step, threshold))
    return np.concatenate(found)


def determinant(integral: Integral, side: int, step: int) -> Array:
    """Returns the determinant of the Hessian at every `step`-th pixel by box filters of a side [px], per area."""
    lobe, half, sums = side // 3, side // 2, integral.sampled(step, side)

    def boxes(top: int, left: int, height: int, width: int) -> Array:
        low, far = top + height, left + width
        return sums(low, far) - sums(low, left) - sums(top, far) + sums(top, left)

    wide = 2 * lobe - 1
    yy = boxes(-half, 1 - lobe, side, wide) - 3 * boxes(-(lobe // 2), 1 - lobe, lobe, wide)
    xx = boxes(1 - lobe, -half, wide, side) - 3 * boxes(1 - lobe, -(lobe // 2), wide, lobe)
    xy = boxes(-lobe, -lobe, lobe, lobe) + boxes(1, 1, lobe, lobe)
    xy -= boxes(-lobe, 1, lobe, lobe) + boxes(1, -lobe, lobe, lobe)
    found = (xx * yy - (CROSS * xy) ** 2) / float(side) ** 4
    border = half // step + 1  # filters reach out of the image there
    found[:border], found[-border:], found[:, :border], found[:, -border:] = 0, 0, 0, 0
    return found


def _peaks(layers: Array, sides: tuple[int, ...], step: int, threshold: float) -> Array:
    """Returns x, y, side, determinant (N, 4) of the maxima of inner layers among their 26 neighbours."""
    around = np.stack([cv2.dilate(layer, np.ones((3, 3), np.uint8)) for layer in layers])
    scale, row, column = np.nonzero((layers >= threshold)[1:-1] & (layers[1:-1] >= around[1:-1]))
    scale += 1
    value = layers[scale, row, column]
    peak = (value > around[scale - 1, row, column]) & (value > around[scale + 1, row, column])
    at = np.stack([scale, row, column], axis=1)[peak]
    if not len(at):
        return np.zeros((0, 4))
    cube = layers[tuple((at[:, None] + OFFSETS).transpose(2, 0, 1))].reshape(-1, 3, 3, 3)
    offset = _summits(cube)
    near = np.abs(offset).max(axis=1) < 1
    at, offset, value = at[near], offset[near], value[peak][near]
    place = step * (at[:, 1:] + offset[:, 1:])
    side = sides[0] + (sides[1] - sides[0]) * (at[:, 0] + offset[:, 0])
    return np.column_stack([place[:, 1], place[:, 0], side, value])


OFFSETS = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
"""(27, 3) of a peak's neighbours over scale, row and column."""


def _summits(cube: Array) -> Array:
    """Returns the offsets (N, 3) of the maxima of quadratics through the values of neighbours (N, 3, 3, 3)."""

    def value(*place: int) -> Array:
        return cube[:, 1 + place[0], 1 + place[1], 1 + place[2]]

    gradient, hessian = np.empty((len(cube), 3)), np.empty((len(cube), 3, 3))
    for i, a in enumerate(np.eye(3, dtype=int)):
        gradient[:, i] = (value(*a) - value(*-a)) / 2
        hessian[:, i, i] = value(*a) + value(*-a) - 2 * value(0, 0, 0)
        for j, b in enumerate(np.eye(3, dtype=int)[:i]):
            mixed = (value(*(a + b)) + value(*(-a - b)) - value(*(a - b)) - value(*(b - a))) / 4
            hessian[:, i, j] = hessian[:, j, i] = mixed
    hessian -= MIN_NORM * np.eye(3)
    return -np.linalg.solve(hessian, gradient[..., None])[..., 0]


# Step 2: orientation


def _disk() -> Array:
    """Returns the samples (109, 2) within a radius of 6, in s."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-6.0, 7), np.arange(-6.0, 7)))
    return np.stack([x, y], axis=1)[x**2 + y**2 < 36]


DISK = _disk()


def orientations(integral: Integral, places: Array) -> Array:
    """Returns the angle (N,) in 0..2 pi [rad] of places x, y, s (N, 3), from x towards y."""
    scale = places[:, 2:]
    x, y = integral.wavelets(places[:, :1] + scale * DISK[:, 0], places[:, 1:2] + scale * DISK[:, 1], 2 * scale)
    weight = np.exp(-(DISK**2).sum(1) / (2 * 2.0**2))  # sigma 2 s
    x, y = weight * x, weight * y
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 1) * SECTORS).astype(int) % SECTORS
    index = (np.arange(len(places))[:, None] * SECTORS + sector).ravel()
    sums = [np.bincount(index, part.ravel(), len(places) * SECTORS).reshape(-1, SECTORS) for part in (x, y)]
    shifts = (np.arange(SECTORS)[:, None] + np.arange(WINDOW)) % SECTORS
    along, down = (part[:, shifts].sum(axis=2) for part in sums)
    best = (along**2 + down**2).argmax(axis=1)[:, None]
    found = np.arctan2(np.take_along_axis(down, best, 1), np.take_along_axis(along, best, 1))[:, 0]
    return found % (2 * np.pi)


# Step 3: descriptor


def descriptors(integral: Integral, places: Array, angles: Array) -> NDArray[np.float32]:
    """Returns unit vectors (N, 64): sums of dx, dy, |dx| and |dy| of 4 x 4 parts; zeros where nothing changes."""
    scale, cos, sin = places[:, 2:], np.cos(angles)[:, None], np.sin(angles)[:, None]
    down, along = (part.ravel() for part in np.meshgrid(GRID, GRID, indexing="ij"))
    u, v = places[:, :1] + scale * (cos * along - sin * down), places[:, 1:2] + scale * (sin * along + cos * down)
    x, y = integral.wavelets(u, v, scale)
    weight = np.exp(-(along**2 + down**2) / (2 * 3.3**2))  # sigma 3.3 s
    turned = weight * (cos * x + sin * y), weight * (cos * y - sin * x)
    parts = [part.reshape(-1, 4, 5, 4, 5).sum(axis=(2, 4)) for d in turned for part in (d, np.abs(d))]
    found = np.stack(parts, axis=-1)[..., [0, 2, 1, 3]].reshape(len(places), 64)
    return (found / np.linalg.norm(found, axis=1, keepdims=True).clip(MIN_NORM)).astype(np.float32)


def without_signs(described: NDArray) -> NDArray[np.float32]:
    """Returns the descriptors with sums of rises and of falls in place of sum(d) and sum(|d|).

    Both pairs differ by a rotation by 45 degrees: distances are the same, and no entry is negative.
    """
    signed, size = described.reshape(-1, 16, 2, 2).transpose(2, 0, 1, 3)
    halves = np.stack([size + signed, size - signed], axis=2) * np.float32(np.sqrt(0.5))
    return np.maximum(halves.reshape(-1, 64), 0).astype(np.float32)


SURF = OpenCvFeatures(Surf, 64, keypoint_px=15.0, normalised=without_signs)
SURF_MATCHER = SimilarityMatcher(dot_product, MIN_SIMILARITY, MAX_RATIO**2)
FRONT_END = descriptor_front_end("surf", "Bay, Ess, Tuytelaars and Van Gool 2008", SURF, SURF_MATCHER)
