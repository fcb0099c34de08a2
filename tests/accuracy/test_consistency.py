"""The study of covariances: what it covers, and its numbers on made errors."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from tests.accuracy import consistency, studies
from tests.accuracy.__main__ import main
from tests.nees import Errors


def test_consistency_covers_what_has_covariances(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def made(seed: int) -> Errors:
        twists = np.random.default_rng(seed).normal(size=(10, 6))
        return Errors(np.arange(10), twists, np.tile(np.eye(6) / 4, (10, 1, 1)))

    monkeypatch.setattr(consistency, "errors_of_run", lambda sequence, method: made(sequence))
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
