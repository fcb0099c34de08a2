"""`ispom new-method` writes a package that works, and `ispom grade` gives it points."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from ispom_app.cli.main import main

from ispom.methods import names

SHORT = ("--runs", "1", "--key", "a", "--max-exposures", "24")


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packages")
    assert main(["new-method", "made_here", "--out", str(folder)]) == 0
    return folder / "made_here"


def python(folder: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """In a process of its own: a graded package is imported."""
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, *map(str, words)]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=200, check=False
    )


def test_it_has_no_placeholder_left(package: Path) -> None:
    files = [path for path in package.rglob("*") if path.is_file()]
    assert sorted(path.name for path in files) == ["README.md", "made_here.py", "pyproject.toml", "test_made_here.py"]
    for path in files:
        text = path.read_text()
        assert "made_here" in text and "$" not in text, path


@pytest.mark.slow
def test_its_own_tests_pass(package: Path) -> None:
    found = python(package, "-m", "pytest", "-q", "-p", "no:cacheprovider")
    assert found.returncode == 0, found.stdout


def test_it_is_graded(package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It has no map: tracking and two-view geometry have most of their points, triangulation none."""
    report = tmp_path / "grade.json"
    assert main(["grade", str(package), *SHORT, "--no-contract", "--json", str(report)]) == 0
    assert "made_here" not in sys.modules and "made_here" not in names(), "its code never runs in this process"
    found = json.loads(report.read_text())["methods"]["made_here"]
    stages = found["stages"]
    assert stages["tracking"] > 15 and stages["two-view"] > 12 and stages["triangulation"] == 0
    assert found["too_good"] == []
    printed = capsys.readouterr().out
    assert "made_here: " in printed and "Step.landmarks" in printed


@pytest.mark.parametrize("name", ["My-VO", "1vo", "class", "numpy", "stereo", "", "a" * 60, "vo.paper"])
def test_a_name_that_is_none_or_taken(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new-method", name, "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_folder_that_is_there_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "my_own_vo").mkdir()
    assert main(["new-method", "my_own_vo", "--out", str(tmp_path)]) == 2
    assert "is there already" in capsys.readouterr().err and not list((tmp_path / "my_own_vo").iterdir())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["no-such-package"], "is no folder, no installed package and no method"),
        (["numpy"], "has no entry point of the group ispom.methods"),
        (["stereo", "--methods", "monocular"], "has no method 'monocular': choose from stereo"),
        (["stereo", "--source", "kitti"], "give a simulation without a seed"),
        (["stereo", "--source", "sim:tiny#3"], "give a simulation without a seed"),
        (["stereo", "--runs", "0"], "--runs is 0"),
        (["stereo", "--seconds", "nan"], "--seconds is nan"),
        (["stereo", "--memory-gb", "0"], "--memory-gb is 0"),
        (["stereo", "--no-contract", "--source", "sim:tiny?fisheye=true"], "rolling shutter or fisheyes"),
    ],
)
def test_a_mistake_is_one_sentence(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["grade", *words]) == 2
    printed = capsys.readouterr().err.splitlines()
    assert message in printed[-1] and printed[-1].startswith("ispom: ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "has no pyproject.toml"),
        ("[project", "is not valid TOML"),
        ("[project]\nname = 'a'\n", "has no entry point of the group"),
        (
            '[project.entry-points."ispom.methods"]\na = "no_such_module_here:METHOD"\n',
            "fails with ModuleNotFoundError",
        ),
        ('[project.entry-points."ispom.methods"]\na = "os:getcwd"\n', "gives no ispom.Method"),
    ],
)
def test_a_folder_without_a_method(
    text: str | None, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        (tmp_path / "pyproject.toml").write_text(text)
    assert main(["grade", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
