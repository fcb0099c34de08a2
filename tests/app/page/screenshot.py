"""Takes the README's pictures: `python -m tests.app.page.screenshot` writes recordings/screenshot.png and moving.webp.

The demo is shown at a frame, and at many frames in turn, in Chromium with the real viewer.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from tests.app.page.test_browser import CHROMIUM, FLAGS, Page, launched, playwright
from tests.app.page.test_stage import seek

FOLDER = Path(__file__).parents[3] / "recordings"
FRAME, SETTLED_MS = 150, 4000
MOVING, MOVING_MS, MOVING_PX = range(20, 321, 10), 220, (960, 540)
"""Frames of the moving picture, how long each is shown [ms], and its size."""


def take(folder: Path, source: str = "sim:city") -> None:
    """Writes a PNG of 1600x900 pixels, and an animated WebP."""
    with TemporaryDirectory() as place:
        words = ["app", source, "--port", "0", "--no-browser"]
        app = launched([sys.executable, "-m", "ispom_app", *words], Path(place))
        try:
            with playwright.sync_playwright() as started:
                browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
                page = Page(browser, app.url)
                page.tab.set_viewport_size({"width": 1600, "height": 900})
                page.until(f"state.computed > {MOVING[-1]}", "the frames", 600_000)
                show(page, FRAME)
                page.tab.wait_for_timeout(SETTLED_MS)  # the 3-D view frames the path
                page.tab.screenshot(path=str(folder / "screenshot.png"))
                shown = [picture(page, frame) for frame in MOVING]
                browser.close()
        finally:
            app.process.terminate()
            app.process.wait(30)
    first, *others = shown
    first.save(
        folder / "moving.webp", save_all=True, append_images=others, duration=MOVING_MS, loop=0, quality=60, method=6
    )


def show(page: Page, frame: int) -> None:
    seek(page, frame)
    page.until("window.ispom.viewer.stage.shown?.index === state.index", "Rerun at that frame", 300_000)


def picture(page: Page, frame: int) -> Image.Image:
    show(page, frame)
    with Image.open(io.BytesIO(page.tab.screenshot())) as taken:
        return taken.convert("RGB").resize(MOVING_PX, Image.Resampling.LANCZOS)


if __name__ == "__main__":
    take(FOLDER)
