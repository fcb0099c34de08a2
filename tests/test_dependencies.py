"""What is installed with ISPOM: each package has its reason and is used, and the page about extras has all of them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
MODULES = {
    "markdown-it-py": "markdown_it",
    "open3d-cpu": "open3d",
    "opencv-python-headless": "cv2",
    "pillow": "PIL",
    "pyyaml": "yaml",
    "rerun-sdk": "rerun",
}
"""Modules that are not called as their package is."""
BY_NAME = {"open3d": "ispom/io/meshes.py", "rerun_notebook": "app/views/web/rerun_assets.py"}
"""Modules that are looked up by their name in this file, and imported nowhere."""


def names(requirements: list[str]) -> list[str]:
    return [Requirement(each).name for each in requirements]


def rows(page: str, heading: str) -> dict[str, list[str]]:
    """The cells of a table's rows by the first one; the table is the first below a heading."""
    text = (ROOT / page).read_text(encoding="utf-8").partition(f"\n## {heading}\n")[2]
    lines = re.findall(r"^\|(.+)\|$", text.partition("\n## ")[0], re.MULTILINE)
    cells = [[cell.strip() for cell in line.split(" | ")] for line in lines[2:]]
    return {first.strip("`"): rest for first, *rest in cells}


def test_each_dependency_has_its_reason() -> None:
    reasons = rows("CONTRIBUTING.md", "Dependencies")
    assert list(reasons) == names(PROJECT["dependencies"])
    assert all(len(cells) == 1 and len(cells[0].split()) > 2 for cells in reasons.values())


def test_each_dependency_is_used() -> None:
    sources = [
        path.read_text(encoding="utf-8") for folder in ("ispom", "app") for path in (ROOT / folder).rglob("*.py")
    ]
    used = set(re.findall(r"^ *(?:import|from) (\w+)", "\n".join(sources), re.MULTILINE))
    for name in names(PROJECT["dependencies"]):
        module = MODULES.get(name, name.replace("-", "_"))
        file = BY_NAME.get(module)
        assert module in used if file is None else f'"{module}"' in (ROOT / file).read_text(encoding="utf-8"), name


def test_the_page_about_extras_has_all_of_them() -> None:
    extras = rows("docs/howto/install_extras.md", "Extras")
    assert extras.keys() == PROJECT["optional-dependencies"].keys() - {"test", "docs", "check"}
    fusion = re.split(r", | and ", extras["fusion"][0])
    assert fusion == names(PROJECT["optional-dependencies"]["fusion"])


def test_what_an_extra_brings_is_no_dependency() -> None:
    extras = PROJECT["optional-dependencies"]
    brought = {name for key in extras.keys() - {"all", "test", "docs", "check"} for name in names(extras[key])}
    assert brought.isdisjoint(names(PROJECT["dependencies"])) and brought <= set(names(extras["test"]))
