"""A live camera: `camera:0` (by its number or its device file), or the address of a stream (HTTP, RTSP), by OpenCV.

Images are stored on arrival in a temporary file that is deleted with the program: none is lost if the estimators are
slower, and they can be read again in any order. Their times are those of arrival.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from threading import Condition, Thread

import cv2
import numpy as np

from ispom.errors import InputError, counted
from ispom.io.calibrations.recognised import one_camera
from ispom.sequences.address import DEVICE_PREFIX, SCHEMES, is_address, is_device, scheme, without_secrets
from ispom.sequences.decoder_output import silenced
from ispom.sequences.spool import Spool
from ispom.sequences.stream import size_of
from ispom.types import Camera, Frame, Image, Measurement, Rig, Sequence

SOURCE_TIMEOUT_S = 10.0
"""Time after which a source has failed that cannot be opened, or gives no image."""
STOP_TIMEOUT_S = 2.0
"""Time for which `stop` waits for the thread of the camera."""


def looks_live(source: str) -> bool:
    """Checks whether a source is a camera or a stream, not a path."""
    return is_device(source) or is_address(source)


def open_live(source: str, calibration: Path | None, max_frames: int | None = None, least: int = 1) -> Sequence:
    """Starts recording a camera; returns its sequence when it has `least` images.

    The sequence ends after `max_frames`, by `stop`, with the source, or when the disk is full. Raises InputError where
    the camera cannot be opened, fails, or does not have the image size of the `calibration`.
    """
    name = without_secrets(source)
    if calibration is None:
        raise InputError(f"{name} has no calibration: give --camera FILE, a camera.yaml of this camera")
    if not is_device(source) and (scheme(source) not in SCHEMES or not source.isprintable()):
        raise InputError(f"{name} is no address of a stream: give one that begins with {', '.join(SCHEMES)}")
    camera, _, notes = one_camera(calibration)
    live = _Live(name, camera, _opened(source, name, camera), max_frames, notes)
    sequence = live.grown(least - 1, None)
    if len(sequence) < least:
        raise InputError(f"{name} ended after {counted(len(sequence), 'image')}: give a source that goes on")
    return sequence


def _opened(source: str, name: str, camera: Camera) -> cv2.VideoCapture:
    if is_device(source):
        capture = _device(source.removeprefix(DEVICE_PREFIX), name)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, camera.width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.height)
    else:
        patience_ms = round(1000 * SOURCE_TIMEOUT_S)
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, patience_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, patience_ms]
        with silenced():
            capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)
    if not capture.isOpened():
        cure = "check that it is plugged in and no other program uses it"
        if not is_device(source):
            cure = "check the address, and that it can be reached"
        raise InputError(f"{name} cannot be opened: {cure}")
    return capture


def _device(which: str, name: str) -> cv2.VideoCapture:
    if sys.platform == "linux":
        file = Path(f"/dev/video{which}" if which.isdecimal() else which)
        if not os.path.exists(file):
            there = ", ".join(sorted(f"{DEVICE_PREFIX}{p}" for p in Path("/dev").glob("video*"))) or "none"
            raise InputError(f"{name} is not there (no {file}): plug it in, or give one of those there are: {there}")
        return cv2.VideoCapture(str(file), cv2.CAP_V4L2)
    if not which.isdecimal():
        raise InputError(f"{name} is no camera: give its number, such as {DEVICE_PREFIX}0")
    return cv2.VideoCapture(int(which))


class _Live:
    """A thread that reads the camera into the spool. All methods may be called from any thread."""

    def __init__(
        self, name: str, camera: Camera, capture: cv2.VideoCapture, max_frames: int | None, notes: tuple[str, ...]
    ) -> None:
        self._name, self._camera, self._capture = name, camera, capture
        self._spool = Spool((camera.height, camera.width, 3), max_frames)
        self._times_ns = np.zeros(self._spool.capacity, np.int64)
        self._notes: tuple[str, ...] = (*notes, "Times are those of each image's arrival.")
        self._count = 0
        self._start_ns = time.time_ns() - time.monotonic_ns()
        self._over = self._stopping = False
        self._failure = ""
        self._news = Condition()
        self._thread = Thread(target=self._record, name="live-camera", daemon=True)
        self._thread.start()

    def grown(self, count: int, patience_s: float | None) -> Sequence:
        """Implements Sequence.grow. A failure is raised once, after all images before it; then the sequence has
        ended."""
        with self._news:
            self._news.wait_for(lambda: self._count > count or self._over, patience_s)
            if self._failure and self._count <= count:
                reason, self._failure = self._failure, ""
                raise InputError(reason)
            known, more = self._count, not self._over or bool(self._failure)
        return Sequence(
            f"live {self._name}",
            Rig.single(self._camera),
            self._times_ns[:known],
            ("video",) * known,
            self._load,
            notes=self._notes,
            grow=self.grown if more else None,
            stop=self._stop,
        )

    def _load(self, i: int) -> Measurement:
        return Frame.video(int(self._times_ns[i]), self._spool.read(i))

    def _stop(self) -> None:
        self._stopping = True
        self._thread.join(STOP_TIMEOUT_S)
        with self._news:  # a camera without new images may block its thread for longer
            self._over = True
            self._news.notify_all()

    def _record(self) -> None:
        """Records until the source, the limit, a failure or `stop` ends it."""
        reason = ""
        try:
            while self._count < self._spool.capacity and not self._stopping:
                image = self._next()
                if image is None:
                    break
                self._spool.append(image)
                with self._news:
                    self._times_ns[self._count] = self._now_ns()
                    self._count += 1
                    if self._spool.full:
                        self._notes += (
                            f"The recording ended after {self._count} images: {self._spool.limit} is full.",
                        )
                    self._over = self._count == self._spool.capacity
                    self._news.notify_all()
        except InputError as fault:
            reason = str(fault)
        finally:
            self._capture.release()
            with self._news:
                self._over, self._failure = True, reason
                self._news.notify_all()

    def _next(self) -> Image | None:
        """Returns the next image, or None at the end of the stream. Raises InputError where the camera fails."""
        started_s = time.monotonic()
        good, image = self._capture.read()
        if self._stopping:
            return None
        if not good or image is None:
            if time.monotonic() - started_s >= 0.9 * SOURCE_TIMEOUT_S:
                raise InputError(
                    f"{self._name} gave no image for {SOURCE_TIMEOUT_S:g} s after {self._count}: check the camera and "
                    "its connection"
                )
            self._notes += (f"The source ended by itself after {self._count} images.",)
            return None
        size_px, expected = image.shape[1::-1], size_of(self._camera)
        if size_px != expected:
            size = f"{size_px[0]} x {size_px[1]}, not {expected[0]} x {expected[1]}"
            raise InputError(f"{self._name} gives images of {size} as its calibration: give that of this camera")
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB if image.ndim == 3 else cv2.COLOR_GRAY2RGB), np.uint8)

    def _now_ns(self) -> int:
        """Returns the time [ns since 1970], which always increases: the time of day at the start plus a monotonic
        clock."""
        before = int(self._times_ns[self._count - 1]) if self._count else 0
        return max(self._start_ns + time.monotonic_ns(), before + 1)
