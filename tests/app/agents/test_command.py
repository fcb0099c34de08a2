"""`ispom mcp` at the command line: mistakes are one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.features.agents import required
from ispom_app.features.agents.server import line


@pytest.mark.parametrize("words", [["mcp"], ["app", "--agents", "0"]])
def test_a_missing_extra_is_named(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(required, "find_spec", lambda name: None)
    assert main(words) == 2
    output = capsys.readouterr()
    assert "ispom[agents]" in output.err and output.err.count("\n") == 1 and not output.out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["nothing-here"], "nothing-here"),
        (["--runs", "nowhere"], "--runs"),
        (["--history-mb", "1"], "--history-mb"),
        (["--log", "nowhere/calls.log"], "nowhere"),
        (["--http", "70000"], "--http"),
    ],
)
def test_a_mistake_is_a_sentence(
    words: list[str], named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["mcp", *words]) == 2
    output = capsys.readouterr()
    assert named in output.err and output.err.count("\n") == 1 and not output.out


def test_a_log_through_a_link_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "target")
    assert main(["mcp", "--log", str(tmp_path / "link")]) == 2
    assert not (tmp_path / "target").exists() and "link" in capsys.readouterr().err


def test_a_call_is_one_printable_line() -> None:
    found = line("events\n", {"kind": "a\nb\x1b[31m", "long": "x" * 10_000}, "refused: one\ntwo")
    assert found.isprintable() and len(found) < 1000 and found.endswith("refused: one two")
