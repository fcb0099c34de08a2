"""Verdicts: one sentence about a method at a frame, by its status and its checks."""

from __future__ import annotations

import re

import pytest
from ispom_app.engine.verdict import Severity, verdict, worst

from ispom.estimators.modern.monocular import checks as monocular
from ispom.estimators.modern.second_motion import SECOND_MOTION
from ispom.estimators.modern.stereo import checks as stereo
from ispom.estimators.paper import checks as paper
from ispom.estimators.survey.multicamera import METRE
from ispom.methods import BUILT_IN, method
from ispom.types import Check, Decision, Status, Step

FALSE = re.compile(r"[<>≤≥]")


def step(method: str, status: Status, *decisions: Decision, **more: object) -> Step:
    return Step(0, status, decisions=decisions, method=method, **more)  # type: ignore[arg-type]


def found(method: str, status: Status, *decisions: Decision, values: dict | None = None, **more: object):
    return verdict(step(method, status, *decisions, **more), 7, values or {})


def test_tracking_says_by_how_many_matches() -> None:
    made = found("stereo", Status.TRACKING, stereo.GUIDED_POINTS.of(345, 120), stereo.POINTS_LEFT.of(0.86, 0.6))
    assert (made.severity, made.headline, made.decisive and made.decisive.key) == ("ok", "Tracking", "guided_points")
    assert made.sentence == "Tracking: 345 matches (minimum 120)." and not made.failed


def test_what_failed_first_and_passed_later_is_no_failure() -> None:
    """The prediction was poor, and another way found the pose."""
    ways = stereo.GUIDED_POINTS.of(20, 120), stereo.NEARBY_POINTS.of(150, 120)
    made = found("stereo", Status.TRACKING, *ways)
    assert (made.severity, made.failed, made.decisive) == (Severity.OK, (), ways[1])


def test_a_keyframe_says_why() -> None:
    tests = monocular.PARALLAX.of(1, 2.5), monocular.VIEW_ANGLE.of(12, 10)
    made = found("monocular", Status.TRACKING, monocular.POSE_POINTS.of(200, 15), *tests, key_frame=True)
    assert made.severity == Severity.KEYFRAME and "200" in made.detail and "rotated 12 deg" in made.detail
    assert "parallax" not in made.detail


def test_lost_says_which_number_was_too_low_and_what_follows() -> None:
    failed = monocular.POSE_POINTS.of(9, 15, "a new map starts from the last pose")
    made = found("monocular", Status.LOST, failed)
    assert (made.severity, made.headline, made.decisive) == (Severity.LOST, "Lost", failed)
    assert all(word in made.detail for word in ("9", "15", "a new map starts"))
    assert found("monocular", Status.LOST).sentence.startswith("Lost: ")


def test_a_warning_comes_before_the_good_news() -> None:
    spread = paper.SCALE_SPREAD.of(51, 20, "82 ratios suggest ×3.17, used ×1.72")
    made = found("monocular.paper", Status.TRACKING, paper.RESECTED_POINTS.of(80, 12), spread, values={"inliers": 80})
    assert (made.severity, made.headline, made.decisive) == (Severity.WARNING, "Scale unreliable", spread)
    assert all(part in made.sentence for part in ("51 %", "20 %", "×3.17", "×1.72"))


def test_of_several_warnings_the_one_farthest_beyond_its_limit_decides() -> None:
    scale, motion = monocular.SCALE_DRIFT.of(10.5, 10), SECOND_MOTION.of(0.3, 0.1)
    made = found("monocular", Status.TRACKING, monocular.POSE_POINTS.of(200, 15), scale, motion)
    assert made.decisive is motion and made.failed == (motion, scale)


def test_without_a_map_it_says_what_is_missing() -> None:
    made = found("monocular", Status.INITIALISING, monocular.START_PARALLAX.of(0.3, 1, "the position is held"))
    assert (made.severity, made.headline) == (Severity.PROVISIONAL, "No map yet")
    assert all(part in made.detail for part in ("0.3 deg", "1 deg", "held"))
    assert found("integrated", Status.INITIALISING).sentence == "No pose yet: waiting for Monocular and Stereo."
    assert found("monocular", Status.INITIALISING, SECOND_MOTION.of(0.3, 0.1)).severity == Severity.WARNING


def test_the_first_map_is_named() -> None:
    made = found(
        "monocular", Status.TRACKING, monocular.AMBIGUITY.of(3, 1.5), values={"landmarks": 214}, key_frame=True
    )
    assert (made.headline, made.detail) == ("Map initialised", "214 points")


def test_without_a_check_the_residuals_speak() -> None:
    made = found("integrated", Status.TRACKING, values={"inliers": 412, "residual_median_px": 0.2149})
    assert made.sentence == "Tracking: 412 inliers, median residual 0.215 px."
    assert found("integrated", Status.TRACKING).sentence == "Tracking."


def test_a_method_without_words_of_its_own_gets_a_verdict_from_its_checks() -> None:
    few = Decision("tracks that agree", 8, 15, False, key="agree")
    odd = Decision("shutter", 9, 5, False, "ms", "<=", key="shutter", kind="warning")
    lost = found("stereo", Status.LOST, few)
    assert lost.sentence == "Lost: tracks that agree: 8 (minimum 15)."
    assert found("stereo", Status.TRACKING, odd).sentence == "Warning: shutter: 9 ms (limit 5 ms)."
    assert found("stereo", Status.TRACKING, Decision("odd", 1, 2, False, kind="finding")).severity == Severity.OK


@pytest.mark.parametrize("name", BUILT_IN)
def test_no_check_prints_a_comparison_that_is_false(name: str) -> None:
    for check in method(name).checks.values():
        for value, threshold in ((0.5, 2.0), (2.0, 0.5)):
            decision = check.of(value, threshold)
            for status in Status:
                made = verdict(step(name, status, decision), 0, {})
                assert made.headline and not FALSE.search(made.sentence), made.sentence
                assert made.sentence.endswith(".") and ".." not in made.sentence and made.detail[-1:] != "."


def test_each_built_in_method_that_finds_poses_has_a_topic() -> None:
    for each in map(method, BUILT_IN):
        topics = {check.topic for check in each.checks.values()}
        assert "pose" in topics or each.asks, each.name


def test_the_worst_of_several() -> None:
    ok, lost = found("stereo", Status.TRACKING), found("stereo", Status.LOST)
    assert worst([ok, lost, ok]) == Severity.LOST and worst([]) == Severity.OK
    assert Severity.LOST.alarming and not Severity.KEYFRAME.alarming


def test_a_check_may_have_its_headline_in_its_sentence() -> None:
    assert Check("a", "b", "warning", passes="Fine.", fails="Lens dirty: {value} spots.").topic == ""


def test_a_pose_from_before_the_first_fit_is_provisional() -> None:
    made = found("integrated", Status.TRACKING, values={"inliers": 12}, provisional=True)
    assert (made.severity, made.headline) == (Severity.PROVISIONAL, "Provisional pose")


def test_a_pose_in_a_guessed_unit_says_so() -> None:
    made = found("multicamera", Status.TRACKING, METRE.of(100.0, 0.05), provisional=True)
    assert (made.severity, made.headline) == (Severity.PROVISIONAL, "Provisional pose")
    assert made.decisive is not None and made.decisive.key == "metre_sigma"
