"""A pose for every frame at once: resection from the last triple's points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.monocular.window import KeyFrameWindow
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Pose
from ispom.solvers.localisation import Policy, PoseFit, locate

MIN_POINTS = 10
"""Fewer known points than this, and a frame gets no pose of its own."""


@dataclass(frozen=True, eq=False)
class Resected:
    """The pose of a frame, and which of its points took part."""

    resection: PoseFit | None
    points: NDArray[np.int64]
    """(K,) index in the frame."""

    @property
    def pose(self) -> Pose | None:
        """world_from_camera."""
        return None if self.resection is None else self.resection.camera_from_world.inverse()


def resected(window: KeyFrameWindow, frame: TrackedFrame, limit: float) -> Resected:
    """From the prediction, else by RANSAC; inliers are within twice the `limit` (normalised)."""
    place = window.landmarks.places(frame.ids)
    known = np.flatnonzero(place >= 0)
    predicted = window.predicted()
    if predicted is None or len(known) < MIN_POINTS:
        return Resected(None, known)
    xyz, x = window.landmarks.xyz[place[known]], frame.x[known]
    return Resected(locate(xyz, x, predicted.inverse(), Policy(limit, 2 * limit, 2 * limit)), known)
