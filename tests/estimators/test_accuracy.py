"""How well the estimators do on the simulator, whose truth they never see; loose bounds that a broken step breaks."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.estimators.paper.monocular import MonocularConfig
from ispom.estimators.paper.stereo import StereoConfig
from ispom.geometry import Pose
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Exposure, Sequence, StereoPair, TrackStatus, Trajectory, VideoFrame
from tests.alone import alone, run


def finish(config, name: str, flight: Sequence, exposures: list[Exposure]) -> Trajectory:
    estimator = alone(name, flight.rig, config)
    state = estimator.start()
    for exposure in exposures:
        if estimator.uses(exposure):
            state, _ = estimator.step(state, exposure)
    return estimator.finish(state)


def true_positions(flight: Sequence, times_ns: np.ndarray, camera: str) -> np.ndarray:
    assert flight.truth is not None
    truth = flight.truth.moved(right=flight.rig.rig_from(camera))  # type: ignore[arg-type]
    return np.array([truth.at(int(t)).translation for t in times_ns])  # type: ignore[union-attr]


@pytest.mark.parametrize("matching", ["sift", "klt"])
def test_stereo_is_metric(matching: str, flight: Sequence, exposures: list[Exposure]) -> None:
    found = finish(StereoConfig(matching=matching), "stereo.paper", flight, exposures)  # type: ignore[arg-type]
    assert len(found) == flight.kinds.count("stereo")
    truth = true_positions(flight, found.times_ns, "rig")
    start = flight.truth.at(int(found.times_ns[0]))  # type: ignore[union-attr]
    error = np.linalg.norm(found.moved(left=start).translations - truth, axis=1)
    assert error.max() < 0.03 * np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"scale_transfer": "vector"},
        {"scale_transfer": "depth"},
        {"local_bundle": True},
        {"interpolation": "linear"},
    ],
    ids=str,
)
def test_monocular_follows_the_shake_up_to_its_scale(
    changes: dict, flight: Sequence, exposures: list[Exposure]
) -> None:
    found = finish(replace(MonocularConfig(), **changes), "monocular.paper", flight, exposures)
    assert len(found) == flight.kinds.count("video")
    truth = true_positions(flight, found.times_ns, "video")
    aligned = umeyama(found.translations, truth, with_scale=True).apply(found.translations)
    error = np.sqrt(((aligned - truth) ** 2).sum(1).mean())
    assert error < 0.02 * np.linalg.norm(truth[-1] - truth[0])


def test_integrated_is_metric_at_every_video_frame(flight: Sequence, exposures: list[Exposure]) -> None:
    estimator = alone("integrated.paper", flight.rig)
    state = estimator.start()
    for exposure in exposures:
        state, _ = estimator.step(state, exposure)
    found, stereo = estimator.finish(state), estimator.finish_asked(state, "stereo")
    first, last = stereo.times_ns[[0, -1]]
    inside = [
        int(t) for t, kind in zip(flight.times_ns, flight.kinds, strict=True) if kind == "video" and first <= t <= last
    ]
    assert found.times_ns.tolist() == inside
    start = flight.truth.at(int(first))  # type: ignore[union-attr]
    error = found.moved(left=start).translations - true_positions(flight, found.times_ns, "rig")
    assert np.sqrt((error**2).sum(1).mean()) < 0.05


def test_standing_still_is_no_motion(flight: Sequence, exposures: list[Exposure]) -> None:
    pair = next(e for e in exposures if isinstance(e, StereoPair))
    still = [replace(pair, time_ns=i * 10**8) for i in range(4)]
    steps = list(run(StereoConfig().build(flight.rig), still))
    for step in steps:
        assert step.world_from_frame is not None
        np.testing.assert_allclose(step.world_from_frame.log(), 0, atol=1e-6)


def test_a_turn_without_travel_is_no_key_frame(flight: Sequence, exposures: list[Exposure]) -> None:
    """Pure rotation has no parallax: the paper's monocular method must wait, not invent a translation."""
    frame = next(e for e in exposures if isinstance(e, VideoFrame))
    camera, steps = flight.rig.camera("video"), []
    pinhole = replace(camera, distortion=())
    rig = replace(flight.rig, video=pinhole)
    for i in range(12):
        turn = Pose.from_rotvec(np.array([0.002 * i, 0.006 * i, 0.0]), np.zeros(3)).rotation
        homography = pinhole.matrix @ turn @ np.linalg.inv(pinhole.matrix)
        size = (camera.width, camera.height)
        steps.append(VideoFrame(i * 33_000_000, cv2.warpPerspective(frame.image, homography, size)))  # type: ignore[arg-type]
    found = list(run(MonocularConfig().build(rig), steps))
    assert [s.key_frame for s in found] == [True] + [False] * 11


def test_dropped_tracks_say_why(flight: Sequence, exposures: list[Exposure]) -> None:
    steps = list(run(alone("monocular.paper", flight.rig), exposures))
    reasons = {int(code) for s in steps for code in s.tracks["video"].status}
    assert {TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.OUT_OF_IMAGE} <= reasons
    ended: set[int] = set()
    for step in steps:
        tracks = step.tracks["video"]
        assert not ended & set(tracks.ids.tolist()), "an ended track must not come back"
        ended |= set(tracks.ids[tracks.status >= TrackStatus.LOST].tolist())
