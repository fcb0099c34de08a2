"""The 3-D view in a real browser: the viewer has nothing to complain of, and a click selects."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.engine.playback import Playback
from ispom_app.views.rerun.file_recording import FileRecording

from ispom.geometry import Similarity
from tests import doubles
from tests.app.page.test_browser import CHROMIUM, App, Page, browser, launched_on  # noqa: F401 - a fixture
from tests.app.page.test_stage import seek

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
    run = Playback(
        doubles.sequence(40),
        ("monocular",),
        builder=lambda config, methods, rig: doubles.ensemble(methods, doubles.FullEstimator),
    )
    with FileRecording(tmp_path / "run.rrd", run.opened) as file:
        while not run.done:
            file.write(replace(run.step(), placements={"monocular": Similarity(2.5)}))
    found = launched_on(tmp_path / "run.rrd")
    yield found
    found.process.kill()
    found.process.wait()


def test_the_viewer_draws_all_of_a_single_camera_also_where_it_is_lost(browser, single: App) -> None:  # noqa: F811
    page = Page(browser, single.url)
    page.tab.locator("#cover").wait_for(state="hidden")
    for index in (30, doubles.LOST_EVERY, 0, 20):
        seek(page, index)
        assert not is_complaining(page), f"at frame {index}"
    assert not page.faults
    page.tab.close()
