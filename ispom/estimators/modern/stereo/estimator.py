"""Modern stereo method: guided tracking, localisation by both images, windowed optimisation, self-calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method, require_frame
from ispom.estimators.modern.loops.asked import Asked
from ispom.estimators.modern.second_motion import Follow
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.height import height_prior
from ispom.estimators.modern.stereo.keyframe import exchanged_since, keyframe_tests, new_points, start_obstacles
from ispom.estimators.modern.stereo.levelling import on_level_pair
from ispom.estimators.modern.stereo.localise import LocalisedFrame
from ispom.estimators.modern.stereo.loop import corrected, with_loops
from ispom.estimators.modern.stereo.map import extend_map
from ispom.estimators.modern.stereo.other_motion import with_other_motion
from ispom.estimators.modern.stereo.pair import PAIR_KLT, Setup, StereoImages, TrackingResult, pair_front_end
from ispom.estimators.modern.stereo.predict import LastPair
from ispom.estimators.modern.stereo.recover import count_loss, relocalise
from ispom.estimators.modern.stereo.report import as_step, next_state
from ispom.estimators.modern.stereo.state import ModernStereoState, Outcome
from ispom.estimators.modern.stereo.track import track
from ispom.features.front_ends import front_ends
from ispom.features.images import MAX_SIDE_PX, TrackedSize
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.settings import Choices, Range, WorthTrying, checked
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.prior import LEAST_SIGMA
from ispom.stopwatch import Stopwatch
from ispom.types import Measurement, PairSigma, Rig, Status, Step, Trajectory


@dataclass(frozen=True)
class ModernStereoConfig:
    """Settings of the modern stereo estimator."""

    max_tracks: Annotated[int, Range(50, 3000), WorthTrying((2, 0.5))] = 400
    """Number of points that are tracked at a time."""
    window: Annotated[int, Range(3, 20), WorthTrying((2,))] = 8
    """Number of keyframes that are optimised together; older ones become a prior."""
    features: Annotated[str, Choices(front_ends)] = PAIR_KLT.name
    """Detects, tracks and describes features: klt (corners), patches, sift, surf, orb, or any other front end. All are
    then aligned with the keyframe's patches."""
    max_width_px: Annotated[int, Range(320, 8192), WorthTrying((0.5,))] = MAX_SIDE_PX
    """Images whose longer side exceeds this are halved first; settings and checks are in pixels of the halved image."""
    relocalise: bool = True
    """Relocalise a lost camera at earlier keyframes by descriptors. Off: search only near the last pose."""
    loops: bool = False
    """Close loops: recognise earlier keyframes, and distribute the drift over all poses. Off: plain odometry."""
    refuse_loops: str = ""
    """Refuse these loops, to see the effect: EARLIER-LATER, times of keyframes in nanoseconds, as `ispom loops` prints
    them; several are separated by commas."""
    accept_loops: str = ""
    """Accept these loops, whatever other rules say. Decisions then state that the user accepted them."""
    follow: Follow = "static"
    """Which of two rigid motions to follow: the static scene (observed longer, and larger), or the object that fills
    more of the image."""
    self_calibration: bool = True
    """Self-calibrate the pair: radial distortion of both cameras; orientation, focal length, principal point,
    distortion and time offset of the right camera. The next settings are prior standard deviations; pair_sigma in the
    rig's file replaces them."""
    offset_sigma_px: Annotated[float, Range(0.01, 10)] = 0.25
    """Prior standard deviation of the disparity offset and the row offset in the image centre."""
    turn_sigma_deg: Annotated[float, Range(0.001, 2)] = 0.1
    """Prior standard deviation of the right camera's rotation about each axis."""
    focal_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.0015
    """Prior standard deviation of the right focal length, relative to the left one."""
    radial_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.01
    """Prior standard deviation of k1 and k2 of both cameras, and of the right camera's own k1 and k2."""
    decentring_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.001
    """Prior standard deviation of the right camera's decentring distortion p1 and p2."""
    lag_sigma_s: Annotated[float, Range(1e-5, 0.1)] = 0.005
    """Prior standard deviation of the right camera's time offset."""
    settling_s: Annotated[float, Range(1, 1e6)] = 3600.0
    """Time constant after which the calibration may have changed by its prior standard deviation."""
    loss_px: Annotated[float, Range(0.05, 5)] = 0.17
    """Scale of the robust loss, and noise of a track in covariances until residuals determine it."""
    max_error_px: Annotated[float, Range(0.5, 20), WorthTrying((2,))] = 2.5
    """Tracks with a larger reprojection error are outliers and end."""
    min_parallax_px: Annotated[float, Range(0.5, 100), WorthTrying((0.5,))] = 25.0
    """Median displacement since the last keyframe from which a new one is made."""
    min_share: Annotated[float, Range(0.1, 1), WorthTrying(values=(0.8,))] = 0.6
    """A new keyframe is made when a smaller share of the last keyframe's points is left."""
    min_inliers: Annotated[int, Range(6, 500)] = 15
    """Least number of inliers with which a frame is localised."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Number of lost frames in a row that are tolerated; the next one starts a new segment at the predicted pose."""
    height_sigma_m: Annotated[float, Range(0, 10)] = 0.0
    """For a ground vehicle: prior standard deviation of the change of height between keyframes, along the rig's y axis.
    0: no such prior."""
    iterations: Annotated[int, Range(1, 30)] = 10
    """Most iterations of the optimisation at each keyframe; a wrong calibration needs nearly all of them."""

    def pair_sigma(self, focal_px: float, calibrated: PairSigma | None = None) -> Array:
        """Returns the prior standard deviations (E,) of the corrections, in the order of right_camera.TERMS.

        0 fixes a correction. The settings are in pixels of images with focal length `focal_px`; `calibrated`, from
        the calibration, replaces them.
        """
        if not self.self_calibration:
            return np.zeros(PAIR)
        sigma = calibrated or PairSigma(
            self.offset_sigma_px,
            self.turn_sigma_deg,
            self.focal_sigma,
            self.radial_sigma,
            self.decentring_sigma,
            self.lag_sigma_s,
        )
        offset, turn = sigma.offset_px / focal_px, np.radians(sigma.turn_deg)
        radial, decentring = [sigma.radial] * 2, [sigma.decentring] * 4
        lens = sigma.focal, *radial, *decentring
        found = np.array([*radial, offset, turn, turn, turn, *lens, turn, sigma.lag_s, offset, turn])
        return np.maximum(found, LEAST_SIGMA)

    def build(self, rig: Rig) -> ModernStereo:
        """Returns the estimator for a rig."""
        return ModernStereo(rig, checked(self))


