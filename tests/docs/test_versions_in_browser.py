"""The list of versions and the note on old pages, in a browser that reads the site from a disk."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.docs.test_versions import ROOT, VERSIONS

playwright = pytest.importorskip("playwright.sync_api")
pytest.importorskip("furo")
DOCS = ROOT / "docs"
CHROMIUM = shutil.which("chromium")
CONF = f"""
from runpy import run_path
real = run_path({str(DOCS / "conf.py")!r})
names = ("html_theme", "html_theme_options", "html_sidebars", "html_css_files")
globals().update({{name: real[name] for name in names}})
project = "ISPOM"
templates_path = [{str(DOCS / "_templates")!r}]
html_static_path = [{str(DOCS / "_static")!r}]
"""
"""The look of the real site, without its pages."""
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two versions of a site with a page in a folder; of the second one a copy that was never put beside others."""
    folder = tmp_path_factory.mktemp("site")
    source = folder / "source"
    (source / "howto").mkdir(parents=True)
    (source / "conf.py").write_text(CONF)
    (source / "index.rst").write_text("Start\n=====\n\n.. toctree::\n\n   howto/run\n")
    (source / "howto" / "run.rst").write_text("Run\n===\n\nText.\n")
    for version in ("0.1.0", "0.2.0"):
        built = folder / f"built-{version}"
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", "-D", f"release={version}"]
        subprocess.run([*command, str(source), str(built)], check=True, capture_output=True)
        VERSIONS.publish(built, folder / "site", version)
    return folder / "site"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.mark.parametrize("page", ["index.html", "howto/run.html"])
@pytest.mark.parametrize(("folder", "old"), [("0.1.0", True), ("0.2.0", False), ("latest", False)])
def test_each_page_has_all_versions_and_only_an_old_one_a_note(
    site: Path, browser: Any, folder: str, old: bool, page: str
) -> None:
    tab = browser.new_page()
    tab.goto((site / folder / page).as_uri())
    links = tab.locator("#versions a")
    assert links.all_text_contents() == ["0.2.0 (latest)", "0.1.0"]
    assert tab.locator("#versions [aria-current]").all_text_contents() == (["0.1.0"] if old else ["0.2.0 (latest)"])
    note = tab.locator(".old-version")
    assert note.count() == old and (not old or "0.1.0" in note.text_content())
    links.last.click()
    assert tab.url == (site / "0.1.0" / "index.html").as_uri()
    tab.locator(".old-version a").click()
    assert tab.url == (site / "latest" / "index.html").as_uri()
    tab.close()


def test_a_site_that_was_built_alone_has_neither(site: Path, browser: Any) -> None:
    tab = browser.new_page()
    tab.goto((site.parent / "built-0.1.0" / "howto" / "run.html").as_uri())
    assert not tab.locator("#versions").is_visible() and tab.locator(".old-version").count() == 0
    tab.close()
