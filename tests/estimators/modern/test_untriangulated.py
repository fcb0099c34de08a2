"""Tracks without a point beside few points of the map, on synthesised truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ispom.estimators.modern.monocular import untriangulated
from ispom.estimators.modern.monocular.covariance import MapUncertainty
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.localise import Localisation, localise_by_tracks
from ispom.estimators.modern.monocular.map import Map, RelativeFrame, TracksInMap
from ispom.estimators.modern.monocular.setup import WIDTH
from ispom.estimators.modern.monocular.tracks import LiveTracks, TrackingResult
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.solvers.localisation import PoseFit, fit_pose
from ispom.solvers.window.prior import LENS, POSE
from ispom.types import Camera, Rig, TrackStatus
from tests.estimators.modern.setups import setup_of
from tests.nees import band

CAMERA = Camera(384, 288, 276.0, 276.0, 191.5, 143.5)
SETUP = setup_of(ModernMonocularConfig().build(Rig.single(CAMERA)))
KEY = Pose.from_rotvec(np.array([0.02, -0.1, 0.01]), np.array([1.0, 0.1, -0.5]))
"""world_from_camera of the key frame, of the last image, and of the new one: a bend."""
LAST = KEY @ Pose.from_rotvec(np.array([0.0, 0.1, 0.005]), np.array([0.15, 0.0, 0.9]))
NEW = KEY @ Pose.from_rotvec(np.array([0.0, 0.2, 0.01]), np.array([0.35, 0.02, 1.8]))
POINTS, TRACKS = 40, 70
ALIVE = int(TrackStatus.ALIVE)


def seen(world_from_camera: Pose, xyz: Array) -> Array:
    """(N, 2) [px]."""
    near = world_from_camera.inverse().apply(xyz)
    return CAMERA.project(near)


def located(
    seed: int,
    tracks: int = TRACKS,
    error_px: float = 0.2,
    drift_m: float = 0.0,
    key: Pose = KEY,
    guess: Pose = LAST,
    predicted: Pose | None = None,
) -> Localisation:
    """A frame by points at the image's edge; the other tracks, all over it, move by `drift_m` a frame of their own.

    `key`: where the map has the key frame; `guess`, `predicted` as of `located_by`.
    """
    rng, other = np.random.default_rng(seed), np.random.default_rng(100 + seed)
    edge = np.column_stack([rng.uniform(-0.62, -0.5, POINTS), rng.uniform(-0.1, 0.1, POINTS), np.ones(POINTS)])
    points = NEW.apply(edge * rng.uniform(11, 12, (POINTS, 1)))
    rays = np.column_stack([other.uniform(-0.4, 0.6, tracks), other.uniform(-0.4, 0.4, tracks), np.ones(tracks)])
    others = NEW.apply(rays * other.uniform(8, 60, (tracks, 1)))
    at, ids = [], np.arange(POINTS + tracks)
    for i, pose in enumerate((KEY, LAST, NEW)):
        uv = seen(pose, np.concatenate([points, others + i * drift_m * NEW.rotation[:, 1]]))
        noise = [r.standard_normal((n, 2)) for r, n in ((rng, POINTS), (other, tracks))]
        at.append(uv + error_px * np.concatenate(noise))
    frame = TrackedFrame(0, ids, CAMERA.normalise(at[0]), key)
    between = RelativeFrame(10**8, 0, key.inverse() @ LAST)
    world = Map((frame,), ScenePoints(ids[:POINTS], points), None, 1e-3, (between,))
    live = LiveTracks(ids=ids, uv=at[1].astype(np.float32), speed=np.zeros((len(ids), 2), np.float32), time_ns=10**8)
    followed = TrackingResult(
        at[2].astype(np.float32), np.full(len(ids), ALIVE, np.uint8), np.zeros((len(ids), 2), np.float32)
    )
    return localise_by_tracks(TracksInMap(SETUP, live, world), followed, guess, predicted=predicted)


def off(found: Localisation) -> Array:
    """(6,) twist on the right of world_from_camera."""
    assert found.fit is not None
    return (NEW.inverse() @ found.fit.camera_from_world.inverse()).log()


def test_tracks_without_a_point_tell_how_the_camera_turned() -> None:
    """Also where points in so small a part of the image do not."""
    few, many = ([np.degrees(off(located(seed, n, 0.5))[4]) for seed in range(10)] for n in (0, TRACKS))
    assert np.std(many) < 0.3 * np.std(few)


def test_points_that_are_more_or_that_are_right_need_no_help() -> None:
    assert all(located(seed, POINTS, 0.5).untriangulated is None for seed in range(10))
    assert any(located(seed, TRACKS, 0.5).untriangulated is not None for seed in range(10))
    assert all(located(seed, TRACKS, 0.02).untriangulated is None for seed in range(10))


ASIDE = Pose.from_rotvec(np.array([0.0, -0.14, 0.0]), np.array([1.0, 0.0, 0.0]))


def led_away(xyz: Array, seen: Array, guess: Pose, *args: Any, **named: Any) -> PoseFit | None:
    """`fit_pose` where points alone lead along a valley: 8 degrees and a metre beside the pose."""
    found = fit_pose(xyz, seen, guess, *args, **named)
    if found is None or named.get("rays") is not None:
        return found
    return replace(found, camera_from_world=ASIDE @ found.camera_from_world)


def test_where_points_lead_away_tracks_are_also_asked_from_where_the_motion_leads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Around a corner all points were on one facade at the image's edge. They led 2 degrees beside the turn; from there
    all tracks together found another minimum, 9 degrees beside it, and the drive lost its unit."""
    monkeypatch.setattr("ispom.estimators.modern.monocular.localise.fit_pose", led_away)
    led, predicted = (ASIDE @ NEW.inverse()).inverse(), LAST @ (KEY.inverse() @ LAST)
    for seed in range(5):
        found, stuck = (located(seed, guess=led, predicted=by) for by in (predicted, None))
        assert np.degrees(np.linalg.norm(off(found)[3:])) < 0.2
        assert np.degrees(np.linalg.norm(off(stuck)[3:])) > 5


