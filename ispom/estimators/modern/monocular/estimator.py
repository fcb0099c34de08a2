"""Monocular, modern: guided tracking, a pose for every frame against a map, windowed bundle adjustment with a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.errors import required
from ispom.estimator import TRANSFER, VIDEO, Method, require_frame
from ispom.estimators.modern.loops.asked import Asked
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.conclude import (
    as_step,
    close_loops,
    correct_by_loops,
    detect_new_corners,
    next_state,
)
from ispom.estimators.modern.monocular.initialise import initialise
from ispom.estimators.modern.monocular.join import in_common_world, join_segments
from ispom.estimators.modern.monocular.keyframe import (
    add_frame,
    add_keyframe,
    keep_frame_before_gap,
    keyframe_tests,
)
from ispom.estimators.modern.monocular.localise import (
    MIN_DESCRIBED,
    MIN_INLIER_SHARE,
    MIN_LOCATED,
    localise,
    without_outliers,
)
from ispom.estimators.modern.monocular.lost_frames import found_at_the_end, try_lost_frames
from ispom.estimators.modern.monocular.map import Map, TracksInMap
from ispom.estimators.modern.monocular.recover import (
    PATIENCE,
    NotLocalised,
    recover,
    relocalise,
)
from ispom.estimators.modern.monocular.setup import LOSS, Setup
from ispom.estimators.modern.monocular.shutter import correct_by_motion
from ispom.estimators.modern.monocular.state import ModernMonocularState, Outcome
from ispom.estimators.modern.monocular.track import (
    track,
    with_corrected_coordinates,
)
from ispom.estimators.modern.monocular.tracks import NewImage
from ispom.estimators.modern.monocular.verify_map import check_agreement, check_other_motion
from ispom.estimators.modern.second_motion import Follow
from ispom.features.front_ends import KLT, front_end, front_ends
from ispom.features.images import MAX_SIDE_PX, TrackedSize
from ispom.geometry import Array
from ispom.numerics.robust import Noise
from ispom.settings import Choices, Range, WorthTrying, checked
from ispom.solvers.window.prior import LEAST_SIGMA
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, LensSigma, Measurement, Rig, Step, Trajectory, as_grey


@dataclass(frozen=True)
class ModernMonocularConfig:
    """Settings of the modern monocular estimator."""

    max_tracks: Annotated[int, Range(50, 2000), WorthTrying((2, 0.5))] = 500
    """Largest number of points tracked at a time."""
    key_frames: Annotated[int, Range(4, 20), WorthTrying((2,))] = 10
    """Number of keyframes optimised together; older ones are marginalised into a prior."""
    min_parallax_deg: Annotated[float, Range(0.05, 20), WorthTrying((0.5,))] = 2.5
    """Median parallax since the last keyframe, without rotation, that triggers the next one [deg]."""
    min_share: Annotated[float, Range(0.1, 1)] = 0.3
    """Least share of the last keyframe's points that must be left; a new keyframe is taken before."""
    max_view_angle_deg: Annotated[float, Range(1, 90), WorthTrying((0.5,))] = 10.0
    """Rotation since the last keyframe that triggers the next one [deg]."""
    max_interval_s: Annotated[float, Range(0.05, 60)] = 1.0
    """Time since the last keyframe that triggers the next one [s], if a quarter of the parallax is reached."""
    start_parallax_deg: Annotated[float, Range(0.1, 20)] = 1.0
    """Median parallax, without rotation, from which the first map is attempted [deg]."""
    point_parallax_deg: Annotated[float, Range(0.05, 20)] = 0.4
    """Least parallax of a point in the map [deg]."""
    features: Annotated[str, Choices(front_ends), WorthTrying(values=("orb", "sift", "patches"))] = KLT.name
    """Detects, tracks and describes features: klt (corners), patches, sift, surf, orb, or any other front end."""
    noise_px: Annotated[float, Range(0.05, 5), WorthTrying((2,))] = 0.34
    """Tracking noise after some keyframes, 1 sigma [px]; sets outlier limits, the initial width of the loss, and
    covariances until the noise is measured from residuals (`noise`)."""
    max_width_px: Annotated[int, Range(320, 8192), WorthTrying((0.5,))] = MAX_SIDE_PX
    """Images whose longer side exceeds this [px] are halved, once or more; other settings and checks are in the smaller
    pixels."""
    relocalise: bool = True
    """Relocalise a lost camera among all keyframes by descriptors; if off, only near the last pose: plain odometry."""
    loops: bool = False
    """Close loops: recognise places after a long path, and correct all poses; if off: plain odometry."""
    refuse_loops: str = ""
    """Refuse these loops, and joins of segments, to see the effect: EARLIER-LATER, times of keyframes in nanoseconds,
    as `ispom loops` prints them; several are separated by commas."""
    accept_loops: str = ""
    """Accept these loops, whatever other rules say. Decisions then state that the user accepted them."""
    follow: Follow = "static"
    """Which of two rigid motions to follow: that of the first map, mostly the static scene, or, in a new map, the one
    that covers more of the image."""
    self_calibration: bool = True
    """Self-calibrate focal length and radial distortion. The next two settings are used unless the rig's file has the
    calibration's standard deviations (video_sigma)."""
    focal_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.003
    """Prior standard deviation of the focal length, relative to its value; the default fits a careful calibration."""
    radial_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.01
    """Prior standard deviation of the radial distortion k1."""

    def lens_sigma(self, calibrated: LensSigma | None = None) -> Array:
        """Returns the prior standard deviations (2,) of focal length and radial distortion; 0 fixes them. Those of
        the calibration replace the settings."""
        sigma = calibrated or LensSigma(self.focal_sigma, self.radial_sigma)
        return np.maximum([sigma.focal, sigma.radial], LEAST_SIGMA) * self.self_calibration

    def build(self, rig: Rig) -> ModernMonocular:
        return ModernMonocular(rig, checked(self))


