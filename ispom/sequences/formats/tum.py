"""TUM style: one camera's `rgb.txt`, `camera.yaml`, and perhaps `groundtruth.txt` (world_from_camera).

Spaces or commas are between time and file; times are seconds, or in another unit in which they are dates.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.pose_table import split_line, times_in
from ispom.io.rows import Row, read_text
from ispom.sequences.formats.folder import read_settings, settings_in
from ispom.sequences.guess import guess_of_photo, size_of_photo
from ispom.sequences.images import read_image, require_size, those_there
from ispom.sequences.orientation import common_orientation
from ispom.sequences.recording import Recording, Side
from ispom.sequences.sensors_beside import sensors_beside
from ispom.sequences.sidecars import not_used, truth_of_images, used
from ispom.types import Found, Image


def looks_like_tum(folder: Path) -> bool:
    """Checks whether a folder has the list of images."""
    return exists(folder / "rgb.txt")


def open_tum(folder: Path, calibration: Path | None = None) -> Recording:
    """Returns the recording of a folder. Raises InputError that names the missing or invalid file."""
    listing = folder / "rgb.txt"
    rows = _rows(listing)
    times_ns, unit = times_in(listing, rows, (0,), None)
    if len(bad := np.flatnonzero(np.diff(times_ns) <= 0)):
        line, words = rows[bad[0] + 1]
        raise InputError(f"{listing} line {line}: time {words[0]} is not after the one before: put the lines in order")
    paths = [folder / words[1] for _, words in rows]
    there, notes = those_there(listing, paths)
    notes += () if unit == "s" else (f"{listing}: times are taken as those in {unit}, by their size or interval",)
    times_ns, paths = times_ns[there], [paths[i] for i in there]
    orientation, turned = common_orientation(paths)
    notes += (turned,) if turned else ()
    path = calibration or settings_in(folder)
    guess = None
    if path is None:
        guess, camera = guess_of_photo(paths[0], orientation)
    else:
        camera, _, others = read_settings(path, lambda: size_of_photo(paths[0], orientation))
        notes += others
    size = (camera.width, camera.height)
    require_size(paths[0], size)

    def read(_: Side, i: int) -> Image:
        return read_image(paths[i], size, orientation)

    truth = folder / "groundtruth.txt"
    ground_truth = None
    if exists(truth):
        ground_truth, others = truth_of_images(truth, times_ns, [path.name for path in paths])
        notes += others
    found = used(("lens", path), ("times", listing), ("truth", truth if ground_truth is not None else None))
    found += (*not_used((folder,)), *_acceleration(folder))
    return Recording(
        f"TUM {folder.resolve().name}", camera, None, times_ns, read, ground_truth, notes,
        guess=guess, found=found, sensors=sensors_beside((folder,)),
    )  # fmt: skip


def _acceleration(folder: Path) -> tuple[Found, ...]:
    """Returns the accelerometer of TUM's Kinect, which is not used."""
    path, why = folder / "accelerometer.txt", "is not used: accelerations alone, without a gyroscope, are no IMU"
    return (Found("imu", str(path), False, why),) if exists(path) else ()


def _rows(listing: Path) -> list[Row]:
    """Returns the time and the file of each line, which are separated by spaces or commas; converts backslashes to
    slashes. Raises InputError for an invalid line, and for a file without lines."""
    rows: list[Row] = []
    for line, text in enumerate(read_text(listing).splitlines(), 1):
        words = split_line(text.strip())
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 2:
            raise InputError(f"{listing} line {line} has {len(words)} columns, not 2: correct that line")
        rows.append((line, [words[0], words[1].replace("\\", "/")]))
    if not rows:
        raise InputError(f"{listing} lists no image: restore the file")
    return rows
