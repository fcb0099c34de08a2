"""What the Rerun views draw is the frame that the page shows: screenshots are compared with the frames' images."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from ispom_app.engine.playback import Playback
from ispom_app.views.rerun.file_recording import FileRecording

from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.page.drawn import SAME, View, image_of, screen_of
from tests.app.page.test_browser import (  # noqa: F401 - fixtures
    CHROMIUM,
    PATIENCE_MS,
    TOTAL,
    App,
    Page,
    app,
    browser,
    launched_on,
)

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
SEQUENCE = doubles.sequence(40)
VIDEO, STEREO = ([i for i, kind in enumerate(SEQUENCE.kinds) if kind == each] for each in ("video", "stereo"))
SHOWN = """(() => {
  const { shown, unread } = window.ispom.viewer.stage;
  return [shown.recording, shown.index, unread.find(({ index }) => index >= 0)?.index ?? shown.index].join(" ");
})()"""
"""The recording and frame that the views show, and the frame that they are taking in."""
SHORT_OF_MEMORY = """
const start = WebViewer.prototype.start;
WebViewer.prototype.start = function (rrd, parent, options) {
  return start.call(this, rrd, parent, { ...options, memory_limit: "1MB" });
};
"""


def image(frame: int) -> np.ndarray:
    return image_of(SEQUENCE[frame])


def on_the_stage(page: Page, frame: int) -> None:
    """The views show this frame, as the page says."""
    page.until(
        f"window.ispom.viewer.stage?.shown?.index === {frame} && window.ispom.viewer.stage.shown.complete",
        f"frame {frame} in the views",
    )


def seek(page: Page, frame: int) -> None:
    page.send(f"{{do: 'seek', index: {frame}}}")
    page.until(f"state.index === {frame} && !state.playing", "the seek")
    on_the_stage(page, frame)


TABS_PX = {"video": 40, "left": 105}
"""Where the tabs of the image are, from its left edge."""


def world_share(page: Page) -> float:
    """Of the 3-D view, in the width of the stage."""
    assert not page.tab.evaluate("window.ispom.viewer.eye.division.below")
    return page.tab.evaluate("window.ispom.viewer.eye.division.world")


def turn(page: Page, camera: str) -> None:
    """Shows the image of this camera, by a click on its tab."""
    box = page.tab.locator("#canvas").bounding_box()
    assert box is not None
    page.tab.mouse.click(box["x"] + world_share(page) * box["width"] + TABS_PX[camera], box["y"] + 12)


class Stage(Page):
    """A page, and where its image views are: it is high, for small views show a frame's neighbours nearly as well."""

    def __init__(self, *args, **kwargs) -> None:
        super().__init__(*args, **kwargs)
        self.resize(1280, 884)

    def views(self) -> dict[str, View]:
        seek(self, 30)
        return {"left": self._view("left", newest(STEREO, 30)), "video": self._view("video", 30)}

    def _view(self, camera: str, frame: int) -> View:
        until = time.monotonic() + PATIENCE_MS / 1000
        while True:
            turn(self, camera)
            screen = screen_of(self.tab)  # views find their sizes a frame or two after the first
            try:
                return View.find(screen, image(frame), self.tab.locator("#at-image").bounding_box()["width"])
            except AssertionError:
                assert time.monotonic() < until, f"timed out waiting for the image of {camera}"


def newest(frames: list[int], index: int) -> int:
    return max(frame for frame in frames if frame <= index)


def assert_drawn(page: Page, views: dict[str, View], index: int) -> None:
    """Both cameras' images are those of the frame, and more like them than like any other."""
    seek(page, index)
    for camera, frames in (("video", VIDEO), ("left", STEREO), ("video", VIDEO)):
        until, score = time.monotonic() + PATIENCE_MS / 1000, 0.0
        while score <= SAME:  # a tab turns with the viewer's next frame
            turn(page, camera)
            found, score = views[camera].frame(screen_of(page.tab), image, frames)
            assert time.monotonic() < until, f"timed out waiting for the image of {camera}"
        assert found == newest(frames, index), f"{camera} at {index}: {score:.2f}"
    assert page.tab.locator("#shown").is_hidden()


