"""Picking in the Look tab, in a real browser: what the state becomes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, app, browser, expect, page_at  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app) as opened:
        opened.controls.get_by_role("tab", name="Tracks").click()
        opened.controls.locator("svg[data-pick]").wait_for()
        yield opened


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
    page.controls.get_by_role("tab", name="Tracks").click()
    page.controls.get_by_text(f"Track {number} of").wait_for()


def test_a_chip_shows_its_exposure(page: Page):
    page.send("{do: 'select', what: 'track:monocular:30'}")
    page.controls.get_by_text("Track 30 of").wait_for()
    chip = page.controls.locator("[data-seek]").first
    index = chip.get_attribute("data-seek")
    chip.click()
    page.until(f"state.index === {index}", "the frame of the chip")
    page.send("action('end')")
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


def redraw(page: Page, selected: str) -> None:
    """Selects one of the tracks, or none, and waits until the table is drawn again with its row in bold."""
    page.send(f"{{do: 'select', what: '{selected}'}}")
    bold = page.controls.locator("tr[data-select][style*='font-weight:700']")
    if selected:
        expect(bold).to_have_attribute("data-select", selected)
    else:
        expect(bold).to_have_count(0)


def scrolled(page: Page) -> list[float]:
    """How far each element is scrolled that the row in focus lies in [px]; empty without one."""
    script = "(e) => { const found = []; for (; e; e = e.parentElement) found.push(e.scrollTop); return found; }"
    focus = page.controls.locator("[data-select]:focus")
    return focus.evaluate(script) if focus.count() else []


def test_walking_the_rows_by_key_keeps_the_place_when_the_table_is_redrawn(page: Page):
    rows = page.controls.locator("tr[data-select]")
    wanted = [rows.nth(i).get_attribute("data-select") for i in range(15)]
    rows.nth(13).focus()
    before = scrolled(page)
    assert max(before) > 0
    redraw(page, wanted[2])
    assert scrolled(page) == before
    page.tab.keyboard.press("Enter")
    page.until(f"state.selected === '{wanted[13]}'", "the row that has the focus still")
    redraw(page, "")
    page.tab.keyboard.press("Tab")
    page.tab.keyboard.press("Enter")
    page.until(f"state.selected === '{wanted[14]}'", "the row below it")


def test_where_its_row_is_gone_the_focus_is_in_its_place_until_the_row_is_back(page: Page):
    rows, focus = page.controls.locator("tr[data-select]"), page.controls.locator("tr[data-select]:focus")
    rows.nth(3).focus()
    wanted, at_end = focus.get_attribute("data-select"), page.state["index"]
    page.send("{do: 'seek', index: 0}")
    page.controls.locator(f"tr[data-select='{wanted}']").wait_for(state="detached")
    assert focus.get_attribute("data-select") == rows.nth(3).get_attribute("data-select")
    page.send("action('end')")
    page.until(f"state.index === {at_end}", "the end")
    expect(focus).to_have_attribute("data-select", wanted)


def test_a_redrawn_part_takes_the_focus_from_nothing_outside_of_it(page: Page):
    rows = page.controls.locator("tr[data-select]")
    wanted = rows.nth(0).get_attribute("data-select")
    rows.nth(3).focus()
    page.tab.locator("#splitter").focus()
    redraw(page, wanted)
    assert page.tab.locator("#splitter:focus").count() == 1


def test_a_press_counts_where_the_table_is_redrawn_before_the_button_is_released(page: Page):
    rows = page.controls.locator("tr[data-select]")
    wanted = [rows.nth(i).get_attribute("data-select") for i in (1, 0, 4)]
    redraw(page, wanted[0])
    rows.nth(4).hover()
    page.tab.mouse.down()
    redraw(page, wanted[1])
    page.tab.mouse.up()
    page.until(f"state.selected === '{wanted[2]}'", "the row that was pressed")


def test_a_key_frame_is_selected_in_the_matrix(page: Page):
    choose(page, "tracks", "keyframes")
    page.until("state.look === 'keyframes'", "the matrix")
    name = page.controls.locator("text[data-select]").first
    wanted = name.get_attribute("data-select")
    name.click()
    page.until(f"state.selected === '{wanted}'", "the keyframe")
    page.controls.get_by_text(f"Keyframe {wanted.split(':')[-1]}").wait_for()


def test_colours_and_camera_are_the_states(page: Page):
    choose(page, "state", "age")
    page.until("state.colour_by === 'age'", "the colouring")
    page.until("state.hidden.some((path) => path.includes('video/tracks/'))", "the layout of Rerun")
    page.controls.get_by_text("age [frames of the camera]").wait_for()
    page.controls.get_by_role("button", name="left image", exact=True).click()
    page.until("state.camera === 'left'", "the camera")
    page.controls.locator("svg[data-pick=left]").wait_for()


def test_what_cannot_be_selected_is_reported(page: Page):
    page.send("{do: 'select', what: 'the moon'}")
    page.tab.locator(".notice", has_text="cannot be selected").wait_for()
