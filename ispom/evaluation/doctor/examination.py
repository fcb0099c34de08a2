"""The stretch of a recording that is examined: its images at a moderate size, its times, and its calibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.types import Frame, Image, Rig, Sequence

if TYPE_CHECKING:
    from .adjustment import Promise
    from .counterfactual import Baseline, Crossed
    from .hypothesis import Change
    from .start import Start
    from .tracking import Tracked

LONGEST_SIDE_PX = 700
"""Larger images are halved, once or more: the causes show at this size, too, and take a quarter of the time."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame of the stretch."""

    index: int
    """In the sequence."""
    time_ns: int
    images: dict[str, Image]
    """By camera: grey, at the size of `Examination.rig`."""

    @property
    def is_pair(self) -> bool:
        return "left" in self.images


@dataclass(frozen=True, eq=False)
class Examination:
    """Frames of a sequence, in the order of time, and what several suspects need of them, computed once."""

    rig: Rig
    """With cameras of the size of the images."""
    shots: tuple[Shot, ...]
    times_ns: NDArray[np.int64]
    """Of all frames of the main camera's kind in the stretch and before it: a gap is one by the usual interval."""
    reduced: Mapping[str, int] = field(default_factory=dict)
    """By camera: pixels of the recording per pixel of the images here; 1 for those that are not named."""

    def recorded_px(self, camera: str, examined_px: float) -> float:
        """Returns a length in pixels of the recording's images, of one in pixels of the images here."""
        return self.reduced.get(camera, 1) * examined_px

    @property
    def main(self) -> str:
        """The camera in which tracks are followed: the video camera, else the left one of the pair."""
        return "video" if self.rig.video is not None else "left"

    @cached_property
    def main_shots(self) -> tuple[Shot, ...]:
        """Frames of the main camera."""
        return tuple(shot for shot in self.shots if self.main in shot.images)

    @cached_property
    def pairs(self) -> tuple[Shot, ...]:
        """Frames of the stereo pair."""
        return tuple(shot for shot in self.shots if shot.is_pair)

    @cached_property
    def tracked(self) -> Tracked:
        """Corners, followed through the main camera's frames and into the pairs."""
        from .tracking import track

        return track(self)

    @cached_property
    def start(self) -> Start | None:
        """A first rigid scene of the tracks; None where they show no parallax."""
        from .start import start

        return start(self)

    @cached_property
    def baseline(self) -> Baseline | None:
        """That scene, fitted with the calibration as it is stated."""
        from .counterfactual import baseline

        return None if self.start is None else baseline(self.start, self.rig)

    @cached_property
    def halves(self) -> tuple[Baseline, ...]:
        """The scene fitted to each half of the tracks, and judged by the other; empty where there is none."""
        from .counterfactual import baseline

        if self.start is None or self.baseline is None:
            return ()
        return self.baseline, baseline(self.start, self.rig, ~self.start.held_out)

    @cached_property
    def promises(self) -> dict[tuple[str, ...], Promise]:
        """What freeing each set of numbers promises, by the names of `suspects.calibration`."""
        from .counterfactual import promising
        from .suspects.calibration import subsets

        return {} if self.baseline is None else promising(self.baseline, subsets(self.rig))

    def freed(self, names: tuple[str, ...]) -> Change:
        """Returns the change that the first half of the tracks chooses for these numbers, unjudged; computed once."""
        from .counterfactual import tested

        if names not in self._freed:
            if self.baseline is None:
                raise ValueError("there is no scene")
            self._freed[names] = tested(self.baseline, names).change
        return self._freed[names]

    @cached_property
    def _freed(self) -> dict[tuple[str, ...], Change]:
        return {}

    @cached_property
    def outcomes(self) -> dict[str, Crossed]:
        """By key of a suspect: what its change does, of those that were tested."""
        return {}


def examination(sequence: Sequence, first: int, last: int, advance: Callable[[], None] = lambda: None) -> Examination:
    """Reads measurements `first` to `last` (both included). Raises InputError where an image is unreadable.

    `advance` is called after each measurement, and may raise to end the work.
    """
    rig = sequence.rig
    kind = "video" if rig.video is not None else "stereo"
    sizes = {name: _halvings(camera.longer_side_px) for name, camera in rig.cameras.items()}
    shots: list[Shot] = []
    for i in range(first, last + 1):
        measured = sequence.load(i) if sequence.kinds[i] in ("video", "stereo") else None
        if isinstance(measured, Frame):
            images = {name: _grey(image, sizes[name]) for name, image in measured.images.items()}
            shots.append(Shot(i, measured.time_ns, images))
        advance()
    smaller = {n: camera.scaled(0.5 ** sizes[n]) for n, camera in rig.cameras.items() if sizes[n]}
    own = np.array([k == kind for k in sequence.kinds[: last + 1]], bool)
    reduced = {name: 2**count for name, count in sizes.items() if count}
    return Examination(rig.changed(**smaller), tuple(shots), sequence.times_ns[: last + 1][own], reduced)


def exchanged(seen: Examination) -> Examination:
    """Returns it with the left and right images exchanged."""

    def swapped(shot: Shot) -> Shot:
        images = shot.images
        return (
            replace(shot, images={**images, "left": images["right"], "right": images["left"]}) if shot.is_pair else shot
        )

    return replace(seen, shots=tuple(map(swapped, seen.shots)))


def _halvings(side_px: int) -> int:
    return max(0, int(np.ceil(np.log2(side_px / LONGEST_SIDE_PX))))


def _grey(image: Image, halvings: int) -> Image:
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    for _ in range(halvings):
        size = (round(grey.shape[1] / 2), round(grey.shape[0] / 2))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(grey, np.uint8)
