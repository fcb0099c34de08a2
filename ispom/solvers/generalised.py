"""Bundle adjustment over a window of frames of a generalised camera: any number of cameras at known poses in a rig.

Points are inverse depths along the rays of the frames that observed them first (their anchors). Each is observed by one
camera over time, and, where fields of view overlap, by a second one. The known distances between cameras determine the
metric scale: through points that two of them observe, or through rotations of the rig, which move its cameras
differently (Pless, Using many cameras as one, CVPR 2003). `scale_sigma` is the standard deviation of the scale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, skew, so3_exp
from ispom.numerics.robust import robust_loss, robust_weights
from ispom.solvers.least_squares import Derivatives, Family, Loss, Problem, normal_equations
from ispom.solvers.least_squares import adjust as adjusted
from ispom.types import Rig

LEAST_DEPTH = 1e-9
"""Least depth of a point, relative to the length of its ray; with less it is behind the camera."""
ERROR_BEHIND_PX = 1e3
"""Error that a point behind the camera is given [px]."""
LEAST_INVERSE_DEPTH = 1e-6
"""Least inverse depth [1/m]: a point 1000 km away."""
MAX_ITERATIONS, TOLERANCE = 10, 1e-4
KNOWN_LENGTH = 1e-3
"""Relative standard deviation of a length that defines the unit, for covariances in that unit."""
MIN_POINTS_FOR_SCALE = 8
"""Number of points whose depths must determine the scale: a few may be false matches, which no other point
contradicts."""
FREE_LENGTH = 1e6
"""Relative standard deviation of a length that is practically free."""


@dataclass(frozen=True, eq=False)
class Cameras:
    """The C cameras of the rig."""

    names: tuple[str, ...]
    rotations: Array
    """(C, 3, 3) rig_from_camera."""
    centres: Array
    """(C, 3) in the rig [m]."""
    focal_px: Array
    """(C,) focal lengths, which convert errors on the plane z = 1 into pixels."""

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
    """K frames, and M points that they observe; observations are on the plane z = 1 of their cameras."""

    rotations: Array
    """(K, 3, 3) world_from_rig."""
    translations: Array
    """(K, 3)."""
    camera: NDArray[np.int64]
    """(M,) camera that observes the point over time."""
    anchor: NDArray[np.int64]
    """(M,) frame whose observation is the point's ray."""
    rho: Array
    """(M,) inverse depth in the camera of the anchor [1/m]."""
    own: Array
    """(K, M, 2) observations by its camera; NaN where there is none."""
    other: NDArray[np.int64]
    """(K, M) second camera that observes the point in that frame; -1 for none."""
    other_xy: Array
    """(K, M, 2) observations by the second camera."""

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
        """Returns the rays (M, 3) of the anchors' observations, in their cameras, with z = 1."""
        return np.column_stack([self.own[self.anchor, np.arange(len(self.anchor))], np.ones(len(self.anchor))])


@dataclass(frozen=True, eq=False)
class Observations:
    """N observations, sorted by point."""

    point: NDArray[np.int64]
    frame: NDArray[np.int64]
    camera: NDArray[np.int64]
    xy: Array
    by_other: NDArray[np.bool_]

    @staticmethod
    def of(window: Window) -> Observations:
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
        return Observations(point[order], frame[order], camera[order], xy[order], by_other[order])

    def select(self, some: NDArray) -> Observations:
        return Observations(self.point[some], self.frame[some], self.camera[some], self.xy[some], self.by_other[some])


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of N observations, and their derivatives by right rotations and world translations of the frames."""

    px: Array
    """(N, 2) reprojection errors [px]."""
    ahead: NDArray[np.bool_]
    """(N,) whether the point is in front of the camera."""
    by_anchor: Array
    """(N, 2, 6) derivatives by (translation, rotation) of the anchor's frame."""
    by_frame: Array
    """(N, 2, 6) derivatives by those of the observing frame."""
    by_rho: Array
    """(N, 2) derivatives by the inverse depth."""


