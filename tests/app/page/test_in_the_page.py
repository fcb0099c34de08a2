"""What a person meets in the page: keys, notices, labels, hostile names. A stand-in draws in place of Rerun."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from tests.app.page.test_browser import CHROMIUM, FAKE, PATIENCE_MS, App, Page, apart, app, browser, expect, page_at  # noqa: F401 - fixtures

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture(scope="module")
def page(browser, app: App) -> Iterator[Page]:  # noqa: F811
    with page_at(browser, app) as opened:
        yield opened


def test_the_arrows_in_a_field_move_nothing_else(page: Page):
    before = page.state["index"]
    page.controls.get_by_role("tab", name="Files").click()
    field = page.controls.get_by_role("textbox").last
    field.fill("two words")
    field.press("ArrowLeft")
    field.press("Space")
    assert field.input_value() == "two word s" and page.state["index"] == before and not page.state["playing"]


def test_an_error_is_dismissed_covers_nothing_and_does_not_come_back(page: Page):
    page.controls.get_by_text("Source", exact=True).first.click()
    page.controls.locator("input[value='double:40']").fill("double:nonsense")
    page.controls.get_by_role("button", name="Open", exact=True).click()
    notice = page.tab.locator(".notice.error")
    notice.wait_for()
    below = page.tab.locator("#panes").bounding_box()
    box = notice.bounding_box()
    assert box["y"] + box["height"] <= below["y"] + 1, "it lies on the panes"
    notice.get_by_role("button", name="dismiss").click()
    assert page.tab.locator(".notice").count() == 0
    page.tab.reload()
    page.until("state.total > 0 && state.notices.length > 0", "the state")
    assert page.tab.locator(".notice").count() == 0
    page.explain.wait_for()


def test_a_long_message_never_pushes_the_exposure_out_of_the_bar(page: Page):
    page.resize(1280, 720)
    page.tab.evaluate("document.getElementById('compiling').textContent = 'compiling the estimators '.repeat(20)")
    box = page.tab.locator("#time").bounding_box()
    assert box["x"] + box["width"] <= 1280


def test_apply_stays_visible_below_open_settings(page: Page):
    page.resize(1280, 720)
    page.controls.get_by_role("tab", name="Methods").click()
    page.controls.get_by_text("Stereo settings", exact=True).click()
    page.controls.locator("label:visible", has_text="max tracks").first.wait_for()
    box = page.controls.get_by_role("button", name="Apply and restart").bounding_box()
    assert box["y"] + box["height"] <= 720


def test_a_picture_without_the_viewer_has_all_the_rest_and_says_so(browser, app: App):  # noqa: F811
    page = Page(browser, app.url, viewer=FAKE)
    page.until("state.ended && window.ispom.viewer.handle", "the end")
    page.tab.evaluate("window.fake.panicked = true")
    page.tab.locator("#restart").wait_for()
    assert apart(page) < 0.02
    page.tab.locator(".notice").get_by_text("its place in the picture is empty").wait_for()
    assert not page.faults
    page.tab.close()


TEXTS_IN_A_ROW = """(() => {
  const parts = [...document.querySelectorAll("#bar > *, #transport > *")];
  const boxes = parts.map((e) => [e.id || e.dataset.do || e.textContent, e.getBoundingClientRect()]);
  const seen = boxes.filter(([, box]) => box.width && box.height);
  const common = (a, b, low, high) => Math.min(a[high], b[high]) - Math.max(a[low], b[low]) > 1;
  const over = ([, a], [, b]) => common(a, b, "left", "right") && common(a, b, "top", "bottom");
  const pairs = seen.flatMap((a, i) => seen.slice(i + 1).filter((b) => over(a, b)).map((b) => [a[0], b[0]]));
  const row = document.getElementById("transport").getBoundingClientRect();
  const cut = seen.filter(([, box]) => box.right > innerWidth + 1 || box.bottom > row.bottom + 1);
  return JSON.stringify([...pairs, ...cut.map(([name]) => name)]);
})()"""

ROWS_IN_THE_STAGE = """(() => {
  const [rows, stage] = ["at-image", "viewer"].map((id) => document.getElementById(id).getBoundingClientRect());
  return rows.right <= stage.right + 1 && rows.bottom <= stage.bottom + 1;
})()"""


@pytest.mark.parametrize(("width", "height"), [(760, 900), (1067, 600), (1280, 720), (1920, 1080)])
def test_nothing_lies_on_another_thing_or_beyond_the_window(page: Page, width: int, height: int):
    """1067x600 are what a browser's zoom of 150 % leaves of 1600x900."""
    page.resize(width, height)
    expect(page.tab.locator("#left")).to_be_visible(visible=width > 900)
    assert page.tab.evaluate(TEXTS_IN_A_ROW) == "[]"
    box = page.tab.locator("#exposure").bounding_box()
    assert box["width"] > 0 and box["x"] + box["width"] <= width, "the frame counter"
    page.until(ROWS_IN_THE_STAGE, "the rows at the image in their place")
    if width < 900:
        page.tab.locator("#fold").click()
        page.tab.locator("#left").wait_for()
    page.resize(1280, 720)


@pytest.mark.parametrize(("width", "height"), [(1067, 600), (1280, 720), (1920, 1080)])
def test_a_second_person_sees_who_is_in_control_beside_all_the_rest(
    browser,  # noqa: F811
    page: Page,
    app: App,  # noqa: F811
    width: int,
    height: int,
):
    second = Page(browser, app.url, viewer=FAKE)
    try:
        second.until("state.people.others.length > 0 && !state.people.driving", "somebody who follows")
        second.resize(width, height)
        expect(second.tab.locator("#people button").last).to_be_visible()
        assert second.tab.evaluate(TEXTS_IN_A_ROW) == "[]"
    finally:
        second.tab.close()


