"""What lies beside a recording that is no run's: a picture, and in NAME.notes.yaml what it is of, with notes."""

from __future__ import annotations

import logging
from pathlib import Path

from ispom.errors import InputError
from ispom.io.whole import replace_whole

from ...engine.events import Bookmark, Opened
from ...engine.run_folder.thumbnail import thumbnail
from ..bookmarks.notes import notes_of, put

log = logging.getLogger(__name__)


def picture_of(recording: Path) -> Path:
    return recording.with_suffix(".jpg")


def write_companions(recording: Path, opened: Opened, count: int, bookmarks: tuple[Bookmark, ...]) -> None:
    """Of a recording of a run's first `count` frames. Where the disk does not take them, it goes without."""
    times_ns = opened.sequence.times_ns[:count]
    duration_s = round(float(times_ns[-1] - times_ns[0]) * 1e-9, 3) if len(times_ns) else 0.0
    about = {"source": opened.sequence.name, "exposures": count, "duration_s": duration_s}
    try:
        put(notes_of(recording), about=about, bookmarks=bookmarks)
        if picture := thumbnail(opened.sequence, count):
            replace_whole(picture_of(recording), picture)
    except (InputError, OSError) as fault:
        log.warning("%s has no picture or notes: %s", recording, fault)
