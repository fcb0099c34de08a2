"""The events of a run, as they are found frame by frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from ispom_app.engine.events import Bookmark
from ispom_app.engine.history.quantities import NO_ROW, row_after
from ispom_app.engine.run_events import kinds, log
from ispom_app.engine.run_events.event import event_kinds, nearest, with_bookmarks
from ispom_app.engine.run_events.log import EventLog
from ispom_app.engine.verdict import Severity

from ispom.estimators.modern.loops.checks import LOOP_VIEWS
from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.second_motion import SECOND_MOTION
from ispom.estimators.modern.stereo.checks import LEVELLED
from ispom.geometry import Pose
from ispom.types import Decision, Landmarks, Status, Step

T, L, INIT = Status.TRACKING, Status.LOST, Status.INITIALISING
FOUND = checks.POSE_POINTS.of(200, 15)


def step(status: Status = T, *decisions: Decision, x: float | None = None, **more: object) -> Step:
    pose = None if x is None else Pose(translation=np.array([x, 0.0, 0.0]))
    return Step(0, status, "video", pose, decisions=decisions, method="monocular", **more)  # type: ignore[arg-type]


def logged(steps: Iterable[Step | None], into: EventLog | None = None, *, start: int = 0, row=NO_ROW) -> EventLog:
    """The events of a run that takes these steps; None is a frame that the method does not use."""
    found = EventLog() if into is None else into
    for frame, one in enumerate(steps, start):
        before, made = row, () if one is None else (one,)
        row = row_after(before, frame, frame, made, {})
        found.add(frame, frame, made, before, row)
    return found


def told(found: EventLog) -> list[tuple[str, int, int | None]]:
    return [(event.kind, event.frame, event.until) for event in found.events]


def test_a_loss_is_one_event_from_its_first_frame_to_its_end() -> None:
    found = logged([step(T), step(L), step(L), step(T, FOUND), step(T), step(L)])
    assert told(found) == [("lost", 1, 3), ("relocalised", 3, 4), ("lost", 5, None)]
    assert [e.severity for e in found.events] == ["lost", "ok", "lost"]
    assert "200 inliers" in found.events[1].sentence and found.events[0].length == 2


def test_a_first_map_and_one_after_a_loss_are_maps_and_no_relocalisation() -> None:
    new = checks.AMBIGUITY.of(3, 1.5)
    found = logged([step(INIT), step(INIT), step(T, new), step(L), step(T, new)])
    assert told(found) == [("map", 2, 3), ("lost", 3, 4), ("map", 4, None)]


def test_a_map_that_goes_on_while_another_is_made_is_relocalised_and_no_new_map() -> None:
    scene = Landmarks(np.arange(3), np.ones((3, 3)), np.zeros((3, 3), np.uint8))
    found = logged([step(INIT), step(T, landmarks=scene), step(L), step(INIT), step(T, landmarks=scene)])
    assert told(found) == [("map", 1, 2), ("lost", 2, 3), ("relocalised", 4, None)]


def test_a_method_without_points_of_the_scene_makes_no_map() -> None:
    assert told(logged([step(INIT), step(T), step(T)])) == []
    scene = Landmarks(np.arange(3), np.ones((3, 3)), np.zeros((3, 3), np.uint8))
    assert told(logged([step(INIT), step(T, landmarks=scene), step(T)])) == [("map", 1, 2)]


def test_a_method_without_a_step_at_a_frame_changes_nothing() -> None:
    assert told(logged([step(T), None, step(L), None, step(L), None, step(T)])) == [
        ("lost", 2, 6),
        ("relocalised", 6, None),
    ]


def test_a_new_segment_is_reported_once_there_was_something_before_it() -> None:
    assert told(logged([step(INIT), step(INIT, restarted=True)])) == []
    found = logged([step(T), step(L, restarted=True), step(INIT)])
    assert told(found) == [("lost", 1, 2), ("segment", 1, 2)]


def test_each_segment_that_begins_as_the_scale_is_lost_says_so() -> None:
    """Though the scale's own event holds, and is no worse the second time."""
    lost = step(T, checks.SCALE_KNOWN.of(70, 50), restarted=True)
    found = logged([step(T), lost, step(T), lost, step(T)])
    assert told(found) == [("scale", 1, None), ("segment", 1, 2), ("segment", 3, 4)]
    assert all("70" in event.sentence for event in found.events if event.kind == "segment")


def test_a_pair_that_is_levelled_is_reported_where_that_begins() -> None:
    stereo = [replace(step(T, *found), method="stereo") for found in ((), (LEVELLED.of(3.1, 10.0),), ())]
    found = logged(stereo)
    assert told(found) == [("pair", 1, 2)] and "3.1" in found.events[0].sentence


