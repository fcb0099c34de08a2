"""Each mistake planted in exact and in noisy pairs is named, with its value; right pairs are silent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ispom.evaluation.audit.auditor import audit
from ispom.evaluation.audit.correction import Correction, undone
from ispom.geometry import Pose, rotation_angle_rad, so3_exp
from ispom.types import Trajectory
from tests.evaluation.audit.made_paths import AWAY, noisy, path, question

TRUTH = path()
EXACT, NOISY = TRUTH.moved(left=AWAY), noisy(TRUTH)
OPENGL, ROS = np.diag([1.0, -1, -1]), np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
ARM = np.array([0.2, -0.25, 0.1])
Change = Callable[[Trajectory], Trajectory]


def later(seconds: float) -> Change:
    return lambda t: replace(t, times_ns=t.times_ns + round(seconds * 1e9))


PLANTED: dict[str, tuple[str, Change]] = {
    "offset": ("offset", later(0.23)),
    "drift": ("drift", lambda t: replace(t, times_ns=np.rint(t.times_ns * 1.01).astype(np.int64))),
    "milliseconds": ("time_unit", lambda t: replace(t, times_ns=1000 * t.times_ns)),
    "inverse": ("inverse", lambda t: undone(t, ("inverse",))),
    "transposed": ("rotations-inverse", lambda t: undone(t, ("rotations-inverse",))),
    "w first": ("w-first", lambda t: undone(t, ("w-last",))),
    "w last": ("w-last", lambda t: undone(t, ("w-first",))),
    "OpenGL": ("axes", lambda t: t.moved(right=Pose(OPENGL, np.zeros(3)))),
    "ROS": ("axes", lambda t: t.moved(right=Pose(ROS, np.zeros(3)))),
    "lever arm": ("lever_arm", lambda t: t.moved(right=Pose(np.eye(3), ARM))),
    "own unit": ("scale", lambda t: replace(t, translations=0.3 * t.translations)),
    "millimetres": ("scale", lambda t: replace(t, translations=1000 * t.translations)),
    "left-handed": ("mirrored", lambda t: undone(t, ("mirrored-y",))),
}


@pytest.mark.parametrize("estimate", [EXACT, NOISY], ids=["exact", "noisy"])
@pytest.mark.parametrize("name", PLANTED)
def test_what_is_planted_is_named_first_and_its_correction_restores_the_errors(name: str, estimate: Trajectory) -> None:
    key, change = PLANTED[name]
    right = question(estimate, TRUTH).measures(Correction())
    found = audit(question(change(estimate), TRUTH))
    assert found and found[0].key == key and not found[0].rivals
    last = found[-1].after
    assert last["poses"] == pytest.approx(right["poses"], abs=12)
    for error, most in (("ate_m", 1e-3), ("ate_deg", 0.05), ("rpe_m", 1e-3)):
        before, after = right[error], last[error]
        assert before is not None and after is not None and after <= 1.3 * before + 2 * most


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("alignment", ["se3", "sim3", "first"])
def test_right_pairs_are_silent(seed: int, alignment: str) -> None:
    true = path(seed)
    estimate = noisy(true, seed) if alignment != "first" else noisy(true, seed, metres=0.002)
    assert not audit(question(estimate, true, alignment))  # type: ignore[arg-type]
    assert not audit(question(true, true, alignment))  # type: ignore[arg-type]


@settings(max_examples=3, deadline=None)
@given(st.floats(-1.5, 1.5).filter(lambda s: abs(s) > 0.05))
def test_a_clock_is_found_to_10_ms_between_different_rates(offset_s: float) -> None:
    true = path(5, rate_hz=50)
    estimate = later(offset_s)(noisy(path(5, rate_hz=15), 5))
    found = audit(question(estimate, true))
    assert [f.key for f in found] == ["offset"]
    assert found[0].values["offset_s"] == pytest.approx(-offset_s, abs=0.01)
    assert 0 < found[0].sigmas["offset_s"] < 0.01


@settings(max_examples=3, deadline=None)
@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3).filter(lambda x: np.linalg.norm(x) > 0.15))
def test_a_lever_arm_is_found_with_its_uncertainty(arm: tuple[float, float, float]) -> None:
    found = audit(question(NOISY.moved(right=Pose(np.eye(3), np.array(arm))), TRUTH))
    assert found[0].key == "lever_arm" and found[0].own.body is not None
    assert found[0].own.body.translation == pytest.approx(-np.array(arm), abs=0.03)


@settings(max_examples=3, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3).filter(lambda x: 0.15 < np.linalg.norm(x) < 3.0))
def test_any_constant_turn_of_the_body_is_found(turn: tuple[float, float, float]) -> None:
    rotation = so3_exp(np.array(turn))
    found = audit(question(NOISY.moved(right=Pose(rotation, np.zeros(3))), TRUTH))
    assert [f.key for f in found] == ["axes"] and found[0].own.body is not None
    assert np.degrees(rotation_angle_rad(rotation @ found[0].own.body.rotation)) < 0.5


def test_files_without_common_times_are_told_by_how_much_they_differ() -> None:
    found = audit(question(later(7200.5)(NOISY), TRUTH))
    assert found[0].key == "offset" and found[0].values["offset_s"] == pytest.approx(-7200.5, abs=0.01)
    assert not found[0].before and found[0].after["ate_m"] is not None


def test_an_offset_after_which_times_fall_between_each_other_widens_the_association() -> None:
    true, estimate = TRUTH.select(slice(0, None, 2)), NOISY.select(slice(1, None, 2))
    (found,) = audit(question(later(1.0)(estimate), true))
    assert found.key == "offset" and found.values["offset_s"] == pytest.approx(-1.0, abs=0.01)
    assert found.own.max_difference_s == pytest.approx(0.05) and (found.after["poses"] or 0) > 250


def test_rows_are_shifted_by_whole_numbers_also_where_files_differ_in_length() -> None:
    rows = replace(NOISY, times_ns=np.arange(len(NOISY), dtype=np.int64) * 10**9)
    true = replace(TRUTH, times_ns=rows.times_ns)
    shorter = rows.select(slice(20, None))
    shorter = replace(shorter, times_ns=shorter.times_ns - shorter.times_ns[0])
    (found,) = audit(question(shorter, true, timed=False))
    assert found.key == "offset" and found.values["offset_s"] == 20


def test_two_mistakes_in_one_file_are_both_found() -> None:
    wrong = later(0.3)(NOISY.moved(right=Pose(ROS, ARM)))
    found = audit(question(wrong, TRUTH))
    assert {f.key for f in found} == {"offset", "axes", "lever_arm"}
    right = question(NOISY, TRUTH).measures(Correction())
    assert found[-1].after["ate_m"] == pytest.approx(right["ate_m"], rel=0.5)


def test_a_lever_arm_is_found_where_one_has_positions_only() -> None:
    prism = TRUTH.moved(right=Pose(np.eye(3), ARM))
    bare = replace(prism, rotations=np.tile(np.eye(3), (len(prism), 1, 1)))
    found = audit(question(NOISY, bare, rotations=(True, False)))
    assert [f.key for f in found] == ["lever_arm"] and found[0].own.body is not None
    assert found[0].own.body.translation == pytest.approx(ARM, abs=0.03)


def test_a_scale_is_no_mistake_where_the_alignment_fits_it() -> None:
    assert not audit(question(replace(NOISY, translations=0.3 * NOISY.translations), TRUTH, "sim3"))


def test_frozen_poses_are_named_with_their_rows_and_excluded() -> None:
    for whose, index in (("reference", 0), ("estimate", 1)):
        pair = [TRUTH, NOISY]
        frozen = pair[index]
        held = np.arange(len(frozen))
        held[200:260] = 199
        pair[index] = replace(frozen, rotations=frozen.rotations[held], translations=frozen.translations[held])
        (found,) = audit(question(pair[1], pair[0]))
        assert (found.key, found.whose, found.rows) == ("frozen", whose, ((200, 260),))
        assert (found.after["ate_m"] or 1) < 1.2 * (question(NOISY, TRUTH).measures(Correction())["ate_m"] or 0)
        assert found.own.excluded_s == found.spans_s


def test_a_body_that_rests_in_both_is_not_frozen() -> None:
    held = np.arange(len(TRUTH))
    held[200:260] = 200
    rests = replace(TRUTH, rotations=TRUTH.rotations[held], translations=TRUTH.translations[held])
    quiet = replace(
        rests, translations=rests.translations + 1e-4 * np.random.default_rng(0).normal(size=(len(rests), 3))
    )
    assert not audit(question(quiet, rests))


def test_a_copied_stretch_is_named() -> None:
    held = np.arange(len(TRUTH))
    held[300:340] = held[100:140]
    copied = replace(TRUTH, rotations=TRUTH.rotations[held], translations=TRUTH.translations[held])
    found = audit(question(NOISY, copied))
    assert found[0].key == "repeated" and found[0].rows == ((301, 340),)


def test_wild_poses_of_the_truth_are_named() -> None:
    wild = TRUTH.translations.copy()
    wild[50] += (9.0, 0, -3)
    wild[333:335] += (0, 20.0, 0)
    (found,) = audit(question(NOISY, replace(TRUTH, translations=wild)))
    assert (found.key, found.whose) == ("spikes", "reference") and found.rows == ((51, 51), (334, 335))


@pytest.mark.parametrize("cuts", [(300,), (200, 400)])
def test_restarts_are_named_with_the_errors_of_the_parts(cuts: tuple[int, ...]) -> None:
    parts = [NOISY.select(part) for part in np.split(np.arange(len(NOISY)), cuts)]
    again = [part.moved(left=part.pose(0).inverse()) for part in parts]
    restarted = Trajectory(
        NOISY.times_ns,
        np.concatenate([part.rotations for part in again]),
        np.concatenate([part.translations for part in again]),
    )
    found = audit(question(restarted, TRUTH))
    assert (found[0].key, found[0].whose) == ("jumps", "estimate")
    assert [round(a * 20) for a, _ in found[0].spans_s] == list(cuts)
    assert len(found[0].parts_m) == len(cuts) + 1 and max(found[0].parts_m) < 0.2 * (found[0].before["ate_m"] or 0)


def test_a_path_at_rest_is_named_and_nothing_else() -> None:
    still = replace(TRUTH, translations=np.zeros_like(TRUTH.translations))
    assert [(f.key, f.whose) for f in audit(question(still, TRUTH))] == [("no_motion", "estimate")]
    assert [(f.key, f.whose) for f in audit(question(TRUTH, still))] == [("no_motion", "reference")]
    assert not audit(question(still, still))


def test_of_paths_of_different_recordings_it_cannot_tell_why() -> None:
    assert [f.key for f in audit(question(noisy(path(8)), TRUTH))] == ["nothing_in_common"]


def test_short_files_have_no_audit() -> None:
    few = TRUTH.select(slice(0, 20))
    assert not audit(question(few, few))
    assert not audit(question(TRUTH.select(slice(0, 1)), TRUTH))


def circling() -> Trajectory:
    """A body that drives in a circle: a lever arm and a scale are the same there."""
    times_ns = np.arange(600, dtype=np.int64) * 50_000_000
    angle = 0.4e-9 * times_ns
    still = np.zeros_like(angle)
    return Trajectory(
        times_ns,
        so3_exp(np.stack([still, still, angle], axis=1)),
        10 * np.stack([np.cos(angle), np.sin(angle), still], axis=1),
    )


@pytest.mark.parametrize("alignment", ["se3", "sim3"])
def test_a_circle_has_no_lever_arm(alignment: str) -> None:
    true = circling()
    assert not audit(question(noisy(true, 0, 0.005, 0.2), true, alignment))  # type: ignore[arg-type]


def test_noise_about_a_point_is_no_other_unit() -> None:
    quiet = replace(TRUTH, translations=1e-4 * TRUTH.translations + 0.002 * np.sin(TRUTH.times_ns[:, None] * 1e-9))
    found = audit(question(noisy(quiet), quiet))
    assert [f.key for f in found] == ["nothing_in_common"]
