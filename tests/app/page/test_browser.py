"""The page in a real browser, the app a process of its own. Software graphics are slow: one of each is shared."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from aiohttp import ClientSession

playwright = pytest.importorskip("playwright.sync_api")


def _chromium() -> str | None:
    """A Chromium that starts: it needs libraries of the system itself."""
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next(filter(None, map(shutil.which, names)), None)
    works = found and not subprocess.run([found, "--version"], capture_output=True, check=False).returncode
    return found if works else None


CHROMIUM = _chromium()
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium that starts here: apt-get install chromium")
ROOT = Path(__file__).parents[3]
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
]
PATIENCE_MS = 60_000
expect = playwright.expect
expect.set_options(timeout=PATIENCE_MS)
NOT_NEW = "localStorage.setItem('ispom.captions', 'seen')"
"""As in a browser that was here before."""
TOTAL = 44
FAKE = Path(__file__).with_name("fake_viewer.js").read_text()
"""In place of the Rerun viewer, which takes seconds of processor time."""
ENDED, AT_ONCE = "state.ended && !state.playing", "true"


@dataclass
class App:
    """The process, where it is, and where it records to."""

    process: subprocess.Popen[str]
    url: str
    recordings: Path


def start(folder: Path, port: int = 0) -> App:
    return launched([sys.executable, "-m", "tests.app.page.serve_double", str(folder), str(port)], folder)


def launched_on(source: Path) -> App:
    """Of a run that is over, or a sequence that the tests made."""
    return launched(
        [sys.executable, "-m", "tests.app.page.serve_double", str(source.parent), "0", str(source)], source.parent
    )


def launched(command: list[str], folder: Path) -> App:
    """The app that a command serves, when it says where it is."""
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(r"ISPOM is at (\S+)", line):
            return App(process, found[1], folder)
    raise AssertionError(f"the app ended with code {process.wait()}")


def serving(module: str, folder: Path, *words: str) -> Iterator[App]:
    """The app that `python -m tests.app.page.MODULE FOLDER WORDS` serves, for a fixture; it is ended afterwards."""
    found = launched([sys.executable, "-m", f"tests.app.page.{module}", str(folder), *words], folder)
    yield found
    found.process.kill()
    found.process.wait()


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    yield from serving("serve_double", tmp_path_factory.mktemp("recordings"), "0")


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    """The app with the real stereo estimator on `sim:tiny`."""
    yield from serving("serve_tiny", tmp_path_factory.mktemp("tiny"), "0")


@pytest.fixture(scope="module")
def browser() -> Iterator:
    with playwright.sync_playwright() as p:
        found = p.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield found
        found.close()


class Page:
    """A page that was opened, with what its console said."""

    def __init__(
        self,
        browser,
        url: str,
        *,
        viewer: str | None = None,
        after_viewer: str = "",
        before: str = NOT_NEW,
        first: str = "state.total > 0",
    ) -> None:
        """`viewer` is a script in place of the Rerun viewer's, which takes seconds of processor time, and
        `after_viewer` one behind it; `before` runs before the page's own: without it the captions show. It is there
        when `first` holds."""
        self.faults: list[str] = []
        self.requests: list[str] = []
        self.tab = browser.new_page(viewport={"width": 1280, "height": 720}, color_scheme="dark")
        self.tab.set_default_timeout(PATIENCE_MS)
        self.tab.on("console", lambda m: self.faults.append(m.text) if m.type == "error" else None)
        self.tab.on("pageerror", lambda e: self.faults.append(str(e)))
        self.tab.on("request", lambda r: self.requests.append(r.url))
        self.tab.add_init_script(before)
        if viewer is not None:
            script = {"body": viewer, "content_type": "text/javascript"}
            self.tab.route("**/rerun/viewer.js", lambda route: route.fulfill(**script))
            self.tab.route("**/rerun/re_viewer_bg.wasm", lambda route: route.fulfill(body=""))
        if after_viewer:
            self.tab.route(
                "**/rerun/viewer.js",
                lambda route: route.fulfill(body=route.fetch().text() + after_viewer, content_type="text/javascript"),
            )
        self.tab.goto(url)
        self.until(first, "the first state")

    @property
    def state(self) -> dict:
        return json.loads(self.tab.evaluate("JSON.stringify(window.ispom.state)"))

    def until(self, condition: str, what: str, patience_ms: float = 0) -> None:
        # Not wait_for_function: that evaluates strings inside the page, which the page's security policy forbids.
        script = f"(async () => {{ const state = window.ispom?.state; return Boolean(state && ({condition})); }})()"
        until = time.monotonic() + (patience_ms or PATIENCE_MS) / 1000
        while not self.tab.evaluate(script):
            assert time.monotonic() < until, f"timed out waiting for {what}; {self.state}; console {self.faults}"
            self.tab.wait_for_timeout(50)

    def resize(self, width: int, height: int) -> None:
        """Gives the window another size, which the page hears of and follows in its next animation frame."""
        self.tab.set_viewport_size({"width": width, "height": height})
        self.until(f"innerWidth === {width} && innerHeight === {height}", "the size of the window")
        self.tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def send(self, message: str) -> None:
        """As the page's own keys and bar do it."""
        self.tab.evaluate(f"{{ const {{ send, action }} = window.ispom; send({message}); }}")

    def open_tab(self, name: str) -> None:
        """A tab of the left pane, also below a sheet."""
        tabs = "[...document.querySelectorAll('#panels [role=tab]')]"
        self.tab.evaluate(f"(name) => {tabs}.find((tab) => tab.textContent === name)?.click()", name)

    @property
    def controls(self):
        """viser's panels, in the tab that is open then."""
        self.open_tab("Controls")
        return self.tab.frame_locator("#controls")

    @property
    def explain(self):
        """What features say of the frame, in the tab that is open then."""
        self.open_tab("Explain")
        return self.tab.locator("#tab-Explain")


