"""The check that was clicked, over time: its curves as values, and the clicks in a browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.page import check_plot as plots
from ispom_app.page.check_plot import check_plot, plot_of
from ispom_app.run.history.record import ExposureRecord
from ispom_app.run.history.series import Series
from ispom_app.run.playback import Playback
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State

from ispom.estimators.modern.monocular import checks
from ispom.types import Decision, Status, Step
from tests import doubles
from tests.alone import METHODS
from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser  # noqa: F401 - fixtures

FAKE = Path(__file__).with_name("fake_viewer.js").read_text()
NAME = "monocular.parallax"


def series_of(*said: Decision | None, other: tuple[int, ...] = ()) -> Series:
    """Of a monocular run that says this at its exposures; at the `other` ones only stereo steps."""
    series = Series(("monocular", "stereo"))
    for i, decision in enumerate(said):
        method = "stereo" if i in other else "monocular"
        step = Step(i, Status.TRACKING, decisions=() if decision is None else (decision,), method=method)
        series.append(ExposureRecord(i, i, "video", (step,), {}, {}, {}))
    return series


def moved(*values: float | None) -> list[Decision | None]:
    return [None if v is None else checks.PARALLAX.of(v, 2.5) for v in values]


def test_the_curve_is_drawn_where_the_method_said_something_with_its_threshold() -> None:
    plot = check_plot(NAME, series_of(*moved(0.5, 1.0, None, 2.0)), np.arange(0, 50, 10), 1)
    assert plot.values == "M0.0 94.0h0L250.0 72.0M750.0 28.0h0"
    assert plot.thresholds == "M0.0 6.0h0L250.0 6.0L750.0 6.0"
    assert (plot.low, plot.high, plot.beyond) == ("0.5", "2.5", "")
    assert plot.now == "exposure 1: 1 deg, threshold 2.5 deg" and plot.help.endswith("[deg]")


def test_an_exposure_of_another_camera_does_not_break_the_curve() -> None:
    said = series_of(*moved(0.5, None, 1.0), other=(1,))
    plot = check_plot(NAME, said, np.arange(3), 1)
    assert plot.values.count("M") == 1
    assert plot.now == "nothing said at exposure 1; at 0: 0.5 deg, threshold 2.5 deg"


def test_a_threshold_that_would_flatten_the_curve_is_named_instead() -> None:
    said = series_of(*(checks.OUTLIERS.of(v, 500) for v in (3, 7)))
    plot = check_plot("monocular.outliers", said, np.arange(2), 1)
    assert plot.thresholds == "" and plot.beyond == "threshold 500, beyond the plot" and plot.high == "7"


def test_a_quantity_without_a_threshold_and_one_never_said_are_plots_as_well() -> None:
    said = series_of(*moved(0.5, 1.0))
    alive = check_plot("monocular.landmarks", said, np.arange(2), 1)
    assert alive.values and alive.thresholds == alive.beyond == ""
    nothing = check_plot("monocular.view_angle", said, np.arange(2), 1)
    assert nothing.values == "" and nothing.now == "nothing said so far"
    assert "No method of this branch" in check_plot("stereo.paper.rigid_points", said, np.arange(2), 1).now


def test_a_long_run_keeps_its_peaks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plots, "COLUMNS", 10)
    values = [1.0] * 1000
    values[503], values[777] = 9.0, 0.25
    plot = check_plot(NAME, series_of(*moved(*values)), np.arange(1000), 0)
    assert len(re.findall("[ML]", plot.values)) <= 20
    assert (plot.low, plot.high) == ("0.25", "9") and f" {plots.PAD:.1f}" in plot.values


def test_it_goes_as_far_as_the_run_is_computed() -> None:
    run = CurrentRun(Playback(doubles.sequence(40), METHODS, builder=build), 10**8)
    for _ in range(20):
        run.step()
    assert plot_of(State("double:40"), run) is None
    plot = plot_of(replace(State("double:40"), plotted=NAME), run)
    assert plot is not None
    ends = [float(x) for x in re.findall(r"[ML]([\d.]+) ", plot.values)]
    assert 300 < max(ends) < 600, "of a thousand"


def build(config, methods, rig):
    return doubles.ensemble(methods, doubles.FullEstimator)


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    opened = Page(browser, app.url, viewer=FAKE)
    opened.until("state.ended && !state.playing", "the end")
    go_to(opened, 20)
    yield opened
    assert not opened.faults
    opened.tab.close()


in_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


def go_to(page: Page, index: int) -> None:
    page.send(f"{{do: 'seek', index: {index}}}")
    page.until(f"state.index === {index}", "the seek")
    page.controls.locator(".explain", has_text=f"Frame {index}").first.wait_for()  # viser draws it a little later


def row(page: Page, name: str = NAME):
    """Of the folder with all checks, which is open as long as the page is."""
    found = page.controls.locator(f'.explain button[data-plot="{name}"]').last
    if not found.is_visible():
        page.controls.get_by_text("All checks", exact=True).click()
        found.wait_for()
    return found


@in_chromium
def test_a_click_on_a_check_plots_it_and_a_reload_keeps_it(page: Page) -> None:
    row(page).click()
    page.until(f"state.plotted === '{NAME}' && state.plot.values", "the plot")
    page.until("location.hash.includes('plot=')", "the address")  # which is written twice a second at most
    page.tab.reload()
    page.until(f"state.plotted === '{NAME}' && state.plot.values", "the plot after a reload")
    assert page.tab.locator("#plot").is_visible() and page.tab.locator("#plot b").inner_text() == NAME
    row(page).and_(page.controls.locator("[aria-pressed=true]")).wait_for()


@in_chromium
def test_a_click_into_the_plot_shows_the_exposure_there(page: Page) -> None:
    box = page.tab.locator("#plot svg").bounding_box()
    page.tab.mouse.click(box["x"] + box["width"] / 4, box["y"] + box["height"] / 2)
    page.until("Math.abs(state.index - 11) <= 1 && !state.playing", "the exposure at a quarter")
    cursor = page.tab.locator("#cursor").bounding_box()
    assert abs(cursor["x"] - box["x"] - box["width"] / 4) < 20 and cursor["height"] > box["height"]


@in_chromium
def test_by_keyboard_a_check_is_closed_and_another_opened_and_keeps_the_focus(page: Page) -> None:
    go_to(page, 15)  # and the next one: of the video both
    row(page).focus()
    page.tab.keyboard.press("Enter")
    page.until("state.plotted === ''", "the plot to be closed")
    other = page.controls.locator('.explain button[data-plot="monocular.alive"]')
    page.controls.get_by_text("Tracks and numbers", exact=True).click()
    other.wait_for()
    other.focus()
    page.tab.keyboard.press("Enter")
    page.until("state.plotted !== ''", "the plot of the next line")
    name = page.state["plotted"]
    assert name != NAME and not page.state["playing"]
    page.tab.keyboard.press("ArrowRight")
    page.until("state.index === 16", "the step, with the focus on a check")
    row(page, name).and_(page.controls.locator(":focus")).wait_for()


@in_chromium
def test_a_press_counts_once_where_the_cards_are_drawn_anew_before_the_button_is_let_go(page: Page) -> None:
    page.send("{do: 'plot', name: ''}")
    go_to(page, 15)
    page.until("state.plotted === ''", "no plot")
    row(page).hover()
    page.tab.mouse.down()
    go_to(page, 16)
    page.tab.mouse.up()
    page.until(f"state.plotted === '{NAME}'", "the plot")
    go_to(page, 15)
    assert page.state["plotted"] == NAME


@in_chromium
def test_the_plot_is_closed_by_its_button_without_a_seek(page: Page) -> None:
    index = page.state["index"]
    page.tab.locator("#plot button").click()
    page.until("state.plotted === '' && state.plot === null", "the plot to be closed")
    assert page.state["index"] == index and page.tab.locator("#plot").is_hidden()


@in_chromium
def test_a_wide_text_stays_in_its_line_at_1280_pixels(page: Page) -> None:
    go_to(page, 15)
    row(page).click()
    page.until("state.plot", "the plot")
    page.tab.evaluate("document.querySelector('#plot .help').textContent = 'what it is '.repeat(60)")
    button = page.tab.locator("#plot button").bounding_box()
    assert button["x"] + button["width"] <= 1280 and button["height"] < 26


@in_chromium
def test_the_address_names_the_plot_and_reopens_it(page: Page) -> None:
    page.send("{do: 'plot', name: ''}")
    page.until("state.plotted === '' && !location.hash.includes('plot')", "no plot")
    page.tab.evaluate("location.hash += '&plot=monocular.alive'")
    page.until("state.plotted === 'monocular.alive' && location.hash.includes('plot=monocular.alive')", "the plot")
