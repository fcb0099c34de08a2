"""Stand-ins for tests that are not about estimating: a tiny three-camera sequence, and Steps of plausible content."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from ispom.ensemble import Ensemble, Member
from ispom.geometry import Pose, Similarity
from ispom.methods import in_order, method
from ispom.solvers.trajectory.interpolation import interpolate
from ispom.types import (
    Camera,
    Decision,
    Frame,
    Landmarks,
    Measurement,
    Rig,
    SegmentFit,
    Sequence,
    SplineFit,
    Status,
    Step,
    Tracks,
    Trajectory,
    is_stereo,
)


def rig() -> Rig:
    stereo = Rig.stereo(Camera(160, 120, 120.0, 120.0, 79.5, 59.5), 0.4)
    video = Camera(80, 60, 60.0, 60.0, 39.5, 29.5, (-0.05, 0.01, 0.0, 0.0))
    return stereo.changed(
        video=video, rig_from_video=Pose.from_rotvec(np.array([0.01, 0.02, 0.0]), np.array([0.02, -0.05, 0.01]))
    )


def pose_at(time_ns: int) -> Pose:
    t = time_ns * 1e-9
    return Pose.from_rotvec(np.array([0.0, 0.1 * t, 0.0]), np.array([np.sin(t), 0.05 * np.sin(3 * t), 2.0 * t]))


def sequence(video_frames: int = 20) -> Sequence:
    """Video at 30 Hz and stereo at 3 Hz between its frames; the images are noise that slides."""
    stamps = [(round(i / 30 * 1e9), "video") for i in range(video_frames)]
    stamps += [(round((i / 3 + 0.01) * 1e9), "stereo") for i in range(1 + video_frames // 10)]
    stamps = sorted(s for s in stamps if s[0] <= stamps[video_frames - 1][0])
    texture = np.random.default_rng(0).integers(0, 256, (240, 640, 3), np.uint8)

    def load(i: int) -> Measurement:
        time_ns, kind = stamps[i]
        if kind == "video":
            return Frame.video(time_ns, texture[:60, i : i + 80].copy())
        return Frame.stereo(time_ns, texture[:120, i : i + 160].copy(), texture[:120, i + 5 : i + 165].copy())

    return Sequence(
        "double",
        rig(),
        np.array([t for t, _ in stamps], np.int64),
        tuple(k for _, k in stamps),
        load,  # type: ignore[arg-type]
        Trajectory.of([(t, pose_at(t)) for t, _ in stamps]),
        ("a stand-in for tests",),
    )


def ensemble(methods: Iterable[str], make: Callable[[str], Any]) -> Ensemble:
    """These methods with made estimators, without those that they ask."""
    names = in_order(methods)
    return Ensemble(names, {name: Member(method(name), make(name)) for name in names})


def spline_fit(times_ns: tuple[int, ...]) -> SplineFit:
    """Of a window: begun a little beside the true path, adjusted onto it."""
    true = np.stack([pose_at(t).translation for t in times_ns])
    knots, wrong = true[::2], np.array([0.0, 0.05, 0.0])
    video = np.array([t % 333_333_333 != 10_000_000 for t in times_ns])
    times, sizes = np.array(times_ns, np.int64), np.linspace(1.0, 2.0, len(true))
    return SplineFit(
        times, video, true + wrong, true, times[::2], knots + wrong, knots, 3 * sizes, sizes, 90.0, 30.0, 4
    )


def segment_fit(start_ns: int, end_ns: int) -> SegmentFit:
    """Of a video whose unit is half a metre, in a world of its own, bent away from the true path."""
    own = Similarity(2.0, Pose.from_rotvec(np.array([0.0, 0.4, 0.0]), np.array([1.0, 2.0, 3.0])))
    times = np.arange(start_ns - 20_000_000, end_ns + 54_000_000, 33_333_333).tolist()
    video = Trajectory.of(
        [(t, own.apply_pose(pose_at(t)) @ Pose.exp(np.full(6, 1e-10 * (t - start_ns)))) for t in times]
    )
    ends = np.array([start_ns, end_ns], np.int64)
    metric = Trajectory.of([(t, pose_at(t)) for t in ends.tolist()], "video")
    return SegmentFit((start_ns, end_ns), video, interpolate(video, ends, "linear"), metric, 0.5, 0.01, 0.03)


class FakeEstimator:
    """Walks the true path; keeps the contract."""

    def __init__(self, method: str) -> None:
        self.method = method

    def start(self) -> tuple[int, ...]:
        return ()

    def step(self, state: tuple[int, ...], exposure: Measurement, asked: object = None) -> tuple[tuple[int, ...], Step]:
        time_ns, n = exposure.time_ns, 30
        rng = np.random.default_rng(time_ns)
        camera, frame = ("left", "rig") if is_stereo(exposure) else ("video", "video")
        size = (160, 120) if camera == "left" else (80, 60)
        tracks = Tracks.of(
            np.arange(n) + len(state),
            rng.random((n, 2)) * size,
            uv_prev=rng.random((n, 2)) * size,
            status=rng.integers(0, 10, n),
            residual_px=rng.random(n),
            disparity_px=rng.random(n) * 9,
        )
        landmarks = Landmarks(np.arange(n) + len(state), rng.random((n, 3)) * 9, rng.integers(0, 256, (n, 3), np.uint8))
        return (
            (*state, time_ns),
            Step(
                time_ns,
                Status.TRACKING,
                "rig" if not self.method.startswith("monocular") else frame,  # type: ignore[arg-type]
                pose_at(time_ns),
                key_frame=len(state) % 5 == 0,
                tracks={camera: tracks},
                landmarks=landmarks,
                residuals_px=rng.random(n),
                revised=Trajectory.of([(t, pose_at(t)) for t in state[-3:]]),
                scale=1.0,
                seconds={"track": 0.004, "pose": 0.001},
                decisions=(Decision("parallax", 14.2, 20.0, False, "px", consequence="no key frame", key="parallax"),),
                method=self.method,
                **(self._fits(state, exposure) if len(state) % 5 == 0 else {}),
            ),
        )

    def _fits(self, state: tuple[int, ...], exposure: Measurement) -> dict[str, Any]:
        """What an integration tells at its key frames."""
        if len(state) < 10 or not self.method.startswith("integrated"):
            return {}
        times = (*state[-10:], exposure.time_ns)
        if self.method == "integrated":
            return {"spline": spline_fit(times)}
        return {"segments": (segment_fit(times[0], times[-1]),)}

    def finish(self, state: tuple[int, ...], asked: object = None) -> Trajectory:
        frame = "video" if self.method.startswith("monocular") else "rig"
        return Trajectory.of([(t, pose_at(t)) for t in state], frame)


LOST_EVERY = 11
"""Of a FullEstimator's exposures, each so manieth is lost."""


