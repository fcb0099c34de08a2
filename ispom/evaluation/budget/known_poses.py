"""The calibration and the clock that fit the tracks with the true poses.

Ground truth makes this an answer to "what if": the calibration that it gives is an input of a rerun, and no estimator
sees the truth itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, RotationSpline

from ispom.evaluation.doctor.adjustment import adjust, adjust_gradually, covariance
from ispom.evaluation.doctor.groups import has
from ispom.evaluation.doctor.hypothesis import Change, change_of
from ispom.evaluation.doctor.scene import CAMERAS, Observations, Scene
from ispom.evaluation.doctor.start import LEAST_TRACKS, triangulate
from ispom.evaluation.doctor.stretch import Stretch
from ispom.evaluation.doctor.tracking import Tracked
from ispom.geometry import Array, Pose
from ispom.solvers.trajectory.cubic import cubic_at
from ispom.types import Rig, Trajectory

CLOCK = "clock_ms"
GROUPS = (
    ("video_focal_percent",), ("video_centre_x_px", "video_centre_y_px"), ("k1",),
    ("pair_focal_percent",), ("pair_centre_x_px", "pair_centre_y_px"), ("baseline_percent",),
    ("right_x_deg", "right_y_deg", "right_z_deg"),
    ("turn_x_deg", "turn_y_deg", "turn_z_deg"), ("shift_x_m", "shift_y_m", "shift_z_m"),
    (CLOCK,),
)  # fmt: skip
"""Numbers that may be wrong together: of the lens, the pair, the mount and the clock."""
SURE = 4.0
"""A group is wrong where its numbers differ from the stated ones by this many standard deviations (root mean square).
By chance none of ten groups does in one of a thousand recordings, and errors that tracks of one place share reach
three. With all numbers free, each is known so badly that a rerun is worse than the run, whatever was wrong."""
TRIAL = 3
"""Iterations after which the groups that may be wrong are compared: the one that explains most is ahead by then."""
VIEWS = 12
"""Frames of the main camera that the scene is observed in, at most: all numbers are of one calibration, and more frames
of the same tracks say little more of it."""
BETWEEN = 4
"""Poses of the scene for each true one: a rig does not move evenly between two of these, where pairs are exposed."""
LEAST_VIEWS = 3
"""Least number of views of a track: two rays always meet in nearly one point."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The numbers that are wrong, as the tracks have them with the true poses."""

    names: tuple[str, ...]
    values: Array
    """(N,) changes of the stated calibration."""
    covariance: Array
    """(N, N)"""
    tracks: int

    def change(self, names: tuple[str, ...]) -> Change:
        """Returns the change in these numbers."""
        return self._change(self.values, names)

    def drawn(self, names: tuple[str, ...], seed: int) -> Change:
        """Returns another one that the tracks allow as well, always the same for a seed."""
        values = np.random.default_rng(seed).multivariate_normal(self.values, self.covariance, method="eigh")
        return self._change(values, names)

    def _change(self, values: Array, names: tuple[str, ...]) -> Change:
        return change_of(names, np.array([values[self.names.index(name)] for name in names]))


