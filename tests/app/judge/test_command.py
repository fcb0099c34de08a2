"""`ispom judge` on rendered recordings: verdict, exit code, JSON, and sentences for mistakes."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ispom_app.cli.main import main
from markupsafe import escape

from ispom.geometry import Pose
from ispom.io.trajectories import tum_text
from ispom.sequences import open_sequence
from ispom.types import Trajectory
from tests.app.written import breaks_schema

RECORDING = ["sim:tiny", "--max-exposures", "60"]


@pytest.fixture(scope="module")
def truth() -> Trajectory:
    """world_from_rig of the whole of sim:tiny."""
    poses = open_sequence("sim:tiny").truth
    assert poses is not None
    return poses


def judged(
    poses: Trajectory, folder: Path, capsys: pytest.CaptureFixture[str], recording: list[str] = RECORDING
) -> tuple[int, dict[str, Any]]:
    """The exit code and the JSON for poses of the rig."""
    (folder / "poses.txt").write_text(tum_text(poses))
    code = main(["judge", str(folder / "poses.txt"), *recording, "--frame", "rig", "--json"])
    text = capsys.readouterr().out
    assert not breaks_schema("judge", text)
    return code, json.loads(text)


def test_the_truth_is_not_contradicted(truth: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found = judged(truth, tmp_path, capsys)
    assert (code, found["verdict"]) == (0, "agrees")
    assert found["places"] == [] and not any(each["found"] for each in found["all_poses"])
    assert found["stretches"] and found["frames_with_pose"] == found["frames"]


def test_inverse_poses_are_contradicted_in_words_and_in_a_file(
    truth: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inverse = Trajectory.of([(time, pose.inverse()) for time, pose in truth.items()])
    (tmp_path / "poses.txt").write_text(tum_text(inverse))
    out = tmp_path / "out"
    code = main(["judge", str(tmp_path / "poses.txt"), *RECORDING, "--frame", "rig", "--out", str(out)])
    assert code == 1 and capsys.readouterr().out.startswith("contradicted: ")
    found = json.loads((out / "judge.json").read_text())
    assert [each["kind"] for each in found["all_poses"] if each["found"]] == ["inverse"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["clock", "jump", "scale", "axes"])
def test_what_is_planted_is_found(
    kind: str, truth: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses, position = truth, truth.translations.copy()
    middle = len(truth) // 2
    if kind == "clock":
        poses = replace(truth, times_ns=truth.times_ns + 20_000_000)
    elif kind == "axes":
        poses = truth.moved(right=Pose(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3)))
    elif kind == "jump":
        position[middle:] += 0.5 * np.array([1.0, 1.0, 1.0])
        poses = replace(truth, translations=position)
    else:
        position[middle:] = position[middle] + 2.5 * (position[middle:] - position[middle])
        poses = replace(truth, translations=position)
    code, found = judged(poses, tmp_path, capsys, ["sim:tiny"])
    assert code == 1
    named = {each["kind"] for each in found["all_poses"] if each["found"]}
    if kind in ("clock", "axes"):
        assert named == {kind}
        return
    assert not named and found["places"]
    time_s = (truth.times_ns[middle] - truth.times_ns[0]) * 1e-9
    assert {"jump": "motion", "scale": "scale"}[kind] in {each["kind"] for each in found["places"]}
    assert any(each["first_s"] - 0.1 <= time_s <= each["last_s"] + 0.1 for each in found["places"])


def test_mistakes_are_one_sentence(truth: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    later = replace(truth, times_ns=truth.times_ns + 3_600_000_000_000)
    (tmp_path / "later.txt").write_text(tum_text(later))
    (tmp_path / "few.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    for name in ("later.txt", "few.txt", "missing.txt"):
        assert main(["judge", str(tmp_path / name), *RECORDING]) == 2
        error = capsys.readouterr().err
        assert error.startswith("ispom: ") and error.count("\n") == 1


def test_the_page_shows_what_is_denied_and_opens_at_the_worst_frame(
    truth: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    position = truth.translations.copy()
    position[len(truth) // 4 :] += 2.0
    (tmp_path / "poses <1>.txt").write_text(tum_text(replace(truth, translations=position)))
    page = tmp_path / "judge.html"
    poses = str(tmp_path / "poses <1>.txt")
    assert main(["judge", poses, *RECORDING, "--frame", "rig", "--page", str(page)]) == 1
    command = capsys.readouterr().out.splitlines()[-1].partition("See it: ")[2]
    words = shlex.split(command)
    assert words[:5] == ["ispom", "app", "sim:tiny", "--max-exposures", "60"]
    assert words[-2:] == ["--beside", f"poses:rig={poses}"]
    sequence = open_sequence("sim:tiny")
    at = int(words[words.index("--at") + 1])
    jump_ns = int(truth.times_ns[len(truth) // 4])
    assert abs(int(sequence.times_ns[at]) - jump_ns) < 0.5e9
    assert main(["judge", poses, *RECORDING, "--frame", "rig", "--page", str(page)]) == 1  # replaces its own
    text = page.read_text()
    assert 'class="denied"' in text and 'class="misfit"' in text
    assert str(escape(command)) in text and "<1>" not in text
    assert "<script" not in text and "http" not in text.replace("http-equiv", "")


def test_too_few_triples_for_a_drift_of_the_scale_are_null_in_json(
    truth: Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """44 frames have pairs enough for a verdict, but hardly any two pairs that follow each other."""
    _, found = judged(truth, tmp_path, capsys, ["sim:tiny", "--max-exposures", "44"])
    growing = next(each for each in found["all_poses"] if each["kind"] == "growing")
    assert growing["sigma"] is None and not growing["detectable"] and not growing["found"]
