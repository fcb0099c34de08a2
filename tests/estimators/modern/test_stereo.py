"""The modern stereo estimator on the simulator and on real drives; bounds with some room above what was measured."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.estimators.modern.stereo.estimator import ModernStereo, ModernStereoConfig
from ispom.evaluation.relative_error import kitti_errors
from ispom.features.descriptors import OpenCvFeatures
from ispom.sequences import open_sequence
from ispom.types import Frame, Measurement, Sequence, Status, Step, TrackStatus, Trajectory, is_stereo
from tests.alone import stepped_through

DATA = Path(__file__).parents[4] / "shared" / "data"
ABSENT = "the shared recordings are not here"


def run(estimator: ModernStereo, exposures: list[Measurement]) -> tuple[Trajectory, list[Step]]:
    state, steps = stepped_through(estimator, filter(is_stereo, exposures))
    return estimator.finish(state), steps


def errors_m(found: Trajectory, truth: Trajectory) -> np.ndarray:
    """Distances from the truth, the first poses laid upon each other."""
    pairs = [(p, q) for t, p in found.items() if (q := truth.at(t)) is not None]
    placed = pairs[0][1] @ pairs[0][0].inverse()
    return np.array([np.linalg.norm((placed @ p).translation - q.translation) for p, q in pairs])


@pytest.mark.slow  # the ratchet measures stereo on simulations, too
def test_the_simulated_flight_is_metric(flight: Sequence, exposures: list[Measurement]) -> None:
    found, steps = run(ModernStereoConfig().build(flight.rig), exposures)
    assert flight.truth is not None and len(found) == flight.kinds.count("stereo")
    assert errors_m(found, flight.truth).max() < 0.006 * flight.truth.length
    assert all(s.covariance is not None and np.linalg.eigvalsh(s.covariance)[0] > 0 for s in steps[2:])


def test_threads_of_opencv_change_nothing(flight: Sequence, exposures: list[Measurement]) -> None:
    before, found = cv2.getNumThreads(), []
    try:
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            found.append(run(ModernStereoConfig().build(flight.rig), exposures[:12])[0])
    finally:
        cv2.setNumThreads(before)
    assert np.array_equal(found[0].translations, found[1].translations)
    assert np.array_equal(found[0].rotations, found[1].rotations)


def pairs_of(exposures: list[Measurement]) -> list[Frame]:
    return [e for e in exposures if is_stereo(e)]


def in_time(pairs: list[Frame], order: list[int]) -> list[Measurement]:
    """Pairs in this order at the times of a steady rig; -1 is a white wall."""
    every, grey = pairs[1].time_ns - pairs[0].time_ns, np.full_like(pairs[0].left, 128)
    images = [(grey, grey) if j < 0 else (pairs[j].left, pairs[j].right) for j in order]
    return [Frame.stereo(pairs[0].time_ns + i * every, *both) for i, both in enumerate(images)]


def way_errors_m(steps: list[Step], pairs: list[Frame], order: list[int], truth: Trajectory) -> np.ndarray:
    """Of the steps with a pose: distances from where the pairs were taken."""
    true = [truth.at(pairs[max(j, 0)].time_ns) for j in order]
    both = [(s.world_from_frame, q) for s, q in zip(steps, true, strict=True) if s.world_from_frame is not None]
    assert all(q is not None for _, q in both)
    placed = both[0][1] @ both[0][0].inverse()  # type: ignore[union-attr]
    return np.array([np.linalg.norm((placed @ p).translation - q.translation) for p, q in both])  # type: ignore


@pytest.mark.parametrize("blank", [2, 3, 10])
def test_a_white_wall_is_lost_and_recovered_from(blank: int, flight: Sequence, exposures: list[Measurement]) -> None:
    pairs = pairs_of(exposures)
    order = [0, 1, 2, *[-1] * blank, *range(3, len(pairs))]
    found, steps = run(ModernStereoConfig().build(flight.rig), in_time(pairs, order))
    assert [s.status for s in steps[3 : 4 + blank]] == [*[Status.LOST] * blank, Status.TRACKING]
    assert len(found) == len(pairs) and flight.truth is not None
    assert way_errors_m(steps, pairs, order, flight.truth).max() < 0.02 * flight.truth.length


@pytest.mark.parametrize("order", [[0, 1, 2, 5, 6], [0] * 5 + [1, 2, 3], [0, 1, 2] + [3] * 4 + [4, 5]])
def test_jumps_and_stops_are_followed(order: list[int], flight: Sequence, exposures: list[Measurement]) -> None:
    pairs = pairs_of(exposures)
    _, steps = run(ModernStereoConfig().build(flight.rig), in_time(pairs, order))
    assert all(s.status is Status.TRACKING for s in steps[1:]) and flight.truth is not None
    assert way_errors_m(steps, pairs, order, flight.truth).max() < 0.015 * flight.truth.length


def test_changes_of_exposure_are_followed(flight: Sequence, exposures: list[Measurement]) -> None:
    pairs, gains = pairs_of(exposures), (1.0, 0.7, 1.2, 0.6, 1.1, 0.8, 1.0, 0.6)
    dimmed: list[Measurement] = [
        Frame.stereo(
            p.time_ns, *(np.clip(g * v, 0, 255).astype(np.uint8) for g, v in ((a, p.left), (0.85 * a, p.right)))
        )
        for p, a in zip(pairs, gains, strict=False)
    ]
    found, steps = run(ModernStereoConfig().build(flight.rig), dimmed)
    assert all(s.status is Status.TRACKING for s in steps[1:])
    assert flight.truth is not None and errors_m(found, flight.truth).max() < 0.015 * flight.truth.length


def test_a_drive_on_which_nothing_is_seen_any_more_begins_anew(flight: Sequence, exposures: list[Measurement]) -> None:
    pairs = pairs_of(exposures)
    grey = np.full_like(pairs[0].left, 128)
    turned = [Frame.stereo(p.time_ns, p.left[::-1].copy(), p.right[::-1].copy()) for p in pairs[4:]]
    config = ModernStereoConfig(max_lost_pairs=0)
    given: list[Measurement] = [*pairs[:3], Frame.stereo(pairs[3].time_ns, grey, grey), *turned]
    found, steps = run(config.build(flight.rig), given)
    assert steps[3].status is Status.LOST and steps[4].status is Status.INITIALISING
    assert any(d.key == "lost_pairs" for d in steps[4].decisions)
    assert [i for i, step in enumerate(steps) if step.restarted] == [4], "a segment of its own"
    assert steps[-1].status is Status.TRACKING and len(found) == len(given) - 1
    # How the rig went on while nothing was seen is as good as unknown, and remains so.
    spread = [np.zeros((6, 6)) if s.covariance is None else s.covariance for s in steps]
    sigma_m = [float(np.sqrt(np.trace(c[:3, :3]))) for c in spread]
    last, now = steps[2].world_from_frame, steps[4].world_from_frame
    assert last is not None and now is not None
    gone = float(np.linalg.norm(now.translation - last.translation))
    assert sigma_m[2] < 0.05 and min(sigma_m[4:]) > 0.4 * gone


def test_half_a_minute_of_darkness_is_no_jump(flight: Sequence, exposures: list[Measurement]) -> None:
    pairs = pairs_of(exposures)
    dark, second_ns = np.full_like(pairs[0].left, 3), 1_000_000_000
    begin_ns, other = pairs[2].time_ns, [(p.left[::-1].copy(), p.right[::-1].copy()) for p in pairs[3:6]]
    given: list[Measurement] = [*pairs[:3]]
    given += [Frame.stereo(begin_ns + i * second_ns, dark, dark) for i in range(1, 30)]
    given += [Frame.stereo(begin_ns + 30 * second_ns + i * second_ns // 10, *both) for i, both in enumerate(other)]
    _, steps = run(ModernStereoConfig().build(flight.rig), given)
    assert {s.status for s in steps[3:32]} == {Status.LOST}
    before, last, now = (steps[i].world_from_frame for i in (1, 2, 32))
    assert before is not None and last is not None and now is not None
    speed = np.linalg.norm(last.translation - before.translation) / ((steps[2].time_ns - steps[1].time_ns) * 1e-9)
    assert np.linalg.norm(now.translation - last.translation) < 2.05 * speed
    # Where it really went while nothing was seen remains as good as unknown.
    spread = steps[32].covariance
    assert spread is not None and np.sqrt(np.linalg.eigvalsh(spread[:3, :3])[0]) > 25 * speed


def test_points_in_sight_are_found_again_where_the_motion_was_not_foreseen(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    """At three pairs a second a hand's shake is not: tracked from the last image alone, a third to a half was found."""
    _, steps = run(ModernStereoConfig().build(flight.rig), exposures)
    for step in steps[1:]:
        status = step.tracks["left"].status
        in_sight = status[(status != TrackStatus.NEW) & (status != TrackStatus.OUT_OF_IMAGE)]
        assert (in_sight == TrackStatus.ALIVE).mean() > 0.9