def test_a_jump_says_how_far() -> None:
    moves = np.cumsum([0, 1, 1, 1, 1, 1, 5.5, 1])
    (event,) = logged(step(T, x=float(x)) for x in moves).events
    assert (event.kind, event.frame, event.severity) == ("jump", 6, Severity.WARNING)
    assert "5.5 units" in event.sentence and "5.5 times" in event.sentence


@pytest.mark.parametrize("seed", range(10))
def test_a_pose_at_rest_and_the_start_of_a_drive_are_no_jump(seed: int) -> None:
    """A rest of 0.2 mm of noise; then half a metre a step."""
    rng = np.random.default_rng(seed)
    rest = rng.normal(0, 2e-4, 30)
    drive = 0.5 * np.arange(1, 20) + rng.normal(0, 2e-4, 19)
    assert told(logged(step(T, x=float(x)) for x in (*rest, *drive))) == []


@pytest.mark.parametrize(("sigma", "jumps"), [(0.1, True), (2.0, False)])
def test_a_jump_is_farther_than_the_poses_are_uncertain(sigma: float, jumps: bool) -> None:
    moves = np.cumsum([0, 1, 1, 1, 1, 1, 6, 1])
    covariance = sigma**2 * np.eye(6)
    found = logged(step(T, x=float(x), covariance=covariance) for x in moves)
    assert bool(found.events) is jumps


def test_the_first_fit_of_a_provisional_pose_is_no_jump() -> None:
    moves = np.cumsum([0, 1, 1, 1, 1, 1, 6, 1])
    assert told(logged(step(T, x=float(x), provisional=i < 6) for i, x in enumerate(moves))) == []


def test_a_warning_that_holds_on_is_one_event_and_ends_where_its_check_passes() -> None:
    bad, good = step(T, checks.SCALE_DRIFT.of(51, 10)), step(T, checks.SCALE_DRIFT.of(5, 10))
    found = logged([good, bad, step(T), bad, step(T), good])
    assert told(found) == [("scale", 1, 5)]


def test_a_warning_that_comes_back_soon_is_the_same_event() -> None:
    bad, good = step(T, checks.SCALE_DRIFT.of(51, 10)), step(T, checks.SCALE_DRIFT.of(5, 10))
    quiet = event_kinds()["scale"].quiet_frames
    assert told(logged([bad, good, bad, good])) == [("scale", 0, 3)]
    assert told(logged([bad, good, *[step(T)] * quiet, bad])) == [("scale", 0, 1), ("scale", quiet + 2, None)]


def test_a_worse_check_is_an_event_though_one_holds() -> None:
    """The unit of a new map is a guess at frame 0; that the scale is lost at frame 2 is no news of that guess."""
    guess, bad, lost = checks.UNIT_POINTS.of(0, 8), checks.SCALE_DRIFT.of(30, 10), checks.SCALE_KNOWN.of(300, 30)
    found = logged([step(T, guess), step(T), step(T, lost, bad), step(T, bad)])
    assert told(found) == [("scale", 0, 2), ("scale", 2, None)]
    assert "300" in found.events[1].sentence


def test_a_check_that_fails_ever_farther_is_said_again_and_noise_is_not() -> None:
    drifts = [step(T, checks.SCALE_DRIFT.of(value, 10)) for value in (30, 35, 60, 28, 100, 110, 3000)]
    assert told(logged(drifts)) == [("scale", 0, 4), ("scale", 4, 6), ("scale", 6, None)]


def test_two_checks_that_fail_in_turns_are_two_events() -> None:
    one, two = step(T, checks.SCALE_DRIFT.of(30, 10)), step(T, checks.STEP_SCALE.of(0.03, 0.01))
    assert told(logged([one, two] * 5)) == [("scale", 0, 1), ("scale", 1, None)]


def test_a_worse_check_soon_after_an_event_is_an_event() -> None:
    bad, good = step(T, checks.SCALE_DRIFT.of(30, 10)), step(T, checks.SCALE_DRIFT.of(5, 10))
    worse = step(T, checks.SCALE_DRIFT.of(300, 10))
    assert told(logged([bad, good, worse])) == [("scale", 0, 1), ("scale", 2, None)]


def test_second_motions_loops_and_other_warnings_have_kinds_of_their_own() -> None:
    found = logged([step(T, SECOND_MOTION.of(0.3, 0.1), LOOP_VIEWS.of(3, 3), checks.FOCAL_LENGTH.of(2, 0.9))])
    assert {e.kind for e in found.events} == {"motion", "loop", "warning"}
    severity = {e.kind: e.severity for e in found.events}
    assert severity == {"motion": Severity.WARNING, "loop": Severity.OK, "warning": Severity.WARNING}


