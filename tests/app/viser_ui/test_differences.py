"""The panel of differences between branches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.engine.differences.compare import Difference, Divergence
from ispom_app.features.branches.branches import Branch
from ispom_app.features.branches.comparison import Comparison
from ispom_app.features.branches.differences import FIRST, NEXT, PREVIOUS, DifferencesPanel
from ispom_app.session import commands as do
from ispom_app.session.state import State

from tests.app.helpers import with_values

NAME = "<img src=x onerror=alert(1)>"
FOUND = tuple(
    Divergence(index, index * 10**8, (Difference(f"stereo.{key}", 1.0, 1.5, 0.5),))
    for index, key in ((9, "scale"), (14, "parallax"), (20, "error_m"))
)
COMPARISON = Comparison(1, 0, 9, 30, ("stereo",), 30, 8, 3, FOUND)


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    found = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield found
    found.stop()


def made(server: viser.ViserServer, comparison: Comparison | None, index: int = 0) -> tuple[Any, list[do.Command]]:
    asked: list[do.Command] = []
    state = with_values(
        State("double"), branches=(Branch(0, "first run"), Branch(1, NAME, 0, 9)), comparison=comparison
    )
    if index:
        state = with_values(state, displayed=SimpleNamespace(index=index, statuses={}))  # type: ignore[arg-type]
    session: Any = SimpleNamespace(state=state, post=asked.append)
    panel = DifferencesPanel(server.gui, session)
    panel.show(state)
    return panel, asked


def test_it_says_where_in_what_and_by_how_much(server: viser.ViserServer) -> None:
    text = made(server, COMPARISON)[0]._text.content
    assert "frames 9 to 29" in text and "they differ at 8 frames; first in:" in text
    assert "frame 9 (0.900 s)" in text and "stereo.scale: 1 | 1.5, apart by 0.5" in text
    assert "Of 3 frames the history no longer has the tracks" in text
    assert "<img" not in text and "&lt;img" in text, "a name is never markup"


def test_it_says_how_far_it_is_and_that_nothing_differs(server: viser.ViserServer) -> None:
    begun = replace(COMPARISON, done=12, apart=0, first=(), thinned=0)
    panel, _ = made(server, begun)
    assert "comparing: 3 of 21 frames" in panel._text.content and not panel._buttons.visible
    assert "all numbers agree within 1e-9" in made(server, replace(begun, done=30))[0]._text.content
    assert not made(server, None)[0]._text.visible


def test_its_buttons_go_to_the_differences(server: viser.ViserServer) -> None:
    panel, asked = made(server, COMPARISON, 14)
    for button in (FIRST, PREVIOUS, NEXT):
        panel._buttons.value = button
    assert asked == [do.Seek(9), do.Seek(9), do.Seek(20)]
    at_the_last, nothing = made(server, COMPARISON, 20)
    at_the_last._buttons.value = NEXT
    assert not nothing
