"""Runs an example of a GPL program with a stand-in for its package, which has the documented functions and exact truth:

    python stand_in.py orbslam3|svo EXAMPLE.py OTHER_FROM [OPTION ...]

From the frame OTHER_FROM on, the position is another one, as where threads ran in another order.
"""

from __future__ import annotations

import enum
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import yaml

POINTS, LOST_AT, STEP_M, OTHER_M = 60, 3, 0.1, 0.01
MOVED_SHARE = 0.002
"""Of its depth, by which adjustment moves a point from frame to frame."""


class Sensor(enum.IntEnum):
    MONOCULAR, STEREO = 0, 1


class TrackingState(enum.IntEnum):
    NO_IMAGES_YET, NOT_INITIALIZED, OK, RECENTLY_LOST, LOST, OK_KLT = range(6)


class Slam:
    """As pyorbslam3.Slam. A camera that moves along its axis, before points of a grid that it always sees."""

    other_from = 0

    def __init__(self, vocab_file, settings_file, sensor) -> None:
        assert Path(vocab_file).is_file()
        text = Path(settings_file).read_text()
        assert text.startswith("%YAML:1.0\n")
        self.settings = yaml.safe_load(text.partition("\n")[2])
        assert ("Camera.bf" in self.settings) == (sensor is Sensor.STEREO)
        u, v = np.meshgrid(np.linspace(-0.3, 0.3, 10), np.linspace(-0.2, 0.2, 6))
        self.points = np.column_stack([10 * u.ravel(), 10 * v.ravel(), np.full(POINTS, 10.0)])
        self.rng, self.count = np.random.default_rng(1), -1
        print("what the program prints must not disturb the answers")  # noqa: T201

    def track_stereo(self, left, right, timestamp):
        assert left.shape == right.shape and right.dtype == np.uint8
        return self.track_monocular(left, timestamp)

    def track_monocular(self, image, timestamp):
        assert image.shape == (self.settings["Camera.height"], self.settings["Camera.width"])
        self.count += 1
        self.pose = np.eye(4)
        self.pose[:3, 3] = OTHER_M * (self.count >= self.other_from), 0, STEP_M * self.count
        state = TrackingState.RECENTLY_LOST if self.count == LOST_AT else TrackingState.OK
        return SimpleNamespace(
            state=state, pose_wc=self.pose, pose_cw=np.linalg.inv(self.pose), num_tracked_points=POINTS
        )

    def tracked_map_points(self):
        moved = self.points + MOVED_SHARE * 10 * self.rng.uniform(-1, 1, (POINTS, 3))
        return self.rng.permutation(moved).astype(np.float32)

    def tracked_keypoints(self):
        seen, s = self.points - self.pose[:3, 3], self.settings
        uv = seen[:, :2] / seen[:, 2:] * (s["Camera.fx"], s["Camera.fy"]) + (s["Camera.cx"], s["Camera.cy"])
        return self.rng.permutation(uv).astype(np.float32)

    def map_changed(self) -> bool:
        return self.count == 4


class Stage(enum.IntEnum):
    PAUSED, FIRST_FRAME, SECOND_FRAME, DEFAULT_FRAME, RELOCALIZING = range(5)


class SVO:
    """As svo_cpp.SVO: it begins with the third image."""

    def __init__(self, camera) -> None:
        self.size, self.count, self.running = camera[:2], -1, False

    def start(self) -> None:
        self.running = True

    def addImage(self, image, timestamp) -> None:
        assert self.running and image.shape == self.size[::-1] and image.dtype == np.uint8
        self.count += 1

    def stage(self) -> Stage:
        return Stage.SECOND_FRAME if self.count < 2 else Stage.DEFAULT_FRAME

    def lastNumObservations(self) -> int:
        return 0 if self.count < 2 else 99

    def lastFrame(self):
        other = OTHER_M * (self.count >= Slam.other_from)
        place = np.array([[other], [0.0], [STEP_M * self.count]])
        return SimpleNamespace(T_f_w=SimpleNamespace(inverse=lambda: SimpleNamespace(translation=lambda: place)))


def main() -> None:
    which, example, other_from, *options = sys.argv[1:]
    Slam.other_from = int(other_from)
    values = {"Slam": Slam, "Sensor": Sensor, "TrackingState": TrackingState}
    if which == "svo":
        values = {"SVO": SVO, "Stage": Stage, "PinholeCamera": lambda *numbers: numbers}
    name = {"orbslam3": "pyorbslam3", "svo": "svo_cpp"}[which]
    sys.modules[name] = module = ModuleType(name)
    module.__dict__.update(values)
    sys.argv = [example, *options]
    runpy.run_path(example, run_name="__main__")


if __name__ == "__main__":
    main()
