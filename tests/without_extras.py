"""A Python in which the packages of the extras cannot be found, as after the README's installation."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
HIDE = """
import sys

class Visible:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, path=None, target=None):
        hidden = name.partition(".")[0] in HIDDEN
        return None if hidden else self.finder.find_spec(name, path, target)

sys.meta_path[:] = [Visible(finder) for finder in sys.meta_path]
"""


def hidden_modules() -> frozenset[str]:
    """Top-level modules that only extras bring: all that `optional-dependencies` lists, with what those need, without
    what the project itself needs."""
    base = _with_needs(PROJECT["dependencies"])
    optional = _with_needs(each for extra in PROJECT["optional-dependencies"].values() for each in extra)
    only = optional - base - {_plain(PROJECT["name"])}
    found = {m for m, distributions in packages_distributions().items() if only.issuperset(map(_plain, distributions))}
    return frozenset(found | {name.replace("-", "_") for name in only})  # some wheels do not list their modules


def hide_extras(folder: Path) -> dict[str, str]:
    """The environment for a Python without extras, and for those that it starts; `folder` is for what hides them."""
    (folder / "sitecustomize.py").write_text(f"HIDDEN = {sorted(hidden_modules())!r}\n{HIDE}")
    return {"PYTHONPATH": str(folder)}


def _with_needs(requirements: Iterable[str]) -> set[str]:
    found, waiting = set[tuple[str, str]](), [Requirement(each) for each in requirements]
    while waiting:
        requirement = waiting.pop()
        for extra in ("", *requirement.extras):
            key = _plain(requirement.name), extra
            if key in found or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
                continue
            found.add(key)
            for each in map(Requirement, _requires(requirement.name)):
                wanted = each.marker is None or each.marker.evaluate({"extra": extra})
                if wanted and _plain(each.name) != _plain(PROJECT["name"]):
                    each.marker = None
                    waiting.append(each)
    return {name for name, _ in found}


def _requires(name: str) -> list[str]:
    if _plain(name) == _plain(PROJECT["name"]):
        return []  # its extras are listed one by one
    try:
        return requires(name) or []
    except PackageNotFoundError:
        return []


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
