"""The time axis: what a page is told of a run, and what it shows and does in a browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import pytest
from ispom_app.engine.conditions.parser import parse
from ispom_app.engine.playback import Playback
from ispom_app.features.breakpoints import axis
from ispom_app.session.branches.branches import Branch
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State
from ispom_app.views.web.time_axis import AxisNews

from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build_full, with_values
from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser, expect, page_at  # noqa: F401 - fixtures


@pytest.fixture
def run() -> CurrentRun:
    return CurrentRun(Playback(doubles.sequence(40), METHODS, builder=build_full), 10**8)


def told(parts: list[dict]) -> list[tuple[list[int], list[list[int]]]]:
    """Of each method: its keyframes and losses, as a page puts them together."""
    found: list[tuple[list[int], list[list[int]]]] = [([], []) for _ in METHODS]
    for part in parts:
        for (keys, lost), result in zip(found, part.get("results", ()), strict=False):
            keys.extend(result["key_frames"])
            for first, last in result["lost"]:
                if lost and lost[-1][1] == first - 1:
                    lost[-1][1] = last
                else:
                    lost.append([first, last])
    return found


def test_in_increments_a_page_hears_what_one_that_comes_late_hears(run: CurrentRun) -> None:
    early, parts = AxisNews(), []
    state = State("double:40")
    while not run.playback.done:
        run.step()
        parts.append(early.since(state, run))
    assert early.since(state, run) is None, "each frame is told once"
    late = AxisNews().since(state, run)
    assert late is not None and told(parts) == told([late])
    assert parts[0]["kinds"] == late["kinds"] and late["kinds"].count("s") == 4
    for method, (keys, lost) in zip(METHODS, told([late]), strict=True):
        steps = [(r.index, s) for r in run.history for s in r.steps if s.method == method]
        assert keys == [i for i, s in steps if s.key_frame]
        assert [i for i, s in steps if s.status == "lost"] == [i for i, s in steps if any(a <= i <= b for a, b in lost)]


def test_matches_come_in_slices(run: CurrentRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(axis, "SLICE", 10)
    while not run.playback.done:
        run.step()
    state = with_values(State("double:40"), marked=parse('monocular.status == "lost"', run.series.quantities))
    news = AxisNews()
    parts = [part["marks"]["matches"] for part in iter(lambda: news.since(state, run), None)]
    assert all(mark["at"] // 10 == number for number, part in enumerate(parts) for mark in part["marks"])
    assert parts[0]["label"] == 'monocular.status == "lost"' and parts[-1]["more"]
    assert [mark["at"] for part in parts for mark in part["marks"]] == [
        r.index for r in run.history for s in r.steps if s.method == "monocular" and s.status == "lost"
    ]
    gone = news.since(with_values(state, marked=None), run)
    assert gone is not None and gone["marks"]["matches"]["label"] == "" and not gone["marks"]["matches"]["marks"]


def test_starts_of_branches_are_sent_only_when_they_change(run: CurrentRun) -> None:
    run.step()
    news, first = AxisNews(), Branch(0, "first run")
    state = with_values(State("double:40"), branches=(first, Branch(1, "other", 0, 9)))
    marks = (news.since(state, run) or {})["marks"]["branches"]["marks"]
    assert [(mark["at"], mark["text"], mark["colour"]) for mark in marks] == [(9, "other begins", "#56b4e9")]
    longer = with_values(state, branches=(replace(first, computed=7), Branch(1, "other", 0, 9)))
    assert news.since(longer, run) is None
    assert news.since(with_values(state, branches=(first,)), run) == {
        "marks": {"branches": {"sign": "flag", "marks": []}}
    }


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app) as opened:
        yield opened


in_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@in_chromium
def test_a_click_and_a_drag_on_the_axis_seek(page: Page) -> None:
    dock = page.tab.locator("#axis")
    dock.click(position={"x": 176 + 452, "y": 6})
    page.until("Math.abs(state.index - 21) <= 1", "the middle")
    dock.click(position={"x": 172, "y": 20})
    page.until("state.index === 0", "the first")
    box = dock.bounding_box()
    page.tab.mouse.move(box["x"] + 400, box["y"] + 5)
    page.tab.mouse.down()
    for x in (500, 900, 1278):
        page.tab.mouse.move(box["x"] + x, box["y"] + 300)
        page.until(f"state.index >= {min(int((x - 196) / 904 * 43), 43)}", "the drag")
    page.tab.mouse.up()
    page.until("state.index === 43", "the last")


@in_chromium
def test_a_loop_is_dragged_by_its_edges_and_its_bar_and_moved_by_key(page: Page) -> None:
    page.send("{do: 'set_loop', start: 10, end: 30}")
    page.until("String(state.loop) === '10,30'", "the loop")
    index = page.state["index"]

    def drag(part: str, by: float) -> None:
        box = page.tab.locator(part).bounding_box()
        at, y = box["x"] + box["width"] / 2, box["y"] + 2
        page.tab.mouse.move(at, y)
        page.tab.mouse.down()
        page.tab.mouse.move(at + by / 2, y + 40)
        page.tab.mouse.move(at + by, y + 40)
        page.tab.mouse.up()

    step = 904 / 43  # pixels of a frame, about: stereo frames come between
    drag("[data-part=start]", 5 * step)
    page.until("state.loop[0] > 12 && state.loop[0] < 18 && state.loop[1] === 30", "its first frame")
    drag("[data-part=end]", -40 * step)
    page.until("state.loop[1] === state.loop[0] + 1", "its last frame, which stays behind the first")
    drag(".loop-bar", -30 * step)
    page.until("String(state.loop) === '0,1'", "both")
    page.tab.locator("[data-part=start]").focus()
    page.tab.keyboard.press("Tab")
    page.tab.keyboard.press("ArrowRight")
    page.until("String(state.loop) === '0,2'", "the edge that has the focus")
    assert page.state["index"] == index, "nothing else moves"
    page.send("action('no_loop')")
    page.until("state.loop === null && document.querySelectorAll('.loop-edge:not([hidden])').length === 0", "no loop")


@in_chromium
def test_hovering_says_exposure_time_and_what_happened(page: Page) -> None:
    hint = page.tab.locator("#axis-hint")
    page.tab.locator("#axis").hover(position={"x": 1270, "y": 26})
    expect(hint).to_have_text(re.compile(r"^Video frames\nframe 43 · 1\.30 s · video(\n|$)"))
    page.tab.locator("#axis").hover(position={"x": 177, "y": 54})
    begin = r"^Monocular: marks are keyframes, red is lost\nframe 0 · 0\.00 s · video\n"
    expect(hint).to_have_text(re.compile(begin + r"(.*\n)*Monocular: keyframe(\n|$)"))
    page.tab.locator("#canvas").hover()
    hint.wait_for(state="hidden")


@in_chromium
def test_the_axis_marks_where_a_condition_holds_and_where_a_branch_begins(page: Page) -> None:
    page.controls.get_by_role("tab", name="Breakpoints").click()
    field = page.controls.get_by_role("textbox").last
    field.fill("stereo.key_frame")
    page.controls.get_by_text("holds at 1 of 44").wait_for()
    page.controls.get_by_role("button", name="◀ Match").click()
    page.until("state.index === 1 && window.ispom.axis.marks.matches?.marks.length === 1", "the match")
    assert page.tab.evaluate("window.ispom.axis.marks.matches.marks.map(({ at }) => at)") == [1]
    page.controls.get_by_role("tab", name="Methods").click()
    page.controls.get_by_role("button", name="Fork").click()
    page.until("window.ispom.axis.marks.branches?.marks.length === 1", "the branch")
    assert page.tab.evaluate("window.ispom.axis.marks.branches.marks")[0]["at"] == 2
    page.until("state.ended && !state.playing && window.ispom.axis.computed === 44", "the branch's end")
