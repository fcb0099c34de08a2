"""Motion of one camera from straight lines in three and more views; the unit is its own.

Spetsakis and Aloimonos, Structure from motion using line correspondences, IJCV 1990; Taylor and Kriegman, Structure and
motion from line segments in multiple images, PAMI 1995; segments and matches as in `lines`.

The steps, in the order of this file:

1. Segments are found, and matched with those of the last frame (see `lines`). Two vanishing directions that are known
   give the rotation.
2. Start: two views of lines say nothing about the motion. From three views, with rotations by vanishing directions,
   each line gives one linear equation in the displacements. RANSAC over lines, then the adjustment of all.
3. Afterwards the pose of each frame is fitted to the lines whose places are known, and to the directions.
4. A frame becomes a key view where lines have moved enough across themselves. Lines that three key views saw get a
   place, and the poses and lines of the last `window` key views are adjusted together.

Limits. It starts only where two vanishing directions are seen, by enough lines, in three views with parallax: a room
or a street, not a meadow. Lines along the motion say nothing. Where most lines lie on one far wall, only the vanishing
directions tell a rotation from a displacement sideways, and those of small images are off by half a degree: in a
rendered room of 320 x 240 pixels the error is 4 % of the path. The unit drifts, and a new segment has its own.

Measured: sim:indoor, the first 80 video frames: directions of three views within a degree at the start, then the unit
stays within 4 % and the direction of displacement within 1 degree (median). A real office (head-high camera, blur,
turns, nominal calibration): 115 of 194 frames have a pose, in seven segments. Their units differ by far, so that they
are no common path, and where fewer than two vanishing directions are seen, no segment begins.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ispom.estimator import VIDEO, Method
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
from ispom.features.segments import match_segments
from ispom.geometry import Array, Pose
from ispom.settings import Range, WorthTrying, checked
from ispom.solvers.line_adjustment import LineViews, adjusted, displacements, line_residuals
from ispom.solvers.lines import (
    KnownDirections,
    KnownLines,
    Observed,
    depths_on_lines,
    end_offsets,
    nearest_on_lines,
    refined_pose,
    sampled_pose,
)
from ispom.stopwatch import Stopwatch
from ispom.types import Check, Decision, Frame, Image, ImageLines, Rig, Tracks, WorldLines, as_grey, by_key

INLIER, WIDTH = 4.0, 2.0
"""An end is an inlier within this number of standard deviations; and width of the loss, in standard deviations."""
FIRST_WIDTH = 10.0
"""Width of the loss of the first adjustment: its start is coarse."""
DEPTH_FACTOR = 2.0
"""Standard deviation of a projected end over that of an observed one: places of lines are not exact, either."""
NORMAL_PX = 2.0
"""Largest error of the middle of a segment in the linear equations of three views; rotations are not exact."""
MIN_PARALLAX_PX = 2.5
"""Least displacement of a line across itself, without that by the rotation, for its place to be known."""
MIN_FIT = 0.35
"""Share of the lines of three views that must fit one motion."""
MAX_MISSED = 4
"""Number of frames without its segment after which a line is discarded."""
EARLY_SHARE = 0.4
"""Share of the setting `key_share` before the start."""
FIXED = 2
"""Key views that an adjustment leaves where they are: they hold the unit."""

LINES = Check(
    "lines", "segments in the image", "requirement", "Frame usable?",
    passes="{value} segments are in the image ({threshold} needed).",
    fails="No lines: {value} segments are in the image ({threshold} needed).",
)  # fmt: skip
START = Check(
    "start_lines", "lines of three views that fit one motion", "requirement", "First lines placed?", topic="map",
    passes="Started: {value} lines of three views fit one motion ({threshold} needed).",
    fails="Not started: {value} lines of three views fit one motion ({threshold} needed).",
)  # fmt: skip
INLIERS = Check(
    "line_inliers", "lines that fit the pose", "requirement", "Frame located?", topic="pose",
    passes="Located: {value} lines fit one pose ({threshold} needed).",
    fails="Lost: {value} lines fit one pose ({threshold} needed).",
)  # fmt: skip
MOVED = Check(
    "lines_moved", "median displacement of lines across themselves", "trigger", "Key view?", unit="% of the width",
    passes="Key view: lines moved by {value:.2f} % of the width across themselves (limit {threshold} %).",
    fails="Lines moved by {value:.2f} % of the width across themselves: no key view (limit {threshold} %).",
)  # fmt: skip
FEW = Check(
    "few_lines", "share of the last key view's lines", "trigger", "Key view?", relation="<",
    passes="Key view: {value:.0%} of the lines of the last one are still seen (limit {threshold:.0%}).",
    fails="{value:.0%} of the lines of the last key view are still seen: no new one (limit {threshold:.0%}).",
)  # fmt: skip
CHECKS = by_key(LINES, DIRECTIONS, START, INLIERS, MOVED, FEW)
STAGES = {
    "segments": "Finds straight segments, and their vanishing directions.",
    "match": "Follows points along known lines, which elect the segment that is the same line.",
    "pose": "Takes the rotation from known directions, and the pose from the lines whose places are known.",
    "adjust": "Places new lines, and adjusts the last key views and their lines together.",
}


@dataclass(frozen=True)
class LinesMonocularConfig(SegmentSettings):
    """Settings of lines.monocular."""

    min_length: Annotated[float, Range(0.5, 20), WorthTrying((0.5,))] = 3.0
    """Least length of a segment [% of the image's width]."""
    min_inliers: Annotated[int, Range(6, 200)] = 12
    """Least number of lines that fit one pose; with fewer the frame is lost. A start needs as many."""
    key_moved: Annotated[float, Range(0.1, 10), WorthTrying((0.5,))] = 1.0
    """Lines that moved by more than this across themselves make a key view [% of the image's width]."""
    key_share: Annotated[float, Range(0.1, 1)] = 0.6
    """Share of the last key view's lines below which the frame becomes a key view."""
    window: Annotated[int, Range(3, 20), WorthTrying((2,))] = 7
    """Key views that are adjusted together."""
    max_lost_frames: Annotated[int, Range(0, 100)] = 5
    """Frames that may fail before a new segment starts from the last pose."""

    def build(self, rig: Rig) -> LinesMonocular:
        return LinesMonocular(rig, checked(self))


@dataclass(frozen=True, eq=False)
class View:
    """A key view and the N lines that it saw."""

    pose: Pose
    """camera_from_world."""
    ids: NDArray[np.int64]
    """(N,) ascending."""
    x: Array
    """(N, 2, 2) both ends, normalised."""
    towards: KnownDirections
    """Segments whose direction is known."""

    def of(self, ids: NDArray[np.int64]) -> tuple[NDArray[np.bool_], Array]:
        """Returns which of these lines it saw (M,), and their ends (M, 2, 2), of the others anything."""
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        return self.ids[at] == ids, self.x[at]


@dataclass(frozen=True, eq=False)
class Memory:
    """The last located frame, key views, and the map of lines."""

    time_ns: int
    grey: Image
    pose: Pose
    """camera_from_world of that frame; before the start with its rotation only."""
    lines: SceneLines
    """Seen in it."""
    waiting: SceneLines
    """Lines that were not found in that frame, though their points were followed."""
    next_id: int
    views: tuple[View, ...]
    map: LineMap
    velocity: Array = field(default_factory=lambda: np.zeros(6))
    """(6,) twist per second on the right of world_from_camera."""
    started: bool = False
    again: bool = False
    """The method was lost before this segment."""
    lost_frames: int = 0


@dataclass(frozen=True, eq=False)
class LinesMonocular(OneKind["Memory | None"]):
    """Gives each frame after the start a pose in a unit of its own. World: the camera at the first key view."""

    rig: Rig
    config: LinesMonocularConfig
    kind = "video"
    frame = "video"

    def begin(self) -> Memory | None:
        return None

    def process(self, memory: Memory | None, frame: Frame, watch: Stopwatch) -> tuple[Memory | None, Result]:
        """See OneKind: one frame."""
        config, camera = self.config, self.rig.camera("video")
        grey = as_grey(frame.image)
        seen = Seen.of(grey, camera, config.detector, config.min_length / 100 * camera.width, config.max_segments)
        watch.lap("segments")
        if memory is None:
            return self._begun(None, frame, grey, seen, ())

        # Step 1
        seconds = (frame.time_ns - memory.time_ns) * 1e-9
        predicted = Pose.exp(-seconds * memory.velocity) @ memory.pose
        before = memory.lines.and_more(memory.waiting)
        ends = self._ends(before, memory.pose, predicted)
        match, followed = match_segments(memory.grey, grey, before.uv.astype(float), seen.uv, ends)
        index = np.flatnonzero(match >= 0)
        lines, of_lines = replace(before[index], uv=seen.uv[match[index]], missed=0 * index), match[index]
        watch.lap("match")
        rotation, same = memory.map.rotation(seen, predicted.rotation)
        directions = DIRECTIONS.of((same >= 0).sum(), 2)
        if not memory.started:
            pose, fits = Pose(rotation, memory.pose.translation), np.ones(len(lines), bool)
            residual, decisions = np.full(len(lines), np.nan), (directions,)
        else:
            pose, fits, residual, located = self._located(memory, seen, lines, of_lines, predicted, rotation, same)
            decisions = (directions, located)
        watch.lap("pose")
        if len(lines) < config.min_inliers or (memory.started and not decisions[-1].passed):
            if memory.started and memory.lost_frames < config.max_lost_frames:
                return replace(memory, lost_frames=memory.lost_frames + 1), self._unused(memory, seen, decisions)
            return self._begun(memory, frame, grey, seen, decisions)

        lines, of_lines = replace(lines[fits], views=lines.views[fits] + 1), of_lines[fits]
        lines = self._at_segments(lines, pose)
        world_from_camera, world_from_last = pose.inverse(), memory.pose.inverse()
        missed = (match < 0) & np.isfinite(followed).all(axis=(1, 2)) & (before.missed < MAX_MISSED)
        waiting = before[missed]
        waiting = replace(waiting, uv=followed[missed].astype(np.float32), missed=waiting.missed + 1)
        after = replace(
            memory, time_ns=frame.time_ns, grey=grey, pose=pose, lines=lines, waiting=waiting, lost_frames=0,
            velocity=(world_from_last.inverse() @ world_from_camera).log() / seconds,
        )  # fmt: skip
        after, more, is_key = self._key_view(after, seen, of_lines)
        watch.lap("adjust")
        tracks = middles(before[index], seen.uv[match[index]], fits, residual, after.lines[len(lines) :])
        result = replace(
            self._result(after, seen, tracks, (*decisions, *more)), key_frame=is_key and after.started,
            restarted=after.started and not memory.started and memory.again,
            residuals_px=residual[fits & np.isfinite(residual)],
        )  # fmt: skip
        return after, result

    def _ends(self, lines: SceneLines, last: Pose, predicted: Pose) -> Array:
        """Returns where the ends (N, 2, 2) of lines are expected: without a place, where the rotation moves them."""
        camera, turn = self.rig.camera("video"), predicted.rotation @ last.rotation.T
        rays = camera.unproject(lines.uv.reshape(-1, 2))[0] @ turn.T
        placed = predicted.apply(lines.xyz.reshape(-1, 3))
        return camera.project(np.where(np.isfinite(placed), placed, rays)).reshape(-1, 2, 2)

    # Step 3: the pose by lines whose places are known

    def _located(
        self, memory: Memory, seen: Seen, lines: SceneLines, of_lines: NDArray[np.int64], predicted: Pose,
        rotation: Array, same: NDArray[np.int64],
    ) -> tuple[Pose, NDArray[np.bool_], Array, Decision]:  # fmt: skip
        """Returns camera_from_world, which lines stay (N,), and their residuals (N,) [px], NaN without a place."""
        px = 1 / self.rig.camera("video").fx
        placed = np.flatnonzero(np.isfinite(lines.xyz[:, 0, 0]))
        sigma = np.full((len(placed), 2), DEPTH_FACTOR * NOISE_PX * px)
        known = KnownLines(seen.normalised[of_lines[placed]], lines.xyz[placed], sigma)
        centre = predicted.inverse().translation
        guesses = [predicted, Pose(rotation, -rotation @ centre), Pose(predicted.rotation, memory.pose.translation)]
        towards = memory.map.pointing(seen, same, px)
        pose, _ = refined_pose(known, towards, sampled_pose(known, guesses, INLIER), WIDTH)
        offset = np.abs(end_offsets(pose.rotation[None], pose.translation[None], known.seen.lines, known.xyz))[0]
        fits, residual = np.ones(len(lines), bool), np.full(len(lines), np.nan)
        fits[placed] = (offset / sigma < INLIER).all(axis=1)
        residual[placed] = np.sqrt((np.minimum(offset, 1e3) ** 2).mean(axis=1)) / px
        return pose, fits, residual, INLIERS.of(fits[placed].sum(), self.config.min_inliers)

    # Steps 2 and 4: key views

    def _begun(
        self, memory: Memory | None, frame: Frame, grey: Image, seen: Seen, decisions: tuple[Decision, ...]
    ) -> tuple[Memory | None, Result]:
        """Begins a segment with the first key view: at the first frame, or after a loss at the last known pose."""
        enough = LINES.of(len(seen.uv), self.config.min_inliers)
        if not enough.passed:
            return memory, self._unused(memory, seen, (*decisions, enough))
        after = Memory(frame.time_ns, grey, Pose(), SceneLines.empty(), SceneLines.empty(), 0, (), LineMap())
        if memory is not None:
            after = replace(
                after, pose=memory.pose, next_id=memory.next_id, map=memory.map.without_directions(),
                again=memory.again or memory.started,
            )  # fmt: skip
        after = self._with_view(after, seen, np.zeros(0, np.int64))
        none = SceneLines.empty()
        tracks = middles(none, none.uv, np.zeros(0, bool), np.zeros(0), after.lines)
        return after, self._result(after, seen, tracks, (*decisions, enough))

    def _key_view(
        self, memory: Memory, seen: Seen, of_lines: NDArray[np.int64]
    ) -> tuple[Memory, tuple[Decision, ...], bool]:
        """Returns the memory after the frame, which becomes a key view where lines moved, or are few."""
        config, last = self.config, memory.views[-1]
        shared, x = last.of(memory.lines.ids)
        now = seen.normalised[of_lines]
        moved = _parallax(last.pose.rotation, x[shared], memory.pose.rotation, now[shared])
        width = self.rig.camera("video").width / self.rig.camera("video").fx
        # Before the start, parallax matters more than many lines.
        share = config.key_share * (1.0 if memory.started else EARLY_SHARE)
        triggers = (
            MOVED.of(100 * float(np.median(moved)) / width if len(moved) else 0.0, config.key_moved),
            FEW.of(shared.sum() / len(last.ids), share),
        )
        if not any(trigger.passed for trigger in triggers):
            return memory, triggers, False
        memory = self._with_view(memory, seen, of_lines)
        if memory.started:
            return self._adjusted(memory), triggers, True
        if len(memory.views) < 3:
            return memory, triggers, True
        memory, start = self._started(memory)
        return memory, (*triggers, start), True

    def _with_view(self, memory: Memory, seen: Seen, of_lines: NDArray[np.int64]) -> Memory:
        """Returns the memory with the frame as a key view: known lines are the segments `of_lines`, others are new."""
        line_map, group = memory.map.with_directions(seen, memory.pose.inverse(), self.config.manhattan)
        new = np.setdiff1d(np.arange(len(seen.uv)), of_lines)
        lines = replace(memory.lines, group=group[of_lines])
        lines = lines.and_more(SceneLines.new(memory.next_id, seen.uv[new], group[new]))
        x = seen.normalised.x[np.concatenate([of_lines, new])]
        order = np.argsort(lines.ids)
        _, same = line_map.rotation(seen, memory.pose.rotation)
        towards = line_map.pointing(seen, same, 1 / self.rig.camera("video").fx)
        view = View(memory.pose, lines.ids[order], x[order], towards)
        views = (*memory.views, view)[-self.config.window :]
        return replace(memory, map=line_map, lines=lines, views=views, next_id=memory.next_id + len(new))

    def _started(self, memory: Memory) -> tuple[Memory, Decision]:
        """Step 2: returns the memory with poses of three key views and places of their lines, or without the first."""
        views, ids, need = memory.views[-3:], memory.lines.ids, self.config.min_inliers
        saw = np.all([view.of(ids)[0] for view in views], axis=0)
        ids = ids[saw]
        failed = replace(memory, views=memory.views[1:])
        pointing = memory.lines.group[saw] < len(memory.map.directions)
        if pointing.sum() < need or len(np.unique(memory.lines.group[saw][pointing])) < 2:
            return failed, START.of(0, need)
        seen = [Observed(view.of(ids)[1]) for view in views]
        first, px = views[0].pose, 1 / self.rig.camera("video").fx
        rotations = np.stack([view.pose.rotation @ first.rotation.T for view in views])
        along = memory.map.directions[memory.lines.group[saw][pointing]] @ first.rotation.T
        middles = np.stack([Observed(s.x[pointing]).middles @ r for s, r in zip(seen, rotations, strict=True)])
        normals = np.cross(middles, along)
        size = np.linalg.norm(normals, axis=2, keepdims=True)
        centres, fits = displacements(normals / np.maximum(size, 1e-9), NORMAL_PX * px)
        if fits.sum() < need:
            return failed, START.of(fits.sum(), need)
        sigma, towards = NOISE_PX * px, [view.towards for view in views]
        trials = list[tuple[int, LineViews, NDArray[np.intp], NDArray[np.bool_]]]()
        for sign in (1.0, -1.0):
            poses = [Pose(r, -r @ c) for r, c in zip(rotations, (np.zeros(3), *(sign * centres)), strict=True)]
            rho = _inverse_depths(poses[2] @ poses[0].inverse(), seen[0].x, seen[2])
            some = np.flatnonzero((rho > 0).all(axis=1))
            count = len(some)
            if count < need:
                continue
            start = LineViews(
                tuple(pose @ first for pose in poses), np.zeros(count, np.int64), seen[0].x[some], rho[some],
                np.tile(np.arange(count), 2), np.repeat((1, 2), count), np.concatenate([s.x[some] for s in seen[1:]]),
            )  # fmt: skip
            found = adjusted(adjusted(start, towards, sigma, FIRST_WIDTH, 1), towards, sigma, WIDTH, 1)
            trials.append((int(self._good(found).sum()), found, some, self._good(found)))
        if not trials:
            return failed, START.of(0, need)
        _, found, some, good = max(trials, key=lambda trial: trial[0])
        moved = _parallax(views[0].pose.rotation, found.x, found.poses[2].rotation, seen[2][some])
        good &= moved > MIN_PARALLAX_PX * px
        decision = START.of(good.sum(), max(need, round(MIN_FIT * len(ids))))
        if not decision.passed:
            return failed, decision
        placed = tuple(replace(view, pose=pose) for view, pose in zip(views, found.poses, strict=True))
        memory = replace(memory, views=placed, pose=placed[-1].pose, started=True, velocity=np.zeros(6))
        return self._placed(memory, ids[some][good], found.xyz[good], ids[:0]), decision

    def _adjusted(self, memory: Memory) -> Memory:
        """Step 4: returns the memory with new lines placed, and the key views of the window adjusted."""
        px, views = 1 / self.rig.camera("video").fx, memory.views
        ids, counts = np.unique(np.concatenate([view.ids for view in views]), return_counts=True)
        ids = ids[counts >= 3]
        saw, ends = (np.stack(part) for part in zip(*(view.of(ids) for view in views), strict=True))
        first, last, rows = saw.argmax(axis=0), len(views) - 1 - saw[::-1].argmax(axis=0), np.arange(len(ids))
        x, known = ends[first, rows], memory.map.of(ids)[0]
        rho = np.full((len(ids), 2), np.nan)
        for i, j in {*zip(first.tolist(), last.tolist(), strict=True)}:
            mine = np.flatnonzero((first == i) & (last == j))
            seen = Observed(ends[j, mine])
            moved = _parallax(views[i].pose.rotation, x[mine], views[j].pose.rotation, seen)
            new = _inverse_depths(views[j].pose @ views[i].pose.inverse(), x[mine], seen)
            rho[mine] = np.where((moved > MIN_PARALLAX_PX * px)[:, None], new, np.nan)
            # What is known already is a better start, where it is before the camera.
            again = 1 / depths_on_lines(x[mine].reshape(-1, 2), views[i].pose.apply(known[mine]))
            rho[mine] = np.where(np.all(again > 0, axis=1, keepdims=True), again, rho[mine])
        some = np.flatnonzero((rho > 0).all(axis=1))
        if len(some) < self.config.min_inliers:
            return memory
        ids, first, saw, ends = ids[some], first[some], saw[:, some], ends[:, some]
        view, line = np.nonzero(saw & (np.arange(len(views))[:, None] != first))
        poses = tuple(v.pose for v in views)
        start = LineViews(poses, first, x[some], rho[some], line, view, ends[view, line])
        found = adjusted(start, [v.towards for v in views], NOISE_PX * px, WIDTH, min(FIXED, len(views) - 1))
        good = self._good(found)
        placed = tuple(replace(v, pose=pose) for v, pose in zip(views, found.poses, strict=True))
        memory = replace(memory, views=placed, pose=placed[-1].pose)
        return self._placed(memory, ids[good], found.xyz[good], ids[~good])

    def _good(self, found: LineViews) -> NDArray[np.bool_]:
        """Returns which lines (N,) lie before their first view, and fit all observations."""
        worst = np.zeros(len(found.rho))
        np.maximum.at(worst, found.line, np.abs(line_residuals(found)).max(axis=1))
        limit = INLIER * NOISE_PX / self.rig.camera("video").fx
        return np.all(found.rho > 0.0, axis=1) & (worst < limit)

    def _placed(self, memory: Memory, ids: NDArray[np.int64], xyz: Array, bad: NDArray[np.int64]) -> Memory:
        """Returns the memory with the places (N, 2, 3) of lines, and without those of `bad` ones."""
        line_map, now = memory.map.without(bad), memory.lines
        group = line_map.of(ids)[1]
        _, here, there = np.intersect1d(ids, now.ids, return_indices=True)
        group[here] = now.group[there]
        line_map = line_map.with_lines(ids, xyz, group)
        lines = self._at_segments(replace(now, xyz=line_map.of(now.ids)[0]), memory.pose)
        waiting = replace(memory.waiting, xyz=line_map.of(memory.waiting.ids)[0])
        return replace(memory, lines=lines, waiting=waiting, map=line_map)

    def _at_segments(self, lines: SceneLines, pose: Pose) -> SceneLines:
        """Returns the lines with those of their points as ends that are nearest to the ends of their segments."""
        x = self.rig.camera("video").normalise(lines.uv.reshape(-1, 2).astype(float))
        ends = nearest_on_lines(x, pose.apply(lines.xyz))
        valid = np.all(ends[..., 2] > 0, axis=1, keepdims=True)[..., None]
        return replace(lines, xyz=np.where(valid, pose.inverse().apply(ends), lines.xyz))

    # What is drawn

    def _unused(self, memory: Memory | None, seen: Seen, decisions: tuple[Decision, ...]) -> Result:
        """Returns the result without a pose: none of the segments is used."""
        mapped = WorldLines.empty() if memory is None else memory.map.lines
        return Result(decisions=decisions, lines={"video": ImageLines.of(seen.uv, -1)}, world_lines=mapped)

    def _result(self, memory: Memory, seen: Seen, tracks: Tracks, decisions: tuple[Decision, ...]) -> Result:
        return Result(
            memory.pose.inverse() if memory.started else None,
            decisions,
            {"video": tracks},
            lines={"video": drawn(seen.uv, memory.lines)},
            world_lines=memory.map.lines,
        )


def _parallax(before: Array, x: Array, now: Array, seen: Observed) -> Array:
    """Returns how far (N,) lines moved across themselves besides the rotation, normalised: the ends (N, 2, 2) of a view
    with camera_from_world rotation `before`, turned into that of `now`, from the observed lines."""
    rays = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=2) @ (now @ before.T).T
    offset = np.einsum("ni,nei->ne", seen.lines, rays) / np.maximum(rays[..., 2], 0.1)
    return np.abs(offset).max(axis=1)


def _inverse_depths(now_from_first: Pose, x: Array, seen: Observed) -> Array:
    """Returns the inverse depths (N, 2) of ends (N, 2, 2) of the first view where the planes of the second cut them."""
    rays = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=2) @ now_from_first.rotation.T
    below = seen.normals @ now_from_first.translation
    return -np.einsum("ni,nei->ne", seen.normals, rays) / np.where(np.abs(below) > 1e-9, below, 1e-9)[:, None]


METHOD = Method(
    "lines.monocular", VIDEO, LinesMonocularConfig, "own",
    "Spetsakis and Aloimonos 1990; Taylor and Kriegman 1995; Grompone von Gioi et al. 2010 (LSD)",
    checks=CHECKS, stages=STAGES, survey="Table 3, one camera: lines",
)  # fmt: skip
