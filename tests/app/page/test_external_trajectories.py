"""In the page: another program's trajectory beside the methods, and the integration step by step."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from ispom_app.presentation import colours

from tests.app.page.test_browser import CHROMIUM, App, Page, browser, expect, page_at, serving  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
PAPER = "integrated.paper"


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    yield from serving("serve_external_trajectories", tmp_path_factory.mktemp("beside"), "0")


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app) as opened:
        yield opened


def tab(page: Page, name: str) -> None:
    page.controls.get_by_role("tab", name=name, exact=True).click()


def choose(page: Page, option: str) -> None:
    """Of the dropdown of the integrations."""
    page.controls.get_by_label("integration", exact=True).click()
    page.controls.get_by_role("option", name=option, exact=True).click()


def test_the_table_and_the_curves_have_the_other_program(page: Page):
    tab(page, "Branches")
    page.controls.get_by_text("Other programs").wait_for()
    cells = page.controls.locator("tr", has_text="orb").first.locator("td")
    expect(cells).to_have_text([re.compile("orb$"), re.compile(r"^[\d.]+ mm SE\(3\)$"), "0"])
    page.controls.get_by_text("aligned to the ground truth by se3").wait_for()
    signs = page.tab.locator('.plot[data-name="error"] .now > div')
    signs.nth(2).wait_for()
    expect(signs.last).to_have_attribute("style", re.compile(re.escape(colours.css(colours.colour_of_external(0)))))


def test_the_integration_is_clicked_through_step_by_step(page: Page):
    tab(page, "View")
    page.controls.get_by_text("Integration, step by step").click()
    choose(page, "Integrated, 2013")
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
    page.controls.get_by_text("2 of 3: Initial spline").wait_for()
    choose(page, "off")
    page.until("state.integration === null", "the end of looking")
