"""`ispom schema`: one schema for each command that writes JSON, and a real answer of each is held against it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from ispom_app.cli.commands import COMMANDS
from ispom_app.cli.main import main
from jsonschema import Draft202012Validator

ROOT = Path(__file__).parents[2]
WRITING = [name for name, command in COMMANDS.items().items() if command.writes is not None]


def test_those_that_examine_trajectories_and_runs_have_a_schema() -> None:
    assert {"evaluate", "judge", "doctor", "triage", "shrink", "undecided", "budget", "loops", "passport"} <= set(
        WRITING
    )


@pytest.mark.parametrize("name", WRITING)
def test_the_schema_of_a_command_is_printed_and_takes_nothing_unknown(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["schema", name]) == 0
    schema = json.loads(capsys.readouterr().out)
    Draft202012Validator.check_schema(schema)
    for title, part in schema["$defs"].items():
        if "properties" in part:
            assert part["additionalProperties"] is False, title
            assert part["description"], title


@pytest.mark.parametrize("name", WRITING)
def test_a_real_answer_of_each_is_held_against_it(name: str) -> None:
    """By the tests of the command itself, which have one."""
    texts = (path.read_text() for folder in ("app", "tests") for path in (ROOT / folder).rglob("test_*.py"))
    assert any(f'breaks_schema("{name}", ' in text for text in texts)


def test_a_command_without_a_schema_is_told_which_have_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "sources"]) == 2
    said = capsys.readouterr().err
    assert all(name in said for name in WRITING)
