"""The depth field of one camera: pixels with a gradient, each with a normal distribution of its inverse depth, which
images from other places make narrower (Engel, Sturm and Cremers, Semi-Dense Visual Odometry for a Monocular Camera,
2013).

In another image of known pose, a pixel lies on a line along which its inverse depth runs. The patch around it is
searched along the part of the line that its distribution allows, then moved along the line to where the intensities
agree best. How exactly that is known follows from the gradient along the line: from noise of the intensities, and from
an error of the line, which matters where the gradient points across it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.survey.photometric import (
    LEAST_SCALE,
    cell_side,
    correlations,
    pyramid,
    rays_of,
    sample,
    square_patch,
)
from ispom.geometry import Array, Pose
from ispom.types import Camera, Image

PATCH = square_patch(5)
"""The patch around a pixel that is compared."""
WIDTH = 2.0
"""Standard deviations to both sides of the mean that are searched (Engel 2013)."""
STEPS = 8, 32
"""Number of positions on a line that are compared, at most a pixel apart: on short lines, and on long ones."""
LEVELS = 4
"""Levels of the pyramids on which lines are searched. The search of a longer line begins on a smaller image, and
continues near the position that was found there. A pixel whose line is too long on the smallest image is not searched
until an image was taken nearer to the keyframe."""
ITERATIONS = 4
"""Iterations of Gauss-Newton along the line."""
STEP_PX = 1.0
"""Distance over which gradients are measured; an iteration moves by no more than twice this."""
LEAST_CLEAR = 0.5
"""Least share of the squared gradients along the line that noise does not explain."""
MIN_CORRELATION = 0.8
"""Least correlation of a patch with the image at the position that was found."""
MAX_RATIO = 0.6
"""Largest ratio of the least squared difference of the patches to the least one elsewhere on the line."""
APART_PX = 2.0
"""Distance from the best position beyond which a position is a different one."""
LINE_PX = 0.25
"""Standard deviation of the line across itself: the pose is about as exact."""
LEAST_PX = 0.1
"""Least standard deviation along the line: the lens and interpolation are no more exact. An image does not improve a
pixel whose position in it is known better."""
CONSISTENT = 3.0
"""Standard deviations within which a measurement is of the same pixel."""
OWN = np.sqrt(0.5)
"""Part of the standard deviation of a measurement that no number of them makes less: half of the variance is that of
the keyframe's own patch."""
CONFIRMED = 2
"""Images that must agree before an inverse depth takes part: a single match may be one of a repeated pattern."""
FAR = 1e-3
"""Least inverse depth, relative to the typical one; farther points count as infinitely far."""
SURE = 0.2
"""Largest standard deviation of an inverse depth that takes part in the alignment, as a share of itself or of the
typical one: a motion by as much as a tenth of the depth then puts the pixel off by 2 % of the focal length at most."""
CARRIED = 0.01
"""Standard deviation that an inverse depth gets in addition when it is carried to another keyframe, as a share of it:
the pixel of the next keyframe is not exactly the same point."""


NAMES = "ids", "uv", "inverse", "sigma", "agreed"


@dataclass(frozen=True, eq=False)
class DepthField:
    """N pixels of a keyframe."""

    grey: Image
    ids: NDArray[np.int64]
    uv: Array
    """(N, 2) [px]."""
    inverse: Array
    """(N,) means of the inverse depths, positive."""
    sigma: Array
    """(N,) standard deviations of them."""
    agreed: NDArray[np.int64]
    """(N,) number of images that agreed, less that of those that did not."""

    @staticmethod
    def unknown(grey: Image, ids: NDArray[np.int64], uv: Array, typical: float) -> DepthField:
        """Returns pixels that may be anywhere from a third of the typical depth to infinity."""
        blank = np.full(len(ids), typical)
        return DepthField(grey, ids, uv.astype(float), blank, blank, np.zeros(len(ids), np.int64))

    def __getitem__(self, some: NDArray[np.bool_]) -> DepthField:
        return DepthField(self.grey, *(getattr(self, name)[some] for name in NAMES))

    @property
    def typical(self) -> float:
        """The median inverse depth of the pixels that have one."""
        known = self.sigma <= SURE * self.inverse
        return float(np.median(self.inverse[known] if known.any() else self.inverse))

    @property
    def sure(self) -> NDArray[np.bool_]:
        """(N,) whether the inverse depth is known well enough for the alignment, and confirmed."""
        return (self.sigma <= SURE * np.maximum(self.inverse, self.typical)) & (self.agreed >= CONFIRMED)

    def improved(self, camera: Camera, image: Image, image_from_key: Pose) -> DepthField:
        """Returns the field after an update by another image."""
        found, sigma, missed = measured(self, camera, image, image_from_key)
        both = np.hypot(self.sigma, sigma)
        agrees = np.isfinite(sigma) & (np.abs(found - self.inverse) <= CONSISTENT * both)
        share = np.where(agrees, (self.sigma / np.where(agrees, both, 1.0)) ** 2, 0.0)
        mean = self.inverse + share * np.where(agrees, found - self.inverse, 0.0)
        deviation = np.maximum(self.sigma * np.sqrt(1 - share), np.where(agrees, OWN * sigma, 0.0))
        wrong = missed | (np.isfinite(sigma) & ~agrees)
        agreed = np.minimum(self.agreed + agrees - wrong, CONFIRMED + 1)
        anew = agreed < 0
        return replace(
            self, inverse=np.where(anew, self.typical, np.maximum(mean, FAR * self.typical)),
            sigma=np.where(anew, self.typical, deviation), agreed=np.maximum(agreed, 0),
        )  # fmt: skip

    def carried(self, camera: Camera, grey: Image, image_from_key: Pose, count: int) -> DepthField:
        """Returns the pixels that lie in another image as a field of that: of each of about `count` cells the surest
        one."""
        rays = rays_of(camera, self.uv) @ image_from_key.rotation.T
        y = rays + self.inverse[:, None] * image_from_key.translation
        uv, scale = camera.project(y), 1 / np.maximum(y[:, 2], 1e-9)
        inverse, sigma = self.inverse * scale, self.sigma * np.abs(rays[:, 2]) * scale**2
        moved = DepthField(grey, self.ids, uv, inverse, np.hypot(sigma, CARRIED * inverse), self.agreed)
        inside = np.isfinite(sample(grey, uv)) & (y[:, 2] > 1e-9)
        order = np.flatnonzero(inside)[np.argsort(sigma[inside], kind="stable")]
        _, first = np.unique(cells(uv[order], grey, count), return_index=True)
        keep = np.zeros(len(uv), bool)
        keep[order[first]] = True
        return moved[keep & (sigma <= self.typical)]

    def joined(self, more: DepthField) -> DepthField:
        """Returns both together: `more` is of the same image."""
        return DepthField(self.grey, *(np.concatenate([getattr(a, n) for a in (self, more)]) for n in NAMES))