@dataclass(frozen=True, eq=False)
class Projected:
    """N points in the observing cameras. Homogeneous coordinates are finite at any distance."""

    in_anchor: Array
    """(N, 3) in the rig of the anchor's frame."""
    in_rig: Array
    """(N, 3) in the rig of the observing frame."""
    depth: Array
    """(N,) depth in the observing camera, relative to that in the anchor's."""
    ahead: NDArray[np.bool_]
    """(N,) whether the point is in front of the camera."""
    x: Array
    """(N, 2) projection on the plane z = 1; meaningless behind the camera."""

    @staticmethod
    def of(window: Window, cameras: Cameras, seen: Observations) -> Projected:
        m, i, k, c = seen.point, window.anchor[seen.point], seen.frame, seen.camera
        rho, own = window.rho[m][:, None], window.camera[m]
        in_anchor = _times(cameras.rotations[own], window.rays()[m]) + rho * cameras.centres[own]
        in_world = _times(window.rotations[i], in_anchor) + rho * (window.translations[i] - window.translations[k])
        in_rig = _times_transposed(window.rotations[k], in_world)
        y = _times_transposed(cameras.rotations[c], in_rig - rho * cameras.centres[c])
        ahead = y[:, 2] > LEAST_DEPTH
        return Projected(in_anchor, in_rig, y[:, 2], ahead, y[:, :2] / np.where(ahead, y[:, 2], 1.0)[:, None])

    def errors_px(self, cameras: Cameras, seen: Observations) -> Array:
        """Returns reprojection errors (N, 2); `ERROR_BEHIND_PX` behind the camera."""
        errors = (self.x - seen.xy) * cameras.focal_px[seen.camera][:, None]
        return np.where(self.ahead[:, None], errors, ERROR_BEHIND_PX)


def distances_px(window: Window, cameras: Cameras, seen: Observations) -> Array:
    """Returns lengths (N,) of the reprojection errors [px]."""
    errors = Projected.of(window, cameras, seen).errors_px(cameras, seen)
    return np.sqrt((errors**2).sum(axis=1))


def errors_of(window: Window, cameras: Cameras, seen: Observations) -> Errors:
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


def resect(window: Window, cameras: Cameras, seen: Observations, frame: int, width_px: float) -> tuple[Window, Array]:
    """Localises one frame by known points of all cameras: generalised resection.

    Gauss-Newton with the robust loss, at first as wide as the errors. Returns the window with the new pose, and the
    errors (N,) [px].
    """
    for _ in range(MAX_ITERATIONS):
        errors = errors_of(window, cameras, seen)
        squares = (errors.px**2).sum(axis=1)
        width = max(width_px, float(np.median(np.sqrt(squares)))) if len(squares) else width_px
        weights = robust_weights(squares, width) * errors.ahead
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
    seen: Observations
    errors_px: Array
    """(N,) of the observations."""
    rho_sigma: Array
    """(M,) standard deviations of inverse depths, in the window's unit; inf for points that are observed once."""
    scale_sigma: float
    """Relative standard deviation of the best determined length, which is the displacement or the depth of several
    points; inf where nothing determines the scale."""
    scale_step: float = 0.0
    """Relative change of the displacement's length in the next step, without a prior on it."""


def adjust(window: Window, cameras: Cameras, noise_px: float, held: float = FREE_LENGTH) -> Adjusted:
    """Optimises all points and all frames but the first.

    `held` is the relative standard deviation of a prior: the last frame but one (of two frames, the last one) keeps its
    distance from the first.
    """
    seen, frames = Observations.of(window), len(window.rotations)
    far = max(1, frames - 2)
    way = window.translations - window.translations[0]
    length, last = float(np.linalg.norm(way[far])), float(np.linalg.norm(way[-1]))
    free = _problem(seen, cameras, noise_px, window)
    length_of_far = Length(far, length, np.array([max(held * length, 1e-12)]))
    if len(seen.point):
        problem = replace(free, families=(*free.families, length_of_far)) if length > 1e-6 else free
        window = adjusted(problem, window, MAX_ITERATIONS, TOLERANCE, narrow=True).values
        way = window.translations - window.translations[0]
        length, last = float(np.linalg.norm(way[far])), float(np.linalg.norm(way[-1]))
    equations = normal_equations(free, window)
    reduced = equations.eliminated(0.0)
    covariance, long = _inverse(reduced.matrix), reduced.matrix
    if length > 1e-6:
        known = Length(far, length, np.array([KNOWN_LENGTH * length]))
        long = long + normal_equations(replace(free, families=(known,)), window).shared

    def sigmas(shared: Array) -> Array:
        variances = reduced.block_covariances(shared)[:, 0, 0]
        return np.where(equations.blocks[:, 0, 0] > 0, np.sqrt(np.maximum(variances, 0)), np.inf)

    relative, scale_step = np.inf, 0.0
    if last > 1e-9:
        relative = float(np.sqrt(max(way[-1] @ covariance[-6:-3, -6:-3] @ way[-1], 0.0))) / last**2
        side = reduced.gradient(equations.shared_gradient, equations.block_gradients)
        scale_step = -float(way[-1] @ (covariance @ side)[-6:-3]) / last**2
    depths = np.sort(sigmas(covariance) / window.rho)
    depth = float(depths[MIN_POINTS_FOR_SCALE - 1]) if len(depths) >= MIN_POINTS_FOR_SCALE else np.inf
    errors_px = distances_px(window, cameras, seen)
    return Adjusted(window, seen, errors_px, sigmas(_inverse(long)), min(relative, depth), scale_step)


