"""A page that does not control the session looks around by itself: the shared run stays as it is."""

from __future__ import annotations

import pytest
from ispom_app.engine.events import Bookmark
from ispom_app.engine.playback import Playback
from ispom_app.features.bookmarks.commands import ToggleBookmark
from ispom_app.features.branches.commands import Fork
from ispom_app.features.layers.commands import Hide
from ispom_app.features.layers.state import Layers
from ispom_app.features.plots.commands import DEFAULT_PLOTS, Plot, Plots
from ispom_app.features.tracks.commands import Select
from ispom_app.session import commands as do
from ispom_app.session.actions import actions
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import Computed, State, changed, reduce
from ispom_app.views.web.looking import Looking
from ispom_app.views.web.messages import own_view

from ispom.errors import InputError
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import with_values

COMPUTED = 30


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


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


def pressed(looking: Looking, state: State, run: CurrentRun, *names: str) -> State:
    for name in names:
        assert looking.obey(next(a.command for a in actions() if a.name == name), state, run)
    return looking.shown(state)


def test_one_who_follows_sees_the_session_itself(state: State) -> None:
    assert Looking(Clock()).shown(state) is state and own_view(state, state) is None


@pytest.mark.parametrize(
    ("keys", "index"),
    [
        (("back",), 28),
        (("start",), 0),
        (("start", "forward"), 1),
        (("start", "stereo"), 1),
        (("start", "key_frame", "key_frame"), 5),
        (("key_frame_back",), 28),
        (("start", "end"), COMPUTED - 1),
        (("forward",), COMPUTED - 1),
    ],
)
def test_each_move_is_the_pages_own(state: State, run: CurrentRun, keys: tuple[str, ...], index: int) -> None:
    looking = Looking(Clock())
    assert pressed(looking, state, run, *keys).index == index == looking.index
    assert state.index == COMPUTED - 1 and len(run.history) == COMPUTED


def test_what_is_shown_of_the_methods_is_that_of_the_pages_own_frame(state: State, run: CurrentRun) -> None:
    looking = Looking(Clock())
    looking.obey(do.Seek(12), state, run)
    local = looking.shown(state)
    assert local.statuses == run.history[12].statuses != state.statuses
    view = own_view(local, state)
    assert view is not None and view["index"] == 12 and "methods" in view and "source" not in view


def test_nothing_is_computed_for_one_who_only_looks(state: State, run: CurrentRun) -> None:
    looking = Looking(Clock())
    looking.obey(do.Seek(35), state, run)
    assert looking.index == COMPUTED - 1
    with pytest.raises(InputError):
        looking.obey(do.StepTo("key_frame"), state, run)
    assert looking.index == COMPUTED - 1 and looking.shown(state).target is None


def test_it_plays_at_the_recorded_speed_up_to_the_last_computed_frame(state: State, run: CurrentRun) -> None:
    clock = Clock()
    looking, times_ns = Looking(clock), run.playback.sequence.times_ns
    assert pressed(looking, state, run, "start", "play").playing
    seen = []
    for _ in range(200):
        clock.now += 0.02
        looking.turn(state, run)
        index = looking.shown(state).index
        if looking.shown(state).playing:
            played_ns = (clock.now - 100.0) * 1e9
            assert times_ns[index] <= played_ns + 1 < times_ns[index + 1] + 1 if index + 1 < COMPUTED else True
        seen.append(index)
    assert seen[-1] == COMPUTED - 1 and seen == sorted(seen) and not looking.shown(state).playing
    assert not state.playing and len(run.history) == COMPUTED
    assert pressed(looking, state, run, "play").index == 0  # at the end, playing starts over


def test_it_waits_at_the_newest_frame_of_a_run_that_goes_on(state: State, run: CurrentRun) -> None:
    clock, going = Clock(), with_values(state, playing=True)
    looking = Looking(clock)
    looking.obey(do.StepBy(-1), going, run)
    assert not looking.shown(going).playing  # the session plays, this page does not
    looking.obey(do.Play(), going, run)
    clock.now += 9
    looking.turn(going, run)
    assert looking.index == COMPUTED - 1 and looking.shown(going).playing


def test_it_goes_round_in_a_loop_of_its_own(state: State, run: CurrentRun) -> None:
    clock = Clock()
    looking = Looking(clock)
    looking.obey(do.Seek(5), state, run)
    pressed(looking, state, run, "loop_start")
    looking.obey(do.Seek(9), state, run)
    assert pressed(looking, state, run, "loop_end", "play").playing and state.loop is None
    seen = []
    for _ in range(60):
        clock.now += 0.02
        looking.turn(state, run)
        seen.append(looking.shown(state).index)
    assert set(seen) == set(range(5, 10)) and looking.shown(state).playing
    assert pressed(looking, state, run, "no_loop").loop is None


def test_layers_and_plots_are_the_pages_own(state: State, run: CurrentRun) -> None:
    looking = Looking(Clock())
    looking.obey(Hide(frozenset({"stereo"})), state, run)
    looking.obey(Plot("stereo.inliers"), state, run)
    view = own_view(looking.shown(state), state)
    assert view is not None and view["address"]["plots"] == "error,inliers,stereo.inliers"
    assert any("stereo" in path for path in view["hidden"])
    assert (
        looking.index is None and not state[Layers].hidden and state[Plots].names == DEFAULT_PLOTS
    )  # it still follows the frames
    looking.follow()
    assert looking.shown(state) is state


@pytest.mark.parametrize("command", [ToggleBookmark(), Fork(("stereo",), None), Select("track:stereo:5")])  # type: ignore[arg-type]
def test_what_others_would_see_is_not_obeyed(state: State, run: CurrentRun, command: do.Command) -> None:
    looking = Looking(Clock())
    assert not looking.obey(command, state, run) and looking.shown(state) is state


def test_another_run_is_followed_from_its_beginning(state: State, run: CurrentRun) -> None:
    looking = Looking(Clock())
    looking.shown(state)
    looking.obey(do.Seek(3), state, run)
    looking.obey(Hide(frozenset({"stereo"})), state, run)
    other = reduce(state, run.opened)
    assert looking.shown(other).index == other.index and looking.index is None
    assert looking.shown(other)[Layers].hidden == {"stereo"}


def test_before_the_first_frame_there_is_nothing_to_look_at(state: State) -> None:
    with pytest.raises(InputError):
        Looking(Clock()).obey(do.Seek(3), reduce(state, changed(playing=False)), None)


def test_events_are_stepped_through_among_the_frames_that_are_computed(state: State, run: CurrentRun) -> None:
    looking, marked = Looking(Clock()), with_values(state, bookmarks=(Bookmark(12, 12, ""),))
    assert pressed(looking, marked, run, "event_back").index == 12
    with pytest.raises(InputError, match="computed"):
        looking.obey(next(a.command for a in actions() if a.name == "event"), marked, run)
    with pytest.raises(InputError, match="No event before"):
        looking.obey(next(a.command for a in actions() if a.name == "event_back"), marked, run)
    assert looking.index == 12
