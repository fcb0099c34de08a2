"""`ispom mcp` at the command line: mistakes are one sentence."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import tyro
from ispom_app.cli.main import main
from ispom_app.features.agents import required
from ispom_app.features.agents.options import Mcp
from ispom_app.features.agents.server import line
from ispom_app.features.agents.tool import tools


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


def test_the_configuration_of_the_documentation_starts_a_server() -> None:
    """Its words are those that the command takes."""
    page = (Path(__file__).parents[3] / "docs" / "howto" / "agents.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```json\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    ((name, entry),) = json.loads(block)["mcpServers"].items()
    assert name == "ispom" and Path(entry["command"]).name == "ispom" and entry["args"][0] == "mcp"
    options = tyro.cli(Mcp, args=entry["args"][1:])
    assert options.sources and not options.allow_changes and options.http is None


def test_the_documentation_has_every_tool() -> None:
    page = (Path(__file__).parents[3] / "docs" / "howto" / "agents.md").read_text(encoding="utf-8")
    listed = {name for row in re.findall(r"^\| (`.*?) \|", page, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)}
    assert listed == tools().keys()
