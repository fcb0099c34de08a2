"""The tutorials' commands run, in their order, and print what the pages quote."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.commands import ROOT, command_lines

TUTORIALS = ROOT / "docs" / "tutorials"
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def executed(page: str, folder: Path, codes: dict[str, int]) -> str:
    """All that the page's commands print, without those that open the page. `codes` are exit codes by command."""
    said = ""
    for words in command_lines((TUTORIALS / page).read_text(encoding="utf-8")):
        if words[0] in ("app", "learn"):
            continue
        command = [sys.executable, "-m", "ispom_app", *words]
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
        assert done.returncode == codes.get(words[0], 0), f"ispom {' '.join(words)}: {done.stderr}"
        said += done.stdout
    return said


def test_debug_a_lost_track(tmp_path: Path) -> None:
    said = executed("lost_track.md", tmp_path, {})
    page = (TUTORIALS / "lost_track.md").read_text(encoding="utf-8")
    quoted = re.findall(r"```text\n(.*?)```", page, re.DOTALL)[0].splitlines()
    for line in quoted:
        assert line.removesuffix(", ...") in said, said
    assert "Map initialised" in (tmp_path / "recordings" / "dark" / "events.csv").read_text()


def test_compare_two_settings(tmp_path: Path) -> None:
    page = (TUTORIALS / "compare_settings.md").read_text(encoding="utf-8")
    (plan,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "tracks.yaml").write_text(plan.replace("seeds: 0-4", "seeds: 0"))
    said = executed("compare_settings.md", tmp_path, {"diff": 1})
    assert "max_tracks" in said
    for name in ("report.html", "tracks/index.html", "tracks/results.csv"):
        assert (tmp_path / name).is_file()


def test_calibrate_a_rig_without_a_camera(tmp_path: Path) -> None:
    lines = command_lines((TUTORIALS / "calibrate_rig.md").read_text(encoding="utf-8"))
    simulated, target, _ = lines
    assert simulated[2].startswith("sim:") and target[:2] == ["calibrate", "target"]
    for words in (simulated, target):
        command = [sys.executable, "-m", "ispom_app", *words]
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "target.pdf").is_file()


def test_write_a_method(tmp_path: Path) -> None:
    from tests.examples.packages import install, python

    (tmp_path / "site").mkdir()
    installed = install(tmp_path / "site", "own_estimator")
    (words,) = command_lines((TUTORIALS / "own_method.md").read_text(encoding="utf-8"))
    out = tmp_path / "own"
    alone = [word for word in words[: words.index("--out")] if word != "monocular"]  # which takes long to compile
    done = python(installed, "-m", "ispom_app", *alone, "--max-exposures", "30", "--out", out)
    assert done.returncode == 0, done.stderr
    assert (out / "frames.tum").is_file()
    shutil.rmtree(out)
