"""What the paper's monocular method remembers from frame to frame, and what a frame does to its key frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.monocular.scale_transfer import ScaleStep
from ispom.estimators.paper.monocular.window import KeyFrameWindow
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.solvers.multiview.triple import Triple
from ispom.types import Decision, Image


@dataclass(frozen=True, eq=False)
class MonocularState:
    grey: Image | None = None
    """The previous image."""
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) of the points alive in it, ascending."""
    uv: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """(N, 2) [px]."""
    next_id: int = 0
    window: KeyFrameWindow = KeyFrameWindow()
    scale: ScaleStep | None = None
    """What the next triple takes its unit from."""
    settled: PersistentList[tuple[int, Pose]] = PersistentList()
    """Poses that nothing will revise."""


@dataclass(frozen=True, eq=False)
class Revision:
    """What a frame did to the window of key frames."""

    window: KeyFrameWindow
    scale: ScaleStep | None
    decisions: tuple[Decision, ...]
    triple: Triple | None = None
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """The points that took part in the triple."""
    step_scale: float | None = None
    lost: bool = False

    def telling(self, *decisions: Decision) -> Revision:
        """The same, and these besides."""
        return replace(self, decisions=(*self.decisions, *decisions))
