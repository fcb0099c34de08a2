"""A folder of images in the order of their names, with a `camera.yaml` in it or next to it, or a guess (guess.py).

The images may be in a subfolder `images`, `rgb`, `color` ... Calibrations, times and poses of other programs next to
them are also used (sidecars.py).

Times are those of `times.txt` (one per image, seconds), or follow from `rate_hz` in camera.yaml and the numbers in the
names, of which some may be missing. Without a rate, names that are times are used (named.py). Images in unsupported
formats are treated as missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, counted
from ispom.io.calibrations.recognised import one_camera
from ispom.io.files import exists, is_folder, names
from ispom.plausibility.images import transparency_doubts
from ispom.sequences.guess import guess_of_photo, position_note, size_of_photo
from ispom.sequences.images import IMAGE_SUFFIXES, UNREAD_SUFFIXES, opacities, read_image, require_size, same_size
from ispom.sequences.named import Named, named, ticks_of
from ispom.sequences.orientation import common_orientation
from ispom.sequences.recording import Recording
from ispom.sequences.sensor_discovery import discovered_sensors
from ispom.sequences.sidecars import INNER, calibration_beside, first_of, not_used, places_of, truth_beside, used
from ispom.sequences.sidecars import TIMES as ALL_TIMES
from ispom.sequences.stream import Clock, Stream, clock_of, fitted, size_of
from ispom.types import Camera, Found, Image

CAMERA, TIMES = "camera.yaml", "times.txt"
OTHER_TIMES = tuple(name for name in ALL_TIMES if name != TIMES)


def holds_images(folder: Path) -> bool:
    """Checks whether a folder contains images, not counting subfolders."""
    return is_folder(folder) and any(_is_image(name) for name in names(folder))


def first_image(folder: Path) -> Path | None:
    """Returns the first image of a folder in alphabetical order; None where there is none."""
    found = min((name for name in names(folder) if _is_image(name)), default=None)
    return None if found is None else folder / found


def looks_like_images(folder: Path) -> bool:
    """Checks whether a folder contains images, or a subfolder such as `images` does."""
    return images_in(folder) is not None


def open_folder(source: Path, calibration: Path | None = None) -> Recording:
    """Returns the recording of a folder of images. Raises InputError that names the missing or invalid file."""
    folder = images_in(source) or source
    places = places_of(folder)
    path = calibration or settings_in(folder) or settings_in(folder.resolve().parent)
    found: tuple[Found, ...] = ()
    if path is None:
        path, found = calibration_beside(places, is_calibration)
    guess, images = None, named_images(folder, path is None)
    paths = [folder / name for name in images.names]
    if path is None:
        guess, camera = guess_of_photo(folder / images.names[0], common_orientation(paths)[0])
        clock, notes = Clock(), ()
    else:
        camera, clock, notes = read_settings(path, lambda: size_of_photo(paths[0], common_orientation(paths)[0]))
    parent = path.parent if path is not None and calibration is None else folder.resolve().parent
    times = next((place / TIMES for place in (folder, parent) if exists(place / TIMES)), None)
    times = times or first_of(places, OTHER_TIMES)
    if times is not None and clock.times is None:
        clock = Clock(times, None, clock.offset_s)
    stream = folder_stream(folder, size_of(camera), clock, images)
    name = f"images {_called(source.resolve())}"
    truth, from_where, of_truth = truth_beside(places, stream.times_ns, images.names)
    notes = tuple(note for note in (*notes, *stream.notes, *from_where, position_note(paths[0])) if note)
    found = (*used(("lens", path), ("times", clock.times)), *found, *of_truth, *not_used(places))
    return Recording(
        name, camera, None, stream.times_ns, lambda _, i: stream.read(i), truth, notes,
        guess=guess, found=found, sensors=discovered_sensors(places),
    )  # fmt: skip


def _called(folder: Path) -> str:
    """Returns the name of a recording's folder: `images` and the like say nothing, and the folder around does."""
    return folder.parent.name if folder.name in INNER and folder.parent.name else folder.name


def images_in(source: Path) -> Path | None:
    """Returns the folder itself, if it contains images, or else its first subfolder with a usual name; None without."""
    return next((place for place in (source, *(source / name for name in INNER)) if holds_images(place)), None)


def is_calibration(path: Path) -> bool:
    """Checks that a file contains a camera; its image size may be missing. Raises InputError where it has none."""
    return one_camera(path, lambda: (640, 480))[0].width > 0


def settings_in(folder: Path, name: str = CAMERA) -> Path | None:
    """Returns the camera's file in a folder, by its `name` or with OpenCV's suffix .yml; None without one."""
    places = [(folder / name).with_suffix(suffix) for suffix in (".yaml", ".yml")]
    return next((place for place in places if exists(place)), None)


