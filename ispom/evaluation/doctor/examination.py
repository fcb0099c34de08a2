"""Data of a stretch that several suspects need; they are computed once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from ispom.evaluation.sensors.judged import SensorsJudged, judged
from ispom.evaluation.sensors.scene import SensorScene
from ispom.types import Frame, Image, Sequence

from .adjustment import Promise
from .counterfactual import Baseline, Crossed, baseline, promising, tested
from .groups import subsets
from .hypothesis import Change
from .start import Start, start
from .stretch import Shot, Stretch
from .tracking import Tracked, track

LONGEST_SIDE_PX = 700
"""Larger images are halved, once or more: the causes show at this size, too, and take a quarter of the time."""


@dataclass(frozen=True, eq=False)
class Examination(Stretch):
    """A stretch with its tracks, its scene, and the effects of free numbers of the calibration."""

    sensors: SensorScene | None = None
    """Measurements of other sensors around the stretch, and the path of the images there; None where it is unknown."""

    @cached_property
    def judged(self) -> SensorsJudged:
        """Returns the claims about these sensors; none without sensors."""
        return SensorsJudged() if self.sensors is None else judged(self.sensors)

    @property
    def has_judged(self) -> bool:
        """Whether that is computed already."""
        return "judged" in self.__dict__

    @cached_property
    def tracked(self) -> Tracked:
        """Corners, tracked through the main camera's frames and into the pairs."""
        return track(self)

    @cached_property
    def start(self) -> Start | None:
        """A first rigid scene of the tracks; None where they show no parallax."""
        return start(self, self.tracked)

    @cached_property
    def baseline(self) -> Baseline | None:
        """Returns that scene, fitted with the stated calibration."""
        return None if self.start is None else baseline(self.start, self.rig)

    @cached_property
    def halves(self) -> tuple[Baseline, ...]:
        """The scene fitted to each half of the tracks, and judged by the other; empty where there is none."""
        if self.start is None or self.baseline is None:
            return ()
        return self.baseline, baseline(self.start, self.rig, ~self.start.held_out)

    @cached_property
    def promises(self) -> dict[tuple[str, ...], Promise]:
        """Returns the predicted effect of freeing each set of numbers, by the names of `groups`."""
        return {} if self.baseline is None else promising(self.baseline, subsets(self.rig))

    def freed(self, names: tuple[str, ...]) -> Change:
        """Returns the change that the first half of the tracks chooses for these numbers, unjudged; computed once."""
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
        """Returns the effects of tested changes by key of the suspect."""
        return {}


def examination(sequence: Sequence, first: int, last: int, advance: Callable[[], None] = lambda: None) -> Examination:
    """Reads measurements `first` to `last` (both included). Raises InputError where an image is unreadable.

    `advance` is called after each measurement, and may raise to end the work.
    """
    rig = sequence.rig
    kind = "video" if rig.video is not None else "stereo"
    sizes = {name: halvings(camera.longer_side_px) for name, camera in rig.cameras.items()}
    shots: list[Shot] = []
    for i in range(first, last + 1):
        measured = sequence.load(i) if sequence.kinds[i] in ("video", "stereo") else None
        if isinstance(measured, Frame):
            images = {name: grey(image, sizes[name]) for name, image in measured.images.items()}
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


def halvings(side_px: int) -> int:
    """Returns how often images whose longer side is this are halved before they are examined."""
    return max(0, int(np.ceil(np.log2(side_px / LONGEST_SIDE_PX))))


def grey(image: Image, times: int) -> Image:
    """Returns the image in grey, with its width and height halved `times` times."""
    made = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    for _ in range(times):
        size = (round(made.shape[1] / 2), round(made.shape[0] / 2))
        made = cv2.resize(made, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(made, np.uint8)
