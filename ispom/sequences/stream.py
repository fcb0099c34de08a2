"""The images of one camera over time, and the clock that gives their times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.io.calibrations.dialect import NOMINAL_RATE
from ispom.io.files import exists
from ispom.io.mapping import finite_numbers
from ispom.io.values import MAX_TIME_S
from ispom.sequences.sidecars import image_times
from ispom.types import Camera, Image

NOMINAL_HZ = 30.0
"""Frame rate that is assumed where none is known."""
MIN_HZ, MAX_HZ = 1e-3, 1e5
MAX_OFFSET_S = float(MAX_TIME_S)
MAX_SHAPE_ERROR_PX = 1.0
"""Largest deviation of a scaled image's height from the exact one."""
MAX_CROP = 0.02
"""Largest relative difference in size of images that were cropped; with a larger one they were scaled."""
MAX_INTERVAL_S = 10.0
"""Longest plausible interval between images; times with longer ones may be in milliseconds."""


@dataclass(frozen=True, eq=False)
class Stream:
    """Images by index, which are decoded on demand."""

    times_ns: NDArray[np.int64]
    """(N,) increasing."""
    read: Callable[[int], Image]
    """Returns image i, grey or RGB. Raises InputError where it is unreadable or of the wrong size. Can be called from
    several threads."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Clock:
    """The times of a stream's images: from a file of times, or from a rate, plus an offset."""

    times: Path | None = None
    """File with a line for each image, see `image_times`."""
    rate_hz: float | None = None
    offset_s: float = 0.0
    nominal_hz: float | None = None
    """Rate in a program's settings, which is used where there is no other information about the times."""

    def times_ns(
        self,
        what: Path,
        count: int,
        otherwise_hz: float | None = None,
        otherwise_ns: NDArray[np.int64] | None = None,
        ticks: NDArray[np.int64] | None = None,
        image_names: Sequence[str] = (),
    ) -> tuple[NDArray[np.int64], str]:
        """Returns the times (N,) [ns] of the `count` images of `what`, and a note about assumptions; "" without any.

        Without times and rate, the times are `otherwise_ns` (N,), or the rate is `otherwise_hz`, or else NOMINAL_HZ. At
        a rate, image i is number `ticks[i]`, by default i. A file of times may name the images.
        """
        if self.times is not None:
            stamps_ns, unit_note = image_times(self.times, count, image_names)
            interval_s = float(np.median(np.diff(stamps_ns))) * 1e-9 if count > 1 else 0.0
            note = f"{self.times}: images are {interval_s:g} s apart: are these times in seconds?"
            return self._moved(stamps_ns, what), note if interval_s >= MAX_INTERVAL_S else unit_note
        if self.rate_hz is None and otherwise_ns is not None:
            return self._moved(otherwise_ns, what), ""
        rate_hz = self.rate_hz or otherwise_hz or self.nominal_hz or NOMINAL_HZ
        assumed = f"{what} has no times: {NOMINAL_HZ:g} images per second assumed (rate_hz sets it)"
        note = "" if self.rate_hz or otherwise_hz or self.nominal_hz else assumed
        ticks = np.arange(count) if ticks is None else ticks
        return self._moved(np.rint(ticks * 1e9 / rate_hz).astype(np.int64), what), note

    def _moved(self, times_ns: NDArray[np.int64], what: Path) -> NDArray[np.int64]:
        offset_ns = round(self.offset_s * 1e9)
        if len(times_ns) and max(abs(int(times_ns[i]) + offset_ns) for i in (0, -1)) > MAX_TIME_S * 10**9:
            raise InputError(
                f"{what}: its last time with offset_s {self.offset_s:g} s is too large: correct the offset"
            )
        return times_ns + offset_ns


def clock_of(path: Path, values: dict[Any, Any], where: str = "") -> Clock:
    """Returns the clock of a mapping with `times` or `rate_hz`, and `offset_s`. Raises InputError that names the
    invalid value."""
    rate_hz, times = values.get("rate_hz"), values.get("times")
    if times is not None and rate_hz is not None:
        raise InputError(f"{path}: {where}times and {where}rate_hz are both given: remove one")
    if times is not None:
        times = named_file(path, f"{where}times", times)
    if rate_hz is not None:
        rate_hz = finite_numbers(path, f"{where}rate_hz", [rate_hz], 1)[0]
        if not MIN_HZ <= rate_hz <= MAX_HZ:
            raise InputError(f"{path}: {where}rate_hz is {rate_hz:g}, give a rate from {MIN_HZ:g} to {MAX_HZ:g}")
    offset_s = finite_numbers(path, f"{where}offset_s", [values.get("offset_s", 0)], 1)[0]
    if abs(offset_s) > MAX_OFFSET_S:
        raise InputError(f"{path}: {where}offset_s is {offset_s:g}, beyond {MAX_OFFSET_S:g}: correct it")
    return Clock(times, rate_hz, offset_s, values.get(NOMINAL_RATE))


def named_file(path: Path, where: str, name: Any) -> Path:
    """Returns the file or folder that the YAML file `path` names, relative to its own folder. Raises InputError where
    it is no name, or does not exist."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise InputError(f"{path}: {where} is not the name of a file: correct it")
    file = path.parent / name
    if not exists(file):
        raise InputError(f"{path}: {where} names {file}, which is missing: correct it")
    return file


_SCALED: ContextVar[bool] = ContextVar("scaled", default=False)


@contextmanager
def scaled_calibrations(allowed: bool) -> Iterator[None]:
    """Allows in its context that a calibration for images of another size with the same aspect is scaled to the
    images."""
    token = _SCALED.set(allowed)
    try:
        yield
    finally:
        _SCALED.reset(token)


def fitted(path: Path, camera: Camera, size: tuple[int, int]) -> tuple[Camera, tuple[str, ...]]:
    """Returns the camera of a calibration file for images of this size (width, height), with a note where it was
    scaled.

    Raises InputError where the images have another size with the same aspect, and `scaled_calibrations` does not allow
    scaling. A camera for images with another aspect is returned unchanged.
    """
    width, height = size
    factor = width / camera.width
    same_shape = abs(camera.height * factor - height) <= MAX_SHAPE_ERROR_PX
    if abs(factor - 1) <= MAX_CROP or not same_shape:
        return camera, ()
    made = f"{path} is made for images of {camera.width} x {camera.height}, these are {width} x {height}"
    whole = round(1 / factor) if factor < 1 else round(factor)
    names = {2: "halve it" if factor < 1 else "double it", 3: f"{'divide' if factor < 1 else 'multiply'} it by 3"}
    exact = abs(max(factor, 1 / factor) - whole) < 1e-9
    words = names.get(whole, "") if exact else ""
    if not _SCALED.get():
        raise InputError(
            f"{made}, of the same shape: {words or f'scale it by {factor:.4g}'} with --scale-calibration, or multiply "
            f"fx, fy, cx and cy by {factor:.4g}"
        )
    scaled = replace(camera.scaled(factor), width=width, height=height)
    return scaled, (f"{made}: scaled by {factor:.4g}, with pixel centres kept in place",)


def size_of(camera: Camera) -> tuple[int, int]:
    """Returns (width, height) of a camera."""
    return camera.width, camera.height
