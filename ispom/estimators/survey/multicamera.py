"""Motion of a rig of any number of cameras at known places, with or without overlap: a generalised camera.

Pless, Using many cameras as one, CVPR 2003; Li, Hartley and Kim, A linear approach to motion estimation using
generalized camera models, CVPR 2008 (when the scale is not observable).

The steps, in the order of this file:

1. Each camera follows corners by itself (Lucas-Kanade), with or without overlap.
2. Where fields of view overlap, points are searched in the second camera: their depths are metric at once.
3. The first motion: from points of known depth, or else from the essential matrix of the camera that sees it best;
   its length is then a guess.
4. Generalised resection: one Gauss-Newton over the points of all cameras gives the pose of the rig.
5. A window of frames is adjusted together with the inverse depths of all points (`ispom.solvers.generalised`).
6. Is the scale observable? Its relative standard deviation is that of the best known length in the window, from the
   normal equations. Overlap makes it small, and so do rotations of a rig whose cameras do not overlap; on the straight
   it is not. There the scale is fixed, and the check says so: the unit is then the earlier one, or the guess. If the
   images determine the scale roughly, and contradict the fixed one by many standard deviations, it is estimated again.

Limits: observations lie on the plane z = 1, so directions at 90 degrees from an axis or more are not used; all cameras
expose at the same time; nothing is relocalised; a point that leaves a camera is a new one in the next camera. Until the
scale is observable for the first time, the path has a guessed unit (the first points at `assumed_depth_m`), which the
segment after that corrects. A rig that moves on a circle and turns with it, with all cameras on the line to the
centre, has no observable scale without overlap (Clipp et al. 2008), and the check says so.

Measured with the default settings; SE(3) aligned, except where it says up to scale:

- KITTI 06 (51 pairs, 60 m) cropped to two cameras (`tests.crops`). 30 % overlap: t_err 1.23 %, scale sigma
  0.3 %. 10 %: the scale is observable from frame 17 on, t_err 1.4 % from there. 0 %: never observable (sigma 65 % and
  more at all frames), t_err 1.1 % up to scale.
- sim:ring5, ring6, ring8 (10 s, 14 m): t_err 0.83, 0.37, 0.28 %; the forward camera alone 4.6 % (its scale is guessed),
  sideways cameras alone 4.5 to 36 %; rotation error 0.8, 0.7, 1.0 degrees/100 m, alone 2.1 to 6.1. Up to scale, the
  forward camera alone, which then has all the points, is as good in position as ring5 (0.4 and 0.8 %; seed 1: 0.4 and
  0.5 %, seed 2: 2.0 and 0.2 %). sim:indoor?cameras=6: 0.11 %.
- A guess 75 % too long, of three made-up cameras that turn by 2 degrees a frame, is freed when the scale is known to
  10 %: 10 % off there, 1 % four frames later. A known scale made 33 % too long (five such cameras) is found anew at the
  next frame: 1.6 % off.
- Three made-up cameras without overlap that turn by 5 degrees a frame: scale within 1 % after six frames.
- A car with six cameras, three instants 1.3 m apart, images halved: 2.9 % of the way, 0.04 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import Method
from ispom.estimators.survey.common import OneKind, Result
from ispom.features.klt import Klt
from ispom.features.overlap import Overlap
from ispom.features.shi_tomasi import detect_spread
from ispom.geometry import Array, Pose
from ispom.numerics.robust import normalised_mad
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.generalised import (
    Adjusted,
    Cameras,
    Observations,
    Projected,
    Window,
    adjust,
    errors_of,
    points_in_world,
    reanchored,
    resect,
    scaled,
)
from ispom.solvers.multiview.essential import relative_pose
from ispom.solvers.multiview.rotation import median_displacement
from ispom.solvers.multiview.triangulation import triangulate
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, Landmarks, Rig, Tracks, TrackStatus, as_grey, by_key, colours_at
from ispom.types.measurements import CAMERAS

FOLLOW = Klt(window_px=13, levels=4)
MIN_DISTANCE_PX = 8.0
"""Least distance between corners."""
KNOWN_PX = 2.0
"""A point takes part in the resection where the uncertainty of its depth moves it less than this in the image."""
OUTLIER_PX = 3.0
"""Points that are farther from where they should be end."""
SCALE_DRIFT = 0.001
"""Relative standard deviation with which the scale may change from frame to frame by itself."""
SHOWN_SIGMA = 0.2
"""Largest relative standard deviation of the depth of points that are shown."""
NEW_BELOW = 0.8
"""New corners are detected in a camera where it has less than this share of those wanted."""
LEAST_ESSENTIAL = 15
"""Inliers of the first essential matrix."""
SPARE = 2
"""Multiple of the least number of inliers that must have a depth in a first frame: the next frame sees fewer."""
LEAST_RATIOS = 5
"""Observations by two cameras from which a guessed scale is corrected."""
MOST_SIGMA = 100.0
"""Relative standard deviation that is reported for a scale that nothing determines."""

CONTRADICTED, KNOWN_CONTRADICTED = 3.0, 5.0
"""Standard deviations by which images must contradict a scale before it is estimated again: of a guessed scale, and of
one that was known."""
ROUGHLY = 2.0
"""Multiple of `max_scale_sigma` up to which images may contradict a scale."""
SETTLING = 5
"""Number of optimisations without a fixed scale, which changes slowly."""
SETTLED = 0.01
"""Relative change of the scale below which these optimisations end."""

PARALLAX = Check(
    "parallax", "parallax of the first motion", "requirement", "First motion known?", unit="px", topic="map",
    passes="First motion: the tracks moved by {value:.1f} px ({threshold:.1f} needed).",
    fails="Waiting: the tracks moved by {value:.1f} px ({threshold:.1f} needed).",
)  # fmt: skip
INLIERS = Check(
    "rig_inliers", "points that fit the first estimate of the rig's pose", "requirement", "Rig located?", topic="pose",
    passes="Located: {value} points fit the first estimate of the pose ({threshold} needed).",
    fails="Lost: {value} points fit the first estimate of the pose ({threshold} needed).",
)  # fmt: skip
SCALE = Check(
    "relative_scale_sigma", "relative standard deviation of the scale", "finding", "Is the scale observable?", "<=",
    passes="Scale observable: its standard deviation is {value:.1%} (limit {threshold:.1%}).", topic="scale",
    fails="Scale not observable: its standard deviation would be {value:.0%} (limit {threshold:.0%}); it is held.",
)  # fmt: skip
HELD = Check(
    "scale_contradiction", "standard deviations by which the images want another scale", "warning", relation="<=",
    passes="The images agree with the scale: they want it {value:.1f} standard deviations off (limit {threshold}).",
    fails="Scale contradicted: the images want it {value:.1f} standard deviations off (limit {threshold}).",
    topic="scale",
)  # fmt: skip
METRE = Check(
    "metre_sigma", "relative standard deviation of the unit, as a metre", "finding", "Is the pose metric?", "<=",
    passes="Metric: the unit is a metre with a standard deviation of {value:.1%} (limit {threshold:.1%}).",
    fails="Not metric: the unit would be a metre with a standard deviation of {value:.0%} (limit {threshold:.1%}).",
    topic="scale",
)  # fmt: skip
OVERLAP = Check(
    "overlap_points", "points seen by two cameras at once", "finding",
    passes="{value} points are seen by two cameras at once.",
    fails="No overlap: {value} points are seen by two cameras at once.",
)  # fmt: skip
CHECKS = by_key(PARALLAX, INLIERS, SCALE, HELD, METRE, OVERLAP)
STAGES = {
    "track": "Follows the corners of each camera into its new image.",
    "overlap": "Searches points in the other cameras that see them.",
    "pose": "Locates the rig by the known points of all cameras (generalised resection), or finds the first motion.",
    "window": "Adjusts the frames of the window and all depths; computes how well the scale is determined.",
    "new points": "Detects new corners in cameras that have few.",
}


@dataclass(frozen=True)
class MulticameraConfig:
    """Settings of the method for rigs of many cameras."""

    max_points: Annotated[int, Range(40, 3000), WorthTrying((2,))] = 400
    """Corners followed in all cameras together."""
    window: Annotated[int, Range(3, 20), WorthTrying((2,))] = 7
    """Frames that are adjusted together."""
    keyframe_px: Annotated[float, Range(0.5, 100), WorthTrying((0.5,))] = 10.0
    """Median displacement of the tracks from the last frame of the window at which the next one stays in it [px]."""
    noise_px: Annotated[float, Range(0.05, 5), WorthTrying((2,))] = 0.5
    """Standard deviation of an observation, and width of the robust loss [px]."""
    nearest_m: Annotated[float, Range(0.1, 100)] = 1.5
    """Least depth of points that are searched in a second camera [m]."""
    max_scale_sigma: Annotated[float, Range(0.001, 1)] = 0.05
    """The scale is observable where its relative standard deviation is at most this, and poses are metric where that of
    their unit is."""
    assumed_depth_m: Annotated[float, Range(0.01, 1000)] = 10.0
    """Median depth of the first points where the scale is not observable: a guess [m]."""
    min_inliers: Annotated[int, Range(6, 500)] = 15
    """Least number of inliers in all cameras together; with fewer the rig is not located."""

    def build(self, rig: Rig) -> Multicamera:
        return Multicamera(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Memory:
    """The window, and its points; those that are still followed have a position `uv`."""

    window: Window
    ids: NDArray[np.int64]
    """(M,)."""
    uv: NDArray[np.float32]
    """(M, 2) [px] in the newest image; NaN where the track ended."""
    rho_sigma: Array
    """(M,) of the inverse depths; inf where unknown."""
    greys: dict[str, Image]
    """The newest images."""
    time_ns: int
    last_pose: Pose
    """world_from_rig of the last located frame."""
    next_id: int = 0
    located: bool = False
    """The window has poses; else it is the first frame, and waits for a motion."""
    newest_is_key: bool = True
    scale_known: bool = False
    """The scale was observable at some time in this segment; else it is a guess."""
    unit_sigma: float = 1.0
    """Relative standard deviation of the prior on the scale. It takes all windows of the segment as independent, so
    that the scale is steady. 1 while the scale is a guess."""
    metre_sigma: float | None = None
    """Relative standard deviation of the unit, as a metre; None while it is a guess."""
    twist: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) velocity of the rig, for the prediction [1/s]."""
    begins: bool = False
    """The first pose that is found begins another segment."""

    @property
    def alive(self) -> NDArray[np.bool_]:
        return np.isfinite(self.uv[:, 0])

    def select(self, points: NDArray[np.bool_]) -> Memory:
        return replace(
            self, window=self.window.select(points), ids=self.ids[points], uv=self.uv[points],
            rho_sigma=self.rho_sigma[points],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Multicamera(OneKind["Memory | None"]):
    """Gives each frame of several cameras a pose of the rig. World: the rig at the first frame."""

    rig: Rig
    config: MulticameraConfig
    kind = CAMERAS
    frame = "rig"

    def begin(self) -> Memory | None:
        return None

    @cached_property
    def cameras(self) -> Cameras:
        return Cameras.of(self.rig, tuple(self.rig.cameras))

    @cached_property
    def overlaps(self) -> dict[tuple[int, int], Overlap]:
        """Returns the overlaps by the numbers of both cameras."""
        names, found = self.cameras.names, dict[tuple[int, int], Overlap]()
        for a, first in enumerate(names):
            for b, second in enumerate(names):
                pose = self.rig.rig_from(first).inverse() @ self.rig.rig_from(second)
                if a != b and np.linalg.norm(pose.translation) > 1e-6:
                    overlap = Overlap.of(self.rig.camera(first), self.rig.camera(second), pose)
                    found |= {} if overlap is None else {(a, b): overlap}
        return found

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory | None, Result]:
        greys = {n: as_grey(image) for n, image in frame.images.items() if n in self.cameras.names}
        if memory is None:
            return self._begun(frame, greys, Pose(), 0, False, watch)
        now, status = self._followed(memory, greys, frame.time_ns)
        watch.lap("track")
        moved, decisions = self._resected(now) if memory.located else self._first_motion(now)
        watch.lap("pose")
        if moved is None:
            return self._not_located(memory, now, status, frame, decisions, watch)
        adjusted, rescaled, scales, unit_sigma, metre_sigma = self._adjusted(moved)
        watch.lap("window")
        located = replace(
            moved, window=adjusted.window, rho_sigma=adjusted.rho_sigma, located=True, unit_sigma=unit_sigma,
            metre_sigma=metre_sigma, scale_known=moved.scale_known or rescaled or scales[0].passed, begins=False,
            last_pose=adjusted.window.pose(-1),
        )  # fmt: skip
        located, residual_px = self._without_outliers(located, adjusted)
        status[(status == TrackStatus.ALIVE) & ~located.alive] = TrackStatus.REPROJECTION
        after = self._with_new_points(self._shortened(located, memory, frame.time_ns))
        watch.lap("new points")
        after, count = self._with_overlap(after)
        watch.lap("overlap")
        overlap = OVERLAP.of(count, self.config.min_inliers)
        tracks = self._tracks(memory, now, status, residual_px, after)
        result = self._result(frame, after, tracks, (*decisions, *scales, overlap), residual_px)
        restarted = (rescaled and memory.located) or moved.begins
        return after, replace(result, restarted=restarted, key_frame=after.newest_is_key)

    # The first frame, and frames without a pose

    def _begun(
        self, frame: Frame, greys: dict[str, Image], pose: Pose, next_id: int, begins: bool, watch: Stopwatch
    ) -> tuple[Memory, Result]:
        """Begins at a frame of this pose; it is located where enough points have a depth from the overlap."""
        none, ints = np.zeros(0), np.zeros(0, np.int64)
        window = Window(
            pose.rotation[None], pose.translation[None], ints, ints, none, np.zeros((1, 0, 2)),
            np.zeros((1, 0), np.int64), np.zeros((1, 0, 2)),
        )  # fmt: skip
        memory = Memory(window, ints, np.zeros((0, 2), np.float32), none, greys, frame.time_ns, pose, next_id)
        memory = self._with_new_points(memory)
        watch.lap("new points")
        memory, count = self._with_overlap(memory)
        watch.lap("overlap")
        located = count >= SPARE * self.config.min_inliers
        memory = replace(memory, located=located, scale_known=located, begins=begins and not located)
        decision = OVERLAP.of(count, self.config.min_inliers)
        tracks = self._tracks(memory.select(np.zeros(len(memory.ids), bool)), None, np.zeros(0, np.uint8), none, memory)
        result = self._result(frame, memory, tracks, (decision,), none)
        return memory, replace(result, pose=pose if located else None, key_frame=True, restarted=begins and located)

    def _not_located(
        self, memory: Memory, now: Memory, status: NDArray[np.uint8], frame: Frame, decisions: tuple[Decision, ...],
        watch: Stopwatch,
    ) -> tuple[Memory, Result]:  # fmt: skip
        """Waits for a motion at the first frame; begins again where the map is lost, or most tracks have ended."""
        if memory.located or now.alive.sum() < max(len(now.ids) / 2, 1):
            begins = memory.located or memory.begins
            after, result = self._begun(frame, now.greys, memory.last_pose, now.next_id, begins, watch)
            return after, replace(result, decisions=(*decisions, *result.decisions))
        first = slice(0, 1)
        window = replace(
            now.window, rotations=now.window.rotations[first], translations=now.window.translations[first],
            own=now.window.own[first], other=now.window.other[first], other_xy=now.window.other_xy[first],
        )  # fmt: skip
        none = np.full(len(now.ids), np.nan)
        tracks = self._tracks(memory, now, status, none, now.select(np.zeros(len(now.ids), bool)))
        return replace(now, window=window), Result(decisions=decisions, tracks=tracks)

    # Step 1: tracks, each in its camera

    def _followed(self, memory: Memory, greys: dict[str, Image], time_ns: int) -> tuple[Memory, NDArray[np.uint8]]:
        """Returns the memory with one more frame, at the predicted pose, and TrackStatus (M,) of its points."""
        uv, xy = np.full_like(memory.uv, np.nan), np.full(memory.uv.shape, np.nan)
        status = np.full(len(uv), TrackStatus.LOST, np.uint8)
        for c, name in enumerate(self.cameras.names):
            some = np.flatnonzero((memory.window.camera == c) & memory.alive)
            if name in greys and name in memory.greys:
                found, status[some] = FOLLOW.track(memory.greys[name], greys[name], memory.uv[some])
                good = status[some] == TrackStatus.ALIVE
                uv[some[good]] = found[good]
                xy[some[good]] = self.rig.camera(name).normalise(found[good])
        window, count = memory.window, len(uv)
        step = Pose.exp(memory.twist * (time_ns - memory.time_ns) * 1e-9)
        pose = memory.last_pose @ step
        window = replace(
            window,
            rotations=np.concatenate([window.rotations, pose.rotation[None]]),
            translations=np.concatenate([window.translations, pose.translation[None]]),
            own=np.concatenate([window.own, xy[None]]),
            other=np.concatenate([window.other, np.full((1, count), -1)]),
            other_xy=np.concatenate([window.other_xy, np.full((1, count, 2), np.nan)]),
        )
        return replace(memory, window=window, uv=uv, greys=greys, time_ns=time_ns), status

    # Step 2: points that two cameras see

    def _with_overlap(self, memory: Memory) -> tuple[Memory, int]:
        """Adds observations of the newest frame by second cameras, and depths of points that had none; returns how
        many points two cameras see, too."""
        window, names = memory.window, self.cameras.names
        other, other_xy = window.other.copy(), window.other_xy.copy()
        rho, sigma = window.rho.copy(), memory.rho_sigma.copy()
        for (a, b), overlap in self.overlaps.items():
            some = np.flatnonzero((window.camera == a) & memory.alive & (other[-1] < 0))
            if not len(some) or names[a] not in memory.greys or names[b] not in memory.greys:
                continue
            images = memory.greys[names[a]], memory.greys[names[b]]
            xy, found = overlap.match(*images, memory.uv[some], self.config.nearest_m)
            some, xy = some[found], xy[found]
            other[-1, some], other_xy[-1, some] = b, xy
            unknown = ~np.isfinite(sigma[some])
            first_from_second = overlap.first_from_second
            z = triangulate(first_from_second.inverse(), window.own[-1, some], xy)[:, 2]
            baseline = float(np.linalg.norm(first_from_second.translation))
            good = some[unknown & (z > 0)]
            rho[good] = 1 / np.clip(z[unknown & (z > 0)], self.config.nearest_m / 2, 1e5)
            sigma[good] = 2 * self.config.noise_px / (self.cameras.focal_px[a] * baseline)
        count = int((other[-1] >= 0).sum())
        window = replace(window, rho=rho, other=other, other_xy=other_xy)
        return replace(memory, window=window, rho_sigma=sigma), count

    # Step 3: the first motion, without known depths

    def _first_motion(self, memory: Memory) -> tuple[Memory | None, tuple[Decision, ...]]:
        """Returns the memory with the pose of its second frame, from the camera with most inliers, and depths."""
        window, best, largest = memory.window, None, 0.0
        for c, focal in enumerate(self.cameras.focal_px):
            some = np.flatnonzero((window.camera == c) & memory.alive)
            x1, x2 = window.own[0, some], window.own[1, some]
            moved = focal * median_displacement(np.eye(3), x1, x2) if len(some) >= LEAST_ESSENTIAL else 0.0
            largest = max(largest, moved)
            if moved < self.config.keyframe_px:
                continue
            found = relative_pose(x1, x2, 1.0 / focal)
            if found is not None and found.inliers.sum() >= max(LEAST_ESSENTIAL, 0 if best is None else best[0] + 1):
                best = int(found.inliers.sum()), c, found.second_from_first, x1[found.inliers], x2[found.inliers]
        parallax = PARALLAX.of(largest, self.config.keyframe_px)
        if best is None:
            return None, (parallax,)
        _, c, second_from_first, x1, x2 = best
        scale = self.config.assumed_depth_m / float(np.median(triangulate(second_from_first, x1, x2)[:, 2]))
        rig_from_camera = self.rig.rig_from(self.cameras.names[c])
        now_from_first = rig_from_camera @ second_from_first.scaled(scale) @ rig_from_camera.inverse()
        window = window.with_pose(1, window.pose(0) @ now_from_first.inverse())
        rho = np.full(len(memory.ids), 1 / self.config.assumed_depth_m)
        for c, name in enumerate(self.cameras.names):
            some = np.flatnonzero((window.camera == c) & memory.alive)
            motion = self.rig.rig_from(name).inverse() @ now_from_first @ self.rig.rig_from(name)
            z = triangulate(motion, window.own[0, some], window.own[1, some])[:, 2]
            rho[some] = 1 / np.where(z > 0, np.clip(z, 1e-2, 1e4), 10 * self.config.assumed_depth_m)
        found = adjust(replace(window, rho=rho), self.cameras, self.config.noise_px, SCALE_DRIFT)
        inliers = INLIERS.of((found.errors_px <= OUTLIER_PX).sum(), self.config.min_inliers)
        if not inliers.passed:
            return None, (parallax, inliers)
        return replace(memory, window=found.window, rho_sigma=found.rho_sigma), (parallax, inliers)

    # Step 4: generalised resection

    def _resected(self, memory: Memory) -> tuple[Memory | None, tuple[Decision, ...]]:
        """Locates the newest frame by the points of all cameras whose depths are known well enough."""
        window, newest = memory.window, len(memory.window.rotations) - 1
        seen = Observations.of(window)
        seen = seen.select(seen.frame == newest)
        seen = seen.select(np.isfinite(memory.rho_sigma[seen.point]))
        uncertain = np.linalg.norm(errors_of(window, self.cameras, seen).by_rho, axis=1) * memory.rho_sigma[seen.point]
        seen = seen.select(uncertain < KNOWN_PX)
        count, errors = 0, np.zeros(0)
        if len(seen.point) >= self.config.min_inliers:
            window, errors = resect(window, self.cameras, seen, newest, self.config.noise_px)
            count = int((errors <= OUTLIER_PX).sum())
        located = INLIERS.of(count, self.config.min_inliers)
        return (replace(memory, window=window) if located.passed else None), (located,)

    # Steps 5 and 6: the window, and whether it determines the scale

    def _adjusted(self, memory: Memory) -> tuple[Adjusted, bool, tuple[Decision, ...], float, float | None]:
        """Returns the optimised window, whether the scale was determined for the first time or again, its checks, the
        standard deviation of the scale from this window and those before (a Kalman filter of one number, whose update
        is part of the optimisation), and that of the unit relative to the metre."""
        noise, window = self.config.noise_px, memory.window
        prior_sigma = float(np.hypot(memory.unit_sigma, SCALE_DRIFT)) if memory.scale_known else SCALE_DRIFT
        if not memory.scale_known:
            window = self._scaled_by_overlap(window)
        found = adjust(window, self.cameras, noise, prior_sigma)
        scale = SCALE.of(min(found.scale_sigma, MOST_SIGMA), self.config.max_scale_sigma)
        first_time = scale.passed and not memory.scale_known
        if first_time:
            prior_sigma = 1.0
            found = adjust(found.window, self.cameras, noise, prior_sigma)
        held, anew = self._contradiction(found, prior_sigma, memory.scale_known or first_time)
        if anew is not None and not first_time:
            found, prior_sigma, first_time = anew, 1.0, True
        known = memory.scale_known or first_time
        unit_sigma = (prior_sigma**-2 + found.scale_sigma**-2) ** -0.5 if known else 1.0
        metre = self._metre(memory, found, first_time) if known else None
        return found, first_time, (scale, *held), min(unit_sigma, 1.0), metre

    def _metre(self, memory: Memory, found: Adjusted, anew: bool) -> float | None:
        """Returns the relative standard deviation with which the unit is a metre, after an adjusted window.

        A keyframe is in as many windows as a window has frames, and its observations must count once. So the
        information of a window is divided by its number of frames, and counts only if its newest frame is a keyframe.
        """
        if memory.metre_sigma is None or anew:
            return found.scale_sigma
        share = 1 / len(found.window.rotations) if memory.newest_is_key else 0.0
        before = np.hypot(memory.metre_sigma, SCALE_DRIFT)
        return float((before**-2 + share * found.scale_sigma**-2) ** -0.5)

    def _contradiction(
        self, found: Adjusted, prior_sigma: float, known: bool
    ) -> tuple[tuple[Decision, ...], Adjusted | None]:
        """Returns whether the images agree with the fixed scale, if they determine it; if they do not agree, also the
        optimised window without the fixed scale."""
        roughly = ROUGHLY * self.config.max_scale_sigma
        if found.scale_sigma > roughly:
            return (), None
        limit = KNOWN_CONTRADICTED if known else CONTRADICTED
        sigma = float(np.hypot(found.scale_sigma, prior_sigma))
        if abs(found.scale_step) <= limit * sigma:
            return (HELD.of(abs(found.scale_step) / sigma, limit),), None
        anew, before = found, np.inf
        for _ in range(SETTLING):
            anew = adjust(anew.window, self.cameras, self.config.noise_px)
            change = abs(np.log(_length(anew.window) / _length(found.window)))
            if abs(change - before) < SETTLED:
                break
            before = change
        off = float(change) / float(np.hypot(anew.scale_sigma, prior_sigma))
        check = HELD.of(off, limit)
        return (check,), None if check.passed or anew.scale_sigma > roughly else anew

    def _scaled_by_overlap(self, window: Window) -> Window:
        """Returns the window in the scale of the points that two cameras see, where they agree.

        Far from that, the robust adjustment would take their observations as outliers. Their depths in the present
        scale are those of an adjustment without the second cameras.
        """
        alone = adjust(
            replace(window, other=np.full_like(window.other, -1)), self.cameras, self.config.noise_px, SCALE_DRIFT
        )
        sure, seen = alone.rho_sigma < SHOWN_SIGMA * alone.window.rho, Observations.of(window)
        seen = seen.select(seen.by_other & sure[seen.point] & np.isfinite(window.own[seen.frame, seen.point, 0]))
        ratios = [np.zeros(0)]
        for (a, b), overlap in self.overlaps.items():
            pair = seen.select((window.camera[seen.point] == a) & (seen.camera == b))
            xy = window.own[pair.frame, pair.point]
            z = triangulate(overlap.first_from_second.inverse(), xy, pair.xy)[:, 2]
            by_first = replace(pair, camera=np.full(len(z), a), xy=xy)
            now = Projected.of(alone.window, self.cameras, by_first).depth / alone.window.rho[pair.point]
            baseline = float(np.linalg.norm(overlap.first_from_second.translation))
            sigma = z * self.config.noise_px / (self.cameras.focal_px[a] * baseline)
            ratios.append((z / now)[(z > 0) & (now > 0) & (sigma < SHOWN_SIGMA)])
        every = np.concatenate(ratios)
        agree = len(every) >= LEAST_RATIOS and normalised_mad(np.log(every)) <= SHOWN_SIGMA
        return replace(scaled(alone.window, float(np.median(every)) if agree else 1.0), other=window.other)

    def _without_outliers(self, memory: Memory, adjusted: Adjusted) -> tuple[Memory, Array]:
        """Ends tracks that are outliers in the newest frame, and drops outliers of second cameras. Also returns the
        errors (M,) [px] of the other tracks in the newest frame."""
        window, seen = memory.window, adjusted.seen
        own, other, uv = window.own.copy(), window.other.copy(), memory.uv.copy()
        newest, off = seen.frame == len(own) - 1, adjusted.errors_px > OUTLIER_PX
        ended = seen.point[newest & off & ~seen.by_other]
        own[-1, ended], uv[ended] = np.nan, np.nan
        wrong = off & seen.by_other & memory.scale_known
        other[seen.frame[wrong], seen.point[wrong]] = -1
        other[-1, ended] = -1
        residual = np.full(len(uv), np.nan)
        good = newest & ~off & ~seen.by_other
        residual[seen.point[good]] = adjusted.errors_px[good]
        return replace(memory, window=replace(window, own=own, other=other), uv=uv), residual

    def _shortened(self, memory: Memory, before: Memory, time_ns: int) -> Memory:
        """Drops the frame before the newest one unless it is a keyframe, the oldest frame if there are too many, and
        points without observations. Decides whether the newest frame is a keyframe, and keeps its velocity."""
        seconds = (time_ns - before.time_ns) * 1e-9
        twist = (before.last_pose.inverse() @ memory.last_pose).log() / seconds if before.located else np.zeros(6)
        if not before.newest_is_key and len(memory.window.rotations) > 2:
            memory = self._without_frame(memory, len(memory.window.rotations) - 2)
        if len(memory.window.rotations) > self.config.window:
            memory = self._without_frame(memory, 0)
        seen = np.isfinite(memory.window.own[..., 0])
        memory = memory.select(memory.alive | (seen.sum(axis=0) > 1))
        last, newest = memory.window.own[-2], memory.window.own[-1]
        common = np.isfinite(last[:, 0]) & np.isfinite(newest[:, 0])
        focal = self.cameras.focal_px[memory.window.camera[common]]
        moved = focal * np.linalg.norm((newest - last)[common], axis=1)
        few = common.sum() < memory.alive.sum() / 2
        is_key = bool(few or not len(moved) or np.median(moved) >= self.config.keyframe_px)
        return replace(memory, twist=twist, newest_is_key=is_key)

    def _without_frame(self, memory: Memory, frame: int) -> Memory:
        window, stay = reanchored(memory.window, self.cameras, frame)
        sigma = memory.rho_sigma[stay] * window.rho / memory.window.rho[stay]
        return replace(memory, window=window, ids=memory.ids[stay], uv=memory.uv[stay], rho_sigma=sigma)

    def _with_new_points(self, memory: Memory) -> Memory:
        """Adds corners of the newest images, at the median depth of the camera's points."""
        wanted, old = max(4, self.config.max_points // len(self.cameras.names)), memory.window
        known = memory.rho_sigma < old.rho
        for c, name in enumerate(self.cameras.names):
            taken = memory.uv[(memory.window.camera == c) & memory.alive]
            if name not in memory.greys or len(taken) >= NEW_BELOW * wanted:
                continue
            uv = detect_spread(memory.greys[name], wanted, taken, MIN_DISTANCE_PX)
            near = old.rho[known & (old.camera == c)] if (known & (old.camera == c)).any() else old.rho[known]
            rho = float(np.median(near)) if len(near) else 1 / self.config.assumed_depth_m
            memory = self._with_points(memory, c, uv, rho)
        return memory

    def _with_points(self, memory: Memory, camera: int, uv: NDArray[np.float32], rho: float) -> Memory:
        window, count, frames = memory.window, len(uv), len(memory.window.rotations)
        own = np.full((frames, count, 2), np.nan)
        own[-1] = self.rig.camera(self.cameras.names[camera]).normalise(uv)
        window = replace(
            window,
            camera=np.concatenate([window.camera, np.full(count, camera)]),
            anchor=np.concatenate([window.anchor, np.full(count, frames - 1)]),
            rho=np.concatenate([window.rho, np.full(count, rho)]),
            own=np.concatenate([window.own, own], axis=1),
            other=np.concatenate([window.other, np.full((frames, count), -1)], axis=1),
            other_xy=np.concatenate([window.other_xy, np.full((frames, count, 2), np.nan)], axis=1),
        )
        ids = memory.next_id + np.arange(count)
        return replace(
            memory, window=window, ids=np.concatenate([memory.ids, ids]), uv=np.concatenate([memory.uv, uv]),
            rho_sigma=np.concatenate([memory.rho_sigma, np.full(count, np.inf)]), next_id=memory.next_id + count,
        )  # fmt: skip

    # What is shown

    def _tracks(
        self, before: Memory, now: Memory | None, status: NDArray[np.uint8], residual_px: Array, after: Memory
    ) -> dict[str, Tracks]:
        """Returns, by camera, the points that were followed, and the new ones of `after`."""
        found, new = dict[str, Tracks](), np.isin(after.ids, before.ids, invert=True)
        for c, name in enumerate(self.cameras.names):
            old, fresh = before.alive & (before.window.camera == c), new & (after.window.camera == c)
            uv = before.uv[old] if now is None else now.uv[old]
            uv = np.where(np.isnan(uv), before.uv[old], uv)
            gap = np.full((fresh.sum(), 2), np.nan, np.float32)
            found[name] = Tracks.of(
                np.concatenate([before.ids[old], after.ids[fresh]]),
                np.concatenate([uv, after.uv[fresh]]),
                uv_prev=np.concatenate([before.uv[old], gap]),
                status=np.concatenate([status[old], np.full(fresh.sum(), TrackStatus.NEW)]),
                residual_px=np.concatenate([residual_px[old], gap[:, 0]]),
            )
        return found

    def _result(
        self,
        frame: Frame,
        memory: Memory,
        tracks: dict[str, Tracks],
        decisions: tuple[Decision, ...],
        residual_px: Array,
    ) -> Result:
        rho = memory.window.rho
        known = memory.alive & (memory.rho_sigma < SHOWN_SIGMA * rho)
        xyz = points_in_world(memory.window.select(known), self.cameras)
        rgb = np.zeros((known.sum(), 3), np.uint8)
        camera = memory.window.camera[known]
        for c, name in enumerate(self.cameras.names):
            if name in frame.images:
                rgb[camera == c] = colours_at(frame.images[name], memory.uv[known][camera == c])
        landmarks = Landmarks(memory.ids[known], xyz, rgb)
        found = Result(memory.last_pose, decisions, tracks, landmarks, residual_px[np.isfinite(residual_px)])
        if not memory.located:
            return found
        sigma = MOST_SIGMA if memory.metre_sigma is None else min(memory.metre_sigma, MOST_SIGMA)
        metre = METRE.of(sigma, self.config.max_scale_sigma)
        known = None if memory.metre_sigma is None else sigma
        return replace(found, decisions=(*decisions, metre), provisional=not metre.passed, scale_sigma=known)


def _length(window: Window) -> float:
    """Returns the distance from the first frame of the window to the last."""
    return max(float(np.linalg.norm(window.translations[-1] - window.translations[0])), 1e-12)


METHOD = Method(
    "multicamera",
    frozenset({CAMERAS}),
    MulticameraConfig,
    "metric",
    "Pless 2003; Li, Hartley and Kim 2008",
    checks=CHECKS,
    stages=STAGES,
    survey="Table 3, many cameras: small or no overlap, panorama rigs",
)
