"""Shake that the images show and smoothed poses lack: how tracks of a frame leave the middle of its neighbours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.numerics.robust import MAD
from ispom.types import Trajectory

from .pairs import BIAS_PX, LEAST, LEAST_NOISE_PX, WIDTH
from .tracks import Chunk

STEPS = (1, 2, 4, 8)
"""Frames from the middle one to its neighbours: the shorter, the faster the shake."""
TRACKS = 64
"""Tracks of three frames that are used, which limits memory: each half of them fixes a turn to a tenth of a pixel."""
LEAST_MISSING = 0.1
"""Share of the shake's energy that must be missing. In simulations a rolling shutter of 20 ms makes up 0.06, a clock
that is 5 ms off and a focal length that is 1 % off less than 0.01; a mean over three frames takes 0.15."""
SIGNIFICANT = 4.0
"""Standard deviations of the share, between blocks of the recording."""
BLOCK = 16
"""Frames of such a block."""
LEAST_BLOCKS = 3
"""Blocks that a standard deviation takes."""
NEAREST = 0.1
"""Depth, relative to the one in the first frame, below which a track is expected behind the camera."""
ROUNDS = 4
"""Iterations of the robust fit of a turn."""
EPIPOLE = 1e-2
"""Angle [rad] from the direction of motion within which a track does not determine its distance."""


@dataclass(frozen=True, eq=False)
class Shakes:
    """N tracks in T times three frames that are equally far apart."""

    step: int
    frames: NDArray[np.int64]
    """(T, 3) numbers among the frames of the main camera."""
    x: Array
    """(T, N, 3, 2) float32 in normalised coordinates; NaN where there are fewer tracks."""


@dataclass(frozen=True)
class Smoothing:
    """The part of the images' shake that the poses lack, at the step at which it is most significant."""

    step: int
    missing: float
    """Share of the energy: 0 where the poses shake as the images do, 1 where they do not shake; noise of poses does not
    change it."""
    sigma: float
    missing_px: float
    """RMS of the missing part, at the centre of the image [px of the tracked images]."""

    @property
    def found(self) -> bool:
        """Whether the poses are smoothed."""
        return self.missing > LEAST_MISSING and self.missing >= SIGNIFICANT * self.sigma and self.missing_px > BIAS_PX


def shakes_of(chunk: Chunk, covered: NDArray[np.bool_]) -> Iterator[Shakes]:
    """Yields the tracks of one chunk at each step, where frames have a pose (F,)."""
    seen, count = np.isfinite(chunk.x[..., 0]), chunk.x.shape[1]
    for step in STEPS:
        frames, tracks = [], []
        for f in range(min(chunk.fresh, count - 2 * step)):
            three = f + step * np.arange(3)
            common = np.flatnonzero(seen[:, three].all(axis=1))[:TRACKS]
            if len(common) >= LEAST and covered[chunk.first + three].all():
                x = np.full((TRACKS, 3, 2), np.nan, np.float32)
                x[: len(common)] = chunk.x[np.ix_(common, three)]
                frames.append(chunk.first + three)
                tracks.append(x)
        if frames:
            yield Shakes(step, np.array(frames), np.array(tracks))


def smoothing(shakes: Iterable[Shakes], given: Trajectory, own: NDArray[np.bool_], pixel: float) -> Smoothing | None:
    """Compares the shake of poses world_from_camera of all frames with the images'; None where none can be compared.

    `own` (F,) tells which frames have a pose that is not interpolated, as that smooths by itself.
    """
    found = []
    for step in STEPS:
        of_step = [_where(each, np.all(own[each.frames], axis=1)) for each in shakes if each.step == step]
        if sum(len(each.frames) for each in of_step):
            found.append(_of_step(step, of_step, given, pixel))
    found = [each for each in found if each is not None]
    return max(found, key=lambda each: (each.found, each.missing / each.sigma), default=None)


def _where(shakes: Shakes, chosen: NDArray[np.bool_]) -> Shakes:
    return Shakes(shakes.step, shakes.frames[chosen], shakes.x[chosen])


