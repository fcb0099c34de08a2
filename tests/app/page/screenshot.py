"""Takes the README's picture: `python -m tests.app.page.screenshot` writes recordings/screenshot.png.

The demo is shown at a frame, in Chromium with the real viewer.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.app.page.test_browser import CHROMIUM, FLAGS, Page, launched, playwright
from tests.app.page.test_stage import seek

PICTURE = Path(__file__).parents[3] / "recordings" / "screenshot.png"
FRAME, SETTLED_MS = 150, 4000


def take(picture: Path, source: str = "sim:city", frame: int = FRAME) -> None:
    """Writes a PNG of 1600x900 pixels."""
    with TemporaryDirectory() as folder:
        words = ["app", source, "--port", "0", "--no-browser"]
        app = launched([sys.executable, "-m", "ispom_app", *words], Path(folder))
        try:
            with playwright.sync_playwright() as started:
                browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
                page = Page(browser, app.url)
                page.tab.set_viewport_size({"width": 1600, "height": 900})
                page.until(f"state.computed > {frame}", "the frame", 600_000)
                seek(page, frame)
                page.tab.wait_for_timeout(SETTLED_MS)  # the 3-D view frames the path
                page.tab.screenshot(path=str(picture))
                browser.close()
        finally:
            app.process.terminate()
            app.process.wait(30)


if __name__ == "__main__":
    take(PICTURE)