def _problem(seen: Observations, cameras: Cameras, noise_px: float, window: Window) -> Problem[Window]:
    """Returns the problem of all frames but the first, and all points, with their observations only."""
    frames = len(window.rotations)

    def moved(now: Window, shared: Array, blocks: Array) -> Window:
        rho = np.maximum(now.rho + blocks[:, 0], LEAST_INVERSE_DEPTH)
        return replace(_moved(now, np.arange(1, frames), shared.reshape(-1, 6)), rho=rho)

    points = ImagePoints(seen, cameras, np.full(len(seen.point), noise_px))
    return Problem((points,), moved, 6 * frames - 6, len(window.rho), 1)


@dataclass(frozen=True, eq=False)
class ImagePoints(Family[Window]):
    """Errors of points in the images [px]."""

    seen: Observations
    cameras: Cameras
    widths: Array
    loss: Loss = robust_loss

    def residuals(self, values: Window) -> Array:
        at = Projected.of(values, self.cameras, self.seen)
        return np.where(at.ahead[:, None], at.errors_px(self.cameras, self.seen), np.nan)

    def derivatives(self, values: Window) -> Derivatives:
        errors, frames = errors_of(values, self.cameras, self.seen), (values.anchor[self.seen.point], self.seen.frame)
        columns = np.concatenate([6 * (frame[:, None] - 1) + np.arange(6) for frame in frames], axis=1)
        by_shared = np.concatenate([errors.by_anchor, errors.by_frame], axis=2)
        return Derivatives(by_shared, np.maximum(columns, -1), errors.by_rho[..., None], self.seen.point)


@dataclass(frozen=True, eq=False)
class Length(Family[Window]):
    """A known distance of a frame from the first one."""

    frame: int
    length: float
    widths: Array
    """(1,)."""

    def residuals(self, values: Window) -> Array:
        return np.array([[float(np.linalg.norm(self._way(values))) - self.length]])

    def derivatives(self, values: Window) -> Derivatives:
        way = self._way(values)
        along = way / max(float(np.linalg.norm(way)), 1e-12)
        return Derivatives.of_shared(along[None, None], 6 * self.frame - 6 + np.arange(3)[None])

    def _way(self, values: Window) -> Array:
        return values.translations[self.frame] - values.translations[0]


def reanchored(window: Window, cameras: Cameras, frame: int) -> tuple[Window, NDArray[np.bool_]]:
    """Returns the window without a frame, and the mask (M,) of the points that remain. Points with their anchor in that
    frame get the next frame that observes them."""
    left = np.isfinite(window.own[..., 0])
    left[frame] = False
    first = left.argmax(axis=0)
    moves = (window.anchor == frame) & left.any(axis=0)
    point = np.flatnonzero(moves)
    seen = Observations(
        point, first[point], window.camera[point], window.own[first[point], point], np.zeros(len(point), bool)
    )
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
    """Returns the window with all lengths, except those of the rig, multiplied about the first frame."""
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
    """Returns the covariance; undetermined unknowns get a huge one."""
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    floor = 1e-12 * max(float(values[-1]) if len(values) else 0.0, 1e-12)
    return (vectors / np.maximum(values, floor)) @ vectors.T


def _times(matrices: Array, vectors: Array) -> Array:
    return np.einsum("nab,nb->na", matrices, vectors)


def _times_transposed(matrices: Array, vectors: Array) -> Array:
    return np.einsum("nba,nb->na", matrices, vectors)
