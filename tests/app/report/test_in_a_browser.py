"""The page in a real browser, opened as a file: drawn in both themes, printed on white, and nothing is asked for."""

from __future__ import annotations

import shutil
from pathlib import Path

import yaml

from tests.app.page.test_browser import browser, pytestmark
from tests.app.report.test_report import made, report

__all__ = ["browser", "made", "pytestmark"]
RECOLOURED = """(dark) => new Promise((done) => {
  const plot = document.querySelector("[data-figure]");
  const look = () => plot.layout.font.color !== dark ? done() : requestAnimationFrame(look);
  look();
})"""
"""Polled in here: the page's own policy forbids a poll that a test brings as text."""
ATTACK = "<img src=x onerror=\"document.title='run'\"><script>document.title='run'</script>"
PRINTED = """() => {
  dispatchEvent(new Event("beforeprint"));
  const shown = [...document.querySelectorAll("[data-figure]")].filter((p) => !p.closest("details:not([open])"));
  return {
    drawn: shown.every((place) => place.classList.contains("js-plotly-plot")),
    text: [...new Set(shown.map((place) => place.layout.font.color))],
    widest: Math.max(...shown.map((place) => place.querySelector(".main-svg").getBoundingClientRect().width)),
    page: getComputedStyle(document.body).backgroundColor,
    words: getComputedStyle(document.body).color,
    cut: [...document.querySelectorAll(".scroll, .card")].filter((box) => getComputedStyle(box).overflowX !== "visible")
      .length,
  };
}"""


def test_all_plots_are_drawn_without_a_network(made: Path, browser, tmp_path: Path) -> None:
    report(tmp_path / "report.html", made)
    page, troubles, requested_urls = browser.new_page(color_scheme="dark"), [], []
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("console", lambda said: troubles.append(said.text) if said.type == "error" else None)
    page.on("request", lambda request: requested_urls.append(request.url))
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
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requested_urls)
    page.close()


def test_on_paper_the_page_is_dark_on_white_and_no_plot_is_cut(made: Path, browser, tmp_path: Path) -> None:
    """Of a dark page whose plots are not drawn yet, and wider than paper."""
    report(tmp_path / "report.html", made)
    page = browser.new_page(color_scheme="dark", viewport={"width": 1600, "height": 500})
    page.goto((tmp_path / "report.html").as_uri())
    page.evaluate("ready")
    page.emulate_media(media="print", color_scheme="dark")
    found = page.evaluate(PRINTED)
    assert found["drawn"] and found["text"] == ["#1c2126"] and found["widest"] <= 700
    assert found["page"] == "rgb(255, 255, 255)" and found["words"] == "rgb(28, 33, 38)"
    assert found["cut"] == 0
    page.emulate_media(media="screen", color_scheme="dark")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate("document.querySelector('[data-figure]').layout.font.color") == "#e6eaed"
    page.emulate_media(media="print")
    assert page.pdf().startswith(b"%PDF")
    page.close()


def test_names_in_a_run_are_text_whatever_they_hold(made: Path, browser, tmp_path: Path) -> None:
    run = Path(shutil.copytree(made, tmp_path / "a<img src=x onerror=document.title='run'>"))
    found = yaml.safe_load((run / "run.yaml").read_text())
    found |= {"source": ATTACK, "sequence": ATTACK, "notes": [ATTACK]}
    (run / "run.yaml").write_text(yaml.safe_dump(found))
    report(tmp_path / "report.html", run, made)
    page, troubles = browser.new_page(), []
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("console", lambda said: troubles.append(said.text) if said.type == "error" else None)
    page.goto((tmp_path / "report.html").as_uri())
    page.evaluate("ready")
    page.evaluate("Promise.all([...document.querySelectorAll('[data-figure]')].map(draw))")
    assert page.title() == f"{ATTACK}, {yaml.safe_load((made / 'run.yaml').read_text())['sequence']} – ISPOM report"
    assert page.locator("img[src='x'], img:not([src^='data:'])").count() == 0 and not troubles
    assert ATTACK in page.locator("h1").inner_text() and "a<img src=x" in page.locator("body").inner_text()
    page.close()
