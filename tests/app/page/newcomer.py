"""Five tasks of a newcomer, done with the real app in Chromium: `python -m tests.app.page.newcomer` prints for each the
clicks, the seconds, and the answer as it stands on the page.

The answers are read from the page alone. The times are those of the machine: they mean something where it is idle.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from ispom.sequences import open_sequence
from tests.app.page.test_browser import CHROMIUM, FLAGS, Page, launched, playwright

PATIENCE_MS = 120_000
FILM_FRAMES = 80


class Newcomer:
    """A person at the page, who counts clicks."""

    def __init__(self, page: Page) -> None:
        self.page, self.clicks, self.began = page, 0, time.monotonic()

    def click(self, selector: str, text: str = "") -> None:
        place = self.page.tab.locator(selector)
        (place.filter(has_text=text) if text else place).first.click(timeout=PATIENCE_MS)
        self.clicks += 1

    def read(self, selector: str) -> str:
        place = self.page.tab.locator(selector).first
        place.wait_for(timeout=PATIENCE_MS)
        return " ".join(place.inner_text().split())


def why_does_it_jump(person: Newcomer) -> str:
    person.click("#answer button", "Diagnose")
    person.page.tab.locator("#answer button", has_text="Apply").wait_for(timeout=PATIENCE_MS)
    return person.read("#answer")


def what_limits_the_inliers(person: Newcomer) -> str:
    return person.read("#funnel .limits")


def which_run_is_better(person: Newcomer) -> str:
    person.click("#home")
    for name in ("some", "many"):
        person.click(f"#runs tr[data-key='{name}'] input[type=checkbox]")
    person.click("#compare-selected")
    person.page.until("state.compared?.[3]", "the comparison", PATIENCE_MS)
    parting = person.page.tab.locator("#compare .parting")
    where = " ".join(parting.first.inner_text().split()) if parting.count() else "no parting"
    return f"{person.read('#compare .verdict')} … {where}"


def own_film(person: Newcomer) -> str:
    person.page.tab.locator("#path").fill("film.mp4")
    person.click("#open button", "Open")
    person.page.until("state.index > 0", "the first frames", PATIENCE_MS)
    return f"{person.read('#guess')} … {person.read('#answer')}"


def a_lesson(person: Newcomer) -> str:
    person.click("#all-lessons")
    person.click("#learn [data-learn]")
    person.click("#lesson .option")
    person.click("#lesson .reveal")
    return person.read("#lesson .right")


TASKS: tuple[tuple[list[str], Callable[[Newcomer], str], str], ...] = (
    (["app", "few"], why_does_it_jump, "state.index >= 0"),
    (["app", "few"], what_limits_the_inliers, "state.index >= 0"),
    (["app", "few"], which_run_is_better, "state.index >= 0"),
    (["app"], own_film, "true"),
    (["app"], a_lesson, "true"),
)
"""The command, the task, and when the person begins."""


@contextmanager
def at_the_page(words: list[str], folder: Path, ready: str) -> Iterator[Newcomer]:
    command = [sys.executable, "-m", "ispom_app", *words, "--port", "0", "--no-browser"]
    app = launched(["env", "-C", str(folder), *command], folder)
    try:
        with playwright.sync_playwright() as started:
            browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            page = Page(browser, app.url, first=ready)
            yield Newcomer(page)
            page.tab.screenshot(path=str(folder / f"{words[-1]}.png"))
            browser.close()
    finally:
        app.process.terminate()
        app.process.wait(30)


def prepare(folder: Path) -> None:
    """Three runs of one source, one with too few tracks, and a film without a calibration."""
    for name, tracks in (("few", "50"), ("some", "150"), ("many", "500")):
        run = ["run", "sim:tiny", "--methods", "monocular", "--monocular.max-tracks", tracks]
        run += ["--out", f"recordings/{name}"]
        subprocess.run([sys.executable, "-m", "ispom_app", *run], cwd=folder, check=True, capture_output=True)
    (folder / "few").symlink_to("recordings/few")
    sequence = open_sequence("sim:city", max_exposures=FILM_FRAMES)
    images = [m.images["video"] for m in sequence if "video" in getattr(m, "images", {})]
    height, width = images[0].shape[:2]
    film = cv2.VideoWriter(str(folder / "film.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (width, height))
    for image in images:
        film.write(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    film.release()


if __name__ == "__main__":
    with TemporaryDirectory() as place:
        prepare(Path(place))
        for words, task, ready in TASKS:
            with at_the_page(words, Path(place), ready) as person:
                answer = task(person)
                seconds = time.monotonic() - person.began
                sys.stdout.write(f"{task.__name__}: {person.clicks} clicks, {seconds:.0f} s: {answer}\n")
