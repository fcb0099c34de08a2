"""Integrated, modern: one windowed problem over the raw observations of both cameras, each at its own time.

A cumulative cubic B-spline over the last few stereo pairs is fitted to all observations of the video and of the stereo
camera in that time. They need not observe the same points: pairs give the spline its scale, the video its shape between
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ispom.estimator import PER_UNIT, STEREO, VIDEO, Method, require_frame
from ispom.estimators.modern.integrated import checks
from ispom.estimators.modern.integrated.alignment import stereo_from_window, video_poses
from ispom.estimators.modern.integrated.localise import localise
from ispom.estimators.modern.integrated.observe import check_right_matches, observe, with_pair, with_video, without_pair
from ispom.estimators.modern.integrated.optimise import Optimisation, limit_views, optimise
from ispom.estimators.modern.integrated.report import newest_covariance, observed_landmarks, rig_corrections
from ispom.estimators.modern.integrated.state import ModernIntegratedState, Setup, start_new_segment
from ispom.estimators.modern.integrated.window import JointWindow, RigNoise
from ispom.features.images import MAX_SIDE_PX, TrackedSize
from ispom.geometry import Array
from ispom.numerics.robust import Noise
from ispom.settings import Range, checked
from ispom.solvers.localisation import PoseFit
from ispom.solvers.spline.problem import RigModel
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Decision,
    Landmarks,
    Measurement,
    Rig,
    Status,
    Step,
    Trajectory,
)


@dataclass(frozen=True)
class ModernIntegratedConfig:
    """Settings of the modern integration."""

    window_pairs: Annotated[int, Range(2, 12)] = 5
    """Number of stereo pairs optimised together, with the video frames between them."""
    max_views: Annotated[int, Range(40, 1000)] = 240
    """Largest number of frames optimised together; where pairs are rare, every second video frame between them follows
    its neighbour."""
    max_points: Annotated[int, Range(50, 5000)] = 400
    """Largest number of video points, and of stereo points, in the optimisation: those with the most observations."""
    knot_frames: Annotated[float, Range(0, 10)] = 0.0
    """Spacing of the spline's knots, in video frames; 0 chooses the widest spacing that follows the motion."""
    knot_misfit: Annotated[float, Range(0.1, 1000)] = 3.0
    """Largest misfit of that spline to the poses: mean squared residual per degree of freedom, in standard deviations
    of the poses."""
    estimate_rig: bool = False
    """Self-calibrate the pose of the video camera on the rig."""
    estimate_clock: bool = False
    """Self-calibrate the time offset of the video camera."""
    rig_sigma_deg: Annotated[float, Range(0.001, 30)] = 2.0
    """Prior standard deviation of the video camera's rotation on the rig [deg]."""
    rig_sigma_m: Annotated[float, Range(0.0001, 1)] = 0.03
    """Prior standard deviation of its position on the rig [m]; it is observable only where the rig rotates."""
    clock_sigma_s: Annotated[float, Range(1e-5, 1)] = 0.03
    """Prior standard deviation of the video's time offset [s]."""
    video_sigma_px: Annotated[float, Range(0.02, 5)] = 0.13
    """Noise (1 sigma) of a point tracked in the video [px]; sets its weight. Covariances use the measured residuals."""
    stereo_sigma_px: Annotated[float, Range(0.02, 5)] = 0.26
    """Noise (1 sigma) of a point tracked from pair to pair [px]; sets its weight."""
    disparity_sigma_px: Annotated[float, Range(0.02, 5)] = 0.26
    """Noise (1 sigma) of the match in the right image [px]."""
    max_width_px: Annotated[int, Range(320, 8192)] = MAX_SIDE_PX
    """Images whose longer side exceeds this [px] are halved, as by the methods that this one depends on; noise is in
    pixels of the halved images."""
    loss: Annotated[float, Range(0.5, 20)] = 1.0
    """Width of the robust loss, in these standard deviations."""
    iterations: Annotated[int, Range(1, 30)] = 4
    """Largest number of iterations per optimisation."""
    follow_stereo: bool = True
    """Align with the poses of the stereo estimator at every pair (with a rolling shutter: on average over the pairs in
    the window), so that both share one drift; otherwise the drift is independent."""

    def build(self, rig: Rig) -> ModernIntegrated:
        return ModernIntegrated(rig, checked(self))


