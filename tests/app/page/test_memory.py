"""What the browser holds after many runs and reloads, with the real Rerun viewer."""

from __future__ import annotations

import json

import pytest

from tests.app.page import memory
from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
MOST_BYTES = 1_500_000_000
"""Of all Chromium's processes, software graphics included."""
RUNS, RELOADS = 4, 2
HELD = """async () => {
  const { recordings } = await window.ispom.viewer.handle.get_state();
  return JSON.stringify(recordings.map(({ store_id }) => store_id));
}"""


def drawn(page: Page) -> None:
    page.until("state.ended && window.ispom.viewer.shown?.endsWith(state.recording_id)", "the run to be drawn")
    page.tab.locator("#cover").wait_for(state="hidden")
    page.until("!document.getElementById('behind').textContent", "the last frame to be drawn")


def held(page: Page) -> list[str]:
    """The recordings in the viewer."""
    return json.loads(page.tab.evaluate(HELD))


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
    assert held(page) == [f"Recording:ispom:{page.state['recording_id']}"]
    for _ in range(RELOADS):
        page.tab.reload()
        drawn(page)
        assert held(page) == [f"Recording:ispom:{page.state['recording_id']}"]
    assert memory.of_browser().total() < MOST_BYTES, memory.of_browser()
    assert not page.faults
    page.tab.close()
