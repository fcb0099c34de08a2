"""A simulated scene with faults, as a YAML file: `scene: city`, and what docs/reference/scenarios.md lists."""

from __future__ import annotations

from pathlib import Path

from ispom.io.files import is_folder
from ispom.io.mapping import read_mapping


def looks_like_scenario(path: Path) -> bool:
    """Checks whether a path is a YAML file that names a scene. Raises InputError for an invalid file."""
    return not is_folder(path) and path.suffix.lower() in (".yaml", ".yml") and "scene" in read_mapping(path)
