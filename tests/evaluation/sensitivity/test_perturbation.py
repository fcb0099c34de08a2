from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from ispom.evaluation.sensitivity.effect import shift_m
from ispom.evaluation.sensitivity.perturbation import Perturbation, predict_integrated
from ispom.geometry import Pose
from ispom.simulation.cameras import simulated_rig
from ispom.types import EXACT_LENS, EXACT_PAIR, Frame, Sequence, Trajectory

IMAGE = np.zeros((2, 2), np.uint8)


def sequence() -> Sequence:
    """A video frame each 10 ms, a pair after every second of them."""
    stamps = [(10 * i, "video") for i in range(6)] + [(20 * i + 4, "stereo") for i in range(3)]
    stamps.sort()
    times, kinds = np.array([t * 1_000_000 for t, _ in stamps]), tuple(kind for _, kind in stamps)

    def load(i: int):
        return Frame.video(int(times[i]), IMAGE) if kinds[i] == "video" else Frame.stereo(int(times[i]), IMAGE, IMAGE)

    truth = Trajectory.of([(int(t), Pose(translation=np.array([t * 1e-9, 0, 0]))) for t in times])
    return Sequence("made", simulated_rig(0.5), times, kinds, load, truth)


def test_each_part_changes_its_own_numbers_and_no_others() -> None:
    rig = simulated_rig()
    stated_rig = Perturbation(pair_focal_percent=1, baseline_percent=-2, turn_y_deg=0.5, shift_z_m=0.01).of_rig(rig)
    assert stated_rig.video == rig.video
    assert stated_rig.camera("left").fx == pytest.approx(1.01 * rig.camera("left").fx)
    assert stated_rig.camera("left").cx == rig.camera("left").cx
    assert stated_rig.baseline_m == pytest.approx(0.98 * rig.baseline_m)
    middle = [(r.rig_from_left.translation + r.rig_from_right.translation) / 2 for r in (rig, stated_rig)]
    np.testing.assert_allclose(middle[0], middle[1], atol=1e-12)
    way = stated_rig.rig_from_video @ rig.rig_from_video.inverse()
    assert np.degrees(np.linalg.norm(way.rotvec)) == pytest.approx(0.5)
    np.testing.assert_allclose(stated_rig.rig_from_video.translation - rig.rig_from_video.translation, [0, 0, 0.01])


def test_nothing_wrong_is_the_same_sequence() -> None:
    found = Perturbation().of_sequence(sequence())
    np.testing.assert_array_equal(found.times_ns, sequence().times_ns)
    np.testing.assert_array_equal(found.rig.rig_from_video.matrix, sequence().rig.rig_from_video.matrix)


def test_a_later_clock_moves_video_stamps_and_their_truth_and_keeps_the_order_of_time() -> None:
    found = Perturbation(clock_ms=7).of_sequence(sequence())
    assert (np.diff(found.times_ns) >= 0).all()
    for i, kind in enumerate(found.kinds):
        assert found[i].time_ns == found.times_ns[i]
        truth = found.truth.at(int(found.times_ns[i])) if found.truth is not None else None
        late_s = 0.007 if kind == "video" else 0.0
        assert truth is not None and truth.translation[0] == pytest.approx(found.times_ns[i] * 1e-9 - late_s)


def test_every_field_has_a_range_and_starts_at_none() -> None:
    assert Perturbation().nonzero == {}
    for field in fields(Perturbation):
        assert Perturbation(**{field.name: 1.0}).nonzero == {field.name: 1.0}


def path(duration_s: float, bend: float) -> Trajectory:
    """world_from_rig at 100 Hz, 1 m/s."""
    items = []
    for i in range(round(100 * duration_s) + 1):
        t = i / 100
        pose = Pose.from_rotvec(np.array([0, bend * t, 0]), np.array([bend * t**2, 0.0, t]))
        items.append((i * 10_000_000, pose))
    return Trajectory.of(items)


def test_an_integration_meets_the_poses_of_the_pairs_whatever_calibration_the_video_gets() -> None:
    run, rig = path(3.0, 0.2), simulated_rig()
    pairs = run.select(np.arange(0, 301, 30))
    wrong = Perturbation(turn_y_deg=0.5, shift_x_m=0.02)
    found = predict_integrated(run, pairs, rig, wrong)
    assert shift_m(pairs, found, "none") < 1e-9
    assert shift_m(run, found, "none") < 1e-3
    assert shift_m(run, predict_integrated(run, pairs, rig, Perturbation()), "none") < 1e-9


def test_an_integration_follows_pairs_that_move() -> None:
    run, rig = path(3.0, 0.2), simulated_rig()
    pairs = run.select(np.arange(0, 301, 30))
    farther = replace(pairs, translations=1.01 * pairs.translations)
    found = predict_integrated(run, farther, rig, Perturbation())
    np.testing.assert_allclose(found.translations, 1.01 * run.translations, atol=1e-3)


def test_a_wrong_clock_reports_where_the_rig_was_at_the_wrong_time() -> None:
    run, rig = path(3.0, 0.0), simulated_rig()
    pairs = run.select(np.arange(0, 301, 30))
    found = predict_integrated(run, pairs, rig, Perturbation(clock_ms=10))
    inside = found.select(np.arange(30, 270))
    ahead = inside.translations[:, 2] - run.translations[30:270, 2]
    np.testing.assert_allclose(ahead, 0.010, atol=1e-6)


def test_a_wrong_rig_does_not_say_that_it_is_exact() -> None:
    rig = simulated_rig()
    for wrong, video, pair in (
        (Perturbation(), EXACT_LENS, EXACT_PAIR),
        (Perturbation(video_focal_percent=1), None, EXACT_PAIR),
        (Perturbation(pair_centre_x_px=1), EXACT_LENS, None),
        (Perturbation(baseline_percent=1), EXACT_LENS, None),
        (Perturbation(turn_x_deg=1, clock_ms=1), EXACT_LENS, EXACT_PAIR),
    ):
        stated_rig = wrong.of_rig(rig)
        assert (stated_rig.video_sigma, stated_rig.pair_sigma) == (video, pair)