def test_the_splitter_never_cuts_the_controls(page: Page):
    splitter = page.tab.locator("#splitter")
    splitter.focus()
    for key in ("Shift+Tab", "Tab", *["ArrowLeft"] * 4):  # by key: after a click the arrows are the run's
        page.tab.keyboard.press(key)
    assert page.tab.locator("#splitter:focus").count() == 1
    edge = splitter.bounding_box()["x"]
    for role, name in (("tab", "Methods"), ("tab", "Files")):
        box = page.controls.get_by_role(role, name=name).bounding_box()
        assert box["x"] + box["width"] <= edge


def test_a_pose_and_its_error_are_two_things(page: Page):
    stereo = page.tab.locator("#methods .method").nth(1)
    assert "does not mean that it is accurate" in stereo.get_attribute("title")
    assert "from the ground truth" in stereo.get_attribute("title")
    label = "(e) => getComputedStyle(e, '::before').content + ' ' + getComputedStyle(e, '::before').display"
    for width in (1280, 1600):
        page.resize(width, 720)
        text = stereo.locator(".error").evaluate(label)
        assert "ATE" in text and "none" not in text.split()[-1]


def test_branches_are_not_lost_without_a_question(page: Page):
    """Opening a source discarded them silently."""
    page.resize(1280, 720)
    page.send("{do: 'seek', index: 10}")
    page.until("state.index === 10", "the seek")
    page.controls.get_by_role("tab", name="Methods").click()
    page.controls.get_by_role("button", name="Fork at frame 11").click()
    page.until("state.address.branch === 1 && state.ended && !state.playing", "the branch")
    dialog, run = page.tab.locator("#question"), page.state["run"]

    def ask() -> None:
        page.controls.get_by_role("button", name="Apply and restart").click()
        dialog.wait_for()
        assert "the branch “branch 1”" in dialog.inner_text()

    ask()
    page.tab.keyboard.press("Escape")
    dialog.wait_for(state="hidden")
    ask()
    page.tab.reload()  # it is still to be answered
    page.until("state.total > 0", "the state")
    dialog.wait_for()
    dialog.get_by_role("button", name="Stay here").click()
    dialog.wait_for(state="hidden")
    page.until(f"state.question === null && state.run === {run} && state.branches.length === 2", "all as it was")
    page.controls.get_by_role("tab", name="Methods").click()
    ask()
    page.tab.keyboard.press("Tab")
    page.tab.keyboard.press("Space")
    dialog.wait_for(state="hidden")
    page.until(f"state.run > {run} && state.branches.length === 1 && state.ended", "the restart")


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_every_text_can_be_read(browser, app: App, scheme: str):  # noqa: F811
    """Contrast of at least 4.5, where a text is no sign for something that is switched off."""
    tab = browser.new_page(viewport={"width": 1280, "height": 720}, color_scheme=scheme)
    tab.set_default_timeout(PATIENCE_MS)
    tab.goto(app.url)
    controls = tab.frame_locator("#controls")
    tab.locator("#panels .card").first.wait_for()
    assert not faint(tab.locator("#panels"))
    tab.evaluate("[...document.querySelectorAll('#panels [role=tab]')].at(-1).click()")
    for name in ("Methods", "View", "Files"):
        controls.get_by_role("tab", name=name).click()
        controls.locator("[role=tab][aria-selected=true]", has_text=name).wait_for()
        for place in (tab.locator("#bar"), controls.locator("body")):
            assert not faint(place), name
    tab.close()


def faint(place) -> dict:
    """Texts that can hardly be read, with their colours."""
    found = place.evaluate(TEXTS)
    found = [each for each in found if not each[0].startswith("WebGL is running in software")]  # viser's
    assert found
    return {text: (colour, ground) for text, colour, ground in found if contrast(colour, ground) < 4.5}


TEXTS = """(root) => {
  const parts = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const over = ([r, g, b, a = 1], under) => [r, g, b].map((v, i) => v * a + under[i] * (1 - a));
  const ground = (e) => {
    const layers = [];
    for (let at = e; at; at = at.parentElement) layers.push(parts(getComputedStyle(at).backgroundColor));
    return layers.reverse().reduce((under, layer) => over(layer, under), [255, 255, 255]);
  };
  const opacity = (e) => (e ? Number(getComputedStyle(e).opacity) * opacity(e.parentElement) : 1);
  const found = [];
  for (const e of root.querySelectorAll("*")) {
    const text = [...e.childNodes].filter((n) => n.nodeType === 3).map((n) => n.data.trim()).join("");
    if (!text || e.closest("[data-disabled], :disabled, style, script, [aria-hidden=true]")) continue;
    if (!e.checkVisibility() || !e.getBoundingClientRect().width) continue;
    const under = ground(e);
    const [r, g, b, a = 1] = parts(getComputedStyle(e).color);
    const colour = over([r, g, b, a * opacity(e)], under);
    found.push([text.slice(0, 40), ...[colour, under].map((each) => `rgb(${each.map(Math.round)})`)]);
  }
  return found;
}"""
"""Of each text in sight below the element: what it says, its colour, and what is under it."""


def contrast(one: str, other: str) -> float:
    """Of two CSS colours, as WCAG 2 defines it."""
    light = sorted((luminance(one), luminance(other)))
    return (light[1] + 0.05) / (light[0] + 0.05)


def luminance(colour: str) -> float:
    parts = [int(v) / 255 for v in re.findall(r"\d+", colour)[:3]]
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
