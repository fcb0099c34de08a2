"""Groups, causes and what to do, from events and diagnoses."""

from __future__ import annotations

from ispom_app.engine.run_events.event import RunEvent
from ispom_app.engine.verdict import Severity
from ispom_app.features.triage.advice import action_of, group_of, how_to_film, of_diagnosis, of_events, of_located
from ispom_app.features.triage.page import note
from ispom_app.features.triage.row import Action, Group, Row

from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Finding, Ranked
from ispom.evaluation.doctor.suspects import SUSPECTS

OF_KEY = {suspect.key: suspect for suspect in SUSPECTS}


def event(kind: str, severity: Severity, frame: int, until: int | None) -> RunEvent:
    return RunEvent(kind, "monocular", frame, 0, severity, f"{kind} happened", until)


LOST = event("lost", Severity.LOST, 20, 30)
NO_MAP = event("no_map", Severity.WARNING, 50, None)
SCALE = event("scale", Severity.WARNING, 5, 80)


def test_the_worst_that_happened_decides_the_group() -> None:
    assert group_of([SCALE, NO_MAP, LOST], moved=True, doubted=True) == Group.LOST
    assert group_of([SCALE, NO_MAP], moved=True, doubted=False) == Group.NO_MAP
    assert group_of([SCALE], moved=True, doubted=False) == Group.SUSPICIOUS
    assert group_of([], moved=True, doubted=True) == Group.SUSPICIOUS
    assert group_of([], moved=True, doubted=False) == Group.FINE
    assert group_of([LOST], moved=False, doubted=False) == Group.NO_MAP


def test_events_say_where_and_at_which_frame() -> None:
    found = of_events([SCALE, LOST, event("lost", Severity.LOST, 97, None)], 100)
    assert found["frame"] == 97 and found["where"] == "frames 20 to 29, 97 to 99"
    assert of_events([event("lost", Severity.LOST, 7, 8)], 100)["where"] == "frame 7"
    assert of_events([], 100) == {}


def test_few_located_frames_are_a_cause_without_any_event() -> None:
    assert "cause" in of_located({"stereo": 100.0, "monocular": 12.5})
    assert of_located({"stereo": 100.0, "monocular": 60.0, "integrated": None}) == {}


def diagnosed(key: str, *frames: int) -> Diagnosis:
    return Diagnosis(0, 40, (Ranked(OF_KEY[key], Finding(2.0, "The figures.", frames=frames)),))


def test_a_cause_brings_its_own_remedy_and_frame() -> None:
    found = of_diagnosis(diagnosed("darkness", 12, 13))
    assert found["action"] == Action.FILM and found["advice"] == OF_KEY["darkness"].remedy
    assert found["frame"] == 12 and found["suspect"] == "darkness"
    assert of_diagnosis(Diagnosis(0, 40, ())).keys() == {"advice"}


def test_calibrations_are_corrected_and_images_filmed_again() -> None:
    assert {action_of(OF_KEY[key]) for key in ("clock", "exchanged", "unlevel-pair")} == {Action.CORRECT}
    assert {action_of(OF_KEY[key]) for key in ("blur", "too-fast", "covered-lens", "zoom")} == {Action.FILM}


def test_the_note_has_each_cause_once_with_its_clips() -> None:
    def row(clip: str, key: str) -> Row:
        suspect = OF_KEY[key]
        action = action_of(suspect)
        return Row(clip, Group.LOST, suspect=key, suspect_name=suspect.name, action=action, advice=suspect.remedy)

    found = how_to_film([row("a", "blur"), row("b", "too-fast"), row("c", "too-fast"), row("d", "clock")])
    assert [(each.suspect, each.clips) for each in found] == [("too-fast", ("b", "c")), ("blur", ("a",))]
    assert OF_KEY["blur"].remedy in note(found) and "2 clips" in note(found)
    assert how_to_film([]) == []
