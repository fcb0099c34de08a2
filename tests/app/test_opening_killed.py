"""A command that reads a run that was killed: the run is finished first where a person says so, and in no other way."""

from __future__ import annotations

import io
import json
import shutil
import sys
from pathlib import Path

import pytest
from ispom_app.cli.commands import COMMANDS
from ispom_app.cli.main import main
from ispom_app.engine.options import ReadsRuns
from ispom_app.engine.run_folder.run_folder import MARKER, is_incomplete, is_unfinished, locked

from tests.app.helpers import files_of
from tests.app.strangers import killed_run

RESULTS = ("monocular.tum", "stereo.tum", "metrics.json", "steps.csv")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def answered(monkeypatch: pytest.MonkeyPatch, text: str | None) -> None:
    """What a person types; without it there is no terminal, and nothing may be read."""
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n") if text is None else Terminal(text))
    if text is not None:
        monkeypatch.setattr(sys, "stderr", Terminal())


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return killed_run(tmp_path_factory.mktemp("killed"), recording=False)


@pytest.fixture
def killed(left: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(left, tmp_path / "run"))


def is_finished(folder: Path) -> bool:
    return all((folder / name).is_file() for name in RESULTS) and not is_unfinished(folder)


def evaluate(folder: Path) -> list[str]:
    return ["evaluate", str(folder / "stereo.tum"), str(folder / "monocular.tum"), "--no-audit"]


def words_of(name: str, run: Path, out: Path) -> list[str]:
    """A command line of each command that takes the option, but of those that go on until they are ended."""
    return {
        "diff": ["diff", str(run), str(run)],
        "evaluate": evaluate(run),
        "export": ["export", str(run), "--format", "tum", "--out", str(out)],
        "report": ["report", str(run), "--out", str(out / "report.html")],
    }[name]


@pytest.mark.parametrize("name", ["diff", "evaluate", "export", "report"])
def test_with_the_option_it_is_finished_and_the_command_goes_on(
    name: str, killed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answered(monkeypatch, None)
    assert is_unfinished(killed)
    (tmp_path / "out").mkdir()
    assert main([*words_of(name, killed, tmp_path / "out"), "--repair"]) == 0
    out, err = capsys.readouterr()
    assert is_finished(killed) and is_incomplete(killed)
    assert "stereo.tum" in err and "as known when" not in out
    if name == "report":
        assert (killed / MARKER).read_text().splitlines()[0] in (tmp_path / "out" / "report.html").read_text()


def test_without_a_terminal_it_is_refused_and_nothing_changes(
    killed: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answered(monkeypatch, None)
    before = files_of(killed)
    assert main(["report", str(killed)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "--repair" in said and str(killed) in said
    assert files_of(killed) == before


@pytest.mark.parametrize("answer", ["y\n", "YES\n"])
def test_on_a_terminal_yes_finishes_it(answer: str, killed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answered(monkeypatch, answer)
    assert main(evaluate(killed)) == 0
    assert "[y/N]" in sys.stderr.getvalue() and is_finished(killed)  # type: ignore[attr-defined]


@pytest.mark.parametrize("answer", ["\n", "n\n", "", "perhaps\n"])
def test_on_a_terminal_anything_else_changes_nothing(
    answer: str, killed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answered(monkeypatch, answer)
    before = files_of(killed)
    assert main(evaluate(killed)) == 2
    assert files_of(killed) == before


def test_a_run_that_another_process_writes_is_not_touched(
    killed: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answered(monkeypatch, None)
    with locked(killed):
        before = files_of(killed)
        assert main([*evaluate(killed), "--repair"]) == 2
        assert files_of(killed) == before
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "another run" in said


def test_a_repaired_run_is_not_asked_for_again(killed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["repair", str(killed)]) == 0
    before = files_of(killed)
    answered(monkeypatch, "y\n")
    assert main(evaluate(killed)) == 0
    assert "[y/N]" not in sys.stderr.getvalue() and files_of(killed) == before  # type: ignore[attr-defined]


def test_files_that_are_no_runs_are_asked_nothing(tmp_path: Path) -> None:
    for source in ("", "sim:tiny", "camera:0", "http://host/x", str(tmp_path), "x" * 5000, "a\0b"):
        assert not is_unfinished(Path(source))
        assert not COMMANDS.get("app").read([source]).unfinished()


def test_the_working_folder_is_no_run_that_was_named(killed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(killed)
    assert not COMMANDS.get("app").read(["sim:tiny"]).unfinished()
    assert not COMMANDS.get("app").read([]).unfinished()
    assert COMMANDS.get("app").read(["."]).unfinished() == (Path("."),)


def test_every_command_says_which_of_its_words_are_runs() -> None:
    reading = {n: c.options_class() for n, c in COMMANDS.items().items() if issubclass(c.options_class(), ReadsRuns)}
    assert set(reading) >= {"app", "diff", "evaluate", "export", "map", "perturb", "publish", "report"}
    for name, options in reading.items():
        assert set(options.READS) <= set(options.__dataclass_fields__), name
    assert json.dumps(sorted(reading))
