"""Stepping through events in the page, by key and by click; a stand-in draws in place of Rerun."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, app, browser, page_at  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app) as opened:
        for index in (12, 30):
            opened.send(f"{{do: 'seek', index: {index}}}")
            opened.until(f"state.index === {index}", "the frame")
            opened.send("action('bookmark')")
            opened.until(f"window.ispom.axis.marks.bookmarks?.marks.some(({{ at }}) => at === {index})", "the bookmark")
        yield opened


def test_n_and_shift_n_go_to_the_next_and_the_previous_event(page: Page) -> None:
    page.send("{do: 'seek', index: 20}")
    page.until("state.index === 20", "the frame between")
    page.tab.keyboard.press("n")
    page.until("state.index === 30", "the next event")
    page.tab.keyboard.press("Shift+n")
    page.until("state.index === 12", "the previous event")


def test_a_click_on_an_event_goes_to_its_frame(page: Page) -> None:
    page.explain.locator('button[data-seek="30"]').click()
    page.until("state.index === 30", "the event's frame")
    page.explain.locator('button[data-seek="30"][aria-current=true]').wait_for()
