"""viser's scene: the run as it was known at the exposure shown, and only what changed is sent again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import viser
from ispom_app.engine.events import Opened
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.model.run_model import RunModel
from ispom_app.engine.playback import Playback
from ispom_app.views.viser.scene import Scene
from numpy.testing import assert_allclose

from ispom.geometry import Pose, Similarity
from tests import doubles
from tests.alone import METHODS

N = 150


class Spy:
    """viser's scene, and what was sent of each node."""

    def __init__(self, api: viser.SceneApi) -> None:
        self._api, self.sent, self.handles = api, Counter[str](), dict[str, Any]()

    def __getattr__(self, name: str) -> Callable[..., Any]:
        real = getattr(self._api, name)

        def call(*arguments: Any, **named: Any) -> Any:
            found = real(*arguments, **named)
            if name.startswith("add_"):
                self.sent[arguments[0]] += 1
                self.handles[arguments[0]] = found
            if name == "remove_by_name":
                self.handles.pop(arguments[0], None)
            return found

        return call


@pytest.fixture(scope="module")
def run() -> tuple[Opened, list[ExposureRecord], list[RunModel]]:
    """With records and models after each exposure."""
    playback = Playback(
        doubles.sequence(N),
        METHODS,
        builder=lambda config, methods, rig: doubles.ensemble(methods, doubles.FullEstimator),
    )
    records, models = list[ExposureRecord](), [RunModel.start(METHODS)]
    while not playback.done:
        records.append(ExposureRecord.of(playback.step(), records[-1] if records else None))
        models.append(models[-1].after(records[-1].index, records[-1].time_ns, records[-1].steps))
    return playback.opened, records, models[1:]


@pytest.fixture
def spy(server: viser.ViserServer) -> Spy:
    return Spy(server.scene)


@pytest.fixture
def scene(spy: Spy, run) -> Scene:
    scene = Scene(spy, lambda _: None)  # type: ignore[arg-type]
    scene.start(run[0])
    return scene


def heights(spy: Spy, method: str) -> list[float]:
    """How often each pose that the method's path shows was revised."""
    lines = [spy.handles[name] for name in sorted(spy.handles) if name.startswith(f"/{method}/path/")]
    points = np.concatenate([lines[0].points[:1, 0], *(line.points[:, 1] for line in lines)])
    stamps = points[:, 2] / 2.0
    level = 0.05 * np.sin(3 * stamps)
    return np.rint(points[:, 1] - level).astype(int).tolist()


def test_the_past_shows_poses_as_known_then(scene: Scene, spy: Spy, run) -> None:
    _, records, models = run
    scene.show(models[-1], records[-1], frozenset())
    at = next(
        r.index for r in reversed(records[:60]) if r.kind == "stereo" and r.statuses["stereo"].status == "tracking"
    )
    scene.show(models[-1].as_known_at(at, lambda i: records[i].steps), records[at], frozenset())
    past = heights(spy, "stereo")
    assert past[-1] == 0 and past[-2] == 1 and past[-3] == 2 and len(past) < 10
    (line,) = models[at].methods["stereo"].poses.lines(0)
    assert_allclose(spy.handles["/stereo/camera"].position, line[-1], atol=1e-6)


def test_an_exposure_sends_what_it_changed(scene: Scene, spy: Spy, run) -> None:
    _, records, models = run
    for record, model in zip(records, models, strict=True):
        spy.sent.clear()
        scene.show(model, record, frozenset())
        for method in METHODS:
            again = Counter(name.split("/")[2] for name in spy.sent if name.startswith(f"/{method}/"))
            assert again["path"] <= 2 and again["key_frames"] <= 2 and again["cloud"] <= 2
    spy.sent.clear()
    scene.show(models[-1], records[-1], frozenset())
    assert not {name for name in spy.sent if not name.endswith("/uncertainty")}


def test_hidden_layers_are_not_there_and_come_back(scene: Scene, spy: Spy, run) -> None:
    _, records, models = run
    hidden = frozenset({"clouds", "key_frames", "uncertainty", "cameras", "truth", "stereo"})
    scene.show(models[-1], records[-1], frozenset())
    everything = set(spy.handles)
    scene.show(models[-1], records[-1], hidden)
    assert not any(f"/{layer}" in name for name in spy.handles for layer in ("cloud", "key_frames", "uncertainty"))
    assert not spy.handles["/monocular/camera"].visible and spy.handles["/monocular"].visible
    assert not spy.handles["/stereo"].visible and not spy.handles["/truth"].visible
    scene.show(models[-1], records[-1], frozenset())
    assert set(spy.handles) == everything and spy.handles["/monocular/camera"].visible


def test_before_the_first_pose_there_is_no_camera(scene: Scene, spy: Spy, run) -> None:
    _, records, _ = run
    scene.show(RunModel.start(METHODS), records[0], frozenset())
    assert "/stereo/camera" not in spy.handles and not any("/path/" in name for name in spy.handles)


def test_a_new_placement_moves_all_that_was_drawn(scene: Scene, spy: Spy, run) -> None:
    _, records, models = run
    scene.show(models[-1], records[-1], frozenset())
    before = spy.handles["/monocular/path/0"].points.copy()
    moved = Similarity(2.0, Pose(translation=np.array([0.0, 0, 100.0])))
    scene.show(models[-1], replace(records[-1], placements={"monocular": moved}), frozenset())
    own = records[-1].placements["monocular"]
    back = (before - own.pose.translation) @ own.pose.rotation / own.scale
    assert_allclose(spy.handles["/monocular/path/0"].points, 2 * back + [0, 0, 100.0], atol=1e-3)


def test_a_click_on_a_key_frame_goes_to_its_exposure(spy: Spy, run) -> None:
    opened, records, models = run
    asked = list[int]()
    scene = Scene(spy, asked.append)  # type: ignore[arg-type]
    scene.start(opened)
    scene.show(models[-1], records[-1], frozenset())
    handle = spy.handles["/stereo/key_frames/0"]
    keys = [r.index for r in records for s in r.steps if s.method == "stereo" and s.key_frame]
    for click in handle._impl.click_cb or []:
        getattr(click, "callback", click)(type("Event", (), {"instance_index": 1}))
    assert asked == [keys[1]]
