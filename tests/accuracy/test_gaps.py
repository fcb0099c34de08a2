"""The bench of gaps: what it asks of a method, and how much of a scene it takes to be seen again."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from ispom.geometry import Pose
from ispom.types import Camera
from tests.accuracy import gaps, studies
from tests.accuracy.__main__ import main
from tests.accuracy.gaps import Found, Trial

CAMERA = Camera(100, 100, 100.0, 100.0, 49.5, 49.5)
TRIAL = Trial("sim:city seed 0", "stereo", 4.0, 2.0, 45.0)


def test_what_is_seen_again_is_visible_and_not_hidden() -> None:
    uv = np.stack(np.meshgrid(np.arange(100.0), np.arange(100.0)), axis=-1).reshape(-1, 2)
    depth = np.full(len(uv), 10.0)
    assert gaps._seen_again(CAMERA, uv, depth, Pose(), Pose()) == 1.0
    moved = Pose(translation=np.array([5.0, 0, 0]))  # by half an image
    assert gaps._seen_again(CAMERA, uv, depth, Pose(), moved) == pytest.approx(0.5, abs=0.02)
    wall = np.full((100, 100), 4.0)
    assert gaps._seen_again(CAMERA, uv, depth, Pose(), Pose(), wall) == 0.0
    behind = Pose.from_rotvec(np.array([0, np.pi, 0]), np.zeros(3))
    assert gaps._seen_again(CAMERA, uv, depth, Pose(), behind) == 0.0


@pytest.mark.parametrize(
    ("seen", "outcome", "error_m", "right"),
    [
        (0.5, "located", 0.1, True),
        (0.5, "located", 0.3, False),
        (0.5, "segment", np.nan, False),
        (0.1, "segment", np.nan, True),
        (0.1, "located", 0.3, False),
        (0.1, "located", 0.1, True),
        (0.1, "lost", np.nan, True),
    ],
)
def test_a_method_knows_its_place_or_says_that_it_does_not(
    seen: float, outcome: str, error_m: float, right: bool
) -> None:
    assert Found(TRIAL, seen, outcome, error_m, 0.2).right is right  # type: ignore[arg-type]


def test_the_study_covers_both_methods(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path
) -> None:
    def measured_elsewhere(module: str, task: dict) -> list[dict]:
        assert module == "gaps"
        trial = Trial(f"seed {task['seed']}", task["method"], 4.0, 2.0)
        return [asdict(Found(trial, 0.5, "located", 0.1, 0.2)), asdict(Found(trial, 0.1, "located", 0.9, 0.2))]

    monkeypatch.setattr(studies, "found", measured_elsewhere)
    assert main(["gaps", "--data", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "monocular: where at least 30%" in out
    assert "in 1 of 1; else 1 of 1 located" in " ".join(out.split())
