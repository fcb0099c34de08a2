"""What a method did right at each stage, by the exact truth of a simulation: depth of every pixel, and poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.evaluation.trajectory_error import MIN_POSES, aligned, alignment, associate, ate_m
from ispom.geometry import Array, Pose
from ispom.sequences import open_sequence
from ispom.sequences.formats.simulated import rendered_source
from ispom.simulation.rendering.cache import NOWHERE
from ispom.simulation.truth import Truth
from ispom.types import FrameName, Step, TrackStatus, Trajectory

from .process import Failure, Limits, SubmissionProcess

WRONG_PX = 2.0
"""A track farther than this from where its point is seen follows another point."""
APART_NS = 330_000_000
"""Interval between two views: 10 video frames."""
MOVED_PX = 2 * WRONG_PX
"""A track shows that it follows something when its point is seen so far from where the track began: what stands still
in the image is right for as long as nothing moves."""
LONG = 3
"""Frames that a track must be seen in, to show the same."""
PROVEN_SHARE = 0.4
"""Of all observations (but those of tracks too young to tell), at least this share must be of tracks that show that
they follow something; with less, the others are guesses. KLT has 0.85 and more, matched descriptors have 0.55."""
PROVEN_TRACKS = 20
"""Least number of right tracks in a frame, at different positions: with fewer nothing can be estimated well."""
LANDMARKS = 10
"""Least number of landmarks in a frame from whose depth and reprojection error a map can be judged."""
CELL_PX = 4.0
"""Tracks, or landmarks, in one cell of this size of the image count once."""
LOCATED_SHARE = 0.5
"""The trajectory has at least this share of the frames, or its error is of a part that was chosen."""
NOISE_PX = 1e-3
"""No corner is located better than this. An image has whole grey levels, an error of 0.29; by the bound of Cramer and
Rao a window of 21 x 21 pixels with gradients of 15 levels per pixel then has an error of 0.29 / (15 * 21) px."""
NOISE_TRACKS = 1000
"""Tracks whose errors a pose may average."""
SMOOTH = 0.05
"""Depths of the four pixels around a point differ by less than this share, or it lies on an edge and is not used."""


@dataclass(frozen=True)
class Measured:
    """The values of one run by name, and the frame at which each was worst; a value that is missing is None."""

    seed: int
    values: Mapping[str, float | None]
    worst: Mapping[str, int] = field(default_factory=dict)
    """Frame, counted from 0 as on the page."""
    failure: str | None = None
    """One sentence, where the method did not come to its end."""
    too_good: Mapping[str, float] = field(default_factory=dict)
    """By name, the least value that the noise of images allows, where the value is smaller."""


def measured(package: str, name: str, source: str, seed: int, max_exposures: int | None, limits: Limits) -> Measured:
    """Runs a method on a simulation, in a process of its own that gets images, times and calibration only. What goes
    wrong with the method is in the result. Raises InputError for a wrong source or package, and where the method needs
    other sensors."""
    rendered = rendered_source(source, seed)
    if rendered is None:
        raise InputError(f"--source {source} is no simulation: give such as sim:tiny")
    if rendered.rolling_ns or rendered.fisheye:
        raise InputError(f"--source {source} has a rolling shutter or fisheyes: give one without")
    sequence = open_sequence(source, seed=seed, max_exposures=max_exposures, cache_dir=NOWHERE)
    frames, frame_now = {"rig", *sequence.rig.sensors}, None
    try:
        with SubmissionProcess(package, (name,), limits) as submission:
            metric = submission.methods[name].unit == "metric"
            views = Views(Truth(rendered), sequence.rig.rig_from, metric)
            submission.start(name, sequence.rig)
            for i in range(len(sequence)):
                frame_now, measurement = i, sequence[i]
                for step in submission.step(measurement):
                    if step.frame not in frames or any(camera not in frames for camera in step.tracks):
                        raise Failure("gives a pose or tracks of an unknown sensor")
                    views.add(i, step)
            frame_now = None
            trajectory = submission.finish()
            if trajectory.frame not in frames:
                raise Failure("gives a trajectory of an unknown sensor")
        assert sequence.truth is not None
        frame = trajectory.frame
        reference = sequence.truth.moved(right=sequence.rig.rig_from(frame), frame=frame)
        values, worst = views.values(trajectory, reference)
        return Measured(seed, values, worst, too_good=views.too_good(values))
    except Failure as fault:
        place = "" if frame_now is None else f" at frame {frame_now}"
        return Measured(seed, {}, failure=f"it {fault}{place}")


class Views:
    """Compares Steps with the truth of their frames, one after the other."""

    def __init__(self, truth: Truth, rig_from: Callable[[FrameName], Pose], metric: bool) -> None:
        """`rig_from` are the poses of the sensors; a method that is not `metric` cannot apply their distances."""
        self.truth, self.rig_from, self.metric = truth, rig_from, metric
        self.frames: list[int] = []
        self._anchors: dict[int, Array] = {}
        """Point of the world that a track showed where it began, by id."""
        self._landmarks: dict[int, Array] = {}
        """Point of the method's world by id."""
        self._alive: list[int] = []
        """Tracks that are right in a frame and were right before, once per cell; all of them in the first frame."""
        self._errors_px: list[float] = []
        """Median distance of tracks from where their points are seen, per frame."""
        self._seen: dict[int, int] = {}
        """Frames in which a track was seen, by id."""
        self._born: dict[int, int] = {}
        """Number of the Step in which it began."""
        self._proven: set[int] = set()
        """Tracks that were right where their point had moved."""
        self._began: dict[int, Array] = {}
        """Where a track began [px]."""
        self._wrong: list[float] = []
        self._mapped: list[int] = []
        self._depth: list[float] = []
        self._reprojected: list[float] = []
        self._poses: list[tuple[int, int, Pose, Pose]] = []
        """Frame, time, the method's pose, and the true one."""
        self._located: list[bool] = []
        self._camera: FrameName = ""
        """Whose tracks are shown."""

    def add(self, frame: int, step: Step) -> None:
        """Takes the Step of a frame."""
        self.frames.append(frame)
        landmarks = step.landmarks
        self._landmarks |= dict(zip(landmarks.ids.tolist(), landmarks.xyz_in_world, strict=True))
        camera: FrameName = next((name for name in ("video", "left") if name in step.tracks), "")
        pose = step.world_from_frame
        self._located.append(pose is not None)
        if pose is not None:
            of_camera = "left" if camera == "left" else "video"
            world_from_rig = self.truth.pose(of_camera, step.time_ns) @ self.rig_from(of_camera).inverse()
            self._poses.append((frame, step.time_ns, pose, world_from_rig @ self.rig_from(step.frame)))
        if camera:
            self._camera = camera
            self._add_tracks(step, camera, pose)
        else:
            self._alive.append(0)
            self._wrong.append(1.0)

    def _add_tracks(self, step: Step, camera: FrameName, pose: Pose | None) -> None:
        tracks = step.tracks[camera]
        seen = tracks.status < TrackStatus.LOST
        ids, uv = tracks.ids[seen].tolist(), tracks.uv[seen].astype(float)
        depth = interpolated(self.truth.depth(camera, step.time_ns), uv)
        model, world_from_camera = self.truth.camera(camera), self.truth.pose(camera, step.time_ns)
        rays = np.column_stack([model.normalise(uv), np.ones(len(uv))]) if len(uv) else np.zeros((0, 3))
        points = world_from_camera.apply(rays * depth[:, None])
        old = [i for i, track in enumerate(ids) if track in self._anchors]
        right = np.zeros(len(ids), bool)
        if old:
            expected = model.project(world_from_camera.inverse().apply(np.array([self._anchors[ids[i]] for i in old])))
            began = np.array([self._began[ids[i]] for i in old])
            with np.errstate(invalid="ignore"):
                errors = np.linalg.norm(expected - uv[old], axis=1)
                near = errors <= WRONG_PX
                moved = near & (np.linalg.norm(expected - began, axis=1) >= MOVED_PX)
            right[old] = near
            self._wrong.append(float(1 - near.mean()))
            if near.any():
                self._errors_px.append(float(np.median(errors[near])))
            self._proven |= {
                ids[i] for i, far in zip(old, moved, strict=True) if far and self._seen[ids[i]] + 1 >= LONG
            }
        elif self._alive:
            self._wrong.append(1.0)  # all tracks are new again: none was followed
        for i, track in enumerate(ids):
            self._seen[track] = self._seen.get(track, 0) + 1
            self._born.setdefault(track, len(self.frames))
            if track not in self._anchors and np.isfinite(points[i]).all():
                self._anchors[track], self._began[track] = points[i], uv[i]
        self._alive.append(_cells(uv[right]) if self._alive else _cells(uv))
        if pose is None:
            return
        known = [i for i, track in enumerate(ids) if track in self._landmarks and np.isfinite(depth[i])]
        self._mapped.append(_cells(uv[known]))
        if len(known) < MIN_POSES:
            return
        turn = (self.rig_from(step.frame).inverse() @ self.rig_from(camera)).scaled(float(self.metric))
        xyz = (pose @ turn).inverse().apply(np.array([self._landmarks[ids[i]] for i in known]))
        ahead = xyz[:, 2] > 0
        ratio = np.where(ahead, depth[known] / np.where(ahead, xyz[:, 2], 1.0), np.inf)
        unit = float(np.median(ratio))
        self._depth.append(float(np.median(np.abs(ratio / unit - 1))) if np.isfinite(unit) else 1.0)
        if ahead.any():
            self._reprojected.append(float(np.median(np.linalg.norm(model.project(xyz) - uv[known], axis=1)[ahead])))

    def values(self, trajectory: Trajectory, reference: Trajectory) -> tuple[dict[str, float | None], dict[str, int]]:
        """Returns all values, and the frames at which some were worst."""
        turns, directions, where = self._two_view()
        first = self._located.index(True) if any(self._located) else len(self._located)
        located = self._located[first:]
        out: dict[str, float | None] = {
            "tracks": _median(self._alive),
            "wrong_percent": self._wrong_percent(),
            "turn_deg": _median(turns),
            "direction_deg": _median(directions),
            "landmarks": _median(self._mapped) if self._poses else None,
            "depth_percent": _percent(_median(self._depth)),
            "reprojection_px": _median(self._reprojected),
            "located_percent": _percent(sum(located) / len(self._located)) if self._located else None,
        }
        if (out["landmarks"] or 0.0) < LANDMARKS:
            out["depth_percent"] = out["reprojection_px"] = None
        own, true = associate(trajectory, reference)
        if len(own) >= max(MIN_POSES, 8, LOCATED_SHARE * len(self._located)) and true.length > 0:
            error = ate_m(aligned(own, true, "sim3"), true)
            out["ate_percent"] = 100 * error / true.length
            unit = alignment(own, true, "sim3").scale
            out["scale_percent"] = 100 * abs(float(np.log(unit))) if self.metric else drift(own, true)
        if self._errors_px:
            out["track_px"] = _median(self._errors_px)
        worst = {}
        if self._wrong:
            worst["wrong_percent"] = self.frames[len(self.frames) - len(self._wrong) + int(np.argmax(self._wrong))]
        if directions:
            worst["direction_deg"] = worst["turn_deg"] = where[int(np.argmax(directions))]
        lost = [frame for frame, known in zip(self.frames, self._located, strict=True) if not known]
        if lost:
            worst["located_percent"] = next(
                (f for f in lost if f > self.frames[min(first, len(self.frames) - 1)]), lost[-1]
            )
        return out, worst

    def _wrong_percent(self) -> float | None:
        """Returns the share of followed tracks that are on another point. They stand for all tracks only where enough
        of those follow something, and enough of them are right."""
        wrong = _mean(self._wrong)
        if wrong is None:
            return None
        last = len(self.frames) - LONG
        told = [track for track, born in self._born.items() if born <= last]
        all_seen = sum(self._seen[track] for track in told)
        share = sum(self._seen[track] for track in told if track in self._proven) / all_seen if all_seen else 0.0
        enough = min(1.0, share / PROVEN_SHARE) * min(1.0, float(np.median(self._alive)) / PROVEN_TRACKS)
        return 100 * (1 - (1 - wrong) * enough)

    def too_good(self, values: Mapping[str, float | None]) -> dict[str, float]:
        """Returns, for each value that is smaller than the noise of images allows, the least one."""
        camera = self.truth.camera(self._camera or "video")
        angle = NOISE_PX / camera.fx / np.sqrt(NOISE_TRACKS)
        least = {
            "track_px": NOISE_PX,
            "reprojection_px": NOISE_PX,
            "turn_deg": float(np.degrees(angle)),
            "direction_deg": float(np.degrees(angle)),
            "depth_percent": 100 * NOISE_PX / camera.width,
            "ate_percent": 100 * float(angle),
        }
        return {k: bound for k, bound in least.items() if (v := values.get(k)) is not None and v < bound}

    def _two_view(self) -> tuple[list[float], list[float], list[int]]:
        """Returns errors of the rotation and of the direction of the translation [deg] of pairs of views."""
        turns, directions, where = [], [], []
        times = np.array([time for _, time, _, _ in self._poses], np.int64)
        for _, time_ns, own, true in self._poses:
            j = int(np.searchsorted(times, time_ns + APART_NS))
            if j >= len(times):
                break
            frame, _, own_later, true_later = self._poses[j]
            relative, expected = own.inverse() @ own_later, true.inverse() @ true_later
            turns.append(_angle_deg(relative.rotation.T @ expected.rotation))
            lengths = np.linalg.norm(relative.translation) * np.linalg.norm(expected.translation)
            cosine = relative.translation @ expected.translation / lengths if lengths > 0 else -1.0
            directions.append(float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))))
            where.append(frame)
        return turns, directions, where


