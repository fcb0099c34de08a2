"""A folder of images in the order of their names, with `camera.yaml` in it or beside it, or a guess (guess.py).

They may lie in a folder `images` of it, as COLMAP has them.

Times are those of `times.txt` there (one per image, seconds), or follow from `rate_hz` in camera.yaml.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.io.calibrations.recognised import any_camera
from ispom.io.files import exists, is_folder, names
from ispom.io.mapping import read_mapping
from ispom.sequences.guess import guess_of_photo
from ispom.sequences.images import IMAGE_SUFFIXES, read_image, require_size
from ispom.sequences.recording import Recording
from ispom.sequences.stream import Clock, Stream, clock_of, size_of
from ispom.types import Camera, Image

CAMERA, TIMES, INNER = "camera.yaml", "times.txt", "images"
CAMERA_ENTRIES = "width, height, fx, fy, cx, cy [px] and, where known, distortion and rate_hz"


def holds_images(folder: Path) -> bool:
    """Whether there are images right in it."""
    return is_folder(folder) and any(_is_image(name) for name in names(folder))


def looks_like_images(folder: Path) -> bool:
    """Whether there are images right in it, or in its `images`."""
    return holds_images(folder) or holds_images(folder / INNER)


def open_folder(given: Path, calibration: Path | None = None) -> Recording:
    """The recording of a folder of images; InputError names the file that is missing or wrong."""
    folder = given if holds_images(given) else given / INNER
    places = [folder / CAMERA, folder.resolve().parent / CAMERA]
    path = calibration or next((place for place in places if exists(place)), None)
    guess = None
    if path is None:
        guess, camera = guess_of_photo(folder / min(filter(_is_image, names(folder)), key=_order))
        clock = Clock()
    else:
        camera, content = read_settings(path)
        clock = clock_of(path, content)
    beside = path.parent if path is not None and calibration is None else folder.resolve().parent
    times = next((place / TIMES for place in (folder, beside) if exists(place / TIMES)), None)
    if times is not None and clock.times is None:
        clock = Clock(times, None, clock.offset_s)
    stream = folder_stream(folder, size_of(camera), clock)
    name = f"images {given.resolve().name}"
    return Recording(name, camera, None, stream.times_ns, lambda _, i: stream.read(i), None, stream.notes, guess=guess)


def read_settings(path: Path) -> tuple[Camera, dict[Any, Any]]:
    """The camera of a camera.yaml or of another program's file, and all that the file says."""
    return any_camera(path), read_mapping(path) if path.suffix.lower() != ".txt" else {}


def folder_stream(folder: Path, size: tuple[int, int], clock: Clock) -> Stream:
    """The images (width, height) of a folder in the order of their names, 2 before 10."""
    paths = [folder / name for name in sorted(filter(_is_image, names(folder)), key=_order)]
    if not paths:
        raise InputError(f"{folder} holds no image: give a folder of {', '.join(sorted(IMAGE_SUFFIXES))} files")
    require_size(paths[0], size)
    times_ns, note = clock.times_ns(folder, len(paths))

    def read(i: int) -> Image:
        return read_image(paths[i], size)

    return Stream(times_ns, read, (note,) if note else ())


def _is_image(name: str) -> bool:
    """Hidden files are those that other systems leave beside the real ones."""
    return Path(name).suffix.lower() in IMAGE_SUFFIXES and not name.startswith(".")


def _order(name: str) -> tuple[tuple[int, str], ...]:
    """Numbers in the name by value; every second part of the split is a number."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((int(part), part) if i % 2 else (0, part) for i, part in enumerate(parts))