@pytest.fixture(scope="module")
def stage(browser, app: App) -> Iterator[Stage]:  # noqa: F811
    """Its viewer discards all that Rerun lets it discard."""
    page = Stage(browser, app.url, after_viewer=SHORT_OF_MEMORY)
    page.until("state.ended && !state.playing", "the end")
    page.tab.locator("#cover").wait_for(state="hidden")
    yield page
    assert not page.faults
    page.tab.close()


@pytest.fixture(scope="module")
def views(stage: Stage) -> dict[str, View]:
    return stage.views()


SLOW = (pytest.param(index, marks=pytest.mark.slow) for index in (34, 5, 22))


@pytest.mark.parametrize("index", [43, 12, 1, *SLOW])
def test_any_exposure_is_drawn_when_it_is_sought_however_little_memory_the_viewer_has(stage, views, index):
    assert_drawn(stage, views, index)


@pytest.mark.slow
def test_after_a_loop_the_images_are_still_those_of_their_exposures(stage: Stage, views):
    seek(stage, 10)
    stage.send("action('loop_start')")
    seek(stage, 20)
    stage.send("action('loop_end')")
    stage.send("action('play')")
    for _ in range(3):
        stage.until("state.index > 16", "the loop's end")
        stage.until("state.index < 14", "the loop's beginning")
    stage.send("{do: 'pause'}")
    stage.send("action('no_loop')")
    stage.until("!state.playing", "a pause")
    assert_drawn(stage, views, 33)
    assert_drawn(stage, views, 15)


def assert_named(stage: Stage, views: dict[str, View]) -> str:
    """What is drawn is what the views were said to show before the screenshot or after it, which is returned."""
    before, screen, after = stage.tab.evaluate(SHOWN), screen_of(stage.tab), stage.tab.evaluate(SHOWN)
    indices = [int(index) for each in (before, after) for index in each.split()[1:]]
    found, score = views["video"].frame(screen, image, VIDEO)
    named = {newest(VIDEO, index) for index in range(min(indices), max(indices) + 1)}
    assert found in named and score > SAME, f"{found} is drawn ({score:.2f}), named are {before} and {after}"
    return after


def test_while_it_plays_each_image_is_that_of_the_exposure_which_the_views_name(stage: Stage, views):
    """The views leave out frames where they are slow, and never show one under the name of another."""
    seek(stage, 0)
    stage.send("action('play')")
    until = time.monotonic() + PATIENCE_MS / 1000
    while not assert_named(stage, views).endswith(f" {TOTAL - 1}"):
        assert time.monotonic() < until, "timed out waiting for the end"
    assert stage.state["index"] == TOTAL - 1


@pytest.mark.slow
def test_a_fork_leaves_its_parent_visible_until_it_has_something_to_show(stage: Stage, views):
    seek(stage, 20)
    parent = stage.state["recording_id"]
    stage.controls.get_by_role("tab", name="Methods").click()
    stage.controls.get_by_role("button", name="Fork").click()
    until = time.monotonic() + PATIENCE_MS / 1000
    while parent in assert_named(stage, views):
        assert time.monotonic() < until, "timed out waiting for the branch"
    stage.until("state.ended && !state.playing", "the end of the branch")
    assert_drawn(stage, views, 12)


@pytest.mark.slow
def test_any_exposure_of_a_finished_recording_is_drawn(browser, tmp_path: Path):  # noqa: F811
    run = Playback(SEQUENCE, METHODS, builder=helpers.build)
    with FileRecording(tmp_path / "run.rrd", run.opened) as file:
        while not run.done:
            file.write(run.step())
        file.write(run.finish())
    app = launched_on(tmp_path / "run.rrd")  # noqa: F811
    try:
        page = Stage(browser, app.url, after_viewer=SHORT_OF_MEMORY)
        page.tab.locator("#cover").wait_for(state="hidden")
        views = page.views()
        for index in (34, 12, 5, TOTAL - 1):
            assert_drawn(page, views, index)
        assert not page.faults
        page.tab.close()
    finally:
        app.process.kill()
        app.process.wait()
