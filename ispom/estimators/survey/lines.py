"""Motion of a stereo camera from straight lines: edges of doors, bricks and windows instead of points.

Segments: LSD (Grompone von Gioi et al. 2010), or as Table 3 names them: Canny's edges (1986) with Hough's transform
(1962; Matas et al. 2000), or Canny's edges and then lines. Both are fitted to the edge points, to the sub-pixel.
Motion: Taylor and Kriegman, Structure and motion from line segments in multiple images, PAMI 1995; directions as an
absolute reference: Coughlan and Yuille, Manhattan world, ICCV 1999, without the right angles unless `manhattan` asks
for them. `lines.monocular` has the same with one camera, from three views.

The steps, in the order of this file (what both methods share is in `scene_lines.py`):

1. Segments are found in the left image, and vanishing directions: sequential RANSAC over pairs of segments. Where they
   are near directions that are known from before, they give the rotation. No error of it accumulates.
2. Matches: points along each known line are followed (Lucas-Kanade) from where its depth and the last velocity predict
   them. A point may slide along an edge; the points only elect the segment that is the same line.
3. Pose: samples of four lines, then robust Gauss-Newton over all. The residuals are distances of the projected 3-D
   ends from the observed infinite line, and of segments from the vanishing points of their directions.
4. Depth: the disparities of points along a segment are fitted by a straight line. Each pair makes those of known lines
   more exact. Lines that were seen in `min_views` pairs are the map of lines.

Limits. A segment along the rows has a depth only by the texture around it; on smooth walls, edges along the rows have
none, and vertical ones alone leave the height unknown. Repeated edges (railings, tiles) elect the wrong neighbour where
the prediction is off by half of their distance. Round things have no lines. No loop is closed, and no covariance is
given: errors of neighbouring segments have common causes that no simple formula covers.

Measured (`ispom run SOURCE --methods lines`): sim:indoor, 90 pairs of 27.7 m: ATE 3 mm, 0.01 % of the path, t_err 0.05
%; with `--lines.detector hough` 5 mm and 0.06 %, with `canny` 2 mm and 0.03 %. KITTI 06, the first 51 pairs of 59.9 m:
t_err 1.9 %, ATE 0.27 m; `canny` 1.9 % and 0.28 m. There `hough` finds fewer of the same segments: 2 of 51 pairs are
lost, t_err 9 %. EuRoC V1_01 at rest, 20 pairs: 0.6 mm.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method
from ispom.estimators.survey.common import OneKind, Result
from ispom.estimators.survey.scene_lines import (
    DIRECTIONS,
    NOISE_PX,
    LineMap,
    SceneLines,
    Seen,
    SegmentSettings,
    drawn,
    middles,
)
from ispom.features.segments import disparity_along, match_segments
from ispom.geometry import Array, Pose
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.lines import KnownLines, depths_on_lines, end_offsets, refined_pose, sampled_pose
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, ImageLines, Rig, Tracks, WorldLines, as_grey, by_key

INLIER = 4.0
"""An end is an inlier within this number of standard deviations."""
WIDTH = 2.0
"""Width of the loss, in standard deviations."""
MIN_DISPARITY_PX, MAX_DISPARITY_SIGMA_PX = 2.0, 1.0
MAX_BASELINES = 4.0
"""Largest displacement over which errors of disparities grow, in baselines: lines near the motion's axis shift less."""
AGEING, CONTRADICTION = 1.2, 4.0
"""Growth of the standard deviation of a known disparity from pair to pair; and difference of a new one, in standard
deviations, that replaces it."""

SEGMENTS = Check(
    "segments", "segments with a depth", "requirement", "Pair usable?",
    passes="{value} segments have a depth ({threshold} needed).",
    fails="No lines: {value} segments of the pair have a depth ({threshold} needed).",
)  # fmt: skip
INLIERS = Check(
    "line_inliers", "lines that fit the pose", "requirement", "Pair located?", topic="pose",
    passes="Located: {value} lines fit one pose ({threshold} needed).",
    fails="Lost: {value} lines fit one pose ({threshold} needed).",
)  # fmt: skip
SHARE = Check(
    "line_share", "share of matched lines that fit the pose", "warning", "Pair located?",
    passes="{value:.0%} of the matched lines fit one pose ({threshold:.0%} expected).",
    fails="Only {value:.0%} of the matched lines fit one pose ({threshold:.0%} expected): matches may be wrong.",
)  # fmt: skip
CHECKS = by_key(SEGMENTS, DIRECTIONS, INLIERS, SHARE)
STAGES = {
    "segments": "Finds straight segments in the left image, and their vanishing directions.",
    "match": "Follows points along known lines, which elect the segment that is the same line.",
    "pose": "Takes the rotation from known directions, and finds the pose under which 3-D ends lie on observed lines.",
    "depth": "Finds segments in the right image: their disparities give depth.",
}