@contextmanager
def page_at(browser, app: App, condition: str = ENDED) -> Iterator[Page]:
    """A page without the Rerun viewer once a condition holds; nothing may be wrong in its console in the end."""
    opened = Page(browser, app.url, viewer=FAKE)
    opened.until(condition, condition)
    yield opened
    assert not opened.faults
    opened.tab.close()


@pytest.fixture(scope="module")
def page(browser, app: App) -> Page:
    return Page(browser, app.url)


def test_it_plays_by_itself(page: Page):
    first = page.state["index"]
    page.until(f"state.ended || state.index > {first} + 3", "the frame counter to advance")
    page.until("state.ended && !state.playing", "the end")
    assert page.state["computed"] == TOTAL
    expect(page.tab.locator("#exposure")).to_have_text(f"frame {TOTAL - 1} / {TOTAL - 1}")
    expect(page.tab.locator("#methods .method")).to_have_count(3)
    expect(page.tab.locator("#methods .method").nth(1)).to_have_text(re.compile(r"^Stereo.*\d mm?$"))


def test_viser_shows_its_panels(page: Page):
    page.explain.locator(".card").nth(2).wait_for()
    for name in ("Methods", "View", "Files"):
        page.controls.get_by_role("tab", name=name).wait_for()


def test_rerun_starts_and_follows_the_time_shown(page: Page):
    page.tab.locator("#cover").wait_for(state="hidden")
    page.send("{do: 'seek', index: 12}")
    page.until("window.ispom.viewer.stage.shown?.index === 12", "Rerun to stand at the frame shown")


VIEWER = """async () => {
  const { recordings } = await window.ispom.viewer.handle.get_state();
  const serial = ({ timelines }) => Number(timelines.find(({ name }) => name === "stage")?.time_range?.end ?? 0);
  return JSON.stringify({ recordings: recordings.map((each) => ({ id: each.store_id, serial: serial(each) })) });
}"""


