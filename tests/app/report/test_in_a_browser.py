"""The page in a real browser, opened as a file: everything is drawn, in both themes, and nothing is asked for."""

from __future__ import annotations

from pathlib import Path

from tests.app.page.test_browser import browser, pytestmark
from tests.app.report.test_report import made, report

__all__ = ["browser", "made", "pytestmark"]
RECOLOURED = """(dark) => new Promise((done) => {
  const plot = document.querySelector("[data-figure]");
  const look = () => plot.layout.font.color !== dark ? done() : requestAnimationFrame(look);
  look();
})"""
"""Polled in here: the page's own policy forbids a poll that a test brings as text."""


def test_all_plots_are_drawn_without_a_network(made: Path, browser, tmp_path: Path) -> None:
    report(tmp_path / "report.html", made)
    page, troubles, asked = browser.new_page(color_scheme="dark"), [], []
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("console", lambda said: troubles.append(said.text) if said.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url))
    page.goto((tmp_path / "report.html").as_uri())
    page.evaluate("ready")
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    page.evaluate("Promise.all([...document.querySelectorAll('[data-figure]')].map(draw))")
    assert page.evaluate("document.querySelectorAll('[data-figure]:not(.js-plotly-plot)').length") == 0
    assert page.evaluate("document.querySelectorAll('[data-figure] canvas').length") >= 1, "no 3-D"
    dark = page.evaluate("document.querySelector('[data-figure]').layout.font.color")
    page.emulate_media(color_scheme="light")
    page.evaluate(RECOLOURED, dark)
    assert page.locator("#trouble").is_hidden()
    assert not troubles
    assert all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    page.close()
