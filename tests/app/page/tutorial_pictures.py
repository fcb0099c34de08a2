"""Takes the tutorials' pictures: `python -m tests.app.page.tutorial_pictures` writes them into docs/tutorials."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from tests.app.page.test_browser import CHROMIUM, FLAGS, Page, launched, playwright
from tests.app.page.test_stage import seek

FOLDER = Path(__file__).parents[3] / "docs" / "tutorials"
DARK = "sim:tiny?fault=darkness:factor=0.02,from_s=1,until_s=1.6"
PICTURES: dict[str, tuple[list[str], int | None]] = {
    "lost_track": (["app", DARK, "--methods", "monocular"], 33),
    "teach": (["learn", "collapse"], None),
}
"""By tutorial: the command, and the frame that is shown; None: where the command begins."""
SETTLED_MS = 6000


def take(name: str) -> None:
    """Writes a PNG of 1400x800 pixels with 256 colours."""
    words, frame = PICTURES[name]
    with TemporaryDirectory() as folder:
        app = launched([sys.executable, "-m", "ispom_app", *words, "--port", "0", "--no-browser"], Path(folder))
        try:
            with playwright.sync_playwright() as started:
                browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
                page = Page(browser, app.url)
                page.tab.set_viewport_size({"width": 1400, "height": 800})
                if frame is not None:
                    page.until(f"state.computed > {frame}", "the frame", 600_000)
                    seek(page, frame)
                page.tab.get_by_text("Starting the Rerun viewer").wait_for(state="hidden", timeout=300_000)
                page.tab.wait_for_timeout(SETTLED_MS)  # the 3-D view frames the path
                page.tab.screenshot(path=str(FOLDER / f"{name}.png"))
                browser.close()
        finally:
            app.process.terminate()
            app.process.wait(30)
    with Image.open(FOLDER / f"{name}.png") as picture:
        picture.convert("RGB").quantize(256).save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    for each in sys.argv[1:] or PICTURES:
        take(each)
