"""The bench of loops: what it calls found, how far off it says a method is, and that its houses are alike."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from ispom.geometry import Pose, Similarity
from ispom.simulation.motions import motion_of
from ispom.simulation.places.town import SPEED_M_S, on_route
from ispom.simulation.rendering.renderer import Renderer
from ispom.types import Camera, Trajectory
from tests.accuracy import loops, studies
from tests.accuracy.__main__ import main
from tests.accuracy.loops import BEGIN_M, START_M, Driven, Later, driven
from tests.accuracy.terraces import ALIKE_M, build_terraces


@pytest.mark.parametrize(
    ("closed", "error_m", "found"), [(1, 0.5, True), (1, 0.6, False), (0, 0.1, False), (2, math.nan, False)]
)
def test_a_loop_is_found_where_the_return_is_right(closed: int, error_m: float, found: bool) -> None:
    assert Driven("stereo", 0, True, 541.0, closed, error_m).found is found


def test_what_is_off_is_what_drifted() -> None:
    times = range(0, 100_000_000_000, 1_000_000_000)
    truth = Trajectory.of([(t, on_route(2e-9 * t)) for t in times], "rig")
    elsewhere = truth.moved(left=Pose.from_rotvec(np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, 3.0])))
    assert loops._off(elsewhere, truth, True).max() < 1e-9
    other = Similarity(0.2, elsewhere.pose(3))
    own = Trajectory.of([(t, other.apply_pose(pose)) for t, pose in elsewhere.items()], "rig")
    assert loops._off(own, truth, False).max() < 1e-9
    assert loops._off(own, truth, True)[-1] > 10
    late = [(t, pose @ Pose(translation=np.array([0.0, 0.7 * (2e-9 * t > START_M), 0.0]))) for t, pose in truth.items()]
    assert loops._off(Trajectory.of(late, "rig"), truth, False)[-1] == pytest.approx(0.7)


def test_houses_look_alike_and_the_road_does_not() -> None:
    camera = Camera(80, 60, 60.0, 60.0, 39.5, 29.5)
    renderer = Renderer(build_terraces(1))
    aside = Pose.from_rotvec(np.array([0.0, np.pi / 2, 0.0]), np.array([0.0, -5.0, 56.0]))
    here, on, between = (
        renderer.image(camera, Pose(translation=np.array([0.0, 0.0, by])) @ aside) for by in (0.0, ALIKE_M, ALIKE_M / 2)
    )
    assert np.abs(here - on)[:30].mean() < 2 < 10 < np.abs(here - between)[:30].mean()
    down = Pose.from_rotvec(np.array([-np.pi / 2, 0.0, 0.0]), np.array([0.0, -3.0, 56.0]))
    here, on = (renderer.image(camera, Pose(translation=np.array([0.0, 0.0, by])) @ down) for by in (0.0, ALIKE_M))
    assert np.abs(here - on).mean() > 2


def test_a_drive_is_joined_under_way() -> None:
    motion, by_ns = motion_of("loop", 0), round(BEGIN_M / SPEED_M_S * 1e9)
    assert np.array_equal(Later(motion, by_ns).pose_at(5).matrix, motion.pose_at(by_ns + 5).matrix)


@pytest.mark.slow
@pytest.mark.parametrize("returns", [True, False])
def test_both_methods_drive(returns: bool) -> None:
    one, pair = driven(0, returns, ("monocular", "stereo"), lap=0.03)
    for found in (one, pair):
        assert found.closed == 0 and not found.found and found.error_m < 0.3
        assert 10 < found.way_m < 20
        assert (found.plain_error_m == found.error_m and found.spread == 1.0) if returns else found.plain_nees is None


def test_the_study_covers_both_methods(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def measured_elsewhere(module: str, task: dict) -> object:
        assert module == "loops"
        if task["seed"] == 1:
            return {"error": "it broke"}
        more = (2.0, 5.0, math.nan) if task["returns"] else ()
        return [asdict(Driven(m, task["seed"], task["returns"], 541.0, 1, 0.3, 0, *more)) for m in task["methods"]]

    monkeypatch.setattr(studies, "found", measured_elsewhere)
    assert main(["loops", "--seeds", "2", "--json", str(tmp_path / "l.json")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "seed 1 of 2: " in printed
    for method in ("monocular", "stereo"):
        assert f"{method}: found, and within 0.1% of the way at the return, in 1 of 1, worst 0.055 %" in printed
        assert f"{method}: loops where houses are alike and nothing returns: 1" in printed
    rows = json.loads((tmp_path / "l.json").read_text())
    assert [r["spread"] for r in rows] == [None] * 4, "JSON has no word for a number that is not finite"
