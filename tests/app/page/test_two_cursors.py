"""Our page and the Rerun viewer, which tells late and not who moved its time. A stand-in tells what the test wants."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FAKE = Path(__file__).with_name("fake_viewer.js").read_text()


class Cursors(Page):
    def tell(self, index: int) -> None:
        """Rerun tells of its cursor."""
        self.tab.evaluate(f"window.fake.tell({index})")

    def touch(self) -> None:
        self.tab.locator("#canvas").click()

    def stays(self, index: int) -> None:
        """Our time comes there, and what the page had in mind before that is over."""
        self.until(f"state.index === {index}", f"frame {index}")
        self.tab.evaluate("new Promise((done) => setTimeout(done, 100))")  # the page's own timers, shorter, come first
        self.until(f"state.index === {index}", f"frame {index} still")


@pytest.fixture(scope="module")
def opened(browser, app: App) -> Iterator[Cursors]:  # noqa: F811
    page = Cursors(browser, app.url, viewer=FAKE)
    page.until("state.ended && !state.playing", "the end")
    page.tab.locator("#cover").wait_for(state="hidden")
    yield page
    assert not page.faults
    page.tab.close()


@pytest.fixture
def cursors(opened: Cursors) -> Cursors:
    opened.send("{do: 'seek', index: 20}")
    opened.until("state.index === 20 && window.ispom.viewer.cursor.sent === 20", "the frame that tests start from")
    opened.tell(20)
    return opened


def test_a_hand_on_the_timeline_moves_our_time(cursors: Cursors):
    cursors.touch()
    cursors.tell(7)
    cursors.until("state.index === 7", "our time to follow")


def test_a_late_cursor_after_a_key_is_nobodys_wish(cursors: Cursors):
    cursors.touch()
    cursors.tab.keyboard.press("ArrowLeft")
    cursors.tell(3)
    cursors.stays(19)


def test_answers_that_come_after_a_touch_are_not_the_hands(cursors: Cursors):
    for index in (21, 22):
        cursors.send(f"{{do: 'seek', index: {index}}}")
        cursors.until(f"window.ispom.viewer.cursor.sent === {index}", "both of our wishes to be passed on")
    cursors.touch()
    cursors.tell(21)
    cursors.stays(22)


def test_where_the_hand_went_counts_before_the_key_after_it(cursors: Cursors):
    cursors.touch()
    cursors.tell(30)
    cursors.tab.keyboard.press("ArrowRight")
    cursors.stays(31)


def test_a_cursor_that_went_astray_is_brought_back(cursors: Cursors):
    """Rerun's own shortcuts and menus move its time, and nobody's hand was on the canvas."""
    cursors.tell(33)
    cursors.until("window.ispom.viewer.cursor.sent === null || window.fake.asked.at(-1)[0] === 6", "another request")
    cursors.stays(20)


@pytest.mark.parametrize("index", [5, 35])
def test_the_page_says_which_exposure_the_views_still_show(cursors: Cursors, index: int):
    cursors.until("window.ispom.viewer.stage.shown?.index === 20", "the views")
    cursors.tab.evaluate("window.fake.serial = 0")
    cursors.send(f"{{do: 'seek', index: {index}}}")
    for place in ("#behind", "#shown"):
        cursors.tab.locator(place).get_by_text(f"loading frame {index}: the views show 20").wait_for()
    cursors.tab.evaluate("window.fake.serial = 1_000_000")
    cursors.tab.locator("#shown").wait_for(state="hidden")
    assert not cursors.tab.locator("#behind").inner_text()


def test_frames_are_left_out_while_the_viewer_takes_one_in(cursors: Cursors):
    """Seeks that come faster than it draws ask for the last one only."""
    cursors.until("window.ispom.viewer.stage.shown?.index === 20", "the views")
    cursors.tab.evaluate(
        "window.fake.serial = 0;"
        "const { socket } = window.ispom.viewer.stage; window.said = []; const send = socket.send.bind(socket);"
        "socket.send = (message) => { window.said.push(message); send(message); };"
    )
    for index in (21, 22, 23, 24):
        cursors.send(f"{{do: 'seek', index: {index}}}")
        cursors.until(f"window.ispom.viewer.stage.wanted === {index}", "the page to want it")
    cursors.until("window.ispom.viewer.stage.unread.some(({ index }) => index >= 0)", "a frame that is not taken in")
    cursors.tab.evaluate("window.said.length = 0")
    for index in (30, 31, 32):
        cursors.send(f"{{do: 'seek', index: {index}}}")
        cursors.until(f"window.ispom.viewer.stage.wanted === {index}", "the page to want it")
    assert cursors.tab.evaluate("window.said") == []
    cursors.tab.evaluate("window.fake.serial = 1_000_000")
    cursors.until("window.ispom.viewer.stage.shown.index === 32", "the last one")
    shows = [message.split()[1] for message in cursors.tab.evaluate("window.said") if message.startswith("show")]
    assert "32" in shows and "30" not in shows


def test_earlier_runs_leave_the_viewer(cursors: Cursors):
    cursors.tab.evaluate("window.fake.stores = ['Recording:ispom:an-earlier-run']")
    cursors.until("window.fake.stores.length === 0", "the earlier run to be closed")
    _, message = cursors.tab.evaluate("window.fake.asked.findLast(([kind]) => kind === 1)")
    assert "Recording:ispom:an-earlier-run" in message and cursors.state["recording_id"] not in message


def test_hiding_a_layer_changes_that_and_nothing_else(cursors: Cursors):
    cursors.controls.get_by_role("tab", name="View").click()
    told = "window.fake.asked.filter(([kind]) => kind === 14).length"
    before, hidden = cursors.tab.evaluate(told), len(cursors.state["hidden"])
    cursors.controls.get_by_text("true path", exact=True).click()
    cursors.until(f"state.hidden.length === {hidden + 1}", "the layer to be hidden")
    cursors.until(f"{told} === {before + 1}", "the viewer to be told")
    _, message = cursors.tab.evaluate("window.fake.asked.findLast(([kind]) => kind === 14)")
    assert re.search(r'overrides/world/truth/visualizers":{"EntityBehavior":{"visible":\[false\]}}}', message)
    asked = cursors.tab.evaluate("window.fake.asked.filter(([kind]) => kind === 14).length")
    cursors.controls.get_by_text("true path", exact=True).click()
    cursors.until(f"window.fake.asked.filter(([kind]) => kind === 14).length === {asked + 1}", "it to be shown again")
    _, message = cursors.tab.evaluate("window.fake.asked.findLast(([kind]) => kind === 14)")
    assert '"visible":[true]' in message
    cursors.stays(20)


def test_a_click_in_a_view_is_passed_on_with_the_frame_that_the_views_show(cursors: Cursors):
    cursors.until("window.ispom.viewer.stage.shown?.index === 20", "the views")
    cursors.tab.evaluate(
        "window.fake.options.on_viewer_event(JSON.stringify({ type: 'selection_change', items: [{ type: 'entity',"
        " entity_path: '/video/image', view_name: 'Video', position: [40.5, 30.5, null] }] }))"
    )
    cursors.until("state.selected.startsWith('track:')", "the nearest track")
    cursors.tab.evaluate(
        "window.fake.options.on_viewer_event(JSON.stringify({ type: 'selection_change', items: [{ type: 'view' }] }))"
    )
    cursors.send("{do: 'select', what: ''}")
    cursors.until("state.selected === ''", "nothing to be selected, and nothing to come of a view")


EYES = "window.fake.asked.filter(([kind, text]) => kind === 14 && text.includes('EyeControls3D'))"


def test_the_eye_goes_where_a_button_says_and_back_with_a_key(cursors: Cursors):
    pressed = cursors.tab.locator("#eyes [aria-pressed=true]")
    for name, press in (
        ("Top", lambda: cursors.tab.get_by_role("button", name="Top").click()),
        ("Frame", lambda: cursors.tab.keyboard.press("f")),
    ):
        before = cursors.tab.evaluate(f"{EYES}.length")
        press()
        cursors.until(f"{EYES}.length === {before + 1}", "the eye to be put there")
        assert pressed.all_inner_texts() == [name]
        assert "look_target" in cursors.tab.evaluate(f"{EYES}.at(-1)[1]")


def test_a_hand_that_turns_the_view_is_left_alone_until_the_path_is_framed_again(cursors: Cursors):
    box = cursors.tab.locator("#canvas").bounding_box()
    assert box is not None
    x, y = box["x"] + 0.2 * box["width"], box["y"] + 0.6 * box["height"]
    cursors.tab.mouse.move(x, y)
    cursors.tab.mouse.down()
    cursors.tab.mouse.move(x + 30, y + 10, steps=3)
    cursors.tab.mouse.up()
    assert cursors.tab.locator("#eyes [aria-pressed=true]").count() == 0
    before = cursors.tab.evaluate(f"{EYES}.length")
    cursors.send("{do: 'seek', index: 1}")
    cursors.until("state.index === 1 && window.ispom.viewer.cursor.sent === 1", "a frame whose path is much shorter")
    assert cursors.tab.evaluate(f"{EYES}.length") == before
    cursors.tab.keyboard.press("f")
    cursors.until(f"{EYES}.length === {before + 1}", "the path to be framed again")


def test_the_viewer_has_no_time_controls_of_its_own_and_a_limit_of_memory(cursors: Cursors):
    """Its play button and timelines beside the page's would be two that disagree."""
    options = cursors.tab.evaluate("({ ...window.fake.options, on_viewer_event: null })")
    assert options["panel_state_overrides"] == dict.fromkeys(("top", "blueprint", "selection", "time"), "Hidden")
    assert re.fullmatch(r"\d{3,4}MB", options["memory_limit"])


def test_a_viewer_that_died_says_so_and_can_be_started_again(browser, app: App):  # noqa: F811
    page = Cursors(browser, app.url, viewer=FAKE)
    page.tab.locator("#cover").wait_for(state="hidden")
    page.tab.evaluate("window.fake.panicked = true")
    page.tab.get_by_text("The Rerun viewer stopped working (out of memory). The run continues.").wait_for()
    page.tab.get_by_role("button", name="Start the viewer again").click()
    page.tab.locator("#cover").wait_for(state="hidden")
    page.until("window.fake && !window.fake.panicked", "the page to be loaded again")
    page.tab.close()
