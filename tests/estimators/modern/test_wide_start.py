"""The first map of one camera where steps are too wide for a tracker."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.monocular import initialise
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.geometry import Pose
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.places.town import build_town, on_route
from ispom.simulation.rendering.renderer import Renderer, exposed
from ispom.simulation.source import NOISE_SIGMA
from ispom.types import Frame, Status, Step
from tests.alone import run

APART_M, COUNT = 11.0, 6


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    """Of a drive through the town, 11 m apart: what is near moves by a fifth of the image, and grows."""
    rig, renderer = simulated_rig(0.5), Renderer(build_town(0))
    camera, found = rig.camera("video"), []
    for i in range(COUNT):
        pose = on_route(20.0 + APART_M * i) @ Pose(translation=np.array([0.0, -1.75, 0.0]))
        image = exposed(renderer.image(camera, pose @ rig.rig_from("video"), 1), i, NOISE_SIGMA)
        found.append(Frame.video(i * 1_000_000_000, image))
    return found


def stepped(frames: list[Frame]) -> list[Step]:
    return list(run(ModernMonocularConfig().build(simulated_rig(0.5)), frames))


def test_features_begin_the_map_where_the_tracker_loses_its_points(
    frames: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = stepped(frames)
    assert all(s.status is Status.TRACKING for s in steps[1:])
    places = np.array([s.world_from_frame.translation for s in steps if s.world_from_frame is not None])
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    np.testing.assert_allclose(lengths, np.median(lengths), rtol=0.05)
    monkeypatch.setattr(initialise, "with_matched_features", lambda setup, state, new: (state, new))
    assert not any(s.status is Status.TRACKING for s in stepped(frames[:3])), "the tracker alone does not"


def test_where_the_tracker_follows_the_points_no_feature_is_looked_for(frames: list[Frame]) -> None:
    estimator = ModernMonocularConfig().build(simulated_rig(0.5))
    state, first = estimator.step(estimator.start(), frames[0])
    again = Frame.video(frames[1].time_ns, frames[0].image)
    _, still = estimator.step(state, again)
    assert set(still.tracks["video"].ids) == set(first.tracks["video"].ids)