def test_animation_frames_stay_the_browsers(page: Page):
    """A frame that was asked for can be cancelled, and the next one comes."""
    called = """new Promise((done) => {
      const called = [];
      cancelAnimationFrame(requestAnimationFrame(() => called.push("cancelled")));
      requestAnimationFrame(() => requestAnimationFrame(() => done(called)));
    })"""
    assert page.tab.evaluate(called) == []
    assert "[native code]" in page.tab.evaluate("String(window.requestAnimationFrame)")


def test_the_saved_picture_is_what_is_on_the_screen(page: Page):
    assert apart(page) < 0.02, "both viewers and the panels are in it"


def apart(page: Page) -> float:
    """Saves a picture of the page; the share of its pixels that are not as on the screen."""
    screen = cv2.imdecode(np.frombuffer(settled(page), np.uint8), cv2.IMREAD_COLOR)
    page.tab.get_by_role("button", name="save this view").click()
    with page.tab.expect_download() as download:
        page.tab.get_by_text("Picture of the page").click()
    assert download.value.suggested_filename == f"double-40-{page.state['index']}.png"
    saved = cv2.imread(str(download.value.path()))
    assert saved is not None and screen is not None and saved.shape == screen.shape
    return float((cv2.absdiff(saved, screen).max(axis=2) > 48).mean())


def settled(page: Page) -> bytes:
    """A screenshot of what changes no more: viewers draw what is new some frames after the page has it."""
    until, before = time.monotonic() + PATIENCE_MS / 1000, b""
    while (now := page.tab.screenshot()) != before:
        assert time.monotonic() < until, "timed out waiting for the picture to stand still"
        before = now
        page.tab.wait_for_timeout(1000)
    return now


def test_a_layer_that_is_hidden_in_the_past_leaves_rerun_where_it_is(page: Page):
    page.send("{do: 'seek', index: 12}")
    shown = "window.ispom.viewer.stage.shown"
    page.until(f"{shown}?.index === 12 && {shown}.complete", "Rerun to stand at the frame shown")
    before = stands(page)
    page.controls.get_by_role("tab", name="View").click()
    drawn = len(page.state["hidden"])  # colours of tracks that are not chosen
    for hidden in (drawn + 1, drawn):
        page.controls.get_by_text("ground truth", exact=True).first.click()
        both = f"state.hidden.length === {hidden} && window.ispom.viewer.hidden.size === {hidden}"
        page.until(both, "the layer")
        page.tab.wait_for_timeout(500)  # the viewer watches itself every 250 ms
        assert stands(page) == before


def stands(page: Page) -> list[tuple[str, int | None]]:
    """What the viewer shows: its recordings, and the message that each took in last."""
    return [(each["id"], each["serial"]) for each in json.loads(page.tab.evaluate(VIEWER))["recordings"]]


def test_keys_step_forward_and_back(page: Page):
    page.send("{do: 'seek', index: 10}")
    page.until("state.index === 10", "the seek")
    page.tab.locator("#bar").click(position={"x": 600, "y": 15})
    page.tab.keyboard.press("ArrowRight")
    page.until("state.index === 11", "a step forward")
    page.tab.keyboard.press("ArrowLeft")
    page.until("state.index === 10", "a step back")
    page.tab.keyboard.press("Space")
    page.until("state.playing || state.index > 10", "playing")
    page.until("!state.playing && state.index === 43", "the end")


def test_the_buttons_of_the_time_dock_work(page: Page):
    page.tab.get_by_role("button", name="One frame back").click()
    page.until("state.index === 42", "a step back")
    page.tab.get_by_role("button", name="One frame on").click()
    page.until("state.index === 43", "a step forward")
    page.tab.get_by_label("Speed").select_option("4 ×")
    page.until("state.speed === 4", "the speed")
    page.tab.get_by_role("button", name="First frame").click()
    page.until("state.index === 0", "the first frame")
    page.tab.get_by_role("button", name="Loop from here").click()
    page.until("String(state.loop) === '0,'", "the loop's start")
    page.tab.get_by_role("button", name="Newest computed frame").click()
    page.until("state.index === 43", "the newest frame")
    page.tab.get_by_role("button", name="Loop to here").click()
    page.until("String(state.loop) === '0,43'", "the loop's end")
    page.tab.get_by_role("button", name="Clear the loop").click()
    page.until("state.loop === null", "no loop")


