"""Reads poses of all known dialects, recognised by their content."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.io.files import exists, is_folder
from ispom.io.poses import dialects
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import TrajectoryFile

IN_FOLDER = ("images.bin", "images.txt", "transforms.json")
"""Files of poses that are looked for in a folder."""


def read_trajectory(path: Path, times_ns: NDArray[np.int64] | None = None) -> TrajectoryFile:
    """Reads at least one pose; `times_ns` are those of the rows of a file without times. Every line is used, also of a
    repeated time. The path may be `BAG:TOPIC`.

    Raises InputError that names file and line of a mistake.
    """
    return dialects.read(content_of(path), times_ns)


def content_of(path: Path) -> PoseContent:
    """Returns the content of a path on the command line: for a folder, its file of poses; for `BAG:TOPIC`, the bag."""
    topic = ""
    if ":/" in str(path) and not exists(path):
        name, _, topic = str(path).partition(":/")
        path, topic = Path(name), f"/{topic}"
    if is_folder(path):
        path = next((path / name for name in IN_FOLDER if exists(path / name)), path)
    return PoseContent(path, topic)
