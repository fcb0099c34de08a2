"""The panel of break points: live value, hits, names that fit, and what its buttons ask for."""

from __future__ import annotations

import html
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.engine.playback import Playback
from ispom_app.features.breakpoints.commands import FindMatch, RunUntil
from ispom_app.features.breakpoints.panel import EXAMPLE, MOST_NAMES, NEXT, PREVIOUS, UNTIL, BreakPointPanel
from ispom_app.session import commands as do
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce

from tests import doubles
from tests.alone import METHODS
from tests.app.gui import Gui
from tests.app.helpers import build_full, run_to_end

LOST = 'monocular.status == "lost"'


@pytest.fixture(scope="module")
def run() -> CurrentRun:
    return run_to_end(Playback(doubles.sequence(40), METHODS, builder=build_full))


@pytest.fixture
def at_ten(run: CurrentRun) -> State:
    return replace(reduce(State("double:40"), run.opened), displayed=run.history[10], computed=len(run.history))


def made(server: viser.ViserServer, run: CurrentRun, state: State) -> tuple[BreakPointPanel, Gui, list[do.Command]]:
    commands: list[do.Command] = []
    session: Any = SimpleNamespace(state=state, post=commands.append, series=run.series)
    gui: Any = Gui(server)
    panel = BreakPointPanel(gui, session)
    panel.show(state)
    return panel, gui, commands


def test_empty_it_says_what_to_write(server: viser.ViserServer, run: CurrentRun, at_ten: State) -> None:
    _, gui, _ = made(server, run, at_ten)
    assert EXAMPLE in html.unescape(gui.text)


def test_it_shows_the_value_here_and_how_often_it_holds(
    server: viser.ViserServer, run: CurrentRun, at_ten: State
) -> None:
    panel, gui, _ = made(server, run, at_ten)
    gui.labelled("condition").value = LOST
    lost = sum(s.method == "monocular" and s.status == "lost" for r in run.history for s in r.steps)
    assert lost and f"holds at {lost} of {len(run.history)} computed frames" in gui.text
    assert "does not hold" in gui.text and "tracking" in gui.text
    panel.show(replace(at_ten, computed=11))
    assert "frame 10" in gui.text


def test_names_that_fit_are_listed_with_their_values(server: viser.ViserServer, run: CurrentRun, at_ten: State) -> None:
    _, gui, _ = made(server, run, at_ten)
    gui.labelled("condition").value = "stereo.status == 'lost' or monocular.dropped"
    assert "monocular.dropped_lost" in gui.text and "integrated." not in gui.text
    gui.labelled("condition").value = "stereo"
    assert gui.text.count("stereo.") <= MOST_NAMES + 1
    gui.labelled("condition").value = "<img src=x> > 3"
    assert "<img" not in gui.text and "column " in gui.text


def test_its_buttons_send_the_condition(server: viser.ViserServer, run: CurrentRun, at_ten: State) -> None:
    _, gui, commands = made(server, run, at_ten)
    gui.labelled("condition").value = LOST
    for button in (UNTIL, NEXT, PREVIOUS):
        gui.every("button_group")[0].value = button
    assert commands == [RunUntil(LOST), FindMatch(LOST, True), FindMatch(LOST, False)]
