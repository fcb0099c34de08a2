"""The example of a program as a method: run, forked, stopped on a check and compared like any other."""

from __future__ import annotations

import ast
import csv
import os
import shlex
import sys
from pathlib import Path

import cv2
import pytest
import yaml

from tests.examples.conftest import FRAMES
from tests.examples.packages import ispom

COMPASS = Path(__file__).parents[2] / "examples" / "external_program" / "compass.py"
PROGRAM = shlex.join([Path(sys.executable).as_posix(), "-S", COMPASS.as_posix()])
BOTH = ("--external", f"compass={PROGRAM}", f"--external=forgetful:video={PROGRAM} --forget")
FORKED_AT = 12


@pytest.fixture(scope="module")
def run(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "run"
    found = ispom("run", recording, *BOTH, "--methods", "compass", "forgetful", "--no-recording", "--out", out)
    assert found.returncode == 0, found.stderr
    return out


def told(*words: str | Path) -> str:
    """The one sentence of a mistake."""
    found = ispom(*words)
    assert found.returncode == 2 and found.stderr.count("\n") == 1 and "Traceback" not in found.stderr, found.stderr
    return found.stderr


def test_it_needs_nothing_of_ispom() -> None:
    imports = [node for node in ast.walk(ast.parse(COMPASS.read_text())) if isinstance(node, ast.Import)]
    assert {alias.name for node in imports for alias in node.names} <= sys.stdlib_module_names
    assert "from" not in {line.split(" ")[0] for line in COMPASS.read_text().splitlines()}


def test_it_is_run(run: Path) -> None:
    assert len((run / "compass.tum").read_text().splitlines()) == FRAMES
    assert (run / "compass.tum").read_bytes() == (run / "forgetful.tum").read_bytes()
    with (run / "decisions.csv").open() as file:
        assert {row["key"] for row in csv.DictReader(file)} == {"contrast", "difference"}
    assert "compass.py" not in (run / "run.yaml").read_text(), "a run folder must not say what is started"


def test_a_fork_is_the_same(run: Path, tmp_path: Path) -> None:
    fork = tmp_path / "fork"
    found = ispom("fork", run, *BOTH, "--at", str(FORKED_AT), "--no-recording", "--out", fork)
    assert found.returncode == 0, found.stderr
    for name in ("compass.tum", "forgetful.tum", "decisions.csv"):
        assert (fork / name).read_bytes() == (run / name).read_bytes()
    alike = ispom("diff", run, fork)
    assert alike.returncode == 0 and "alike: compass, forgetful" in alike.stdout, alike.stderr


def test_it_stops_on_its_check_and_a_changed_image_is_found(run: Path, recording: Path, tmp_path: Path) -> None:
    with (run / "decisions.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == "compass" and row["key"] == "difference"]
    value = float(next(row["value"] for row in rows if row["exposure"] == str(FORKED_AT)))
    stopped, changed, out = tmp_path / "stopped", tmp_path / "changed", tmp_path / "other"
    until = f"exposure >= {FORKED_AT} and compass.difference >= {value!r}"
    words = (*BOTH, "--methods", "compass", "--no-recording", "--out")
    assert ispom("run", recording, *words, stopped, "--until", until).returncode == 0
    assert yaml.safe_load((stopped / "run.yaml").read_text())["stopped"]["exposure"] == FORKED_AT
    changed.mkdir()
    for file in recording.iterdir():
        (changed / file.name).write_bytes(file.read_bytes())
    image = cv2.imread(str(recording / f"{FORKED_AT:03d}.png"))
    image[100, 100] += 9
    cv2.imwrite(str(changed / f"{FORKED_AT:03d}.png"), image)
    assert ispom("run", changed, *words, out).returncode == 0
    comparison = ispom("diff", run, out)
    assert comparison.returncode == 1 and f"frame {FORKED_AT}" in comparison.stdout, (
        comparison.stdout + comparison.stderr
    )


def test_it_has_flags_and_no_flag_for_its_command() -> None:
    found = ispom("run", "--help", *BOTH, "--methods", "compass")
    assert "--compass.timeout-s" in found.stdout and "--compass.command" not in found.stdout


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("", "give NAME=COMMAND"),
        ("compass", "give NAME=COMMAND"),
        ("compass:lidar=ls", "give NAME=COMMAND"),
        ("compass:video+video=ls", "give NAME=COMMAND"),
        ("Com-pass=ls", "names a method 'Com-pass'"),
        ("class=ls", "names a method 'class'"),
        ("truth=ls", "'truth', which has another meaning"),
        ("world=ls", "'world', which has another meaning"),
        ("survey=ls", "'survey', which has another meaning"),
        ("monocular_paper=ls", "which there is already"),
        ("compass=", "starts nothing"),
        ("compass='ls", "close its quotes"),
        ("compass=no-such-program --fast", "starts 'no-such-program', which is no program"),
    ],
)
def test_a_mistake_is_a_sentence(value: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    from ispom_app.engine.external import add_programs

    assert said in add_programs(["run", "--external", value])


def test_a_program_that_ends_is_a_sentence(recording: Path, tmp_path: Path) -> None:
    python = Path(sys.executable).as_posix()
    said = told("run", recording, "--external", f"compass={shlex.join([python, '-c', 'raise SystemExit(1)'])}")
    assert "compass: " in said and "exit code 1," in said
    with_fault = tmp_path / "fault.py"
    with_fault.write_text(
        COMPASS.read_text().replace(
            "    shift, left_over =", "    left_over = 1 / (state['id'] < 1)\n    shift, left_over ="
        )
    )
    program = shlex.join([Path(sys.executable).as_posix(), "-S", with_fault.as_posix()])
    words = ("--external", f"faulty={program}", "--methods", "faulty", "--out", tmp_path / "run", "--no-recording")
    said = told("run", recording, *words)
    assert "exit code 1 (ZeroDivisionError: division by zero), at frame 1" in said
    assert (tmp_path / "run" / "INCOMPLETE").exists() and os.path.getsize(tmp_path / "run" / "steps.csv")
