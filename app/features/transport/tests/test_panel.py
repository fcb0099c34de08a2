"""The transport among the controls: it asks for what its buttons say, and shows what the session does."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.features.transport.panel import MOVES, OTHER, SPEEDS, TransportPanel
from ispom_app.session import commands as do
from ispom_app.session.state import State

from tests.app.gui import Gui
from tests.app.viser_ui.conftest import server  # noqa: F401  (a fixture)


@pytest.fixture
def session() -> Any:
    asked: list[do.Command] = []
    return SimpleNamespace(state=State("double:9"), asked=asked, post=asked.append)


def test_speeds_go_both_ways_and_one_of_another_kind_is_named(server: viser.ViserServer, session: Any) -> None:  # noqa: F811
    gui: Any = Gui(server)
    panel, speed = TransportPanel(gui, session), gui.labelled("speed")
    for factor in (2.0, None, 0.3):
        session.state = replace(session.state, speed=factor)
        panel.show(session.state)
    assert speed.value == OTHER and not session.asked, "showing asks for nothing"
    speed.value = "4 ×"
    assert session.asked == [do.Speed(4.0)]


def test_the_button_says_what_a_click_does(server: viser.ViserServer, session: Any) -> None:  # noqa: F811
    gui: Any = Gui(server)
    panel, labels = TransportPanel(gui, session), []
    for playing in (True, False):
        panel.show(replace(session.state, playing=playing))
        labels.append(gui.every("button")[0].label)
    assert labels == ["Pause", "Play"]


def test_every_speed_and_move_is_a_command_that_a_page_may_send() -> None:
    assert all(command.from_page for command in MOVES.values()) and len(set(SPEEDS.values())) == len(SPEEDS)
