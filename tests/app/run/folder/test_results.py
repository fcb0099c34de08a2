"""What a run says it found: poses of a map, held ones, and stretches that nothing joins."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from ispom_app.engine.run_folder.results import Results, metrics_text, summary, trajectory_files
from ispom_app.engine.run_folder.run_folder import RunFolder
from ispom_app.engine.run_folder.statistics import RunStatistics

from ispom.geometry import Pose
from ispom.types import Camera, Rig, Status, Trajectory

COUNT, FROM = 40, 20
RIG = Rig.single(Camera(640, 480, 500, 500, 320, 240))


def way(shift: float) -> Trajectory:
    """Along a curve; from FROM on displaced, as after a blind start."""
    at = [np.array([0.1 * i, 0.002 * i * i, 0.02 * (i % 3) + shift * (i >= FROM)]) for i in range(COUNT)]
    return Trajectory.of([(i, Pose(np.eye(3), t)) for i, t in enumerate(at)], "video")


def told(status: Status, restarted: bool) -> dict[str, Any]:
    statistics = RunStatistics()
    for i in range(COUNT):
        statistics.count("monocular", i, 5.0, status, restarted and i == FROM)
    truth = Trajectory(way(0).times_ns, way(0).rotations, way(0).translations, "rig")
    results = Results("made", (), RIG, truth, COUNT, {"monocular": way(2.0 * restarted)})
    return json.loads(metrics_text(results, ["monocular"], statistics))


def test_predicted_poses_are_not_called_located() -> None:
    report = told(Status.INITIALISING, restarted=False)
    assert report["methods"]["monocular"]["located"] == 0
    assert "its 40 poses" in summary(report) and "lost" not in summary(report)
    again = told(Status.INITIALISING, restarted=True)
    assert "segments" not in again["methods"]["monocular"], "held poses are no stretch that nothing joins"


def test_a_stretch_that_nothing_joins_is_measured_by_itself() -> None:
    report = told(Status.TRACKING, restarted=True)
    segments = report["methods"]["monocular"]["segments"]
    assert [(s["from_ns"], s["until_ns"], s["poses"]) for s in segments] == [(0, 19, 20), (20, 39, 20)]
    assert all(s["ate_m"] < 1e-9 for s in segments) and report["methods"]["monocular"]["ate_m"] > 0.1
    assert "2 segments" in summary(report)
    assert "segments" not in told(Status.TRACKING, restarted=False)["methods"]["monocular"]


def test_a_segment_found_to_be_of_an_earlier_ones_world_is_one_with_it() -> None:
    statistics = RunStatistics()
    for i in range(COUNT):
        statistics.count("monocular", i, 5.0, Status.TRACKING, i in (10, FROM), 0 if i == FROM else None)
    assert statistics.segments("monocular") == [(0, 0), (10, 1), (FROM, 0)]
    written = dict(trajectory_files("monocular", way(0.0), statistics.segments("monocular")))
    lines = written["monocular.tum"].splitlines()[-COUNT:]
    assert written["monocular_segment_1.tum"].splitlines()[-10 - COUNT + FROM :] == [*lines[:10], *lines[FROM:]]
    assert written["monocular_segment_2.tum"].splitlines()[-10:] == lines[10:FROM]


def test_stretches_that_nothing_joins_have_files_of_their_own(tmp_path: Path) -> None:
    written = dict(trajectory_files("monocular", way(2.0), [(0, 0), (FROM, 1)]))
    assert list(written) == ["monocular.tum", "monocular_segment_1.tum", "monocular_segment_2.tum"]
    parts = [written[name].splitlines()[-FROM:] for name in list(written)[1:]]
    assert [line for part in parts for line in part] == written["monocular.tum"].splitlines()[-COUNT:]
    assert list(dict(trajectory_files("monocular", way(0.0), [(0, 0)]))) == ["monocular.tum"]
    # A run that was killed leaves them in a folder that the next one may use.
    with RunFolder(tmp_path / "run") as folder:
        for name, text in written.items():
            folder.write(name, text)
    with RunFolder(tmp_path / "run"):
        assert not list((tmp_path / "run").glob("*.tum"))


def test_joined_stretches_are_one_segment_of_the_run() -> None:
    statistics = RunStatistics()
    for time_ns, restarted, joins in ((0, False, None), (5, True, None), (7, True, None), (9, True, 1), (11, False, 0)):
        statistics.count("m", time_ns, 1.0, "tracking", restarted, joins)
    assert [world for _, world in statistics.segments("m")] == [0, 0, 2, 0]


def test_a_segment_begins_at_its_first_frame_also_if_that_is_known_later() -> None:
    statistics = RunStatistics()
    statistics.count("m", 0, 1.0, "tracking", False)
    statistics.count("m", 9, 1.0, "tracking", True, None, 4)
    assert statistics.segments("m") == [(0, 0), (5, 1)]
