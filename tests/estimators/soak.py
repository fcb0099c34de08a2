"""A run without end over small made images: does an exposure cost as much, and a State hold as much, as at first?

`python -m tests.estimators.soak` walks 20,000 exposures through every method and prints a table; `test_soak.py` walks
fewer, and looks at sizes only.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, partial
from itertools import count, islice
from typing import Any

import cv2
import numpy as np

from ispom.ensemble import build
from ispom.geometry import Pose
from ispom.methods import Config, Variant, with_asked
from ispom.persistent_list import PersistentList
from ispom.types import Camera, Exposure, Frame, Image, Rig, StereoPair, VideoFrame

LAP = 240
"""Video frames of one round; then the images come again."""
STEREO_EVERY = 4
"""Video frames from pair to pair."""
FRAME_NS = 33_333_333
STOP = 240
"""The video frame at which in some scenarios the world changes."""
MEASURED_EVERY = 10
"""Exposures: to walk a State takes about as long as a step."""
RADIUS_M, BALLS, BALL_M = 4.0, 900, 0.1


def rig() -> Rig:
    """160 x 120 pixels, a baseline of 0.3 m, a video camera beside the left one."""
    camera = Camera(160, 120, 115.0, 115.0, 79.5, 59.5)
    pair = Rig.stereo(camera, 0.3)
    beside = Pose(translation=np.array([0.0, -0.05, 0.02]))
    return Rig(camera, pair.left, pair.right, beside, pair.rig_from_left, pair.rig_from_right)


@cache
def image(name: Frame, frame: int) -> Image:
    """What a camera sees at one of the LAP places of a round trip through a cloud of balls."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform((-14, -5, -14), (14, 5, 14), (BALLS, 3))
    grey = rng.integers(60, 255, BALLS)
    angle = 2 * np.pi * frame / LAP
    place = RADIUS_M * np.array([1 - np.cos(angle), 0.0, np.sin(angle)])
    world_from_rig = Pose.from_rotvec(np.array([0.0, angle, 0.0]), place)
    camera, near = rig().camera(name), (world_from_rig @ rig().rig_from(name)).inverse().apply(xyz)
    drawn = np.full((camera.height, camera.width), 20, np.uint8)
    ahead = np.flatnonzero((near[:, 2] > 1) & (np.abs(near[:, :2]) < near[:, 2:]).all(axis=1))
    uv = camera.project(near)
    for i in ahead[np.argsort(-near[ahead, 2])]:
        centre = (round(16 * uv[i, 0]), round(16 * uv[i, 1]))
        cv2.circle(drawn, centre, round(16 * camera.fx * BALL_M / near[i, 2]), int(grey[i]), -1, cv2.LINE_AA, 4)
    noise = np.random.default_rng(frame).normal(0, 1.5, drawn.shape)
    return np.clip(drawn + noise, 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Scenario:
    """What the platform does, and which exposures come."""

    name: str
    method: str
    place: Callable[[int], int]
    """Where on the round trip a video frame is taken."""
    video: bool = True
    stereo: bool = True
    pairs_end: bool = False
    """No pair comes after STOP."""
    blank: tuple[Frame, ...] = ()
    """Cameras that see nothing more after STOP."""

    def exposures(self) -> Iterator[Exposure]:
        """Without end."""
        for i in count():
            time_ns, place = i * FRAME_NS, self.place(i)
            if self.stereo and i % STEREO_EVERY == 0 and not (self.pairs_end and i > STOP):
                yield StereoPair(time_ns, self._seen("left", i, place), self._seen("right", i, place))
            if self.video:
                yield VideoFrame(time_ns, self._seen("video", i, place))

    def _seen(self, name: Frame, i: int, place: int) -> Image:
        return np.full((120, 160), 7, np.uint8) if i > STOP and name in self.blank else image(name, place % LAP)


def moving(i: int) -> int:
    return i


def still(i: int) -> int:
    """Noise changes from frame to frame all the same, as places are those of images with another noise."""
    return 0 * i


def stopping(i: int) -> int:
    return min(i, STOP)


def far(i: int) -> int:
    """Pairs alone: as far apart as video frames."""
    return i // STEREO_EVERY


SCENARIOS = (
    Scenario("monocular moving", "monocular", moving, stereo=False),
    Scenario("monocular still", "monocular", still, stereo=False),
    Scenario("monocular stops", "monocular", stopping, stereo=False),
    Scenario("monocular goes blank", "monocular", moving, stereo=False, blank=("video",)),
    Scenario("stereo moving", "stereo", far, video=False),
    Scenario("stereo still", "stereo", still, video=False),
    Scenario("stereo goes blank", "stereo", far, video=False, blank=("left", "right")),
    Scenario("integrated moving", "integrated", moving),
    Scenario("integrated still", "integrated", still),
    Scenario("integrated stops", "integrated", stopping),
    Scenario("integrated, pairs end", "integrated", moving, pairs_end=True),
    Scenario("integrated, pairs go blank", "integrated", moving, blank=("left", "right")),
    Scenario("integrated, video goes blank", "integrated", moving, blank=("video",)),
)


def size(state: Any) -> tuple[int, int]:
    """Values that a State holds, those apart that are the trajectory itself, and bytes of its arrays, each once."""
    values, arrays, seen, waiting = 0, 0, set[int](), [state]
    while waiting:
        value = waiting.pop()
        if id(value) in seen or isinstance(value, PersistentList):
            continue
        seen.add(id(value))
        values += 1
        if isinstance(value, np.ndarray):
            base = value if value.base is None or not isinstance(value.base, np.ndarray) else value.base
            if base is value or id(base) not in seen:
                seen.add(id(base))
                arrays += base.nbytes
        elif is_dataclass(value) and not isinstance(value, type):
            waiting += [getattr(value, f.name) for f in fields(value)]
        elif isinstance(value, tuple | list | set | frozenset):
            waiting += value
        elif isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, partial):
            waiting += value.args
    return values, arrays


