"""Two browsers at one session: the second one follows, looks around, takes over and is handed over to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FAKE = Path(__file__).with_name("fake_viewer.js").read_text()


@pytest.fixture(scope="module")
def both(browser, app: App) -> Iterator[tuple[Page, Page]]:  # noqa: F811
    driver, follower = (Page(browser, app.url, viewer=FAKE) for _ in range(2))
    driver.until("state.ended && !state.playing", "the end")
    follower.until("state.people.driver === 1", "the first one drives")
    yield driver, follower
    for page in (driver, follower):
        assert not page.faults
        page.tab.close()


def seek(page: Page, index: int) -> None:
    page.send(f"{{do: 'seek', index: {index}}}")


def test_one_who_does_not_drive_looks_at_other_exposures_alone(both: tuple[Page, Page]):
    driver, follower = both
    seek(driver, 20)
    follower.until("window.ispom.shown.index === 20", "to follow")
    follower.tab.keyboard.press("ArrowLeft")
    follower.until(
        "window.ispom.shown.index === 19 && window.ispom.viewer.cursor.sent === 19", "a look at the one before"
    )
    assert "look at" not in driver.tab.locator("#people").inner_text()
    seek(driver, 22)
    follower.until("state.index === 22 && window.ispom.shown.index === 19", "to stay where they look")
    assert "Person 1 drives, you look at exposure 19" in follower.tab.locator("#people").inner_text()
    follower.tab.get_by_role("button", name="Follow").click()
    follower.until("window.ispom.shown.index === 22", "to follow again")


def test_what_they_cannot_do_is_said_and_changes_nothing(both: tuple[Page, Page]):
    driver, follower = both
    seek(driver, 20)
    follower.until("window.ispom.shown.index === 20", "to follow")
    follower.tab.keyboard.press("Space")
    follower.tab.get_by_text("Person 1 drives this session; take over to change it.").wait_for()
    follower.send("{do: 'seek', index: 3}")  # past the page, as a script would
    seek(driver, 21)
    follower.until("state.index === 21 && !window.ispom.state.playing", "only the driver's command")
    panel = follower.tab.frame_locator("#controls")
    play = panel.get_by_role("button", name="Play").first
    assert play.evaluate("(e) => getComputedStyle(e).pointerEvents") == "none"
    assert panel.get_by_role("tab").first.evaluate("(e) => getComputedStyle(e).pointerEvents") == "auto"


def test_the_wheel_is_taken_and_handed_back(both: tuple[Page, Page]):
    driver, follower = both
    follower.tab.get_by_role("button", name="Take over").click()
    driver.until("state.people.driver === 2", "that the other one drives")
    driver.tab.get_by_text("Person 2 drives now.").wait_for()
    seek(follower, 7)
    driver.until("window.ispom.shown.index === 7", "to follow")
    follower.tab.get_by_role("button", name="Hand over to person 1").click()
    driver.until("state.people.driving", "to drive again")
    seek(driver, 9)
    follower.until("window.ispom.shown.index === 9", "to follow")
