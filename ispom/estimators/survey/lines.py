"""Motion of a stereo camera from straight lines: edges of doors, bricks and windows instead of points.

Segments: LSD (Grompone von Gioi et al. 2010), or Canny's edges (1986) with Hough's transform (1962; Matas et al. 2000).
Motion: Taylor and Kriegman, Structure and motion from line segments in multiple images, PAMI 1995; directions as an
absolute reference: Coughlan and Yuille, Manhattan world, ICCV 1999, without the right angles unless `manhattan` asks
for them.

The steps, in the order of this file:

1. Segments are found in the left image.
2. Vanishing directions: sequential RANSAC over pairs of segments. Where they are near directions that are known from
   before, they give the rotation. No error of it accumulates.
3. Matches: points along each known line are followed (Lucas-Kanade) from where its depth and the last velocity predict
   them. A point may slide along an edge; the points only elect the segment that is the same line.
4. Pose: samples of four lines, then robust Gauss-Newton over all. The residuals are distances of the projected 3-D
   ends from the observed infinite line, and of segments from the vanishing points of their directions.
5. Depth: the disparities of points along a segment are fitted by a straight line. A segment whose points are not found,
   such as one along the rows without texture around it, has no depth.

Lines that were seen in `min_views` pairs are the map of lines.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import STEREO, Method
from ispom.estimators.survey.common import OneKind, Result
from ispom.features.segments import Detector, detect_segments, disparity_along, match_segments
from ispom.geometry import Array, Pose
from ispom.settings import Range
from ispom.solvers.lines import (
    KnownDirections,
    KnownLines,
    Observed,
    depths_on_lines,
    end_offsets,
    refined_pose,
    rotation_from_directions,
    sampled_pose,
    squared,
    vanishing_directions,
)
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.stopwatch import Stopwatch
from ispom.types import (
    Check,
    Decision,
    Frame,
    Image,
    ImageLines,
    Rig,
    Tracks,
    TrackStatus,
    WorldLines,
    as_grey,
    by_key,
)

NOISE_PX = 0.5
"""Standard deviation of the end of a segment across it [px]."""
INLIER = 4.0
"""An end is an inlier within this number of standard deviations."""
WIDTH = 2.0
"""Of the loss, in standard deviations."""
VANISHING_PX = 1.5
"""Largest offset of a segment's end from the line to the vanishing point."""
SAME_DIRECTION_RAD = np.radians(12.0)
"""Vanishing directions that differ by less are the same direction."""
RIGHT_ANGLE_RAD = np.radians(3.0)
"""What differs from a right angle by less is one in a Manhattan world."""
DIRECTION_PX = 1.0
"""Standard deviation of the offset of a segment's end from the line to its vanishing point; bricks are not exact."""
MIN_DISPARITY_PX, MAX_DISPARITY_SIGMA_PX = 2.0, 1.0
MAX_BASELINES = 4.0
"""Displacement over which errors of disparities grow, in baselines: what is near the motion's axis shifts less."""
AGEING, CONTRADICTION = 1.2, 4.0
"""Growth of the standard deviation of a known disparity from pair to pair; and difference of a new one, in standard
deviations, that replaces it."""
MAX_DIRECTIONS, MAX_COUNT, MAX_MAPPED = 5, 10, 3000
"""Directions in the world, pairs that each is the mean of, and lines of the map."""
WITHOUT_DIRECTION = MAX_DIRECTIONS
"""Group of lines that point to no vanishing point."""

SEGMENTS = Check(
    "segments", "segments with a depth", "requirement", "Pair usable?",
    passes="{value} segments have a depth ({threshold} needed).",
    fails="No lines: {value} segments of the pair have a depth ({threshold} needed).",
)  # fmt: skip
DIRECTIONS = Check(
    "directions", "known vanishing directions in the image", "finding", "Rotation from directions?",
    passes="{value} known vanishing directions are in the image: they give the rotation ({threshold} suffice).",
    fails="{value} known vanishing directions are in the image ({threshold} give the whole rotation).",
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
    "segments": "Finds straight segments in the left image.",
    "directions": "Finds vanishing directions, and the rotation from those that are known.",
    "match": "Follows points along known lines, which elect the segment that is the same line.",
    "pose": "Finds the pose under which the 3-D ends lie on the observed lines.",
    "depth": "Finds segments in the right image: their disparities give depth.",
}


