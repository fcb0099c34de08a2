"""The images of each camera that a calibration is made of, wherever they are."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.calibration.motion.course import LONGEST_S
from ispom.errors import InputError
from ispom.io.files import exists, expanded, is_folder, names, require_file
from ispom.io.rows import increasing_times_ns, read_rows
from ispom.sequences.decoder_output import film_name, silenced
from ispom.sequences.formats.folder import TIMES
from ispom.sequences.formats.video import looks_like_video, video_stream
from ispom.sequences.formats.video_folder import video_in
from ispom.sequences.images import IMAGE_SUFFIXES, read_grey
from ispom.sequences.orientation import common_orientation
from ispom.sequences.stream import Clock
from ispom.types import Image, as_grey

CAMERAS = {"video": ("video",), "stereo": ("left", "right"), "rig": ("video", "left", "right")}
_ALIASES = {"video": ("video", "mono"), "left": ("left", "cam0", "image_0"), "right": ("right", "cam1", "image_1")}


SAME_NS = 100_000
"""Images whose stamps differ by no more were taken at once, by one trigger."""


@dataclass(frozen=True, eq=False)
class Source:
    """The images of one camera, in the order of time or of their names."""

    camera: str
    place: Path
    names: tuple[str, ...]
    times_ns: NDArray[np.int64] | None
    """(N,) where they are known."""
    read: Callable[[int], Image]
    """Image i (H, W), grey."""
    is_film: bool = False
    """Many similar images: the best are chosen."""
    notes: tuple[str, ...] = ()
    """Sentences about how they are read."""

    def __len__(self) -> int:
        return len(self.names)

    def select(self, index: list[int]) -> Source:
        times = None if self.times_ns is None else self.times_ns[index]
        chosen = tuple(self.names[i] for i in index)
        return Source(self.camera, self.place, chosen, times, lambda i: self.read(index[i]), self.is_film, self.notes)


def open_sources(what: str, image_paths: tuple[Path, ...]) -> tuple[Source, ...]:
    """Returns one for each camera of `what`, a key of CAMERAS. Raises InputError for what is missing."""
    cameras = CAMERAS[what]
    paths = [expanded(path) for path in image_paths]
    if not paths:
        raise InputError(f"no images were given: name a folder of images or a video file for {_listed(cameras)}")
    if what == "video" and len(paths) > 1:
        return (_of_files("video", paths[0].parent, paths),)
    if len(paths) == len(cameras):
        if len(set(paths)) < len(paths):
            raise InputError(f"{paths[0]} is given twice: give the images of {_listed(cameras)} apart")
        return tuple(_source(camera, path) for camera, path in zip(cameras, paths, strict=True))
    if len(paths) == 1 and is_folder(paths[0]):
        return tuple(_inside(camera, paths[0]) for camera in cameras)
    raise InputError(
        f"{len(paths)} places were given for {_listed(cameras)}: give one for each, or one folder with all"
    )


def own_clock(sources: tuple[Source, ...]) -> bool:
    """Returns whether the video camera of a rig takes its images at times of its own: films do, and images whose times
    are not those of the pairs, where they follow each other closely enough."""
    by_name = {source.camera: source for source in sources}
    if set(by_name) != set(CAMERAS["rig"]):
        return False
    left, video = by_name["left"], by_name["video"]
    if left.times_ns is None or video.times_ns is None or len(video) < 2:
        return False
    if float(np.median(np.diff(video.times_ns))) * 1e-9 > LONGEST_S:
        return False
    away = np.abs(video.times_ns[nearest(video.times_ns, left.times_ns)] - left.times_ns)
    return video.is_film or int(away.max()) > SAME_NS


def nearest(times_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns the indices (M,) of the times (of N, increasing) that are nearest to those wanted (M,)."""
    after = np.clip(np.searchsorted(times_ns, wanted_ns), 1, len(times_ns) - 1)
    return after - (wanted_ns - times_ns[after - 1] < times_ns[after] - wanted_ns)


