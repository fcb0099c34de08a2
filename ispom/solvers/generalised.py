"""Bundle adjustment over a window of frames of a generalised camera: any number of cameras at known poses in a rig.

Points are inverse depths along the rays of the frames that saw them first (their anchors). Each is seen by one camera
over time, and, where fields of view overlap, by a second one. Metric scale is in the known distances between cameras:
through points that two of them see, or through rotations of the rig, which move its cameras differently (Pless, Using
many cameras as one, CVPR 2003). `scale_sigma` says how well either determines it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, skew, so3_exp
from ispom.numerics.levenberg_marquardt import minimise
from ispom.numerics.robust import cauchy_cost, cauchy_weights
from ispom.types import Rig

LEAST_DEPTH = 1e-9
"""Of a point relative to the length of its ray; with less it is behind the camera."""
BEHIND_PX = 1e3
"""Error of a point behind the camera."""
LEAST_INVERSE_DEPTH = 1e-6
"""[1/m]: as good as infinitely far."""
ITERATIONS, TOLERANCE = 10, 1e-4
KNOWN_LENGTH = 1e-3
"""Relative standard deviation of a length that defines the unit, for covariances in that unit."""
AGREEING = 8
"""Points whose depths are known: a few may be false matches, which are tied to nothing else."""
FREE = 1e6
"""Relative standard deviation of a length that is not held."""


@dataclass(frozen=True, eq=False)
class Cameras:
    """The C cameras of the rig."""

    names: tuple[str, ...]
    rotations: Array
    """(C, 3, 3) rig_from_camera."""
    centres: Array
    """(C, 3) in the rig [m]."""
    focal_px: Array
    """(C,) turns errors on the plane z = 1 into pixels."""

    @staticmethod
    def of(rig: Rig, names: tuple[str, ...]) -> Cameras:
        """Returns these cameras of a rig."""
        poses, cameras = [rig.rig_from(name) for name in names], [rig.camera(name) for name in names]
        return Cameras(
            names,
            np.array([pose.rotation for pose in poses]),
            np.array([pose.translation for pose in poses]),
            np.array([(camera.fx + camera.fy) / 2 for camera in cameras]),
        )


@dataclass(frozen=True, eq=False)
class Window:
    """K frames, and M points that they see; observations are on the plane z = 1 of their cameras."""

    rotations: Array
    """(K, 3, 3) world_from_rig."""
    translations: Array
    """(K, 3)."""
    camera: NDArray[np.int64]
    """(M,) that sees the point over time."""
    anchor: NDArray[np.int64]
    """(M,) frame whose observation is the point's ray."""
    rho: Array
    """(M,) inverse depth in the camera of the anchor [1/m]."""
    own: Array
    """(K, M, 2) observations by its camera; NaN where there is none."""
    other: NDArray[np.int64]
    """(K, M) second camera that sees the point in that frame; -1 for none."""
    other_xy: Array
    """(K, M, 2) observations by that."""

    def pose(self, frame: int) -> Pose:
        """world_from_rig."""
        return Pose(self.rotations[frame], self.translations[frame])

    def with_pose(self, frame: int, pose: Pose) -> Window:
        rotations, translations = self.rotations.copy(), self.translations.copy()
        rotations[frame], translations[frame] = pose.rotation, pose.translation
        return replace(self, rotations=rotations, translations=translations)

    def select(self, points: NDArray) -> Window:
        """Returns the window with some of the points only."""
        return replace(
            self, camera=self.camera[points], anchor=self.anchor[points], rho=self.rho[points],
            own=self.own[:, points], other=self.other[:, points], other_xy=self.other_xy[:, points],
        )  # fmt: skip

    def rays(self) -> Array:
        """(M, 3) of the anchors, in their cameras, with z = 1."""
        return np.column_stack([self.own[self.anchor, np.arange(len(self.anchor))], np.ones(len(self.anchor))])


