"""Our page and the Rerun viewer, for which a stand-in tells what the test wants."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, app, browser, expect  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


class Staged(Page):
    def stays(self, index: int) -> None:
        """Our time comes there, and what the page had in mind before that is over."""
        self.until(f"state.index === {index}", f"frame {index}")
        self.tab.evaluate("new Promise((done) => setTimeout(done, 100))")  # the page's own timers, shorter, come first
        self.until(f"state.index === {index}", f"frame {index} still")


@pytest.fixture(scope="module")
def opened(browser, app: App) -> Iterator[Staged]:  # noqa: F811
    page = Staged(browser, app.url, viewer=FAKE)
    page.until("state.ended && !state.playing", "the end")
    page.tab.locator("#cover").wait_for(state="hidden")
    yield page
    assert not page.faults
    page.tab.close()


@pytest.fixture
def page(opened: Staged) -> Staged:
    opened.send("{do: 'seek', index: 20}")
    shown = "window.ispom.viewer.stage.shown"
    opened.until(f"{shown}?.index === 20 && {shown}.complete", "the frame that tests start from")
    return opened


@pytest.mark.parametrize("index", [5, 35])
def test_the_page_says_which_exposure_the_views_still_show(page: Staged, index: int):
    page.tab.evaluate("window.fake.serial = 0")
    page.send(f"{{do: 'seek', index: {index}}}")
    for place in ("#behind", "#shown"):
        page.tab.locator(place).get_by_text(f"loading frame {index}: the views show 20 or already {index}").wait_for()
    opacity = "Number(getComputedStyle(document.getElementById('canvas')).opacity)"
    page.until(f"{opacity} < 0.5", "the picture of another frame to fade")
    page.tab.evaluate("window.fake.serial = 1_000_000")
    page.tab.locator("#shown").wait_for(state="hidden")
    page.until(f"{opacity} === 1", "the right one")
    assert not page.tab.locator("#behind").inner_text()


def test_frames_are_left_out_while_the_viewer_takes_one_in(page: Staged):
    """Of seeks that come faster than it draws, it gets the last one only."""
    page.tab.evaluate(
        "window.fake.serial = 0; window.given = [];"
        "const { stage } = window.ispom.viewer; const push = stage.unread.push.bind(stage.unread);"
        "stage.unread.push = (each) => { window.given.push(each.index); return push(each); }; 0"
    )
    page.send("{do: 'seek', index: 21}")
    page.until("window.ispom.viewer.stage.unread.length === 1", "a frame that is not taken in")
    page.tab.evaluate("window.given.length = 0")
    for index in (30, 31, 32):
        page.send(f"{{do: 'seek', index: {index}}}")
        page.until(f"state.index === {index}", "the page to be there")
    assert page.tab.evaluate("window.given") == []
    page.tab.evaluate("window.fake.serial = 1_000_000")
    page.until("window.ispom.viewer.stage.shown.index === 32", "the last one")
    assert set(page.tab.evaluate("window.given")) == {32}


def test_earlier_runs_leave_the_viewer(page: Staged):
    page.tab.evaluate("window.fake.stores = ['Recording:ispom:an-earlier-run']")
    page.until("window.fake.stores.length === 0", "the earlier run to be closed")
    _, message = page.tab.evaluate("window.fake.asked.findLast(([name]) => name === 'close')")
    assert "Recording:ispom:an-earlier-run" in message and page.state["recording_id"] not in message


def test_hiding_a_layer_changes_that_and_nothing_else(page: Staged):
    page.controls.get_by_role("tab", name="View").click()
    count_messages = "window.fake.asked.filter(([name]) => name === 'set_blueprint').length"
    before, hidden = page.tab.evaluate(count_messages), len(page.state["hidden"])
    page.controls.get_by_text("ground truth", exact=True).first.click()
    page.until(f"state.hidden.length === {hidden + 1}", "the layer to be hidden")
    page.until(f"{count_messages} === {before + 1}", "the viewer to be told")
    _, message = page.tab.evaluate("window.fake.asked.findLast(([name]) => name === 'set_blueprint')")
    assert re.search(r'overrides/world/truth/visualizers":{"EntityBehavior":{"visible":\[false\]}}}', message)
    count = page.tab.evaluate("window.fake.asked.filter(([name]) => name === 'set_blueprint').length")
    page.controls.get_by_text("ground truth", exact=True).first.click()
    page.until(
        f"window.fake.asked.filter(([name]) => name === 'set_blueprint').length === {count + 1}", "it to be shown again"
    )
    _, message = page.tab.evaluate("window.fake.asked.findLast(([name]) => name === 'set_blueprint')")
    assert '"visible":[true]' in message
    page.stays(20)


def test_a_click_in_a_view_is_passed_on_with_the_frame_that_the_views_show(page: Staged):
    page.tab.evaluate(
        "window.fake.pick({ type: 'selection_change', items: [{ type: 'entity',"
        " entity_path: '/video/image', view_name: 'Video', position: [40.5, 30.5, null] }] })"
    )
    page.until("state.selected.startsWith('track:')", "the nearest track")
    page.tab.evaluate("window.fake.pick({ type: 'selection_change', items: [{ type: 'view' }] })")
    page.send("{do: 'select', what: ''}")
    page.until("state.selected === ''", "nothing to be selected, and nothing to come of a view")


EYES = "window.fake.asked.filter(([name, text]) => name === 'set_blueprint' && text.includes('EyeControls3D'))"


def test_the_eye_goes_where_a_button_says_and_back_with_a_key(page: Staged):
    pressed = page.tab.locator("#eyes [aria-pressed=true]")
    for name, press in (
        ("Top", lambda: page.tab.get_by_role("button", name="Top").click()),
        ("Frame", lambda: page.tab.keyboard.press("f")),
    ):
        before = page.tab.evaluate(f"{EYES}.length")
        press()
        page.until(f"{EYES}.length === {before + 1}", "the eye to be put there")
        assert pressed.all_inner_texts() == [name]
        assert "look_target" in page.tab.evaluate(f"{EYES}.at(-1)[1]")


def test_a_hand_that_turns_the_view_is_left_alone_until_the_path_is_framed_again(page: Staged):
    box = page.tab.locator("#canvas").bounding_box()
    assert box is not None
    x, y = box["x"] + 0.2 * box["width"], box["y"] + 0.6 * box["height"]
    page.tab.mouse.move(x, y)
    page.tab.mouse.down()
    page.tab.mouse.move(x + 30, y + 10, steps=3)
    page.tab.mouse.up()
    expect(page.tab.locator("#eyes [aria-pressed=true]")).to_have_count(0)
    before = page.tab.evaluate(f"{EYES}.length")
    page.send("{do: 'seek', index: 1}")
    page.until("window.ispom.viewer.stage.shown?.index === 1", "a frame whose path is much shorter")
    assert page.tab.evaluate(f"{EYES}.length") == before
    page.tab.keyboard.press("f")
    page.until(f"{EYES}.length === {before + 1}", "the path to be framed again")


def test_the_viewer_has_no_time_controls_of_its_own_and_a_limit_of_memory(page: Staged):
    """Its play button and timelines beside the page's would be two that disagree."""
    hidden = dict.fromkeys(("top", "blueprint", "selection", "time"), "hidden")
    assert page.tab.evaluate("window.fake.panels") == hidden
    assert re.fullmatch(r"\d{3,4}MB", page.tab.evaluate("window.fake.options.memory_limit"))


def test_a_viewer_that_died_says_so_and_can_be_started_again(browser, app: App):  # noqa: F811
    page = Staged(browser, app.url, viewer=FAKE)
    page.tab.locator("#cover").wait_for(state="hidden")
    on_the_views = [page.tab.locator(each) for each in ("#eyes", "#at-image")]
    assert all(each.is_visible() for each in on_the_views)
    page.tab.evaluate("window.fake.panicked = true")
    page.tab.get_by_text("The Rerun viewer stopped working. The run continues.").wait_for()
    assert not any(each.is_visible() for each in on_the_views), "they would lie on what is said in place of the views"
    page.tab.get_by_role("button", name="Start the viewer again").click()
    page.tab.locator("#cover").wait_for(state="hidden")
    page.until("window.fake && !window.fake.panicked", "the page to be loaded again")
    page.tab.close()
