"""The start screen, the runs table and the modes in a browser; a stand-in draws in place of Rerun."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from ispom_app.features.headless.command import run
from ispom_app.features.headless.options import Run as Options

from tests.app import helpers
from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, browser, expect, launched  # noqa: F401 - a fixture
from tests.app.strangers import killed_run
from tests.sequences.kitti_folder import make_drive

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
UNLABELLED = """[...document.querySelectorAll('button, input, select, a[href], [role=radiogroup]')].filter((each) =>
  each.checkVisibility() && !(each.ariaLabel || each.textContent.trim() || each.labels?.[0]?.textContent.trim()))
  .map((each) => each.outerHTML)"""


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A recording, beside two finished runs on it."""
    found = make_drive(tmp_path / "drive")
    for name, methods in (("first", ("stereo", "monocular")), ("second", ("stereo",))):
        options = Options(source=str(found), out=tmp_path / name, recording=False, methods=methods)
        assert run(options, helpers.build) == 0
    return found


@pytest.fixture
def app(drive: Path, tmp_path: Path) -> Iterator[App]:
    found = launched([sys.executable, "-m", "tests.app.page.serve_empty", str(tmp_path)], tmp_path)
    yield found
    found.process.kill()
    found.process.wait()


@pytest.fixture
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    opened = Page(browser, app.url, viewer=FAKE, first="state.phase === 'empty'")
    opened.tab.locator("#start").wait_for()
    yield opened
    opened.tab.close()


def play_demo(page: Page) -> None:
    page.tab.locator("#demo").click()
    page.until("state.phase === 'ready' && state.total > 0", "the demo")
    page.tab.locator("#start").wait_for(state="hidden")


def row(page: Page, key: str):
    return page.tab.locator(f"#runs tr[data-key='{key}']")


def test_without_a_source_the_demo_can_be_played_and_the_start_screen_opened_over_it(page: Page) -> None:
    assert page.tab.locator("#back").is_hidden()
    play_demo(page)
    page.until("state.playing || state.ended", "playing")
    number = page.state["run"]
    page.tab.locator("#home").click()
    row(page, "live:0").wait_for()
    page.tab.keyboard.press("Escape")
    page.tab.locator("#start").wait_for(state="hidden")
    page.tab.locator("#home").click()
    page.tab.locator("#path").fill("/no/such/place")
    page.tab.locator("#path").press("Enter")
    page.tab.locator("#path-fault").get_by_text("/no/such/place").wait_for()
    page.tab.locator("#back").click()
    page.tab.locator("#start").wait_for(state="hidden")
    assert page.state["run"] == number and not page.faults


def test_a_wrong_path_is_reported_at_its_field_and_the_right_one_opens(page: Page, drive: Path) -> None:
    fault = page.tab.locator("#path-fault")
    page.tab.locator("#path").fill(f"{drive}/nowhere")
    page.tab.keyboard.press("Enter")
    fault.filter(has_text="nowhere").wait_for()
    assert page.state["phase"] == "empty" and page.tab.locator(".notice").count() == 0
    page.tab.locator("#path").fill("")
    page.tab.keyboard.press("Enter")
    fault.filter(has_not_text="nowhere").wait_for()
    assert page.state["phase"] == "empty"
    page.tab.locator("#browse").click()
    page.tab.locator("#folders").get_by_text("drive", exact=False).first.wait_for()
    page.tab.locator("#path").fill(str(drive))
    page.tab.keyboard.press("Enter")
    page.until("state.phase === 'ready'", "the recording")
    page.tab.locator("#start").wait_for(state="hidden")


def test_a_run_that_was_killed_is_named_and_repaired_when_a_person_says_so(page: Page, app: App) -> None:
    assert page.tab.locator("#unfinished").is_hidden()
    killed_run(app.recordings, recording=False).rename(app.recordings / "killed")
    before = {path.name for path in (app.recordings / "killed").iterdir()}
    page.tab.locator("#unfinished").filter(has_text="killed").wait_for()
    assert row(page, "killed").count() == 0 and {p.name for p in (app.recordings / "killed").iterdir()} == before
    page.tab.locator("#repair").click()
    row(page, "killed").wait_for()
    page.tab.locator("#unfinished").wait_for(state="hidden")
    assert (app.recordings / "killed" / "stereo.tum").is_file() and not page.faults


def test_the_table_lists_finished_runs_keeps_notes_and_opens_one(page: Page, app: App) -> None:
    row(page, "first").wait_for()
    assert row(page, "second").count() == 1
    note = row(page, "first").locator("input.note")
    note.fill("<b>mine</b>")
    note.press("Enter")
    helpers.wait_for((app.recordings / "first" / "notes.yaml").exists, "the note")
    page.tab.locator("#filter").fill("mine")
    row(page, "second").wait_for(state="detached")
    assert row(page, "first").locator("b").count() == 0, "a note is never markup"
    row(page, "first").get_by_role("button", name="first").click()
    page.until("state.address.run === 'first' && state.phase === 'ready'", "the run")
    page.tab.locator("#start").wait_for(state="hidden")


