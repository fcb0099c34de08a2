"""The tour on the first start: six steps with the keyboard alone, or skipped, and then never again."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FAKE = Path(__file__).with_name("fake_viewer.js").read_text()
FORBIDDEN = (
    "Object.defineProperty(window, 'localStorage', { get() { throw new DOMException('no', 'SecurityError'); } })"
)


def first(browser, app: App) -> Page:  # noqa: F811
    """In a browser that was never here."""
    return Page(browser, app.url, viewer=FAKE, before="")


def test_enter_goes_through_it_and_every_card_is_on_the_screen(browser, app: App) -> None:  # noqa: F811
    page = first(browser, app)
    card, titles = page.tab.locator("#tour"), []
    card.wait_for()
    while card.is_visible():
        titles.append(card.locator("b").inner_text())
        box = card.bounding_box()
        assert box["x"] >= 0 and box["y"] >= 0 and box["x"] + box["width"] <= 1280 and box["y"] + box["height"] <= 720
        assert card.locator("span").inner_text() == f"{len(titles)} of 6"
        page.tab.keyboard.press("Enter")
    assert titles == ["Methods", "Time", "Explain", "Try something else", "Views", "Keys"]
    assert not page.tab.locator("#tour-frame").is_visible() and not page.faults
    page.tab.close()


def test_skipped_it_never_returns_and_the_list_of_keys_has_it(browser, app: App) -> None:  # noqa: F811
    page = first(browser, app)
    page.tab.locator("#tour").wait_for()
    page.tab.keyboard.press("Escape")
    page.tab.locator("#tour").wait_for(state="hidden")
    page.tab.reload()
    page.until("state.index >= 0", "the state")
    assert not page.tab.locator("#tour").is_visible()
    page.tab.keyboard.press("?")
    page.tab.get_by_role("button", name="Tour of the page").click()
    page.tab.locator("#tour").get_by_text("1 of 6").wait_for()
    page.tab.get_by_role("button", name="Skip").click()
    assert not page.tab.locator("#tour").is_visible() and not page.faults
    page.tab.close()


def test_what_is_beneath_it_can_be_used(browser, app: App) -> None:  # noqa: F811
    page = first(browser, app)
    page.tab.locator("#tour").wait_for()
    page.until("state.ended && !state.playing", "the end")
    page.tab.locator("#transport [data-do=back]").click()
    page.until("state.index === 42", "a step back")
    assert page.tab.locator("#tour").is_visible()
    page.tab.keyboard.press("Escape")  # wherever the focus is by now: the viewer takes it as it starts
    page.tab.locator("#tour").wait_for(state="hidden", timeout=5000)
    assert not page.tab.locator("#tour-frame").is_visible() and not page.faults
    page.tab.close()


def test_a_browser_without_storage_does_not_get_the_tour_again_and_again(browser, app: App) -> None:  # noqa: F811
    page = Page(browser, app.url, viewer=FAKE, before=FORBIDDEN)
    page.until("state.index >= 0", "the state")
    assert not page.tab.locator("#tour").is_visible() and not page.faults
    page.tab.keyboard.press("?")
    page.tab.get_by_role("button", name="Tour of the page").click()
    page.tab.locator("#tour").wait_for()
    page.tab.close()
