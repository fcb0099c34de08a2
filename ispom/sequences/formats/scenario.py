"""A simulated scene with faults, as a YAML file: `scene: city`, and what docs/reference/scenarios.md lists."""

from __future__ import annotations

from pathlib import Path

from ispom.io.files import is_folder
from ispom.io.mapping import read_mapping
from ispom.types import Sequence


def looks_like_scenario(path: Path) -> bool:
    """Checks whether a path is a YAML file that names a scene. Raises InputError for an invalid file."""
    return not is_folder(path) and path.suffix.lower() in (".yaml", ".yml") and "scene" in read_mapping(path)


def open_scenario(path: Path, seed: int) -> Sequence:
    """Opens a scenario with the seed of the file, or else with `seed`. Raises InputError for an invalid file."""
    from ispom.sequences.formats.simulated import open_scenario_file  # imports the simulation, which takes seconds

    return open_scenario_file(path, seed)
