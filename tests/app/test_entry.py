"""The command begins to get ready for rendering at once, but only where something is to be rendered."""

from __future__ import annotations

import sys

import pytest
from ispom_app import __main__ as entry
from ispom_app.cli import main as cli

from ispom.simulation.rendering.process import RenderPool


@pytest.mark.parametrize(
    ("words", "rendered", "starts"),
    [
        (["demo", "--port", "1"], False, 1),
        (["app", "--seed", "2", "sim:city"], False, 1),
        (["demo"], True, 0),
        (["app", "kitti/sequences/06"], False, 0),
        (["run", "sim:city"], False, 0),
        ([], False, 0),
    ],
)
def test_when_the_renderer_starts(
    words: list[str], rendered: bool, starts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[object] = []
    monkeypatch.setattr(sys, "argv", ["ispom", *words])
    monkeypatch.setattr("ispom.simulation.rendering.cache.anything_rendered", lambda: rendered)

    def start(self: RenderPool) -> None:
        started.append(self)

    def end(self: RenderPool) -> None:  # not the real one: the tests that follow need the processes
        ended.append(self)

    ended: list[object] = []
    monkeypatch.setattr(RenderPool, "start", start)
    monkeypatch.setattr(RenderPool, "end", end)
    monkeypatch.setattr(cli, "main", lambda given: 7 if given == words else 0)
    assert entry.main() == 7
    assert len(started) == starts
    assert len(ended) == 1
