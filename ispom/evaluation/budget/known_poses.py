"""The calibration and the clock as the tracks have them where the true poses are known.

Ground truth makes this an answer to "what if": the calibration that it gives is an input of a rerun, and no estimator
sees the truth itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, RotationSpline

from ispom.evaluation.doctor.adjustment import adjust_gradually, covariance
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
NUMBERS = (
    "video_focal_percent", "video_centre_x_px", "video_centre_y_px", "k1",
    "pair_focal_percent", "pair_centre_x_px", "pair_centre_y_px", "baseline_percent",
    "right_x_deg", "right_y_deg", "right_z_deg",
    "turn_x_deg", "turn_y_deg", "turn_z_deg", "shift_x_m", "shift_y_m", "shift_z_m",
    CLOCK,
)  # fmt: skip
"""What may be wrong: of the lens, the pair, the mount and the clock."""
VIEWS = 12
"""Frames of the main camera that the scene is observed in, at most: all numbers are of one calibration, and more frames
of the same tracks say little more of it."""
BETWEEN = 4
"""Poses of the scene for each true one: a rig does not move evenly between two of these, where pairs are exposed."""
LEAST_VIEWS = 3
"""Of a track: two rays always meet in nearly one point."""


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The numbers that the tracks have with the true poses."""

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
    """Returns the numbers of the rig's cameras that the tracks of a stretch have with the true poses. None where too
    few tracks, or too few frames with a true pose, are there."""
    found = _scene(seen, tracked, world_from_rig)
    if found is None:
        return None
    scene, observed = found
    names = tuple(name for name in NUMBERS if _applies(seen.rig, name))
    scene, change, _ = adjust_gradually(scene, seen.rig, observed, names)
    spread = covariance(scene, seen.rig, observed, names, change)
    factors = np.array([_recorded(seen, name) for name in names])
    values = factors * np.array([change.value(name) for name in names])
    return Calibrated(names, values, spread * np.outer(factors, factors), len(scene.points))


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
