"""A video file (FFmpeg, through OpenCV); its camera in `NAME.yaml` or `camera.yaml` next to it, or in another program's
file (sidecars.py), or a guess (guess.py).

Each image has its time in the file, at constant or variable rates, unless the camera's file has `rate_hz` or `times`.
The first image is at 0.
"""

from __future__ import annotations

import threading
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, UnreadableImage
from ispom.io.files import names, read_head
from ispom.sequences.decoder_output import film_name, silenced
from ispom.sequences.formats.folder import is_calibration, read_settings, settings_in
from ispom.sequences.guess import guess_of_film, pixel_aspect, subtitles_of
from ispom.sequences.images import IMAGE_SUFFIXES
from ispom.sequences.recording import Recording
from ispom.sequences.sensors_beside import sensors_beside
from ispom.sequences.sidecars import calibration_beside, not_used, subtitles_found, truth_beside, used
from ispom.sequences.stream import MAX_HZ, MIN_HZ, Clock, Stream, size_of
from ispom.types import Camera, Found, Image

VIDEO_SUFFIXES = frozenset(
    {".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".mts", ".m2ts", ".ts", ".wmv", ".3gp", ".flv", ".mpg", ".mpeg"}
)
HEAD_BYTES = 400
"""Number of first bytes by which the container format is recognised."""
MAX_FRAMES = 100_000_000
"""Largest number of images in a header: 38 days at 30 Hz."""
MAX_SKIP = 40
"""Largest number of images that are decoded in order instead of a jump, which decodes from the keyframe before."""
ROUNDING_NS = 2_500_000
"""Largest difference of intervals at a constant rate: those of times that are rounded to milliseconds differ by up to
2 ms."""
RATE_ERROR = 0.01
"""Largest relative difference between the rate in a file and that of its images."""
ASPECT_ERROR = 0.02
"""Largest relative difference between a file's pixel aspect and that of a calibration, fy / fx."""
MIN_FRAMES_FOR_RATE = 10
"""Least number of images whose rounded times determine the rate."""
MAX_HEADER_ERROR = 4
"""Number of images that the header of an intact file may have too many; with more, images are counted by decoding."""


def looks_like_video(path: Path) -> bool:
    """Checks whether its name is that of a video file."""
    return path.suffix.lower() in VIDEO_SUFFIXES


def open_video(path: Path, calibration: Path | None = None) -> Recording:
    """Returns the recording of a video file. Raises InputError that names the missing or invalid file."""
    settings = calibration or settings_in(path.parent, f"{path.stem}.yaml") or settings_in(path.parent)
    guess, notes = None, ()
    places = (path.parent,) if _is_alone(path) else ()
    found, clock = tuple[Found, ...](), Clock()
    if settings is None:
        settings, found = calibration_beside(places, is_calibration)
    if settings is None:
        film = _Film(path)
        guess = guess_of_film(path, film.size, film.aspect)
        camera, stream = guess.camera(film.size), _stream(film, path, clock)
    else:
        film = _Film(path)
        camera, clock, notes = read_settings(settings, lambda: film.size)
        film.require(size_of(camera))
        stream, notes = _stream(film, path, clock), (*notes, *_aspect_note(path, film, camera))
    truth, from_where, of_truth = truth_beside(places, stream.times_ns, ())
    read, notes = stream.read, (*notes, *stream.notes, *from_where)
    found = (*used(("lens", settings), ("times", clock.times)), *found, *of_truth, *subtitles_found(subtitles_of(path)))
    return Recording(
        f"video {path.name}", camera, None, stream.times_ns, lambda _, i: read(i), truth, notes,
        guess=guess, found=(*found, *not_used(places)), sensors=sensors_beside(places),
    )  # fmt: skip


def _is_alone(path: Path) -> bool:
    """Checks that a video is the only one in its folder, so that sidecar files there belong to it."""
    others = (Path(name) for name in names(path.parent) if name != path.name and not name.startswith("."))
    return not any(other.suffix.lower() in VIDEO_SUFFIXES | IMAGE_SUFFIXES for other in others)


def video_stream(path: Path, size: tuple[int, int], clock: Clock) -> Stream:
    """Returns the images of a video file of this size (width, height)."""
    return _stream(_Film(path, size), path, clock)


def _stream(film: _Film, path: Path, clock: Clock) -> Stream:
    times_ns, note = clock.times_ns(path, film.count, film.rate_hz, film.stamps_ns)
    if clock.times is None and clock.rate_hz is None and not note:
        if film.uneven:
            shortest, longest = np.diff(times_ns).min() * 1e-6, np.diff(times_ns).max() * 1e-6
            note = f"{path.name}: a variable rate, each image at its own time, {shortest:.0f} to {longest:.0f} ms apart"
        else:
            note = f"{path.name}: times follow from the file's own rate, {film.rate_hz:g} images per second"
    return Stream(times_ns, film.read, tuple(text for text in (note, film.note) if text))


def _aspect_note(path: Path, film: _Film, camera: Camera) -> tuple[str, ...]:
    """Returns a note where the pixel aspects of calibration and file differ."""
    if abs(camera.fy / camera.fx / film.aspect - 1) <= ASPECT_ERROR:
        return ()
    wide = f"{path.name}: the file says that its pixels are {film.aspect:.4g} times as wide as high, the calibration"
    return (f"{wide} that they are {camera.fy / camera.fx:.4g} times: is it that of this film?",)


def _is_container(head: bytes) -> bool:
    """Checks the first bytes: FFmpeg would also accept a list of addresses, and open them."""
    mp4 = head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
    known = (b"\x1aE\xdf\xa3", b"FLV\x01", b"\x30\x26\xb2\x75\x8e\x66\xcf\x11", b"\x00\x00\x01\xba")
    return mp4 or head.startswith(known) or (head.startswith(b"RIFF") and head[8:12] == b"AVI ") or _is_stream(head)


def _is_stream(head: bytes) -> bool:
    """Checks for packets of an MPEG transport stream, of 188 bytes, or of 192 with a time before each."""
    return any(
        len(head) > first + 2 * size and all(head[first + i * size] == 0x47 for i in range(3))
        for first, size in ((0, 188), (4, 192))
    )


def _stamps_ns(path: Path) -> NDArray[np.int64]:
    """Returns (N,) presentation times [ns] of the packets in a video file, ascending from 0. Decodes nothing."""
    with silenced():
        packets = cv2.VideoCapture(film_name(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
        stamps_ms = []
        while packets.grab():
            stamps_ms.append(packets.get(cv2.CAP_PROP_POS_MSEC))
        packets.release()
    stamps_ns = np.sort(np.rint(np.array(stamps_ms) * 1e6).astype(np.int64))
    return stamps_ns - stamps_ns[:1]


def _is_uneven(times_ns: NDArray[np.int64]) -> bool:
    """Checks whether intervals differ by more than the rounding of times to milliseconds explains."""
    return len(times_ns) > 1 and int(np.ptp(np.diff(times_ns))) > ROUNDING_NS


class _Film:
    """A decoder with a current position: reading in order is fast; a jump decodes from a keyframe on."""

    def __init__(self, path: Path, size: tuple[int, int] | None = None) -> None:
        """Raises InputError where it is no video, or none of this size (width, height), before any image is decoded."""
        if not _is_container(read_head(path, HEAD_BYTES)):
            raise InputError(
                f"{path} is not a video in MP4, MOV, AVI, MKV, WebM, MPEG, WMV or FLV (damaged?): restore it"
            )
        self._path = path
        self._lock = threading.Lock()
        self._decoder = self._opened()
        self._next = 0
        self._last: tuple[int, Image] | None = None
        get = self._decoder.get
        width, height = int(get(cv2.CAP_PROP_FRAME_WIDTH)), int(get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.size = width, height
        if size is not None:
            self.require(size)
        aspect = pixel_aspect(get(cv2.CAP_PROP_SAR_NUM), get(cv2.CAP_PROP_SAR_DEN))
        turned = get(cv2.CAP_PROP_ORIENTATION_AUTO) and get(cv2.CAP_PROP_ORIENTATION_META) % 180
        self.aspect = 1 / aspect if turned else aspect
        """Width of a pixel over its height."""
        rate_hz = get(cv2.CAP_PROP_FPS)
        self.rate_hz = rate_hz if np.isfinite(rate_hz) and MIN_HZ <= rate_hz <= MAX_HZ else None
        claimed = int(min(max(0, get(cv2.CAP_PROP_FRAME_COUNT)), MAX_FRAMES))
        packets_ns = _stamps_ns(path)
        self._in_order = not self._has_own_rate(packets_ns)
        self.count = 0 if self._in_order else self._counted(claimed)
        self.stamps_ns: NDArray[np.int64] | None = None
        """(N,) [ns] where the rate does not determine the times."""
        if self.count == 0 or self.count != len(packets_ns) > 0:
            # Packets outside of the part that an edit list shows are no images, nor are damaged ones.
            self._in_order, shown_ns = True, self._shown_ns()
            self.count = len(shown_ns)
            if (np.diff(shown_ns) > 0).all() and not self._has_own_rate(shown_ns):
                self.stamps_ns = shown_ns
        claimed = max(claimed, len(packets_ns))
        fewer = f"{path.name}: {self.count} of {claimed} images can be decoded and are part of what the file shows"
        self.note = fewer if self.count < claimed else ""

    def require(self, size: tuple[int, int]) -> None:
        """Raises InputError where the images have another size (width, height)."""
        if self.size != size:
            (width, height), cure = self.size, "give the calibration of this video"
            raise InputError(f"{self._path} is {width} x {height}, not {size[0]} x {size[1]} as its camera: {cure}")

    @property
    def uneven(self) -> bool:
        """Whether the times of images are not determined by the rate."""
        return self.stamps_ns is not None

    def _has_own_rate(self, times_ns: NDArray[np.int64]) -> bool:
        """Checks whether times (N,) are those of images at the file's rate."""
        if len(times_ns) < 2 or self.rate_hz is None:
            return True
        share = (times_ns[-1] - times_ns[0]) * 1e-9 / (len(times_ns) - 1) * self.rate_hz
        return not _is_uneven(times_ns) and bool(abs(share - 1) <= RATE_ERROR or len(times_ns) < MIN_FRAMES_FOR_RATE)

    def read(self, i: int) -> Image:
        """Returns image i (H, W, 3) RGB, read-only. Raises UnreadableImage where it cannot be decoded."""
        with self._lock:
            if self._last is None or self._last[0] != i:
                decoded = self._decoded(i)
                if decoded is None:
                    raise UnreadableImage(f"{self._path}: image {i} cannot be decoded: restore the file")
                image = np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), np.uint8)
                image.setflags(write=False)
                self._last = i, image
            return self._last[1]

    def _opened(self) -> cv2.VideoCapture:
        with silenced():
            decoder = cv2.VideoCapture(film_name(self._path), cv2.CAP_FFMPEG)
        if not decoder.isOpened():
            raise InputError(f"{self._path} is not a video that FFmpeg can decode (truncated or damaged?): restore it")
        return decoder

    def _counted(self, claimed: int) -> int:
        """Returns the number of images, found by jumps to the last ones; 0 where the header's number is 0 or far too
        large."""
        for count in range(claimed, max(0, claimed - MAX_HEADER_ERROR), -1):
            if self._decoded(count - 1) is not None:
                return count
        return 0

    def _shown_ns(self) -> NDArray[np.int64]:
        """Returns the presentation times (N,) [ns] from 0 on, by decoding all images. Raises InputError where there is
        none."""
        self._restart()
        shown_ms = []
        while self._decoder.grab():
            shown_ms.append(self._decoder.get(cv2.CAP_PROP_POS_MSEC))
        self._restart()
        if not shown_ms:
            code = int(self._decoder.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True).decode("latin-1")
            kind = f" ({code})" if code.isprintable() else ""
            raise InputError(
                f"{self._path} holds no image that can be decoded{kind}: restore the file, or convert it, to H.264 for "
                "example"
            )
        shown_ns = np.rint(np.array(shown_ms) * 1e6).astype(np.int64)
        return shown_ns - shown_ns[0]

    def _decoded(self, i: int) -> np.ndarray | None:
        """Returns image i in OpenCV's order of colours; None where there is none."""
        if self._in_order:  # the decoder's jumps assume a constant rate, and that each packet is an image
            if i < self._next:
                self._restart()
        elif not self._next <= i <= self._next + MAX_SKIP:
            self._decoder.set(cv2.CAP_PROP_POS_FRAMES, i)
            self._next = i
            if round(self._decoder.get(cv2.CAP_PROP_POS_FRAMES)) != i:  # a container without an index
                self._restart()
        while self._next < i:
            if not self._decoder.grab():
                return self._lost()
            self._next += 1
        good, image = self._decoder.read()
        if not good:
            return self._lost()
        self._next = i + 1
        return image

    def _lost(self) -> None:
        """Marks the decoder's position as unknown, after a failure."""
        self._restart()

    def _restart(self) -> None:
        self._decoder.release()
        self._decoder = self._opened()
        self._next = 0