@dataclass(frozen=True)
class LinesConfig:
    """Settings of the lines method."""

    detector: Detector = "lsd"
    """lsd: line segment detector; hough: Canny's edges and Hough's transform."""
    max_segments: Annotated[int, Range(20, 2000)] = 400
    """The longest ones are used."""
    min_length: Annotated[float, Range(0.5, 20)] = 2.0
    """Least length of a segment [% of the image's width]."""
    manhattan: bool = False
    """Vanishing directions near right angles are taken as right angles."""
    min_inliers: Annotated[int, Range(4, 200)] = 10
    """With fewer lines that fit one pose the pair is lost."""
    min_share: Annotated[float, Range(0.05, 1)] = 0.35
    """With a smaller share of matched lines that fit the pose, it is doubtful."""
    min_views: Annotated[int, Range(2, 20)] = 3
    """Lines seen in this number of pairs are in the map."""
    max_lost_pairs: Annotated[int, Range(0, 50)] = 2
    """Pairs that may fail against the last located one before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> Lines:
        return Lines(rig, self)


@dataclass(frozen=True, eq=False)
class Seen:
    """The N segments of one image."""

    uv: NDArray[np.float32]
    """(N, 2, 2) [px]."""
    normalised: Observed
    found: Array
    """(D, 3) vanishing directions in the camera, of length 1."""
    points_to: NDArray[np.int64]
    """(N,) which one each segment points to, or -1."""


@dataclass(frozen=True, eq=False)
class SceneLines:
    """N lines as seen in the last located pair, with their places in the scene."""

    ids: NDArray[np.int64]
    uv: NDArray[np.float32]
    """(N, 2, 2) in the left image [px]."""
    xyz: Array
    """(N, 2, 3) both ends in the world."""
    sigma_px: Array
    """(N, 2) of the disparities at both ends."""
    views: NDArray[np.int64]
    """(N,) number of pairs that saw it."""
    group: NDArray[np.int64]
    """(N,) number of its direction in the world, or WITHOUT_DIRECTION."""

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, some: NDArray | slice) -> SceneLines:
        return SceneLines(*(getattr(self, f.name)[some] for f in fields(self)))

    def and_more(self, more: SceneLines) -> SceneLines:
        return SceneLines(*(np.concatenate([getattr(self, f.name), getattr(more, f.name)]) for f in fields(self)))


@dataclass(frozen=True, eq=False)
class Memory:
    """The last located pair with its lines, known directions, and the map of lines."""

    time_ns: int
    left: Image
    lines: SceneLines
    next_id: int
    world_from_left: Pose
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) twist per second on the right of the pose."""
    directions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(K, 3) unit vectors in the world."""
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(K,) pairs that each direction is the mean of."""
    mapped_ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(M,) ascending."""
    mapped: WorldLines = field(default_factory=WorldLines.empty)
    """M lines."""
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
        left, px = as_grey(frame.left), 1 / camera.fx
        uv = detect_segments(left, config.detector, config.min_length / 100 * camera.width, config.max_segments)
        normalised = Observed(camera.normalise(uv.reshape(-1, 2).astype(float)).reshape(-1, 2, 2))
        watch.lap("segments")
        seen = Seen(uv, normalised, *vanishing_directions(normalised, VANISHING_PX * px))
        if memory is None:
            watch.lap("directions")
            return self._begun(None, frame, left, seen, (), watch)

        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        predicted = memory.world_from_left @ Pose.exp(seconds * memory.velocity)
        rotation, same = rotation_from_directions(
            seen.found, memory.directions, predicted.rotation.T, SAME_DIRECTION_RAD
        )
        watch.lap("directions")

        lines = memory.lines
        ends = camera.project(predicted.inverse().apply(lines.xyz.reshape(-1, 3))).reshape(-1, 2, 2)
        match = match_segments(memory.left, left, lines.uv.astype(float), uv, ends)
        index = np.flatnonzero(match >= 0)
        watch.lap("match")

        moved = float(np.linalg.norm(predicted.translation - memory.world_from_left.translation))
        known = KnownLines(normalised[match[index]], lines.xyz[index], self._sigma(lines.sigma_px[index], moved))
        world = np.append(same, -1)[seen.points_to]
        towards = KnownDirections(
            normalised[world >= 0], memory.directions[world[world >= 0]], np.full((world >= 0).sum(), DIRECTION_PX * px)
        )
        guesses = [predicted.inverse(), Pose(rotation, -rotation @ predicted.translation)]
        pose, _ = refined_pose(known, towards, sampled_pose(known, guesses, INLIER), WIDTH)
        offset = np.abs(end_offsets(pose.rotation[None], pose.translation[None], known.seen.lines, known.xyz))[0]
        fits = (offset / known.sigma < INLIER).all(axis=1)
        decisions = (
            DIRECTIONS.of((same >= 0).sum(), 2),
            INLIERS.of(fits.sum(), config.min_inliers),
            SHARE.of(fits.mean() if len(fits) else 0.0, config.min_share),
        )
        watch.lap("pose")
        if not decisions[1].passed:
            if memory.lost_pairs < config.max_lost_pairs:
                return replace(memory, lost_pairs=memory.lost_pairs + 1), self._unused(memory, uv, decisions)
            return self._begun(memory, frame, left, seen, decisions, watch)

        located = pose.inverse()
        after = replace(
            memory, time_ns=frame.time_ns, left=left, world_from_left=located, lost_pairs=0,
            velocity=(memory.world_from_left.inverse() @ located).log() / seconds,
        )  # fmt: skip
        inliers = index[fits]
        kept = replace(lines[inliers], uv=uv[match[inliers]])
        after, segments = self._with_lines(after, frame, left, seen, kept, match[inliers])
        watch.lap("depth")
        residual = np.sqrt((np.minimum(offset, 1e3) ** 2).mean(axis=1)) * camera.fx
        tracks = _tracks(lines[index], uv[match[index]], fits, residual, after.lines)
        result = self._result(after, uv, tracks, (*decisions, segments))
        return after, replace(result, residuals_px=residual[fits])

    def _sigma(self, sigma_px: Array, moved: float) -> Array:
        """Returns the standard deviations (N, 2) of projected ends from observed lines, normalised.

        Errors of disparities shift the projection after a displacement as they do from left to right.
        """
        depth = sigma_px * min(moved / self.rig.baseline_m, MAX_BASELINES)
        return np.hypot(NOISE_PX, depth) / self.rig.camera("left").fx

    # Depth, and the map

    def _begun(
        self, memory: Memory | None, frame: Frame, left: Image, seen: Seen, decisions: tuple[Decision, ...],
        watch: Stopwatch,
    ) -> tuple[Memory | None, Result]:  # fmt: skip
        """Begins at a pair: the first one, or after a loss at the last known pose."""
        none = SceneLines(
            np.zeros(0, np.int64), np.zeros((0, 2, 2), np.float32), np.zeros((0, 2, 3)), np.zeros((0, 2)),
            np.zeros(0, np.int64), np.zeros(0, np.int64),
        )  # fmt: skip
        after = Memory(frame.time_ns, left, none, 0, self.rig.rig_from_left)
        if memory is not None:
            after = replace(
                memory, time_ns=frame.time_ns, left=left, lines=none, velocity=np.zeros(6), lost_pairs=0,
                directions=np.zeros((0, 3)), counts=np.zeros(0, np.int64),
            )  # fmt: skip
        after, segments = self._with_lines(after, frame, left, seen, none, np.zeros(0, np.int64))
        watch.lap("depth")
        if not segments.passed:
            return memory, self._unused(memory, seen.uv, (*decisions, segments))
        tracks = _tracks(none, seen.uv[:0], np.zeros(0, bool), np.zeros(0), after.lines)
        result = self._result(after, seen.uv, tracks, (*decisions, segments))
        return after, replace(result, restarted=memory is not None)

    def _with_lines(
        self, memory: Memory, frame: Frame, left: Image, seen: Seen, kept: SceneLines, of_kept: NDArray[np.int64]
    ) -> tuple[Memory, Decision]:
        """Step 5: returns the memory with the known lines, now the segments `of_kept`, and new ones of the pair."""
        memory, world = self._with_directions(memory, seen)
        group = np.where(world >= 0, world, WITHOUT_DIRECTION)
        disparity, sigma = disparity_along(left, as_grey(frame.right), seen.uv)
        good = np.all((disparity > MIN_DISPARITY_PX) & (sigma < MAX_DISPARITY_SIGMA_PX), axis=1)
        kept = self._fused(memory.world_from_left, kept, disparity[of_kept], sigma[of_kept], good[of_kept])
        kept = replace(kept, views=kept.views + 1, group=group[of_kept])
        good[of_kept] = False
        count = int(good.sum())
        new = SceneLines(
            memory.next_id + np.arange(count), seen.uv[good],
            self._xyz(memory.world_from_left, seen.uv[good], disparity[good]), sigma[good],
            np.ones(count, np.int64), group[good],
        )  # fmt: skip
        lines = kept.and_more(new)
        ids, mapped = _mapped(memory, lines[lines.views >= self.config.min_views])
        memory = replace(memory, lines=lines, next_id=memory.next_id + count, mapped_ids=ids, mapped=mapped)
        return memory, SEGMENTS.of(len(lines), self.config.min_inliers)

    def _xyz(self, world_from_left: Pose, uv: NDArray[np.float32], disparity: Array) -> Array:
        flat = points_from_disparity(
            self.rig.camera("left"), self.rig.baseline_m, uv.reshape(-1, 2).astype(float), disparity.ravel()
        )
        return world_from_left.apply(flat).reshape(-1, 2, 3)

    def _fused(
        self, pose: Pose, kept: SceneLines, disparity: Array, sigma: Array, good: NDArray[np.bool_]
    ) -> SceneLines:
        """Returns known lines with the ends of this pair's segments: their disparities are the weighted means of what
        was known and of what this pair shows."""
        camera = self.rig.camera("left")
        strength = camera.fx * self.rig.baseline_m
        before = strength / depths_on_lines(camera.normalise(kept.uv.reshape(-1, 2)), pose.inverse().apply(kept.xyz))
        usable = (before > MIN_DISPARITY_PX).all(axis=1)
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

    def _with_directions(self, memory: Memory, seen: Seen) -> tuple[Memory, NDArray[np.int64]]:
        """Returns the memory with the vanishing directions of the pair, and the number of that of each segment or -1.

        A known direction is the mean of the first MAX_COUNT pairs that saw it, so that errors of the pose do not
        accumulate in it.
        """
        rotation = memory.world_from_left.rotation
        _, same = rotation_from_directions(seen.found, memory.directions, rotation.T, SAME_DIRECTION_RAD)
        directions, counts = memory.directions.copy(), memory.counts.copy()
        for n, v in enumerate(seen.found @ rotation.T):
            k = same[n]
            if k >= 0 and counts[k] < MAX_COUNT:
                mean = counts[k] * directions[k] + np.sign(directions[k] @ v) * v
                directions[k], counts[k] = mean / np.linalg.norm(mean), counts[k] + 1
            elif k < 0 and len(directions) < MAX_DIRECTIONS:
                same[n] = len(directions)
                directions, counts = np.vstack([directions, v]), np.append(counts, 1)
        if self.config.manhattan:
            directions = squared(directions, RIGHT_ANGLE_RAD)
        return replace(memory, directions=directions, counts=counts), np.append(same, -1)[seen.points_to]

    # What is drawn

    def _unused(self, memory: Memory | None, uv: NDArray[np.float32], decisions: tuple[Decision, ...]) -> Result:
        """Returns the result without a pose: none of the segments is used."""
        mapped = WorldLines.empty() if memory is None else memory.mapped
        return Result(decisions=decisions, lines={"left": ImageLines.of(uv, -1)}, world_lines=mapped)

    def _result(
        self, memory: Memory, uv: NDArray[np.float32], tracks: Tracks, decisions: tuple[Decision, ...]
    ) -> Result:
        """Segments of the image with the colours of their directions; those that are not used, too."""
        lines = memory.lines
        used = np.equal(uv[:, None], lines.uv[None]).all(axis=(2, 3))
        group = np.where(used.any(axis=1), lines.group[used.argmax(axis=1)] if len(lines) else -1, -1)
        return Result(
            memory.world_from_left @ self.rig.rig_from_left.inverse(),
            decisions,
            {"left": tracks},
            key_frame=True,
            lines={"left": ImageLines.of(uv, group)},
            world_lines=memory.mapped,
        )


def _tracks(
    old: SceneLines, now: NDArray[np.float32], fits: NDArray[np.bool_], residual: Array, lines: SceneLines
) -> Tracks:
    """Returns the middles of matched segments, those that do not fit the pose as ended, and of new ones."""
    new = lines[lines.views == 1]
    status = np.where(fits, TrackStatus.ALIVE, TrackStatus.RIGID)
    gap = np.full(len(new), np.nan)
    return Tracks.of(
        np.concatenate([old.ids, new.ids]),
        np.concatenate([now.mean(axis=1), new.uv.mean(axis=1)]),
        uv_prev=np.concatenate([old.uv.mean(axis=1), np.column_stack([gap, gap])]),
        status=np.concatenate([status, np.full(len(new), TrackStatus.NEW)]),
        residual_px=np.concatenate([residual, gap]),
    )


def _mapped(memory: Memory, lines: SceneLines) -> tuple[NDArray[np.int64], WorldLines]:
    """Returns the map with the latest places of these lines; the oldest lines go where there are too many."""
    stay = ~np.isin(memory.mapped_ids, lines.ids)
    ids = np.concatenate([memory.mapped_ids[stay], lines.ids])
    xyz = np.concatenate([memory.mapped.xyz_in_world[stay], lines.xyz])
    group = np.concatenate([memory.mapped.group[stay], lines.group])
    order = np.argsort(ids, kind="stable")[-MAX_MAPPED:]
    return ids[order], WorldLines(xyz[order], group[order])


METHOD = Method(
    "lines", STEREO, LinesConfig, "metric", "Taylor and Kriegman 1995; Grompone von Gioi et al. 2010 (LSD)",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: lines",
)  # fmt: skip
