"""The link of a notebook to Colab. It needs a public repository on GitHub, which pyproject.toml names as Source."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from urllib.parse import quote

ROOT = Path(__file__).parents[2]


def address(name: str, project: dict) -> str | None:
    """Returns where Colab opens a notebook of `examples`, in this version; None where GitHub has no repository."""
    source = project.get("urls", {}).get("Source", "")
    repository = re.fullmatch(r"https://github\.com/([\w.-]+/[\w.-]+?)(\.git)?/?", source)
    if repository is None:
        return None
    path = quote(f"{repository[1]}/blob/v{project['version']}/examples/{name}")
    return f"https://colab.research.google.com/github/{path}"


def this_project() -> dict:
    """Returns the table `project` of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def with_link(text: str, name: str, project: dict) -> str:
    """Returns a notebook with its link below the title; unchanged where there is no address."""
    found = address(name, project)
    if found is None:
        return text
    notebook = json.loads(text)
    title = notebook["cells"][0]["source"]
    title[1:1] = ["\n", f"[Open in Colab]({found})\n"]
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
