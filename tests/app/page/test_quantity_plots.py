"""The plots of the time dock: what a page is sent of their curves, and the clicks in a browser."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.features.plots import page_message as quantity_plots
from ispom_app.features.plots.commands import ERROR, Plots
from ispom_app.features.plots.page_message import PlotNews, choices, plot_of
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State

from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build_full, with_values
from tests.app.page.test_browser import CHROMIUM, App, Page, app, browser, expect, page_at  # noqa: F401 - fixtures

NAME = "monocular.parallax"
STATE = State("double:40").having(Plots((NAME, "inliers")))


@pytest.fixture
def run() -> CurrentRun:
    return CurrentRun(Playback(doubles.sequence(40), METHODS, builder=build_full), 10**8)


def curves_of(parts: list[dict | None]) -> dict[str, list[tuple[int, float | None]]]:
    """By curve: frame and value, as a page puts them together."""
    found: dict[str, list[tuple[int, float | None]]] = {}
    for part in parts:
        for curve, frames, values in (part or {}).get("values", ()):
            found.setdefault(curve, []).extend(zip(frames, values, strict=True))
    return found


def test_in_increments_a_page_gets_what_one_that_comes_late_gets(run: CurrentRun) -> None:
    early, parts = PlotNews(), []
    while not run.playback.done:
        run.step()
        parts.append(early.since(STATE, run))
    assert early.since(STATE, run) is None, "each value is sent once"
    assert curves_of(parts) == curves_of([PlotNews().since(STATE, run)])
    (last_frame, last_value) = curves_of(parts)[NAME][-1]
    assert run.series.value(run.series.quantities[NAME], last_frame) == pytest.approx(last_value, rel=1e-4)


def test_a_check_comes_with_its_threshold_and_a_shared_key_with_a_curve_for_each_method(run: CurrentRun) -> None:
    run.step()
    check, shared = (PlotNews().since(STATE, run) or {})["plots"]
    assert [(c["id"], c["threshold"]) for c in check["curves"]] == [(NAME, False), (f"{NAME}.threshold", True)]
    assert check["unit"] == "deg"
    assert [c["id"] for c in shared["curves"]] == [f"{method}.inliers" for method in METHODS]


def test_a_curve_that_is_added_later_comes_whole_and_the_others_do_not_come_again(run: CurrentRun) -> None:
    for _ in range(10):
        run.step()
    news = PlotNews()
    news.since(with_values(STATE, plots=("inliers",)), run)
    added = news.since(STATE, run)
    assert added is not None and set(curves_of([added])) == {NAME, f"{NAME}.threshold"}
    assert "choices" not in added


def test_long_curves_come_in_slices(run: CurrentRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quantity_plots, "SLICE", 10)
    while not run.playback.done:
        run.step()
    news = PlotNews()
    parts = list(iter(lambda: news.since(STATE, run), None))
    assert len(parts) == 5
    monkeypatch.undo()
    assert curves_of(parts) == curves_of([PlotNews().since(STATE, run)])


def test_another_run_begins_again(run: CurrentRun) -> None:
    run.step()
    other = CurrentRun(Playback(doubles.sequence(40), METHODS, builder=build_full), 10**8)
    other.step()
    news = PlotNews()
    assert news.since(STATE, run) == news.since(STATE, other)


def test_what_the_run_does_not_have_is_not_plotted(run: CurrentRun) -> None:
    quantities = run.series.quantities
    for name in ("monocular.status", "stereo.paper.rigid_points", "nonsense", "time_s", ""):
        assert plot_of(name, quantities) is None, name
    assert all(plot_of(name, quantities) is not None for name, _ in choices(quantities) if name != ERROR)


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app) as opened:
        go_to(opened, 20)
        yield opened


in_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
SHOWN = "state.address.plots.split(',').includes('monocular.parallax')"
DRAWN = """(() => {
  const canvas = document.querySelector('.plot[data-name="monocular.parallax"] canvas');
  const ink = canvas?.getContext("2d", { willReadFrequently: true });
  const { data } = ink?.getImageData(0, 0, canvas.width, canvas.height) ?? { data: [] };
  return data.filter((value, i) => i % 4 === 3 && value).length > 200;
})()"""


def go_to(page: Page, index: int) -> None:
    page.send(f"{{do: 'seek', index: {index}}}")
    page.until(f"state.index === {index}", "the seek")
    page.explain.get_by_text(f"Frame {index}").first.wait_for()


def row(page: Page, name: str = NAME):
    """Of the folder with all checks, which is open as long as the page is."""
    found = page.explain.locator(f'button[data-plot="{name}"]').last
    if not found.is_visible():
        page.explain.get_by_text("All checks", exact=True).click()
        found.wait_for()
    return found


def plot(page: Page, name: str = NAME):
    return page.tab.locator(f'.plot[data-name="{name}"]')


@in_chromium
def test_the_usual_plots_have_curves_and_values_at_the_frame_shown(page: Page) -> None:
    assert page.tab.locator(".plot").count() == 2
    lines = plot(page, "inliers").locator(".now div")
    assert lines.locator(".whose").all_inner_texts() == ["Monocular", "Stereo", "Integrated"]
    assert all(float(value) > 0 for value in lines.locator(".value").all_inner_texts())
    last = page.tab.evaluate("document.getElementById('rows').clientWidth - 200")  # the axis ends there
    boxes = [line.bounding_box() for line in lines.all()]
    assert all(box["x"] > last for box in boxes), "they stand beside the curves"
    assert all(a["y"] + a["height"] <= b["y"] for a, b in pairwise(boxes))


@in_chromium
def test_a_click_on_a_check_plots_it_and_a_reload_keeps_it(page: Page) -> None:
    row(page).click()
    page.until(f"{SHOWN} && {DRAWN}", "the plot")
    page.until("location.hash.includes('plot=')", "the address")  # which is written twice a second at most
    page.tab.reload()
    page.until(f"{SHOWN} && {DRAWN}", "the plot after a reload")
    row(page).and_(page.explain.locator("[aria-pressed=true]")).wait_for()


@in_chromium
def test_a_click_into_a_plot_shows_the_frame_there_and_hovering_its_value(page: Page) -> None:
    box = plot(page).bounding_box()
    x = 176 + (box["width"] - 376) / 4
    page.tab.mouse.click(box["x"] + x, box["y"] + box["height"] / 2)
    page.until("Math.abs(state.index - 11) <= 1 && !state.playing", "the frame at a quarter")
    cursor = page.tab.locator("#cursor").bounding_box()
    assert abs(cursor["x"] - box["x"] - x) < 20 and cursor["height"] > box["height"]
    page.tab.mouse.move(box["x"] + x + 5, box["y"] + 20)
    expect(page.tab.locator("#axis-hint")).to_contain_text("Monocular: ")


@in_chromium
def test_by_keyboard_a_check_is_closed_and_another_opened_and_keeps_the_focus(page: Page) -> None:
    go_to(page, 15)  # and the next one: of the video both
    row(page).focus()
    page.tab.keyboard.press("Enter")
    page.until("state.address.plots === ''", "the plot to be closed")
    other = page.explain.locator('button[data-plot="monocular.alive"]')
    page.explain.get_by_text("Tracks and numbers", exact=True).click()
    other.wait_for()
    other.focus()
    page.tab.keyboard.press("Enter")
    page.until("state.address.plots !== ''", "the plot of another line")
    name = page.state["address"]["plots"].split(",")[-1]
    assert name != NAME and not page.state["playing"]
    page.tab.keyboard.press("ArrowRight")
    page.until("state.index === 16", "the step, with the focus on a check")
    row(page, name).and_(page.explain.locator(":focus")).wait_for()


@in_chromium
def test_a_press_counts_once_where_the_cards_are_drawn_again_before_the_button_is_let_go(page: Page) -> None:
    page.send("{do: 'set_plots', names: null}")
    go_to(page, 15)
    page.until("state.address.plots === ''", "the usual plots")
    row(page).hover()
    page.tab.mouse.down()
    go_to(page, 16)
    page.tab.mouse.up()
    page.until(SHOWN, "the plot")
    go_to(page, 15)
    assert NAME in page.state["address"]["plots"]


@in_chromium
def test_a_plot_is_closed_by_its_button_without_a_seek(page: Page) -> None:
    index = page.state["index"]
    plot(page).get_by_role("button", name="Closes the plot").click()
    page.until("state.address.plots === '' && document.querySelectorAll('.plot').length === 2", "the plot to be closed")
    assert page.state["index"] == index


@in_chromium
def test_a_quantity_is_added_by_its_name(page: Page) -> None:
    page.tab.locator("#add-plot").fill("stereo.alive")
    page.tab.locator("#add-plot").press("Enter")
    page.until("document.querySelectorAll('.plot').length === 3", "the plot")
    plot(page, "stereo.alive").get_by_text("Stereo: Alive").wait_for()


@in_chromium
def test_the_address_names_the_plots_and_reopens_them(page: Page) -> None:
    page.send("{do: 'set_plots', names: null}")
    page.until("state.address.plots === '' && !location.hash.includes('plot')", "the usual plots")
    page.tab.evaluate("location.hash += '&plot=monocular.alive'")
    page.until(
        "state.address.plots === 'monocular.alive' && location.hash.includes('plot=monocular.alive')", "the plot"
    )
    page.send("{do: 'set_plots', names: null}")
