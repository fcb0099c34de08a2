"""Stereo levels its pair: row offsets and turns of the right image, images of different moments, and level pairs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ispom.estimators.modern.stereo import estimator
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.estimators.modern.stereo.level import (
    AGREEING,
    CHANGES,
    EVERY,
    FORGOTTEN,
    LEVELLED,
    PATIENCE,
    Level,
    Measured,
    RowOffsets,
)
from ispom.estimators.modern.stereo.pair import Setup
from ispom.evaluation.trajectory_error import trajectory_error
from ispom.features.pair_rows import LEVELLED_PX
from ispom.geometry import Array
from ispom.io.trajectories import read_tum
from ispom.sequences import open_sequence
from ispom.simulation.scenario.calibrations import Unlevel, WrongPair
from ispom.solvers.right_camera import FOCAL, OFFSET_Y, PAIR, PITCH, ROLL, YAW, by_column, by_row
from ispom.types import Decision, Frame, Rig, Sequence, Status, Step, is_stereo
from tests.alone import alone, run, stepped_through
from tests.estimators.modern.setups import setup_of

DATA = Path(__file__).parents[4] / "shared/data"
SAID = {"levelled", "rows_changed", "different_moments"}
PAIRS = 5
CONFIG = ModernStereoConfig()


def pairs_of(sequence: Sequence, count: int = PAIRS) -> list[Frame]:
    found = [i for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    return [pair for i in found[:count] if is_stereo(pair := sequence[i])]


def steps_of(rig: Rig, pairs: list[Frame], config: ModernStereoConfig = CONFIG) -> list[Step]:
    return list(run(config.build(rig), pairs))


def about_level(step: Step) -> list[Decision]:
    return [d for d in step.decisions if d.key in SAID]


def error_m(sequence: Sequence, steps: list[Step]) -> float:
    """The largest error of a position, of located frames."""
    assert sequence.truth is not None
    first = sequence.truth.at(steps[0].time_ns)
    assert first is not None
    errors = []
    for step in steps:
        true = sequence.truth.at(step.time_ns)
        if step.world_from_frame is not None and true is not None:
            errors.append(np.linalg.norm((first @ step.world_from_frame).translation - true.translation))
    return float(max(errors))


# The fit


def seen(truth: Array, noise: float, seed: int = 0, count: int = 150) -> RowOffsets:
    """Points of a pair with focal length 460 whose right camera has these errors (E,); `noise` is normalised."""
    rng = np.random.default_rng(seed)
    left = rng.uniform((-0.6, -0.5), (0.6, 0.5), (count, 2))
    disparity = rng.uniform(0.005, 0.1, count)
    ideal = np.column_stack([left[:, 0] - disparity, left[:, 1]])
    right = ideal.copy()
    right[:, 0] += by_column(ideal, disparity) @ truth[:OFFSET_Y]
    right[:, 1] += by_row(ideal, disparity, np.zeros_like(ideal)) @ truth
    return RowOffsets(left, right + noise * rng.standard_normal(right.shape))


def wrong(**values: float) -> Array:
    """Errors (E,) of the right camera: `offset` [px], the others [deg]."""
    out = np.zeros(PAIR)
    out[OFFSET_Y] = values.pop("offset", 0.0) / 460
    for name, value in values.items():
        out[{"pitch": PITCH, "yaw": YAW, "roll": ROLL}[name]] = np.radians(value)
    return out


@cache
def setup() -> Setup:
    rig = open_sequence("sim:tiny", seed=0).rig.changed(pair_sigma=None)
    return setup_of(ModernStereoConfig().build(rig))


@pytest.mark.parametrize(
    "truth",
    [wrong(offset=3.1), wrong(offset=-6), wrong(roll=0.8), wrong(offset=5, pitch=0.6, roll=-0.5), wrong(yaw=1.5)],
)
def test_exact_rows_give_offset_and_turns(truth: Array) -> None:
    found = Measured.of(setup(), seen(truth, 0.0), np.zeros(PAIR))
    assert found.terms == pytest.approx(truth, abs=2e-4)  # 0.1 px
    assert (found.terms != 0).sum() == (truth != 0).sum()


def test_noisy_rows_give_them_within_their_standard_deviations() -> None:
    truth, ratios = wrong(offset=4, pitch=1.2, yaw=-1.5, roll=0.4), []
    for seed in range(20):
        found = Measured.of(setup(), seen(truth, 0.25 / 460, seed), np.zeros(PAIR))
        which = list(LEVELLED)
        ratios.append((found.terms - truth)[which] / found.sigma[which])
    spread = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert (spread < 1.3).all() and np.abs(ratios).max() < 4


def test_what_is_known_or_not_significant_is_not_corrected() -> None:
    truth = wrong(offset=0.9, roll=0.3)
    offsets = seen(truth, 0.25 / 460)
    assert not Measured.of(setup(), offsets, truth).terms.any()
    assert set(np.flatnonzero(Measured.of(setup(), offsets, np.zeros(PAIR)).terms)) == {OFFSET_Y, ROLL}
    focal = np.zeros(PAIR)
    focal[FOCAL] = 0.003  # two standard deviations of the prior: no turn
    assert not Measured.of(setup(), seen(focal, 0.25 / 460), np.zeros(PAIR)).terms.any()


# The judgement, from pair to pair


def measured_at(offset_px: float) -> Measured:
    return Measured.of(setup(), seen(wrong(offset=offset_px), 0.05 / 460), np.zeros(PAIR))


def judged(offsets_px: list[float], level: Level | None = None) -> tuple[Level, list[list[str]]]:
    """The level after pairs with these offsets of the images as given, none of which fits, and what was said."""
    level, decided = level or Level(), []
    for offset_px in offsets_px:
        level, decisions = level.after(measured_at(offset_px - 460 * float(level.terms[OFFSET_Y])))
        decided.append([d.key for d in decisions])
    return level, decided


def test_the_first_pair_is_levelled_and_the_next_ones_agree() -> None:
    level, decided = judged([3.1, 3.3, 2.9])
    assert decided == [["levelled"], [], []]
    assert 460 * level.terms[OFFSET_Y] == pytest.approx(3.1, abs=0.1)


def test_an_offset_that_changes_from_pair_to_pair_is_of_different_moments_and_not_corrected() -> None:
    for offsets in ([-5.0, 3.0, -1.0, 2.0], [0.2, 3.0, -2.0, 1.5]):
        level, decided = judged(offsets)
        assert decided[1:] == [["rows_changed"], ["different_moments"], ["different_moments"]]
        assert level.moments and not level.terms.any()


def test_a_camera_that_was_moved_is_levelled_again_once_some_pairs_agree() -> None:
    level = Level()
    for _ in range(FORGOTTEN):
        level = level.agreeing()
    level, decided = judged([4.0] * AGREEING, level)
    assert decided == [*[["rows_changed"]] * (AGREEING - 1), ["levelled"]]
    assert 460 * level.terms[OFFSET_Y] == pytest.approx(4, abs=0.1) and not level.moments


def test_single_pairs_that_differ_once_in_a_while_are_no_different_moments() -> None:
    level = judged([0.1])[0]
    for _ in range(3 * CHANGES):
        level = judged([5.0], level)[0]
        for _ in range(FORGOTTEN):
            level = level.agreeing()
    assert not level.moments and not level.terms.any()


def test_what_is_beyond_the_reach_is_said_and_not_corrected() -> None:
    level, (first, second) = judged([LEVELLED_PX + 4] * 2)
    assert first == second == ["levelled"] and not level.terms.any()
    _, (decision,) = Level().after(measured_at(LEVELLED_PX + 4))
    assert not decision.passed and decision.value == pytest.approx(LEVELLED_PX + 4, abs=0.1)


def test_pairs_that_tell_nothing_are_measured_now_and_then_only() -> None:
    level, due = Level(), 0
    for _ in range(40):
        due += level.is_due
        level, decisions = level.after(None)
        assert not decisions
    assert due <= PATIENCE + 40 // EVERY and level.agreeing().is_due


# The method


@pytest.mark.parametrize("rows_px", [-6.0, -1.5, 1.5, 3.1, 6.0])
def test_a_right_image_that_is_too_high_or_too_low_is_levelled(flight: Sequence, rows_px: float) -> None:
    sequence = Unlevel(rows_px=rows_px).on(flight, 0)
    steps = steps_of(sequence.rig, pairs_of(sequence))
    (decision,) = about_level(steps[0])
    assert decision.key == "levelled" and decision.passed and decision.value == pytest.approx(abs(rows_px), abs=0.15)
    assert not any(about_level(step) for step in steps[1:])
    assert all(step.status is Status.TRACKING for step in steps[1:])
    assert error_m(sequence, steps) < 0.01
    pair = steps[-1].calibration.pair
    assert pair is not None and pair.covariance is not None
    f, sigma = flight.rig.camera("left").fx, np.sqrt(np.diag(pair.covariance))[OFFSET_Y]
    assert abs(pair.offset_y_rad - rows_px / f) < 4 * sigma


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.6, 0.0), (-0.4, 0.5), (0.0, -0.8)])
def test_a_right_camera_that_was_turned_is_levelled(flight: Sequence, pitch_deg: float, roll_deg: float) -> None:
    sequence = WrongPair(pitch_deg=pitch_deg, yaw_deg=0.0, roll_deg=roll_deg).on(flight, 0)
    steps = steps_of(sequence.rig, pairs_of(sequence))
    assert [d.key for d in about_level(steps[0])] == ["levelled"] and not any(about_level(step) for step in steps[1:])
    assert all(step.status is Status.TRACKING for step in steps[1:])
    assert error_m(sequence, steps) < 0.015
    pair = steps[-1].calibration.pair
    assert pair is not None and pair.covariance is not None
    sigma = np.sqrt(np.diag(pair.covariance))
    assert abs(abs(pair.roll_rad) - np.radians(abs(roll_deg))) < 4 * sigma[ROLL]
    assert abs(abs(pair.offset_y_rad) - np.radians(abs(pitch_deg))) < 4 * sigma[OFFSET_Y]


def test_the_integration_takes_the_level_pair(flight: Sequence) -> None:
    sequence = Unlevel(rows_px=-3.1, roll_deg=0.5).on(flight, 0)
    method = alone("integrated", sequence.rig)
    state, steps = stepped_through(method, (sequence[i] for i in range(40)))
    assert sum(step.status is Status.TRACKING for step in steps) >= len(steps) - 2
    assert sequence.truth is not None
    error = trajectory_error(method.finish(state), sequence.truth, "se3")
    assert error is not None and error.ate_m < 0.005


def test_disparities_are_those_of_the_images_as_given(flight: Sequence) -> None:
    """Points in rows below the middle move to one side as the image is turned."""
    plain, turned = flight, Unlevel(rows_px=0, roll_deg=0.8).on(flight, 0)
    before, after = (steps_of(each.rig, pairs_of(each, 1))[0].tracks["left"] for each in (plain, turned))
    camera = flight.rig.camera("left")
    found = {tuple(uv): d for uv, d in zip(before.uv, before.disparity_px, strict=True)}
    now = zip(after.uv, after.disparity_px, strict=True)
    both = [(uv, found[tuple(uv)], d) for uv, d in now if tuple(uv) in found]
    y = np.array([uv[1] - camera.cy for uv, _, _ in both])
    moved = np.array([d - level for _, level, d in both])
    assert len(both) > 100
    assert np.median(np.abs(moved - np.radians(0.8) * y)) < 0.1


def test_a_level_pair_gets_the_same_bytes_and_nothing_is_said(
    flight: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs, rig = pairs_of(flight), flight.rig.changed(pair_sigma=None)
    steps = steps_of(rig, pairs)
    monkeypatch.setattr(estimator, "on_level_pair", lambda setup, state, given, advance: (advance(state, given), given))
    for step, plain in zip(steps, steps_of(rig, pairs), strict=True):
        assert step.decisions == plain.decisions and not about_level(step)
        tracks, same = step.tracks["left"], plain.tracks["left"]
        assert tracks.uv.tobytes() == same.uv.tobytes() and tracks.disparity_px.tobytes() == same.disparity_px.tobytes()
        assert step.world_from_frame is not None and plain.world_from_frame is not None
        assert step.world_from_frame.matrix.tobytes() == plain.world_from_frame.matrix.tobytes()


def test_a_pair_that_is_held_as_calibrated_is_not_levelled(flight: Sequence) -> None:
    sequence = Unlevel(rows_px=3.1).on(flight, 0)
    assert not any(
        map(about_level, steps_of(sequence.rig, pairs_of(sequence, 2), replace(CONFIG, self_calibration=False)))
    )


def test_a_pair_that_is_moved_on_the_way_is_levelled_again(flight: Sequence) -> None:
    pairs, lower = pairs_of(flight), pairs_of(Unlevel(rows_px=4).on(flight, 0))
    rig = flight.rig.changed(pair_sigma=None)
    steps = steps_of(rig, [*pairs[:2], *lower[2:]])
    decided = [[d.key for d in about_level(step)] for step in steps]
    assert decided == [[], [], *[["rows_changed"]] * (AGREEING - 1), ["levelled"]][: len(steps)]


@pytest.mark.parametrize("late_ms", [-60, 60])
def test_images_of_different_moments_are_named(rendered: Path, late_ms: int) -> None:
    """A moving rig, whose right images are late or early by less than a pair's interval."""
    sequence = open_sequence(f"sim:tiny?right_late_ms={late_ms}&width_px=400", seed=0, cache_dir=rendered)
    steps = steps_of(sequence.rig.changed(pair_sigma=None), pairs_of(sequence))
    decided = [d.key for step in steps for d in about_level(step)]
    assert "different_moments" in decided
    last = decided.index("different_moments")
    assert set(decided[last:]) == {"different_moments"}


@pytest.mark.skipif(not (DATA / "hard/rover_unlevel").is_dir(), reason="../shared/data/hard/rover_unlevel is absent")
def test_a_rover_s_pair_is_levelled_at_its_first_frame() -> None:
    folder = DATA / "hard/rover_unlevel"
    sequence, truth = open_sequence(str(folder / "sequences/32")), read_tum(folder / "truth.tum")
    stereo = CONFIG.build(sequence.rig)
    state, steps = stepped_through(stereo, pairs_of(sequence, 50))
    assert sum(step.status is Status.TRACKING for step in steps) >= 48
    assert [d.key for step in steps for d in about_level(step)] == ["levelled"] and about_level(steps[0])
    error = trajectory_error(stereo.finish(state), truth, "se3")
    assert error is not None and error.ate_m < 0.02 * truth.length
