"""Stereo, modern: guided tracking in both images, reprojection in both, a window of key frames, self-calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from ispom.estimator import STEREO, require_frame
from ispom.estimators.modern.motions import Follow
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.conclude import as_step, next_state
from ispom.estimators.modern.stereo.exchanged import exchanged, exchanged_since
from ispom.estimators.modern.stereo.key_frame import Current, extended, key_frame_tests, new_points
from ispom.estimators.modern.stereo.last_pair import LastPair
from ispom.estimators.modern.stereo.loop import corrected, with_loops
from ispom.estimators.modern.stereo.other_motion import motions
from ispom.estimators.modern.stereo.pair import NewPair, TrackingResult
from ispom.estimators.modern.stereo.relocate import recover
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.state import ModernStereoState, Outcome
from ispom.estimators.modern.stereo.track import track_and_locate
from ispom.features.images import MAX_SIDE_PX, TrackedSize
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.settings import Range
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.prior import LEAST_SIGMA
from ispom.stopwatch import Stopwatch
from ispom.types import Decision, Measurement, PairSigma, Rig, Status, Step, Trajectory


@dataclass(frozen=True)
class ModernStereoConfig:
    """Settings of the modern stereo estimator."""

    max_tracks: Annotated[int, Range(50, 3000)] = 400
    """Points tracked at a time."""
    window: Annotated[int, Range(3, 20)] = 8
    """Key frames adjusted together; older ones become a prior."""
    max_width_px: Annotated[int, Range(320, 8192)] = MAX_SIDE_PX
    """Wider images, or higher ones, are halved before anything is looked for in them; pixels of settings and checks are
    those then."""
    relocalise: bool = True
    """Look for a lost camera at all key frames by descriptors; off, only around the last place: plain odometry."""
    loops: bool = False
    """Find places again after a long way, and spread over all poses what odometry was off by; off: plain odometry."""
    follow: Follow = "static"
    """Where two things move by themselves: what stands still, as far as known (it was there before, and spans more
    room), or what fills more of the image."""
    self_calibration: bool = True
    """Estimate what is wrong with the pair: the radial distortion of both cameras; and how the right one is turned, its
    own focal length, principal point, distortion, and a late shutter. The settings that follow are standard deviations
    before any data, where the rig's file does not say how sure its calibration is (pair_sigma)."""
    offset_sigma_px: Annotated[float, Range(0.01, 10)] = 0.25
    """Of how far off disparities and rows are in the middle of the image."""
    turn_sigma_deg: Annotated[float, Range(0.001, 2)] = 0.1
    """Of how the right camera is turned about each of its axes."""
    focal_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.0015
    """Of its focal length against the left one's, as a share."""
    radial_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.01
    """Of the radial distortion k1 and k2 of both, and of the right one's beside."""
    decentring_sigma: Annotated[float, Range(1e-5, 0.1)] = 0.001
    """Of the right one's decentring distortion p1 and p2."""
    lag_sigma_s: Annotated[float, Range(1e-5, 0.1)] = 0.005
    """Of how late its shutter is."""
    settling_s: Annotated[float, Range(1, 1e6)] = 3600.0
    """After so long the pair may have changed by as much as was unknown before any data."""
    loss_px: Annotated[float, Range(0.05, 5)] = 0.17
    """Scale of the Cauchy loss, and the error that covariances take a track for until residuals say more."""
    max_error_px: Annotated[float, Range(0.5, 20)] = 2.5
    """Larger reprojection errors end a track."""
    min_parallax_px: Annotated[float, Range(0.5, 100)] = 25.0
    """Median displacement since the last key frame that makes the next one."""
    min_share: Annotated[float, Range(0.1, 1)] = 0.6
    """A key frame is taken before a smaller share of the last one's points is left."""
    min_inliers: Annotated[int, Range(6, 500)] = 15
    """Fewer points than this, and the pair is not located."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the last located one before the next starts afresh from where the motion led."""
    iterations: Annotated[int, Range(1, 30)] = 10
    """Of the adjustment at most, at each key frame: a pair that is not what it is taken for needs most of them."""

    def pair_sigma(self, focal_px: float, told: PairSigma | None = None) -> Array:
        """(E,) of what may be wrong with the pair, in the order of right_camera.TERMS; 0 holds it.

        `focal_px` of the images whose pixels they are in; `told` by the calibration, in place of the settings.
        """
        if not self.self_calibration:
            return np.zeros(PAIR)
        sigma = told or PairSigma(
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
        return ModernStereo(rig, self)


@dataclass(frozen=True, eq=False)
class ModernStereo:
    """Metric; needs no key frame to follow, and corrects the last few as it goes. World: the rig at the first pair."""

    rig: Rig
    config: ModernStereoConfig

    def start(self) -> ModernStereoState:
        return ModernStereoState(LastPair(left_from_world=self._left_from_rig))

    def finish(self, state: ModernStereoState) -> Trajectory:
        keys = dict(state.settled) | {k.time_ns: k.left_from_world for k in state.map.keys}
        world_from_left = {t: (pose @ keys[key]).inverse() for t, key, pose in state.poses}
        poses = Trajectory.of([(t, pose @ self._left_from_rig) for t, pose in world_from_left.items()])
        return corrected(state.loops, poses)

    def step(self, state: ModernStereoState, exposure: Measurement) -> tuple[ModernStereoState, Step]:
        """One pair: follow the points and locate it; at a key frame look for new points and adjust the window."""
        last_ns = None if state.last.left is None else state.last.time_ns
        exposure = self._size.reduced(require_frame(exposure, STEREO, last_ns))
        watch, new = Stopwatch(), NewPair.of(exposure)
        outcome = self._advance(state, new, watch)
        after, step = outcome.after, as_step(self._setup, exposure, outcome)
        watch.lap("conclude")
        if self.config.loops:
            after, step = with_loops(self._setup, state, outcome, new, step)
            watch.lap("loops")
        return after, self._size.enlarged(replace(step, seconds=watch.seconds))

    def _advance(self, state: ModernStereoState, new: NewPair, watch: Stopwatch) -> Outcome:
        """The algorithm, as its list of steps."""
        setup = self._setup
        before, sighting, decisions = track_and_locate(setup, state, new)
        watch.lap("track")
        state = replace(state, database=before.database)
        wrong = exchanged_since(setup, new, sighting)
        if wrong is not None:
            before, sighting, decisions = state, TrackingResult.nothing(), (*decisions, wrong)
        if state.map.keys and sighting.inliers < setup.min_inliers:
            before, sighting, restart = recover(setup, before, sighting)
            decisions += restart
            if not restart:
                return Outcome(before, Status.LOST, sighting, decisions)
        sighting, tests, moved = motions(setup, before, new, sighting)
        watch.lap("other motion")
        outcome = self._located(state, before, new, sighting, (*decisions, *tests), watch)
        return replace(outcome, other_motion=moved)

    def _located(
        self,
        state: ModernStereoState,
        before: ModernStereoState,
        new: NewPair,
        sighting: TrackingResult,
        decisions: tuple[Decision, ...],
        watch: Stopwatch,
    ) -> Outcome:
        """The pair once it is known where it was taken; `before` is the state as it was followed from."""
        setup = self._setup
        status = Status.INITIALISING if sighting.located is None else Status.TRACKING
        now = Current.of(before, new, sighting)
        tests = key_frame_tests(setup, before.map, now.points)
        decisions += tests
        if before.map.keys and not any(test.passed for test in tests):
            after = next_state(setup, before, before, now, sighting, is_key=False)
            return Outcome(after, status, sighting, decisions, before)
        fresh = new_points(setup, before, now)
        why_not = () if before.map.keys else _no_start(setup, new, len(fresh))
        if why_not:
            # Nothing is seen: what was seen before is still the best to find the way from.
            status = Status.LOST if state.map.keys else Status.INITIALISING
            waiting = replace(state, lost_pairs=before.lost_pairs)
            return Outcome(waiting, status, sighting, (*decisions, *why_not))
        watch.lap("new points")
        grown, now, adjustment = extended(setup, before, now, fresh, sighting)
        watch.lap("adjust")
        after = next_state(setup, before, grown, now, sighting, is_key=True)
        restarted = bool(state.map.keys) and not before.map.keys
        decisions += adjustment
        return Outcome(after, status, sighting, decisions, before, len(fresh), key_frame=True, restarted=restarted)

    @cached_property
    def _size(self) -> TrackedSize:
        return TrackedSize.of(self.rig.camera("left"), self.config.max_width_px)

    @property
    def _pair_sigma(self) -> Array:
        told = self.rig.pair_sigma
        return self.config.pair_sigma((self._size.tracked if told is None else self.rig.camera("left")).fx, told)

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
        )

    @cached_property
    def _left_from_rig(self) -> Pose:
        return self.rig.rig_from_left.inverse()


def _no_start(setup: Setup, new: NewPair, count: int) -> tuple[Decision, ...]:
    """Why a pair begins no map, with `count` new points; nothing where it does."""
    wrong = exchanged(setup, new)
    few = checks.DEPTH_POINTS.of(count, setup.min_inliers, "waiting for the next pair")
    return (wrong,) if wrong is not None else (few,) if few.failed else ()
