"""Integrated (section 6.3). Settings first; the estimator follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ispom.estimators.monocular import MonocularConfig
from ispom.estimators.stereo import StereoConfig
from ispom.types import Rig


@dataclass(frozen=True)
class IntegratedConfig:
    """Settings of the integration (section 6.3)."""

    interpolation: Literal["linear", "bspline"] = "bspline"
    """Of video positions at stereo exposures; rotations are interpolated spherically."""

    def build(self, rig: Rig, monocular: MonocularConfig, stereo: StereoConfig):
        raise NotImplementedError
