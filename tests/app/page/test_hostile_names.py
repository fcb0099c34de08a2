"""Names from the disk that are markup: they are shown as they are, and nothing in them runs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, browser, launched  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
IMAGE = "<img src=x onerror=top.hit=1>"
FRAME = "<iframe srcdoc='<img src=x onerror=top.hit=2>'>"
LINK = "[x](javascript:top.hit=3) **bold**"
MADE = "img[src=x], iframe[srcdoc], a[href^=javascript]"
CAMERA = "width: 64\nheight: 48\nfx: 60\nfy: 60\ncx: 31.5\ncy: 23.5\n"


def recording(folder: Path) -> Path:
    folder.mkdir()
    (folder / "camera.yaml").write_text(CAMERA)
    texture = np.random.default_rng(0).integers(0, 256, (48, 90), np.uint8)
    for i in range(8):
        cv2.imwrite(str(folder / f"{IMAGE} {i:02d}.png"), texture[:, i : i + 64])
    return folder


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    folder = tmp_path_factory.mktemp("sources")
    source, _, _ = (recording(folder / name) for name in (IMAGE, FRAME, LINK))
    recordings = tmp_path_factory.mktemp("recordings")
    (recordings / f"{FRAME}.rrd").write_bytes(b"rows")
    found = launched(
        [sys.executable, "-m", "tests.app.page.serve_double", str(recordings), "0", str(source)], recordings
    )
    yield found
    found.process.kill()
    found.process.wait()


def field(page: Page, label: str):
    """The input beside a label."""
    return page.controls.get_by_text(label, exact=True).locator("xpath=ancestor::*[.//input][1]//input").first


def opened(page: Page, source: str) -> None:
    field(page, "source").fill(source)
    page.controls.get_by_role("button", name="Open", exact=True).click()


def test_no_name_becomes_markup_anywhere_on_the_page(browser, app: App):  # noqa: F811
    page = Page(browser, app.url, viewer=FAKE)
    page.until("state.ended", "the end")
    assert IMAGE in page.tab.locator("#name").inner_text() and IMAGE in page.tab.title()
    page.controls.get_by_text("Source", exact=True).first.click()
    source = Path(field(page, "source").input_value())
    assert source.name == IMAGE

    opened(page, str(source.with_name(FRAME)))
    page.until("state.run === 2 && state.ended", "the other source")
    opened(page, str(source.with_name(LINK)))
    page.until("state.run === 3 && state.ended", "the third source")
    opened(page, f"/no/{FRAME}")
    page.tab.locator(".notice.error").get_by_text(FRAME).wait_for()

    assert not page.explain.locator(MADE).count()
    for tab in ("Files", "Methods", "View"):
        page.controls.get_by_role("tab", name=tab).click()
        assert not page.controls.locator(MADE).count(), tab
    page.tab.locator("#home").click()
    page.tab.locator("#runs").get_by_text(f"{FRAME}.rrd", exact=True).wait_for()
    page.tab.locator("#recent").get_by_title(str(source), exact=True).wait_for()
    page.tab.locator("#browse").click()
    page.tab.locator("#folders").get_by_text(f"▶ {FRAME}", exact=True).wait_for()
    page.tab.locator("#back").click()
    assert not page.tab.locator(f":is({MADE}):not(#controls)").count()
    assert page.tab.evaluate("window.hit") is None
    assert [frame.url for frame in page.tab.frames if "viser" not in frame.url] == [page.tab.main_frame.url]
    page.tab.close()
