"""The badges of the README, from pyproject.toml: `python docs/badges.py` draws them again.

Badges of checks, of the site and of PyPI need the address of a public repository, which the project does not have yet.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "badges"
LETTER, PAD, HEIGHT = 6.6, 7, 20
"""Width of a letter of 11 px, space beside the text, and height [px]."""
SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" role="img"
 aria-label="{name}: {value}">
<title>{name}: {value}</title>
<rect width="{width}" height="{height}" rx="3" fill="#555"/>
<path d="M{left} 0h{right}a3 3 0 0 1 3 3v14a3 3 0 0 1-3 3h-{right}z" fill="#1f6feb"/>
<g fill="#fff" text-anchor="middle" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11">
<text x="{name_x}" y="14">{name}</text>
<text x="{value_x}" y="14">{value}</text>
</g>
</svg>
"""


def badges(project: dict) -> dict[str, tuple[str, str]]:
    """Returns name and value of each badge, by its file; `project` is that table of pyproject.toml."""
    pattern = re.compile(r"Programming Language :: Python :: 3\.(\d+)$")
    minors = sorted(int(found[1]) for line in project["classifiers"] if (found := pattern.match(line)))
    versions = f"3.{minors[0]}" if len(minors) == 1 else f"3.{minors[0]} to 3.{minors[-1]}"
    return {"python.svg": ("Python", versions), "licence.svg": ("licence", project["license"])}


def drawn(name: str, value: str) -> str:
    """Returns a badge as SVG."""
    left, right = (round(LETTER * len(text) + 2 * PAD) for text in (name, value))
    places = {"name_x": left / 2, "value_x": left + right / 2, "left": left, "right": right - 3}
    return SVG.format(name=name, value=value, width=left + right, height=HEIGHT, **places)


def files() -> dict[str, str]:
    """Returns the content of each file."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {file: drawn(*words) for file, words in badges(project).items()}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for file, text in files().items():
        (FOLDER / file).write_text(text, encoding="utf-8")