@pytest.mark.parametrize("drift_m", [0.3, 1.0])
def test_what_moves_by_itself_as_clouds_do_has_no_part(drift_m: float) -> None:
    for seed in range(5):
        with_clouds, alone = located(seed, drift_m=drift_m), located(seed, 0)
        assert np.abs(off(with_clouds) - off(alone)).max() < 0.01


@pytest.mark.parametrize("unsure_rad", [0.0, 1e-3])
def test_the_covariance_is_that_of_the_errors(unsure_rad: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of tracks, and of the key frame from which the others are seen; also where these are not needed."""
    monkeypatch.setattr(untriangulated, "LEAST_GAIN", -1.0)
    nees, held = [], np.zeros((POSE + LENS, POSE + LENS))
    held[:POSE, :POSE] = np.diag([0.0, 0.0, 0.0, unsure_rad, unsure_rad, unsure_rad])
    none = np.zeros((POINTS, POSE + LENS))
    arrays = np.zeros((POINTS, 3, POSE + LENS)), held**2, none, 1.0, np.eye(6)
    known = MapUncertainty((0,), np.arange(POINTS), *arrays, 0, 0, 0, 0)
    for seed in range(40):
        twist = held[:POSE, :POSE] @ np.random.default_rng(1000 + seed).standard_normal(POSE)
        found = located(seed, key=(Pose.exp(twist) @ KEY.inverse()).inverse())
        assert found.fit is not None and found.untriangulated is not None
        args = found.ids, found.xyz, found.x, found.fit
        covariance = known.of_pose(*args, WIDTH * SETUP.noise.width, found.untriangulated)
        nees.append(off(found) @ np.linalg.solve(covariance, off(found)))
        alone = known.of_pose(*args, WIDTH * SETUP.noise.width, replace(found.untriangulated, key_ns=5))
        assert unsure_rad == 0 or np.trace(alone[3:, 3:]) < np.trace(covariance[3:, 3:])
    low, high = band(6, len(nees), 0.999)
    assert low < np.mean(nees) < high
