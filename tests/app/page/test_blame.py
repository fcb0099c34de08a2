"""What moved a pose, in the page: the button answers, and a click on a row shows its tracks in the image."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import AT_ONCE, CHROMIUM, App, Page, browser, page_at, tiny  # noqa: F401 - fixtures

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium"),
]
AT = 12
"""The second stereo frame."""


@pytest.fixture(scope="module")
def page(browser, tiny: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, tiny, AT_ONCE) as opened:
        opened.send(f"{{do: 'seek', index: {AT}}}")
        opened.until(f"state.index === {AT}", "the frame")
        yield opened


def test_a_click_on_a_row_shows_its_tracks(page: Page):
    page.explain.get_by_text("What decided this pose", exact=True).click()
    page.explain.get_by_role("button", name="Which points decided this pose?").click()
    page.until("state.blame.includes('stereo')", "the answer")
    row = page.explain.locator("[data-select^='tracks:stereo:']").first
    wanted = row.get_attribute("data-select")
    row.click()
    page.until(f"state.selected === '{wanted}'", "the tracks")
    page.controls.get_by_role("tab", name="Tracks", exact=True).click()
    page.controls.locator("svg[data-pick] circle").nth(2).wait_for()