@dataclass(frozen=True, eq=False)
class ModernMonocular:
    """Estimates a pose for every frame, without metric scale.

    World: the video camera at the first frame; after a restart of the initialisation, at the first frame of the map,
    with the orientation of the first frame of all. Unit: the first baseline of the map.
    """

    rig: Rig
    config: ModernMonocularConfig

    def start(self) -> ModernMonocularState:
        return ModernMonocularState()

    def finish(self, state: ModernMonocularState) -> Trajectory:
        current = state.map.trajectory() if state.map is not None else []
        held = state.start.held if state.start is not None else ()
        late = found_at_the_end(self._setup, state)
        poses = Trajectory.of([*state.settled, *held, *current, *late], "video")
        return correct_by_loops(state.loops, in_common_world(state.worlds, poses))

    def step(self, state: ModernMonocularState, exposure: Measurement) -> tuple[ModernMonocularState, Step]:
        """Processes one frame: tracks features, localises it in the map (or initialises one), and detects new
        corners."""
        exposure = self._size.reduced(require_frame(exposure, VIDEO, rig=self.rig))
        setup, watch = self._setup, Stopwatch()
        state = keep_frame_before_gap(setup, state, exposure.time_ns)
        image = track(setup, state, exposure.time_ns, as_grey(exposure.image))
        state = with_corrected_coordinates(setup, state, image.tracked)
        watch.lap("track")
        outcome = None
        if state.map is None:
            state, image, outcome = _resume(setup, state, image, watch)
            if outcome is None:
                state, image, outcome = initialise(setup, state, image)
                watch.lap("start")
        else:
            state, found = _track_with_map(setup, state, state.map, image, watch)
            outcome = found if isinstance(found, Outcome) else recover(setup, state, image, found)
        if outcome.map is not None and outcome.inliers is not None:
            outcome = check_other_motion(setup, state, outcome, image)
            state, outcome = check_agreement(setup, state, outcome, image)
            watch.lap("other motion")
        state, outcome = try_lost_frames(setup, state, outcome)
        watch.lap("lost frames")
        new_uv = detect_new_corners(setup, outcome, image.grey)
        after = next_state(setup, state, outcome, image, new_uv)
        watch.lap("new points")
        step = as_step(setup, state, after, outcome, exposure, new_uv, watch.seconds)
        if self.config.loops:
            after, step = close_loops(setup, state, after, outcome, image, step)
            watch.lap("loops")
        else:
            after, step = join_segments(setup, state, after, outcome, image, step)
            watch.lap("join")
        return after, self._size.enlarged(step)

    def without_tracks(self, state: ModernMonocularState, ids: NDArray[np.int64]) -> ModernMonocularState:
        """See LeavesOut."""
        return state.without_tracks(ids)

    @cached_property
    def _size(self) -> TrackedSize:
        return TrackedSize.of(self.rig.camera("video"), self.config.max_width_px)

    @cached_property
    def _setup(self) -> Setup:
        c = self.config
        return Setup(
            camera=self._size.tracked,
            noise_px=Noise(c.noise_px, LOSS),
            extra_sigma=LOSS * c.lens_sigma(self.rig.video_sigma),
            max_tracks=c.max_tracks,
            key_frames=c.key_frames,
            start_parallax_rad=float(np.radians(c.start_parallax_deg)),
            point_parallax_rad=float(np.radians(c.point_parallax_deg)),
            min_parallax_deg=c.min_parallax_deg,
            min_share=c.min_share,
            max_view_angle_deg=c.max_view_angle_deg,
            max_interval_s=c.max_interval_s,
            relocalise=c.relocalise,
            follow=c.follow,
            front_end=front_end(c.features),
            asked=Asked.of(c.refuse_loops, c.accept_loops),
        )


