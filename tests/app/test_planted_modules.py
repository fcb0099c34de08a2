"""Modules that somebody planted in the working directory are never imported by the processes that are started there."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from ispom_app import __main__ as entry
from ispom_app.engine import warmup
from ispom_app.features.experiments import cluster
from ispom_app.features.sweep import process as sweep

from ispom.child import PYTHON, Child
from ispom.estimators.program.pipe import Pipe, ProgramFault
from ispom.simulation.rendering import process as rendering

ROOT = Path(__file__).parents[2]
PLANTED = ("json", "argparse", "yaml", "numpy", "cv2", "numba", "ispom", "ispom_app", "psutil", "contextlib")


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: each module in it leaves a mark when it is imported."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    for name in PLANTED:
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n")
    monkeypatch.chdir(folder)
    return tmp_path / "ran"


@pytest.mark.parametrize(
    "command",
    [warmup.COMMAND, cluster.COMMAND, sweep.COMMAND, [*rendering._COMMAND, "1.0"], [*PYTHON, "-c", "import json"]],
    ids=["warm-up", "worker", "sweep", "rendering", "code"],
)
def test_no_child_imports_from_the_working_directory(stranger: Path, command: list[str]) -> None:
    child = Child(list(command))
    child.requests.close()  # it ends with its imports, for there is nothing to do
    child.ending()
    assert not stranger.exists()


def test_the_supervisor_of_a_program_does_not(stranger: Path) -> None:
    pipe = Pipe([sys.executable, "-I", "-c", "pass"], 60.0)
    with pytest.raises(ProgramFault):
        pipe.request(b"{}\n")
    pipe.stop()
    assert not stranger.exists()


def test_the_same_folder_without_it_would(stranger: Path) -> None:
    child = Child([sys.executable, "-c", "import json"])
    child.ending()
    assert stranger.exists()


def test_every_child_is_started_so() -> None:
    sources = [
        path for folder in ("ispom", "app") for path in (ROOT / folder).rglob("*.py") if "tests" not in path.parts[-2:]
    ]
    own = [path for path in sources if re.search(r"sys\.executable", path.read_text())]
    assert [path.relative_to(ROOT).as_posix() for path in own] == ["ispom/child.py"]


@pytest.mark.parametrize("name", [".numba_config.yaml", "matplotlibrc"])
def test_settings_that_libraries_would_obey_are_refused(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text("disable_jit: 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["ispom", "--help"])
    monkeypatch.setattr(entry, "_complete_streams", lambda: None)  # these are the test's
    assert entry.main() == 2
    message = capsys.readouterr().err
    assert name in message and message.count("\n") == 1
