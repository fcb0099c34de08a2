"""A view in a real browser: what a person does in the page reaches Python's side by the link, and the other way round.

The notebook around it is a page with an element and a model, which is what an application gives a widget.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

import ispom
from tests.app.page.test_browser import CHROMIUM, FLAGS, playwright

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
HOME = "http://notebook.test/"
HOST = """<!doctype html><body>{page}<div id="link"></div><script type="module">
{link}
const values = {values}, heard = {{}};
window.sent = [];
window.told = (name, ...rest) => (heard[name] ?? []).forEach((call) => call(...rest));
window.model = {{
  get: (name) => values[name],
  set(name, value) {{ values[name] = value; window.told(`change:${{name}}`); }},
  save_changes: () => window.sent.push({{ frame: values.frame, tracks: values.tracks }}),
  send: (content) => window.sent.push(content),
  on: (name, call) => (heard[name] ??= []).push(call),
  off() {{}},
}};
window.begin = () => render({{ model: window.model, el: document.getElementById("link") }});
</script>"""


@pytest.fixture(scope="module")
def run() -> ispom.Run:
    return ispom.run("sim:tiny", "stereo", frames=36, max_tracks=300)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield found
        found.close()


def opened(browser: Any, view: Any) -> tuple[Any, Any]:
    """The page of the application, and the frame with that of the view. Whatever else is asked for fails the test."""
    link = view._esm.replace("export default", "const widget =")
    values = json.dumps({name: getattr(view, name) for name in ("channel", "frame", "tracks", "page")})
    html = HOST.format(page=view._repr_html_(), link=link, values=values)
    tab = browser.new_page(viewport={"width": 900, "height": 900})
    asked: list[str] = []

    def answered(route: Any) -> None:
        if route.request.url == HOME:
            route.fulfill(body=html, content_type="text/html")
        elif route.request.url.startswith("data:"):
            route.continue_()
        else:
            asked.append(route.request.url)
            route.abort()

    tab.route("**/*", answered)
    tab.goto(HOME)
    page = tab.frame_locator("iframe")
    playwright.expect(page.locator("#at")).not_to_be_empty()
    tab.evaluate("() => void window.begin()")  # after the page, as where a notebook is opened again
    tab.wait_for_function("window.sent.some((content) => content.known)")
    assert [url for url in asked if not url.endswith("favicon.ico")] == []
    return tab, page


def last(tab: Any) -> Any:
    return tab.evaluate("window.sent.at(-1)")


def test_a_click_on_a_track_reaches_python(run: ispom.Run, browser: Any) -> None:
    tab, page = opened(browser, run.show())
    first, second = page.locator("circle[data-track]").nth(40), page.locator("circle[data-track]").nth(90)
    ids = [int(each.get_attribute("data-track") or -1) for each in (first, second)]
    first.click()
    tab.wait_for_function(f"window.sent.at(-1).tracks?.includes({ids[0]})")
    second.click(modifiers=["Shift"])
    tab.wait_for_function("window.sent.at(-1).tracks.length == 2")
    assert last(tab) == {"frame": run.show().frame, "tracks": ids}
    playwright.expect(page.locator("#ids")).to_have_value(", ".join(map(str, ids)))
    page.locator("#before").click()
    tab.wait_for_function(f"window.sent.at(-1).frame != {run.show().frame}")
    assert last(tab)["tracks"] == ids, "what is chosen stays chosen from frame to frame"
    tab.close()


def test_what_python_sets_is_shown_and_new_steps_come_in(run: ispom.Run, browser: Any) -> None:
    walk = ispom.stepper(run.sequence, "stereo", max_tracks=300)
    view = walk.show()
    for _ in range(2):
        next(walk)
    tab, page = opened(browser, view)
    messages: list[Any] = []
    view.send = messages.append
    next(walk)
    tab.evaluate("(message) => window.told('msg:custom', message)", messages[-1])
    playwright.expect(page.locator("#at")).to_contain_text(f"frame {view.frame} ")
    playwright.expect(page.locator("#slider")).to_have_attribute("max", "2")
    first = run.sequence.kinds.index("stereo")
    tab.evaluate(f"window.model.set('frame', {first})")
    playwright.expect(page.locator("#at")).to_contain_text(f"frame {first} ")
    walk.back()
    tab.evaluate("(message) => window.told('msg:custom', message)", messages[-1])
    playwright.expect(page.locator("#slider")).to_have_attribute("max", "1")
    tab.close()


def test_the_page_alone_goes_through_all_frames(run: ispom.Run, browser: Any) -> None:
    tab = browser.new_page()
    tab.set_content(run.show().html)
    count = len(run.steps)
    tab.locator("#slider").press("Home")
    for step in run.steps:
        playwright.expect(tab.locator("#at")).to_contain_text(f"{step.time_ns * 1e-9:.3f} s")
        playwright.expect(tab.locator("summary")).to_have_text(f"{len(step.decisions)} checks")
        tab.locator("#after").click()
    assert tab.locator("#slider").get_attribute("max") == str(count - 1)
    tab.close()


def test_text_of_a_source_is_shown_as_text(run: ispom.Run, browser: Any) -> None:
    bad = "<img src=x onerror=alert(1)>"
    tab = browser.new_page()
    alerts: list[str] = []
    tab.on("dialog", lambda dialog: (alerts.append(dialog.message), dialog.dismiss()))
    steps = tuple(replace(s, decisions=(ispom.Decision(bad, 1, 0, False, key="bad"),)) for s in run.steps)
    tab.set_content(replace(run, source=bad, steps=steps).show().html)
    playwright.expect(tab.locator("#verdict")).to_contain_text(bad)
    assert tab.locator("img").count() == 0 and not alerts
    tab.close()
