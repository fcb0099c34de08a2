"""Other programs' trajectories in viser's scene: up to the exposure shown, and only what changed is sent again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import viser
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.model.run_model import RunModel
from ispom_app.engine.playback import Playback, truth_from_start
from ispom_app.views.viser import beside_scene
from ispom_app.views.viser.beside_scene import BesideScene
from numpy.testing import assert_allclose

from ispom.types import Trajectory
from tests import doubles
from tests.app import helpers
from tests.app.run.beside.made import beside, elsewhere, written
from tests.app.viser_ui.test_scene import Spy

SEQUENCE = doubles.sequence(60)
TRUTH = truth_from_start(SEQUENCE) or Trajectory.empty()
NONE: frozenset[str] = frozenset()


@pytest.fixture
def drawn(server: viser.ViserServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(beside_scene, "POSES_PER_LINE", 20)
    half = elsewhere(SEQUENCE).select(np.arange(40))
    found = beside(SEQUENCE, written(tmp_path / "a.tum", half))
    playback = Playback(SEQUENCE, ("stereo",), builder=helpers.build, beside=(found,))
    records = list[ExposureRecord]()
    while not playback.done:
        records.append(ExposureRecord.of(playback.step(), records[-1] if records else None))
    spy = Spy(server.scene)
    return BesideScene(spy, playback.opened), spy, records, RunModel.start(("stereo",))  # type: ignore[arg-type]


def test_only_what_lies_up_to_the_time_is_drawn_with_the_rig_at_the_exposure(drawn) -> None:
    scene, spy, records, model = drawn
    scene.show(model, records[25], NONE)
    lines = [handle for name, handle in spy.handles.items() if "/path/" in name]
    assert sum(len(line.points) for line in lines) == 25, "26 poses, joined"
    camera = spy.handles["/beside/orb/camera"]
    assert_allclose(camera.position, TRUTH.translations[25], atol=1e-5)
    assert_allclose(lines[-1].points[-1, 1], camera.position, atol=1e-5)


def test_the_next_exposure_sends_the_last_line_only(drawn) -> None:
    scene, spy, records, model = drawn
    scene.show(model, records[25], NONE)
    spy.sent.clear()
    scene.show(model, records[26], NONE)
    scene.show(model, records[26], NONE)
    assert dict(spy.sent) == {"/beside/orb/path/20": 1}


def test_back_in_time_later_lines_are_gone_and_beyond_its_end_the_camera(drawn) -> None:
    scene, spy, records, model = drawn
    scene.show(model, records[30], NONE)
    scene.show(model, records[50], NONE)
    assert not spy.handles["/beside/orb/camera"].visible
    scene.show(model, records[5], NONE)
    assert [name for name in spy.handles if "/path/" in name] == ["/beside/orb/path/0"]
    assert spy.handles["/beside/orb/camera"].visible


def test_it_can_be_hidden(drawn) -> None:
    scene, spy, records, model = drawn
    scene.show(model, records[25], NONE)
    scene.show(model, records[25], frozenset({"beside"}))
    assert not [name for name in spy.handles if "/path/" in name] and not spy.handles["/beside/orb/camera"].visible
