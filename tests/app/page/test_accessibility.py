"""The page for everybody: contrast of texts, names of controls, and roles, as axe-core judges them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, app, browser  # noqa: F401 - fixtures

axe_playwright_python = pytest.importorskip("axe_playwright_python.sync_playwright")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
NOT_OURS = {"frame-title", "landmark-one-main", "region", "page-has-heading-one"}
"""Rules about the structure of documents, which a tool of panes has no use for."""


def violations(where: Any) -> list[str]:
    """A line for each node that breaks a rule."""
    found = axe_playwright_python.Axe().run(where).response["violations"]
    return [
        f"{rule['id']}: {node['target']} {node['failureSummary'].splitlines()[-1].strip()}"
        for rule in found
        if rule["id"] not in NOT_OURS
        for node in rule["nodes"]
    ]


def in_scheme(page: Page, scheme: str) -> None:
    """The system turns dark or light, which changes colours and nothing else."""
    page.tab.evaluate("window.same = true")
    page.tab.emulate_media(color_scheme=scheme)
    of_viser = "document.getElementById('controls').contentDocument.documentElement"
    page.until(f"{of_viser}.getAttribute('data-mantine-color-scheme') === '{scheme}'", "viser's colours")
    assert page.tab.evaluate("window.same"), "the page was loaded again"


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    opened = Page(browser, app.url, viewer=FAKE)
    opened.until("state.ended && !state.playing", "the end")
    yield opened
    opened.tab.close()


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize(
    ("mode", "content"), [("debug", "#panels .card"), ("compare", "#compare .pair button"), ("learn", "#learn li")]
)
def test_the_page_has_contrast_and_names(page: Page, mode: str, content: str, scheme: str) -> None:
    in_scheme(page, scheme)
    page.tab.locator(f"#modes input[value={mode}]").check(force=True)
    page.tab.locator(content).first.wait_for()
    assert violations(page.tab) == []


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_start_screen_has_contrast_and_names(page: Page, scheme: str) -> None:
    in_scheme(page, scheme)
    page.tab.locator("#home").click()
    page.tab.locator("#runs tbody tr").first.wait_for()
    assert violations(page.tab) == []
    page.tab.locator("#back").click()


@pytest.mark.parametrize("tab", ["Tracks", "Methods", "Branches", "Breakpoints", "View", "Files"])
def test_our_texts_in_the_left_pane_have_contrast(page: Page, tab: str) -> None:
    """viser's own controls are not judged."""
    in_scheme(page, "dark")
    page.tab.locator("#modes input[value=debug]").check(force=True)
    page.controls.get_by_role("tab", name=tab, exact=True).click()
    page.controls.get_by_role("tab", name=tab, exact=True, selected=True).wait_for()
    frame = next(frame for frame in page.tab.frames if "viser" in frame.url)
    ours = [line for line in violations(frame) if line.startswith("color-contrast")]
    assert ours == []
