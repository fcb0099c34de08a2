"""The study of stated covariances: its table is complete, and the page has it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.methods import names
from ispom.sensors.gnss import SimulatedGnss
from ispom.types import Camera, Frame, Imu, Rig, Sequence, Status, Step, Trajectory
from tests.accuracy import studies, uncertainty
from tests.accuracy.__main__ import main
from tests.accuracy.uncertainty import CAUSES, Mean, Stated, markdown, means, read_table

PAGE = Path(__file__).parents[2] / "docs" / "evaluation" / "consistency.md"


def test_schemes_of_fused_are_told_apart_by_their_gauge() -> None:
    """An exact path in any of the worlds has no error in it."""
    rng, way = np.random.default_rng(0), np.linspace(0, 5, 8)
    truth = Trajectory.of(
        [(i, Pose.from_rotvec(0.1 * rng.normal(size=3), np.array([0, 0, z]))) for i, z in enumerate(way)]
    )
    level = Pose.from_rotvec(np.array([0.0, 0.7, 0.0]), np.array([1.0, 2.0, 3.0]))
    east = Pose(uncertainty.OPTICAL_FROM_LOCAL @ SimulatedGnss().local_from_world)
    any_world = Pose.from_rotvec(np.array([0.4, -0.2, 0.3]), np.array([1.0, 0.0, 0.0]))
    for scheme, world in (("4", east), ("6", level), ("8", any_world)):
        path = Trajectory.of([(t, world @ pose) for t, pose in truth.items()])
        steps = [Step(t, Status.TRACKING, "rig", pose, np.eye(6)) for t, pose in path.items()]
        found = uncertainty.errors_in_gauge(scheme, steps, path, truth)
        assert len(found.times_ns) == 7
        np.testing.assert_allclose(found.twists, 0, atol=1e-9)
        elsewhere = [replace(step, world_from_frame=Pose()) for step in steps[:4]]  # before a world of its own
        later = [*elsewhere, replace(steps[4], restarted=True), *steps[5:]]
        np.testing.assert_allclose(
            uncertainty.errors_in_gauge(scheme, later, path, truth).twists, np.zeros((4, 6)), atol=1e-9
        )


def test_a_tilted_rig_has_its_sensors_where_they_were() -> None:
    camera, behind = Camera(64, 48, 50.0, 50.0, 31.5, 23.5), Pose(translation=np.array([0.0, 0.2, -0.5]))
    rig = Rig.of(video=camera, imu=Imu(rig_from_sensor=behind))
    truth = Trajectory.of([(i, Pose.from_rotvec(np.array([0, 0.1 * i, 0]), np.array([0, 0, i]))) for i in range(3)])
    level = Sequence(
        "drive", rig, truth.times_ns, ("video",) * 3, lambda i: Frame.video(i, np.zeros((48, 64), np.uint8))
    )
    level = replace(level, truth=truth)
    found, other = (uncertainty.tilted(level, seed) for seed in (0, 1))
    assert found.truth is not None and other.truth is not None
    for name in rig.sensors:
        for i in range(3):
            there = found.truth.pose(i) @ found.rig.rig_from(name)
            np.testing.assert_allclose(there.matrix, (truth.pose(i) @ rig.rig_from(name)).matrix, atol=1e-12)
    up = [t.truth.pose(0).rotation[1, 1] for t in (level, found, other) if t.truth is not None]
    assert up[0] == 1 and all(0.95 < each < 0.9999 for each in up[1:]) and up[1] != up[2]


def test_the_mean_is_over_the_seeds_of_one_source() -> None:
    rows = [Stated("fused", "2", "a drive", seed, nees, 0.01 * nees) for seed, nees in ((0, 4.0), (1, 8.04))]
    (found,) = means([*rows, Stated("direct", "", "sim:tiny", 0, None)])
    assert found == Mean("2", "a drive", (4.0, 8.0), 0.06) and found.mean == 6 and found.right
    assert not Mean("", "", (1.0, 4.0)).right and not Mean("", "", (9.0, 12.0)).right


def test_the_study_keeps_what_it_does_not_measure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked = []

    def rows_of(console: object, what: str, module: str, task: dict[str, Any]) -> list[dict[str, Any]]:
        asked.append((task["method"], task["seed"]))
        nees = None if task["method"] == "direct" else 5.0 + task["seed"]
        return [{"method": task["method"], "scheme": "", "source": "sim:tiny", "seed": task["seed"], "nees": nees}]

    monkeypatch.setattr(studies, "rows_of", rows_of)
    monkeypatch.setattr(studies, "UNCERTAINTY", tmp_path / "u.json")
    assert main(["uncertainty", "--seeds", "3", "--methods", "stereo"]) == 0
    assert main(["uncertainty", "--seeds", "3", "--methods", "direct"]) == 0
    assert asked == [("stereo", 0), ("stereo", 1), ("stereo", 2), ("direct", 0)]  # one seed says that it states none
    assert read_table(tmp_path / "u.json") == {"stereo": [Mean("", "sim:tiny", (5.0, 6.0, 7.0))], "direct": []}
    printed = capsys.readouterr().out
    assert "| `stereo` | sim:tiny | 6.0 | 5.0, 6.0, 7.0 |" in printed and "`direct`" in printed


def test_every_method_has_its_sources() -> None:
    assert all(uncertainty.SCHEMES.get(name) or uncertainty.sources_of(name) for name in names())


def test_the_page_has_the_table_of_every_method() -> None:
    table = read_table()
    assert set(table) == set(names()), "python -m tests.accuracy uncertainty --seeds 5 measures the others"
    assert markdown(table) in PAGE.read_text(encoding="utf-8")


def test_what_is_outside_has_a_cause_and_nothing_else() -> None:
    outside = {(m, row.scheme or row.source) for m, rows in read_table().items() for row in rows if not row.right}
    assert outside == set(CAUSES)
