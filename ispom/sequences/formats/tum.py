"""TUM style: one camera's `rgb.txt`, `camera.yaml`, and perhaps `groundtruth.txt` (world_from_camera)."""

from __future__ import annotations

from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.rows import increasing_times_ns, read_rows
from ispom.io.trajectories import read_tum
from ispom.sequences.formats.folder import read_settings, settings_in
from ispom.sequences.guess import guess_of_photo, size_of_photo
from ispom.sequences.images import read_image, require_size, those_there
from ispom.sequences.matching import no_truth_note, truth_at
from ispom.sequences.orientation import common_orientation
from ispom.sequences.recording import Recording, Side
from ispom.types import Image


def looks_like_tum(folder: Path) -> bool:
    """Whether the list of images is there."""
    return exists(folder / "rgb.txt")


def open_tum(folder: Path, calibration: Path | None = None) -> Recording:
    """The recording of a folder; InputError names the file that is missing or wrong."""
    listing = folder / "rgb.txt"
    rows = read_rows(listing, 2)
    if not rows:
        raise InputError(f"{listing} lists no image: restore the file")
    times_ns = increasing_times_ns(listing, rows)
    paths = [folder / words[1] for _, words in rows]
    there, notes = those_there(listing, paths)
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
        ground_truth = truth_at(read_tum(truth, "left"), times_ns)
        notes += no_truth_note(truth, ground_truth)
    return Recording(f"TUM {folder.resolve().name}", camera, None, times_ns, read, ground_truth, notes, guess=guess)