@dataclass(frozen=True, eq=False)
class Seen:
    """N observations, sorted by point."""

    point: NDArray[np.int64]
    frame: NDArray[np.int64]
    camera: NDArray[np.int64]
    xy: Array
    by_other: NDArray[np.bool_]

    @staticmethod
    def of(window: Window) -> Seen:
        """Returns all observations but those of the anchors, which are exact by definition."""
        own = np.isfinite(window.own[..., 0])
        own[window.anchor, np.arange(len(window.anchor))] = False
        points, frames = np.nonzero(own.T)
        others, other_frames = np.nonzero(window.other.T >= 0)
        point, frame = np.concatenate([points, others]), np.concatenate([frames, other_frames])
        camera = np.concatenate([window.camera[points], window.other[other_frames, others]])
        xy = np.concatenate([window.own[frames, points], window.other_xy[other_frames, others]])
        by_other = np.arange(len(point)) >= len(points)
        order = np.argsort(point, kind="stable")
        return Seen(point[order], frame[order], camera[order], xy[order], by_other[order])

    def select(self, some: NDArray) -> Seen:
        return Seen(self.point[some], self.frame[some], self.camera[some], self.xy[some], self.by_other[some])


@dataclass(frozen=True, eq=False)
class Errors:
    """Of N observations [px], and their derivatives by right rotations and world translations of the frames."""

    px: Array
    """(N, 2)."""
    ahead: NDArray[np.bool_]
    """(N,) whether the point is in front of the camera."""
    by_anchor: Array
    """(N, 2, 6) by (translation, rotation) of the anchor's frame,"""
    by_frame: Array
    """(N, 2, 6) of the frame that sees it,"""
    by_rho: Array
    """(N, 2) and by the inverse depth."""


@dataclass(frozen=True, eq=False)
class Projected:
    """N points in the cameras that see them, in homogeneous coordinates: none is too far away."""

    in_anchor: Array
    """(N, 3) in the rig of the anchor's frame,"""
    in_rig: Array
    """(N, 3) in the rig of the frame that sees it,"""
    depth: Array
    """(N,) in the camera, relative to that in the anchor's,"""
    ahead: NDArray[np.bool_]
    """(N,) whether it is in front of the camera,"""
    x: Array
    """(N, 2) and where, on the plane z = 1; meaningless behind the camera."""

    @staticmethod
    def of(window: Window, cameras: Cameras, seen: Seen) -> Projected:
        m, i, k, c = seen.point, window.anchor[seen.point], seen.frame, seen.camera
        rho, own = window.rho[m][:, None], window.camera[m]
        in_anchor = _times(cameras.rotations[own], window.rays()[m]) + rho * cameras.centres[own]
        in_world = _times(window.rotations[i], in_anchor) + rho * (window.translations[i] - window.translations[k])
        in_rig = _times_transposed(window.rotations[k], in_world)
        y = _times_transposed(cameras.rotations[c], in_rig - rho * cameras.centres[c])
        ahead = y[:, 2] > LEAST_DEPTH
        return Projected(in_anchor, in_rig, y[:, 2], ahead, y[:, :2] / np.where(ahead, y[:, 2], 1.0)[:, None])

    def errors_px(self, cameras: Cameras, seen: Seen) -> Array:
        """Returns reprojection errors (N, 2); `BEHIND_PX` behind the camera."""
        errors = (self.x - seen.xy) * cameras.focal_px[seen.camera][:, None]
        return np.where(self.ahead[:, None], errors, BEHIND_PX)


def distances_px(window: Window, cameras: Cameras, seen: Seen) -> Array:
    """Returns lengths (N,) of the reprojection errors [px]."""
    errors = Projected.of(window, cameras, seen).errors_px(cameras, seen)
    return np.sqrt((errors**2).sum(axis=1))


