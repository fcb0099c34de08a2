"""Which stretch of a run is examined."""

from __future__ import annotations

import pytest
from ispom_app.engine.run_events.event import RunEvent
from ispom_app.engine.run_events.stretch import stretch_of, worst_event
from ispom_app.engine.verdict import Severity

from ispom.errors import InputError
from ispom.sequences import open_sequence


def event(frame: int, severity: Severity, until: int | None) -> RunEvent:
    return RunEvent("lost", "monocular", frame, 0, severity, "Lost.", until)


EVENTS = [event(5, Severity.WARNING, None), event(20, Severity.LOST, 22), event(60, Severity.LOST, 80)]


def test_the_worst_event_is_the_longest_loss() -> None:
    assert worst_event(EVENTS) is EVENTS[2]
    assert worst_event([event(5, Severity.KEYFRAME, 6)]) is None


def test_a_stretch_has_its_frames_most_of_them_before() -> None:
    sequence = open_sequence("sim:tiny")
    found = stretch_of(sequence, None, 30, EVENTS)
    video = [i for i in range(found.first, found.last + 1) if sequence.kinds[i] == "video"]
    assert found.event is EVENTS[2] and found.at == 60 and len(video) == 30
    assert found.at - found.first > 1.5 * (found.last - found.at)


def test_a_stretch_at_an_end_is_inside() -> None:
    sequence = open_sequence("sim:tiny")
    assert stretch_of(sequence, 0, 30, []).first == 0
    assert stretch_of(sequence, len(sequence) - 1, 30, []).last == len(sequence) - 1
    assert stretch_of(sequence, 5, 400, []).first == 0


def test_a_frame_that_is_not_there_is_an_error() -> None:
    with pytest.raises(InputError):
        stretch_of(open_sequence("sim:tiny"), 100, 30, [])


def test_a_stretch_without_warnings_and_losses_is_quiet() -> None:
    sequence = open_sequence("sim:tiny")
    near = stretch_of(sequence, 30, 12, EVENTS[1:])  # the loss of frames 20 and 21 is in it, and not at frame 30
    assert near.event is None and near.first < 22 and not near.quiet
    assert stretch_of(sequence, 45, 8, EVENTS[1:]).quiet and not stretch_of(sequence, 45, 8, EVENTS[:1]).quiet