def _resume(
    setup: Setup, state: ModernMonocularState, image: NewImage, watch: Stopwatch
) -> tuple[ModernMonocularState, NewImage, Outcome | None]:
    """Localises a frame soon after a loss in the map before it, while a new one is being started.

    Also returns the state and the image used: those before the loss, with the tracks of that time, if that succeeds.
    """
    before = None if state.start is None else state.start.before_loss
    if state.start is None or before is None or before.map is None:
        return state, image, None
    before = replace(before, database=state.database, lost_frames=state.lost_frames, worlds=state.worlds)
    again = track(setup, before, image.time_ns, image.grey)
    before = with_corrected_coordinates(setup, before, again.tracked)
    tried, outcome = _track_with_map(setup, before, required(before.map, "it had a map"), again, watch)
    if isinstance(outcome, Outcome):
        return tried, again, outcome
    missed = before.missed + 1
    before = replace(before, missed=missed, last_localised=tried.last_localised) if missed <= PATIENCE else None
    return replace(state, database=tried.database, start=replace(state.start, before_loss=before)), image, None


def _track_with_map(
    setup: Setup, state: ModernMonocularState, local_map: Map, image: NewImage, watch: Stopwatch
) -> tuple[ModernMonocularState, Outcome | NotLocalised]:
    """Localises the frame in the map, and makes it a keyframe if a check requires it.

    Also returns the state used, which has more tracks if the frame was relocalised by descriptors.
    """
    tracks = TracksInMap(setup, state.live, local_map)
    localisation, relocalisation = localise(tracks, image), None
    decisions = tuple[Decision, ...]()
    if not localisation.has_enough_inliers or localisation.count < MIN_INLIER_SHARE * tracks.count:
        state, relocalisation, described = relocalise(tracks, state, image, localisation)
        decisions = (described,)
    if relocalisation is not None:
        state, local_map, localisation = relocalisation.state, relocalisation.map, relocalisation.localisation
    elif localisation.has_enough_inliers:
        recent = (*state.rolling_tracks, state.live.rolling_tracks)
        localisation, local_map = correct_by_motion(tracks, recent, image.time_ns, localisation)
    watch.lap("locate")
    least, enough = MIN_LOCATED if relocalisation is None else MIN_DESCRIBED, localisation.has_enough_inliers
    decisions = (*decisions, checks.POSE_POINTS.of(localisation.count, least, passed=enough))
    if not enough:
        return state, NotLocalised(localisation.tracked, decisions)
    frame, outcome = without_outliers(TracksInMap(setup, state.live, local_map), image, localisation, decisions)
    if relocalisation is not None and relocalisation.segment != state.segment:
        outcome = replace(outcome, restarted=True, segment=relocalisation.segment)
    tests = keyframe_tests(setup, local_map, frame)
    outcome = replace(outcome, decisions=(*decisions, *tests))
    watch.lap("locate")
    # The points of a relocalised frame are new to the map: only its optimisation gives the covariance of the pose.
    if relocalisation is None and not any(test.passed for test in tests):
        outcome = add_frame(setup, state, outcome, frame, localisation)
        watch.lap("locate")
    else:
        outcome = add_keyframe(setup, state, outcome, frame)
        watch.lap("key frame")
    return state, outcome


METHOD = Method(
    "monocular",
    VIDEO,
    ModernMonocularConfig,
    "own",
    "key frames and local bundle adjustment (PTAM, 2007)",
    TRANSFER,
    checks=checks.CHECKS,
    stages=checks.STAGES,
)
