"""What the paper's stereo method remembers from pair to pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.features.interfaces import Features
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.types import Image


@dataclass(frozen=True, eq=False)
class Cloud:
    """The points of one stereo pair, with what finds them again in the next left image."""

    grey: Image
    ids: NDArray[np.int64]
    features: Features
    disparity_px: NDArray[np.float32]
    xyz_in_left: Array

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class StereoState:
    reference: Cloud | None = None
    """Of the last located pair."""
    world_from_rig: Pose | None = None
    """Of the last located pair."""
    lost_pairs: int = 0
    next_id: int = 0
    poses: PersistentList[tuple[int, Pose]] = PersistentList()