def test_two_runs_that_are_selected_are_compared_on_one_stage(page: Page) -> None:
    for name in ("second", "first"):  # the shorter one is A
        row(page, name).locator("input[type=checkbox]").click()
    page.tab.locator("#compare-selected").click()
    page.until("state.compared?.[3]", "the comparison")
    page.tab.locator("#compare .verdict").wait_for()
    assert page.tab.locator("#compare .pair option:checked").all_inner_texts() == ["second", "first"], (
        "A was selected first"
    )
    page.tab.locator("#compare table tr").nth(2).wait_for()
    expect(page.tab.locator("#compare tr.of")).to_have_count(2)  # the method that both have, and the whole run
    page.tab.locator("#compare .which span").filter(has_text="Frame").wait_for()
    drawn = "[...document.querySelectorAll('#compare .images img')].every((image) => image.naturalWidth > 0)"
    page.until(drawn, "both images")
    assert not page.faults


def test_after_a_fork_the_mode_compare_compares_it_with_its_parent(page: Page) -> None:
    play_demo(page)
    page.until("state.ended && !state.playing", "the end")
    page.send("{do: 'seek', index: 20}")
    page.until("state.index === 20", "the frame")
    page.controls.get_by_role("tab", name="Methods").click()
    page.controls.get_by_role("button", name="Fork at frame").click()
    page.until("state.address.branch === 1 && !state.playing", "the fork")
    page.tab.locator("#modes input[value=compare]").check(force=True)
    page.until("state.compared?.[3]", "the comparison")
    first = "document.querySelector('#compare .pair option:checked')?.textContent"
    page.until(f"{first} === 'first run'", "the lists of the comparison, after those of the runs")
    assert page.tab.locator("#compare .pair option:checked").nth(1).inner_text().endswith("fork at frame 21")
    page.tab.locator("#compare .verdict").wait_for()
    assert page.tab.locator("#compare .verdict").inner_text() and not page.faults


def test_the_mode_survives_a_reload_and_is_the_pages_own(page: Page, app: App, browser) -> None:  # noqa: F811
    play_demo(page)
    page.until("state.ended && !state.playing", "the end")
    page.tab.locator("#home").focus()
    page.tab.keyboard.press("Tab")
    page.tab.keyboard.press("ArrowRight")
    page.tab.locator("#compare").wait_for()
    page.until("location.hash.includes('mode=compare')", "the address")
    page.tab.locator("#compare").get_by_role("button", name="Choose two runs").wait_for()
    page.tab.reload()
    page.until("state.total > 0 && document.body.dataset.mode === 'compare'", "the mode")
    page.tab.locator("#compare").wait_for()
    other = Page(browser, app.url, viewer=FAKE)
    assert other.tab.locator("#modes input[value=debug]").is_checked()
    other.tab.close()
    page.tab.locator("#modes input[value=learn]").check()
    page.tab.locator("#learn button").first.wait_for()
    assert page.tab.locator("#learn button").count() >= 10 and not page.faults


def test_every_control_of_the_start_screen_is_labelled_and_reached_by_key(page: Page) -> None:
    row(page, "first").wait_for()
    assert page.tab.evaluate(UNLABELLED) == []
    visible = "(each) => each.checkVisibility() && !each.disabled && each.tabIndex >= 0"
    wanted = page.tab.evaluate(
        f"[...document.querySelectorAll('#start :is(button, input, a)')].filter({visible}).length"
    )
    page.tab.locator("#home").focus()
    reached = set[int]()
    place = "[...document.querySelectorAll('#start :is(button, input, a)')].indexOf(document.activeElement)"
    for _ in range(wanted + 20):
        page.tab.keyboard.press("Tab")
        reached.add(page.tab.evaluate(place))
    assert len(reached - {-1}) == wanted
    page.tab.locator("#path").focus()
    page.tab.keyboard.type("n N")
    assert page.tab.locator("#path").input_value() == "n N", "a letter that is a key of the run is text in a field"


def test_keys_of_the_run_do_nothing_under_the_start_screen(page: Page) -> None:
    play_demo(page)
    page.until("state.ended && !state.playing", "the end")
    page.tab.locator("#home").click()
    page.tab.locator("#start h1").first.click()
    page.tab.keyboard.press("Home")
    page.tab.keyboard.press("Space")
    page.tab.keyboard.press("Escape")
    page.tab.locator("#start").wait_for(state="hidden")
    page.tab.keyboard.press("ArrowLeft")
    page.until("state.index === state.total - 2", "one step back, and nothing else")