def errors_of(window: Window, cameras: Cameras, seen: Seen) -> Errors:
    """Returns the reprojection errors of observations, and their derivatives."""
    i, k, c, own = window.anchor[seen.point], seen.frame, seen.camera, window.camera[seen.point]
    at, rho = Projected.of(window, cameras, seen), window.rho[seen.point][:, None, None]
    by_rho = _times(window.rotations[i], cameras.centres[own]) + window.translations[i] - window.translations[k]
    by_rho = _times_transposed(window.rotations[k], by_rho) - cameras.centres[c]
    slope = cameras.focal_px[c] / np.where(at.ahead, at.depth, np.inf)
    by_camera = np.zeros((len(i), 2, 3))
    by_camera[:, 0, 0] = by_camera[:, 1, 1] = slope
    by_camera[:, :, 2] = -at.x * slope[:, None]
    by_rig = by_camera @ np.swapaxes(cameras.rotations[c], 1, 2)
    by_world = by_rig @ np.swapaxes(window.rotations[k], 1, 2)
    by_anchor_rotation = -(by_world @ window.rotations[i]) @ skew(at.in_anchor)
    return Errors(
        at.errors_px(cameras, seen),
        at.ahead,
        np.concatenate([rho * by_world, by_anchor_rotation], axis=2),
        np.concatenate([-rho * by_world, by_rig @ skew(at.in_rig)], axis=2),
        _times(by_rig, by_rho),
    )


