"""What the browser holds after many runs and reloads, with the real Rerun viewer."""

from __future__ import annotations

import pytest

from tests.app.page import memory
from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
MOST_BYTES = 1_500_000_000
"""Of all Chromium's processes, software graphics included."""
RUNS, RELOADS = 4, 2
HELD = "(await window.ispom.viewer.handle.get_state()).recordings.map(({ store_id }) => store_id).join()"
"""The recordings in the viewer."""


def drawn(page: Page) -> None:
    page.until("state.ended && window.ispom.viewer.shown?.endsWith(state.recording_id)", "the run to be drawn")
    page.tab.locator("#cover").wait_for(state="hidden")
    page.until("!document.getElementById('behind').textContent", "the last frame to be drawn")


def alone(page: Page) -> None:
    """The viewer holds nothing but the run."""
    page.until(f"{HELD} === `Recording:ispom:${{state.recording_id}}`", "earlier runs to be closed")


@pytest.mark.slow
def test_runs_that_are_over_leave_the_browsers_memory(browser, app: App):  # noqa: F811
    page = Page(browser, app.url)
    drawn(page)
    page.controls.get_by_role("tab", name="Methods").click()
    for run in range(2, 2 + RUNS):
        page.controls.get_by_role("button", name="Apply and restart").click()
        page.until(f"state.run === {run}", "the next run")
        drawn(page)
        page.until("window.ispom.viewer.handle", "the viewer")
    alone(page)
    for _ in range(RELOADS):
        page.tab.reload()
        drawn(page)
        alone(page)
    assert memory.of_browser().total() < MOST_BYTES, memory.of_browser()
    assert not page.faults
    page.tab.close()
