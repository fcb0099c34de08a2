"""How far somebody came in each lesson, kept for the user between starts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...engine.user_files import read_json, write_json


class Progress:
    """In a file of the user's own; without one (None), it is forgotten at the end."""

    def __init__(self, path: Path | None) -> None:
        self._path, found = path, read_json(path)
        pairs = found.items() if isinstance(found, dict) else ()
        self.steps: Mapping[str, int] = {name: steps for name, steps in pairs if type(steps) is int}
        """By lesson: the steps whose answer was revealed, counted from the first on."""

    def reached(self, lesson: str, steps: int) -> Mapping[str, int]:
        """Kept where it is more than before; where the file cannot be written, only until the end."""
        if steps > self.steps.get(lesson, 0):
            self.steps = {**self.steps, lesson: steps}
            write_json(self._path, self.steps, "progress in lessons is")
        return self.steps
