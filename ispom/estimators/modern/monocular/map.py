"""The map of the monocular estimator: a window of keyframes, the points they observe, and a prior of those
marginalised."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import Lens, corrected
from ispom.estimators.modern.monocular.setup import INLIER, Setup
from ispom.estimators.modern.monocular.tracks import LiveTracks, TrackingResult, at_middle_row
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.influence.problem import report_problem
from ispom.solvers.influence.window import WindowProblem
from ispom.solvers.multiview.inverse_depth import InverseDepths, intersect
from ispom.solvers.window.adjustment import Adjusted, Window, adjust
from ispom.solvers.window.prior import LENS, Prior
from ispom.types import TrackStatus

WIDTH_IN_MEDIANS = 3.0
"""Width of the loss, in median residuals: 3.5 standard deviations of normal errors, of whose information it keeps 98 %.
There are larger errors too, of patches on more than one surface: with a width for these, 0.5 px, pose errors in rooms,
streets and sim:tiny were larger by a tenth to a quarter."""
NARROWEST = 0.1
"""Least width of the loss relative to the widest one: without image noise the width would be 0."""


@dataclass(frozen=True, eq=False)
class RelativeFrame:
    """A frame that is no keyframe: its pose is relative to the keyframe before it, or to the first one, and moves with
    it."""

    time_ns: int
    key_ns: int
    key_from_camera: Pose


@dataclass(frozen=True, eq=False)
class Map:
    """World: the first video frame, or the position of the first frame of the map (see ModernMonocular); own scale."""

    keys: tuple[TrackedFrame, ...]
    """Ordered by time, each with its pose and all its tracks, including those without a point."""
    points: ScenePoints
    prior: Prior | None
    """Prior over the first poses of the window; fixes the world and the scale."""
    loss: float
    """Width of the robust loss, normalised, in which the prior and `extra_sigma` are scaled."""
    relative_frames: tuple[RelativeFrame, ...] = ()
    extra: Array = field(default_factory=lambda: np.zeros(LENS))
    """Lens corrections, see lens.py; the keyframes' coordinates are without them."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(LENS))
    """Their prior standard deviations, scaled like the loss; 0 for fixed ones."""
    noise: TrackNoise = TrackNoise()
    """Noise of the tracks, measured from the windows' residuals."""

    @property
    def poses(self) -> tuple[Pose, ...]:
        """world_from_camera of the keyframes."""
        return tuple(k.pose for k in self.keys)

    def trajectory(self) -> list[tuple[int, Pose]]:
        """Returns times and poses of all frames of the window."""
        of_key = {k.time_ns: p for k, p in zip(self.keys, self.poses, strict=True)}
        others = [(b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in self.relative_frames]
        return [*of_key.items(), *others]

    @property
    def median_depth(self) -> float:
        """Median depth of the points that the last keyframe observes; NaN without any."""
        known = self.known(self.keys[-1].ids)
        near = self.poses[-1].inverse().apply(known[np.isfinite(known[:, 0])])[:, 2]
        return float(np.median(near)) if len(near) else float("nan")

    def pose_at(self, time_ns: int) -> Pose | None:
        """Returns world_from_camera at this time if it is that of the last keyframe or of the last frame after it."""
        if self.keys[-1].time_ns == time_ns:
            return self.poses[-1]
        last = self.relative_frames[-1] if self.relative_frames else None
        if last is None or last.time_ns != time_ns or last.key_ns != self.keys[-1].time_ns:
            return None
        return self.poses[-1] @ last.key_from_camera

    def since(self, time_ns: int) -> list[tuple[int, Pose]]:
        """Returns the frames of the window from this time on, ordered by time."""
        of_key = {k.time_ns: p for k, p in zip(self.keys, self.poses, strict=True)}
        others = [
            (b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in self.relative_frames if b.time_ns >= time_ns
        ]
        return sorted([*((t, p) for t, p in of_key.items() if t >= time_ns), *others], key=lambda item: item[0])

    def known(self, ids: NDArray[np.int64]) -> Array:
        """Returns the points (N, 3) of these tracks, NaN for untriangulated ones."""
        index = self.points.places(ids)
        if not len(self.points.ids):
            return np.full((len(ids), 3), np.nan)
        return np.where((index >= 0)[:, None], self.points.xyz[index], np.nan)

    def with_relative_frame(self, time_ns: int, world_from_camera: Pose) -> Map:
        key_from_camera = self.poses[-1].inverse() @ world_from_camera
        new = RelativeFrame(time_ns, self.keys[-1].time_ns, key_from_camera)
        return replace(self, relative_frames=(*self.relative_frames, new))

    def moved(self, time_ns: int, world_from_camera: Pose) -> Map:
        """Replaces the pose of the frame at this time, which is no keyframe."""
        of_key = {k.time_ns: p for k, p in zip(self.keys, self.poses, strict=True)}
        frames = (
            replace(b, key_from_camera=of_key[b.key_ns].inverse() @ world_from_camera) if b.time_ns == time_ns else b
            for b in self.relative_frames
        )
        return replace(self, relative_frames=tuple(frames))

    def with_new_tracks(self, ids: NDArray[np.int64], x: Array) -> Map:
        """Adds tracks that start in the last keyframe."""
        return replace(self, keys=(*self.keys[:-1], self.keys[-1].with_new(ids, x)))

    def with_updated_coordinates(self, time_ns: int, ids: NDArray[np.int64], x: Array) -> Map:
        """Replaces the coordinates (M, 2) of tracks (M,) in the keyframe at this time, if there is one."""
        return replace(
            self, keys=tuple(k.with_updated_coordinates(ids, x) if k.time_ns == time_ns else k for k in self.keys)
        )

    def with_loss(self, widest: float) -> Map:
        """Adapts the width of the loss to the residuals of the last window; at most `widest` (normalised)."""
        loss = min(max(WIDTH_IN_MEDIANS * self.noise.spread * self.loss, NARROWEST * widest), widest)
        share = loss / self.loss
        prior = None if self.prior is None else self.prior.times(1 / share**2)
        return replace(self, loss=loss, prior=prior, extra_sigma=share * self.extra_sigma)

    def without(self, ids: NDArray[np.int64]) -> Map:
        """Removes these points."""
        return replace(self, points=self.points.without(ids))


@dataclass(frozen=True, eq=False)
class TracksInMap:
    """The live tracks, and the map whose points some of them observe."""

    setup: Setup
    live: LiveTracks
    map: Map

    @cached_property
    def xyz(self) -> Array:
        """(N, 3) points of the tracks; NaN for tracks without a point."""
        return self.map.known(self.live.ids)

    @cached_property
    def lens(self) -> Lens:
        """The camera as corrected by the map."""
        return Lens(self.setup.camera, self.map.extra)

    @property
    def count(self) -> int:
        """Number of tracks with a point."""
        return int(np.count_nonzero(np.isfinite(self.xyz[:, 0])))

    def normalise(self, tracks: LiveTracks | TrackingResult, index: NDArray[np.int64]) -> Array:
        """Returns the normalised, corrected coordinates (M, 2) of some tracks (M,), all at the time of the middle
        row."""
        uv = at_middle_row(self.setup.camera, tracks)[index]
        return corrected(self.setup.camera.normalise(uv), self.map.extra)

    def observations(self, tracked: TrackingResult) -> tuple[NDArray[np.int64], Array, Array]:
        """Returns the points of the map that a new image observes, ids (M,) and positions (M, 3), and their normalised,
        corrected coordinates (M, 2)."""
        index = np.flatnonzero((tracked.status == TrackStatus.ALIVE) & np.isfinite(self.xyz[:, 0]))
        return self.live.ids[index], self.xyz[index], self.normalise(tracked, index)


@dataclass(frozen=True, eq=False)
class BundleProblem:
    """The window as arrays."""

    window: Window
    ids: NDArray[np.int64]
    """(M,) ids of its points."""


@dataclass(frozen=True, eq=False)
class TrackObservations:
    """All observations of some tracks (indices 0..M-1) by the keyframes, sorted by track, then by keyframe."""

    cameras: NDArray[np.int64]
    owners: NDArray[np.int64]
    seen: Array
    """(K, 2) normalised coordinates."""


def observations_of(keys: tuple[TrackedFrame, ...], ids: NDArray[np.int64]) -> TrackObservations:
    """Returns the observations of tracks `ids` (M,), ascending."""
    wanted = ScenePoints(ids, np.zeros((len(ids), 3)))
    cameras, owners, seen = [], [], []
    for c, key in enumerate(keys):
        index = wanted.places(key.ids)
        use = index >= 0
        owners.append(index[use])
        cameras.append(np.full(len(owners[-1]), c, np.int64))
        seen.append(key.x[use])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return TrackObservations(np.concatenate(cameras)[order], owner[order], np.concatenate(seen)[order])


def camera_poses(poses: tuple[Pose, ...]) -> tuple[Array, Array]:
    """Returns camera_from_world: rotations (C, 3, 3) and translations (C, 3)."""
    inverses = [p.inverse() for p in poses]
    return np.stack([p.rotation for p in inverses]), np.stack([p.translation for p in inverses])


def bundle_problem(local_map: Map) -> BundleProblem:
    """Returns the points that at least two keyframes observe, with all their observations."""
    seen = observations_of(local_map.keys, local_map.points.ids)
    counts = np.bincount(seen.owners, minlength=len(local_map.points.ids))
    use = counts >= 2
    slot, kept = np.cumsum(use) - 1, use[seen.owners]
    rotations, translations = camera_poses(local_map.poses)
    return BundleProblem(
        Window(
            rotations,
            translations,
            local_map.points.xyz[use],
            seen.cameras[kept],
            slot[seen.owners[kept]],
            np.column_stack([seen.seen[kept], np.full(int(kept.sum()), np.nan)]),
            extra=local_map.extra,
            extra_sigma=local_map.extra_sigma,
            prior=local_map.prior,
        ),
        local_map.points.ids[use],
    )


def optimise(
    local_map: Map, width: float, iterations: int, tolerance: float = 1e-3
) -> tuple[Map, Adjusted, BundleProblem]:
    """Runs windowed bundle adjustment, and removes points that end behind a camera or have an outlier.

    `width` of the widest loss, normalised.
    """
    before = bundle_problem(local_map)
    found = adjust(before.window, local_map.loss, iterations, tolerance)
    window = found.window
    times_ns = tuple(key.time_ns for key in local_map.keys)
    report_problem(lambda: WindowProblem(before.window, window, local_map.loss, before.ids, times_ns, "video"))
    worst = np.zeros(len(before.ids))
    np.maximum.at(worst, window.owners, found.distances)
    xyz = local_map.points.xyz.copy()
    index = local_map.points.places(before.ids)
    xyz[index] = window.points
    keys = tuple(
        replace(k, world_from_camera=Pose(r.T, -r.T @ t))
        for k, r, t in zip(local_map.keys, window.rotations, window.translations, strict=True)
    )
    kept = np.ones(len(xyz), bool)
    kept[index[worst > INLIER * width]] = False
    after = replace(local_map, extra=window.extra, keys=keys, points=ScenePoints(local_map.points.ids[kept], xyz[kept]))
    return after, found, before


def triangulate(local_map: Map, ids: NDArray[np.int64], noise: Noise) -> InverseDepths:
    """Triangulates tracks (M,), ascending, from all keyframes that observe them; `noise` normalised."""
    seen = observations_of(local_map.keys, ids)
    x = corrected(seen.seen, local_map.extra)
    return intersect(*camera_poses(local_map.poses), seen.cameras, seen.owners, x, len(ids), noise)
