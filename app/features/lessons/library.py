"""The lessons that there are: those that come with ISPOM, and one's own files."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import expanded
from ispom.io.rows import read_text

from .lesson import Lesson
from .lesson_file import read_lesson
from .progress import Progress

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


def own_lesson(given: str) -> Lesson | None:
    """Of a Markdown file; None where what is given is the name of another lesson. InputError for a wrong file."""
    path = expanded(given)
    return read_lesson(path.stem, read_text(path, MAX_BYTES)) if path.suffix == ".md" else None
