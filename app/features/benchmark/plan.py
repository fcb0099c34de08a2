"""What is measured: sources, those of known data sets where they are found, and the methods on each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ispom.sequences import open_sequence
from ispom.types import Sequence


@dataclass(frozen=True)
class Case:
    """A source, the same stretch of it whatever its length, and the methods that it is for."""

    key: str
    title: str
    methods: tuple[str, ...]
    frames: int
    """Only the first ones of the video camera, and the pairs among them, are used."""
    source: str = ""
    """What `ispom run` would be given; empty for a data set that must be looked for."""
    places: tuple[str, ...] = ()
    """Where it may be below the data folder."""
    stereo_every: int = 1
    video_scale: float = 1.0

    def open(self) -> Sequence:
        """The stretch that is used. InputError where the source is not as it must be."""
        found = open_sequence(self.source, stereo_every=self.stereo_every, video_scale=self.video_scale)
        video = [i for i, kind in enumerate(found.kinds) if kind == "video"]
        return found.truncated(video[self.frames - 1] + 1 if self.frames <= len(video) else len(found))

    @property
    def simulated(self) -> bool:
        return self.source.startswith("sim:")


_KITTI = ("kitti/sequences", "kitti/dataset/sequences", "sequences", "dataset/sequences", "kitti", "")
_06, _00 = ((tuple(f"{folder}/{drive}".lstrip("/") for folder in _KITTI)) for drive in ("06", "00"))


def _both(*names: str) -> tuple[str, ...]:
    """These methods, modern and as published."""
    return tuple(variant for name in names for variant in (name, f"{name}.paper"))


CASES = (
    Case("sim-tiny", "sim:tiny, 3 s", _both("monocular", "stereo", "integrated"), 90, "sim:tiny"),
    Case("sim-city", "sim:city, its first 5 s", _both("monocular", "stereo", "integrated"), 150, "sim:city"),
    Case("kitti-06", "KITTI 06, its first 51 pairs", _both("monocular", "stereo"), 51, places=_06),
    Case(
        "kitti-06-two-rate",
        "KITTI 06, emulated video at half size, every 5th pair stereo",
        _both("integrated"),
        51,
        places=_06,
        stereo_every=5,
        video_scale=0.5,
    ),
    Case("kitti-00", "KITTI 00, its first 200 left images", _both("monocular"), 200, places=_00),
    Case(
        "handheld",
        "a hand-held camera over a checkerboard, 250 frames",
        _both("monocular"),
        250,
        places=("handheld_board",),
    ),
    Case(
        "euroc",
        "EuRoC V1_01, its first 20 pairs: standing still",
        _both("stereo"),
        20,
        places=("euroc_v1_01_start", "V1_01_easy", "euroc/V1_01_easy", "EuRoC/V1_01_easy", "vicon_room1/V1_01_easy"),
    ),
)


def found_below(case: Case, data: Path) -> Case | None:
    """The case with its source, or None where the data set is not there."""
    if case.source:
        return case
    place = next((data / place for place in case.places if (data / place).is_dir()), None)
    return None if place is None else replace(case, source=str(place))
