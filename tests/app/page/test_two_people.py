"""Two browsers at one session: the second one follows, looks around, takes over and is handed over to."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


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
        "window.ispom.shown.index === 19 && window.ispom.viewer.stage.shown?.index === 19", "a look at the one before"
    )
    seek(driver, 22)
    driver.until("state.index === 22", "the seek")
    assert "look at" not in driver.tab.locator("#people").inner_text()
    follower.until("state.index === 22 && window.ispom.shown.index === 19", "to stay where they look")
    assert "Person 1 is in control, you look at frame 19" in follower.tab.locator("#people").inner_text()
    follower.tab.locator("#people").get_by_role("button", name="Follow").click()
    follower.until("window.ispom.shown.index === 22", "to follow again")


LOOKS = {
    "k": "window.ispom.shown.index === 22",
    "Shift+k": "window.ispom.shown.index === 17",
    "Shift+ArrowRight": "window.ispom.shown.index === 23",
    "Shift+ArrowLeft": "window.ispom.shown.index === 12",
    "Home": "window.ispom.shown.index === 0",
    "i": "window.ispom.shown.loop?.[0] === 20",
    "Space": "window.ispom.shown.playing || window.ispom.shown.index > 21",
}
"""Of each key at frame 20, as in test_keys.py."""


@pytest.mark.parametrize("key", LOOKS)
def test_every_key_that_only_looks_is_theirs(both: tuple[Page, Page], key: str):
    """All but arrows, Home and End were refused, in a sentence that said "you can look at any frame"."""
    driver, follower = both
    follower.send("{do: 'follow'}")
    seek(driver, 20)
    follower.until("window.ispom.shown.index === 20 && state.looking === null", "to follow")
    follower.tab.keyboard.press(key)
    follower.until(LOOKS[key], key)
    follower.until(
        "document.getElementById('exposure').textContent.includes(` ${window.ispom.shown.index} /`)", "the bar"
    )
    assert follower.tab.locator(".notice").count() == 0
    assert (driver.state["index"], driver.state["playing"], driver.state["loop"]) == (20, False, None)


def test_their_buttons_play_and_step_and_their_bar_has_the_numbers_of_their_exposure(both: tuple[Page, Page]):
    driver, follower = both
    follower.send("{do: 'follow'}")
    seek(driver, 13)  # the first one at which the single camera has a unit, and so an error
    follower.until("window.ispom.shown.index === 13 && state.looking === null", "to follow")
    errors = "[...document.querySelectorAll('#methods .method')].map((e) => e.title).join()"  # with the live ones
    count = f"{errors}.match(/(ATE|Live error)[^\\n]*[0-9] mm/g).length"
    follower.until(f"{count} === 6", "an ATE and a live error of each method")
    follower.tab.get_by_role("button", name="◀ Step").click()
    follower.until("window.ispom.shown.index === 12", "the step")
    follower.until(f"{count} === 5", "the errors at that frame")
    seek(driver, 12)
    driver.until(f"state.index === 12 && {errors} === {json.dumps(follower.tab.evaluate(errors))}", "the same frame")
    follower.tab.get_by_role("button", name="▶ Play").click()
    follower.until("!window.ispom.shown.playing && window.ispom.shown.index === 43", "the end")
    assert driver.state["index"] == 12 and not driver.state["playing"]
    follower.tab.locator("#people").get_by_role("button", name="Follow").click()


def test_unavailable_actions_are_reported_and_change_nothing(both: tuple[Page, Page]):
    driver, follower = both
    seek(driver, 20)
    follower.until("window.ispom.shown.index === 20", "to follow")
    follower.tab.keyboard.press("m")
    follower.tab.get_by_text("Person 1 is in control of this session; take over to change it.").wait_for()
    follower.send("{do: 'seek', index: 3}")  # past the page, as a script would
    seek(driver, 21)
    follower.until("state.index === 21 && !window.ispom.state.playing", "only the driver's command")
    assert not driver.tab.evaluate("window.ispom.axis.marks.bookmarks?.marks.length")
    follower.send("{do: 'follow'}")
    step = follower.explain.locator(".act").first
    assert step.evaluate("(e) => getComputedStyle(e).pointerEvents") == "none"
    panel = follower.controls
    button = panel.locator("button.mantine-Button-root").first
    assert button.evaluate("(e) => getComputedStyle(e).pointerEvents") == "none"
    assert panel.get_by_role("tab").first.evaluate("(e) => getComputedStyle(e).pointerEvents") == "auto"


def test_the_wheel_is_taken_and_handed_back(both: tuple[Page, Page]):
    driver, follower = both
    follower.tab.get_by_role("button", name="Take over").click()
    driver.until("state.people.driver === 2", "that the other one drives")
    driver.tab.get_by_text("Person 2 is in control now.").wait_for()
    seek(follower, 7)
    driver.until("window.ispom.shown.index === 7", "to follow")
    follower.tab.get_by_role("button", name="Hand over to person 1").click()
    driver.until("state.people.driving", "to drive again")
    seek(driver, 9)
    follower.until("window.ispom.shown.index === 9", "to follow")


def test_the_last_browser_that_is_left_is_in_control(browser, app: App, both: tuple[Page, Page]):  # noqa: F811
    """It said "Nobody drives, you follow", and its buttons and sliders were dead."""
    driver, follower = both
    seek(driver, 20)
    follower.until("window.ispom.shown.index === 20", "to follow")
    driver.tab.goto(app.url.replace("?", "calibration?"))  # a page of the app, but none of the session
    follower.until("state.people.driving && state.people.others.length === 0", "to drive")
    assert follower.tab.locator("#people").inner_text() == ""
    panel = follower.controls
    panel.get_by_role("tab", name="Files").click()
    panel.get_by_role("button", name="Bookmark this frame").click()
    follower.until(
        "window.ispom.axis.marks.bookmarks?.marks.some(({ at }) => at === 20)", "what the panel's button does"
    )
    driver.tab.goto(app.url)
    driver.until("state.total > 0 && state.people.driver === 2", "the other one to drive")
