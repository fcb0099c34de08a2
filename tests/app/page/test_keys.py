"""Each key and each button of the moves, in the page; a stand-in draws in place of Rerun."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.session.actions import actions

from tests.app.page.test_browser import CHROMIUM, ENDED, App, Page, app, browser, expect, page_at  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FROM = 20
CONSEQUENCES = {
    "play": "state.playing || state.index > 21",  # by more than a step
    "forward": "state.index === 21",
    "back": "state.index === 19",
    "stereo": "state.index === 23",
    "stereo_back": "state.index === 12",
    "key_frame": "state.index === 22",
    "key_frame_back": "state.index === 17",
    "event": "state.notices.at(-1)?.text.startsWith('No event after')",  # of stand-ins that do nothing of note
    "event_back": "state.notices.at(-1)?.text.startsWith('No event before')",
    "start": "state.index === 0",
    "end": "state.index === 43",
    "loop_start": "state.loop?.[0] === 20 && state.loop[1] === null",
    "loop_end": "state.loop?.[0] === 0 && state.loop[1] === 20",
    "no_loop": "state.loop === null",
    "bookmark": "window.ispom.axis.marks.bookmarks?.marks[0]?.at === 20",
}
"""Of each action at frame 20, where the first and every fifth frame of a method is a keyframe."""
BUTTONS = ("back", "forward", "start", "end", "loop_start", "loop_end", "no_loop", "bookmark")
"""Those of the time dock."""


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app, f"{ENDED} && window.ispom.viewer.handle") as opened:
        yield opened


def begin(page: Page, name: str) -> None:
    """At frame 20, without a bookmark; with a loop, where it is to be taken away."""
    page.send("action('no_loop')")
    page.send(f"{{do: 'seek', index: {FROM}}}")
    page.until(f"state.index === {FROM} && state.loop === null && !state.playing", "the beginning")
    if name == "bookmark" and page.tab.evaluate("window.ispom.axis.marks.bookmarks?.marks.length"):
        page.send("action('bookmark')")
        page.until("window.ispom.axis.marks.bookmarks.marks.length === 0", "the bookmark to be gone")
    if name == "no_loop":
        page.send("action('loop_start')")
        page.until("state.loop !== null", "a loop")


def pressed(page: Page) -> None:
    begin(page, "back")
    page.tab.get_by_role("button", name="One frame on").click()
    page.until(f"state.index === {FROM + 1}", "the step")


def opened_tab(page: Page, name: str) -> None:
    page.controls.get_by_role("tab", name=name, exact=True).click()
    page.controls.get_by_role("tab", name=name, exact=True, selected=True).wait_for()


def clicked_panel(page: Page) -> None:
    page.explain.get_by_text("Frame ").first.click()


FOCUSED = {
    "the page": lambda page: page.tab.locator("#bar").click(position={"x": 600, "y": 15}),
    "Rerun's canvas": lambda page: page.tab.locator("#canvas").click(),
    "what is explained": clicked_panel,
    "a pressed button": pressed,
}


@pytest.mark.parametrize("where", FOCUSED)
def test_every_key_does_what_the_list_says_wherever_the_focus_is(page: Page, where: str):
    FOCUSED[where](page)
    for action in actions():
        begin(page, action.name)
        page.tab.keyboard.press(action.key)
        page.until(CONSEQUENCES[action.name], f"{action.key} with the focus on {where}")


def clicked_slider(page: Page) -> None:
    opened_tab(page, "Methods")
    if not page.controls.get_by_role("slider").count():
        page.controls.get_by_text("Stereo settings", exact=True).click()
    page.controls.get_by_role("slider").first.click()


def clicked_box(page: Page) -> None:
    opened_tab(page, "View")
    for _ in range(2):  # and back
        page.controls.get_by_role("checkbox").first.click()


def chosen_from_a_list(page: Page) -> None:
    opened_tab(page, "Tracks")
    page.controls.get_by_label("colour by", exact=True).click()
    page.controls.get_by_role("option", name="state", exact=True).click()


CLICKED = {
    "a tab": lambda page: opened_tab(page, "Branches"),
    "the slider of a setting": clicked_slider,
    "a checkbox": clicked_box,
    "a list, and one of its entries": chosen_from_a_list,
    "a folder": lambda page: page.controls.get_by_text("Source", exact=True).click(),
    "the splitter": lambda page: page.tab.locator("#splitter").click(),
}


@pytest.mark.parametrize("where", CLICKED)
def test_a_key_is_the_runs_after_a_click_on_anything_that_is_no_text_field(page: Page, where: str):
    """Arrows switched tabs, moved sliders and dragged the splitter; a list kept all keys once it had been clicked."""
    splitter = page.tab.locator("#splitter").bounding_box()["x"]
    begin(page, "play")
    CLICKED[where](page)
    tab = page.controls.locator("[role=tab][aria-selected=true]").inner_text()
    for name in ("forward", "back", "start", "stereo", "key_frame", "play"):
        begin(page, name)
        key = next(action.key for action in actions() if action.name == name)
        page.tab.keyboard.press(key)
        page.until(CONSEQUENCES[name], f"{key} after a click on {where}")
    assert page.controls.locator("[role=tab][aria-selected=true]").inner_text() == tab
    assert page.tab.locator("#splitter").bounding_box()["x"] == splitter
    expect(page.controls.locator("[role=listbox]:visible")).to_have_count(0)


def test_what_was_reached_by_key_keeps_the_keys_that_move_or_press_it(page: Page):
    """Who has no mouse changes tabs, sliders and boxes by key."""
    opened_tab(page, "Branches")
    page.tab.locator("#splitter").focus()
    begin(page, "play")
    page.controls.get_by_role("tab", name="Branches", exact=True).focus()
    page.tab.keyboard.press("Shift+Tab")
    page.tab.keyboard.press("Tab")
    page.tab.keyboard.press("ArrowRight")
    page.controls.locator("[role=tab][aria-selected=true]", has_text="Breakpoints").wait_for()
    page.tab.keyboard.press("i")
    page.until(CONSEQUENCES["loop_start"], "the loop from the frame that is shown still")


REACHED = """(() => {
  const found = document.activeElement;
  const { id, dataset, textContent } = found;
  if (found.closest("#canvas")) return "canvas";
  return found === document.body ? "" : id || dataset.do || dataset.eye || dataset.part || textContent;
})()"""


def test_tab_goes_through_all_controls_in_their_order_and_leaves_the_canvas(page: Page):
    begin(page, "no_loop")  # which gives it edges on the axis
    page.open_tab("Explain")
    page.tab.locator("#help").focus()
    reached: list[str] = []
    for _ in range(90):
        page.tab.keyboard.press("Tab")
        reached.append(page.tab.evaluate(REACHED))
        if reached[-1] == "home":
            break
    wanted = ["Explain", "splitter", "canvas", "frame", "camera", "start", "play", "end", "speed"]
    wanted += ["loop_start", "loop_end", "no-loop", "bookmark", "add-plot", "start", "end", "home"]
    assert [name for name in reached if name in wanted] == wanted
    page.tab.locator("#canvas canvas").focus()
    page.tab.keyboard.press("Shift+Tab")
    assert page.tab.evaluate(REACHED) == "splitter"


@pytest.mark.parametrize("name", BUTTONS)
def test_every_button_of_the_time_dock(page: Page, name: str):
    begin(page, name)
    page.tab.locator(f"#transport [data-do={name}]").click()
    page.until(CONSEQUENCES[name], name)


def test_question_mark_lists_every_key_and_escape_closes_the_list(page: Page):
    dialog = page.tab.locator("#keys")
    for focus in FOCUSED.values():
        focus(page)
        assert not dialog.is_visible()
        page.tab.keyboard.press("?")
        dialog.wait_for()
        text = dialog.inner_text()
        assert all(action.label in text and action.hint in text for action in actions())
        page.tab.keyboard.press("Escape")
        dialog.wait_for(state="hidden")
    page.tab.locator("#help").click()
    dialog.wait_for()
    page.tab.keyboard.press("?")
    dialog.wait_for(state="hidden")


def test_a_text_field_keeps_all_keys(page: Page):
    begin(page, "play")
    page.controls.get_by_role("tab", name="Files").click()
    field = page.controls.get_by_role("textbox").last
    field.fill("")
    field.focus()
    page.tab.keyboard.type("k a?b l")
    page.tab.keyboard.press("Home")
    assert field.input_value() == "k a?b l" and not page.tab.locator("#keys").is_visible()
    FOCUSED["the page"](page)
    page.tab.keyboard.press("i")
    page.until(f"{CONSEQUENCES['loop_start']} && !state.playing", "the loop from the frame that is shown still")


@pytest.mark.slow
def test_the_palette_has_every_action(page: Page):
    clicked_panel(page)
    search = page.controls.get_by_placeholder("Search")
    for action in actions():
        begin(page, action.name)
        page.tab.keyboard.press("Control+k")
        search.fill(action.label)
        page.controls.get_by_text(action.hint).first.click()
        page.until(CONSEQUENCES[action.name], action.label)
        search.wait_for(state="hidden")


def test_the_tabs_fit_in_one_line(page: Page):
    page.controls.get_by_role("tab").nth(5).wait_for()
    boxes = [tab.bounding_box() for tab in page.controls.get_by_role("tab").all()]
    assert len({box["y"] for box in boxes}) == 1
    assert boxes[-1]["x"] + boxes[-1]["width"] <= page.tab.locator("#splitter").bounding_box()["x"]


def test_a_key_or_button_while_a_source_is_opened_is_answered_once_and_does_nothing_later(page: Page, tmp_path: Path):
    """Both were kept until the source was open, and paused then what plays by itself."""
    source, run = f"slow:{tmp_path / 'open'}", page.state["run"]
    field = page.controls.locator("input[value='double:40']")
    if not field.is_visible():
        page.controls.get_by_text("Source", exact=True).first.click()
    field.fill(source)
    page.controls.get_by_role("button", name="Open", exact=True).click()
    page.until(f"state.phase === 'opening' && state.source === '{source}'", "the opening")
    page.tab.keyboard.press("Space")  # in viser's panel
    FOCUSED["the page"](page)
    notice = page.tab.locator(".notice")
    expect(notice).to_have_count(0)  # those of other tests are gone
    for key in ("Space", "Space", "ArrowRight"):
        page.tab.keyboard.press(key)
    notice.get_by_text(f"{source} is still being opened").wait_for(timeout=5_000)
    assert notice.count() == 1
    (tmp_path / "open").touch()
    page.until(f"state.run === {run + 1} && state.ended && !state.playing", "the source to play to its end by itself")
