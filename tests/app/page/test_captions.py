"""Three captions in the picture on the first start in a browser: gone at the first action, and then for good."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FORBIDDEN = (
    "Object.defineProperty(window, 'localStorage', { get() { throw new DOMException('no', 'SecurityError'); } })"
)

INSIDE = """(captions) => {
  const { left, top, right, bottom } = document.getElementById("viewer").getBoundingClientRect();
  const boxes = captions.map((caption) => caption.getBoundingClientRect());
  return boxes.every((box) => box.left >= left && box.right <= right && box.top >= top && box.bottom <= bottom);
}"""
"""At one time: the run goes on, and the viewer may get smaller."""


def first(browser, app: App, before: str = "") -> Page:  # noqa: F811
    """In a browser that was never here, when there is something to act on."""
    page = Page(browser, app.url, viewer=FAKE, before=before)
    page.until("state.index >= 0", "the state")
    return page


@pytest.mark.parametrize(
    "act",
    [lambda tab: tab.keyboard.press("Space"), lambda tab: tab.locator("#transport [data-do=back]").click()],
    ids=["key", "click"],
)
def test_they_are_gone_at_the_first_action(browser, app: App, act: Callable) -> None:  # noqa: F811
    page = first(browser, app)
    captions = page.tab.locator("#captions")
    captions.wait_for()
    assert captions.locator("li").count() == 3
    assert captions.locator("li").evaluate_all(INSIDE)
    act(page.tab)  # the action itself is not held up
    captions.wait_for(state="hidden")
    page.tab.reload()
    page.until("state.index >= 0", "the state")
    assert not captions.is_visible() and not page.faults
    page.tab.close()


def test_the_left_pane_counts_as_well(browser, app: App) -> None:  # noqa: F811
    page = first(browser, app)
    page.tab.locator("#captions").wait_for()
    page.controls.get_by_role("tab", name="Methods").click()
    page.tab.locator("#captions").wait_for(state="hidden")
    page.tab.close()


def test_a_browser_that_remembers_nothing_has_them_with_each_page(browser, app: App) -> None:  # noqa: F811
    page = first(browser, app, FORBIDDEN)
    page.tab.locator("#captions").wait_for()
    page.tab.keyboard.press("k")
    page.tab.locator("#captions").wait_for(state="hidden")
    assert not page.faults
    page.tab.close()