def cells(uv: Array, grey: Image, count: int) -> NDArray[np.int64]:
    """Returns the number (N,) of the cell of `textured` that each pixel (N, 2) lies in."""
    column, row = (np.rint(uv) // cell_side(grey, count)).astype(np.int64).T
    return row * grey.shape[1] + column


def measured(
    field: DepthField, camera: Camera, image: Image, image_from_key: Pose
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Returns the inverse depths (N,) as an image shows them, and their standard deviations, inf where it does not; and
    which pixels (N,) it does not show though their lines are in it."""
    keyframe, other = pyramid(field.grey)[:LEVELS], pyramid(image)[:LEVELS]
    lines = [Lines.of(field, n, keyframe[n], camera, other[n], image_from_key) for n in range(len(keyframe))]
    uncertain = field.sigma * lines[0].speed(field.inverse)
    tried = np.flatnonzero((uncertain > LEAST_PX) & (2 * WIDTH * uncertain <= STEPS[-1] * 2.0 ** (len(lines) - 1)))
    found, width, left = field.inverse.copy(), field.sigma.copy(), tried
    for line in reversed(lines):
        length = 2 * WIDTH * width[left] * line[left].speed(found[left])
        for least, most in pairwise((1.0, *STEPS)):
            some = left[(length > least) & (length <= most)]
            best, clear = line[some].searched(found[some], width[some], field.typical, int(most))
            found[some] = np.where(clear, best, np.nan)
            width[some] = 1 / np.maximum(line[some].speed(best), 1e-9)
        left = left[np.isfinite(found[left])]
    sigma = np.full(len(field.ids), np.inf)
    found[left], sigma[left] = lines[0][left].refined(found[left])
    missed = np.zeros(len(field.ids), bool)
    missed[tried] = ~np.isfinite(sigma[tried]) & np.isfinite(sample(image, lines[0][tried].at(field.inverse[tried])))
    return found, sigma, missed


@dataclass(frozen=True, eq=False)
class Lines:
    """Epipolar lines of N pixels in an image, each with a patch of P pixels."""

    level: int
    """Level of the pyramids; all positions are in pixels of this level."""
    camera: Camera
    image: Image
    intensity: Array
    """(N, P) of the patches in the keyframe, without their means."""
    rays: Array
    """(N, 1 + P, 3) to the pixels and to those of their patches, turned into the image's camera."""
    step: Array
    """(3,) displacement: a pixel is at the projection of ray + inverse depth * step."""

    @staticmethod
    def of(field: DepthField, level: int, keyframe: Image, camera: Camera, image: Image, image_from_key: Pose) -> Lines:
        """`keyframe` and `image` are those of the level."""
        pixels = field.uv[:, None] / 2**level + np.vstack([np.zeros((1, 2)), PATCH])
        rays = rays_of(camera, 2**level * pixels.reshape(-1, 2)) @ image_from_key.rotation.T
        intensity = without_mean(sample(keyframe, pixels[:, 1:].reshape(-1, 2)).reshape(-1, len(PATCH)))
        rays = rays.reshape(*pixels.shape[:2], 3)
        return Lines(level, camera, image, intensity, rays, image_from_key.translation)

    def __getitem__(self, some: NDArray[np.int64]) -> Lines:
        return replace(self, intensity=self.intensity[some], rays=self.rays[some])

    def at(self, inverse: Array) -> Array:
        """Returns the places (N, 2) [px] of the pixels with inverse depths (N,)."""
        return self.camera.project(self.rays[:, 0] + inverse[:, None] * self.step) / 2**self.level

    def patches(self, inverse: Array) -> Array:
        """Returns the pixels (N, P, 2) of the patches, as planes across the keyframe's axis, from their places [px]."""
        xyz = self.rays + inverse[:, None, None] * self.step
        uv = self.camera.project(xyz.reshape(-1, 3)).reshape(*xyz.shape[:2], 2) / 2**self.level
        return uv[:, 1:] - uv[:, :1]

    def velocity(self, inverse: Array) -> Array:
        """Returns by how much the places (N, 2) move with the inverse depth [px by its unit]; 0 without a place."""
        jacobian = self.camera.project_jacobian(self.rays[:, 0] + inverse[:, None] * self.step)
        return np.nan_to_num(jacobian @ self.step) / 2**self.level

    def speed(self, inverse: Array) -> Array:
        """Returns the size (N,) of that."""
        return np.linalg.norm(self.velocity(inverse), axis=1)

    def values(self, uv: Array) -> Array:
        """Returns the intensities (N, P) of pixels (N, P, 2), without their means."""
        return without_mean(sample(self.image, uv.reshape(-1, 2)).reshape(uv.shape[:2]))

    def searched(self, inverse: Array, sigma: Array, typical: float, steps: int) -> tuple[Array, NDArray[np.bool_]]:
        """Returns the inverse depths (N,) of the place on the line whose patch differs least, and whether no place
        elsewhere is similar."""
        low = np.maximum(inverse - WIDTH * sigma, FAR * typical)
        trials = low[:, None] + (inverse + WIDTH * sigma - low)[:, None] * np.linspace(0, 1, steps + 1)
        xyz = self.rays[:, :1] + trials[..., None] * self.step
        places = self.camera.project(xyz.reshape(-1, 3)).reshape(*trials.shape, 2) / 2**self.level
        uv = (places[:, :, None] + self.patches(inverse)[:, None]).reshape(-1, len(PATCH), 2)
        apart = self.values(uv).reshape(*trials.shape, len(PATCH)) - self.intensity[:, None]
        cost = (apart**2).sum(axis=2)
        cost = np.where(np.isfinite(cost), cost, np.inf)
        rows, best = np.arange(len(cost)), cost.argmin(axis=1)
        elsewhere = np.linalg.norm(places - places[rows, best][:, None], axis=2) > APART_PX
        rival = np.where(elsewhere, cost, np.inf).min(axis=1)
        least = cost[rows, best]
        return trials[rows, best], np.isfinite(least) & (least <= MAX_RATIO * rival)

    def refined(self, inverse: Array) -> tuple[Array, Array]:
        """Returns the inverse depths (N,) under which the patches agree best, and their standard deviations; inf where
        they do not agree."""
        patches = self.patches(inverse)
        for _ in range(ITERATIONS):
            values, along, _ = self.slopes(inverse, patches)
            step = ((self.intensity - values) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-6)
            speed = np.maximum(self.speed(inverse), 1e-9)
            inverse = inverse + np.clip(np.nan_to_num(step), -STEP_PX, STEP_PX) / speed
        values, along, across = self.slopes(inverse, patches)
        energy = (along**2).sum(axis=1)
        noise = np.maximum(LEAST_SCALE**2, ((self.intensity - values) ** 2).mean(axis=1))
        clear = energy - len(PATCH) * noise / (2 * STEP_PX) ** 2
        good = (clear > LEAST_CLEAR * energy) & (inverse > 0)
        good &= correlations(self.intensity, values) >= MIN_CORRELATION
        clear = np.where(good, clear, 1.0)
        sigma_px = np.sqrt(LEAST_PX**2 + noise / clear + (LINE_PX * (along * across).sum(axis=1) / clear) ** 2)
        return inverse, np.where(good, sigma_px / np.maximum(self.speed(inverse), 1e-9), np.inf)

    def slopes(self, inverse: Array, patches: Array) -> tuple[Array, Array, Array]:
        """Returns the intensities (N, P) of the patches, and their slopes along the line and across it (N, P) [grey
        levels per px], each without its mean."""
        velocity, uv = self.velocity(inverse), self.at(inverse)[:, None] + patches
        along = directions(velocity)
        slopes = list[Array]()
        for direction in (along, along[:, ::-1] * (-1.0, 1.0)):
            ahead, back = (self.values(uv + sign * STEP_PX * direction[:, None]) for sign in (1, -1))
            slopes.append((ahead - back) / (2 * STEP_PX))
        return self.values(uv), slopes[0], slopes[1]


def directions(velocity: Array) -> Array:
    """Returns the unit vectors (N, 2) of velocities (N, 2); the axis u where there is none."""
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    return np.where(speed > 1e-9, velocity / np.maximum(speed, 1e-9), (1.0, 0.0))


def without_mean(values: Array) -> Array:
    """Returns values (N, P) less the mean of each row."""
    return values - values.mean(axis=1, keepdims=True)
