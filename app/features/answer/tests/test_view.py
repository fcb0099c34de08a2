"""The answer line: of the worst event that holds at the frame, with the doctor's cause where it examined that event."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.run_events.event import RunEvent
from ispom_app.engine.run_events.stretch import Stretch
from ispom_app.engine.verdict import Severity
from ispom_app.features.answer.view import NOTHING, AnswerView, answer
from ispom_app.features.doctor.job import Progress
from ispom_app.features.doctor.rerun import NOT_TRIED
from ispom_app.features.doctor.service import CANCELLED
from ispom_app.features.doctor.state import Examined
from ispom_app.session.branches.state import Branches
from ispom_app.session.state import FeatureState, State

from ispom.evaluation.doctor.diagnose import with_reruns
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Finding, Ranked
from ispom.evaluation.doctor.reruns import Outcome, Reruns, Trial, Tried
from ispom.evaluation.doctor.suspects import SUSPECTS
from ispom.plausibility.doubt import Doubt

SCALE = RunEvent("scale", "monocular", 21, 0, Severity.WARNING, "Scale unreliable: its deviation is 12 % (limit 10 %).")
JUMP = RunEvent("jump", "stereo", 40, 0, Severity.WARNING, "Jump: moved 3 m in one step.", 41)
LOST = RunEvent("lost", "stereo", 50, 0, Severity.LOST, "Lost: 9 inliers (15 needed).", 55)
STRETCH = Stretch(5, 49, 21, SCALE)


def shown(frame: int, *events: RunEvent, branch: int = 0, values: tuple[FeatureState, ...] = ()) -> AnswerView:
    record = ExposureRecord(frame, 0, "video", (), {}, {}, {})
    state = State("double:9", displayed=record).having(Branches(shown=branch), *values)
    run: Any = SimpleNamespace(events=SimpleNamespace(events=events))
    return answer(state, run, frame)


def planted(reruns: int = 3) -> Diagnosis:
    """Only 50 tracks, and what more of them do to the error."""
    worse, better = (Outcome(40, dict.fromkeys(range(40), 0.3), 0, {}, 0, error_m=error) for error in (0.947, 0.144))
    tried = Tried(Trial("monocular", "max_tracks", 50, 400), (better,) * reruns, (worse,) * reruns)
    return with_reruns(Diagnosis(0, 9, ()), Reruns(0, 9, (tried,), set_back=True))


def test_the_worst_event_that_holds_is_the_answer() -> None:
    here = shown(50, SCALE, JUMP, LOST)
    assert (here.tone, here.diagnose, here.show) == ("lost", 50, None) and "15 needed" in here.text
    later = shown(60, SCALE, JUMP, LOST)
    assert (later.tone, later.diagnose, later.show) == ("warning", 21, 21)
    assert all(part in later.text for part in ("Monocular", "frame 21", "12 %", "10 %"))


def test_without_a_problem_it_names_the_nearest() -> None:
    assert shown(7) == AnswerView("ok", shown(7).text, False, None, False, False, None) and shown(7).text
    calm = shown(45, JUMP, LOST)
    assert (calm.tone, calm.diagnose, calm.show) == ("ok", None, 40)


def test_a_doubtful_source_is_no_answer_of_no_problem() -> None:
    record = ExposureRecord(7, 0, "video", (), {}, {}, {})
    doubt = Doubt("pair_unlike", "The right images are turned.")
    run: Any = SimpleNamespace(events=SimpleNamespace(events=()))
    state = State("double:9", notes=("emulated", doubt), displayed=record).having(Branches())
    found = answer(state, run, 7)
    assert found.tone == "warning" and doubt in found.text
    assert answer(replace(state, notes=("emulated",)), run, 7).tone == "ok"


def test_the_cause_has_its_numbers_and_can_be_applied() -> None:
    found = shown(60, SCALE, values=(Examined(STRETCH, None, planted()),))
    assert found.applies and found.show == 21 and found.diagnose is None
    assert all(part in found.text for part in ("frame 21", "50", "400", "947 mm", "144 mm", "3 reruns"))


def test_an_answer_is_of_its_event_and_its_branch_only() -> None:
    examined = Examined(STRETCH, None, planted())
    assert not shown(52, SCALE, LOST, values=(examined,)).applies, "a worse event was not examined"
    assert not shown(60, SCALE, branch=1, values=(examined,)).applies


def test_an_answer_at_the_frame_where_an_event_began_is_about_it_too() -> None:
    other = RunEvent("warning", "stereo", 2, 0, Severity.WARNING, "Few points: 3 (5 expected).", 22)
    assert shown(60, SCALE, values=(Examined(Stretch(5, 49, 21, other), None, planted()),)).applies


def test_of_equal_events_the_examined_one_is_shown() -> None:
    other = RunEvent("warning", "stereo", 3, 0, Severity.WARNING, "Few points: 3 (5 expected).")
    assert shown(60, other, SCALE).diagnose == 3
    assert shown(60, other, SCALE, values=(Examined(STRETCH, None, planted()),)).applies


def test_what_it_cannot_explain_it_says_and_offers_more_time() -> None:
    unexplained = with_reruns(
        Diagnosis(0, 9, tuple(Ranked(s, Finding(0.5, "")) for s in SUSPECTS)), Reruns(0, 9, note=NOT_TRIED)
    )
    found = shown(60, SCALE, values=(Examined(STRETCH, None, unexplained),))
    assert (found.thorough, found.diagnose, found.applies) == (True, 21, False) and str(len(SUSPECTS)) in found.text
    undecided = Diagnosis(0, 9, (Ranked(SUSPECTS[0], Finding(2.0, "5 of 9.", undecided="Film a board.")),))
    found = shown(60, SCALE, values=(Examined(STRETCH, None, undecided),))
    assert not found.thorough and "5 of 9." in found.text and "Film a board." in found.text


def test_while_the_doctor_works_it_says_what_and_how_long() -> None:
    working = Examined(STRETCH, Progress(12, 68, "testing whether it is blurred"), taken_s=9, limit_s=60)
    found = shown(3, values=(working,))
    assert found.working and found.diagnose is None
    assert all(part in found.text for part in ("it is blurred", "12 of 68", "9 s", "51 s"))
    compiling = shown(3, values=(replace(working, taken_s=0),))
    assert compiling.working and "60" not in compiling.text, "its time has not begun"


def test_while_the_doctor_works_it_says_what_is_known_already() -> None:
    progress = Progress(0, 75, "rerunning the stretch", planted(1))
    found = shown(60, SCALE, values=(Examined(STRETCH, progress, taken_s=9, limit_s=60),))
    assert found.working and not found.applies, "it is not confirmed yet"
    assert all(part in found.text for part in ("50", "400", "947 mm", "144 mm", "one rerun", "51 s"))
    nothing = replace(progress, known=Diagnosis(0, 9, (Ranked(SUSPECTS[0], Finding(0.5, "")),)))
    unknown = replace(progress, known=None)
    texts = [shown(60, SCALE, values=(Examined(STRETCH, each, taken_s=9),)).text for each in (nothing, unknown)]
    assert texts[0] == texts[1], "what is no cause is not said"


def test_a_problem_of_the_examination_is_named_and_a_cancelled_one_is_not() -> None:
    failed = shown(60, SCALE, values=(Examined(STRETCH, problem="disk is full"),))
    assert "disk is full" in failed.text and failed.diagnose == 21
    assert shown(60, SCALE, values=(Examined(STRETCH, problem=CANCELLED),)) == shown(60, SCALE)


def test_while_a_question_covers_the_run_it_says_nothing() -> None:
    assert answer(State("double:9").having(Examined(STRETCH, None, planted())), None, 21) == NOTHING
