"""A sweep in the page: chosen, run, compared, cancelled."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import AT_ONCE, CHROMIUM, App, Page, browser, expect, page_at, tiny  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(browser, tiny: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, tiny, AT_ONCE) as opened:
        opened.send("{do: 'seek', index: window.ispom.state.total - 1}")
        opened.until("state.ended", "the end")
        opened.controls.get_by_role("tab", name="Branches", exact=True).click()
        opened.controls.get_by_text("Sweep", exact=True).click()
        yield opened


def field(page: Page, label: str):
    """The input beside this label."""
    return page.controls.get_by_text(label, exact=True).locator("xpath=ancestor::p/../..").get_by_role("textbox")


def run(page: Page) -> None:
    page.controls.get_by_role("button", name="Run the values").click()


def test_a_wrong_value_is_reported_in_one_sentence(page: Page) -> None:
    expect(field(page, "values")).to_have_value("100, 200, 400, 800")  # proposed
    field(page, "values").fill("100, 20")
    run(page)
    page.until("state.notices.some(n => n.text.includes('give a value from 50 to 3000'))", "the refusal")
    assert page.state["sweep"] is None


def test_the_values_are_run_and_listed_together(page: Page) -> None:
    field(page, "values").fill("200, 400")
    run(page)
    page.until("state.sweep && !state.sweep.ended && state.sweep.share > 0", "how far it is", 60_000)
    page.controls.get_by_text("% of the frames").first.wait_for()
    page.until("state.sweep.ended", "the end of the sweep", 120_000)
    errors = page.state["sweep"]["ate_m"]
    assert sorted(errors) == ["200", "400"] and all(0 < error < 0.1 for error in errors.values())
    page.controls.get_by_text("2 of 2 runs").wait_for()
    page.controls.get_by_text("Error against the value").wait_for()


def test_a_value_is_shown_as_a_branch(page: Page) -> None:
    page.controls.get_by_role("button", name="Show as a branch").click()
    page.until("state.branches.length === 2 && state.address.branch === 1", "the branch")
    page.controls.get_by_text("max-tracks 200, sweep-1").first.wait_for()
    expect(field(page, "values")).not_to_have_value("200, 400")  # others are proposed for the branch


def test_it_can_be_cancelled(page: Page) -> None:
    field(page, "values").fill("100, 200, 300, 400, 500, 600")
    expect(field(page, "values")).to_have_value("100, 200, 300, 400, 500, 600")
    run(page)
    page.until("state.sweep.name === 'sweep-2' && state.sweep.share > 0", "its begin", 60_000)
    page.controls.get_by_role("button", name="Cancel").click()
    page.until("state.sweep.ended && state.sweep.share < 1", "its end", 60_000)
    page.controls.get_by_text("cancelled").wait_for()
