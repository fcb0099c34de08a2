"""`sim:calibration`: somebody films a target with three cameras, rendered; its truth is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ispom.geometry import Pose
from ispom.settings import Range
from ispom.simulation.board import Exposing, Picture, board_image
from ispom.simulation.filming import PAUSE_S, Filming, board_poses, filming_rig
from ispom.types import FrameName, Image, Rig

BLUR_SAMPLES = 7
CAMERAS: tuple[FrameName, ...] = ("video", "left", "right")


@dataclass(frozen=True)
class How:
    """How it is filmed."""

    views: Annotated[int, Range(1, 200)] = 25
    """Exposures of each camera, at the same times."""
    seed: Annotated[int, Range(0, 2**31)] = 0
    """Of the board's poses and the noise."""
    alike: bool = False
    """The bad views of somebody who never tilts the board nor moves it far."""
    blur_ms: Annotated[float, Range(0, 200)] = 0.0
    """How long the shutter is open while the cameras move."""
    noise: Annotated[float, Range(0, 50)] = 2.0
    """Of the sensor [grey levels]."""


@dataclass(frozen=True, eq=False)
class FilmedBoard:
    """The images, each rendered when it is asked for; the same bytes each time."""

    rig: Rig
    """The truth; its frame is that of the left camera."""
    picture: Picture
    how: How
    path: Filming

    @staticmethod
    def of(picture: Picture, size_m: tuple[float, float], camera: FrameName, how: How) -> FilmedBoard:
        """Of a board of this size, held for `camera` (the others see what they see of it)."""
        rig = filming_rig()
        poses = board_poses(rig.camera(camera), size_m, max(how.views, 4), how.seed, how.alike)
        left_from_camera = rig.rig_from_left.inverse() @ rig.rig_from(camera)
        return FilmedBoard(rig, picture, how, Filming(rig, tuple(left_from_camera @ pose for pose in poses), 0.0))

    def image(self, camera: FrameName, i: int) -> Image:
        """Exposure i (H, W), grey."""
        camera_from_left = self.rig.rig_from(camera).inverse() @ self.rig.rig_from_left
        poses = tuple(camera_from_left @ pose for pose in self._left_from_board(i))
        noise_seed = self.how.seed * 1000 + 3 * i + CAMERAS.index(camera)
        return board_image(
            self.picture, self.rig.camera(camera), poses, Exposing(noise=self.how.noise, seed=noise_seed)
        )

    def _left_from_board(self, i: int) -> tuple[Pose, ...]:
        """During the exposure."""
        if not self.how.blur_ms:
            return (self.path.left_from_board[i],)
        offsets_s = 1e-3 * self.how.blur_ms * ((np.arange(BLUR_SAMPLES) + 0.5) / BLUR_SAMPLES - 0.5)
        times = (PAUSE_S * i + offsets_s).clip(0, self.path.duration_s)
        return tuple(self.path.left_from_board_at(float(t)) for t in times)
