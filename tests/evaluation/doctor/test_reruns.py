"""When a setting helps, on made outcomes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.evaluation.doctor.diagnose import with_reruns
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Finding, Ranked, Suspect
from ispom.evaluation.doctor.reruns import Outcome, Reruns, Trial, Tried
from ispom.geometry import Pose
from ispom.settings import alternatives
from ispom.types import Decision, Status, Step

FRAMES = 40
"""Of which a change of two is needed."""
MORE = Trial("stereo", "max_tracks", 100, 200)


def outcome(located: int, failing: int = 0, segments: int = 0, residual_px: float = 0.3) -> Outcome:
    failed = {"described_points": failing} if failing else {}
    return Outcome(FRAMES, dict.fromkeys(range(located), residual_px), segments, failed, failing)


def tried(own: Iterable[Outcome], other: Iterable[Outcome]) -> Tried:
    return Tried(MORE, tuple(own), tuple(other))


def test_more_frames_located_in_all_repetitions_help() -> None:
    assert tried([outcome(32)] * 3, [outcome(30)] * 3).helps
    assert not tried([outcome(31)] * 3, [outcome(30)] * 3).helps


def test_what_noise_alone_does_is_no_help() -> None:
    assert not tried([outcome(36)] * 3, [outcome(30), outcome(36), outcome(31)]).helps
    assert not tried([outcome(36), outcome(30), outcome(36)], [outcome(30)] * 3).helps


def test_fewer_checks_that_failed_help_where_no_frame_is_lost() -> None:
    assert tried([outcome(30, failing=2)] * 3, [outcome(30, failing=4)] * 3).helps
    assert not tried([outcome(29, failing=2)] * 3, [outcome(30, failing=4)] * 3).helps


def test_a_segment_fewer_helps_and_one_more_does_not() -> None:
    assert tried([outcome(30)] * 3, [outcome(30, segments=1)] * 3).helps
    assert not tried([outcome(38, segments=2)] * 3, [outcome(30, segments=1)] * 3).helps


def test_the_first_segment_of_a_stretch_without_any_is_no_loss() -> None:
    assert tried([outcome(20, segments=1)] * 3, [outcome(0)] * 3).helps


def test_worse_poses_that_are_only_accepted_do_not_help() -> None:
    assert not tried([outcome(38, residual_px=1.5)] * 3, [outcome(30)] * 3).helps


def test_what_is_lost_again_after_the_stretch_is_only_delayed() -> None:
    better = tried([outcome(30)] * 3, [outcome(30, segments=1)] * 3)
    assert replace(better, later=(outcome(40), outcome(40))).helps
    delayed = replace(better, later=(outcome(40, segments=1), outcome(40)))
    assert not delayed.helps and delayed.only_delays and not delayed.finding.found


def with_error(error_m: float | None, located: int = 40, alarms: Iterable[str] = ()) -> Outcome:
    return replace(outcome(located), error_m=error_m, alarms=Counter(alarms))


def test_an_error_that_falls_by_a_third_in_all_repetitions_helps() -> None:
    found = tried([with_error(0.144)] * 3, [with_error(0.947), with_error(0.8), with_error(0.9)])
    assert found.helps and found.finding.values["error_m"] == 0.144
    assert found.finding.values["error_unchanged_m"] == 0.947
    assert "947 mm" in found.finding.evidence and "144 mm" in found.finding.evidence
    assert not tried([with_error(0.7)] * 3, [with_error(0.947)] * 3).helps
    assert not tried([with_error(0.144), with_error(0.9), with_error(0.144)], [with_error(0.947)] * 3).helps


def test_an_error_that_rises_is_no_help_and_a_few_frames_are_no_loss() -> None:
    assert not tried([with_error(0.9)] * 3, [with_error(0.1, located=30)] * 3).helps
    assert tried([with_error(0.1, located=39)] * 3, [with_error(0.9)] * 3).helps
    assert not tried([with_error(0.1, located=20)] * 3, [with_error(0.9)] * 3).helps


def test_a_rerun_without_the_event_explains_it() -> None:
    clean, doubtful = with_error(None), with_error(None, alarms=["scale", "scale"])
    explained = replace(tried([clean] * 3, [doubtful] * 3), event="scale")
    assert explained.helps
    assert not replace(explained, event="lost").helps
    assert not replace(explained, unchanged=(doubtful, clean, doubtful)).helps
    assert not replace(explained, outcomes=(clean, doubtful, clean)).helps


def test_a_setting_set_back_comes_before_what_images_show() -> None:
    dark = Ranked(Suspect("darkness", "", "images", "", lambda seen: None), Finding(9.0, ""))
    trials = (tried([with_error(0.1)] * 3, [with_error(0.9)] * 3),)
    found = with_reruns(Diagnosis(0, 50, (dark,)), Reruns(0, 50, trials, set_back=True))
    assert [each.suspect.key for each in found.causes] == ["stereo.max-tracks", "darkness"]
    assert found.helped is found.set_back and found.reruns is None
    assert "fork" not in found.causes[0].suspect.remedy


def test_an_outcome_counts_frames_checks_and_segments() -> None:
    failed = Decision("few", 1.0, 2.0, False, key="few")
    steps = [
        Step(0, Status.TRACKING, world_from_frame=Pose(), restarted=True),
        Step(1, Status.TRACKING, world_from_frame=Pose(), provisional=True),
        Step(2, Status.LOST, world_from_frame=Pose(), decisions=(failed,)),
    ]
    found = Outcome.of(enumerate(steps, 7))
    assert (found.frames, list(found.located), found.segments) == (3, [7], 1)
    assert found.failed == {"few": 1} and found.failing == 1


def test_the_best_value_of_a_setting_is_a_suspect() -> None:
    better, other = tried([outcome(36)] * 3, [outcome(30)] * 3), tried([outcome(30)], [outcome(30)])
    found = with_reruns(Diagnosis(0, 50, ()), Reruns(10, 50, (other, better)))
    assert [each.suspect.key for each in found.causes] == ["stereo.max-tracks"]
    assert "--stereo.max-tracks 200" in found.causes[0].suspect.remedy and "--at 10" in found.causes[0].suspect.remedy
    assert found.causes[0].finding.frames and set(found.causes[0].finding.frames) <= set(range(30, 36))


def test_options_are_those_of_the_command_line() -> None:
    assert Trial("stereo", "relocalise", True, False).option == "--stereo.no-relocalise"
    assert Trial("stereo", "relocalise", False, True).option == "--stereo.relocalise"
    assert Trial("stereo", "max_error_px", 2.5, 5.0).option == "--stereo.max-error-px 5"


def test_alternatives_are_the_default_and_what_is_worth_trying_within_the_range() -> None:
    found = alternatives(ModernStereoConfig(max_tracks=2000, relocalise=False))
    assert found[:2] == (("max_tracks", 400), ("relocalise", True))
    assert [value for name, value in found if name == "max_tracks"] == [400, 3000, 1000]
    assert not any(name == "min_inliers" for name, _ in found)
