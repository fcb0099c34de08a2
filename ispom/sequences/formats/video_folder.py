"""A folder with one video file and no other recording: the file is opened (video.py)."""

from __future__ import annotations

import os
import re
from pathlib import Path

from ispom.io.files import exists, is_folder, names
from ispom.sequences.formats.bags import BAG_SUFFIXES
from ispom.sequences.formats.video import looks_like_video, open_video
from ispom.sequences.images import IMAGE_SUFFIXES
from ispom.sequences.recording import Recording

_CHAPTER = re.compile(r"G[HXL](\d\d)(\d{4})\.[A-Z0-9]+|G(OPR|P\d\d)(\d{4})\.[A-Z0-9]+")
"""GoPro's names: kind, chapter, film; and those of older cameras, whose first chapter is GOPR."""
OTHERS = IMAGE_SUFFIXES | BAG_SUFFIXES
"""Suffixes of other files that are recordings or parts of one."""
RUNS, MARKS = "recordings", ("run.yaml", "INCOMPLETE")
"""The default folder of `ispom run`, and a file in the folder of each run."""


def video_in(folder: Path) -> Path | None:
    """Returns the only video file of a folder, which may also contain a calibration, texts and runs of the video; None
    for a folder with images, bags or other folders."""
    inside = [folder / name for name in names(folder) if not name.startswith(".")] if is_folder(folder) else []
    videos = [path for path in inside if looks_like_video(path)]
    return videos[0] if len(videos) == 1 and not any(map(_is_another, inside)) else None


def chapters_in(folder: Path) -> list[str]:
    """Returns the names of the chapters of one film of an action camera, in their order; empty for other videos."""
    films = [name for name in names(folder) if looks_like_video(Path(name))] if is_folder(folder) else []
    matches = [_CHAPTER.fullmatch(name.upper()) for name in films]
    numbers = {match[2] or match[4] for match in matches if match is not None}
    if len(films) < 2 or None in matches or len(numbers) != 1:
        return []
    return sorted(films, key=lambda name: (not name.upper().startswith("GOPR"), name.upper()))


def join_line(chapters: list[str]) -> str:
    """Returns the command that joins the chapters without decoding them."""
    listed = "\\n".join(f"file '{name}'" for name in chapters)
    return f'printf "{listed}\\n" > chapters.txt; ffmpeg -f concat -i chapters.txt -c copy whole.mp4'


def looks_like_video_folder(folder: Path) -> bool:
    """Checks whether the only recording in a folder is one video."""
    return video_in(folder) is not None


def open_video_folder(folder: Path, calibration: Path | None = None) -> Recording:
    """Returns the recording of its video. Raises InputError as `open_video`."""
    return open_video(video_in(folder) or folder, calibration)


def _is_another(path: Path) -> bool:
    return path.suffix.lower() in OTHERS or (os.path.isdir(path) and not _holds_runs(path))


def _holds_runs(folder: Path) -> bool:
    return folder.name == RUNS or any(exists(folder / mark) for mark in MARKS)
