"""Our time and the Rerun viewer's, which tells late and not who moved it. A stand-in tells what the test wants."""

from __future__ import annotations

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
        self.until(f"state.index === {index}", f"exposure {index}")
        self.tab.evaluate("new Promise((done) => setTimeout(done, 100))")  # the page's own timers, shorter, come first
        self.until(f"state.index === {index}", f"exposure {index} still")


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
    opened.until("state.index === 20 && window.ispom.viewer.sync.sent === 20", "the exposure that tests start from")
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
        cursors.until(f"window.ispom.viewer.sync.sent === {index}", "both of our wishes to be passed on")
    cursors.touch()
    cursors.tell(21)
    cursors.stays(22)


def test_where_the_hand_went_counts_before_the_key_after_it(cursors: Cursors):
    cursors.touch()
    cursors.tell(30)
    cursors.tab.keyboard.press("ArrowRight")
    cursors.stays(31)


def test_turning_the_scene_while_it_plays_does_not_stop_it(cursors: Cursors):
    """Where Rerun follows its stream, its cursor moves on by itself."""
    cursors.tab.evaluate(
        "() => { const { follow } = window.ispom.viewer;"
        " follow({ run: window.ispom.state.run, index: 5, computed: 6, playing: true, target: null }); }"
    )
    cursors.until("window.ispom.viewer.sync.sent === 'following'", "Rerun to follow")
    for index in (5, 6, 7):
        cursors.touch()
        cursors.tell(index)
    cursors.stays(20)
