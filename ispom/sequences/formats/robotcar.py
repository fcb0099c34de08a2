"""Oxford RobotCar: a traversal such as `2014-05-19-13-20-57` with `stereo/left` and `stereo/right`, the wide pair.

The images are raw (Bayer pattern GBRG) and distorted; names are their times in microseconds. They are rectified by the
tables of the data set's SDK, `models/stereo_wide_left.txt` (fx fy cx cy in its first line) and
`stereo_wide_left_distortion_lut.bin` (for each pixel of the rectified image u, and then v, in the raw one, from 0, as
doubles), in the folder `models` in or beside the traversal. Both rectified images have one camera. The baseline is that
of the SDK's camera, 0.239983 m. Positions (`gps`, `vo`) are not used. Written from public documentation: the page
"documentation" of the data set, and its SDK.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ispom.errors import InputError
from ispom.io.camera import usable
from ispom.io.files import exists, read_bytes
from ispom.io.rows import numbers, read_text
from ispom.sequences.formats.folder import holds_images, named_images
from ispom.sequences.guess import size_of_photo
from ispom.sequences.images import read_image
from ispom.sequences.recording import Recording, Side
from ispom.sequences.rectification import Maps, remapped
from ispom.sequences.stereo_stream import level_pair
from ispom.sequences.stream import Stream
from ispom.types import Camera, Image

BASELINE_M = 0.239983
"""Baseline of the wide pair, from the data set's SDK."""
SIDES: tuple[Side, ...] = ("left", "right")
MAX_TABLE_BYTES = 256 << 20
"""Largest size of a table: those of the data set have 20 MB."""


def looks_like_robotcar(folder: Path) -> bool:
    """Checks whether a folder has the left images of the stereo camera, and its list of times or its other images."""
    others = ("stereo.timestamps", "stereo/right", "stereo/centre")
    return holds_images(folder / "stereo" / "left") and any(exists(folder / name) for name in others)


def open_robotcar(folder: Path) -> Recording:
    """Returns the recording of a traversal. Raises InputError that names the missing or invalid file."""
    real = folder.resolve()
    places = [place / "models" for place in (real, real.parent, real.parent.parent)]
    models = next((place for place in places if exists(place / "stereo_wide_left.txt")), None)
    if models is None:
        raise InputError(f"{places[1]} is missing: put the folder models of the data set's SDK there")
    sides: list[Side] = [side for side in SIDES if holds_images(folder / "stereo" / side)]
    cameras = [_camera(models / f"stereo_wide_{side}.txt", _first(folder, side)) for side in sides]
    if cameras[0] != cameras[-1]:
        raise InputError(f"{models}: left and right have not one camera: give the models of the data set's SDK")
    streams: dict[Side, Stream] = {side: _stream(folder, side, models, cameras[0]) for side in sides}
    times_ns, read, notes = level_pair(folder, streams)
    unused = [str(path) for path in (folder / "gps" / "ins.csv", folder / "vo" / "vo.csv") if exists(path)]
    if unused:
        notes += (f"there and not used, as they are not poses of the camera: {', '.join(unused)}",)
    baseline_m = BASELINE_M if "right" in sides else None
    return Recording(f"RobotCar {real.name}", cameras[0], baseline_m, times_ns, read, None, notes)


def _first(folder: Path, side: Side) -> Path:
    inside = folder / "stereo" / side
    return inside / named_images(inside).names[0]


def _camera(path: Path, image: Path) -> Camera:
    words = read_text(path).splitlines()[:1]
    values = numbers(path, 1, words[0].split()) if words else np.empty(0)
    if len(values) != 4:
        raise InputError(f"{path} line 1 has {len(values)} numbers, not fx fy cx cy: give that of the SDK")
    fx, fy, cx, cy = values.tolist()
    return usable(Camera(*size_of_photo(image), fx, fy, cx, cy), str(path))


def _stream(folder: Path, side: Side, models: Path, camera: Camera) -> Stream:
    inside = folder / "stereo" / side
    images, size = named_images(inside), (camera.width, camera.height)
    if images.stamps_ns is None:
        raise InputError(f"{inside}: the names of the images are no times in microseconds: restore them")
    maps = _maps(models / f"stereo_wide_{side}_distortion_lut.bin", size)
    paths = [inside / name for name in images.names]

    def read(i: int) -> Image:
        raw = read_image(paths[i], size)
        colours = raw if raw.ndim == 3 else np.asarray(cv2.cvtColor(raw, cv2.COLOR_BayerGBRG2RGB), np.uint8)
        return remapped(colours, maps)

    return Stream(images.stamps_ns, read)


def _maps(path: Path, size: tuple[int, int]) -> Maps:
    """Reads the position in the raw image of each pixel of the rectified one (width, height)."""
    content = read_bytes(path, MAX_TABLE_BYTES)
    if len(content) != 16 * size[0] * size[1]:
        raise InputError(f"{path} is not for images of {size[0]} x {size[1]}: give that of the SDK")
    values = np.frombuffer(content, "<f8").reshape(2, size[1], size[0])
    if not np.isfinite(values).all():
        raise InputError(f"{path} has values that are not finite: give that of the SDK")
    return values[0].astype(np.float32), values[1].astype(np.float32)