def calibrated(seen: Stretch, tracked: Tracked, world_from_rig: Trajectory) -> Calibrated | None:
    """Returns the numbers of the calibration and the clock that differ from the stated ones, by the tracks of a stretch
    and the true poses; perhaps there are none. None with too few tracks or frames with a true pose."""
    found = _scene(seen, tracked, world_from_rig)
    if found is None:
        return None
    scene, observed = found
    groups = [group for group in GROUPS if _applies(seen.rig, group[0])]
    fit = _chosen(scene, seen.rig, observed, groups)
    factors = np.array([_recorded(seen, name) for name in fit.names])
    values = factors * np.array([fit.change.value(name) for name in fit.names])
    return Calibrated(fit.names, values, fit.covariance * np.outer(factors, factors), len(scene.points))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A scene that is fitted with some numbers free."""

    scene: Scene
    names: tuple[str, ...]
    change: Change
    cost: float
    covariance: Array

    @staticmethod
    def of(scene: Scene, rig: Rig, seen: Observations, names: tuple[str, ...]) -> _Fit:
        """Fits the scene."""
        fitted, change, cost = adjust_gradually(scene, rig, seen, names)
        spread = covariance(fitted, rig, seen, names, change) if names else np.zeros((0, 0))
        return _Fit(fitted, names, change, cost, spread)

    def sigmas_off(self, group: tuple[str, ...]) -> float:
        """Returns the root mean square difference of these numbers from the stated ones, in standard deviations."""
        at = [self.names.index(name) for name in group]
        values = np.array([self.change.value(name) for name in group])
        return float(np.sqrt(values @ np.linalg.solve(self.covariance[np.ix_(at, at)], values) / len(group)))


def _chosen(scene: Scene, rig: Rig, seen: Observations, groups: list[tuple[str, ...]]) -> _Fit:
    """Frees the group that explains most, then the next one, as long as it exceeds SURE. A group that no longer does
    with the later ones is fixed again."""
    chosen, fit = list[tuple[str, ...]](), _Fit.of(scene, rig, seen, ())
    while left := [group for group in groups if group not in chosen]:

        def cost(group: tuple[str, ...], now: _Fit = fit) -> float:
            return adjust(now.scene, rig, seen, now.names + group, TRIAL, now.change)[2]

        best = min(left, key=cost)
        more = _Fit.of(scene, rig, seen, fit.names + best)
        if more.sigmas_off(best) < SURE:
            break
        chosen, fit = [*chosen, best], more
    kept = [group for group in chosen if fit.sigmas_off(group) >= SURE]
    return fit if kept == chosen else _Fit.of(scene, rig, seen, tuple(name for group in kept for name in group))


def _applies(rig: Rig, name: str) -> bool:
    if name == CLOCK or name.startswith(("turn", "shift")):
        return rig.video is not None and rig.has_stereo
    return has(rig, name)


def _recorded(seen: Stretch, name: str) -> float:
    """Returns pixels of the recording per pixel of the examined images, for a number in pixels; 1 for others."""
    return seen.recorded_px("left" if name.startswith("pair") else "video", 1.0) if name.endswith("_px") else 1.0


def _scene(seen: Stretch, tracked: Tracked, world_from_rig: Trajectory) -> tuple[Scene, Observations] | None:
    """Returns the true poses, at frames of the main camera, and points with their observations."""
    shots = seen.main_shots
    known = [(f, pose) for f, shot in enumerate(shots) if (pose := world_from_rig.at(shot.time_ns)) is not None]
    if len(known) < LEAST_VIEWS:
        return None
    frames, poses = np.array([f for f, _ in known]), [pose for _, pose in known]
    uv = tracked.uv[:, frames]
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(VIEWS, len(frames))).astype(int))
    rows, points = _points(seen, poses, uv, chosen)
    if len(rows) < LEAST_TRACKS:
        return None
    begin_ns = shots[0].time_ns
    times_s = np.array([(shots[f].time_ns - begin_ns) * 1e-9 for f in frames])
    scene = Scene(*_dense(times_s, poses), points, known=True)
    parts = [_observed(seen.main, uv[rows][:, chosen], times_s[chosen])]
    pair_times_s = np.array([(shot.time_ns - begin_ns) * 1e-9 for shot in seen.pairs])
    inside = (pair_times_s >= times_s[0] - 1e-9) & (pair_times_s <= times_s[-1] + 1e-9)
    if inside.any() and seen.rig.has_stereo:
        parts.append(_observed("right", tracked.right[rows][:, inside], pair_times_s[inside]))
        if seen.main != "left":
            parts.append(_observed("left", tracked.left[rows][:, inside], pair_times_s[inside]))
    every = ("camera", "time_s", "point", "uv")
    return scene, Observations(*(np.concatenate([getattr(part, name) for part in parts]) for name in every))


def _points(seen: Stretch, poses: list[Pose], uv: Array, chosen: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Returns the tracks that are seen often enough in the chosen frames and meet in front of these, and where."""
    camera, rig_from_camera = seen.rig.camera(seen.main), seen.rig.rig_from(seen.main)
    rays = camera.normalise(uv[:, chosen].reshape(-1, 2)).reshape(len(uv), len(chosen), 2)
    views = {k: poses[f] @ rig_from_camera for k, f in enumerate(chosen)}
    points, errors = triangulate(rays, views)
    often = np.isfinite(rays[..., 0]).sum(axis=1) >= LEAST_VIEWS
    rows = np.flatnonzero(often & np.isfinite(errors) & np.isfinite(points[:, 0]))
    return rows, points[rows]


def _dense(times_s: Array, poses: list[Pose]) -> tuple[Array, Array, Array]:
    """Returns times, rotations and positions of BETWEEN poses for each given one, on smooth curves through these."""
    count = BETWEEN * (len(times_s) - 1) + 1
    dense_s = np.interp(np.arange(count) / BETWEEN, np.arange(len(times_s)), times_s)
    rotations = RotationSpline(times_s, Rotation.from_matrix([p.rotation for p in poses]))(dense_s).as_matrix()
    return dense_s, rotations, cubic_at(times_s, np.array([p.translation for p in poses]), dense_s)


def _observed(camera: str, uv: Array, times_s: Array) -> Observations:
    point, frame = np.nonzero(np.isfinite(uv[..., 0]))
    return Observations(np.full(len(point), CAMERAS.index(camera)), times_s[frame], point, uv[point, frame])
