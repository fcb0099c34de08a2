"""A page that does not control the session looks around by itself: the shared run stays as it is. How it moves is the
page's own (tests/page_scripts/place.test.mjs)."""

from __future__ import annotations

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.features.bookmarks.commands import ToggleBookmark
from ispom_app.features.branches.commands import Fork
from ispom_app.features.layers.commands import Hide
from ispom_app.features.layers.state import Layers
from ispom_app.features.plots.commands import DEFAULT_PLOTS, Plot, Plots
from ispom_app.features.tracks.commands import Select
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import Computed, Loop, State, changed, reduce
from ispom_app.views.web.messages import LookAt, command_of, own_view
from ispom_app.views.web.own_place import OwnPlace

from ispom.errors import InputError
from tests import doubles
from tests.alone import METHODS

COMPUTED = 30


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    def build(config, methods, rig):
        return doubles.ensemble(methods, doubles.FakeEstimator)

    found = CurrentRun(Playback(doubles.sequence(40), METHODS, builder=build), 10**9)
    for _ in range(COMPUTED):
        found.step()
    return found


@pytest.fixture
def state(run: CurrentRun) -> State:
    """Paused at its newest frame."""
    found = reduce(State("double:40"), run.opened)
    for record in run.history:
        found = reduce(found, Computed(record, run.tally))
    return found


def test_one_who_follows_sees_the_session_itself(state: State) -> None:
    assert OwnPlace().shown(state) is state and own_view(state, state) is None


def test_what_is_shown_of_the_methods_is_that_of_the_pages_own_frame(state: State, run: CurrentRun) -> None:
    own, place = (
        OwnPlace(),
        command_of('{"do": "look_at", "index": 12, "playing": true, "loop": [3, null], "speed": 2}'),
    )
    own.shown(state)
    assert isinstance(place, LookAt)
    own.look_at(place, run)
    local = own.shown(state)
    assert local.statuses == run.history[12].statuses != state.statuses
    assert (local.index, local.playing, local.loop, local.speed) == (12, True, Loop(3), 2.0)
    view = own_view(local, state)
    assert view is not None and view["index"] == 12 and "methods" in view and "source" not in view
    assert state.index == COMPUTED - 1 and len(run.history) == COMPUTED


def test_what_a_page_does_not_say_is_the_sessions(state: State, run: CurrentRun) -> None:
    own = OwnPlace()
    own.shown(state)
    own.look_at(LookAt(speed=None), run)
    local = own.shown(state)
    assert own.index is None and local.index == state.index and local.speed is None


def test_nothing_is_computed_for_one_who_only_looks(state: State, run: CurrentRun) -> None:
    own = OwnPlace()
    own.shown(state)
    own.look_at(LookAt(index=35), run)
    assert own.index == COMPUTED - 1 and own.shown(state).target is None and len(run.history) == COMPUTED


@pytest.mark.parametrize("text", ['"index": -1', '"speed": 0', '"loop": [0]', '"index": "x"', '"other": 1'])
def test_a_place_that_makes_no_sense_is_not_heard(text: str) -> None:
    assert command_of(f'{{"do": "look_at", {text}}}') is None


def test_layers_and_plots_are_the_pages_own(state: State, run: CurrentRun) -> None:
    own = OwnPlace()
    own.obey(Hide(frozenset({"stereo"})), state, run)
    own.obey(Plot("stereo.inliers"), state, run)
    view = own_view(own.shown(state), state)
    assert view is not None and view["address"]["plots"] == "error,inliers,stereo.inliers"
    assert any("stereo" in path for path in view["hidden"])
    assert own.index is None and not state[Layers].hidden and state[Plots].names == DEFAULT_PLOTS  # it still follows
    own.follow()
    assert own.shown(state) is state


OTHERS_WOULD_SEE = [ToggleBookmark(), Fork(("stereo",), None), Select("track:stereo:5"), do.Seek(3), do.Play()]  # type: ignore[arg-type]


@pytest.mark.parametrize("command", OTHERS_WOULD_SEE)
def test_what_others_would_see_is_not_obeyed(state: State, run: CurrentRun, command: do.Command) -> None:
    own = OwnPlace()
    assert not own.obey(command, state, run) and own.shown(state) is state


def test_another_run_is_followed_from_its_beginning(state: State, run: CurrentRun) -> None:
    own = OwnPlace()
    own.shown(state)
    own.look_at(LookAt(index=3), run)
    own.obey(Hide(frozenset({"stereo"})), state, run)
    other = reduce(state, run.opened)
    assert own.shown(other).index == other.index and own.index is None
    assert own.shown(other)[Layers].hidden == {"stereo"}


def test_before_the_first_frame_there_is_nothing_to_look_at(state: State) -> None:
    own, empty = OwnPlace(), reduce(state, changed(playing=False))
    own.look_at(LookAt(index=3), None)
    assert own.index is None
    with pytest.raises(InputError):
        own.obey(Hide(frozenset({"stereo"})), empty, None)
