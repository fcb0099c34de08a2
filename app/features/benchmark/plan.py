"""What is measured: sources, data sets where they are found, the methods on each, and what other programs reached.

Those were measured on two shared cores without a GPU. Times are medians per frame in U (unit.py); t_err as KITTI has it
over 5, 10, 20 and 40 m; ATE after alignment (SE(3) stereo, Sim(3) monocular). ORB-SLAM2 differs from run to run.
"""

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


@dataclass(frozen=True)
class Peer:
    name: str
    unit_ratio: str = "-"
    """Median time per frame in U, on one thread where not stated otherwise."""
    t_err_percent: str = "-"
    ate_m: str = "-"
    note: str = ""


PEERS: dict[tuple[str, str], tuple[Peer, ...]] = {
    ("kitti-06", "stereo"): (
        Peer("libviso2, default", "1.4", "0.98", "0.120"),
        Peer("libviso2, full size", "7.5", "0.87", "0.098"),
        Peer("ORB-SLAM2", "6.1", "0.67-0.75", "0.048-0.073", "one core; 2.6-3.5 on several"),
        Peer("an OpenCV tutorial", "7.7", "2.55", "0.394", "popular, in Python"),
        Peer("a prototype", "1.2", "1.02", "0.12", "Python, OpenCV and numba, window of 8 keyframes"),
    ),
    ("kitti-06", "monocular"): (
        Peer("ORB-SLAM2", "1.3", "0.55-0.67", "0.020-0.036", "several threads"),
        Peer("libviso2", "2.3", "2.74", "0.236"),
        Peer("pycolmap 4.2", "43", "0.62", "0.022", "incremental, two threads"),
    ),
    ("kitti-00", "monocular"): (
        Peer("ORB-SLAM2", "1.4", "3.2-3.65", "0.71-0.85", "several threads"),
        Peer("pycolmap 4.2", "88", "4.75", "1.20", "incremental, two threads"),
        Peer("libviso2", "2.3", "11.9", "2.75", "6 frames failed"),
    ),
    ("euroc", "stereo"): (
        Peer("libviso2", note="drifts 17 mm in 5 s"),
        Peer("ORB-SLAM2", note="drifts 1 mm in 5 s"),
    ),
}
"""By source and method."""

PEERS_UNIT_MS = 11.2
WINDOW_PEERS = "peers per solve: Ceres 11.5-24 ms, fixed-lag smoothers 24-104 ms, gtsam 67-106 ms"