def test_ended_tracks_say_why(flight: Sequence, exposures: list[Measurement]) -> None:
    _, steps = run(ModernStereoConfig(max_error_px=0.5).build(flight.rig), exposures)
    seen = {int(s) for step in steps for s in step.tracks["left"].status}
    assert {TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.REPROJECTION} <= seen
    assert all(len(np.unique(s.tracks["left"].ids)) == len(s.tracks["left"]) for s in steps)


@pytest.mark.skipif(not (DATA / "kitti").exists(), reason=ABSENT)
def test_kitti_06_is_within_its_limit() -> None:
    sequence = open_sequence(str(DATA / "kitti" / "sequences" / "06"))
    pairs = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    found, steps = run(ModernStereoConfig().build(sequence.rig), pairs)
    assert sequence.truth is not None and len(found) == 51
    errors = kitti_errors(found, sequence.truth)
    assert errors is not None and errors.t_err_percent < 0.85
    assert any("disparity offset" in str(d) for d in steps[-1].decisions + steps[-2].decisions)


@pytest.mark.skipif(not (DATA / "kitti").exists(), reason=ABSENT)
@pytest.mark.parametrize("bend_px", [0.0, -1.5])  # at 45 degrees to the side against the middle
def test_fast_and_without_a_road_the_disparities_offset_is_found(bend_px: float) -> None:
    """A stand-in for a motorway: 2.4 m between pairs, nothing to see on the road, the right image off by 0.8 px."""
    sequence = open_sequence(str(DATA / "kitti" / "sequences" / "06"))
    pairs = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"][::2]
    camera = sequence.rig.camera("right")
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    u, v = u.astype(np.float32), v.astype(np.float32)
    u -= 0.8 + bend_px * ((u - camera.cx) / camera.fx) ** 2

    def blank(image: np.ndarray) -> np.ndarray:
        out, road = image.copy(), int(0.62 * len(image))
        out[road:] = cv2.GaussianBlur(image, (0, 0), 8)[road:]
        return out

    moved: list[Measurement] = [
        Frame.stereo(p.time_ns, blank(p.left), blank(np.asarray(cv2.remap(p.right, u, v, cv2.INTER_CUBIC), np.uint8)))
        for p in pairs
        if is_stereo(p)
    ]
    found, steps = run(ModernStereoConfig().build(sequence.rig), moved)
    assert sequence.truth is not None and all(s.status is Status.TRACKING for s in steps[1:])
    errors = kitti_errors(found, sequence.truth.select(np.searchsorted(sequence.truth.times_ns, found.times_ns)))
    assert errors is not None and errors.t_err_percent < 1.2


