"""The funnel: a count for each stage that is known, and the stage that limits the inliers with its reason."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.history.series import Series
from ispom_app.features.funnel.view import FunnelView, MethodFunnel, funnel
from ispom_app.session.state import State

from ispom.estimators.modern.monocular import checks
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.methods import Config
from ispom.types import Status, Step, Tracks, TrackStatus

ALIVE, NEW, LOST, OFF = TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.LOST, TrackStatus.REPROJECTION


def step(statuses: list[TrackStatus], with_point: int = 0, inliers: int = 0) -> Step:
    """Of tracks with these statuses, the first ones with a point."""
    count = len(statuses)
    residuals = np.where(np.arange(count) < with_point, 0.3, np.nan)
    tracks = Tracks.of(np.arange(count), np.zeros((count, 2)), status=np.array(statuses), residual_px=residuals)
    decision = checks.POSE_POINTS.of(inliers, 15)
    return Step(
        0, Status.TRACKING, "video", tracks={"video": tracks}, residuals_px=np.full(inliers, 0.3),
        decisions=(decision,), method="monocular",
    )  # fmt: skip


def shown(*steps: Step, max_tracks: int = 50, earlier: tuple[Any, ...] = (), thinned: bool = False) -> FunnelView:
    """At the last of these steps."""
    series = Series(("monocular",))
    records = [ExposureRecord(i, i, "video", (each,), {}, {}, {}) for i, each in enumerate(steps)]
    for record in records:
        series.append(record)
    config = Config({"monocular": ModernMonocularConfig(max_tracks=max_tracks)})
    run: Any = SimpleNamespace(series=series, history=records, playback=SimpleNamespace(earlier=earlier, config=config))
    last = records[-1]
    if thinned:
        last = ExposureRecord(last.index, 0, "video", (Step(0, Status.TRACKING, method="monocular"),), {}, {}, {})
    return funnel(State("double:9", methods=("monocular",), displayed=last), run, last.index)


def counts(of: MethodFunnel) -> dict[str, int]:
    return {stage.name: stage.count for stage in of.stages}


def limiting(of: MethodFunnel) -> tuple[str, str]:
    ((name, why),) = [(stage.name, stage.why) for stage in of.stages if stage.limits]
    return name, why


def test_the_cap_of_the_planted_fault_limits() -> None:
    (found,) = shown(step([NEW] * 50), step([ALIVE] * 45 + [LOST] * 5, with_point=44, inliers=40)).methods
    assert counts(found) == {"detected": 50, "tracked": 45, "with depth": 44, "inliers": 40}
    name, why = limiting(found)
    assert name == "detected" and "max-tracks" in why and "50" in why


def test_the_stage_that_keeps_the_smallest_share_limits() -> None:
    (lost,) = shown(step([NEW] * 50), step([ALIVE] * 20 + [LOST] * 30, with_point=20, inliers=18)).methods
    assert limiting(lost)[0] == "tracked" and "30" in limiting(lost)[1]
    (flat,) = shown(step([NEW] * 50), step([ALIVE] * 48, with_point=10, inliers=10)).methods
    assert limiting(flat)[0] == "with depth"
    (odd,) = shown(step([NEW] * 50), step([ALIVE] * 14 + [OFF] * 34, with_point=48, inliers=14)).methods
    assert counts(odd)["tracked"] == 48, "what was rejected later was tracked"
    assert limiting(odd)[0] == "inliers" and "15" in limiting(odd)[1]


def test_before_there_is_a_map_the_detection_or_the_tracking_limits() -> None:
    waiting = replace(step([ALIVE] * 47), status=Status.INITIALISING)
    (found,) = shown(step([NEW] * 50), waiting).methods
    assert counts(found)["with depth"] == 0 and limiting(found)[0] == "detected" and "50" in limiting(found)[1]


def test_the_detection_is_the_last_one_before_the_frame() -> None:
    steps = step([NEW] * 50), step([ALIVE] * 40 + [NEW] * 8), step([ALIVE] * 44 + [NEW] * 6, 44, 44)
    (found,) = shown(*steps).methods
    assert counts(found)["detected"] == 48


def test_between_two_frames_of_a_method_its_newest_one_is_shown() -> None:
    between = Step(0, Status.TRACKING, method="stereo")
    (found,) = shown(step([NEW] * 50), step([ALIVE] * 45, 44, 40), between).methods
    assert (found.frame, counts(found)["inliers"]) == (1, 40)


def test_a_frame_before_a_fork_has_the_settings_of_then() -> None:
    stage = SimpleNamespace(until=9, config=Config({"monocular": ModernMonocularConfig(max_tracks=60)}))
    (found,) = shown(step([NEW] * 60), step([ALIVE] * 60, 60, 60), max_tracks=500, earlier=(stage,)).methods
    assert "60" in limiting(found)[1]


def test_what_is_not_known_is_left_out() -> None:
    assert shown(step([NEW] * 50)).methods == (), "nothing was detected before"
    (found,) = shown(step([NEW] * 50), step([ALIVE] * 45, 44, 40), thinned=True).methods
    assert counts(found) == {"detected": 50, "tracked": 45, "inliers": 40}
    assert funnel(State("double:9"), None, 3) == FunnelView(())
