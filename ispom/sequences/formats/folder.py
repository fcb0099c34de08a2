"""A folder of images in the order of their names, with `camera.yaml` in it or next to it, or a guess (guess.py).

They may lie in a folder `images`, `rgb`, `color` ... of it. Other programs' calibrations, times and poses beside
them are used, too (sidecars.py).

Times are those of `times.txt` there (one per image, seconds), or follow from `rate_hz` in camera.yaml and the numbers
in the names, of which some may be missing; without a rate, names that are times count (named.py). Images in formats
that are not read count as missing.
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
CAMERA_ENTRIES = "width, height, fx, fy, cx, cy [px] and, where known, distortion and rate_hz"


def holds_images(folder: Path) -> bool:
    """Whether there are images right in it."""
    return is_folder(folder) and any(_is_image(name) for name in names(folder))


def first_image(folder: Path) -> Path | None:
    """The image right in it whose name comes first in the alphabet; None where there is none."""
    found = min((name for name in names(folder) if _is_image(name)), default=None)
    return None if found is None else folder / found


def looks_like_images(folder: Path) -> bool:
    """Whether there are images right in it, or in its `images` and the like."""
    return images_in(folder) is not None


def open_folder(source: Path, calibration: Path | None = None) -> Recording:
    """The recording of a folder of images; InputError names the file that is missing or wrong."""
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
    name = f"images {source.resolve().name}"
    truth, from_where, of_truth = truth_beside(places, stream.times_ns, images.names)
    notes = tuple(note for note in (*notes, *stream.notes, *from_where, position_note(paths[0])) if note)
    found = (*used(("lens", path), ("times", clock.times)), *found, *of_truth, *not_used(places))
    return Recording(
        name, camera, None, stream.times_ns, lambda _, i: stream.read(i), truth, notes,
        guess=guess, found=found, sensors=discovered_sensors(places),
    )  # fmt: skip


def images_in(source: Path) -> Path | None:
    """Returns the folder itself, where it holds images, or else the first in it that is called as such folders are."""
    return next((place for place in (source, *(source / name for name in INNER)) if holds_images(place)), None)


def is_calibration(path: Path) -> bool:
    """Checks that a file has the camera of images, whose size it may lack. Raises InputError where it has none."""
    return one_camera(path, lambda: (640, 480))[0].width > 0


def settings_in(folder: Path, name: str = CAMERA) -> Path | None:
    """The camera's file in a folder, by its `name` or with OpenCV's suffix .yml; None without one."""
    places = [(folder / name).with_suffix(suffix) for suffix in (".yaml", ".yml")]
    return next((place for place in places if exists(place)), None)


def read_settings(
    path: Path, size: Callable[[], tuple[int, int]] | None = None
) -> tuple[Camera, Clock, tuple[str, ...]]:
    """The camera of a camera.yaml or of another program's file, the clock of its images, and notes: about entries of a
    camera.yaml that are not known, as a misspelt one would go unnoticed, and about values that are likely wrong.

    `size` gives that (width, height) of the images: it counts where the file has none, and the camera is scaled to them
    where that is allowed (see `fitted`).
    """
    camera, entries, notes = one_camera(path, size)
    if size is None:
        return camera, clock_of(path, entries), notes
    camera, scaled = fitted(path, camera, size())
    return camera, clock_of(path, entries), (*notes, *scaled)


def named_images(folder: Path, one_size: bool = False) -> Named:
    """The images of a folder in their order; InputError where there is none, or where they are of several kinds.

    Those of `one_size` are the largest group of images of the same size: no camera is known that says which to take.
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
    """The images in a folder whose format is not read, such as those of iPhones (HEIC)."""
    return [name for name in names(folder) if _suffix(name) in UNREAD_SUFFIXES]


def _unread_note(folder: Path, images: Named) -> str:
    """How many images of other formats lie between those that are read."""
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
    """The `images` (width, height) of a folder, at `ticks` (N,) of the clock's rate where these are not those of the
    images alone, and stamps counted from since_ns."""
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
    """Hidden files are those that other systems write next to the real ones."""
    return _suffix(name) in IMAGE_SUFFIXES


def _suffix(name: str) -> str:
    """In lower case; "" of a hidden file."""
    return "" if name.startswith(".") else Path(name).suffix.lower()