@dataclass(frozen=True, eq=False)
class ModernStereo:
    """Estimates metric poses, and optimises the last few keyframes. The world is the rig at the first frame."""

    rig: Rig
    config: ModernStereoConfig

    def start(self) -> ModernStereoState:
        """Returns the state before the first frame."""
        return ModernStereoState(LastPair(left_from_world=self._left_from_rig))

    def finish(self, state: ModernStereoState) -> Trajectory:
        """Returns the final estimate: world_from_rig of all localised frames, with loops closed."""
        keys = dict(state.settled) | {k.time_ns: k.left_from_world for k in state.map.keys}
        world_from_left = {t: (pose @ keys[key]).inverse() for t, key, pose in state.poses}
        poses = Trajectory.of([(t, pose @ self._left_from_rig) for t, pose in world_from_left.items()])
        return corrected(state.loops, poses)

    def step(self, state: ModernStereoState, measurement: Measurement) -> tuple[ModernStereoState, Step]:
        """Tracks and localises one frame; at a keyframe also adds points and optimises the window."""
        last_ns = None if state.last.left is None else state.last.time_ns
        measured = self._size.reduced(require_frame(measurement, STEREO, last_ns, self.rig))
        watch = Stopwatch()
        outcome, images = on_level_pair(self._setup, state, StereoImages.of(measured), partial(self._advance, watch))
        after, step = outcome.state, as_step(self._setup, measured, outcome)
        watch.lap("conclude")
        if self.config.loops:
            after, step = with_loops(self._setup, state, outcome, images, step)
            watch.lap("loops")
        return after, self._size.enlarged(replace(step, seconds=watch.seconds))

    def without_tracks(self, state: ModernStereoState, ids: NDArray[np.int64]) -> ModernStereoState:
        """See LeavesOut."""
        return state.without_tracks(ids)

    def _advance(self, watch: Stopwatch, earlier: ModernStereoState, images: StereoImages) -> Outcome:
        """Runs the steps of the algorithm on one frame. `earlier` is the state before it."""
        setup = self._setup

        # 1. Predict the pose, track the points into both images, and localise the frame by them.
        predicted = earlier.last.predicted(images.time_ns)
        state, tracked, decisions = track(setup, earlier, images, predicted)

        # 2. If tracking failed, relocalise at earlier keyframes.
        if decisions and not decisions[-1].passed:
            state, tracked, decision = relocalise(setup, state, images, tracked)
            decisions = *decisions, decision
        watch.lap("track")
        earlier = replace(earlier, database=state.database)  # has the descriptors that were computed
        exchanged = exchanged_since(setup, images, tracked)
        if exchanged is not None:
            state, tracked, decisions = earlier, TrackingResult.nothing(), (*decisions, exchanged)

        # 3. If that failed, the frame is lost, or starts a new segment.
        if earlier.map.keys and tracked.inliers < setup.min_inliers:
            state, restart = count_loss(setup, state)
            if restart is None:
                return Outcome(state, Status.LOST, tracked, decisions)
            tracked, decisions = TrackingResult.nothing(), (*decisions, restart)

        # 4. Choose between two rigid motions.
        tracked, tests, other_motion = with_other_motion(setup, state, images, tracked)
        decisions = *decisions, *tests
        watch.lap("other motion")

        # 5. Decide whether the frame becomes a keyframe.
        frame, tracked_points = LocalisedFrame.of(state, images, tracked), state.last.points
        status = Status.INITIALISING if tracked.located is None else Status.TRACKING
        tests = keyframe_tests(setup, state.map, frame.points)
        decisions = *decisions, *tests
        is_first = not state.map.keys
        if not is_first and not any(test.passed for test in tests):
            state = next_state(setup, state, frame, tracked, is_key=False)
            return Outcome(state, status, tracked, decisions, tracked_points, other_motion=other_motion)

        # 6. Detect new points.
        new = new_points(setup, state, frame)
        obstacles = start_obstacles(setup, images, len(new)) if is_first else ()
        if obstacles:
            # No map can start here, so the earlier state remains the best one to localise from.
            status = Status.LOST if earlier.map.keys else Status.INITIALISING
            state = replace(earlier, lost_pairs=state.lost_pairs)
            return Outcome(state, status, tracked, (*decisions, *obstacles), other_motion=other_motion)
        watch.lap("new points")

        # 7. Extend the map by the keyframe, and optimise the window.
        state, frame, optimisation = extend_map(setup, state, frame, new, tracked)
        watch.lap("adjust")
        return Outcome(
            next_state(setup, state, frame, tracked, is_key=True),
            status,
            tracked,
            (*decisions, *optimisation),
            tracked_points,
            len(new),
            keyframe=True,
            restarted=is_first and bool(earlier.map.keys),
            other_motion=other_motion,
        )

    @cached_property
    def _size(self) -> TrackedSize:
        return TrackedSize.of(self.rig.camera("left"), self.config.max_width_px)

    @property
    def _pair_sigma(self) -> Array:
        calibrated = self.rig.pair_sigma
        camera = self._size.tracked if calibrated is None else self.rig.camera("left")
        return self.config.pair_sigma(camera.fx, calibrated)

    @cached_property
    def _setup(self) -> Setup:
        c = self.config
        return Setup(
            camera=self._size.tracked,
            baseline_m=self.rig.baseline_m,
            rig_from_left=self.rig.rig_from_left,
            noise_px=Noise(c.loss_px),
            max_error_px=c.max_error_px,
            extra_sigma=self._pair_sigma,
            settling_s=c.settling_s,
            max_tracks=c.max_tracks,
            window=c.window,
            min_parallax_px=c.min_parallax_px,
            min_share=c.min_share,
            min_inliers=c.min_inliers,
            max_lost_pairs=c.max_lost_pairs,
            iterations=c.iterations,
            relocalise=c.relocalise,
            follow=c.follow,
            front_end=pair_front_end(c.features),
            asked=Asked.of(c.refuse_loops, c.accept_loops),
            make_families=(partial(height_prior, sigma_m=c.height_sigma_m),) if c.height_sigma_m else (),
        )

    @cached_property
    def _left_from_rig(self) -> Pose:
        return self.rig.rig_from_left.inverse()


METHOD = Method(
    "stereo",
    STEREO,
    ModernStereoConfig,
    "metric",
    "key frames, local bundle adjustment (ORB-SLAM2 2017)",
    checks=checks.CHECKS,
    stages=checks.STAGES,
)