def read_settings(
    path: Path, size: Callable[[], tuple[int, int]] | None = None
) -> tuple[Camera, Clock, tuple[str, ...]]:
    """Returns the camera of a camera.yaml or of another program's file, the clock of its images, and notes.

    The notes are about unknown entries of a camera.yaml, which may be misspelt, and about values that are likely wrong.
    `size` returns (width, height) of the images, which is used where the file has none; the camera is scaled to it
    where that is allowed (see `fitted`).
    """
    camera, entries, notes = one_camera(path, size)
    if size is None:
        return camera, clock_of(path, entries), notes
    camera, scaled = fitted(path, camera, size())
    return camera, clock_of(path, entries), (*notes, *scaled)


def named_images(folder: Path, one_size: bool = False) -> Named:
    """Returns the images of a folder in their order. Raises InputError where there is none, or where they are of
    several kinds.

    With `one_size`, only the largest group of images of the same size: for images without a camera, which would define
    it.
    """
    image_names = [name for name in names(folder) if _is_image(name)]
    if not image_names:
        raise InputError(f"{folder} holds no image: give a folder of {', '.join(sorted(IMAGE_SUFFIXES))} files")
    image_names = without_depth(image_names)
    taken, note = same_size([folder / name for name in image_names]) if one_size else (image_names, "")
    others = sorted(set(image_names) - set(taken))
    try:
        images = named(taken, [*unread_images(folder), *others])
    except InputError as fault:
        raise InputError(f"{folder}: {fault.args[0]}") from None
    return replace(images, notes=(*images.notes, note)) if note else images


def without_depth(image_names: list[str]) -> list[str]:
    """Returns the names without depth images, such as those that Replica has in one folder with the colours."""
    depth = [name for name in image_names if name.lower().startswith("depth")]
    return image_names if len(depth) == len(image_names) else [name for name in image_names if name not in set(depth)]


def unread_images(folder: Path) -> list[str]:
    """Returns the images in a folder whose format is not read, such as those of iPhones (HEIC)."""
    return [name for name in names(folder) if _suffix(name) in UNREAD_SUFFIXES]


def _unread_note(folder: Path, images: Named) -> str:
    """Returns a note about images in unsupported formats among the others; "" without any."""
    unread = unread_images(folder)
    read = {Path(name).stem.lower() for name in images.names}
    alone = [name for name in unread if Path(name).stem.lower() not in read]
    kinds = ", ".join(sorted({_suffix(name) for name in alone or unread}))
    if alone:
        gaps = "" if images.unread is None else "; their numbers are gaps in time"
        return (
            f"{folder}: {counted(len(alone), 'image')} in formats that are not read ({kinds}) skipped{gaps}: convert "
            "them to JPEG or PNG to use them"
        )
    return f"{folder}: {counted(len(unread), 'copy', 'copies')} of the images as {kinds} skipped" if unread else ""


def folder_stream(
    folder: Path,
    size: tuple[int, int],
    clock: Clock,
    images: Named,
    ticks: NDArray[np.int64] | None = None,
    since_ns: int = 0,
) -> Stream:
    """Returns the `images` of a folder, of `size` (width, height), as a stream.

    `ticks` (N,) are the images' numbers at the clock's rate, by default those of the names alone. Times in the names
    are counted from `since_ns`.
    """
    paths = [folder / name for name in images.names]
    require_size(paths[0], size)
    stamps_ns = None if images.stamps_ns is None else images.stamps_ns - since_ns
    ticks = ticks_of(images) if ticks is None else ticks
    times_ns, note = clock.times_ns(folder, len(paths), None, stamps_ns, ticks, images.names)
    if clock.times is None and (clock.rate_hz is not None or stamps_ns is None):
        skipped = int(ticks[-1] - ticks[0]) + 1 - len(ticks)
        missing = counted(skipped, "number is", "numbers are")
        gaps = f"{folder}: {missing} missing in the names of the images: taken as gaps in time"
        notes = (note, gaps if skipped else "")
    else:
        notes = (note, f"{folder}: times are those in the names of the images" if clock.times is None else "")
    if images.stamps_ns is None and images.numbers is None:
        notes = (*notes, f"{folder}: the names of the images are not numbered in one way: taken in alphabetical order")
    if images.stamps_ns is None or (clock.times is None and clock.rate_hz is None):
        notes = (*notes, *(f"{folder}: {note}" for note in images.notes))
    notes = (*notes, _unread_note(folder, images), *transparency_doubts(str(folder), opacities(paths)))

    orientation, turned = common_orientation(paths)

    def read(i: int) -> Image:
        return read_image(paths[i], size, orientation)

    return Stream(times_ns, read, tuple(text for text in (*notes, turned) if text))


def _is_image(name: str) -> bool:
    """Checks the suffix. Hidden files are no images: other systems write them next to the real ones."""
    return _suffix(name) in IMAGE_SUFFIXES


def _suffix(name: str) -> str:
    """Returns the suffix in lower case; "" for a hidden file."""
    return "" if name.startswith(".") else Path(name).suffix.lower()
