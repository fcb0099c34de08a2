"""The legend at the image: it counts what the image shows, and says what the colours mean."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

import pytest
from ispom_app.engine.inspection.colouring import SCALES
from ispom_app.engine.inspection.sightings import seen_by
from ispom_app.engine.playback import Playback
from ispom_app.features.layers.state import Layers
from ispom_app.features.layers.view import legend
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce

from tests import doubles
from tests.alone import METHODS
from tests.app import helpers


@pytest.fixture
def shown() -> tuple[State, CurrentRun]:
    run = CurrentRun(Playback(doubles.sequence(40), METHODS, builder=helpers.build), 10**8)
    for _ in range(8):
        run.step()
    return replace(reduce(State("double:40"), run.opened), displayed=run.history[7]), run


def test_it_counts_the_tracks_of_the_image_by_their_states(shown) -> None:
    state, run = shown
    seen = seen_by(run.history[7])
    assert seen is not None
    counts = [int(re.match(r"\d+", item.text)[0]) for item in legend(state, run, 7).items]  # type: ignore[index]
    assert counts == [count for _, count in sorted(Counter(seen.tracks.status.tolist()).items())]


@pytest.mark.parametrize("by", SCALES)
def test_a_scale_names_its_ends_and_what_is_unknown(shown, by) -> None:
    state, run = shown
    found = legend(helpers.with_values(state, colour_by=by), run, 7)
    assert found.title == SCALES[by].title
    labels = SCALES[by].labels()
    assert [item.text for item in found.items if item.text] == [labels[0], *labels[-2:]]
    assert len(found.items) == len(labels)


def test_where_no_tracks_are_drawn_there_is_no_legend(shown) -> None:
    state, run = shown
    assert not legend(state.having(replace(state[Layers], hidden=frozenset({"tracks"}))), run, 7).items
    assert not legend(state, None, 7).items
