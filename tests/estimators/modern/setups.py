"""What modern estimators are set up with, for tests of their parts."""

from __future__ import annotations

from typing import Any

import numpy as np

from ispom.estimators.modern.monocular.setup import LOSS, Setup
from ispom.features.front_ends import front_end
from ispom.numerics.robust import Noise
from ispom.types import Camera


def monocular_setup(camera: Camera) -> Setup:
    """Returns default settings, with a calibration that is exact."""
    return Setup(
        camera,
        Noise(0.34, LOSS),
        np.zeros(2),
        max_tracks=500,
        key_frames=10,
        start_parallax_rad=0.02,
        point_parallax_rad=0.01,
        min_parallax_deg=2.5,
        min_share=0.3,
        max_view_angle_deg=10,
        max_interval_s=1,
        relocalise=True,
        follow="static",
        front_end=front_end("klt"),
    )


def setup_of(estimator: Any) -> Any:
    """What a modern estimator hands to its parts. It is no public part of it, and tests take it out here alone."""
    return estimator._setup
