"""Clicks through all published lessons, with the real viewer: `python -m tests.app.page.click_lessons SITE [NAME ...]`.

SITE is a folder that `ispom publish --lessons` wrote; it is served by `python -m http.server`. Of each lesson, it says
after how many seconds its page had the first question, and was at its end. The code is 1 where a first question took
longer than FIRST_S, an answer has no verdict, or a text says something else than the run.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.request import urlopen

from playwright.sync_api import sync_playwright

from tests.app.page.test_browser import CHROMIUM, FLAGS
from tests.app.page.test_lessons import Learner, answer

FIRST_S = 15.0
"""For the first question."""
START_S = 20.0


@contextmanager
def served(folder: Path) -> Iterator[str]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1", "--directory", str(folder)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    url, until = f"http://127.0.0.1:{port}/", time.monotonic() + START_S
    try:
        while True:
            try:
                urlopen(url).close()
                break
            except OSError:
                if time.monotonic() > until:
                    raise
                time.sleep(0.1)
        yield url
    finally:
        server.kill()
        server.wait()


def clicked_through(browser, url: str, name: str) -> tuple[float, float, list[str]]:
    """In a new tab: seconds to the first question and to the end, and what is wrong."""
    began, wrong = time.monotonic(), []
    page = Learner(browser, f"{url}#lesson={name}:1")
    page.tab.locator("#lesson .reveal").wait_for()
    first_s = time.monotonic() - began
    while True:
        step = page.tab.evaluate("window.ispom.lesson.place") + 1
        answer(page)
        page.tab.locator("#lesson").get_by_role("button", name="Run and reveal").click()
        page.revealed()
        verdicts = page.tab.locator("#lesson .verdict").all_inner_texts()
        wrong += [f"step {step}: {verdicts}"] if len(verdicts) != 1 else []
        on = page.tab.locator("#lesson .act.main")
        ends = on.inner_text() == "Finish"
        on.click()
        if ends:
            break
        page.until(
            f"window.ispom.lesson?.place === {step} && window.ispom.lesson.phase === 'asking'", "the next question"
        )
    page.tab.locator("#lesson").wait_for(state="hidden")
    wrong += page.faults
    page.tab.close()
    return first_s, time.monotonic() - began, wrong


def main(site: Path, names: list[str]) -> int:
    code = 0
    with served(site) as url, sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        if not names:
            page = Learner(browser, url)
            page.tab.locator("#learn [data-learn]").first.wait_for()
            names = page.tab.locator("#learn [data-learn]").evaluate_all("all => all.map((each) => each.dataset.learn)")
            page.tab.close()
        for name in names:
            first_s, whole_s, wrong = clicked_through(browser, url, name)
            code |= int(first_s > FIRST_S or bool(wrong))
            line = f"{name:12} first question {first_s:5.1f} s, all {whole_s:5.1f} s {' '.join(wrong)}"
            sys.stdout.write(f"{line.rstrip()}\n")
            sys.stdout.flush()
        browser.close()
    return code


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