def paired(sources: tuple[Source, ...]) -> tuple[Source, ...]:
    """Returns them with images of one number taken at the same time: by their names where these have something in
    common, else in their order. Raises InputError where that cannot be."""
    if len(sources) == 1:
        return sources
    keys = [[_key(name, source.camera) for name in source.names] for source in sources]
    common = set(keys[0]).intersection(*keys[1:])
    unique = all(len(set(own)) == len(own) for own in keys)
    if unique and len(common) >= 2:
        chosen = [[own.index(key) for key in keys[0] if key in common] for own in keys]
        return tuple(source.select(index) for source, index in zip(sources, chosen, strict=True))
    counts = {len(source) for source in sources}
    if len(counts) == 1:
        return sources
    counts_text = ", ".join(f"{source.camera} has {len(source)}" for source in sources)
    raise InputError(f"the cameras' images do not pair ({counts_text}): give as many of each, or the same names")


def _inside(camera: str, folder: Path) -> Source:
    """Of a folder for all cameras: the camera's own folder or film in it, or the files that begin with its name."""
    listing = names(folder)
    for alias in _ALIASES[camera]:
        for name in listing:
            path = folder / name
            if name.lower() == alias and is_folder(path):
                return _source(camera, path)
            if path.stem.lower() == alias and looks_like_video(path):
                return _source(camera, path)
    files = [folder / n for n in listing if n.lower().startswith(_ALIASES[camera]) and _is_image(n)]
    if not files and camera == "video":
        return _source(camera, folder)
    if not files:
        raise InputError(f"{folder} holds no folder, film or images called {camera}: give the cameras' folders apart")
    return _of_files(camera, folder, files)


def _source(camera: str, path: Path) -> Source:
    path = video_in(path) or path
    if is_folder(path):
        data = path / "data"
        folder = data if not any(map(_is_image, names(path))) and is_folder(data) else path
        files = [folder / name for name in names(folder) if _is_image(name)]
        if not files:
            raise InputError(f"{folder} holds no image: give a folder of {', '.join(sorted(IMAGE_SUFFIXES))} files")
        return _of_files(camera, folder, files)
    require_file(path)
    if looks_like_video(path):
        return _film(camera, path)
    if _is_image(path.name):
        return _of_files(camera, path.parent, [path])
    raise InputError(f"{path} is neither a folder of images nor a video: give one for {camera}")


def _of_files(camera: str, place: Path, files: list[Path]) -> Source:
    files = sorted(files, key=lambda path: _natural(path.name))
    listed, times = tuple(path.name for path in files), None
    if exists(place / TIMES):
        times = increasing_times_ns(place / TIMES, read_rows(place / TIMES, 1))
        if len(times) != len(files):
            raise InputError(f"{place / TIMES} has {len(times)} times for {len(files)} images: give one per image")
    elif all(re.fullmatch(r"\d{15,19}", path.stem) for path in files):  # EuRoC's names are nanoseconds
        times = np.array([int(path.stem) for path in files], np.int64)
    orientation, note = common_orientation(files)
    notes = (note,) if note else ()
    return Source(camera, place, listed, times, lambda i: read_grey(files[i], None, orientation), notes=notes)


def _film(camera: str, path: Path) -> Source:
    with silenced():
        decoder = cv2.VideoCapture(film_name(path), cv2.CAP_FFMPEG)
        size = int(decoder.get(cv2.CAP_PROP_FRAME_WIDTH)), int(decoder.get(cv2.CAP_PROP_FRAME_HEIGHT))
        decoder.release()
    stream = video_stream(path, size, Clock())
    listed = tuple(f"{path.name} frame {i}" for i in range(len(stream.times_ns)))
    return Source(camera, path, listed, stream.times_ns, lambda i: as_grey(stream.read(i)), is_film=True)


def _key(name: str, camera: str) -> str:
    """What is left of a file's name without the camera's."""
    stem = Path(name).stem.lower()
    for alias in _ALIASES[camera]:
        stem = stem.removeprefix(alias)
    return stem.strip("_-. ")


def _natural(name: str) -> tuple[tuple[int, str], ...]:
    """Numbers in names by value; every second part of the split is a number."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((int(part), part) if i % 2 else (0, part) for i, part in enumerate(parts))


def _is_image(name: str) -> bool:
    return Path(name).suffix.lower() in IMAGE_SUFFIXES and not name.startswith(".")


def _listed(cameras: tuple[str, ...]) -> str:
    return " and ".join(filter(None, [", ".join(cameras[:-1]), *cameras[-1:]]))
