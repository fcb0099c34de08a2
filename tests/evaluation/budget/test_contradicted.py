"""Points that move by themselves contradict the true poses; still ones do not, nor where all are off by as much."""

from __future__ import annotations

import numpy as np

from ispom.evaluation.budget.contradicted import FirstSeen
from ispom.evaluation.budget.noise import noise_sigma
from ispom.geometry import Pose
from ispom.types import Camera, Tracks, TrackStatus

CAMERA = Camera(320, 240, 200.0, 200.0, 159.5, 119.5)
POINTS = np.random.default_rng(2).uniform([-3, -2, 5], [3, 2, 12], (60, 3))
MOVING = np.arange(50, 60)


def world_from_camera(frame: int) -> Pose:
    return Pose.from_rotvec(np.array([0.0, 0.01 * frame, 0.0]), np.array([0.2 * frame, 0.0, 0.1 * frame]))


def tracks(frame: int, moved_m: float, all_px: float = 0.0) -> Tracks:
    points = POINTS.copy()
    points[MOVING, 1] += moved_m * frame
    uv = CAMERA.project(world_from_camera(frame).inverse().apply(points))
    uv[:, 1] += all_px * (frame > 0)
    return Tracks.of(np.arange(len(points)), uv)


def contradicting(moved_m: float, all_px: float = 0.0) -> set[int]:
    seen, bad = FirstSeen(), set[int]()
    for frame in range(5):
        seen, ids = seen.contradicting(CAMERA, world_from_camera(frame), tracks(frame, moved_m, all_px))
        bad |= set(ids.tolist())
    return bad


def test_only_what_moves_contradicts() -> None:
    assert contradicting(0.1) == set(MOVING.tolist())
    assert contradicting(0.0) == set()


def test_where_all_tracks_are_off_none_is_an_outlier() -> None:
    assert contradicting(0.0, 3.0) == set()


def test_a_track_that_ended_is_forgotten() -> None:
    seen, _ = FirstSeen().contradicting(CAMERA, world_from_camera(0), tracks(0, 0.1))
    ended = Tracks.of(np.arange(60), tracks(1, 0.1).uv, status=np.full(60, TrackStatus.LOST))
    seen, bad = seen.contradicting(CAMERA, world_from_camera(1), ended)
    assert not seen.points and not len(bad) and len(seen.views) == 1


def test_a_camera_that_rests_says_nothing() -> None:
    seen, _ = FirstSeen().contradicting(CAMERA, world_from_camera(0), tracks(0, 0.1))
    _, bad = seen.contradicting(CAMERA, world_from_camera(0), tracks(3, 0.1))
    assert not len(bad)


def test_noise_is_measured_on_an_even_slope() -> None:
    slope = np.linspace(60, 180, 320)[None] + np.zeros((240, 1))
    rng = np.random.default_rng(0)
    for sigma in (1.5, 6.0):
        image = np.clip(slope + sigma * rng.normal(size=slope.shape) + 0.5, 0, 255).astype(np.uint8)
        assert abs(noise_sigma(image) / sigma - 1) < 0.15
        assert abs(noise_sigma(np.dstack([image] * 3)) / sigma - 1) < 0.15
    assert noise_sigma(np.full((240, 320), 9, np.uint8)) == 0 and noise_sigma(np.zeros((4, 4), np.uint8)) == 0
