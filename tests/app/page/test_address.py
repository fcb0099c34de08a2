"""The page's address reopens exactly what is shown; bookmarks are put, seen on the axis, gone to and removed."""

from __future__ import annotations

from collections.abc import Iterator
from urllib.parse import parse_qsl

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, NOT_NEW, App, Page, app, browser, expect, page_at  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app) as opened:
        yield opened


def address(page: Page) -> dict[str, str]:
    return dict(parse_qsl(page.tab.evaluate("location.hash.slice(1)"), keep_blank_values=True))


def go(page: Page, index: int) -> None:
    page.send(f'{{do: "seek", index: {index}}}')
    page.until(f"state.index === {index} && location.hash.includes('at={index}')", "the frame in the address")


def test_the_address_follows_the_page(page: Page) -> None:
    go(page, 21)
    assert address(page) == {"run": "double:40", "at": "21"}
    assert "token" not in page.tab.evaluate("location.href")
    page.controls.get_by_role("tab", name="View").click()
    page.controls.get_by_text("point clouds").first.click()
    page.until("state.address.hidden.length === 1 && location.hash.includes('hidden=clouds')", "the layer")
    page.controls.get_by_text("point clouds").first.click()
    page.until("state.address.hidden.length === 0 && !location.hash.includes('hidden')", "the layer")


def test_the_address_names_what_is_looked_at_closely_and_plotted(page: Page) -> None:
    page.tab.evaluate("location.hash = '#run=double:40&at=22&select=key_frame:stereo:1'")
    page.until("state.index === 22 && state.selected === 'key_frame:stereo:1'", "what the address names")
    page.tab.evaluate("location.hash = '#run=double:40&at=23&plot=stereo.inliers'")
    page.until("state.index === 23 && state.selected === '' && state.address.plots === 'stereo.inliers'", "the plot")
    page.tab.evaluate("location.hash = '#run=double:40&at=21'")
    page.until("state.index === 21 && state.address.plots === ''", "nothing")


def test_a_page_that_is_opened_with_it_shows_the_same(page: Page, app: App) -> None:  # noqa: F811
    go(page, 30)
    assert not page.faults
    page.tab.goto(f"{app.url}#run=double:40&at=7&hidden=clouds,truth")
    page.faults.clear()  # requests that leaving the page broke off
    page.until("state.index === 7 && String(state.address.hidden) === 'clouds,truth'", "what the address names")
    page.tab.evaluate("location.hash = '#run=double:40&at=12'")
    page.until("state.index === 12 && state.address.hidden.length === 0", "the address that was typed")
    page.until("location.hash === '#run=double:40&at=12'", "the address to stay")


RELOADED_AT_ONCE = """() => {
    const once = (reached, then) => (reached() ? then() : setTimeout(() => once(reached, then), 1));
    ispom.send({ do: "seek", index: 12 });
    once(() => location.hash.includes("at=12"), () => {  // the next change is written half a second after this one
        ispom.send({ do: "seek", index: 14 });
        once(() => ispom.shown.index === 14, () => location.reload());
    });
}"""


RELOADED_BEFORE_IT_IS_WRITTEN = """() => {
    const seen = () => ispom.shown.index === 14 && location.reload();  // by the message that tells it
    new MutationObserver(seen).observe(document.getElementById("exposure"), { childList: true });
    setTimeout(() => ispom.send({ do: "seek", index: 14 }), 600);  // so late that the change is written at once
}"""


@pytest.mark.parametrize("reload", [RELOADED_AT_ONCE, RELOADED_BEFORE_IT_IS_WRITTEN])
def test_a_page_that_is_reloaded_at_once_after_a_change_keeps_it(page: Page, reload: str) -> None:
    go(page, 11)
    with page.tab.expect_event("load"):
        page.tab.evaluate(reload)
    page.faults.clear()  # requests that leaving the page broke off
    page.until("state.index === 14 && location.hash.includes('at=14')", "what was shown")


def test_a_run_that_plays_goes_on_over_a_reload(page: Page) -> None:
    for message in ("{do: 'seek', index: 20}", "action('loop_end')", "{do: 'seek', index: 2}", "action('loop_start')"):
        page.send(message)
    page.send("action('play')")
    page.until("state.playing && state.loop !== null && location.hash.includes('at=1')", "the loop")
    with page.tab.expect_event("load"):
        page.tab.reload()
    page.faults.clear()  # requests that leaving the page broke off
    page.until("state.people.driving", "the wheel")
    before = page.tab.evaluate("location.hash")
    page.until(f"location.hash !== '{before}'", "an address that follows the page")
    assert page.state["playing"]
    page.send("action('no_loop')")
    page.send("action('play')")
    page.until("!state.playing && state.loop === null", "the pause")


