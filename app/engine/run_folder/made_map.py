"""The map that `ispom map` made of a run, where it can be shown."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.rows import read_text
from ispom.methods import names

MAP = "map"
"""The folder in the run's."""
MAP_PREVIEW, MAP_RECORDING, MAP_NUMBERS = "preview.glb", "map.rrd", "map.json"


@dataclass(frozen=True)
class MadeMap:
    method: str
    """In whose world it is."""
    preview: Path
    """A small mesh, glTF."""
    recording: Path
    """Belongs to the run's."""


def made_map(run: Path) -> MadeMap | None:
    """Of a run's folder; None where there is none, or not a whole one."""
    folder = run / MAP
    try:
        if not all(exists(folder / name) for name in (MAP_PREVIEW, MAP_RECORDING, MAP_NUMBERS)):
            return None
        method = json.loads(read_text(folder / MAP_NUMBERS)).get("method")
    except (InputError, ValueError, AttributeError):
        return None
    return MadeMap(method, folder / MAP_PREVIEW, folder / MAP_RECORDING) if method in names() else None