def _of_step(step: int, shakes: list[Shakes], given: Trajectory, pixel: float) -> Smoothing | None:
    halves = [
        np.concatenate(each) for each in zip(*(_turns(s, given, pixel) for s in shakes if len(s.frames)), strict=True)
    ]
    (seen_a, seen_b), (own_a, own_b) = halves[:2], halves[2:]
    # Each half of the tracks is compared with the other one, as noise of the same tracks would look like shake. Errors
    # of the poses that have nothing to do with the shake cancel.
    lacks = (seen_a * (seen_b - own_b) + seen_b * (seen_a - own_a)).sum(axis=1) / 2
    shake = (seen_a * seen_b).sum(axis=1)
    blocks = np.concatenate([each.frames[:, 1] for each in shakes]) // BLOCK
    names = np.unique(blocks)
    by_block = np.array([[lacks[blocks == n].sum(), shake[blocks == n].sum()] for n in names])
    if len(names) < LEAST_BLOCKS or not by_block[:, 1].sum() > 0:
        return None
    missing = float(by_block[:, 0].sum() / by_block[:, 1].sum())
    left = by_block[:, 0] - missing * by_block[:, 1]
    sigma = float(np.sqrt((left**2).sum() * len(names) / (len(names) - 1)) / by_block[:, 1].sum())
    px = float(np.sqrt(max(lacks.mean(), 0.0))) / pixel
    return Smoothing(step, missing, max(sigma, 1e-6), px)


def _turns(shakes: Shakes, given: Trajectory, pixel: float) -> tuple[Array, Array, Array, Array]:
    """Turns (T, 3) [rad] that move tracks from the middle between both neighbours to where they are in the frame
    between: as seen, by each half of the tracks, and as expected by the poses, by each half."""
    a, k, b = shakes.frames.T
    times = given.times_ns.astype(float)
    part = ((times[k] - times[a]) / np.maximum(times[b] - times[a], 1.0))[:, None, None]
    x = shakes.x.astype(float)
    middle, expected = (1 - part) * x[:, :, 0] + part * x[:, :, 2], _expected(shakes, given)
    known = np.isfinite(expected).all(axis=2)
    halves = [known & (np.arange(x.shape[1]) % 2 == n) for n in (0, 1)]
    seen = [_turn(middle, x[:, :, 1], half, pixel) for half in halves]
    own = [_turn(middle, expected, half, pixel) for half in halves]
    return seen[0], seen[1], own[0], own[1]


def _expected(shakes: Shakes, given: Trajectory) -> Array:
    """Returns the positions (T, N, 2) of tracks in the middle frame that the poses predict from both neighbours; NaN
    behind the camera."""
    a, k, b = shakes.frames.T
    r, t = given.rotations, given.translations
    back, x = np.swapaxes(r, 1, 2), shakes.x.astype(float)
    rays = np.concatenate([x, np.ones((*x.shape[:3], 1))], axis=3)
    turned_b, turned_k = (rays[:, :, 0] @ np.swapaxes(back[j] @ r[a], 1, 2) for j in (b, k))
    moved_b, moved_k = (np.einsum("tij,tj->ti", back[j], t[a] - t[j])[:, None] for j in (b, k))
    off, per_depth = np.cross(rays[:, :, 2], turned_b), np.cross(rays[:, :, 2], moved_b)
    length = (moved_b**2).sum(axis=2)
    inverse = -(off * per_depth).sum(axis=2) / np.maximum((per_depth**2).sum(axis=2) + EPIPOLE**2 * length, 1e-300)
    xyz = turned_k + np.where(length > 0, inverse, 0.0)[..., None] * moved_k
    return xyz[..., :2] / np.where(xyz[..., 2:] > NEAREST, xyz[..., 2:], np.nan)


def _turn(x: Array, seen: Array, known: NDArray[np.bool_], pixel: float) -> Array:
    """Turns (T, 3) [rad] of rays that move points (T, N, 2) to where they are seen, by most of those that are known."""
    u, v = x[..., 0], x[..., 1]
    rows = np.stack([-u * v, 1 + u * u, -v, -1 - v * v, u * v, u], axis=-1).reshape(*x.shape, 3)
    rows, left = np.where(known[..., None, None], rows, 0.0), np.where(known[..., None], seen - x, 0.0)
    weight, found = known.astype(float), np.zeros((len(x), 3))
    for _ in range(ROUNDS):
        normal = np.einsum("tn,tnci,tncj->tij", weight, rows, rows) + 1e-9 * np.eye(3)
        found = np.linalg.solve(normal, np.einsum("tn,tnci,tnc->ti", weight, rows, left)[..., None])[..., 0]
        after = np.linalg.norm(left - np.einsum("tnci,ti->tnc", rows, found), axis=2)
        scale = MAD * np.nanmedian(np.where(known, after, np.nan), axis=1, keepdims=True)
        limit = WIDTH * np.maximum(np.nan_to_num(scale), LEAST_NOISE_PX * pixel)
        weight = np.where(known, 1 / (1 + (after / limit) ** 2), 0.0)
    return found
