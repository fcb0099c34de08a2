"""Published lessons in a browser, from a plain file server; a stand-in draws in place of Rerun."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, browser  # noqa: F401 - a fixture
from tests.app.page.test_lessons import Learner, answer

from .test_in_browser import served

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FRAME, LAST = 5, 26
"""Of the first question; of the run."""


@pytest.fixture(scope="module")
def page(browser, lessons: Path) -> Iterator[Learner]:  # noqa: F811
    with served(lessons) as url:
        found = Learner(browser, url, viewer=FAKE)
        yield found
        assert not found.faults and all(request.startswith((url, "blob:", "data:")) for request in found.requests)
        found.tab.close()


def test_the_list_is_shown_and_nothing_is_drawn_before_a_lesson_is_chosen(page: Learner) -> None:
    page.tab.locator("#learn [data-learn=own]").wait_for()
    assert page.tab.evaluate("window.ispom.viewer.handle") is None
    page.tab.locator("#learn [data-learn=own]").click()
    page.asked("Choose")
    page.until("window.ispom.viewer.handle", "the viewer")


def test_an_open_question_covers_what_the_run_did(page: Learner) -> None:
    state = page.state
    assert state["index"] == FRAME and state["computed"] == FRAME + 1 and state["methods"] == []
    assert page.tab.evaluate("window.ispom.axis.methods.length + window.ispom.axis.events.length") == 0
    assert page.tab.locator("#plots .plot").count() == 0
    assert any("truth" in path for path in state["hidden"]) and any("branches/1" in path for path in state["hidden"])
    page.tab.keyboard.press("End")
    page.until(f"state.index === {FRAME}", "no later frame")
    page.send("{do: 'plot', name: 'alive'}")
    page.tab.locator("#notices .notice", has_text="question").wait_for()


def test_the_answer_is_judged_and_the_run_is_there(page: Learner) -> None:
    page.tab.locator("#lesson .option").nth(0).click()
    page.tab.locator("#lesson").get_by_role("button", name="Run and reveal").click()
    page.tab.locator("#lesson .verdict.right").wait_for()
    page.until(f"state.index === {LAST} && state.computed === {LAST + 1}", "the end")
    page.until("state.methods.length > 0 && window.ispom.axis.methods.length > 0", "what the methods did")
    assert not [path for path in page.state["hidden"] if "truth" in path or "branches" in path]
    page.tab.locator("#plots .whose", has_text="other").first.wait_for()


def test_each_kind_of_question_is_answered_and_the_runs_change(page: Learner) -> None:
    recording = page.state["recording_id"]
    for title in ("Give a number", "Point", "Draw"):
        page.tab.locator("#lesson").get_by_role("button", name="Next").click()
        page.asked(title)
        answer(page)
        page.tab.locator("#lesson").get_by_role("button", name="Run and reveal").click()
        page.revealed()
        page.tab.locator("#lesson .verdict").first.wait_for()
        if title == "Give a number":
            page.until("state.computed === 9 && state.index === 8", "the run up to a frame")
    assert page.state["recording_id"] != recording
    assert page.tab.locator("#lesson polyline.right").count() == 1


def test_the_address_leads_to_a_step_and_what_was_done_is_kept(page: Learner) -> None:
    page.until("location.hash === '#lesson=own:4'", "the address")
    page.tab.evaluate("location.hash = '#lesson=own:2'")
    page.asked("Give a number")
    page.tab.reload()
    page.asked("Give a number")
    page.tab.locator("#lesson").get_by_role("button", name="end the lesson").click()
    page.tab.locator("#lesson").wait_for(state="hidden")
    page.tab.locator("#learn [data-learn=own]", has_text="done").wait_for()
