"""Tracks of image points, and the landmarks of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array


class TrackStatus(IntEnum):
    """State of a track in this image. From LOST on the track ended, for the reason in the name."""

    ALIVE = 0
    NEW = 1
    LOST = 2
    FORWARD_BACKWARD = 3
    OUT_OF_IMAGE = 4
    EPIPOLAR = 5
    REPROJECTION = 6
    RIGID = 7
    NO_DISPARITY = 8
    UNMATCHED = 9

    @property
    def dropped(self) -> bool:
        return self >= TrackStatus.LOST

    @property
    def reason(self) -> str:
        """The reason for which the track ended, as a clause."""
        return {
            0: "alive",
            1: "new",
            2: "not found again",
            3: "forward-backward check failed",
            4: "left the image",
            5: "off the epipolar line",
            6: "reprojection error too large",
            7: "does not fit the rigid motion",
            8: "no reliable left-right match",
            9: "descriptor match not found or ambiguous",
        }[int(self)]


@dataclass(frozen=True, eq=False, repr=False)
class Tracks:
    """The image points of one camera at one frame, with those that ended in it."""

    ids: NDArray[np.int64]
    """(N,) unique for the run of one estimator."""
    uv: NDArray[np.float32]
    """(N, 2) [px]; the last known position of an ended track."""
    uv_prev: NDArray[np.float32]
    """(N, 2) [px] in the same camera's previous frame; NaN where new."""
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""
    residual_px: NDArray[np.float32]
    """(N,) reprojection error of the last pose estimate; NaN for points that were not used."""
    disparity_px: NDArray[np.float32]
    """(N,) left minus right column; NaN where unknown (and in the video camera)."""

    def __repr__(self) -> str:
        ended = int((self.status != TrackStatus.ALIVE).sum())
        return f"Tracks({len(self.ids) - ended} alive, {ended} ended)"

    @staticmethod
    def of(ids: NDArray, uv: NDArray, **others: NDArray) -> Tracks:
        """Returns tracks with NaN or ALIVE for missing arrays."""
        n = len(ids)
        nan1, nan2 = np.full(n, np.nan, np.float32), np.full((n, 2), np.nan, np.float32)
        return Tracks(
            np.asarray(ids, np.int64),
            np.asarray(uv, np.float32).reshape(n, 2),
            np.asarray(others.get("uv_prev", nan2), np.float32),
            np.asarray(others.get("status", np.zeros(n)), np.uint8),
            np.asarray(others.get("residual_px", nan1), np.float32),
            np.asarray(others.get("disparity_px", nan1), np.float32),
        )

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False, repr=False)
class Landmarks:
    """Points of the scene, in the world (and unit) of the trajectory that they belong to."""

    ids: NDArray[np.int64]
    """(M,) the ids of their tracks."""
    xyz_in_world: Array
    """(M, 3)."""
    rgb: NDArray[np.uint8]
    """(M, 3)."""

    @staticmethod
    def empty() -> Landmarks:
        return Landmarks(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))

    def __len__(self) -> int:
        return len(self.ids)

    def __repr__(self) -> str:
        return f"Landmarks({len(self)})"


@dataclass(frozen=True, eq=False)
class ImageLines:
    """Straight lines to draw on an image: detected segments, optical flow, the outline of a tag."""

    uv: NDArray[np.float32]
    """(N, 2, 2) [px]: both ends."""
    group: NDArray[np.int64]
    """(N,) 0 or larger: lines of one group have one colour; -1: those that the method does not use."""

    @staticmethod
    def of(uv: NDArray, group: NDArray | int = 0) -> ImageLines:
        """Returns lines (N, 2, 2) [px] of these groups, or all of one."""
        uv = np.asarray(uv, np.float32).reshape(-1, 2, 2)
        return ImageLines(uv, np.broadcast_to(np.asarray(group, np.int64), len(uv)).copy())

    def __len__(self) -> int:
        return len(self.uv)


@dataclass(frozen=True, eq=False)
class WorldLines:
    """Straight lines of the scene: a map of lines, the sides of tags."""

    xyz_in_world: Array
    """(N, 2, 3): both ends."""
    group: NDArray[np.int64]
    """(N,) as in ImageLines."""

    @staticmethod
    def empty() -> WorldLines:
        return WorldLines(np.zeros((0, 2, 3)), np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.group)
