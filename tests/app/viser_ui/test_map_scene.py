"""The map in viser's scene: sent when it is wanted first, with its layer and its method."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import viser
from ispom_app.engine.run_folder.made_map import MadeMap
from ispom_app.features.mapping.scene import MapScene

from ispom.io.meshes import glb_bytes
from tests.app.viser_ui.test_scene import Spy


@pytest.fixture
def made(tmp_path: Path) -> MadeMap:
    xyz, rgb = np.eye(3), np.full((3, 3), 99, np.uint8)
    (tmp_path / "preview.glb").write_bytes(glb_bytes(xyz, xyz, rgb, np.array([[0, 1, 2]], np.int32)))
    return MadeMap("stereo", tmp_path / "preview.glb", tmp_path / "map.rrd")


def test_it_is_sent_once_when_it_is_wanted(server: viser.ViserServer, made: MadeMap) -> None:
    spy = Spy(server.scene)
    scene = MapScene(spy, made)  # type: ignore[arg-type]
    for hidden, visible in (({"map"}, None), (set(), True), ({"stereo"}, False), ({"clouds"}, True), ({"map"}, False)):
        scene.show(frozenset(hidden))
        handle = spy.handles.get("/stereo/map")
        assert (handle.visible if handle is not None else None) == visible
    assert spy.sent["/stereo/map"] == 1
    np.testing.assert_allclose(np.abs(spy.handles["/stereo/map"].wxyz), [0, 1, 0, 0], atol=1e-9)


def test_a_run_without_one_has_none(server: viser.ViserServer, made: MadeMap) -> None:
    spy = Spy(server.scene)
    MapScene(spy, None).show(frozenset())  # type: ignore[arg-type]
    made.preview.unlink()
    gone = MapScene(spy, made)  # type: ignore[arg-type]
    for _ in range(2):
        gone.show(frozenset())
    assert not spy.sent