def test_one_who_does_not_drive_opens_it_at_its_exposure(page: Page, browser, app: App) -> None:  # noqa: F811
    go(page, 30)
    other = Page(browser, f"{app.url}#run=double:40&at=7&hidden=clouds,truth", viewer=FAKE)
    other.until("window.ispom.shown.index === 7 && state.index === 30", "the frame, on that page alone")
    other.until("location.hash === '#run=double:40&at=7'", "the address to say what is shown")
    assert not other.faults
    other.tab.close()


PATIENT = "; const now = performance.now.bind(performance); performance.now = () => now() / 10;"
"""A page waits for 8 s to drive, in which a busy machine may not even have closed the page before."""


def test_who_drives_a_moment_after_opening_it_gets_all_of_it(page: Page, browser, app: App) -> None:  # noqa: F811
    """As after a reload, where the server sees the page before closed only later."""
    before = Page(browser, app.url, viewer=FAKE)
    before.send('{do: "take_control"}')
    before.until("state.people.driving", "the wheel")
    other = Page(browser, f"{app.url}#run=double:40&at=9&hidden=clouds,truth", viewer=FAKE, before=NOT_NEW + PATIENT)
    other.until(
        "window.ispom.shown.index === 9 && location.hash === '#run=double:40&at=9'", "the frame, on that page alone"
    )
    before.tab.close()
    other.until("state.index === 9 && String(state.address.hidden) === 'clouds,truth'", "all that its address named")
    other.send('{do: "hide", names: []}')
    assert not other.faults
    other.tab.close()
    page.send('{do: "take_control"}')
    page.until("state.people.driving && state.address.hidden.length === 0", "the wheel")


def test_an_address_of_another_branch_shows_that_branch(page: Page) -> None:
    go(page, 40)
    page.controls.get_by_role("tab", name="Methods").click()
    page.controls.get_by_role("button", name="Fork").click()
    page.until("state.address.branch === 1 && state.ended && !state.playing", "the branch")
    page.until("location.hash.includes('branch=1')", "the branch in the address")
    page.tab.evaluate("location.hash = '#run=double:40&at=5'")
    page.until("state.address.branch === 0 && state.index === 5", "the first run")


def test_an_unknown_run_is_reported_and_never_a_path(page: Page) -> None:
    go(page, 9)
    for run in ("nowhere", "/etc", "../../etc/passwd"):
        count = page.tab.evaluate("window.ispom.state.notices.at(-1)?.number ?? 0")
        page.tab.evaluate(f"location.hash = '#run={run}&at=3'")
        page.until(f"(state.notices.at(-1)?.number ?? 0) > {count}", "the notice")
        assert "no run called" in page.state["notices"][-1]["text"]
        page.until("location.hash === '#run=double:40&at=9'", "the address of what is shown")


def test_an_exposure_beyond_the_end_is_the_last_one(page: Page) -> None:
    go(page, 9)
    page.tab.evaluate("location.hash = '#run=double:40&at=9999'")
    page.until("state.index === 43 && location.hash === '#run=double:40&at=43'", "the last one")


def test_m_puts_a_bookmark_that_the_axis_and_the_panel_show(page: Page) -> None:
    go(page, 17)
    page.tab.keyboard.press("m")
    page.until("window.ispom.axis.marks.bookmarks?.marks.length === 1", "the bookmark")
    assert page.tab.evaluate("window.ispom.axis.marks.bookmarks.marks.map(({ at, note }) => [at, note])") == [[17, ""]]
    go(page, 33)
    page.controls.get_by_role("tab", name="Files").click()
    page.controls.get_by_role("textbox").and_(page.controls.locator("input:visible")).last.fill("here it jumps")
    page.controls.get_by_role("button", name="Bookmark this frame").click()
    page.until("window.ispom.axis.marks.bookmarks?.marks.length === 2", "the second one")
    assert page.tab.evaluate("window.ispom.axis.marks.bookmarks.marks")[1]["note"] == "here it jumps"
    page.tab.locator("#axis").hover(position={"x": 176 + 904 * 33 / 43, "y": 3})
    expect(page.tab.locator("#axis-hint")).to_contain_text("bookmark: here it jumps")
    go(page, 2)
    page.controls.get_by_role("button", name="Go to", exact=True).click()
    page.until("state.index === 33", "the bookmark's frame")
    page.controls.get_by_role("button", name="Remove", exact=True).click()
    page.until(
        "window.ispom.axis.marks.bookmarks?.marks.length === 1 && window.ispom.axis.marks.bookmarks.marks[0].at === 17",
        "the other",
    )
