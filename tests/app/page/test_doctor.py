"""The doctor in the page: "Diagnose" below an event examines that one, and the answer leads to frames."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.app.page.serve_double import LOSSY
from tests.app.page.test_browser import CHROMIUM, TOTAL, App, Page, browser, page_at, serving  # noqa: F401 - a fixture

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
LOST = 24
"""Where the monocular stand-in is lost."""
PATIENCE_MS = 120_000
"""An examination may take a minute, and begins nothing new after that."""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    yield from serving("serve_double", tmp_path_factory.mktemp("doctor"), "0", LOSSY)


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app, f"state.computed === {TOTAL}") as opened:
        opened.send("{do: 'seek', index: window.ispom.state.total - 1}")
        opened.until("state.index === state.total - 1 && !state.playing", "the last frame")
        yield opened


def test_why_below_an_event_examines_that_event(page: Page) -> None:
    assert page.state["doctor"] == {"at": None, "running": False, "causes": None}
    why = page.explain.locator("button[data-doctor]").first
    frame = int(why.get_attribute("data-doctor") or "")
    why.click()
    page.until(f"state.doctor.at === {frame}", "the examination")
    page.until("!state.doctor.running && state.doctor.causes", "the answer", PATIENCE_MS)
    answer = page.explain.locator("[data-cause]")
    answer.locator("details summary").click()
    shown = answer.locator("button[data-seek]").first
    wanted = int(shown.get_attribute("data-seek") or "")
    shown.click()
    page.until(f"state.index === {wanted}", "the frame that shows it")


def test_the_answer_line_diagnoses_what_holds_at_the_frame(page: Page) -> None:
    page.send(f"{{do: 'seek', index: {LOST}}}")
    page.until(f"state.index === {LOST}", "the frame")
    line = page.tab.locator("#answer .answer.lost")
    line.wait_for()
    height = page.tab.locator("#panes").bounding_box()["y"]
    line.get_by_role("button", name="Diagnose").click()
    page.until(f"state.doctor.at === {LOST}", "the examination")
    page.until("!state.doctor.running && state.doctor.causes", "the answer", PATIENCE_MS)
    page.tab.locator("#answer .answer.lost").wait_for()
    assert page.tab.locator("#answer .line").get_attribute("title")
    assert page.tab.locator("#panes").bounding_box()["y"] == height, "the line shifts nothing"
