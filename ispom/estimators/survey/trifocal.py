"""Motion of a stereo camera from trifocal transfer, without 3-D points.

Kitt, Geiger and Lategahn, Visual odometry based on stereo image sequences with RANSAC-based outlier rejection scheme,
IEEE Intelligent Vehicles Symposium 2010.

The steps, in the order of the paper and of this file:

1. Features in a circle: corners of the pair t-1 are followed into the left and the right image of t, and the circle
   is closed from the left image of t to its right one. Buckets keep them spread over the image.
2. The trifocal tensor of (left t-1, right t-1, left t or right t) is a function of six velocities alone. It transfers
   an observed pair of t-1 into an image of t. No point of the scene is a parameter.
3. RANSAC: three features each give the velocities by Gauss-Newton on the transfer errors in both images.
4. An iterated Kalman filter joins the prediction (constant velocities) with the transfer errors of all inliers.
5. The covariance of the pose, which is a product of motions: see `trifocal_covariance`.

Differences from the print: derivatives are central differences instead of sigma points, as transfer is all but linear
within the standard deviation of the velocities; features are Shi-Tomasi corners followed by Lucas-Kanade; and each is
weighted by the errors of all its observations, those of t-1 too, instead of by one noise.

Where most features are on something that moves, the motion is relative to that. The covariance takes the calibration as
exact: on real pairs the error is many times larger. A search for a shift within a window of 15 px is biased by some
hundredths of a pixel where the motion varies within it, as on a ground that is near; the covariance lacks this.

Measured: KITTI 06, the first 51 pairs (60 m; `ispom run KITTI/sequences/06 --methods trifocal`): t_err 1.25 %, ATE
0.17 m; in the same measure the window adjustment of `stereo` has 0.61 %. sim:tiny: ATE 2 mm on 4 m.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method
from ispom.estimators.survey.common import OneKind, Result
from ispom.estimators.survey.trifocal_covariance import Changes, Linear
from ispom.features.klt import Klt
from ispom.features.row_search import RowSearch
from ispom.features.shi_tomasi import detect_spread
from ispom.geometry import Array, Pose, so3_exp
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, Landmarks, Rig, Tracks, TrackStatus, as_grey, by_key, colours_at

FOLLOW = Klt(window_px=15, levels=4, max_forward_backward_px=0.5)
"""Tracker from t-1 to t; near points move by tens of pixels."""
CLOSE = Klt(window_px=15, levels=1, max_forward_backward_px=0.5)
"""Tracker from left to right; it starts at the position that closes the circle."""
MAX_CIRCLE_PX = 1.5
"""Largest distance between both ways from left t-1 to right t; either errs by some tenths of a pixel."""
MAX_ROW_PX = 1.5
"""Largest difference of the rows of a rectified pair."""
MIN_DISPARITY_PX = 1.0
"""Points with a smaller disparity have hardly any depth."""
MIN_DISTANCE_PX = 8.0
"""Least distance between features."""
SAMPLES, SAMPLE_ITERATIONS = 100, 4
"""Number of samples of three features, and iterations for each. With 60 % inliers, 20 samples suffice at 99 %."""
ITERATIONS = 5
FIRST_SIGMA = np.array([30.0] * 3 + [1.5] * 3)
"""Standard deviations of the velocities before the first pair: a fast car [m/s], a hand-held camera [rad/s]."""
STEP = np.array([1e-3] * 3 + [1e-4] * 3)
"""Steps of the central differences: displacements [m] and rotations [rad]."""
RIGHT_STEP = 1e-5
"""Step of the central difference by the observation in the right image of t-1, normalised."""
NOW = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 1.0], [1.0, 0.0, 2.0, 0.0], [0.0, 1.0, 0.0, 2.0]])
"""(4, 4) covariance of the observations (u, v left, u, v right) of t by two searches with errors of size 1: from left
t-1 to left t, and from there to right t."""
LARGEST = np.array([5.0] * 3 + [0.5] * 3)
"""Step of an iteration: bad samples would go astray [m], [rad]."""
BEHIND = 1e3
"""Normalised coordinate for points behind the camera, so large that they are never inliers."""
EXPECTED_SHARE = 0.5
"""Share of inliers; with less, more features may belong to a moving object than to the scene."""
SHOWN_BASELINES = 60
"""Depth up to which features are shown in the scene."""

POINTS = Check(
    "stereo_points", "features seen by both cameras", "requirement",
    passes="{value} features are seen by both cameras ({threshold} needed).",
    fails="No features: {value} are seen by both cameras ({threshold} needed).",
)  # fmt: skip
INLIERS = Check(
    "transfer_inliers", "inliers of the trifocal transfer", "requirement", "Pair localised?", topic="pose",
    passes="Located: {value} inliers of the trifocal transfer ({threshold} needed).",
    fails="Lost: {value} inliers of the trifocal transfer ({threshold} needed).",
)  # fmt: skip
SHARE = Check(
    "transfer_share", "share of inliers of the trifocal transfer", "warning",
    passes="{value:.0%} of the features fit one motion ({threshold:.0%} expected).",
    fails="Only {value:.0%} of the features fit one motion ({threshold:.0%} expected): another object may dominate.",
)  # fmt: skip
CHECKS = by_key(POINTS, INLIERS, SHARE)
STAGES = {
    "track": "Follows the features of the last pair into both images, and closes the circle between them.",
    "transfer": "Finds the velocities whose trifocal tensors transfer most features (RANSAC over samples of three).",
    "filter": "Joins the predicted velocities with the transfer errors of all inliers (iterated Kalman filter).",
    "covariance": "Adds what each track has changed the pose by, and squares that of tracks that have ended.",
    "new points": "Detects new corners in empty buckets, and finds them in the right image.",
}


@dataclass(frozen=True)
class TrifocalConfig:
    """Settings of the trifocal method."""

    max_points: Annotated[int, Range(50, 3000), WorthTrying((2,))] = 500
    """Features followed from pair to pair, spread over buckets."""
    inlier_px: Annotated[float, Range(0.2, 10)] = 1.0
    """Largest transfer error of an inlier in each image of the new pair [px]."""
    noise_px: Annotated[float, Range(0.05, 5), WorthTrying((2,))] = 0.35
    """Standard deviation of one observation in the filter [px]; a transfer error has those of three."""
    acceleration_m_s2: Annotated[float, Range(0.1, 100), WorthTrying((4,))] = 8.0
    """Standard deviation of the change of velocity within 1 s, for the prediction; a car that brakes hard has 8."""
    rotation_acceleration_deg_s2: Annotated[float, Range(1, 5000)] = 200.0
    """The same of the angular velocity [degrees/s^2]; a car has 50, a drone hundreds."""
    min_inliers: Annotated[int, Range(6, 500)] = 12
    """Least number of inliers; with fewer the pair is not localised."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the last localised one before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> Trifocal:
        return Trifocal(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Features:
    """N features of a pair."""

    ids: NDArray[np.int64]
    left: NDArray[np.float32]
    """(N, 2) [px]."""
    right: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, some: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Features:
        return Features(self.ids[some], self.left[some], self.right[some])

    def and_more(self, more: Features) -> Features:
        left, right = np.concatenate([self.left, more.left]), np.concatenate([self.right, more.right])
        return Features(np.concatenate([self.ids, more.ids]), left, right)


@dataclass(frozen=True, eq=False)
class Memory:
    """The last localised pair, its features, and the state of the filter."""

    time_ns: int
    left: Image
    right: Image
    features: Features
    next_id: int
    world_from_rig: Pose = field(default_factory=Pose)
    changes: Changes = field(default_factory=Changes)
    """Changes of the pose by the errors of the tracks."""
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) of the left camera in its own axes: [m/s], [rad/s]."""
    covariance: Array = field(default_factory=lambda: np.diag(FIRST_SIGMA**2))
    """(6, 6) of the velocity."""
    lost_pairs: int = 0


@dataclass(frozen=True, eq=False)
class Trifocal(OneKind["Memory | None"]):
    """Gives each pair a metric pose relative to the pair before. World: the rig at the first pair."""

    rig: Rig
    config: TrifocalConfig
    kind = "stereo"
    frame = "rig"

    def begin(self) -> Memory | None:
        return None

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory | None, Result]:
        left, right = as_grey(frame.left), as_grey(frame.right)
        if memory is None:
            return self._begun(frame, left, right, watch, None)
        old, config, camera = memory.features, self.config, self.rig.camera("left")
        features, status = follow(memory, left, right)
        index = np.flatnonzero(status == TrackStatus.ALIVE)
        before, now = old[index], features[index]
        seen = [camera.normalise(uv) for uv in (before.left, before.right, now.left, now.right)]
        views = Views(seen[0], seen[1], seen[2], seen[3], self.rig.baseline_m)
        watch.lap("track")

        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        predicted, limit = seconds * memory.velocity, config.inlier_px / camera.fx
        sampled = ransac(views, predicted, limit)
        watch.lap("transfer")

        gained = seconds * np.repeat((config.acceleration_m_s2, np.radians(config.rotation_acceleration_deg_s2)), 3)
        expected = Expected(predicted, seconds**2 * (memory.covariance + np.diag(gained**2)))
        noise = config.noise_px / camera.fx
        motion, covariance, errors = filtered(views, expected, sampled, limit, noise)
        inliers = errors <= limit
        watch.lap("filter")

        located = INLIERS.of(inliers.sum(), config.min_inliers)
        decisions = (located, SHARE.of(inliers.mean() if len(index) else 0.0, EXPECTED_SHARE))
        status[index[~inliers]] = TrackStatus.EPIPOLAR
        residual = np.full(len(old), np.nan)
        residual[index] = errors * camera.fx
        if not located.passed:
            return self._lost(memory, frame, left, right, decisions, watch)
        changes = changes_of(views[inliers], now[inliers].left, motion, expected, noise)
        pose, sure = self._moved(memory, motion, now[inliers], changes)
        watch.lap("covariance")
        stay = status == TrackStatus.ALIVE
        new = self._new_features(left, right, features.left[stay], memory.next_id)
        watch.lap("new points")
        after = Memory(
            frame.time_ns, left, right, features[stay].and_more(new), memory.next_id + len(new),
            pose, sure, motion / seconds, covariance / seconds**2,
        )  # fmt: skip
        tracks = _tracks(old, features, status, residual, new)
        return after, self._result(frame, after, tracks, decisions)

    def _moved(
        self, memory: Memory, motion: Array, inliers: Features, changes: tuple[Array, Array]
    ) -> tuple[Pose, Changes]:
        """Returns world_from_rig after the motion (6,) of the left camera, and the changes of it by the tracks.
        `changes` of the motion are the result of `changes_of`."""
        before_from_now, rig_from_left = pose_of(motion), self.rig.rig_from_left
        step = rig_from_left @ before_from_now @ rig_from_left.inverse()
        # From the axes of the left camera before to those now; the rotation within the step is small.
        to_twist = rig_from_left.adjoint @ Pose(before_from_now.rotation.T).adjoint
        by_tracks, by_prediction = changes[0] @ to_twist.T, to_twist @ changes[1] @ to_twist.T
        after = memory.changes.after(step, inliers.ids, by_tracks, by_prediction)
        return memory.world_from_rig @ step, after

    def _begun(
        self, frame: Frame, left: Image, right: Image, watch: Stopwatch, memory: Memory | None
    ) -> tuple[Memory | None, Result]:
        """Begins at a pair: the first one, or after a loss at the last known pose."""
        new = self._new_features(left, right, np.zeros((0, 2), np.float32), 0 if memory is None else memory.next_id)
        watch.lap("new points")
        points = POINTS.of(len(new), self.config.min_inliers)
        if not points.passed:
            return memory, Result(decisions=(points,))
        after = Memory(frame.time_ns, left, right, new, len(new))
        if memory is not None:
            after = replace(
                after, next_id=memory.next_id + len(new), world_from_rig=memory.world_from_rig,
                changes=memory.changes.ended(),
            )  # fmt: skip
        tracks = _tracks(new[:0], new[:0], np.zeros(0, np.uint8), np.zeros(0), new)
        result = self._result(frame, after, tracks, (points,))
        return after, replace(result, restarted=memory is not None)

    def _lost(
        self, memory: Memory, frame: Frame, left: Image, right: Image, decisions: tuple[Decision, ...], watch: Stopwatch
    ) -> tuple[Memory | None, Result]:
        """Keeps the last localised pair for the next one, or begins again here after too many."""
        if memory.lost_pairs < self.config.max_lost_pairs:
            return replace(memory, lost_pairs=memory.lost_pairs + 1), Result(decisions=decisions)
        after, result = self._begun(frame, left, right, watch, memory)
        return after, replace(result, decisions=(*decisions, *result.decisions))

    def _new_features(self, left: Image, right: Image, taken: NDArray[np.float32], first_id: int) -> Features:
        """Detects corners in buckets with few features, and finds them along the rows of the right image."""
        uv = detect_spread(left, self.config.max_points, taken, MIN_DISTANCE_PX)
        disparity, _ = RowSearch().disparity(left, right, uv)
        good = disparity >= MIN_DISPARITY_PX
        uv_right = uv[good] - np.column_stack([disparity[good], np.zeros(good.sum())]).astype(np.float32)
        return Features(first_id + np.arange(good.sum()), uv[good], uv_right)

    def _result(self, frame: Frame, memory: Memory, tracks: Tracks, decisions: tuple[Decision, ...]) -> Result:
        """Landmarks are for display only: the method itself has none."""
        features, pose = memory.features, memory.world_from_rig
        disparity = (features.left - features.right)[:, 0]
        xyz = points_from_disparity(self.rig.camera("left"), self.rig.baseline_m, features.left, disparity)
        near = xyz[:, 2] <= SHOWN_BASELINES * self.rig.baseline_m
        world = (pose @ self.rig.rig_from_left).apply(xyz[near])
        used = tracks.status == TrackStatus.ALIVE
        return Result(
            pose,
            decisions,
            {"left": tracks},
            Landmarks(features.ids[near], world, colours_at(frame.left, features.left[near])),
            tracks.residual_px[used].astype(float),
            memory.changes.covariance,
            key_frame=True,
        )


def _tracks(old: Features, now: Features, status: NDArray[np.uint8], residual: Array, new: Features) -> Tracks:
    """Returns the followed features, those that ended where they were last, and the new ones."""
    alive = (status == TrackStatus.ALIVE)[:, None]
    left, right = (np.where(alive, a, b) for a, b in ((now.left, old.left), (now.right, old.right)))
    gap = np.full(len(new), np.nan, np.float32)
    return Tracks.of(
        np.concatenate([old.ids, new.ids]),
        np.concatenate([left, new.left]),
        uv_prev=np.concatenate([old.left, np.column_stack([gap, gap])]),
        status=np.concatenate([status, np.full(len(new), TrackStatus.NEW)]),
        residual_px=np.concatenate([np.where(np.isfinite(residual), residual, np.nan), gap]),
        disparity_px=np.concatenate([left - right, new.left - new.right])[:, 0],
    )


# Step 1: the circle left t-1, right t-1, right t, left t


def follow(memory: Memory, left: Image, right: Image) -> tuple[Features, NDArray[np.uint8]]:
    """Follows the features into both images; returns them, and TrackStatus (N,)."""
    old = memory.features
    uv_left, status = FOLLOW.track(memory.left, left, old.left)
    uv_right, right_status = FOLLOW.track(memory.right, right, old.right)
    closed, circle_status = CLOSE.track(left, right, uv_left, uv_right)
    alive = status == TrackStatus.ALIVE
    status[alive] = np.where(right_status == TrackStatus.ALIVE, circle_status, right_status)[alive]
    disparity, rows = (uv_left - closed).T
    fits = (np.abs(closed - uv_right).max(axis=1, initial=0) <= MAX_CIRCLE_PX) & (np.abs(rows) <= MAX_ROW_PX)
    status[(status == TrackStatus.ALIVE) & ~(fits & (disparity >= MIN_DISPARITY_PX))] = TrackStatus.NO_DISPARITY
    return Features(old.ids, uv_left, closed), status


# Step 2: the trifocal tensor as a function of the motion


@dataclass(frozen=True, eq=False)
class Views:
    """Observations of N features in the previous and in the present pair; each (N, 2) normalised."""

    left_before: Array
    right_before: Array
    left: Array
    right: Array
    baseline_m: float

    def __len__(self) -> int:
        return len(self.left)

    def __getitem__(self, some: Any) -> Views:
        """Returns views of these features: with an index (..., K), of shape (..., K, 2)."""
        before, now = (self.left_before[some], self.right_before[some]), (self.left[some], self.right[some])
        return Views(*before, *now, self.baseline_m)


def trifocal_tensor(rotation: Array, translation: Array, baseline_m: float) -> Array:
    """Returns T (..., 3, 3, 3) of left t-1 [I | 0], right t-1 [I | -b] and a camera [R | t] (Hartley 15.1): with the
    columns a of the second and c of the third one, T_i^jk = a_i^j c_4^k - a_4^j c_i^k."""
    fourth = np.array([-baseline_m, 0.0, 0.0])
    first = np.eye(3)[:, :, None] * translation[..., None, None, :]
    return first - fourth[:, None] * np.swapaxes(rotation, -1, -2)[..., :, None, :]


def transferred(tensor: Array, views: Views) -> Array:
    """Returns (..., N, 2) normalised: x_k = x_i l_j T_i^jk, with the line l through the right observation at right
    angles to its epipolar line, which is a row: l is a column. Points behind the camera get the coordinate BEHIND."""
    one = np.ones((*views.left_before.shape[:-1], 1))
    point = np.concatenate([views.left_before, one], axis=-1)
    line = np.concatenate([one, 0 * one, -views.right_before[..., :1]], axis=-1)
    x = np.einsum("...ni,...nj,...ijk->...nk", point, line, tensor)
    ahead = x[..., 2:] > 1e-9 * views.baseline_m
    return np.where(ahead, x[..., :2] / np.where(ahead, x[..., 2:], 1.0), BEHIND)


def pose_of(motion: Array) -> Pose:
    """Returns left_before_from_left of a displacement and a rotation vector (6,): velocities times the interval."""
    return Pose(so3_exp(motion[3:]), motion[:3])


def predictions(motion: Array, views: Views) -> Array:
    """Returns where motions (..., 6) transfer the features to in the left and the right image: (..., N, 4)."""
    rotation = np.swapaxes(so3_exp(motion[..., 3:]), -1, -2)
    translation = -np.einsum("...ij,...j->...i", rotation, motion[..., :3])
    baseline = np.array([views.baseline_m, 0.0, 0.0])
    tensors = (trifocal_tensor(rotation, t, views.baseline_m) for t in (translation, translation - baseline))
    return np.concatenate([transferred(tensor, views) for tensor in tensors], axis=-1)


def errors_of(motion: Array, views: Views) -> Array:
    """Returns the larger of the transfer errors in both images (..., N), normalised."""
    difference = predictions(motion, views) - np.concatenate([views.left, views.right], axis=-1)
    u_left, v_left, u_right, v_right = np.moveaxis(difference, -1, 0)
    return np.maximum(np.hypot(u_left, v_left), np.hypot(u_right, v_right))


def linearised(motion: Array, views: Views) -> tuple[Array, Array]:
    """Returns the derivatives (..., 6, N, 4) of the predictions of motions (..., 6), and residuals (..., N, 4)."""
    step = np.diag(STEP)
    ahead, back = (
        predictions(motion[..., None, :] + s, views[..., None, :, :]) for s in (step, -step)
    )  # (..., 6, N, 4)
    jacobian = (ahead - back) / (2 * STEP[:, None, None])
    return jacobian, np.concatenate([views.left, views.right], axis=-1) - predictions(motion, views)


def normal_equations(motion: Array, views: Views, noise: float) -> tuple[Array, Array]:
    """Returns the information (..., 6, 6) on motions (..., 6), and the gradient (..., 6) towards the observations, with
    independent transfer errors of one size."""
    jacobian, residuals = linearised(motion, views)
    information = np.einsum("...anm,...bnm->...ab", jacobian, jacobian) / noise**2
    return information, np.einsum("...anm,...nm->...a", jacobian, residuals) / noise**2


# Step 3: RANSAC


def ransac(views: Views, predicted: Array, limit: float) -> Array:
    """Returns the motion (6,) of the sample of three features whose transfer errors, cut off at `limit`, are least;
    the predicted one is among them."""
    if len(views) < 3:
        return predicted
    rng = np.random.default_rng(0)
    samples = np.argsort(rng.random((SAMPLES, len(views))), axis=1, kind="stable")[:, :3]
    motions = np.tile(predicted, (SAMPLES, 1))
    for _ in range(SAMPLE_ITERATIONS):
        information, gradient = normal_equations(motions, views[samples], limit)
        information += np.einsum("sii,jk->sjk", information, 1e-9 * np.eye(6)) + 1e-9 * np.eye(6)
        motions = motions + np.clip(np.linalg.solve(information, gradient[..., None])[..., 0], -LARGEST, LARGEST)
    motions = np.concatenate([predicted[None], motions])
    costs = np.minimum(errors_of(motions, views[None]) / limit, 1.0) ** 2
    return motions[np.argmin(costs.sum(axis=1))]


# Step 4: the iterated Kalman filter, in its information form


@dataclass(frozen=True, eq=False)
class Expected:
    """The predicted motion."""

    motion: Array
    """(6,)."""
    covariance: Array
    """(6, 6)."""


def weighted(motion: Array, views: Views, noise: float) -> tuple[Array, Array]:
    """Returns the derivatives (N, 4, 6) of the predictions of a motion (6,), and the residuals (N, 4). Both are
    whitened, for observations with the standard deviation `noise`.

    An error in the right image of t-1 moves the transferred points in both images. An error in the left image of t also
    moves the right observation, because its search starts there.
    """
    jacobian, residuals = linearised(motion, views)
    step = np.array([RIGHT_STEP, 0.0])
    ahead, back = (
        predictions(motion, replace(views, right_before=views.right_before + s)) for s in (step, -step)
    )  # (N, 4)
    by_before = (ahead - back) / (2 * RIGHT_STEP)
    root = np.linalg.cholesky(NOW + by_before[:, :, None] * by_before[:, None, :])
    return (
        np.linalg.solve(root, jacobian.transpose(1, 2, 0)) / noise,
        np.linalg.solve(root, residuals[..., None])[..., 0] / noise,
    )


def filtered(views: Views, expected: Expected, start: Array, limit: float, noise: float) -> tuple[Array, Array, Array]:
    """Returns the motion (6,), its covariance (6, 6), and the transfer errors (N,) that it leaves, normalised.

    The covariance is that of independent errors of the size `noise`. The linearisation begins at `start`, whose inliers
    count.
    """
    prior = np.linalg.inv(expected.covariance)
    motion = start
    for _ in range(ITERATIONS):
        inliers = np.flatnonzero(errors_of(motion, views) <= limit)
        derivatives, residuals = weighted(motion, views[inliers], noise)
        information = np.einsum("nma,nmb->ab", derivatives, derivatives) + prior
        gradient = np.einsum("nma,nm->a", derivatives, residuals) + prior @ (expected.motion - motion)
        motion = motion + np.linalg.solve(information, gradient)
    return motion, np.linalg.inv(information), errors_of(motion, views)


def changes_of(inliers: Views, uv: Array, motion: Array, expected: Expected, noise: float) -> tuple[Array, Array]:
    """Returns the changes (N, 6) of a filtered motion by each of its inliers, seen at `uv` (N, 2) [px], and its
    covariance (6, 6) by the error of the prediction."""
    derivatives, residuals = weighted(motion, inliers, noise)
    prior = np.linalg.inv(expected.covariance)
    inverse = np.linalg.inv(np.einsum("nma,nmb->ab", derivatives, derivatives) + prior)
    return Linear(inverse, derivatives, residuals).changes(uv), inverse @ prior @ inverse


METHOD = Method(
    "trifocal",
    STEREO,
    TrifocalConfig,
    "metric",
    "Kitt, Geiger and Lategahn 2010",
    checks=CHECKS,
    stages=STAGES,
    survey="Table 3, two cameras: tri- or quadrifocal",
)