@dataclass(frozen=True)
class LinesConfig(SegmentSettings):
    """Settings of the lines method."""

    min_length: Annotated[float, Range(0.5, 20), WorthTrying((0.5,))] = 2.0
    """Least length of a segment [% of the image's width]."""
    min_inliers: Annotated[int, Range(4, 200)] = 10
    """Least number of lines that fit one pose; with fewer the pair is lost."""
    min_share: Annotated[float, Range(0.05, 1)] = 0.35
    """Share of matched lines that fit the pose below which it is doubtful."""
    min_views: Annotated[int, Range(2, 20)] = 3
    """Lines seen in this number of pairs are in the map."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the last located one before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> Lines:
        return Lines(rig, checked(self))


@dataclass(frozen=True, eq=False)
class Memory:
    """The last located pair with its lines, and the map of lines."""

    time_ns: int
    left: Image
    world_from_left: Pose
    lines: SceneLines = field(default_factory=SceneLines.empty)
    next_id: int = 0
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) twist per second on the right of the pose."""
    map: LineMap = field(default_factory=LineMap)
    lost_pairs: int = 0


@dataclass(frozen=True, eq=False)
class Lines(OneKind["Memory | None"]):
    """Gives each pair a metric pose. World: the rig at the first pair."""

    rig: Rig
    config: LinesConfig
    kind = "stereo"
    frame = "rig"

    def begin(self) -> Memory | None:
        return None

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory | None, Result]:
        """See OneKind: one pair."""
        config, camera = self.config, self.rig.camera("left")
        left = as_grey(frame.left)
        seen = Seen.of(left, camera, config.detector, config.min_length / 100 * camera.width, config.max_segments)
        watch.lap("segments")
        if memory is None:
            return self._begun(None, frame, left, seen, (), watch)

        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        predicted, lines = memory.world_from_left @ Pose.exp(seconds * memory.velocity), memory.lines
        ends = camera.project(predicted.inverse().apply(lines.xyz.reshape(-1, 3))).reshape(-1, 2, 2)
        match, _ = match_segments(memory.left, left, lines.uv.astype(float), seen.uv, ends)
        index = np.flatnonzero(match >= 0)
        watch.lap("match")

        rotation, same = memory.map.rotation(seen, predicted.rotation.T)
        moved = float(np.linalg.norm(predicted.translation - memory.world_from_left.translation))
        sigma = self._sigma(lines.sigma_px[index], moved)
        known = KnownLines(seen.normalised[match[index]], lines.xyz[index], sigma)
        guesses = [predicted.inverse(), Pose(rotation, -rotation @ predicted.translation)]
        towards = memory.map.pointing(seen, same, 1 / camera.fx)
        pose, _ = refined_pose(known, towards, sampled_pose(known, guesses, INLIER), WIDTH)
        offset = np.abs(end_offsets(pose.rotation[None], pose.translation[None], known.seen.lines, known.xyz))[0]
        fits = (offset / sigma < INLIER).all(axis=1)
        decisions = (
            DIRECTIONS.of((same >= 0).sum(), 2),
            INLIERS.of(fits.sum(), config.min_inliers),
            SHARE.of(fits.mean() if len(fits) else 0.0, config.min_share),
        )
        watch.lap("pose")
        if not decisions[1].passed:
            if memory.lost_pairs < config.max_lost_pairs:
                return replace(memory, lost_pairs=memory.lost_pairs + 1), self._unused(memory, seen, decisions)
            return self._begun(memory, frame, left, seen, decisions, watch)

        located, inliers = pose.inverse(), index[fits]
        after = replace(
            memory, time_ns=frame.time_ns, left=left, world_from_left=located, lost_pairs=0,
            velocity=(memory.world_from_left.inverse() @ located).log() / seconds,
        )  # fmt: skip
        kept = replace(lines[inliers], uv=seen.uv[match[inliers]])
        after, segments = self._with_lines(after, frame, seen, kept, match[inliers])
        watch.lap("depth")
        residual = np.sqrt((np.minimum(offset, 1e3) ** 2).mean(axis=1)) * camera.fx
        tracks = middles(lines[index], seen.uv[match[index]], fits, residual, after.lines)
        result = self._result(after, seen, tracks, (*decisions, segments))
        return after, replace(result, residuals_px=residual[fits])

    def _sigma(self, sigma_px: Array, moved: float) -> Array:
        """Returns the standard deviations (N, 2) of projected ends from observed lines, normalised.

        After a displacement, errors of disparities shift the projection as they do between the left and right image.
        """
        depth = sigma_px * min(moved / self.rig.baseline_m, MAX_BASELINES)
        return np.hypot(NOISE_PX, depth) / self.rig.camera("left").fx

    # Step 4: depth, and the map

    def _begun(
        self, memory: Memory | None, frame: Frame, left: Image, seen: Seen, decisions: tuple[Decision, ...],
        watch: Stopwatch,
    ) -> tuple[Memory | None, Result]:  # fmt: skip
        """Begins at a pair: the first one, or after a loss at the last known pose."""
        after, none = Memory(frame.time_ns, left, self.rig.rig_from_left), SceneLines.empty()
        if memory is not None:
            after = replace(
                after, world_from_left=memory.world_from_left, next_id=memory.next_id,
                map=memory.map.without_directions(),
            )  # fmt: skip
        after, segments = self._with_lines(after, frame, seen, none, np.zeros(0, np.int64))
        watch.lap("depth")
        decisions = (*decisions, segments)
        if not segments.passed:
            return memory, self._unused(memory, seen, decisions)
        tracks = middles(none, none.uv, np.zeros(0, bool), np.zeros(0), after.lines)
        return after, replace(self._result(after, seen, tracks, decisions), restarted=memory is not None)

    def _with_lines(
        self, memory: Memory, frame: Frame, seen: Seen, kept: SceneLines, of_kept: NDArray[np.int64]
    ) -> tuple[Memory, Decision]:
        """Returns the memory with the known lines, which are now the segments `of_kept`, and new ones of the pair."""
        pose = memory.world_from_left
        line_map, group = memory.map.with_directions(seen, pose, self.config.manhattan)
        disparity, sigma = disparity_along(memory.left, as_grey(frame.right), seen.uv)
        good = np.all((disparity > MIN_DISPARITY_PX) & (sigma < MAX_DISPARITY_SIGMA_PX), axis=1)
        kept = self._fused(pose, kept, disparity[of_kept], sigma[of_kept], good[of_kept])
        kept = replace(kept, views=kept.views + 1, group=group[of_kept])
        good[of_kept] = False
        count = int(good.sum())
        xyz = self._xyz(pose, seen.uv[good], disparity[good])
        lines = kept.and_more(SceneLines.new(memory.next_id, seen.uv[good], group[good], xyz, sigma[good]))
        known = lines[lines.views >= self.config.min_views]
        line_map = line_map.with_lines(known.ids, known.xyz, known.group)
        memory = replace(memory, lines=lines, next_id=memory.next_id + count, map=line_map)
        return memory, SEGMENTS.of(len(lines), self.config.min_inliers)

    def _xyz(self, world_from_left: Pose, uv: NDArray[np.float32], disparity: Array) -> Array:
        flat = points_from_disparity(
            self.rig.camera("left"), self.rig.baseline_m, uv.reshape(-1, 2).astype(float), disparity.ravel()
        )
        return world_from_left.apply(flat).reshape(-1, 2, 3)

    def _fused(
        self, pose: Pose, kept: SceneLines, disparity: Array, sigma: Array, good: NDArray[np.bool_]
    ) -> SceneLines:
        """Returns known lines with the ends of this pair's segments. Their disparities are weighted means of the
        earlier values and those of this pair."""
        camera = self.rig.camera("left")
        strength = camera.fx * self.rig.baseline_m
        before = strength / depths_on_lines(camera.normalise(kept.uv.reshape(-1, 2)), pose.inverse().apply(kept.xyz))
        usable = np.all(before > MIN_DISPARITY_PX, axis=1)
        value, error = np.where(usable[:, None], before, 1.0), AGEING * kept.sigma_px
        new, new_error = np.where(good[:, None], disparity, value), np.where(good[:, None], sigma, np.inf)
        replaced = good & ((np.abs(value - new) > CONTRADICTION * np.hypot(error, new_error)).any(axis=1) | ~usable)
        weight = np.where(replaced[:, None], 0.0, 1 / error**2)
        total = weight + 1 / new_error**2
        mean = (weight * value + new / new_error**2) / total
        valid = usable | good
        fused = replace(kept, xyz=self._xyz(pose, kept.uv, mean), sigma_px=np.sqrt(1 / total))
        return replace(
            kept,
            xyz=np.where(valid[:, None, None], fused.xyz, kept.xyz),
            sigma_px=np.where(valid[:, None], fused.sigma_px, error),
        )

    # What is drawn

    def _unused(self, memory: Memory | None, seen: Seen, decisions: tuple[Decision, ...]) -> Result:
        """Returns the result without a pose: none of the segments is used."""
        mapped = WorldLines.empty() if memory is None else memory.map.lines
        return Result(decisions=decisions, lines={"left": ImageLines.of(seen.uv, -1)}, world_lines=mapped)

    def _result(self, memory: Memory, seen: Seen, tracks: Tracks, decisions: tuple[Decision, ...]) -> Result:
        return Result(
            memory.world_from_left @ self.rig.rig_from_left.inverse(),
            decisions,
            {"left": tracks},
            key_frame=True,
            lines={"left": drawn(seen.uv, memory.lines)},
            world_lines=memory.map.lines,
        )


METHOD = Method(
    "lines", STEREO, LinesConfig, "metric", "Taylor and Kriegman 1995; Grompone von Gioi et al. 2010 (LSD)",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: lines",
)  # fmt: skip
