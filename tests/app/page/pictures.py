"""Takes the pictures of the documentation: `python -m tests.app.page.pictures [PATH ...]` writes them into docs.

The program is started as a user would, and Chromium shows the page, or one that a command wrote. A path is that of a
picture below docs, such as methods/pictures/lines.webp; without one all are taken.
"""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

from tests.app.page.click_lessons import served
from tests.app.page.test_browser import CHROMIUM, FLAGS, Page, launched, playwright
from tests.app.page.test_stage import seek

DOCS = Path(__file__).parents[3] / "docs"
ISPOM = [sys.executable, "-m", "ispom_app"]
SIZE = {"width": 1400, "height": 800}
SETTLED_MS = 6000
"""The 3-D view frames the path."""
DARK = "sim:tiny?fault=darkness:factor=0.02,from_s=1,until_s=1.6"
PAN = "sim:tiny?motion=pan&duration_s=10"
TAGS = "sim:tiny?place=tags&motion=sideways"
DRIVE = "sim:city?motion=drive"
SENSORS = f"{DRIVE}&sensor=imu&sensor=gnss"


@dataclass(frozen=True)
class Shown:
    """A session of the page: the words after `ispom`, and the frame; None: where the command begins."""

    words: tuple[str, ...]
    frame: int | None = None


@dataclass(frozen=True)
class Written:
    """A page that commands write: the words after `ispom` of each, and the file, or the folder for a web server."""

    commands: tuple[tuple[str, ...], ...]
    file: str


def method(name: str, source: str = "sim:city", frame: int = 155, settings: tuple[str, ...] = ()) -> Shown:
    return Shown(("app", source, "--methods", name, *settings), frame)


METHODS = {
    "monocular": method("monocular"),
    "stereo": method("stereo"),
    "integrated": Shown(("app", "sim:city"), 155),
    "monocular_paper": method("monocular.paper"),
    "stereo_paper": method("stereo.paper"),
    "integrated_paper": Shown(("app", "sim:city", "--variant", "paper"), 155),
    "points": method("points"),
    "lines": method("lines", "sim:indoor", 144),
    "lines_monocular": method("lines.monocular", "sim:indoor", 144),
    "direct": method("direct"),
    "direct_monocular": method("direct.monocular"),
    "flow": method("flow"),
    "hybrid": method("hybrid"),
    "hybrid_monocular": method("hybrid.monocular"),
    "panorama": method("panorama", PAN),
    "tags": method("tags", TAGS, 60, ("--tags.side-m", "1.2")),
    "planar": method("planar", DRIVE),
    "sfm": method("sfm"),
    "trifocal": method("trifocal"),
    "multicamera": method("multicamera", "sim:ring6", 40),
    "fused": method("fused", SENSORS, 900),
    "fused_stereo": method("fused.stereo", SENSORS, 900),
    "fused_tight": method("fused.tight", SENSORS, 900),
}
TARGET = ("--target", "aprilgrid:6x6:0.03:0.3")
PICTURES: dict[str, Shown | Written] = {
    "tutorials/lost_track.png": Shown(("app", DARK, "--methods", "monocular"), 33),
    "tutorials/teach.png": Shown(("learn", "collapse")),
    "tutorials/own_method.png": Shown(("app", "sim:tiny", "--methods", "frames", "monocular"), 60),
    "tutorials/compare_settings.png": Written(
        (
            ("run", "sim:tiny", "--methods", "stereo", "--out", "recordings/a"),
            ("run", "sim:tiny", "--methods", "stereo", "--stereo.max-tracks", "150", "--out", "recordings/b"),
            ("report", "recordings/a", "recordings/b", "--out", "report.html"),
        ),
        "report.html",
    ),
    "tutorials/calibrate_rig.png": Written(
        (("calibrate", "rig", "sim:calibration?views=30&blur_ms=20", *TARGET, "--report", "calibration.html"),),
        "calibration.html",
    ),
    "gallery/failures.png": Written((("publish", "--failures", "--out", "failures"),), "failures"),
    **{f"methods/pictures/{name}.webp": shown for name, shown in METHODS.items()},
}
"""What each picture shows. `frames` is the method of examples/own_estimator, which must be installed."""


def take(name: str) -> None:
    """Writes one picture: a PNG with 256 colours, or a WebP."""
    shown = PICTURES[name]
    with TemporaryDirectory() as folder, playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        taken = _session(shown, Path(folder), browser) if isinstance(shown, Shown) else _file(shown, folder, browser)
        browser.close()
    path = DOCS / name
    path.parent.mkdir(exist_ok=True)
    with Image.open(io.BytesIO(taken)) as picture:
        if path.suffix == ".png":
            picture.convert("RGB").quantize(256).save(path, optimize=True)
        else:
            picture.convert("RGB").save(path, quality=70, method=6)


def _session(shown: Shown, folder: Path, browser: Any) -> bytes:
    app = launched([*ISPOM, *shown.words, "--port", "0", "--no-browser"], folder)
    try:
        page = Page(browser, app.url)
        page.tab.set_viewport_size(SIZE)
        if shown.frame is None:
            page.until("state.computed > 60", "the question", 600_000)
        else:
            page.until(f"state.computed > {shown.frame} || state.ended", "the frame", 1_200_000)
            seek(page, shown.frame)
        page.until("window.ispom.viewer.stage.shown?.index === state.index", "Rerun at that frame", 300_000)
        return _settled(page.tab.wait_for_timeout, page.tab.screenshot)
    finally:
        app.process.terminate()
        app.process.wait(30)


def _file(shown: Written, folder: str, browser: Any) -> bytes:
    for words in shown.commands:
        subprocess.run([*ISPOM, *words], cwd=folder, check=True)
    tab, path = browser.new_page(viewport=SIZE), Path(folder) / shown.file
    with served(path) if path.is_dir() else nullcontext(path.as_uri()) as url:
        tab.goto(url)
        return _settled(tab.wait_for_timeout, tab.screenshot)


def _settled(wait: Callable[[float], None], screenshot: Callable[[], bytes]) -> bytes:
    wait(SETTLED_MS)
    return screenshot()


if __name__ == "__main__":
    for each in sys.argv[1:] or PICTURES:
        take(each)
