"""Calibration error in the page: sliders, predictions, and the branch that runs with the error."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import AT_ONCE, CHROMIUM, App, Page, browser, page_at, tiny  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(browser, tiny: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, tiny, AT_ONCE) as opened:
        opened.send("{do: 'seek', index: state.total - 1}".replace("state.", "window.ispom.state."))
        opened.until("state.ended", "the end")
        opened.controls.get_by_role("tab", name="Branches", exact=True).click()
        opened.controls.get_by_text("Calibration error", exact=True).click()
        yield opened


def number(page: Page, label: str):
    """The number at the slider of this label."""
    row = page.controls.get_by_text(label, exact=True).locator("xpath=ancestor::p/../..")
    return row.get_by_role("textbox")


def test_a_slider_predicts_what_the_error_does(page: Page):
    page.controls.get_by_text("Move a slider").wait_for()
    number(page, "baseline [%]").fill("1")
    page.until("state.effect && state.effect.wrong.baseline_percent === 1", "the prediction")
    assert page.state["effect"]["predicted"]["stereo"] > 0
    page.controls.get_by_text("baseline +1 %").first.wait_for()


def test_a_slider_is_moved_by_its_keys(page: Page):
    row = page.controls.get_by_text("turn y [°]", exact=True).locator("xpath=ancestor::p/../..")
    row.get_by_role("slider").focus()
    for key in ("Shift+Tab", "Tab", "ArrowRight"):  # by key: after a click the arrows are the run's
        page.tab.keyboard.press(key)
    page.until("state.effect && state.effect.wrong.turn_y_deg > 0", "the prediction")
    number(page, "turn y [°]").fill("0")
    page.until("state.effect && !('turn_y_deg' in state.effect.wrong)", "the slider at 0 again")


def test_the_rerun_is_a_branch_that_is_compared_with_the_prediction(page: Page):
    predicted = page.state["effect"]["predicted"]["stereo"]
    page.controls.get_by_role("button", name="Rerun as a branch").click()
    page.until("state.branches.length === 2 && state.address.branch === 1", "the branch")
    page.send("{do: 'seek', index: window.ispom.state.total - 1}")
    page.until("state.effect && state.effect.rerun.stereo > 0", "the comparison")
    assert page.state["effect"]["rerun"]["stereo"] == pytest.approx(predicted, rel=0.3)
    page.controls.get_by_text("predicted-stereo").first.wait_for()


def test_no_error_puts_the_sliders_back(page: Page):
    page.controls.get_by_role("button", name="No error").click()
    page.until("state.effect && Object.keys(state.effect.wrong).length === 0", "nothing wrong")
    page.controls.get_by_role("button", name="Rerun as a branch", disabled=True).wait_for()
