"""Integrated, modern: one windowed problem over the raw observations of both cameras, each at its own time.

A cumulative cubic B-spline through the last few stereo pairs is adjusted to all that the video and the stereo camera
saw in that time. They need not see the same points: pairs make the spline metric, the video shapes it between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.frame_interval import FrameInterval
from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.joint_report import report
from ispom.estimators.modern.integrated.joint_window import USUAL_KNOT_FRAMES, JointWindow
from ispom.estimators.modern.integrated.view import Noise, View
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range
from ispom.solvers.anchoring import anchored
from ispom.solvers.continuous import RigModel
from ispom.solvers.pose_covariance import pose_covariance, pose_information
from ispom.solvers.resection import Resection, refine_pose, resect
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Exposure,
    Landmarks,
    Rig,
    Status,
    Step,
    StereoPair,
    Tracks,
    TrackStatus,
    Trajectory,
    VideoFrame,
    colours_at,
)

MIN_POINTS = 8
"""Fewer known points than this, and an exposure is placed by the motion before it."""

ENOUGH_POINTS = 30
"""Of points that were adjusted: with so many, an exposure is placed by them alone."""

INLIER = 8.0
"""Of a resection: larger reprojection errors, in those of an observation, are wrong points."""


@dataclass(frozen=True)
class ModernIntegratedConfig:
    """Settings of the modern integration."""

    window_pairs: Annotated[int, Range(2, 12)] = 5
    """Stereo pairs adjusted together, with the video frames between them."""
    max_views: Annotated[int, Range(40, 1000)] = 240
    """Exposures adjusted together; where pairs are rare, every second video frame between them moves along instead."""
    max_points: Annotated[int, Range(50, 5000)] = 400
    """Points of the video, and as many of the pairs, in one adjustment: those seen most often."""
    knot_frames: Annotated[float, Range(0, 10)] = 0.0
    """Video frames from one knot of the spline to the next; 0 chooses the most that can follow the motion."""
    knot_misfit: Annotated[float, Range(0.1, 1000)] = 3.0
    """How far poses may lie from that spline: mean square, in what the errors of their observations make of them."""
    estimate_rig: bool = False
    """Refine how the video camera is turned on the rig, and where it sits."""
    estimate_clock: bool = False
    """Estimate how late the video camera's time stamps are."""
    rig_sigma_deg: Annotated[float, Range(0.001, 30)] = 2.0
    """How far the video camera may be turned from what the calibration says, before any data."""
    rig_sigma_m: Annotated[float, Range(0.0001, 1)] = 0.03
    """How far it may sit from where the calibration says; found only where the rig turns."""
    clock_sigma_s: Annotated[float, Range(1e-5, 1)] = 0.03
    """How far off the video's clock may be, before any data."""
    video_sigma_px: Annotated[float, Range(0.02, 5)] = 0.13
    """Error of a point tracked in the video."""
    stereo_sigma_px: Annotated[float, Range(0.02, 5)] = 0.26
    """Error of a point followed from pair to pair."""
    disparity_sigma_px: Annotated[float, Range(0.02, 5)] = 0.26
    """Error of its match in the right image."""
    loss: Annotated[float, Range(0.5, 20)] = 1.0
    """Scale of the Cauchy loss, in these errors."""
    iterations: Annotated[int, Range(1, 30)] = 6
    """Of each adjustment, at most."""
    follow_stereo: bool = True
    """Meet the stereo estimator's pose at every pair, so that both share one drift; else the drift is its own."""

    def build(self, rig: Rig) -> ModernIntegrated:
        return ModernIntegrated(rig, self)


@dataclass(frozen=True, eq=False)
class ModernIntegratedState:
    window: JointWindow
    interval: FrameInterval = FrameInterval()
    """Between two video frames."""
    metric: tuple[tuple[int, Pose], ...] = ()
    """The stereo estimator's poses in the window."""
    metric_covariance: Array | None = None
    """(6, 6) of the newest of them."""
    settled: PersistentList[tuple[int, Pose, bool]] = PersistentList()
    """Time, world_from_rig in the window's own world, whether of the video, of all exposures that have left it."""