def test_a_long_wait_for_a_map_is_an_event() -> None:
    waiting = step(INIT, checks.START_PARALLAX.of(0.1, 1))
    found = logged([*[waiting] * 60, step(T, checks.AMBIGUITY.of(3, 1.5))])
    assert told(found) == [("no_map", 50, 60), ("map", 60, None)] and "0.1 deg" in found.events[0].sentence


def test_a_frame_that_could_not_be_read_is_an_event() -> None:
    found = EventLog()
    found.add(3, 3, (), NO_ROW, NO_ROW, "left/3.png is truncated")
    assert [(e.kind, e.method) for e in found.events] == [("unreadable", "")]
    assert "left/3.png" in found.events[0].sentence


BAD, GOOD = step(T, checks.SCALE_DRIFT.of(51, 10)), step(T, checks.SCALE_DRIFT.of(5, 10))
WORSE = step(T, checks.SCALE_DRIFT.of(999, 10))
RUN = [
    *[step(INIT)] * 55,
    step(T),
    step(L),
    step(L),
    BAD,
    step(T),
    WORSE,
    BAD,
    GOOD,
    step(L),
    step(T, FOUND),
    BAD,
    step(T),
    GOOD,
]


@pytest.mark.parametrize("at", range(len(RUN)))
def test_a_fork_that_takes_the_same_steps_has_the_same_events(at: int) -> None:
    whole, row = logged(RUN), NO_ROW
    for frame, one in enumerate(RUN[:at]):
        row = row_after(row, frame, frame, (one,), {})
    forked = logged(RUN[at:], logged(RUN).until(at, ("monocular",)), start=at, row=row)
    assert told(forked) == told(whole)


def test_a_fork_without_a_method_has_none_of_its_events() -> None:
    assert logged([step(T), step(L)]).until(2, ("stereo",)).events == ()


def test_memory_is_bounded_and_what_is_not_kept_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log, "MOST", 5)
    found = logged([step(T), step(L)] * 20)
    assert sum(e.kind == "lost" for e in found.events) == 5 and found.omitted == 15 + 14


def test_what_comes_later_is_reported_in_increments() -> None:
    found = logged([step(T), step(L)])
    count = len(found)
    logged([step(T, FOUND)], found, start=2, row={"monocular": {"status": "lost"}})
    assert [e.kind for e in found.since(count)] == ["relocalised"]


def test_the_next_and_the_previous_event_with_bookmarks_between() -> None:
    found = logged([step(T), step(T), step(L), step(T, FOUND), step(T), step(L)])
    marked = with_bookmarks(found.events, [Bookmark(4, 4, "the bus")])
    assert [e.frame for e in marked] == [2, 3, 4, 5]
    assert nearest(marked, 2, forwards=True)[0].kind == "relocalised"
    assert nearest(marked, 5, forwards=False)[0].sentence.endswith("the bus")
    assert nearest(marked, 2, forwards=True, alarming=True)[0].frame == 5
    assert nearest(marked, 5, forwards=True) == [] and nearest(marked, 0, forwards=False) == []


KIND = """
from ispom_app.engine.run_events.event import EventKind, Moment
from ispom_app.engine.verdict import Severity


def detect(moment):
    return "Even: a number that two divides." if moment.frame % 2 == 0 else False


KINDS = (EventKind("even", "Even", Severity.OK, "At every second frame.", detect),)
"""


def test_a_new_kind_is_one_file(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "even.py").write_text(KIND)
    monkeypatch.setattr(kinds, "__path__", [*kinds.__path__, str(tmp_path)])
    event_kinds.cache_clear()
    try:
        assert told(logged([step(T)] * 3)) == [("even", 0, 1), ("even", 2, None)]
        marked = with_bookmarks(logged([step(T)] * 3).events, ())
        assert [e.severity for e in marked] == [Severity.OK] * 2
    finally:
        event_kinds.cache_clear()


def test_every_kind_says_when_it_happens() -> None:
    found = event_kinds()
    assert {"lost", "relocalised", "jump", "segment", "scale", "motion", "loop", "map", "bookmark"} <= found.keys()
    for kind in found.values():
        assert kind.label and kind.help.endswith(".") and (kind.detect is None) == (kind.scope == "person")
    assert replace(found["lost"], name="other").name == "other"


def test_an_event_has_the_key_of_the_check_that_made_it() -> None:
    few = checks.POSE_POINTS.of(3, 15)
    lost = logged([step(T), step(L, few)]).events[0]
    assert (lost.kind, lost.cause) == ("lost", "pose_points")
    levelled = logged([replace(step(T, LEVELLED.of(3.2, 10)), method="stereo")]).events[0]
    assert (levelled.kind, levelled.cause) == ("pair", LEVELLED.key)
    assert logged([step(T), step(L)]).events[0].cause == ""
