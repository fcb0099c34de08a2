"""The unit of a monocular trajectory: found once, and nothing is computed while there is no segment to find it from."""

from __future__ import annotations

import numpy as np
import pytest
from ispom_app.engine.model import placing
from ispom_app.engine.model.placing import Placing

from ispom.evaluation.scale import first_segment_placement
from ispom.geometry import Pose
from ispom.types import Trajectory
from tests import doubles

STEP_NS = 33_000_000


def video(count: int, speed: float = 0.5) -> list[Trajectory]:
    """One pose at a time, in a unit of two metres a metre."""
    place = [speed * np.array([np.sin(i / 9), 0.0, i / 9]) for i in range(count)]
    return [Trajectory.of([(i * STEP_NS, Pose(translation=xyz))], "video") for i, xyz in enumerate(place)]


def test_the_first_segment_fixes_it_as_over_the_whole_trajectory() -> None:
    rig, poses = doubles.rig(), video(40)
    pairs = [(i * 10 * STEP_NS + 1, Pose(translation=np.array([0.0, 0, float(i)]))) for i in range(4)]
    found, seen, at = Placing(rig), list[Trajectory](), None
    for i, pose in enumerate(poses):
        for time_ns, stereo in pairs:
            if (i - 1) * STEP_NS < time_ns <= i * STEP_NS:
                found.add_metric(time_ns, stereo)
        found.add_video(pose)
        seen.append(pose)
        if (at := found.found()) is not None:
            break
    whole = Trajectory.of([item for pose in seen for item in pose.items()], "video")
    wanted = first_segment_placement(whole, Trajectory.of(pairs), rig)
    assert at is not None and wanted is not None and len(seen) == 12
    assert at.scale == wanted.scale and np.array_equal(at.pose.matrix, wanted.pose.matrix)


def test_without_a_second_pair_no_exposure_costs_more_than_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(placing, "first_segment_placement", lambda *_: pytest.fail("there is no segment"))
    found = Placing(doubles.rig())
    found.add_metric(STEP_NS, Pose())
    for pose in video(500):
        found.add_video(pose)
        assert found.found() is None


def test_at_rest_what_is_tried_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []

    def measured(moving: Trajectory, metric: Trajectory, rig, scale) -> None:
        tried.append(len(moving))

    monkeypatch.setattr(placing, "first_segment_placement", measured)
    found = Placing(doubles.rig())
    for i, pose in enumerate(video(600, speed=0.0)):
        if i % 10 == 0:
            found.add_metric(i * STEP_NS + 1, Pose())
        found.add_video(pose)
        found.found()
    assert len(tried) > 50 and max(tried) <= 25
