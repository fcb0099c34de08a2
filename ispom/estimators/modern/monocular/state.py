"""What the modern monocular estimator keeps from frame to frame, and what one frame leads to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.modern.monocular.covariance import Spread
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.start import Start
from ispom.estimators.modern.monocular.tracks import Followed, Live
from ispom.geometry import Array, Pose
from ispom.persistent_list import PersistentList
from ispom.types import Decision, Status


@dataclass(frozen=True, eq=False)
class ModernMonocularState:
    live: Live = Live()
    start: Start | None = None
    """While there is no map."""
    map: Map | None = None
    recent: tuple[tuple[int, Pose], ...] = ()
    """The last two poses, for the motion model."""
    missed: int = 0
    """Frames since the last pose."""
    spread: Spread | None = None
    """How sure the map is, since the last key frame."""
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    """(6, 6) of the last pose."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """Poses that nothing will revise."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one frame led to; the rest of the Step follows from it."""

    followed: Followed
    status: Status
    pose: Pose | None = None
    map: Map | None = None
    start: Start | None = None
    key_frame: bool = False
    decisions: tuple[Decision, ...] = ()
    residual_px: NDArray[np.float32] | None = None
    covariance: Array | None = None
    spread: Spread | None = None
    scale: float | None = None
    settled: tuple[tuple[int, Pose], ...] = ()
    missed: int = 0
    compared: NDArray[np.bool_] | None = None
    """Which tracks were found by the patch of their origin."""
