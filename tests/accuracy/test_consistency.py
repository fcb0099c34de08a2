"""The study of covariances: what it covers, and its numbers on made errors."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.sensors.gnss import SimulatedGnss
from ispom.types import Status, Step, Trajectory
from tests.accuracy import consistency, schemes, studies
from tests.accuracy.__main__ import main
from tests.nees import Errors


def test_consistency_covers_what_has_covariances(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def made(seed: int) -> Errors:
        twists = np.random.default_rng(seed).normal(size=(10, 6))
        return Errors(np.arange(10), twists, np.tile(np.eye(6) / 4, (10, 1, 1)))

    monkeypatch.setattr(consistency, "_errors", lambda sequence, method: made(sequence))
    monkeypatch.setattr(consistency, "_known", lambda sequence, seed, cameras: sequence)
    monkeypatch.setattr(consistency, "open_simulated", lambda name, seed, folder, duration_s, world: seed)
    monkeypatch.setattr(studies, "names", lambda: ("stereo",))
    found = lambda module, task: consistency.measured(  # noqa: E731
        "stereo", task["scene"], task["cameras"], task["seeds"], tmp_path
    )
    monkeypatch.setattr(studies, "found", found)
    assert main(["consistency", "--seeds", "5", "--json", str(tmp_path / "c.json")]) == 0
    row, *others = json.loads((tmp_path / "c.json").read_text())
    assert [(r["cameras"], r["scene"]) for r in (row, *others)] == list(product(consistency.KNOWN, consistency.FLIGHTS))
    assert (
        row["pose"]["above"] == 1
        and row["pose"]["below"] == 0
        and row["pose"]["longest_above_s"] == pytest.approx(9e-9)
    )
    assert row["pose"]["sigma_factor"] == pytest.approx(2, rel=0.1) and row["position"]["dof"] == 3
    monkeypatch.setattr(studies, "found", lambda module, task: {})
    assert main(["consistency"]) == 0
    printed = capsys.readouterr().out
    assert "orientation" in printed and "gives no covariances" in printed


def test_schemes_of_fused_are_told_apart_by_their_gauge() -> None:
    """An exact path in any of the worlds has no error in it."""
    rng, way = np.random.default_rng(0), np.linspace(0, 5, 8)
    truth = Trajectory.of(
        [(i, Pose.from_rotvec(0.1 * rng.normal(size=3), np.array([0, 0, z]))) for i, z in enumerate(way)]
    )
    level = Pose.from_rotvec(np.array([0.0, 0.7, 0.0]), np.array([1.0, 2.0, 3.0]))
    east = Pose(schemes.OPTICAL_FROM_LOCAL @ SimulatedGnss().local_from_world)
    any_world = Pose.from_rotvec(np.array([0.4, -0.2, 0.3]), np.array([1.0, 0.0, 0.0]))
    for scheme, world in (("4", east), ("6", level), ("8", any_world)):
        path = Trajectory.of([(t, world @ pose) for t, pose in truth.items()])
        steps = [Step(t, Status.TRACKING, "rig", pose, np.eye(6)) for t, pose in path.items()]
        found = schemes._errors(scheme, steps, path, truth)
        assert len(found.times_ns) == 7
        np.testing.assert_allclose(found.twists, 0, atol=1e-9)
