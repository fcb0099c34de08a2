"""`fused` over the relative poses of a stereo pair: their unit is the metre from the first pair on, so that no start is
waited for but that of the fixes' heading; wheels and fixes correct drift, and the IMU gives up and bridges what the
images lose. See `fused` for the graph and its references.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from ispom.estimator import STEREO
from ispom.estimators.survey.fused import Fused, FusedConfig, method_of
from ispom.settings import checked
from ispom.types import Rig


@dataclass(frozen=True)
class FusedStereoConfig(FusedConfig):
    """Settings of `fused.stereo`."""

    def build(self, rig: Rig) -> Fused:
        """Returns the estimator. Raises InputError without a sensor of the scheme, or without gtsam."""
        return Fused(rig, checked(self), "fused.stereo", "stereo")


METHOD = partial(
    method_of, "fused.stereo", STEREO, FusedStereoConfig, "stereo", "Table 2: stereo images and other sensors"
)