class FullEstimator(FakeEstimator):
    """Says all that a Step can say: covariances, losses, parts, drift of the unit, points without a place, and
    revisions that differ from what they replace (the height of a pose is how often it was revised, in metres)."""

    def step(self, state: tuple[int, ...], exposure: Measurement, asked: object = None) -> tuple[tuple[int, ...], Step]:
        after, step = super().step(state, exposure)
        if len(after) % LOST_EVERY == 0:
            nothing = {"world_from_frame": None, "residuals_px": np.zeros(0), "scale": None, "key_frame": False}
            return after, replace(step, status=Status.LOST, revised=Trajectory.empty(), **nothing)  # type: ignore[arg-type]
        lost = {t for i, t in enumerate(after, 1) if i % LOST_EVERY == 0}
        again = [(t, raised(t, len(after) - i)) for i, t in enumerate(state, 1) if i > len(state) - 3 and t not in lost]
        xyz = step.landmarks.xyz_in_world.copy()
        xyz[::7] = np.nan
        parts = () if self.method != "integrated" else (replace(step, method="monocular"),)
        return after, replace(
            step,
            world_from_frame=raised(step.time_ns, 0),
            covariance=np.diag([0.01, 0.02, 0.03, 1e-4, 1e-4, 1e-4]) * len(after),
            revised=Trajectory.of(again, step.frame),
            landmarks=replace(step.landmarks, xyz_in_world=xyz),
            scale_sigma=0.01 * len(after) if self.method == "monocular" else None,
            parts=parts,
        )


def raised(time_ns: int, times: int) -> Pose:
    """The pose at a time after it was revised `times` times."""
    return Pose(translation=np.array([0.0, times, 0.0])) @ pose_at(time_ns)
