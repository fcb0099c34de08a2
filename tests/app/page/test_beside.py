"""In the page: another program's trajectory beside the methods, the flicker, and the integration step by step."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.page.test_browser import CHROMIUM, App, Page, browser, launched  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
FAKE = Path(__file__).with_name("fake_viewer.js").read_text()
PAPER = "integrated.paper"
COLOURED = """() => {
  const pictures = document.querySelector("#controls").contentDocument.querySelectorAll(".uplot canvas");
  const coloured = (c) => {
    const { data } = c.getContext("2d").getImageData(0, 0, c.width, c.height);
    const strong = (i) => data[i + 3] > 200 && Math.abs(data[i] - data[i + 2]) > 80;
    return [...Array(data.length / 4).keys()].filter((pixel) => strong(4 * pixel)).length;
  };
  return [...pictures].some((c) => coloured(c) > 50);
}"""
"""Whether a curve is drawn: all but curves is grey."""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    folder = tmp_path_factory.mktemp("beside")
    found = launched([sys.executable, "-m", "tests.app.page.serve_beside", str(folder), "0"], folder)
    yield found
    found.process.kill()
    found.process.wait()


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    opened = Page(browser, app.url, viewer=FAKE)
    opened.until("state.ended && !state.playing", "the end")
    yield opened
    assert not opened.faults
    opened.tab.close()


def tab(page: Page, name: str) -> None:
    page.controls.get_by_role("tab", name=name, exact=True).click()


def choose(page: Page, option: str) -> None:
    """Of the dropdown of the integrations."""
    page.controls.get_by_label("integration", exact=True).click()
    page.controls.get_by_role("option", name=option, exact=True).click()


def test_the_table_and_the_curves_have_the_other_program(page: Page):
    tab(page, "Compare")
    page.controls.get_by_text("Other programs").wait_for()
    cells = page.controls.locator("tr", has_text="orb").first.locator("td").all_inner_texts()
    assert cells[0].endswith("orb") and re.fullmatch(r"[\d.]+ mm SE\(3\)", cells[1]) and cells[2] == "0"
    page.controls.get_by_text("aligned to the ground truth by se3").wait_for()
    legend = page.controls.locator(".u-legend").first
    legend.wait_for()
    assert all(name in legend.inner_text() for name in ("Stereo", "Integrated (paper)", "orb"))
    page.tab.wait_for_function(COLOURED)


def test_x_flickers_between_two_sides_and_off_ends_it(page: Page):
    tab(page, "Compare")
    page.controls.get_by_text("Flicker", exact=True).click()
    page.tab.locator("#bar").click(position={"x": 600, "y": 15})
    page.tab.keyboard.press("x")
    page.until("state.flicker?.join() === 'a,0,monocular'", "the first side")
    page.controls.get_by_text("drawn: A, 0 first run: Monocular").wait_for()
    page.tab.keyboard.press("x")
    page.until("state.flicker?.join() === 'b,0,stereo'", "the other side")
    page.controls.get_by_role("button", name="A / B").click()
    page.until("state.flicker?.join() === 'a,0,monocular'", "the first side again")
    page.controls.get_by_role("button", name="Stop", exact=True).click()
    page.until("state.flicker === null", "the end of the flicker")
    page.controls.get_by_text("Choose two methods or branches").wait_for()


def test_the_integration_is_clicked_through_step_by_step(page: Page):
    tab(page, "View")
    page.controls.get_by_text("Integration, step by step").click()
    choose(page, "Integrated (paper)")
    page.until(f"state.integration?.join() === '{PAPER},0'", "the first step")
    for stage, title in enumerate(("Interpolated at t_j", "Scaled", "Rotated", "Oriented"), 1):
        page.controls.get_by_role("button", name="Next step ▶").click()
        page.until(f"state.integration?.join() === '{PAPER},{stage}'", title)
        page.controls.get_by_text(f"{stage + 1} of 5: {title}").wait_for()
    page.controls.get_by_role("button", name="◀ Previous step").click()
    page.until(f"state.integration?.join() === '{PAPER},3'", "one step back")
    choose(page, "Integrated")
    page.until("state.integration?.join() === 'integrated,0'", "the spline")
    page.controls.get_by_role("button", name="Next step ▶").click()
    page.controls.get_by_text("2 of 3: Spline begun with").wait_for()
    choose(page, "off")
    page.until("state.integration === null", "the end of looking")