def interpolated(depth: Array, uv: Array) -> Array:
    """Returns depths (N,) at places (N, 2) [px]: exact on planes; NaN outside, in the sky and at edges."""
    height, width = depth.shape
    x, y = uv[:, 0], uv[:, 1]
    inside = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    left = np.clip(np.floor(np.where(inside, x, 0)).astype(int), 0, width - 2)
    top = np.clip(np.floor(np.where(inside, y, 0)).astype(int), 0, height - 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        corners = 1 / np.stack([depth[top + dy, left + dx] for dy in (0, 1) for dx in (0, 1)])
        smooth = inside & (corners.min(axis=0) > 0) & (corners.max(axis=0) < (1 + SMOOTH) * corners.min(axis=0))
        right, down = x - left, y - top
        weights = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right])
        return np.where(smooth, 1 / (weights * corners).sum(axis=0), np.nan)


def _cells(uv: Array) -> int:
    """Returns the number of cells of an image that have one of the points (N, 2)."""
    return len(np.unique(np.floor(uv / CELL_PX), axis=0)) if len(uv) else 0


def drift(own: Trajectory, true: Trajectory) -> float | None:
    """Returns by how much the unit changes from the first quarter of the poses to the last [%]."""
    quarter = len(own) // 4
    ratios = []
    for part in (slice(0, quarter + 1), slice(len(own) - quarter - 1, len(own))):
        length, expected = (np.linalg.norm(np.diff(t.translations[part][[0, -1]], axis=0)) for t in (own, true))
        if length <= 0 or expected <= 0:
            return None
        ratios.append(length / expected)
    return 100 * abs(float(np.log(ratios[1] / ratios[0])))


def _angle_deg(rotation: Array) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def _median(values: list[Any] | NDArray) -> float | None:
    return float(np.median(values)) if len(values) else None


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _percent(value: float | None) -> float | None:
    return None if value is None else 100 * value
