"""Real methods in a simulated darkness: the example of docs/howto/shrink.md, and programs."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from ispom_app.cli.main import main
from ispom_app.features.shrink.drawn import GREY

from .test_command import expected

ROOT = Path(__file__).parents[4]
PAGE = ROOT / "docs/howto/shrink.md"
SOURCE = "sim:tiny?fault=darkness:factor=0.02,from_s=1"
FIRST_DARK = 33
"""The darkness begins at 1 s of a video of 33 1/3 frames per second, whose frames include those of the pairs."""
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_the_example_of_the_page_is_what_happens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shrink, verify = (shlex.split(block)[1:] for block in blocks("sh"))
    assert main(shrink) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in blocks("text")[0].splitlines() if line not in lines] == []
    found = expected(tmp_path / "dark")
    assert found.part.frames[-1] == found.event.recorded_frame == FIRST_DARK
    assert len(found.part.frames) <= found.part.of_frames / 10 and (tmp_path / "dark.zip").exists()
    assert main(verify) == 0


def test_drawn_tracks_keep_the_failure_and_no_image(tmp_path: Path) -> None:
    words = ["shrink", SOURCE, "--kind", "lost", "--methods", "monocular", "--private", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    found = expected(tmp_path / "out")
    assert found.private and not found.recording and found.event.cause == "pose_points"
    paths = sorted((tmp_path / "out" / "video").iterdir())
    drawn = [float((cv2.imread(str(path), cv2.IMREAD_UNCHANGED) != GREY).mean()) for path in paths]
    assert drawn[-1] < 0.05 < 0.4 < min(drawn[:-1]), "hardly anything is tracked in the dark"
    assert main(["shrink", "--verify", str(tmp_path / "out")]) == 0


def test_the_failure_of_a_program_is_shrunk(tmp_path: Path) -> None:
    """A process of its own: methods that are programs are added to those of a process."""
    program = f"compass={shlex.quote(sys.executable)} {shlex.quote(str(ROOT / 'examples/external_program/compass.py'))}"
    out = tmp_path / "out"
    words = ["shrink", SOURCE, "--external", program, "--methods", "compass", "--kind", "lost", "--out", str(out)]
    done = ispom(words)
    assert not done.returncode, done.stderr
    found = expected(out)
    assert found.event.recorded_frame == FIRST_DARK and found.external == (program,)
    assert len(found.part.frames) <= found.part.of_frames / 10 and found.event.cause == "difference"
    assert ispom(["shrink", "--verify", str(out)]).returncode == 2, "a program is started that nobody named"
    assert ispom(["shrink", "--verify", str(out), "--external", program]).returncode == 0


def ispom(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "ispom_app", *words], capture_output=True, text=True, check=False
    )