@dataclass(frozen=True)
class Lap:
    """Some hundred exposures."""

    values: int
    """At most, of the State."""
    arrays: int
    """Bytes, at most."""
    cpu_s: float
    tracking: int
    """Steps with a pose."""


SETTINGS: dict[str, dict[str, Any]] = {
    "monocular": {"max_tracks": 80},
    "stereo": {"max_tracks": 80},
    "integrated": {"max_points": 80, "max_views": 120},
    "monocular.paper": {"max_tracks": 80},
    "stereo.paper": {"matching": "klt", "max_tracks": 80},
    "integrated.paper": {},
}
"""Few tracks: small images."""


def config(name: str) -> Config:
    """For a method and those that it asks."""
    found = Config()
    for method in with_asked((name,)):
        found = found.with_settings(method, replace(found.of(method), **SETTINGS[method]))
    return found


def laps(scenario: Scenario, variant: Variant, exposures: int, length: int = 100) -> list[Lap]:
    """A run, measured in pieces."""
    name = scenario.method if variant == "modern" else f"{scenario.method}.paper"
    ensemble = build(config(name), (name,), rig())
    state, found, stream = ensemble.start(), [], islice(scenario.exposures(), exposures)
    while piece := list(islice(stream, length)):
        values, arrays, tracking, used_s = 0, 0, 0, 0.0
        for i, exposure in enumerate(piece):
            before = time.process_time()
            state, steps = ensemble.step(state, exposure)
            used_s += time.process_time() - before
            tracking += any(step.world_from_frame is not None for step in steps)
            if i % MEASURED_EVERY == 0:
                now = size(state)
                values, arrays = max(values, now[0]), max(arrays, now[1])
        found.append(Lap(values, arrays, used_s, tracking))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--exposures", type=int, default=20_000, help="2,000 or more")
    parser.add_argument("--scenario", default="")
    parser.add_argument("--variant", choices=("modern", "paper"), action="append")
    chosen = parser.parse_args()
    head = ("ms CPU, 1,000 to 2,000", "last 1,000", "ratio", "State, MB", "last 1,000", "values", "last 1,000", "posed")
    sys.stdout.write(" | ".join([" " * 37, *head]) + "\n")
    for variant in chosen.variant or ("modern", "paper"):
        for scenario in (s for s in SCENARIOS if chosen.scenario in s.name):
            found = laps(scenario, variant, chosen.exposures)
            early, late = found[10:20], found[-10:]
            ms = [10 * sum(lap.cpu_s for lap in part) / len(part) for part in (early, late)]
            arrays = [max(lap.arrays for lap in part) / 1e6 for part in (early, late)]
            values = [max(lap.values for lap in part) for part in (early, late)]
            posed = sum(lap.tracking for lap in found) / chosen.exposures
            sys.stdout.write(
                f"{variant:8} {scenario.name:28} | {ms[0]:22.2f} | {ms[1]:10.2f} | {ms[1] / ms[0]:5.2f} "
                f"| {arrays[0]:9.2f} | {arrays[1]:10.2f} | {values[0]:6} | {values[1]:10} | {100 * posed:.0f} %\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