@dataclass(frozen=True, eq=False)
class ModernIntegrated:
    """Estimates metric poses at video rate. World: the rig at the first stereo pair.

    Depends on any monocular and stereo method whose Steps contain their tracks.
    """

    rig: Rig
    config: ModernIntegratedConfig

    def start(self) -> ModernIntegratedState:
        return ModernIntegratedState(JointWindow(self._rig_model, self._rig_model))

    def finish(self, state: ModernIntegratedState, asked: Mapping[str, Trajectory]) -> Trajectory:
        """Returns the poses of the video frames from the first stereo pair to the last."""
        in_window = [pose for view in state.window.views for pose in view.poses()]
        return video_poses(self._setup, [*state.settled, *in_window], asked["stereo"], tuple(state.begun_ns))

    def step(
        self, state: ModernIntegratedState, exposure: Measurement, asked: Mapping[str, Step]
    ) -> tuple[ModernIntegratedState, Step]:
        """Processes one frame: collects its observations, localises it, and after a pair optimises the window."""
        setup, watch = self._setup, Stopwatch()
        is_pair = require_frame(exposure, VIDEO | STEREO, rig=self.rig).kind in STEREO
        part = asked["stereo" if is_pair else "video"]
        right_matches = (check_right_matches(part),) if is_pair else ()
        if any(test.failed for test in right_matches):
            return self._skip_pair(state, part, right_matches)
        # Only if stereo is followed do poses depend on it, so that its gap is one here.
        disconnected = is_pair and (part.restarted or state.stereo_restarted)
        if disconnected and self.config.follow_stereo and state.window.views:
            state = start_new_segment(state, exposure.time_ns)
        state = with_pair(state, part) if is_pair else with_video(state, part)
        state, resection, status = localise(setup, state, observe(self.rig, part, not is_pair))
        watch.lap("place")
        state, limits = limit_views(setup, state)
        state, optimisation = optimise(setup, state) if is_pair else (state, Optimisation())
        watch.lap("adjust")
        pose, covariance, landmarks = None, None, Landmarks.empty()
        stereo_from_world = stereo_from_window(setup, state)
        if status == Status.TRACKING:
            pose = stereo_from_world @ state.window.views[-1].world_from_rig
            covariance = newest_covariance(setup, state, part)
            landmarks = observed_landmarks(state.window, stereo_from_world, exposure, part)
        return state, Step(
            exposure.time_ns,
            status,
            "rig",
            pose,
            covariance,
            key_frame=bool(optimisation.poses),
            landmarks=landmarks,
            residuals_px=self._residuals_px(resection, is_pair),
            revised=video_poses(setup, optimisation.poses, Trajectory.of(list(state.metric))),
            seconds={**_seconds(part), **watch.seconds},
            decisions=(*right_matches, *limits, *optimisation.decisions),
            parts=(part,),
            restarted=disconnected and (resection is None or self.config.follow_stereo),
            provisional=pose is not None and state.window.reference is None,
            calibration=rig_corrections(state.window),
            spline=None if optimisation.spline is None else optimisation.spline.moved(stereo_from_world),
        )

    def _skip_pair(
        self, state: ModernIntegratedState, part: Step, decisions: tuple[Decision, ...]
    ) -> tuple[ModernIntegratedState, Step]:
        """Skips a pair that measures no depth: the video continues alone as long as it observes optimised points."""
        status = Status.LOST if state.window.views else Status.INITIALISING
        return without_pair(state, part), Step(
            part.time_ns,
            status,
            "rig",
            seconds=_seconds(part),
            decisions=decisions,
            parts=(part,),
            calibration=rig_corrections(state.window),
        )

    @property
    def _setup(self) -> Setup:
        c = self.config
        video, left = (TrackedSize.of(self.rig.camera(name), c.max_width_px).tracked for name in ("video", "left"))
        noise = RigNoise(
            Noise(c.video_sigma_px / video.fx, c.loss),
            Noise(c.stereo_sigma_px / left.fx, c.loss),
            Noise(c.disparity_sigma_px / left.fx, c.loss),
        )
        return Setup(
            rig=self.rig,
            noise=noise,
            window_pairs=c.window_pairs,
            max_views=c.max_views,
            max_points=c.max_points,
            knot_frames=c.knot_frames,
            knot_misfit=c.knot_misfit,
            iterations=c.iterations,
            follow_stereo=c.follow_stereo,
        )

    @property
    def _rig_model(self) -> RigModel:
        c, r = self.config, self.rig
        sigma = np.array([np.radians(c.rig_sigma_deg)] * 3 + [c.rig_sigma_m] * 3 + [c.clock_sigma_s])
        free = np.array([c.estimate_rig] * 6 + [c.estimate_clock])
        return RigModel(r.rig_from_video, r.rig_from_left, r.baseline_m, 0.0, np.diag(1 / sigma**2), free)

    def _residuals_px(self, resection: PoseFit | None, is_pair: bool) -> Array:
        if resection is None:
            return np.zeros(0)
        return resection.distances[resection.inliers] * self.rig.camera("left" if is_pair else "video").fx


def _seconds(part: Step) -> dict[str, float]:
    """Returns the times of the stages of the method that this one depends on."""
    return {f"{part.method}: {stage}": seconds for stage, seconds in part.seconds.items()}


METHOD = Method(
    "integrated",
    VIDEO | STEREO,
    ModernIntegratedConfig,
    "metric",
    "continuous-time estimation on a cumulative B-spline (Spline Fusion 2013)",
    PER_UNIT,
    {"video": "monocular", "stereo": "stereo"},
    checks.CHECKS,
    checks.STAGES,
)