@dataclass(frozen=True, eq=False)
class ModernIntegrated:
    """Metric at video rate. World: the rig at the first stereo pair.

    Asks any monocular and stereo method whose Steps have their tracks.
    """

    rig: Rig
    config: ModernIntegratedConfig

    def start(self) -> ModernIntegratedState:
        return ModernIntegratedState(JointWindow(self._rig_model(), self._rig_model()))

    def finish(self, state: ModernIntegratedState, asked: Mapping[str, Trajectory]) -> Trajectory:
        """Poses of the video exposures from the first stereo pair to the last."""
        return self._video_poses([*state.settled, *_poses(state.window.views)], asked["stereo"])

    def step(
        self, state: ModernIntegratedState, exposure: Exposure, asked: Mapping[str, Step]
    ) -> tuple[ModernIntegratedState, Step]:
        """One exposure: see, place, and after a pair adjust the window."""
        watch = Stopwatch()
        part = asked["stereo" if isinstance(exposure, StereoPair) else "video"]
        if isinstance(exposure, StereoPair):
            state = self._with_metric(replace(state, window=_calibrated(state.window, part)), part)
        else:
            state = replace(state, interval=state.interval.after(exposure.time_ns), window=_lens(state.window, part))
        state, located, status = self._place(state, self._view(state, part, isinstance(exposure, VideoFrame)))
        watch.lap("place")
        state, limits = self._limited(state)
        state, why, revised = self._adjust(state) if isinstance(exposure, StereoPair) else (state, (), ())
        watch.lap("adjust")
        newest = state.window.views[-1] if status == Status.TRACKING else None
        onto = self._onto_stereo(state)
        return state, Step(
            exposure.time_ns,
            status,
            "rig",
            None if newest is None else onto @ newest.world_from_rig,
            None if newest is None else self._covariance(state, part),
            key_frame=bool(revised),
            landmarks=Landmarks.empty() if newest is None else self._landmarks(state.window, onto, exposure, part),
            residuals_px=np.zeros(0)
            if located is None
            else self._residuals_px(located, isinstance(exposure, VideoFrame)),
            revised=self._video_poses(revised, Trajectory.of(list(state.metric))),
            seconds={**{f"{part.method}: {k}": v for k, v in part.seconds.items()}, **watch.seconds},
            decisions=(*limits, *why),
            parts=(part,),
        )

    def _place(
        self, state: ModernIntegratedState, view: View
    ) -> tuple[ModernIntegratedState, Resection | None, Status]:
        """The window with one more view, whose pose is that of the points known by now, or that of the view before."""
        window = state.window
        if not window.views:
            if view.video or len(view.ids) < MIN_POINTS:
                return state, None, Status.INITIALISING
            return replace(state, window=window.with_view(view)), None, Status.TRACKING
        located = self._locate(window, view)
        if located is None:
            guess = window.views[-1].world_from_rig
        else:
            rig_from_camera = window.rig.rig_from_video if view.video else window.rig.rig_from_left
            guess = located.camera_from_world.inverse() @ rig_from_camera.inverse()
        view = replace(view, world_from_rig=guess, placed=located is not None)
        if located is not None:
            view = replace(view, information=self._information(window, view))
        state = replace(state, window=window.with_view(view))
        # The first frames have no points of known depth yet: the pair just before them says where they are.
        near = located is None and window.reference is None
        return state, located, Status.TRACKING if located is not None or near else Status.LOST

    def _limited(self, state: ModernIntegratedState) -> tuple[ModernIntegratedState, tuple[Decision, ...]]:
        """With no more views than can be adjusted together."""
        most, count = self.config.max_views, len(state.window.views)
        if count <= most:
            return state, ()
        window, left = state.window.limited(most)
        then = "the oldest leave unadjusted" if left else "every second between two pairs moves along with the others"
        state = replace(state, window=window, settled=state.settled.extended(_poses(left)))
        return state, (checks.VIEWS.of(count, most, then),)

    def _rig_model(self) -> RigModel:
        c, r = self.config, self.rig
        sigma = np.array([np.radians(c.rig_sigma_deg)] * 3 + [c.rig_sigma_m] * 3 + [c.clock_sigma_s])
        free = np.array([c.estimate_rig] * 6 + [c.estimate_clock])
        return RigModel(r.rig_from_video, r.rig_from_left, r.baseline_m, 0.0, np.diag(1 / sigma**2), free)

    def _view(self, state: ModernIntegratedState, part: Step, video: bool) -> View:
        """The raw observations of one exposure."""
        name = "video" if video else "left"
        camera, tracks = self.rig.camera(name), part.tracks.get(name, Tracks.of(np.zeros(0), np.zeros((0, 2))))
        alive = tracks.status < TrackStatus.LOST
        if not video:
            alive &= tracks.disparity_px > 0
        order = np.flatnonzero(alive)[np.argsort(tracks.ids[alive], kind="stable")]
        uv = tracks.uv[order].astype(float)
        seen = camera.normalise(uv)
        if video:
            return View(part.time_ns, True, 2 * tracks.ids[order], seen, np.full(len(order), np.nan))
        disparity = tracks.disparity_px[order].astype(float) / camera.fx
        return View(
            part.time_ns,
            False,
            2 * tracks.ids[order] + 1,
            seen,
            disparity,
            part.calibration.get("pair_rate", np.zeros(6)),
        )

    def _locate(self, window: JointWindow, view: View) -> Resection | None:
        """camera_from_world by resection from the points known by now."""
        place = window.table.places(view.ids)
        known = place >= 0
        if window.reference is not None:
            adjusted = known & np.isin(view.ids, window.reference.ids, assume_unique=True)
            # The depth of a new point is a guess.
            known = adjusted if adjusted.sum() >= ENOUGH_POINTS else known
        if known.sum() < MIN_POINTS:
            return None
        xyz = window.table.select(place[known]).points.xyz_in_world
        sigma = self._sigma(view.video)
        threshold, scale = INLIER * sigma, self.config.loss * sigma
        guess = replace(view, world_from_rig=window.predicted(view.time_ns))
        seen = window.seen(view)[known]
        found = refine_pose(xyz, seen, window.camera_pose(guess).inverse(), threshold, scale=scale)
        if found is None or found.inliers.mean() < 0.5:
            again = resect(xyz, seen, threshold, scale)
            if again is not None and (found is None or again.inliers.sum() > found.inliers.sum()):
                found = again
        return found if found is not None and found.inliers.sum() >= MIN_POINTS else None

    @property
    def _noise(self) -> Noise:
        disparity = self.config.disparity_sigma_px / self.rig.camera("left").fx
        return Noise(self._sigma(True), self._sigma(False), disparity, self.config.loss)

    def _sigma(self, video: bool) -> float:
        """Error of an observation in normalised units."""
        if video:
            return self.config.video_sigma_px / self.rig.camera("video").fx
        return self.config.stereo_sigma_px / self.rig.camera("left").fx

    def _covariance(self, state: ModernIntegratedState, part: Step) -> Array | None:
        """(6, 6) of the newest pose as told: that of the pair it is told relative to, and of the way from there."""
        window, view = state.window, state.window.views[-1]
        if self.config.follow_stereo and not view.video and part.world_from_frame is not None:
            return part.covariance
        reference, pair = window.reference, self._meeting(state)
        if reference is None or pair is None or reference.time_ns != pair.time_ns:
            return None
        base = state.metric_covariance if self.config.follow_stereo else reference.drift
        way = reference.newest if view.best is not None else self._located_covariance(window, view)
        if base is None or way is None:
            return None
        carry = (view.world_from_rig.inverse() @ reference.world_from_rig).adjoint
        return carry @ base @ carry.T + way

    def _information(self, window: JointWindow, view: View) -> Array:
        """(6, 6) of a pose by resection, relative to the points."""
        place = window.table.places(view.ids)
        return pose_information(
            view.world_from_rig,
            window.rig.rig_from_video if view.video else window.rig.rig_from_left,
            window.table.select(place[place >= 0]).points,
            window.seen(view)[place >= 0],
            self._sigma(view.video),
            self.config.loss,
        )

    def _located_covariance(self, window: JointWindow, view: View) -> Array | None:
        """(6, 6) of a pose by resection relative to the window's reference; None where its points are new."""
        assert window.reference is not None
        _, mine, its = np.intersect1d(view.ids, window.reference.ids, assume_unique=True, return_indices=True)
        if len(mine) < MIN_POINTS:
            return None
        return pose_covariance(
            view.world_from_rig,
            window.rig.rig_from_video if view.video else window.rig.rig_from_left,
            view.video,
            window.table.select(window.table.places(view.ids[mine])).points,
            window.seen(view)[mine],
            self._sigma(view.video),
            self.config.loss,
            window.reference.uncertainty.select(its),
        )

    def _adjust(
        self, state: ModernIntegratedState
    ) -> tuple[ModernIntegratedState, tuple[Decision, ...], Sequence[tuple[int, Pose, bool]]]:
        """The window with its oldest pair gone, adjusted; why; and the poses in it."""
        window, left = state.window.shortened(self.config.window_pairs)
        since = window.views[0].time_ns if window.views else 0
        metric = tuple(item for item in state.metric if item[0] >= since)
        state = replace(state, window=window, settled=state.settled.extended(_poses(left)), metric=metric)
        meeting = self._meeting(state)
        if len(window.pairs) < 2 or meeting is None:
            return state, (), ()
        config, noise = self.config, self._noise
        frame_s, frames, why = (state.interval.median_ns or 1e8) * 1e-9, config.knot_frames or USUAL_KNOT_FRAMES, ()
        # A clock or a rig that is still wrong looks like motion.
        if not config.knot_frames and not window.rig.free.any():
            window, chosen = window.with_knots(frame_s, config.knot_misfit)
            frames, why = min(window.knots), (chosen,)
        spacing_s = window.spacing_s(frames, frame_s)
        found = window.adjusted(noise, spacing_s, config.max_points, config.iterations, meeting.time_ns)
        if found is None:
            return state, (checks.POINTS.of(0, 1),), ()
        window, solution = found
        return replace(state, window=window), (*why, *report(window, solution)), _poses(window.views)

    def _with_metric(self, state: ModernIntegratedState, part: Step) -> ModernIntegratedState:
        known = dict(state.metric)
        known |= {t: pose for t, pose in part.revised.items() if t in known}
        if part.world_from_frame is not None:
            known[part.time_ns] = part.world_from_frame
            state = replace(state, metric_covariance=part.covariance)
        return replace(state, metric=tuple(sorted(known.items(), key=lambda item: item[0])))

    def _meeting(self, state: ModernIntegratedState) -> View | None:
        """The last pair, of those that the stereo estimator located where it is followed: poses are told from there."""
        metric = dict(state.metric)
        pairs = [v for v in state.window.views if not v.video]
        if self.config.follow_stereo:
            pairs = [v for v in pairs if v.time_ns in metric] or pairs
        return pairs[-1] if pairs else None

    def _onto_stereo(self, state: ModernIntegratedState) -> Pose:
        """What carries the window's world onto that of the stereo estimator, at the last pair of both."""
        pair, metric = self._meeting(state), dict(state.metric)
        if not self.config.follow_stereo or pair is None or pair.time_ns not in metric:
            return Pose()
        return metric[pair.time_ns] @ pair.world_from_rig.inverse()

    def _video_poses(self, poses: Sequence[tuple[int, Pose, bool]], metric: Trajectory) -> Trajectory:
        """Those of the video, up to the last pair, in the world of the stereo estimator's poses."""
        last = max((t for t, _, video in poses if not video), default=0)
        inside = [(t, pose) for t, pose, video in poses if not video or t <= last]
        own = Trajectory.of(inside)
        if self.config.follow_stereo:
            own = anchored(own, metric)
        return own.select(np.isin(own.times_ns, [t for t, _, video in poses if video]))

    def _residuals_px(self, located: Resection, video: bool) -> Array:
        return located.residuals[located.inliers] * self.rig.camera("video" if video else "left").fx

    def _landmarks(self, window: JointWindow, onto: Pose, exposure: Exposure, part: Step) -> Landmarks:
        """The points seen in this exposure, with their names of the estimator inside."""
        view = window.views[-1]
        place = window.table.places(view.ids)
        known = place >= 0
        image = exposure.image if isinstance(exposure, VideoFrame) else exposure.left
        tracks = part.tracks["video" if view.video else "left"]
        uv = tracks.uv[_places(tracks.ids, view.ids[known] // 2)]
        points = window.table.select(place[known]).points
        return Landmarks(view.ids[known], onto.apply(points.xyz_in_world), colours_at(image, uv))


def _places(ids: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    order = np.argsort(ids, kind="stable")
    return order[np.searchsorted(ids[order], wanted)]


def _poses(views: Sequence[View]) -> list[tuple[int, Pose, bool]]:
    return [pose for view in views for pose in view.poses()]


def _calibrated(window: JointWindow, stereo: Step) -> JointWindow:
    """With what the stereo method found to be wrong with the pair, so that both have one scale."""
    return replace(window, of_pair=stereo.calibration.get("pair", window.of_pair))


def _lens(window: JointWindow, video: Step) -> JointWindow:
    """With what the monocular method found to be wrong with its lens."""
    return replace(window, of_lens=video.calibration.get("lens", window.of_lens))
