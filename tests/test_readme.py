"""The README is short; its commands are those of the checks, each a single line that sets up all it needs."""

import re
import tomllib
from pathlib import Path

from tests.docs.test_pages import module

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


def test_its_badges_say_what_the_project_says() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    badges = module(ROOT / "docs" / "badges.py")
    lines = re.findall(r"\[!\[(.+?): (.+?)\]\(docs/badges/(\S+?)\)\]\((\S+?)\)", (ROOT / "README.md").read_text())
    assert {file: (name, value) for name, value, file, _ in lines} == badges.badges(project)
    assert all((ROOT / target).is_file() for *_, target in lines)
    assert project["license"] == "MIT" and (ROOT / "LICENSE").read_text().startswith("MIT License")
    for file, text in badges.files().items():
        assert (badges.FOLDER / file).read_text(encoding="utf-8") == text, "run python docs/badges.py"


def test_a_badge_follows_the_classifiers() -> None:
    lines = [f"Programming Language :: Python :: 3{minor}" for minor in ("", ".9", ".10")]
    found = module(ROOT / "docs" / "badges.py").badges({"classifiers": lines, "license": "BSD-3-Clause"})
    assert found == {"python.svg": ("Python", "3.9 to 3.10"), "licence.svg": ("licence", "BSD-3-Clause")}


def test_no_badge_names_an_address_that_the_project_does_not() -> None:
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"].values()
    for address in re.findall(r"\[!\[[^\]]*\]\((https?:\S+?)\)", (ROOT / "README.md").read_text()):
        assert any(address.startswith(url) for url in urls), address
