"""How-tos of the commands that examine trajectories and runs: short, and each with a real example made by a script."""

from __future__ import annotations

import re

import pytest

from tests.docs.commands import command_lines
from tests.docs.examples import HOWTO, commands, marks

PAGES = ("evaluate", "judge", "doctor", "triage", "shrink", "undecided", "budget", "loops", "passport")
MOST_WORDS = 300


def words(text: str) -> list[str]:
    """What a reader reads as text: headings, tables and code within a line count; blocks of commands and of what they
    print, and comments, do not. The target of a link counts with its text as one."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    return [word for word in text.split() if re.search(r"\w", word)]


@pytest.mark.parametrize("page", PAGES)
def test_a_howto_is_short_and_its_example_is_that_of_its_own_commands(page: str) -> None:
    text = (HOWTO / f"{page}.md").read_text(encoding="utf-8")
    assert len(words(text)) <= MOST_WORDS
    before, example, after = re.split("|".join(map(re.escape, marks(page))), text)
    assert re.fullmatch(r"\s*```text\n.+\n```\s*", example, re.DOTALL) and "```text" not in before + after
    assert any(line[0] == page for line in command_lines(f"```sh\n{commands(before)}```\n"))


def test_words_are_counted_as_they_are_read() -> None:
    text = "# One two\n\n```sh\nno no\n```\n<!-- no -->\n| `three` | [four](five.md) |\n| --- | --- |\n\n- six\n"
    assert words(text) == ["One", "two", "`three`", "[four](five.md)", "six"]