def resect(window: Window, cameras: Cameras, seen: Seen, frame: int, width_px: float) -> tuple[Window, Array]:
    """Moves one frame so that known points of all cameras fall on their observations: generalised resection.

    Gauss-Newton with Cauchy weights, as wide at first as the errors are. Returns the errors (N,) [px], too.
    """
    for _ in range(ITERATIONS):
        errors = errors_of(window, cameras, seen)
        squares = (errors.px**2).sum(axis=1)
        width = max(width_px, float(np.median(np.sqrt(squares)))) if len(squares) else width_px
        weights = cauchy_weights(squares, width) * errors.ahead
        jacobian = errors.by_frame
        information = np.einsum("n,nab,nac->bc", weights, jacobian, jacobian)
        information += 1e-9 * (np.trace(information) + 1.0) * np.eye(6)
        step = -np.linalg.solve(information, np.einsum("n,nab,na->b", weights, jacobian, errors.px))
        window = _moved(window, np.array([frame]), step[None])
        if width == width_px and np.abs(step).max() < 1e-7:
            break
    return window, distances_px(window, cameras, seen)


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The result of `adjust`."""

    window: Window
    seen: Seen
    errors_px: Array
    """(N,) of the observations."""
    rho_sigma: Array
    """(M,) standard deviations of inverse depths, in the present unit; inf for points that are seen once."""
    scale_sigma: float
    """Relative standard deviation of the best known length, the displacement or the depth of several points: inf where
    nothing determines the scale."""
    scale_step: float = 0.0
    """By how much that of the displacement would change in the next step, relatively, if nothing held it."""


def adjust(window: Window, cameras: Cameras, noise_px: float, held: float = FREE) -> Adjusted:
    """Optimises all points and all frames but the first; `held`: relative standard deviation with which the distance
    of the last frame but one (of two frames, the last one) from the first keeps its length."""
    seen, frames = Seen.of(window), len(window.rotations)
    far = max(1, frames - 2)
    length = float(np.linalg.norm(window.translations[far] - window.translations[0]))
    hold = 1 / (held * length) if length > 1e-6 else 0.0

    def pull(now: Window) -> tuple[float, Array]:
        """Returns by how much the held length is off, in its standard deviations, and the derivative (3,)."""
        way = now.translations[far] - now.translations[0]
        now_long = float(np.linalg.norm(way))
        return hold * (now_long - length), hold * way / max(now_long, 1e-12)

    def cost(now: Window) -> float:
        return cauchy_cost(distances_px(now, cameras, seen) ** 2, noise_px) + 0.5 * pull(now)[0] ** 2

    def stepped(now: Window, damping: float) -> Window:
        system = System.of(now, cameras, seen, noise_px)
        off, slope = pull(now)
        reduced, side = system.reduced(damping)
        at = slice(6 * far - 6, 6 * far - 3)
        reduced[at, at] += np.outer(slope, slope)
        side[at] += off * slope
        reduced[np.diag_indices(len(side))] += damping * np.diag(reduced) + 1e-9
        step = -np.linalg.solve(reduced, side)
        rho = now.rho + system.points(step, damping)
        moved = _moved(now, np.arange(1, frames), step.reshape(-1, 6))
        return replace(moved, rho=np.maximum(rho, LEAST_INVERSE_DEPTH))

    if len(seen.point):
        window = minimise(window, cost, stepped, ITERATIONS, TOLERANCE).values
    errors_px = distances_px(window, cameras, seen)
    system, way = System.of(window, cameras, seen, noise_px), window.translations - window.translations[0]
    reduced, side = system.reduced(0.0)
    free = _inverse(reduced)
    at, long = slice(6 * far - 6, 6 * far - 3), float(np.linalg.norm(way[far]))
    if long > 1e-6:
        reduced[at, at] += np.outer(way[far], way[far]) / (KNOWN_LENGTH * long**2) ** 2
    rho_sigma = system.depth_sigmas(_inverse(reduced))
    last = float(np.linalg.norm(way[-1]))
    relative = float(np.sqrt(max(way[-1] @ free[-6:-3, -6:-3] @ way[-1], 0.0))) / last**2 if last > 1e-9 else np.inf
    scale_step = -float(way[-1] @ (free @ side)[-6:-3]) / last**2 if last > 1e-9 else 0.0
    depths = np.sort(system.depth_sigmas(free) / window.rho)
    depth = float(depths[AGREEING - 1]) if len(depths) >= AGREEING else np.inf
    return Adjusted(window, seen, errors_px, rho_sigma, min(relative, depth), scale_step)


@dataclass(frozen=True, eq=False)
class System:
    """Normal equations of all frames but the first (6 (K - 1)) and of all points, as a sum over observations."""

    frames: Array
    """(6K - 6, 6K - 6)."""
    frames_side: Array
    mixed: Array
    """(M, 6K - 6)."""
    depths: Array
    """(M,)."""
    depths_side: Array

    @staticmethod
    def of(window: Window, cameras: Cameras, seen: Seen, noise_px: float) -> System:
        errors, size = errors_of(window, cameras, seen), 6 * len(window.rotations)
        squares = (errors.px**2).sum(axis=1)
        root = np.sqrt(cauchy_weights(squares, noise_px) * errors.ahead) / noise_px
        n = np.arange(len(root))
        jacobian = np.zeros((len(root), 2, size))
        column = 6 * np.stack([window.anchor[seen.point], seen.frame])[..., None] + np.arange(6)  # (2, N, 6)
        for place, block in zip(column, (errors.by_anchor, errors.by_frame), strict=True):
            jacobian[n[:, None], :, place] += np.swapaxes(block * root[:, None, None], 1, 2)
        jacobian = jacobian[:, :, 6:]
        by_rho, px = errors.by_rho * root[:, None], errors.px * root[:, None]
        count = len(window.rho)
        mixed = np.zeros((count, size - 6))
        np.add.at(mixed, seen.point, np.einsum("na,nab->nb", by_rho, jacobian))
        flat = jacobian.reshape(-1, size - 6)
        return System(
            flat.T @ flat,
            flat.T @ px.reshape(-1),
            mixed,
            np.bincount(seen.point, (by_rho**2).sum(axis=1), count).astype(float),
            np.bincount(seen.point, (by_rho * px).sum(axis=1), count).astype(float),
        )

    def reduced(self, damping: float) -> tuple[Array, Array]:
        """Returns the normal equations of the frames alone (Schur complement)."""
        inverse = self._inverse_depths(damping)
        weighted = self.mixed * inverse[:, None]
        return self.frames - weighted.T @ self.mixed, self.frames_side - weighted.T @ self.depths_side

    def points(self, step: Array, damping: float) -> Array:
        """Returns the step (M,) of the inverse depths that belongs to one of the frames."""
        return -self._inverse_depths(damping) * (self.depths_side + self.mixed @ step)

    def depth_sigmas(self, covariance: Array) -> Array:
        """Returns the standard deviations (M,) of inverse depths from the covariance of the frames."""
        inverse = self._inverse_depths(0.0)
        by_frames = self.mixed * inverse[:, None]
        variance = inverse + np.einsum("ma,ab,mb->m", by_frames, covariance, by_frames)
        return np.where(self.depths > 0, np.sqrt(np.maximum(variance, 0)), np.inf)

    def _inverse_depths(self, damping: float) -> Array:
        return np.where(self.depths > 0, 1 / np.maximum((1 + damping) * self.depths, 1e-12), 0.0)


def reanchored(window: Window, cameras: Cameras, frame: int) -> tuple[Window, NDArray[np.bool_]]:
    """Returns the window without a frame, and which (M,) of its points are left in it; those anchored in that frame
    are anchored in the next one that sees them."""
    left = np.isfinite(window.own[..., 0])
    left[frame] = False
    first = left.argmax(axis=0)
    moves = (window.anchor == frame) & left.any(axis=0)
    point = np.flatnonzero(moves)
    seen = Seen(point, first[point], window.camera[point], window.own[first[point], point], np.zeros(len(point), bool))
    rho = window.rho.copy()
    depth = Projected.of(window, cameras, seen).depth
    rho[point] = np.maximum(rho[point] / np.where(depth > LEAST_DEPTH, depth, 1.0), LEAST_INVERSE_DEPTH)
    stay = moves | (window.anchor != frame)
    stay[point[depth <= LEAST_DEPTH]] = False
    anchor = np.where(moves, first, window.anchor)
    anchor -= anchor > frame
    others = np.arange(len(window.rotations)) != frame
    reduced = Window(
        window.rotations[others], window.translations[others], window.camera, anchor, rho, window.own[others],
        window.other[others], window.other_xy[others],
    )  # fmt: skip
    return reduced.select(stay), stay


def scaled(window: Window, factor: float) -> Window:
    """Returns the window with all lengths but those of the rig multiplied, about its first frame."""
    way = window.translations - window.translations[0]
    return replace(window, translations=window.translations[0] + factor * way, rho=window.rho / factor)


def points_in_world(window: Window, cameras: Cameras) -> Array:
    """Returns all points (M, 3)."""
    i, own, rho = window.anchor, window.camera, window.rho[:, None]
    in_rig = _times(cameras.rotations[own], window.rays()) / rho + cameras.centres[own]
    return _times(window.rotations[i], in_rig) + window.translations[i]


def _moved(window: Window, frames: NDArray[np.int64], steps: Array) -> Window:
    """Returns the window with frames moved by steps (F, 6): translations in the world, rotations on the right."""
    rotations, translations = window.rotations.copy(), window.translations.copy()
    translations[frames] += steps[:, :3]
    rotations[frames] = rotations[frames] @ so3_exp(steps[:, 3:])
    return replace(window, rotations=rotations, translations=translations)


def _inverse(information: Array) -> Array:
    """Returns the covariance; what is not determined at all gets a huge one."""
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    floor = 1e-12 * max(float(values[-1]) if len(values) else 0.0, 1e-12)
    return (vectors / np.maximum(values, floor)) @ vectors.T


def _times(matrices: Array, vectors: Array) -> Array:
    return np.einsum("nab,nb->na", matrices, vectors)


def _times_transposed(matrices: Array, vectors: Array) -> Array:
    return np.einsum("nba,nb->na", matrices, vectors)
