"""The lessons that there are: those that come with ISPOM, and one's own files."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import expanded
from ispom.io.rows import read_text

from ...engine.user_files import read_json, write_json
from .lesson import Lesson
from .lesson_file import read_lesson


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


MAX_BYTES = 256 << 10
ORDER = (
    "scale",
    "rotation",
    "collapse",
    "bundle",
    "stereo",
    "integration",
    "clock",
    "calibration",
    "outliers",
    "errors",
    "table1",
    "intensities",
    "view",
    "sensors",
)
"""As they build on each other."""


class Library:
    """`lessons` in their order; `own`, where there is one, comes first."""

    def __init__(self, own: Lesson | None = None, progress: Path | None = None) -> None:
        """`progress` is the file that keeps how far somebody came."""
        others = (lesson for lesson in built_in() if own is None or lesson.name != own.name)
        self.lessons = (*filter(None, (own,)), *others)
        self.progress = Progress(progress)

    def lesson(self, name: str) -> Lesson:
        """InputError where there is none of this name."""
        found = next((lesson for lesson in self.lessons if lesson.name == name), None)
        if found is None:
            known = ", ".join(lesson.name for lesson in self.lessons)
            raise InputError(f"there is no lesson {name[:60]!r}: choose from {known}, or give a Markdown file")
        return found


@cache
def built_in() -> tuple[Lesson, ...]:
    """Those that come with ISPOM."""
    folder = files(__name__.rpartition(".")[0]).joinpath("lessons")
    texts = {Path(file.name).stem: file.read_text(encoding="utf-8") for file in folder.iterdir()}
    return tuple(read_lesson(name, texts[name]) for name in ORDER if name in texts)


def own_lesson(lesson_path: str) -> Lesson | None:
    """Of a Markdown file; None where what is given is the name of another lesson. InputError for a wrong file."""
    path = expanded(lesson_path)
    return read_lesson(path.stem, read_text(path, MAX_BYTES)) if path.suffix == ".md" else None
