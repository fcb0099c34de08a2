"""Picking in the Look tab, in a real browser: what the state becomes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser  # noqa: F401 - fixtures
from tests.app.page.test_in_the_page import FAKE

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    opened = Page(browser, app.url, viewer=FAKE)
    opened.until("state.ended && !state.playing", "the end")
    opened.controls.get_by_role("tab", name="Look").click()
    opened.controls.locator("svg[data-pick]").wait_for()
    yield opened
    assert not opened.faults
    opened.tab.close()


def choose(page: Page, now: str, wanted: str) -> None:
    """In the list that stands at `now`."""
    page.controls.locator(f"input:visible[value='{now}']").first.click()
    page.controls.get_by_role("option", name=wanted, exact=True).click()


def test_a_click_in_the_picture_picks_a_track_that_survives_a_reload(page: Page):
    picture = page.controls.locator("svg[data-pick]")
    box = picture.bounding_box()
    picture.click(position={"x": 0.3 * box["width"], "y": 0.6 * box["height"]})
    page.until("/^track:[a-z.]+:[0-9]+$/.test(state.selected)", "a selected track")
    chosen = page.state["selected"]
    number = chosen.split(":")[-1]
    page.controls.get_by_text(f"Track {number} of").wait_for()
    page.tab.reload()
    page.until("state.total > 0", "the state")
    assert page.state["selected"] == chosen
    page.controls.get_by_role("tab", name="Look").click()
    page.controls.get_by_text(f"Track {number} of").wait_for()


def test_a_chip_shows_its_exposure(page: Page):
    page.send("{do: 'select', what: 'track:monocular:30'}")
    page.controls.get_by_text("Track 30 of").wait_for()
    chip = page.controls.locator("[data-seek]").first
    index = chip.get_attribute("data-seek")
    chip.click()
    page.until(f"state.index === {index}", "the exposure of the chip")
    page.send("{do: 'end'}")
    page.until("state.index === state.computed - 1", "the end")


def test_a_row_of_the_table_is_selected_by_click_and_by_key(page: Page):
    choose(page, "track", "tracks")
    page.until("state.look === 'tracks'", "the table")
    rows = page.controls.locator("tr[data-select]")
    rows.nth(1).wait_for()
    wanted = [rows.nth(i).get_attribute("data-select") for i in (0, 1)]
    rows.nth(1).click()
    page.until(f"state.selected === '{wanted[1]}'", "the row that was clicked")
    rows.nth(0).focus()
    rows.nth(0).press("Enter")
    page.until(f"state.selected === '{wanted[0]}'", "the row where Enter was pressed")


def test_a_key_frame_is_selected_in_the_matrix(page: Page):
    choose(page, "tracks", "key frames")
    page.until("state.look === 'key frames'", "the matrix")
    name = page.controls.locator("text[data-select]").first
    wanted = name.get_attribute("data-select")
    name.click()
    page.until(f"state.selected === '{wanted}'", "the key frame")
    page.controls.get_by_text(f"Key frame {wanted.split(':')[-1]}").wait_for()


def test_colours_and_camera_are_the_states(page: Page):
    choose(page, "state", "age")
    page.until("state.colour_by === 'age'", "the colouring")
    page.until("state.hidden.some((path) => path.includes('video/tracks/'))", "the layout of Rerun")
    page.controls.get_by_text("age [exposures of the camera]").wait_for()
    page.controls.get_by_role("button", name="left image", exact=True).click()
    page.until("state.camera === 'left'", "the camera")
    page.controls.locator("svg[data-pick=left]").wait_for()


def test_what_cannot_be_selected_is_said(page: Page):
    page.send("{do: 'select', what: 'the moon'}")
    page.tab.locator(".notice", has_text="cannot be selected").wait_for()
