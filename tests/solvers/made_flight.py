"""A made flight: exact observations of random points by the simulated rig, for the spline solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, so3_exp
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import Flight as FlightPath
from ispom.solvers.spline.curve import Spline
from ispom.solvers.spline.problem import (
    LEFT,
    VIDEO,
    AnchoredPoints,
    PosePrior,
    RigModel,
    RigObservations,
    RowBands,
    SplineProblem,
)

RIG = simulated_rig()


@dataclass(frozen=True, eq=False)
class Flight:
    path: FlightPath
    start_s: float
    times_s: Array
    """(E,) as stamped: the video's clock may be off."""
    video: NDArray[np.bool_]
    xyz: Array
    """(M, 3)."""
    clock_offset_s: float

    def true_time_s(self, e: int) -> float:
        return self.start_s + self.times_s[e] + (self.clock_offset_s if self.video[e] else 0.0)

    def truth(self, e: int, late_s: float = 0.0) -> Pose:
        """start_from_rig at an exposure, or when one of its rows is exposed."""
        return self.origin.inverse() @ self.path.pose_at(round(1e9 * (self.true_time_s(e) + late_s)))

    @property
    def origin(self) -> Pose:
        return self.path.pose_at(round(1e9 * (self.start_s + self.times_s[0])))


def made_flight(duration_s: float = 1.0, points: int = 120, clock_offset_s: float = 0.0, seed: int = 0) -> Flight:
    """Stereo at 3 Hz from 0 on and video at 30 Hz, 11 ms before; points 3-40 m ahead."""
    stereo, video = np.arange(0, duration_s + 0.01, 1 / 3), np.arange(-0.0113 + 1 / 30, duration_s, 1 / 30)
    times = np.concatenate([stereo, video])
    order = np.argsort(times, kind="stable")
    rng = np.random.default_rng(seed)
    depth = rng.uniform(3, 40, points)
    xyz = np.column_stack([rng.uniform(-0.6, 0.6, points) * depth, rng.uniform(-0.45, 0.45, points) * depth, depth])
    is_video = np.concatenate([np.zeros(len(stereo), bool), np.ones(len(video), bool)])[order]
    return Flight(FlightPath.seeded(seed), 2.0, times[order], is_video, xyz, clock_offset_s)


def problem_of(
    flight: Flight,
    noise_px: float = 0.0,
    spacing_s: float = 1 / 15,
    turn_rig: Array | None = None,
    estimate_clock: bool = False,
    seed: int = 1,
    read_out_s: float = 0.0,
) -> SplineProblem:
    """The problem with a poor start: the spline interpolates the stereo poses, and all points are at one depth.

    With a `read_out_s` shutters roll, and each observation has a band of rows of its own.
    Even point numbers are seen by the video camera, odd ones by the pair: they share no points, only the spline.
    """
    rng = np.random.default_rng(seed)
    rows, anchors, values, priors = [], [], [], []
    stereo = np.flatnonzero(~flight.video)
    for m, point in enumerate(flight.xyz):
        number, name = (VIDEO, "video") if m % 2 == 0 else (LEFT, "left")
        camera, first = RIG.camera(name), None  # type: ignore[arg-type]
        sigma = max(noise_px, 0.3) / camera.fx
        for e in range(len(flight.times_s)):
            if flight.video[e] != (m % 2 == 0):
                continue
            late_s = 0.0
            for _ in range(6 if read_out_s else 1):
                camera_from_world = (flight.truth(e, late_s) @ RIG.rig_from(name)).inverse()  # type: ignore[arg-type]
                x = camera_from_world.apply(point)
                exact = camera.project(x[None])[0]
                late_s = read_out_s * float(np.nan_to_num(exact[1] / (camera.height - 1) - 0.5))
            uv = exact + noise_px * rng.standard_normal(2)
            if x[2] < 0.5 or not ((uv >= 0) & (uv < (camera.width, camera.height))).all():
                continue
            seen = camera.normalise(uv[None])[0]
            disparity, known = RIG.baseline_m / x[2] + noise_px / camera.fx * rng.standard_normal(), number == LEFT
            if first is None:
                first = len(anchors)
                near = stereo[np.argmin(np.abs(flight.times_s[stereo] - flight.times_s[e]))]
                anchors.append(flight.truth(near) @ RIG.rig_from(name))  # type: ignore[arg-type]
                values.append([*seen, 1 / 10.0])
                priors.append([0.1, 1.0])
            rows.append((e, number, first, *seen, disparity, 1 / sigma, 1 / sigma, known / sigma, late_s))
    table = np.array(rows)
    points = AnchoredPoints(
        np.stack([a.rotation for a in anchors]), np.stack([a.translation for a in anchors]), np.array(values)
    )
    exposure, bands = table[:, 0].astype(int), RowBands()
    if read_out_s:
        bands, exposure = RowBands(exposure, table[:, 9]), len(flight.times_s) + np.arange(len(table))
    observations = RigObservations(
        exposure, table[:, 1].astype(int), table[:, 2].astype(int), table[:, 3:6], table[:, 6:9]
    )
    video = RIG.rig_from_video
    if turn_rig is not None:
        video = Pose(video.rotation @ so3_exp(turn_rig), video.translation)
    free = np.zeros(7, bool)
    free[:3], free[6] = turn_rig is not None, estimate_clock
    information = np.diag(1 / np.array([0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.05]) ** 2)
    rig = RigModel(video, RIG.rig_from_left, RIG.baseline_m, 0.0, information, free)
    start = -spacing_s
    count = int(np.ceil((flight.times_s[-1] + 0.04 - start) / spacing_s)) + 3
    at = np.clip(start + spacing_s * (np.arange(count) - 1), flight.times_s[stereo[0]], flight.times_s[stereo[-1]])
    ends = [flight.truth(int(e)) for e in stereo]
    guess = [_between(flight.times_s[stereo], ends, t) for t in at]
    spline = Spline(start, spacing_s, np.stack([g.rotation for g in guess]), np.stack([g.translation for g in guess]))
    prior = PosePrior(0, Pose(), np.eye(6) * 1e8)
    priors_of_depth = np.array(priors)
    return SplineProblem(
        spline, flight.times_s, flight.video, points, observations, rig, rig, prior, priors_of_depth, bands=bands
    )


def _between(times_s: Array, poses: list[Pose], time_s: float) -> Pose:
    i = min(max(int(np.searchsorted(times_s, time_s, side="right")) - 1, 0), len(poses) - 2)
    a, b, f = poses[i], poses[i + 1], (time_s - times_s[i]) / (times_s[i + 1] - times_s[i])
    step = a.inverse() @ b
    return a @ Pose(so3_exp(f * step.rotvec), f * step.translation)
