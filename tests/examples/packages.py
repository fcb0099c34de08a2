"""Examples as installed packages: in a folder as pip writes one, which only processes of the tests know."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"


def install(folder: Path, *names: str) -> Path:
    """Returns the folder of packages, with these examples in it."""
    for name in names:
        example = EXAMPLES / name
        project = tomllib.loads((example / "pyproject.toml").read_text())
        described = project["project"]
        for module in project["tool"]["setuptools"]["py-modules"]:
            (folder / f"{module}.py").write_bytes((example / f"{module}.py").read_bytes())
        info = folder / f"{described['name'].replace('-', '_')}-{described['version']}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {described['name']}\nVersion: {described['version']}\n"
        )
        points = described["entry-points"].items()
        lines = [f"[{g}]\n" + "".join(f"{k} = {v}\n" for k, v in entries.items()) for g, entries in points]
        (info / "entry_points.txt").write_text("\n".join(lines))
    return folder


def python(installed: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs Python as a person who has installed them; the tests' own process knows nothing of them."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200, check=False)


def ispom(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs the program in a process of its own."""
    command = [sys.executable, "-m", "ispom_app", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
