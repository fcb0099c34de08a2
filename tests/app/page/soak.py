"""The page after a long drive: what browser and app hold of memory, and how fast it steps back.

`python -m tests.app.page.soak FOLDER_OF_A_DRIVE [COUNT [BRANCH_AT]]` goes to and fro over the drive until there are
COUNT frames (5,000), plays them as fast as they are computed with the page open in Chromium, and prints a line every
15 s; then it runs a branch from frame BRANCH_AT to the end, where that is given; at the end it steps back 50 times,
from frames all over the run. It takes some ten minutes without a branch.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from tests.app.page import memory
from tests.app.page.test_browser import CHROMIUM, FLAGS, App, Page, launched

COUNT = 5000
EVERY_S = 15.0
STEPS = 50
STEP_BACK = """async (from) => {
  const shown = (index) => new Promise((done) => {
    let now = window.ispom;
    const look = (value) => value.state.index === index && done(performance.now());
    Object.defineProperty(window, "ispom", { configurable: true, get: () => now, set: (value) => look((now = value)) });
    look(now);
  });
  const { send } = window.ispom;
  send({ do: "seek", index: from });
  await shown(from);
  await new Promise((done) => setTimeout(done, 1500));
  const began = performance.now();
  send({ do: "back" });
  return (await shown(from - 1)) - began;
}"""
"""The time from the command to the new state in the page [ms], when nothing is drawn meanwhile."""

HEAP = "performance.memory.usedJSHeapSize"
"""Of the renderer's memory, JavaScript's [bytes]. The Rerun viewer's, which never shrinks, is not to be had."""


def sampled(page: Page, app: App, say: Callable[[str], object], branch: int) -> None:
    """Prints until this branch has ended and is drawn."""
    began, due = time.monotonic(), 0.0
    while not page.state["notices"]:
        state, behind = page.state, page.tab.locator("#behind").inner_text()
        over = state["ended"] and state["address"]["branch"] == branch and not behind
        if time.monotonic() >= due or over:
            due = time.monotonic() + EVERY_S
            browser, own = memory.of_browser(), memory.of_app(app.process.pid)
            kinds = ", ".join(f"{kind} {size / 1e6:.0f}" for kind, size in browser.most_common())
            heap = f"of the renderer's scripts {page.tab.evaluate(HEAP) / 1e6:.0f}"
            say(
                f"{time.monotonic() - began:6.0f} s  frame {state['computed']:5d}  {behind or 'drawn':32}"
                f"browser {browser.total() / 1e6:5.0f} MB ({kinds}; {heap})"
                f"  app {own.total() / 1e6:5.0f} MB"
                f"  both {(browser + own).total() / 1e6:5.0f} MB"
            )
            if over:
                return
        page.tab.wait_for_timeout(1000)


def main(source: str, count: int = COUNT, *branch_at: int) -> int:
    def say(text: str) -> None:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as p:
        command = [sys.executable, "-m", "tests.app.page.served_soak", folder, source, *map(str, (count, *branch_at))]
        app = launched(command, Path(folder))
        try:
            browser = p.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            page = Page(browser, app.url)
            sampled(page, app, say, len(branch_at))
            places = np.linspace(count - 1, 5, STEPS).astype(int)
            ms = np.array([page.tab.evaluate(STEP_BACK, int(i)) for i in np.random.default_rng(0).permutation(places)])
            say(f"step back: median {np.median(ms):.1f} ms, 95 % below {np.percentile(ms, 95):.1f} ms, of {len(ms)}")
            say(f"console: {page.faults}")
            browser.close()
        finally:
            app.process.terminate()
            app.process.wait(10)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:])))
