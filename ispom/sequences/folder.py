"""A folder of images in the order of their names, with `camera.yaml` in it or beside it.

Times are those of `times.txt` there (one per image, seconds), or follow from `rate_hz` in camera.yaml.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.io.camera import read_camera
from ispom.io.mapping import read_mapping
from ispom.sequences.images import IMAGE_SUFFIXES, read_image
from ispom.sequences.recording import Recording
from ispom.sequences.stream import Clock, Stream, clock_of, size_of
from ispom.types import Camera, Image

CAMERA, TIMES = "camera.yaml", "times.txt"
CAMERA_ENTRIES = "width, height, fx, fy, cx, cy [px] and, where known, distortion and rate_hz"


def looks_like_images(folder: Path) -> bool:
    """Whether there are images right in it."""
    try:
        return folder.is_dir() and any(_is_image(path) for path in folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror}): check its permissions") from None


def open_folder(folder: Path, calibration: Path | None = None) -> Recording:
    """The recording of a folder of images; InputError names the file that is missing or wrong."""
    places = [folder / CAMERA, folder.resolve().parent / CAMERA]
    path = calibration or next((place for place in places if place.exists()), None)
    if path is None:
        raise InputError(f"{places[0]} is missing: write one with {CAMERA_ENTRIES}")
    camera, content = read_settings(path)
    clock = clock_of(path, content)
    beside = path.parent if calibration is None else folder.resolve().parent
    times = next((place / TIMES for place in (folder, beside) if (place / TIMES).exists()), None)
    if times is not None and clock.times is None:
        clock = Clock(times, None, clock.offset_s)
    stream = folder_stream(folder, size_of(camera), clock)
    name = f"images {folder.resolve().name}"
    return Recording(name, camera, None, stream.times_ns, lambda _, i: stream.read(i), None, stream.notes)


def read_settings(path: Path) -> tuple[Camera, dict[Any, Any]]:
    """The camera of a camera.yaml, and all that the file says."""
    return read_camera(path), read_mapping(path)


def folder_stream(folder: Path, size: tuple[int, int], clock: Clock) -> Stream:
    """The images (width, height) of a folder in the order of their names, 2 before 10."""
    paths = sorted((p for p in folder.iterdir() if _is_image(p)), key=lambda p: _order(p.name))
    if not paths:
        raise InputError(f"{folder} holds no image: give a folder of {', '.join(sorted(IMAGE_SUFFIXES))} files")
    times_ns, note = clock.times_ns(folder, len(paths))

    def read(i: int) -> Image:
        return read_image(paths[i], size)

    return Stream(times_ns, read, (note,) if note else ())


def _is_image(path: Path) -> bool:
    """By its name; hidden files are those that other systems leave beside the real ones."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")


def _order(name: str) -> tuple[tuple[int, str], ...]:
    """Numbers in the name by value; every second part of the split is a number."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((int(part), part) if i % 2 else (0, part) for i, part in enumerate(parts))
