"""Filming a target with a camera: views that show something new are stored, and what is missing is reported at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from ispom.calibration.adjust.problem import Observations
from ispom.calibration.adjust.solve import start_of
from ispom.calibration.detection.detect import detect
from ispom.calibration.detection.detection import Detection
from ispom.calibration.diagnostics import MANY_VIEWS, Coverage, coverage
from ispom.calibration.filmed.images import Source
from ispom.calibration.targets.target import Target
from ispom.errors import InputError
from ispom.sequences.decoder_output import silenced
from ispom.types import Image

NEW_SHARE = 0.06
"""Of the image's width: a view is new when its points are, at the median, so far from where every kept one has them."""
LEAST_POINTS = 8
LEAST_VIEWS = 3
"""For tilts and distances: from fewer, the camera is not known well enough."""
_DEVICE = re.compile(r"camera:(\d{1,3})")


def is_camera(paths: tuple[Path, ...]) -> bool:
    """Returns whether these name a camera of this machine, such as camera:0."""
    return len(paths) == 1 and _DEVICE.fullmatch(str(paths[0])) is not None


@contextmanager
def camera_frames(name: str) -> Iterator[Callable[[], Image | None]]:
    """Yields what reads the next frame (H, W) of `camera:N`, and gives None where there is none. Raises InputError
    where the camera is not there."""
    found = _DEVICE.fullmatch(name)
    if found is None:
        raise InputError(f"{name} is no camera: give camera:NUMBER, as camera:0")
    with silenced():
        device = cv2.VideoCapture(int(found[1]))
    if not device.isOpened():
        raise InputError(f"{name} cannot be opened: connect the camera, and close other programs that use it")

    def read() -> Image | None:
        there, image = device.read()
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8) if there else None

    try:
        yield read
    finally:
        device.release()


def filmed(
    target: Target, name: str, read: Callable[[], Image | None], report: Callable[[str], None], most: int
) -> Source:
    """Returns the views that are filmed until nothing is missing any more, `most` views are kept, the camera ends, or
    Ctrl-C is pressed.

    `report` gets, after each frame, what was seen, how much is covered, and what to film next.
    """
    images: list[Image] = []
    seen: list[Detection] = []
    advice = f"show the target {target.spec} to the camera"
    report(advice)
    try:
        while len(images) < most and (image := read()) is not None:
            if images and image.shape != images[0].shape:
                raise InputError(f"{name} changed the size of its images: film again")
            found = detect(target, image)
            if found.reason or len(found) < LEAST_POINTS:
                report(f"{found.reason or 'too few points'}; {advice}")
                continue
            if not is_new(found, seen, image.shape[1]):
                report(f"seen already; {advice}")
                continue
            images.append(image)
            seen.append(found)
            now = covered(target, seen, (image.shape[1], image.shape[0]))
            advice = words(len(images), now)
            report(advice)
            if now is not None and not now.advice:
                break
    except KeyboardInterrupt:
        report(f"{len(images)} views kept; solving")
    names = tuple(f"view {i}" for i in range(len(images)))
    if not images:
        raise InputError(f"{name}: the target was never seen: give the target that is filmed as --target")
    return Source("video", Path(name), names, None, lambda i: images[int(i)])


def is_new(found: Detection, seen: list[Detection], width: int) -> bool:
    """Returns whether no earlier view has its points at nearly the same positions, in images of `width` pixels."""
    for other in seen:
        _, mine, theirs = np.intersect1d(found.ids, other.ids, return_indices=True)
        away = np.linalg.norm(found.uv[mine] - other.uv[theirs], axis=1)
        if len(mine) and np.median(away) < NEW_SHARE * width:
            return False
    return True


def covered(target: Target, seen: list[Detection], size: tuple[int, int]) -> Coverage | None:
    """Returns what the views cover, in images of `size` (width, height) [px]; None while they are too few."""
    if len(seen) < LEAST_VIEWS:
        return None
    views = Observations.of(target, [seen])
    estimate = start_of(views, size, "radtan" if len(seen) >= 2 * LEAST_VIEWS else "pinhole")
    poses = [estimate.rig_from_board(v) for v in range(len(seen))]
    return coverage(estimate.cameras[0], [each.uv for each in seen], poses, target.xyz_in_board.mean(0))


def words(count: int, now: Coverage | None) -> str:
    """Returns a sentence for the person with the board."""
    if now is None:
        return f"{count} views kept; next: show the target tilted, and in other places"
    share = f"{count} views kept, {100 * now.covered:.0f} % of the image covered"
    others = [text for text in now.advice if not text.startswith("take more views")]
    if others:
        return f"{share}; next: {others[0]}"
    return f"{share}; next: {MANY_VIEWS - count} more views" if now.advice else f"{share}; nothing is missing"
