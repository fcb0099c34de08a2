"""The README is short; its commands are those of the checks, each a single line that sets up all it needs."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST_WORDS = 700


def test_the_two_commands() -> None:
    commands = re.findall(r"^python3 -m venv .*$", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert [line.split()[-1] for line in commands] == ["demo", "pytest"]
    assert all(".venv/bin/pip install" in line for line in commands)


def test_the_checks_run_the_readmes_test_command() -> None:
    script = (ROOT / ".ci" / "run").read_text()
    assert "README.md" in script and (ROOT / ".ci" / "run").stat().st_mode & 0o100
    for check in ("ruff check .", "ruff format --check .", "pyright", "sphinx -W"):
        assert check in script


def test_it_is_short() -> None:
    assert len((ROOT / "README.md").read_text().split()) <= MOST_WORDS
