"""Exposures without end, at little cost: small images of a round trip through a cloud of balls, made when asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import count, islice

import cv2
import numpy as np

from ispom.geometry import Pose
from ispom.types import Camera, Frame, FrameName, Image, Kind, Measurement, Rig, Sequence

LAP = 240
"""Video frames of one round; then the images come again."""
STEREO_EVERY = 4
"""Video frames from pair to pair."""
FRAME_NS = 33_333_333
STOP = 240
"""The video frame at which in some scenarios the world changes."""
RADIUS_M, BALLS, BALL_M = 4.0, 900, 0.1


def rig() -> Rig:
    """160 x 120 pixels, a baseline of 0.3 m, a video camera beside the left one."""
    camera = Camera(160, 120, 115.0, 115.0, 79.5, 59.5)
    pair = Rig.stereo(camera, 0.3)
    beside = Pose(translation=np.array([0.0, -0.05, 0.02]))
    return pair.changed(video=camera, rig_from_video=beside)


def world_from_rig(frame: int) -> Pose:
    """At one of the LAP places of the round trip."""
    angle = 2 * np.pi * frame / LAP
    place = RADIUS_M * np.array([1 - np.cos(angle), 0.0, np.sin(angle)])
    return Pose.from_rotvec(np.array([0.0, angle, 0.0]), place)


@cache
def image(name: FrameName, frame: int) -> Image:
    """What a camera sees at one of the LAP places of a round trip."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform((-14, -5, -14), (14, 5, 14), (BALLS, 3))
    grey = rng.integers(60, 255, BALLS)
    camera, near = rig().camera(name), (world_from_rig(frame) @ rig().rig_from(name)).inverse().apply(xyz)
    drawn = np.full((camera.height, camera.width), 20, np.uint8)
    ahead = np.flatnonzero((near[:, 2] > 1) & (np.abs(near[:, :2]) < near[:, 2:]).all(axis=1))
    uv = camera.project(near)
    for i in ahead[np.argsort(-near[ahead, 2])]:
        centre = (round(16 * uv[i, 0]), round(16 * uv[i, 1]))
        cv2.circle(drawn, centre, round(16 * camera.fx * BALL_M / near[i, 2]), int(grey[i]), -1, cv2.LINE_AA, 4)
    noise = np.random.default_rng(frame).normal(0, 1.5, drawn.shape)
    return np.clip(drawn + noise, 0, 255).astype(np.uint8)


def moving(i: int) -> int:
    return i


def still(_: int) -> int:
    return 0


def stopping(i: int) -> int:
    return min(i, STOP)


@dataclass(frozen=True)
class Scenario:
    """What the platform does, and which exposures come."""

    name: str
    kinds: frozenset[Kind]
    """Of a method that needs just these."""
    place: Callable[[int], int] = moving
    """Where on the round trip an image is taken."""
    pairs_end: bool = False
    """No pair comes after STOP."""
    blank: tuple[FrameName, ...] = ()
    """Cameras that see nothing more after STOP."""

    def exposures(self) -> Iterator[Measurement]:
        """Without end."""
        return (self._exposure(i, kind) for i, kind in self._index())

    def sequence(self, exposures: int) -> Sequence:
        """The first ones, randomly accessible; no images are kept but those of one round."""
        index = list(islice(self._index(), exposures))
        times_ns = np.array([i * FRAME_NS for i, _ in index], np.int64)
        return Sequence(
            self.name, rig(), times_ns, tuple(kind for _, kind in index), lambda n: self._exposure(*index[n])
        )

    def _index(self) -> Iterator[tuple[int, Kind]]:
        """Video frame and kind of each exposure."""
        for i in count():
            if "stereo" in self.kinds and i % STEREO_EVERY == 0 and not (self.pairs_end and i > STOP):
                yield i, "stereo"
            if "video" in self.kinds:
                yield i, "video"

    def _exposure(self, i: int, kind: Kind) -> Measurement:
        time_ns = i * FRAME_NS
        place = self.place(i if "video" in self.kinds else i // STEREO_EVERY)  # pairs alone: as near as video frames
        if kind == "video":
            return Frame.video(time_ns, self._seen("video", i, place))
        return Frame.stereo(time_ns, self._seen("left", i, place), self._seen("right", i, place))

    def _seen(self, name: FrameName, i: int, place: int) -> Image:
        return np.full((120, 160), 7, np.uint8) if i > STOP and name in self.blank else image(name, place % LAP)


VIDEO: frozenset[Kind] = frozenset({"video"})
STEREO: frozenset[Kind] = frozenset({"stereo"})
SCENARIOS = (
    Scenario("moving", VIDEO),
    Scenario("still", VIDEO, still),
    Scenario("stops", VIDEO, stopping),
    Scenario("goes blank", VIDEO, blank=("video",)),
    Scenario("moving", STEREO),
    Scenario("still", STEREO, still),
    Scenario("goes blank", STEREO, blank=("left", "right")),
    Scenario("moving", VIDEO | STEREO),
    Scenario("still", VIDEO | STEREO, still),
    Scenario("stops", VIDEO | STEREO, stopping),
    Scenario("pairs end", VIDEO | STEREO, pairs_end=True),
    Scenario("pairs go blank", VIDEO | STEREO, blank=("left", "right")),
    Scenario("video goes blank", VIDEO | STEREO, blank=("video",)),
)