@pytest.mark.skipif(not (DATA / "euroc_v1_01_start").exists(), reason=ABSENT)
def test_a_drone_at_rest_stays_where_it_is() -> None:
    sequence = open_sequence(str(DATA / "euroc_v1_01_start"))
    pairs = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    found, _ = run(ModernStereoConfig().build(sequence.rig), pairs)
    assert np.linalg.norm(found.translations - found.translations[0], axis=1).max() < 0.0005


def test_what_was_not_seen_in_half_a_minute_of_darkness_stays_unknown(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    pairs, gap_ns = pairs_of(exposures), 30_000_000_000
    dark = np.full_like(pairs[0].left, 128)
    elsewhere = [Frame.stereo(p.time_ns + gap_ns, p.left[::-1].copy(), p.right[::-1].copy()) for p in pairs[4:]]
    given: list[Measurement] = [*pairs[:3], Frame.stereo(pairs[3].time_ns + gap_ns, dark, dark), *elsewhere]
    _, steps = run(ModernStereoConfig(max_lost_pairs=0).build(flight.rig), given)
    assert [s.status for s in steps[3:6]] == [Status.LOST, Status.INITIALISING, Status.TRACKING]
    first, *later = [s.covariance for s in steps[4:]]
    assert first is not None and len(later) >= 3
    sigma_m = float(np.sqrt(np.trace(first[:3, :3])))
    assert sigma_m > 30
    for covariance in later:
        assert covariance is not None
        assert float(np.sqrt(np.trace(covariance[:3, :3]))) > 0.99 * sigma_m


def test_in_the_dark_nothing_is_described(
    flight: Sequence, exposures: list[Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs, described = pairs_of(exposures), []
    rng, describe = np.random.default_rng(0), OpenCvFeatures.detect_and_describe
    monkeypatch.setattr(OpenCvFeatures, "detect_and_describe", lambda *call: described.append(1) or describe(*call))
    shape = pairs[0].left.shape
    night = [np.clip(rng.normal(6, 1.5, shape), 0, 255).astype(np.uint8) for _ in range(4)]
    dark = [Frame.stereo(pairs[i].time_ns, night[0], night[i - 3]) for i in (3, 4, 5, 6)]
    _, steps = run(ModernStereoConfig().build(flight.rig), [*pairs[:3], *dark])
    assert [s.status for s in steps[3:]] == [Status.LOST] * 4 and not described
    assert steps[3].decisions[-1].value == 0 and not steps[3].decisions[-1].passed
