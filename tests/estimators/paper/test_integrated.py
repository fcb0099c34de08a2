"""The paper's integration on made Steps of the methods that it asks."""

from __future__ import annotations

import numpy as np

from ispom.estimators.paper.integrated import MAX_FRAMES, IntegratedConfig, IntegratedState
from ispom.solvers.trajectory.stages import stages
from ispom.types import Camera, Frame, Rig, Status, Step
from tests.doubles import pose_at

SECOND_NS = 1_000_000_000
UNIT_M = 0.5
NOTHING = np.zeros((120, 160), np.uint8)


def rig() -> Rig:
    camera = Camera(160, 120, 120.0, 120.0, 79.5, 59.5)
    return Rig.stereo(camera, 0.4).changed(video=camera)


def video(time_ns: int) -> tuple[Frame, dict[str, Step]]:
    pose = pose_at(time_ns).scaled(1 / UNIT_M)
    final_ns = time_ns - SECOND_NS
    return Frame.video(time_ns, NOTHING), {
        "video": Step(time_ns, Status.TRACKING, "video", pose, method="m", final_until_ns=final_ns)
    }


def pair(time_ns: int) -> tuple[Frame, dict[str, Step]]:
    return Frame.stereo(time_ns, NOTHING, NOTHING), {
        "stereo": Step(time_ns, Status.TRACKING, "rig", pose_at(time_ns), method="s")
    }


def walked(video_ns: list[int], pairs_ns: list[int]) -> tuple[IntegratedState, list[Step]]:
    estimator = IntegratedConfig().build(rig())
    given = sorted([*map(video, video_ns), *map(pair, pairs_ns)], key=lambda g: (g[0].time_ns, "video" in g[1]))
    state, steps = estimator.start(), []
    for exposure, inputs in given:
        state, step = estimator.step(state, exposure, inputs)
        steps.append(step)
    return state, steps


def test_video_below_five_hertz_keeps_its_pose_before_a_segment() -> None:
    every_ns = SECOND_NS // 3
    state, steps = walked([50_000_000 + i * every_ns for i in range(30)], [i * SECOND_NS for i in range(1, 9)])
    closed = [d for s in steps for d in s.decisions]
    assert closed and not any(d.failed for d in closed)
    found = IntegratedConfig().build(rig()).finish(state, {})
    errors = [np.linalg.norm(p.translation - pose_at(t).translation) for t, p in found.items()]
    assert len(errors) > 15 and max(errors) < 0.02


def test_where_pairs_stop_the_newest_frames_stay_and_live_poses_go_on() -> None:
    every_ns = SECOND_NS // 30
    state, steps = walked([i * every_ns for i in range(3 * MAX_FRAMES)], [i * SECOND_NS // 3 for i in range(1, 8)])
    assert len(state.frames_ns) < 1.2 * MAX_FRAMES and len(state.video) < 1.2 * MAX_FRAMES
    last = steps[-1]
    assert last.world_from_frame is not None and [d.key for d in last.decisions] == ["open_frames"]
    assert np.linalg.norm(last.world_from_frame.translation - pose_at(last.time_ns).translation) < 0.05


def test_a_step_reports_how_each_of_its_segments_was_fitted() -> None:
    every_ns = SECOND_NS // 10
    _, steps = walked([50_000_000 + i * every_ns for i in range(60)], [i * SECOND_NS for i in range(1, 6)])
    closing = [step for step in steps if len(step.revised)]
    assert len(closing) == 3 and all(len(step.segments) == 1 for step in closing)
    assert not any(step.segments for step in steps if not len(step.revised))
    for step in closing:
        (fit,) = step.segments
        assert fit.scale == step.scale and abs((fit.scale or 0.0) - UNIT_M) < 0.01
        assert fit.video.times_ns[0] < fit.span_ns[0] and fit.video.times_ns[-1] > fit.span_ns[1]
        last = stages(fit)[-1].poses.moved(right=rig().rig_from_video.inverse(), frame="rig")
        np.testing.assert_allclose(last.translations, step.revised.translations, atol=1e-9)
        np.testing.assert_allclose(last.rotations, step.revised.rotations, atol=1e-9)
