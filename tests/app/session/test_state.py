"""reduce: what the screen shows after events."""

from __future__ import annotations

from ispom_app.engine.events import Finished, Opened, Stepped
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.model.run_model import Tally
from ispom_app.session.state import (
    MAX_NOTICES,
    Computed,
    Displayed,
    NoticeAdded,
    Opening,
    OpeningFailed,
    State,
    changed,
    reduce,
)

from ispom.methods import Config, method, names
from tests import doubles
from tests.alone import OF_CAMERAS

SEQUENCE = doubles.sequence(6)
OPENED = Opened(SEQUENCE, ("monocular", "stereo", "integrated"), Config(), SEQUENCE.truth)


def moment(index: int, before: ExposureRecord | None = None) -> ExposureRecord:
    exposure = SEQUENCE[index]
    estimators = [doubles.FakeEstimator(m) for m in ("monocular", "stereo")]
    steps = tuple(e.step((), exposure)[1] for e in estimators if method(e.method).uses(exposure))
    return ExposureRecord.of(Stepped(index, exposure, steps, {}, {s.method: 0.5 for s in steps}), before)


def test_a_run_from_opening_to_its_end():
    state = reduce(State("double"), Opening("double"))
    assert (state.phase, state.index, state.time_s) == ("opening", -1, 0.0)
    state = reduce(state, OPENED)
    assert (state.phase, state.total, state.run) == ("ready", len(SEQUENCE), 1)
    assert state.possible == tuple(name for name in names() if name not in OF_CAMERAS)
    first, second = moment(0), moment(1)
    state = reduce(reduce(state, Computed(first, Tally())), Computed(second, Tally()))
    assert (state.computed, state.index) == (2, 1)
    state = reduce(state, Displayed(first))
    assert (state.computed, state.index) == (2, 0)
    state = reduce(reduce(state, changed(playing=True)), Finished({}, {}))
    assert state.ended and not state.playing


def test_a_second_run_starts_empty_and_keeps_the_notices():
    state = reduce(reduce(State("double"), OPENED), NoticeAdded("careful"))
    state = reduce(reduce(state, Computed(moment(0), Tally())), Opening("double"))
    assert state.displayed is None and state.computed == 0 and state.notices[0].text == "careful"
    assert reduce(state, OPENED).run == 2


def test_a_failed_opening_is_reported():
    state = reduce(State("nothing"), OpeningFailed("nothing does not exist: correct the path"))
    assert state.phase == "failed" and state.notices[-1].text.startswith("nothing does")
    assert state.failure == state.notices[-1].text, "for pages that come after the notice"


def test_notices_are_numbered_and_few():
    state = State("double")
    for i in range(MAX_NOTICES + 3):
        state = reduce(state, NoticeAdded(str(i)))
    assert [n.number for n in state.notices] == list(range(4, MAX_NOTICES + 4))


def test_statuses_keep_the_latest_step_of_each_method():
    moments: list[ExposureRecord] = []
    for i in range(len(SEQUENCE)):
        moments.append(moment(i, moments[-1] if moments else None))
    stereo = next(i for i, m in enumerate(moments) if m.kind == "stereo")
    later = moments[stereo + 1]
    assert later.kind == "video" and later.statuses["stereo"].error_m == 0.5


def test_a_moment_keeps_no_image():
    kept = moment(0)
    assert not any(hasattr(kept, name) for name in ("exposure", "image"))
    again = kept.stepped(SEQUENCE[0])
    assert again.index == 0 and again.steps is kept.steps
