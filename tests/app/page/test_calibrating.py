"""The calibration page in a real browser: a simulated calibration from the form to residuals over its images."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import CHROMIUM, NOT_NEW, PATIENCE_MS, App, app, browser  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
TARGET = "chessboard:7x5:0.03"


class CalibrationTab:
    """The page, with what its console said."""

    def __init__(self, browser, url: str) -> None:  # noqa: F811
        self.faults: list[str] = []
        self.tab = browser.new_page(viewport={"width": 1280, "height": 720}, color_scheme="dark")
        self.tab.set_default_timeout(PATIENCE_MS)
        self.tab.on("console", lambda m: self.faults.append(m.text) if m.type == "error" else None)
        self.tab.on("pageerror", lambda e: self.faults.append(str(e)))
        self.tab.add_init_script(NOT_NEW)
        self.tab.goto(url)  # with the token, which the browser keeps
        address, _, _ = url.partition("?")
        self.tab.goto(f"{address}calibration")
        self.until("state.number >= 0", "the first state")

    def until(self, condition: str, what: str) -> None:
        script = f"(() => {{ const state = window.calibration?.state; return Boolean(state && ({condition})); }})()"
        until = time.monotonic() + 2 * PATIENCE_MS / 1000
        while not self.tab.evaluate(script):
            assert time.monotonic() < until, f"timed out waiting for {what}; {self.faults}"
            self.tab.wait_for_timeout(50)

    @property
    def state(self) -> dict:
        return json.loads(self.tab.evaluate("JSON.stringify(window.calibration.state)"))


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[CalibrationTab]:  # noqa: F811
    opened = CalibrationTab(browser, app.url)
    yield opened
    assert not opened.faults
    opened.tab.close()


def test_before_the_first_request_it_explains_what_to_do(page: CalibrationTab):
    page.tab.get_by_text("Give a folder of images of a target").wait_for()
    assert page.state["number"] == 0


def test_a_mistake_is_reported_in_a_sentence(page: CalibrationTab):
    page.tab.locator("textarea[name=images]").fill("/nowhere/at/all")
    page.tab.locator("input[name=target]").fill(TARGET)
    page.tab.get_by_role("button", name="Calibrate", exact=True).click()
    page.until("state.number === 1 && state.fault", "the fault")
    assert "/nowhere/at/all" in page.tab.locator("#fault").inner_text()


def test_a_simulation_is_solved_and_reported_with_its_truth(page: CalibrationTab):
    page.tab.get_by_role("button", name="Try a simulation").click()
    page.until("state.number === 2", "the start")
    assert page.tab.locator("textarea[name=images]").input_value() == "sim:calibration?views=20"
    page.until("state.verdict && !state.doing", "the result")
    assert page.tab.locator("#verdict").inner_text() in ("good", "usable")
    page.tab.get_by_text("video minus its truth").wait_for()
    assert page.tab.locator("#drawings svg").count() == 7
    assert page.tab.locator("#views button").count() == 20


def test_an_image_is_looked_at_with_its_points_and_residuals(page: CalibrationTab):
    name = page.state["cameras"][0]["views"][5]["name"]
    page.tab.locator("#views button").nth(5).click()
    page.tab.get_by_text(f"{name}: ").wait_for()
    page.tab.locator("#overlay path").wait_for(state="attached")
    assert page.tab.evaluate("window.calibration.view") == [0, 5]
    assert page.tab.locator("#overlay circle").count() > 20
    until = time.monotonic() + PATIENCE_MS / 1000
    while page.tab.evaluate("document.querySelector('#image').naturalWidth") != 640:
        assert time.monotonic() < until, "timed out waiting for the image"
        page.tab.wait_for_timeout(50)


@pytest.mark.parametrize("where", ["#cameras button", "#views button:nth-child(4)", "#said .new a:nth-of-type(2)"])
def test_a_redrawn_part_keeps_the_focus(page: CalibrationTab, where: str):
    page.tab.locator(where).focus()
    page.tab.locator(where).evaluate("(e) => (window.old = e)")
    page.tab.evaluate("window.calibration.state.known = ''")  # as if there were news
    page.until("!window.old.isConnected", "the page to be drawn anew")
    assert page.tab.locator(f"{where}:focus").count() == 1


def test_the_result_is_kept_and_can_be_opened_and_downloaded(page: CalibrationTab):
    kept = page.state["kept"]
    line = page.tab.locator("#said li.new")
    assert kept and line.inner_text().startswith(f"{kept}: ")
    with page.tab.expect_download() as download:
        line.get_by_role("link", name="rig.yaml").click()
    assert "Written by `ispom calibrate`" in download.value.path().read_text()
    with page.tab.context.expect_page() as report:
        line.get_by_role("link", name="report.html").click()
    report.value.get_by_role("heading", name="Calibration:").wait_for()
    report.value.close()


def test_residuals_are_drawn_to_the_requested_scale(page: CalibrationTab):
    path = page.tab.locator("#overlay path")
    before = path.get_attribute("d")
    page.tab.get_by_label("length of residuals").press("End")
    page.tab.get_by_text("200 times as long").wait_for()
    assert path.get_attribute("d") != before


def test_similar_views_are_to_be_filmed_again(page: CalibrationTab):
    page.tab.locator("textarea[name=images]").fill("sim:calibration?views=8&alike")
    page.tab.get_by_role("button", name="Calibrate", exact=True).click()
    page.until("state.number === 3 && !state.doing", "the end")
    assert page.state.get("verdict", {}).get("level") == "redo" or page.state["fault"]
