"""The 3-D view in a real browser: the viewer has nothing to complain of, and a click selects."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr
from ispom_app.engine.playback import Playback
from ispom_app.features.stage.page_message import StageNews
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.state import State, reduce
from ispom_app.views.rerun.batch import Entry
from ispom_app.views.rerun.eye import FOV_RAD
from ispom_app.views.rerun.file_recording import FileRecording
from ispom_app.views.rerun.recorder import Recorder

from ispom.geometry import Similarity
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import build_full
from tests.app.page.test_browser import CHROMIUM, PATIENCE_MS, App, Page, app, browser, launched_on  # noqa: F401 - fixtures
from tests.app.page.test_stage import SEQUENCE, seek, world_share

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
HEAD_PX = 24
"""Height of the views' titles, where the viewer puts a red sign for what it cannot draw."""


def is_complaining(page: Page) -> bool:
    box = page.tab.locator("#canvas").bounding_box()
    assert box is not None
    screen = cv2.imdecode(np.frombuffer(page.tab.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert screen is not None
    x, y = round(box["x"]), round(box["y"])
    blue, green, red = np.moveaxis(screen[y : y + HEAD_PX, x:].astype(int), 2, 0)
    return int(((red > 200) & (green < 60) & (blue < 120)).sum()) > 20


@pytest.fixture
def single(tmp_path: Path) -> Iterator[App]:
    """A recording of one camera whose unit is not the shared one, and which is lost now and then."""
    run = Playback(doubles.sequence(40), ("monocular",), builder=build_full)
    with FileRecording(tmp_path / "run.rrd", run.opened) as file:
        while not run.done:
            file.write(replace(run.step(), placements={"monocular": Similarity(2.5)}))
    found = launched_on(tmp_path / "run.rrd")
    yield found
    found.process.kill()
    found.process.wait()


@pytest.mark.slow
def test_the_viewer_draws_all_of_a_single_camera_also_where_it_is_lost(browser, single: App) -> None:  # noqa: F811
    page = Page(browser, single.url)
    page.tab.locator("#cover").wait_for(state="hidden")
    for index in (30, doubles.LOST_EVERY, 0, 20):
        seek(page, index)
        assert not is_complaining(page), f"at frame {index}"
    assert not page.faults
    page.tab.close()


FRAME = 20
ALONE_PX = 10
"""No other point is so near on the screen to one that is clicked."""
BESIDE_PX = 60
"""Of the middle of the view, where cameras and paths are drawn."""
AGAIN_MS = 5000
"""A click counts for what the viewer last drew under the mouse: it may come too early."""


@pytest.fixture
def drawn() -> tuple[CurrentRun, dict[str, np.ndarray]]:
    """The run that the app plays, and where the points that it draws at a frame are in the shared world, by entity."""
    run, clouds = CurrentRun(Playback(SEQUENCE, METHODS, builder=helpers.build), 10**9), dict[str, np.ndarray]()
    recorder = Recorder(run.opened)
    while len(run.history) <= FRAME:
        for entry in recorder.batch(run.step()[0]).entries:
            if isinstance(entry, Entry) and isinstance(entry.value, rr.Points3D) and entry.value.positions is not None:
                flat = entry.value.positions.as_arrow_array().flatten().to_numpy(zero_copy_only=False)
                clouds[entry.path] = flat.reshape(-1, 3)
    placements = run.history[FRAME].placements
    clouds = {path: xyz for path, xyz in clouds.items() if re.fullmatch(r"world/\w+/\w+/\d+", path)}
    return run, {p: placements.get(p.split("/")[1], Similarity()).apply(xyz) for p, xyz in clouds.items()}


def on_screen(page: Page, eye: list, xyz: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) of points in the 3-D view; NaN for those that are not in sight."""
    box = page.tab.locator("#canvas").bounding_box()
    assert box is not None
    position, target, up = map(np.array, eye)
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    axes = np.stack([right, np.cross(forward, right), forward])
    x, y, z = axes @ (xyz - position).T
    height, width = box["height"] - HEAD_PX, world_share(page) * box["width"]
    at = np.stack([x, y], 1) / z[:, None] * 0.5 * height / np.tan(FOV_RAD / 2)
    in_sight = (z > 0) & (np.abs(at) < 0.5 * np.array([width, height]) - 40).all(1)  # not below the buttons either
    middle = np.array([box["x"] + 0.5 * width, box["y"] + HEAD_PX + 0.5 * height])
    return middle + np.where(in_sight[:, None], at, np.nan)


def test_a_click_on_a_point_selects_its_track(browser, app: App, drawn) -> None:  # noqa: F811
    run, clouds = drawn
    page = Page(browser, app.url)
    page.until("state.ended && !state.playing", "the end")
    page.tab.locator("#cover").wait_for(state="hidden")
    seek(page, FRAME)
    page.tab.get_by_role("button", name="Follow").click()
    state = helpers.with_values(reduce(State("double:40"), run.opened), displayed=run.history[FRAME])
    eye = (StageNews().since(state, run) or {})["follow"]

    names: list[str] = []
    for path, xyz in clouds.items():
        method, block = path.split("/")[1::2]
        ids = run.known_at(FRAME).methods[method].points.blocks[int(block)].ids
        names += [f"track:{method}:{number}" for number in ids[: len(xyz)]]  # it may have grown since it was drawn
    places = np.concatenate(list(clouds.values()))
    pixels = on_screen(page, eye, places)
    middle = on_screen(page, eye, np.array([eye[1]]))[0]
    clicked = 0
    for place, at in zip(places, pixels, strict=True):
        same = np.linalg.norm(places - place, axis=1) < 1e-5
        others = np.linalg.norm(pixels[~same] - at, axis=1)
        if np.isfinite(at).all() and np.nanmin(others) > ALONE_PX and np.linalg.norm(at - middle) > BESIDE_PX:
            click(page, at, [name for name, here in zip(names, same, strict=True) if here])
            clicked += 1
        if clicked == 3:
            break
    assert clicked == 3 and not page.faults
    page.tab.close()


def click(page: Page, at: np.ndarray, wanted: list[str]) -> None:
    """Clicks until one of these is selected."""
    until = time.monotonic() + PATIENCE_MS / 1000
    while page.state["selected"] not in wanted:
        assert time.monotonic() < until, f"{page.state['selected']} is selected, none of {wanted}"
        page.tab.mouse.move(*at)
        page.tab.mouse.click(*at)
        with suppress(AssertionError):
            page.until(f"{wanted}.includes(state.selected)", "the selection", AGAIN_MS)