def test_the_dock_seeks(page: Page):
    page.tab.locator("#axis").click(position={"x": 176 + 452, "y": 4})
    page.until("Math.abs(state.index - 21) <= 1", "the middle")


def test_a_second_browser_shows_the_same(page: Page, browser, app: App):
    page.send("{do: 'seek', index: 17}")
    page.until("state.index === 17", "the seek")
    other = Page(browser, app.url, viewer="")
    other.until("state.index === 17 && state.computed === 44", "the same state")
    other.send("{do: 'take_control'}")
    other.send("{do: 'seek', index: 5}")
    page.until("state.index === 5", "the other's seek")
    assert not other.faults
    other.tab.close()


def test_recording_leaves_a_sound_file(page: Page, app: App):
    page.controls.get_by_role("tab", name="Files").click()
    page.controls.get_by_role("textbox").first.wait_for()
    page.controls.get_by_role("button", name="Record", exact=True).click()
    page.until("state.recording", "the recording")
    page.controls.get_by_role("button", name="Stop recording").click()
    page.until("!state.recording", "the end of the recording")
    page.tab.locator("#home").click()
    link = page.tab.locator("#runs a[href='recordings/double-1.rrd']")
    link.wait_for()
    page.tab.locator("#back").click()
    rerun = Path(sys.executable).with_name("rerun")
    subprocess.run([str(rerun), "rrd", "verify", str(app.recordings / "double-1.rrd")], check=True, capture_output=True)


def test_the_page_requests_nothing_elsewhere_and_logs_no_complaint(page: Page, app: App):
    base = app.url.partition("?")[0]
    own = (base, base.replace("http", "ws"), "data:", "blob:")
    foreign = {url for url in page.requests if not url.startswith(own)}
    assert not foreign
    assert not page.faults


def test_closed_and_opened_again_it_shows_the_same(page: Page, browser, app: App):
    index = page.state["index"]
    page.tab.close()
    again = Page(browser, app.url)
    again.until(f"state.index === {index} && state.computed === 44", "the same state")
    again.tab.locator("#cover").wait_for(state="hidden")
    again.tab.close()


def test_a_taken_port_is_reported_and_the_next_one_used(app: App, tmp_path: Path):
    taken = urlsplit(app.url).port
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.app.page.serve_double", str(tmp_path), str(taken)],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    assert process.stderr.readline() == f"port {taken} is taken, trying the next one\n"
    process.kill()
    process.wait()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_closes_the_recording_within_three_seconds(tmp_path: Path, number: signal.Signals):
    app = start(tmp_path)
    press_record(app.url)
    until = time.monotonic() + PATIENCE_MS / 1000
    while not (files := list(tmp_path.glob("*.rrd"))) or files[0].stat().st_size < 20_000:
        assert time.monotonic() < until, "nothing was recorded"
        time.sleep(0.01)
    began = time.monotonic()
    app.process.send_signal(number)
    assert app.process.wait(10) == 0
    assert time.monotonic() - began < 3.0
    rerun = Path(sys.executable).with_name("rerun")
    (finished,) = tmp_path.glob("*.rrd")
    assert not finished.name.startswith(".")
    subprocess.run([str(rerun), "rrd", "verify", str(finished)], check=True, capture_output=True)
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", urlsplit(app.url).port)) != 0


def press_record(url: str) -> None:
    """Presses record without a browser."""

    async def main() -> None:
        async with ClientSession() as client, client.ws_connect(url.replace("?", "ws?")) as ws:
            await ws.receive()
            await ws.send_str('{"do": "record"}')
            while True:
                if json.loads((await ws.receive()).data)["recording"]:
                    return

    # In a thread of its own: playwright has a loop running in this one.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(lambda: asyncio.run(asyncio.wait_for(main(), PATIENCE_MS / 1000))).result()
