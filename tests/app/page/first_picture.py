"""Measures how long somebody waits who has nothing: from an empty cache to the moving picture of the demo.

`python -m tests.app.page.first_picture dist/ispom-0.1.0-py3-none-any.whl` runs the wheel by uvx, which fetches
all that it needs, and opens the page in Chromium.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.app.page.test_browser import CHROMIUM, FLAGS, Page, launched, playwright

PATIENCE_MS = 300_000


def measure(wheel: Path) -> dict[str, float]:
    """Returns the seconds after which the program says its address, and after which the viewer shows a frame."""
    with TemporaryDirectory() as place:
        home = {"HOME": place, "XDG_CACHE_HOME": f"{place}/cache", "XDG_DATA_HOME": f"{place}/data"}
        uv = {"UV_CACHE_DIR": f"{place}/uv", "UV_PYTHON": sys.executable}
        os.environ |= {**home, **uv}
        command = ["uvx", "--from", str(wheel.resolve()), "ispom", "demo", "--port", "0", "--no-browser"]
        begin = time.monotonic()
        app = launched(command, Path(place))
        served_s = time.monotonic() - begin
        try:
            with playwright.sync_playwright() as started:
                browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
                page = Page(browser, app.url)
                page.until("state.index >= 1 && window.ispom.viewer.stage?.shown", "the picture", PATIENCE_MS)
                shown_s = time.monotonic() - begin
                browser.close()
        finally:
            app.process.terminate()
            app.process.wait(30)
    return {"served_s": round(served_s, 1), "shown_s": round(shown_s, 1)}


if __name__ == "__main__":
    sys.stdout.write(f"{measure(Path(sys.argv[1]))}\n")
