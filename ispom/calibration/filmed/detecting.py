"""Detection in all images of all cameras, on all cores."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress

import numpy as np

from ispom.calibration.calibrate import require_found
from ispom.calibration.detection.detect import common_hint, detect, layout_fault
from ispom.calibration.detection.detection import Detection
from ispom.calibration.filmed.choose import around
from ispom.calibration.filmed.images import Source
from ispom.calibration.result import Views
from ispom.calibration.targets.target import Target
from ispom.errors import InputError, UnreadableImage
from ispom.stop import check_stop
from ispom.types import Image

LOOKED_AT = 9
"""Images that say which target was filmed, where it is not the one given."""


Bar = Callable[[str, int | None], AbstractContextManager[Callable[[], None]]]
"""Begins to show how far something is, of how many (None: unknown), and gives what moves it on by one."""


@contextmanager
def no_bar(what: str, total: int | None) -> Iterator[Callable[[], None]]:
    """Shows nothing. What moves it on raises what ends the command, as `check_stop`."""
    yield check_stop


def detected(target: Target, sources: tuple[Source, ...], bar: Bar = no_bar) -> tuple[Views, ...]:
    """Returns what each camera saw. Raises InputError where its images have several sizes."""
    jobs = [(source, i) for source in sources for i in range(len(source))]
    with bar("detecting the target", len(jobs)) as step, ThreadPoolExecutor(os.cpu_count() or 1) as pool:

        def one(job: tuple[Source, int]) -> tuple[tuple[int, int] | None, Detection]:
            source, i = job
            try:
                image = source.read(i)
            except UnreadableImage as fault:
                return None, Detection(reason=str(fault))
            return _size(image), detect(target, image)

        results: list[tuple[tuple[int, int] | None, Detection]] = []
        try:
            for result in pool.map(one, jobs):
                results.append(result)
                step()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    out, at = [], 0
    for source in sources:
        part = results[at : at + len(source)]
        at += len(source)
        size = _one_size(source, [size for size, _ in part])
        out.append(Views(source.camera, size, source.names, tuple(found for _, found in part), source.times_ns))
    return tuple(out)


def require_target(target: Target, sources: tuple[Source, ...], views: tuple[Views, ...]) -> None:
    """Raises InputError where another target was filmed than the one given, with what is there instead: where a
    camera's images show nothing of it, or its tags sit otherwise."""
    for source, each in zip(sources, views, strict=True):
        seen = [i for i, found in enumerate(each.detections) if not found.reason]
        if not seen:
            require_found(each, common_hint(target, _images(source, range(len(source)))))
        if fault := layout_fault(target, _images(source, seen)):
            raise InputError(f"{source.camera}: {fault}")


def _images(source: Source, index: Sequence[int]) -> Iterator[Image]:
    """Up to LOOKED_AT of those of the index, evenly."""
    for n in np.unique(np.linspace(0, len(index) - 1, LOOKED_AT).round().astype(int)).tolist():
        with suppress(UnreadableImage):
            yield source.read(index[n])


def moving_views(
    target: Target, all_sources: tuple[Source, ...], chosen: tuple[Source, ...], bar: Bar = no_bar
) -> Views | None:
    """Returns what a single camera saw around the images that were chosen of those given; None where that is not
    known."""
    neighbours = around(all_sources[0], chosen[0]) if len(all_sources) == 1 else None
    return None if neighbours is None else detected(target, (neighbours,), bar)[0]


def _one_size(source: Source, sizes: list[tuple[int, int] | None]) -> tuple[int, int]:
    """That of all images; InputError where one differs, or none can be read."""
    counts = Counter(size for size in sizes if size is not None)
    if not counts:
        raise InputError(f"{source.place}: none of {len(source)} images can be read: restore them")
    usual = counts.most_common(1)[0][0]
    if len(counts) > 1:
        first = next(i for i, size in enumerate(sizes) if size is not None and size != usual)
        width, height = sizes[first] or usual
        raise InputError(
            f"{source.place}: {source.names[first]} is {width} x {height}, others are {usual[0]} x {usual[1]}: "
            "give images of one size, as the camera is used later"
        )
    return usual


def _size(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]
