"""A published folder in a browser, from a plain file server; a stand-in draws in place of Rerun."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.features.publish.review import no_images
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.review.folder import read_stored
from ispom_app.session.review.stored import nobody
from ispom_app.views.web.numbers import of_exposure, over_time

from tests.app.page.test_browser import CHROMIUM, FAKE, Page, browser, expect  # noqa: F401 - a fixture

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The folder's address, as `python -m http.server` serves it."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()


@pytest.fixture(scope="module")
def url(site: Path) -> Iterator[str]:
    with served(site) as found:
        yield found


@pytest.fixture(scope="module")
def page(browser, url: str) -> Iterator[Page]:  # noqa: F811
    found = Page(browser, url, viewer=FAKE)
    yield found
    assert not found.faults and all(request.startswith((url, "blob:", "data:")) for request in found.requests)
    found.tab.close()


def at(page: Page, index: int) -> None:
    page.until(f"state.index === {index}", f"frame {index}")
    page.tab.locator(".panels h3", has_text=re.compile(rf"Frame {index}\D")).wait_for()


def test_it_shows_a_verdict_of_each_method(page: Page) -> None:
    page.tab.locator(".panels .card").first.wait_for()
    assert page.tab.locator(".panels .card").count() == len(page.state["methods"]) > 1
    page.until("window.ispom.viewer.stage?.shown?.index === state.index", "the stage")


def test_keys_move_and_the_stage_follows(page: Page) -> None:
    last = page.state["total"] - 1
    for key, index in (("Home", 0), ("ArrowRight", 1), ("End", last), ("ArrowLeft", last - 1)):
        page.tab.keyboard.press(key)
        at(page, index)
        page.until(f"window.ispom.viewer.stage.shown?.index === {index}", "the stage")
    page.tab.keyboard.press("Shift+k")
    page.until("window.ispom.axis.results === undefined && state.index < " + str(last - 1), "a keyframe")
    index = page.state["index"]
    made = page.tab.evaluate("window.ispom.axis.methods.flatMap(({ keyFrames }) => keyFrames)")
    assert index == max(frame for frame in made if frame < last - 1)


def test_a_picture_is_taken_of_the_frame_that_is_shown(page: Page) -> None:
    page.until("window.ispom.viewer.stage?.shown", "the stage")
    asked = "window.ispom.viewer.stage.redraw()({ set_time: ({ timeline }) => timeline })"
    assert page.tab.evaluate(asked) == "exposure"


def test_the_time_dock_seeks_and_a_reload_returns_there(page: Page, url: str) -> None:
    page.send("{do: 'seek', index: 0}")
    box = page.tab.locator("#axis").bounding_box()
    page.tab.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 12)
    page.until("state.index > 3 && state.index < state.total - 1", "the frame at the click")
    index = page.state["index"]
    page.until(f"location.hash.includes('at={index}')", "the address")
    page.tab.reload()
    at(page, index)


def test_it_plays_to_the_end_and_from_the_start_again(page: Page) -> None:
    last = page.state["total"] - 1
    page.tab.locator("#speed").select_option("null")
    page.tab.locator("#play").click()
    page.until(f"state.index === {last} && !state.playing", "the end")
    page.tab.locator("#speed").select_option("0.2")  # else it may end before anybody looks
    page.tab.locator("#play").click()
    page.until(f"state.playing && state.index < {last}", "the start")
    page.tab.locator("#speed").select_option("null")
    page.until("!state.playing", "the end again")


def test_a_loop_is_played_round(page: Page) -> None:
    for index, key in ((2, "i"), (5, "o")):
        page.send(f"{{do: 'seek', index: {index}}}")
        page.tab.keyboard.press(key)
    page.until("String(state.loop) === '2,5'", "the loop")
    page.tab.keyboard.press("Space")
    page.until("state.playing && state.index === 3", "the loop")
    page.until("state.playing && state.index === 5", "its end")
    page.until("state.playing && state.index === 2", "its start")
    page.tab.keyboard.press("l")
    page.tab.keyboard.press("Home")
    page.until("state.loop === null && state.index === 0", "no loop")


def test_a_click_on_an_event_goes_to_its_frame(page: Page) -> None:
    event = page.tab.locator(".panels [data-seek]").last
    index = int(event.get_attribute("data-seek") or "")
    event.click()
    at(page, index)
    expect(event).to_have_attribute("aria-current", "true")
    page.tab.keyboard.press("Shift+n")
    page.until(f"state.index < {index}", "the event before")


def test_a_check_is_plotted_by_a_click_and_a_quantity_by_its_name(page: Page) -> None:
    page.send("{do: 'seek', index: 4}")
    at(page, 4)
    before = page.tab.locator(".plot").count()
    page.tab.locator(".panels summary").first.click()
    check = page.tab.locator(".panels details [data-plot]").first
    name = check.get_attribute("data-plot")
    check.click()
    page.tab.locator(f".plot[data-name='{name}']").wait_for()
    expect(check).to_have_attribute("aria-pressed", "true")
    expect(page.tab.locator(".plot")).to_have_count(before + 1)
    page.until(f"state.address.plots.endsWith({name!r})", "the address")
    page.tab.locator("#add-plot").fill("alive")
    page.tab.locator("#add-plot").press("Enter")
    page.tab.locator(".plot[data-name='alive']").wait_for()
    for each in (name, "alive"):
        page.tab.locator(f".plot[data-name='{each}'] button").last.click()
    expect(page.tab.locator(".plot")).to_have_count(before)


def test_layers_are_hidden_and_shown(page: Page) -> None:
    before = page.state["hidden"]
    page.tab.locator(".panels").get_by_role("tab", name="View").click()
    box = page.tab.locator(".panels input[name=tracks]")
    box.uncheck()
    hidden = set(page.state["hidden"]) - set(before)
    assert hidden and any("left/tracks" in path for path in hidden)
    page.until("location.hash.includes('hidden=tracks')", "the address")
    box.check()
    assert page.state["hidden"] == before
    page.tab.locator(".panels").get_by_role("tab", name="Explain").click()


def test_what_needs_an_estimator_is_refused_in_a_sentence(page: Page) -> None:
    before = page.state["index"]
    page.send("{do: 'open_source', source: 'sim:city'}")
    page.tab.locator("#notices .notice", has_text="published").wait_for()
    assert page.state["index"] == before
    for gone in ("#calibration", "#modes", "[data-do=bookmark]"):
        assert not page.tab.locator(gone).first.is_visible()


def test_numbers_are_saved_as_the_app_does(page: Page, runs: tuple[Path, Path]) -> None:
    page.send("{do: 'seek', index: 4}")
    at(page, 4)
    texts = []
    for href in ("numbers/exposure", "numbers/run"):
        page.tab.locator("#saving").click()
        with page.tab.expect_download() as download:
            page.tab.locator(f"#save a[href='{href}']").click()
        texts.append(Path(download.value.path()).read_text())
        assert download.value.suggested_filename == ("first.csv" if href.endswith("run") else "first-4.csv")
    series = CurrentRun.of_stored(read_stored(runs[0], no_images, nobody), 1 << 20).series
    assert texts == [of_exposure(series, 4), over_time(series, len(series))]


def test_a_narrow_window_has_everything_one_above_the_other(page: Page) -> None:
    page.resize(600, 900)
    stage, panels, dock = (page.tab.locator(each).bounding_box() for each in ("#viewer", ".panels", "#dock"))
    assert stage["y"] + stage["height"] <= panels["y"] + 1 and panels["y"] + panels["height"] <= dock["y"] + 1
    assert min(stage["width"], panels["width"]) == 600
    page.resize(1280, 720)


def test_two_runs_are_compared(browser, pair: Path) -> None:  # noqa: F811
    with served(pair) as url:
        page = Page(browser, url, viewer=FAKE)
        page.tab.get_by_text("Compare", exact=True).click()
        place = page.tab.locator("#compare")
        place.locator("table td").first.wait_for()
        expect(place.locator("select").nth(1)).to_have_value("live:1")
        place.locator(".verdict").wait_for()
        assert not place.locator(".images").is_visible() and not page.faults
        page.tab.close()


def test_both_images_are_shown_where_paths_part(browser, parted: Path) -> None:  # noqa: F811
    with served(parted) as url:
        page = Page(browser, url, viewer=FAKE)
        page.tab.get_by_text("Compare", exact=True).click()
        images = page.tab.locator("#compare .parting .images img")
        images.first.wait_for()
        assert images.count() == 2
        for i in range(2):
            page.until(f"document.querySelectorAll('#compare .parting img')[{i}].naturalWidth > 0", "the image")
        assert not page.tab.locator("#compare .parting .missing").count() and not page.faults
        assert all(request.startswith((url, "blob:", "data:")) for request in page.requests)
        page.tab.close()


@pytest.mark.slow
def test_the_real_viewer_draws_the_frames(browser, runs: tuple[Path, Path], tmp_path: Path) -> None:  # noqa: F811
    assert main(["publish", str(runs[0]), "--out", str(tmp_path / "site")]) == 0
    with served(tmp_path / "site") as url:
        page = Page(browser, url)
        pictures = []
        for index in (3, 12):
            page.send(f"{{do: 'seek', index: {index}}}")
            page.until(f"window.ispom.viewer.stage?.shown?.index === {index}", "the frame", 300_000)
            page.tab.locator("#cover").wait_for(state="hidden")
            drawn = "window.ispom.viewer.picture().then((drawn) => drawn.toDataURL())"
            pictures.append(page.tab.evaluate(drawn))
        assert len(set(pictures)) == 2 and not page.faults
        page.tab.close()
