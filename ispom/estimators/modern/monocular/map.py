"""The map of the monocular estimator: a window of key frames, the points they see, and what has left it, as a prior."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.lens import corrected
from ispom.estimators.modern.monocular.setup import INLIER
from ispom.estimators.modern.noise import TrackNoise
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.inverse_depth import InverseDepths, intersect
from ispom.solvers.window.adjustment import Adjusted, Window, adjust
from ispom.solvers.window.prior import LENS, Prior

WIDTH_IN_MEDIANS = 3.0
"""Of the loss, in median distances of points from where they were seen: 3.5 deviations of normal errors, of which it
keeps 98 % of what they say. Beside these there are larger errors, of patches on more than one surface: by a width of
their own kind, 0.5 px, poses in rooms, streets and sim:tiny were off by a tenth to a quarter more."""
NARROWEST = 0.1
"""Of the widest loss: images without any noise leave none to be told from others."""


@dataclass(frozen=True, eq=False)
class RelativeFrame:
    """A frame that is no key frame: its pose is held relative to the key frame before it, or to the first one, and
    moves along with that."""

    time_ns: int
    key_ns: int
    key_from_camera: Pose


@dataclass(frozen=True, eq=False)
class Map:
    """World: the first video frame, or the place of the first of the map (see ModernMonocular); unit: own."""

    keys: tuple[TrackedFrame, ...]
    """In order of time, each with its pose and all its tracks, those without a point included."""
    points: ScenePoints
    prior: Prior | None
    """Over the first poses of the window; holds the world and the unit."""
    loss: float
    """Width of the robust loss, normalised, in which the prior and `extra_sigma` count."""
    relative_frames: tuple[RelativeFrame, ...] = ()
    extra: Array = field(default_factory=lambda: np.zeros(LENS))
    """Correction of the camera, see lens.py; the key frames' coordinates are without it."""
    extra_sigma: Array = field(default_factory=lambda: np.zeros(LENS))
    """Its deviations before any data, widened as the loss is; 0 where it is held."""
    noise: TrackNoise = TrackNoise()
    """What the windows' residuals said of the tracks."""

    @property
    def poses(self) -> tuple[Pose, ...]:
        """world_from_camera of the key frames."""
        return tuple(k.world_from_camera for k in self.keys if k.world_from_camera is not None)

    def trajectory(self) -> list[tuple[int, Pose]]:
        """All frames of the window."""
        of_key = {k.time_ns: p for k, p in zip(self.keys, self.poses, strict=True)}
        others = [(b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in self.relative_frames]
        return [*of_key.items(), *others]

    def pose_at(self, time_ns: int) -> Pose | None:
        """world_from_camera of the last key frame, or of the last frame after it, if it is of that time."""
        if self.keys[-1].time_ns == time_ns:
            return self.poses[-1]
        last = self.relative_frames[-1] if self.relative_frames else None
        if last is None or last.time_ns != time_ns or last.key_ns != self.keys[-1].time_ns:
            return None
        return self.poses[-1] @ last.key_from_camera

    def since(self, time_ns: int) -> list[tuple[int, Pose]]:
        """Frames of the window from a time on, in order of time."""
        of_key = {k.time_ns: p for k, p in zip(self.keys, self.poses, strict=True)}
        others = [
            (b.time_ns, of_key[b.key_ns] @ b.key_from_camera) for b in self.relative_frames if b.time_ns >= time_ns
        ]
        return sorted([*((t, p) for t, p in of_key.items() if t >= time_ns), *others], key=lambda item: item[0])

    def known(self, ids: NDArray[np.int64]) -> Array:
        """Points (N, 3) of these tracks, NaN where there is none."""
        place = self.points.places(ids)
        if not len(self.points.ids):
            return np.full((len(ids), 3), np.nan)
        return np.where((place >= 0)[:, None], self.points.xyz[place], np.nan)

    def with_relative_frame(self, time_ns: int, world_from_camera: Pose) -> Map:
        key_from_camera = self.poses[-1].inverse() @ world_from_camera
        new = RelativeFrame(time_ns, self.keys[-1].time_ns, key_from_camera)
        return replace(self, relative_frames=(*self.relative_frames, new))

    def moved(self, time_ns: int, world_from_camera: Pose) -> Map:
        """With another pose of the frame of that time, which is no key frame."""
        of_key = {k.time_ns: p for k, p in zip(self.keys, self.poses, strict=True)}
        frames = (
            replace(b, key_from_camera=of_key[b.key_ns].inverse() @ world_from_camera) if b.time_ns == time_ns else b
            for b in self.relative_frames
        )
        return replace(self, relative_frames=tuple(frames))

    def with_new_tracks(self, ids: NDArray[np.int64], x: Array) -> Map:
        """Adds tracks first seen in the last key frame to it."""
        return replace(self, keys=(*self.keys[:-1], self.keys[-1].with_new(ids, x)))

    def with_updated_coordinates(self, time_ns: int, ids: NDArray[np.int64], x: Array) -> Map:
        """With tracks (M,) at other coordinates (M, 2) in the key frame of that time, if there is one."""
        return replace(
            self, keys=tuple(k.with_updated_coordinates(ids, x) if k.time_ns == time_ns else k for k in self.keys)
        )

    def with_loss(self, widest: float) -> Map:
        """With a loss as wide as the errors of its last window ask for, and `widest` (normalised) at most."""
        loss = min(max(WIDTH_IN_MEDIANS * self.noise.spread * self.loss, NARROWEST * widest), widest)
        share = loss / self.loss
        prior = None if self.prior is None else self.prior.times(1 / share**2)
        return replace(self, loss=loss, prior=prior, extra_sigma=share * self.extra_sigma)

    def without(self, ids: NDArray[np.int64]) -> Map:
        """Forgets these points."""
        return replace(self, points=self.points.without(ids))


@dataclass(frozen=True, eq=False)
class BundleProblem:
    """The window as arrays."""

    window: Window
    ids: NDArray[np.int64]
    """(M,) of its points."""


@dataclass(frozen=True, eq=False)
class TrackObservations:
    """All observations of some tracks (places 0..M-1) by the key frames, sorted by track, then by key frame."""

    cameras: NDArray[np.int64]
    owners: NDArray[np.int64]
    seen: Array
    """(K, 2) normalised."""


def observations_of(keys: tuple[TrackedFrame, ...], ids: NDArray[np.int64]) -> TrackObservations:
    """`ids` (M,) ascending."""
    wanted = ScenePoints(ids, np.zeros((len(ids), 3)))
    cameras, owners, seen = [], [], []
    for c, key in enumerate(keys):
        place = wanted.places(key.ids)
        use = place >= 0
        owners.append(place[use])
        cameras.append(np.full(len(owners[-1]), c, np.int64))
        seen.append(key.x[use])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return TrackObservations(np.concatenate(cameras)[order], owner[order], np.concatenate(seen)[order])


def views(poses: tuple[Pose, ...]) -> tuple[Array, Array]:
    """camera_from_world (C, 3, 3) and (C, 3)."""
    inverses = [p.inverse() for p in poses]
    return np.stack([p.rotation for p in inverses]), np.stack([p.translation for p in inverses])


def bundle_problem(state: Map) -> BundleProblem:
    """The points that two key frames or more see, with all their observations."""
    seen = observations_of(state.keys, state.points.ids)
    counts = np.bincount(seen.owners, minlength=len(state.points.ids))
    use = counts >= 2
    slot, kept = np.cumsum(use) - 1, use[seen.owners]
    rotations, translations = views(state.poses)
    return BundleProblem(
        Window(
            rotations,
            translations,
            state.points.xyz[use],
            seen.cameras[kept],
            slot[seen.owners[kept]],
            np.column_stack([seen.seen[kept], np.full(int(kept.sum()), np.nan)]),
            extra=state.extra,
            extra_sigma=state.extra_sigma,
            prior=state.prior,
        ),
        state.points.ids[use],
    )


def adjusted(state: Map, width: float, iterations: int, tolerance: float = 1e-3) -> tuple[Map, Adjusted, BundleProblem]:
    """The map after windowed bundle adjustment, without the points that end behind a view or disagree with one.

    `width` of the widest loss, normalised.
    """
    before = bundle_problem(state)
    found = adjust(before.window, state.loss, iterations, tolerance)
    window = found.window
    worst = np.zeros(len(before.ids))
    np.maximum.at(worst, window.owners, found.distances)
    xyz = state.points.xyz.copy()
    place = state.points.places(before.ids)
    xyz[place] = window.points
    keys = tuple(
        replace(k, world_from_camera=Pose(r.T, -r.T @ t))
        for k, r, t in zip(state.keys, window.rotations, window.translations, strict=True)
    )
    kept = np.ones(len(xyz), bool)
    kept[place[worst > INLIER * width]] = False
    after = replace(state, extra=window.extra, keys=keys, points=ScenePoints(state.points.ids[kept], xyz[kept]))
    return after, found, before


def intersected(state: Map, ids: NDArray[np.int64], noise: Noise) -> InverseDepths:
    """Intersects the rays of tracks (M,), ascending, from all keyframes that see them; `noise` normalised."""
    seen = observations_of(state.keys, ids)
    x = corrected(seen.seen, state.extra)
    return intersect(*views(state.poses), seen.cameras, seen.owners, x, len(ids), noise)
