"""View values: the page's types are those of the values, a field is sent when it changed, and a view that fails costs
that view."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from ispom_app.session import commands as do
from ispom_app.session.state import State, changed, reduce
from ispom_app.views.web import view_values
from ispom_app.views.web.news import Look
from ispom_app.views.web.view_values import View, ViewNews, listed, scripts, views

from tests.app import view_types


def test_the_types_of_the_page_are_those_of_the_values() -> None:
    assert view_types.FILE.read_text(encoding="utf-8") == view_types.text(), "run python -m tests.app.view_types"


def test_each_view_has_a_component_of_its_name() -> None:
    for view in listed():
        assert f"export function {view['name']}(" in scripts()[view["script"]].read_text(encoding="utf-8")
    assert len({view.name for view in views()}) == len(views())


class Pair(msgspec.Struct):
    frame: int
    playing: bool


def looked(state: State) -> Look:
    posted: list[do.Command] = []
    return Look(SimpleNamespace(post=posted.append, posted=posted), "", state, state, None)  # type: ignore[arg-type]


def made(monkeypatch: pytest.MonkeyPatch, of: Any) -> ViewNews:
    monkeypatch.setattr(view_values, "views", lambda: [View("pair", "Explain", 1, of)])
    monkeypatch.setattr(view_values, "listed", lambda: [{"name": "pair"}])
    return ViewNews()


def test_a_field_is_sent_when_it_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    news = made(monkeypatch, lambda state, run, frame: Pair(frame, state.playing))
    state = State("double:5")
    first = news.of(looked(state))
    assert first["views"] == {"pair": {"frame": -1, "playing": False}} and first["panels"]
    assert news.of(looked(state)) == {}
    assert news.of(looked(reduce(state, changed(playing=True)))) == {"views": {"pair": {"playing": True}}}


def test_a_view_that_fails_is_reported_once(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    def broken(state: State, run: object, frame: int) -> Pair:
        raise ValueError("no such colour")

    news, look = made(monkeypatch, broken), looked(State("double:5"))
    with caplog.at_level(logging.CRITICAL):
        assert "views" not in news.of(look) and "views" not in news.of(look)
    (notice,) = look.session.posted  # type: ignore[attr-defined]
    assert isinstance(notice, do.Notify) and "no such colour" in notice.text
