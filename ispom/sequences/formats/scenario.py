"""A simulated scene with faults, as a YAML file: `scene: city`, and what docs/reference/scenarios.md lists."""

from __future__ import annotations

from pathlib import Path

from ispom.io.files import is_folder
from ispom.io.mapping import read_mapping
from ispom.types import Sequence


def looks_like_scenario(path: Path) -> bool:
    """Whether it is a YAML file that names a scene; InputError for one that is not valid."""
    return not is_folder(path) and path.suffix.lower() in (".yaml", ".yml") and "scene" in read_mapping(path)


def open_scenario(path: Path, seed: int) -> Sequence:
    """With the seed that the file names, or else this one; InputError where the file is wrong."""
    from ispom.sequences.formats.simulated import open_scenario_file  # brings the simulation, which takes seconds

    return open_scenario_file(path, seed)
