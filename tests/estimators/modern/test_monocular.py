"""The modern monocular estimator: its contract, what it survives, and how well it does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.estimators.modern.monocular.estimator import ModernMonocular, ModernMonocularConfig
from ispom.estimators.modern.monocular.initialise import advance
from ispom.estimators.modern.monocular.state import Start
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Pose, so3_log
from ispom.numerics.robust import Noise
from ispom.sequences import open_sequence
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Frame, Measurement, Rig, Sequence, Status, Step, TrackStatus, Trajectory, is_video
from tests.alone import run, stepped_through
from tests.estimators.test_contract import same

DATA = Path(__file__).parents[4] / "shared" / "data"


@pytest.fixture(scope="module")
def frames(exposures: list[Measurement]) -> list[Frame]:
    return [e for e in exposures if is_video(e)]


@pytest.fixture(scope="module")
def estimator(flight: Sequence) -> ModernMonocular:
    return ModernMonocularConfig().build(flight.rig)


def finish(estimator: ModernMonocular, frames: list[Frame]) -> tuple[Trajectory, list[Step]]:
    state, steps = stepped_through(estimator, frames)
    return estimator.finish(state), steps


@pytest.fixture(scope="module")
def walked(estimator: ModernMonocular, frames: list[Frame]) -> tuple[Trajectory, list[Step]]:
    return finish(estimator, frames)


def ate(found: Trajectory, truth: Trajectory) -> tuple[float, float]:
    """Root mean square distance [m] from the truth after alignment in Sim(3), and the scale of that."""
    target = np.array([p.translation for t in found.times_ns if (p := truth.at(int(t))) is not None])
    sim3 = umeyama(found.translations, target, with_scale=True)
    return float(np.sqrt(((sim3.apply(found.translations) - target) ** 2).sum(1).mean())), sim3.scale


def video_truth(sequence: Sequence) -> Trajectory:
    assert sequence.truth is not None
    return sequence.truth.moved(right=sequence.rig.rig_from_video)


def test_once_started_every_frame_is_tracked_as_the_video_cameras(walked: tuple[Trajectory, list[Step]]) -> None:
    assert all(s.status is Status.TRACKING for s in walked[1][-20:])
    assert {s.frame for s in walked[1]} == {"video"}


def test_every_frame_gets_a_good_pose(walked: tuple[Trajectory, list[Step]], flight: Sequence) -> None:
    found, _ = walked
    assert len(found) == flight.kinds.count("video")
    error, _ = ate(found, video_truth(flight))
    assert error < 0.015


def test_the_covariance_is_that_of_the_right_twist(walked: tuple[Trajectory, list[Step]], flight: Sequence) -> None:
    covariances = [s.covariance for s in walked[1] if s.status is Status.TRACKING]
    for covariance in covariances:
        assert covariance is not None and covariance.shape == (6, 6)
        assert np.linalg.eigvalsh((covariance + covariance.T) / 2).min() > -1e-12


def test_every_key_frame_tells_how_far_its_unit_may_have_drifted(walked: tuple[Trajectory, list[Step]]) -> None:
    keys = [s for s in walked[1] if s.key_frame and s.status is Status.TRACKING]
    sigmas = [s.scale_sigma for s in keys if s.scale_sigma is not None]
    assert len(sigmas) == len(keys) >= 3 and all(1e-4 < sigma < 0.1 for sigma in sigmas[1:])
    assert all(any(d.name.startswith("scale drift") for d in s.decisions) for s in keys[1:])
    assert all(s.scale_sigma is None for s in walked[1] if not s.key_frame)


def test_an_earlier_state_can_be_stepped_on_from(estimator: ModernMonocular, frames: list[Frame]) -> None:
    state, states = estimator.start(), []
    for frame in frames[:40]:
        states.append(state)
        state, _ = estimator.step(state, frame)
    again = states[15]
    for frame in frames[15:40]:
        again, _ = estimator.step(again, frame)
    assert same(estimator.finish(state), estimator.finish(again))


def test_threads_change_nothing(
    estimator: ModernMonocular, frames: list[Frame], walked: tuple[Trajectory, list[Step]]
) -> None:
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        assert same(finish(estimator, frames)[0], walked[0])
    finally:
        cv2.setNumThreads(before)


def turned(frame: Frame, rig: Rig, turn: np.ndarray, time_ns: int) -> Frame:
    """The image after a rotation second_from_first of the camera."""
    camera = rig.camera("video")
    homography = camera.matrix @ turn @ np.linalg.inv(camera.matrix)
    return Frame.video(time_ns, cv2.warpPerspective(frame.image, homography, (camera.width, camera.height)))  # type: ignore[arg-type]


def test_a_turn_on_the_spot_keeps_the_place(flight: Sequence, frames: list[Frame]) -> None:
    rig = flight.rig.changed(video=replace(flight.rig.camera("video"), distortion=()))
    turns = [Pose.from_rotvec(np.array([0.002 * i, 0.006 * i, 0.0]), np.zeros(3)).rotation for i in range(12)]
    steps = list(
        run(
            ModernMonocularConfig().build(rig),
            [turned(frames[0], rig, t, i * 33_000_000) for i, t in enumerate(turns)],
        )
    )
    assert {s.status for s in steps} == {Status.INITIALISING}
    for step, turn in zip(steps, turns, strict=True):
        assert step.world_from_frame is not None and not step.world_from_frame.translation.any()
        assert np.linalg.norm(so3_log(step.world_from_frame.rotation @ turn)) < 2e-3
    assert any("waiting for parallax" in d.consequence for d in steps[-1].decisions)


def test_a_plane_starts_a_map(flight: Sequence) -> None:
    rng = np.random.default_rng(0)
    xyz = np.column_stack([rng.uniform((-1.5, -1), (1.5, 1), (200, 2)), np.zeros(200)])
    xyz[:, 2] = 3 + 0.3 * xyz[:, 0]
    truth = [
        Pose.from_rotvec(np.array([0.0, 0.03 * i, 0.01 * i]), np.array([-0.12 * i, 0.02 * i, 0.05 * i]))
        for i in range(12)
    ]
    start, begun = Start(), None
    for i, pose in enumerate(truth):
        p = pose.inverse().apply(xyz)
        x = p[:, :2] / p[:, 2:] + rng.normal(0, 2e-4, (200, 2))
        begun = advance(start, TrackedFrame(i, np.arange(200), x), Noise(1e-3), np.radians(2.0))
        start = begun.start
        if begun.map is not None:
            break
    assert begun is not None and begun.map is not None
    assert any(d.key == "plane_share" and d.passed for d in begun.decisions)
    found = Trajectory.of(begun.map.trajectory())
    assert len(found) == i + 1
    target = np.array([truth[int(t)].translation for t in found.times_ns])
    sim3 = umeyama(found.translations, target, with_scale=True)
    assert np.abs(sim3.apply(found.translations) - target).max() < 0.03 * np.linalg.norm(target[-1])
    turn = found.pose(-1).rotation.T @ found.pose(0).rotation @ truth[0].rotation.T @ truth[i].rotation
    assert np.linalg.norm(so3_log(turn)) < 0.01


def blanked(frames: list[Frame], first: int, count: int) -> list[Frame]:
    dark = np.zeros_like(frames[0].image)
    return [f.with_images(video=dark) if first <= i < first + count else f for i, f in enumerate(frames)]


def test_a_few_dark_frames_are_bridged(estimator: ModernMonocular, frames: list[Frame], flight: Sequence) -> None:
    found, steps = finish(estimator, blanked(frames, 30, 3))
    assert [s.status for s in steps[30:33]] == [Status.LOST] * 3
    assert all(s.status is Status.TRACKING for s in steps[33:])
    assert len(found) == len(frames) - 3 and ate(found, video_truth(flight))[0] < 0.02


def test_a_place_is_known_again_after_a_dark_stretch(
    estimator: ModernMonocular, frames: list[Frame], flight: Sequence
) -> None:
    found, steps = finish(estimator, blanked(frames, 25, 20))
    assert [s.status for s in steps[25:45]] == [Status.LOST] * 20
    assert all(s.status is Status.TRACKING for s in steps[45:]) and not any(s.restarted for s in steps)
    truth = video_truth(flight)
    before, after = (
        found.select(found.times_ns < frames[35].time_ns),
        found.select(found.times_ns > frames[35].time_ns),
    )
    assert ate(found, truth)[0] < 0.02
    assert ate(after, truth)[1] / ate(before, truth)[1] == pytest.approx(1, abs=0.03)


def test_a_long_loss_starts_a_new_map_in_the_old_world(
    estimator: ModernMonocular, frames: list[Frame], flight: Sequence
) -> None:
    other = [
        f.with_images(video=np.ascontiguousarray(f.image[:, ::-1])) for f in frames[35:]
    ]  # a place never seen before
    found, steps = finish(estimator, [*blanked(frames[:35], 25, 10), *other])
    assert steps[-1].status is Status.TRACKING and steps[-1].covariance is not None
    assert any("a new map" in d.consequence for s in steps for d in s.decisions)
    (begins,) = [step for step in steps if step.restarted]
    assert begins.segment_from_ns == frames[35].time_ns, "what is seen first after the dark is its first frame"
    assert begins.revised.times_ns[0] <= frames[35].time_ns < begins.time_ns
    part = found.select(found.times_ns > frames[35].time_ns)
    before = found.select(found.times_ns < frames[25].time_ns)
    truth = video_truth(flight)
    mirrored = replace(truth, translations=truth.translations * (-1, 1, 1))
    error, scale = ate(part, mirrored)
    assert error < 0.03
    assert scale / ate(before, truth)[1] == pytest.approx(1, abs=0.35), "the unit goes on, as far as the speed does"
    gone = before.pose(-1).translation
    assert np.linalg.norm(part.pose(0).translation - gone) * scale > 0.1, "it went on while nothing was seen"
    spread = np.sqrt(np.trace(steps[-1].covariance[:3, :3]))
    assert spread * scale > 0.05, "and where it went is not sure"


def test_a_first_view_of_a_board_is_not_taken_for_its_mirrored_one(estimator: ModernMonocular) -> None:
    """Half the size of the images, and standing still for a while, led to the other pose that a plane allows."""
    cases = [(0.5, 0), (1.0, 20)]
    if not (DATA / "handheld_board").exists():
        pytest.skip("no ../shared/data/handheld_board here")
    sequence = open_sequence(str(DATA / "handheld_board")).truncated(60)
    truth, frames = video_truth(sequence), [e for i in range(60) if is_video(e := sequence[i])]
    for factor, still in cases:
        camera = sequence.rig.camera("video").scaled(factor)
        size, step_ns = (camera.width, camera.height), frames[1].time_ns - frames[0].time_ns
        images = [np.asarray(cv2.resize(f.image, size, interpolation=cv2.INTER_AREA), np.uint8) for f in frames]
        played = [Frame.video(frames[0].time_ns - (still - i) * step_ns, images[0]) for i in range(still)]
        played += [Frame.video(f.time_ns, image) for f, image in zip(frames, images, strict=True)]
        found, _ = finish(ModernMonocularConfig().build(Rig.single(camera)), played)
        assert ate(found.select(found.times_ns >= frames[0].time_ns), truth)[0] < 0.004


def test_brightness_may_change_at_once(estimator: ModernMonocular, frames: list[Frame], flight: Sequence) -> None:
    flickering = [
        f.with_images(video=(f.image * (1.0, 0.7, 0.85)[i % 3]).astype(np.uint8)) for i, f in enumerate(frames)
    ]
    found, steps = finish(estimator, flickering[:40])
    assert sum(s.status is Status.LOST for s in steps) == 0 and len(found) == 40
    assert ate(found, video_truth(flight))[0] < 0.015


def golden(folder: str, count: int) -> tuple[Trajectory, Sequence]:
    if not (DATA / folder).exists():
        pytest.skip(f"no ../shared/data/{folder} here")
    sequence = open_sequence(str(DATA / folder)).truncated(count)
    estimator = ModernMonocularConfig().build(sequence.rig)
    frames = [e for i in range(len(sequence)) if is_video(e := sequence[i])]
    return finish(estimator, frames)[0], sequence


def test_a_drive_from_its_left_camera() -> None:
    folder = DATA / "kitti" / "sequences" / "06"
    if not folder.exists():
        pytest.skip("no ../shared/data/kitti here")
    found, sequence = golden("kitti/sequences/06", 51)
    assert len(found) >= sequence.kinds.count("video") - 1
    assert ate(found, video_truth(sequence))[0] < 0.08


def test_a_handheld_camera_over_a_board() -> None:
    found, sequence = golden("handheld_board", 100)
    assert len(found) >= 99
    assert ate(found, video_truth(sequence))[0] < 0.005


def test_tracks_that_end_say_why(walked: tuple[Trajectory, list[Step]]) -> None:
    reasons = {int(code) for s in walked[1] for code in s.tracks["video"].status}
    assert {TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.OUT_OF_IMAGE, TrackStatus.LOST} <= reasons


def test_images_without_texture_give_no_map(estimator: ModernMonocular, frames: list[Frame]) -> None:
    steps = list(run(estimator, [f.with_images(video=np.full_like(f.image, 128)) for f in frames[:8]]))
    assert {s.status for s in steps} == {Status.INITIALISING}


def test_a_video_of_three_times_the_size_is_as_accurate(
    flight: Sequence, frames: list[Frame], walked: tuple[Trajectory, list[Step]]
) -> None:
    """4K and the like: tracked at a bounded width, with the same error in degrees."""
    camera = flight.rig.camera("video").scaled(3)
    large = [
        Frame.video(f.time_ns, cv2.resize(f.image, (camera.width, camera.height), interpolation=cv2.INTER_CUBIC))  # type: ignore[arg-type]
        for f in frames[:40]
    ]
    found, steps = finish(ModernMonocularConfig().build(flight.rig.changed(video=camera)), large)
    plain = walked[0].select(np.isin(walked[0].times_ns, found.times_ns))
    truth = video_truth(flight)
    assert len(found) == 40 and ate(found, truth)[0] < 1.5 * ate(plain, truth)[0] + 1e-4
    uv = steps[-1].tracks["video"].uv
    assert 0.7 * camera.width < uv[:, 0].max() < camera.width
