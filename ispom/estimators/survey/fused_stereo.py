"""`fused` over the relative poses of a stereo pair. Their unit is the metre from the first pair on, so the start only
waits for the heading by fixes. Wheels and fixes correct drift; the IMU measures up and bridges frames in which the
images are lost. See `fused` for the graph and its references.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from ispom.estimator import STEREO
from ispom.estimators.survey.fused import Fused, FusedConfig, method_of
from ispom.settings import Range, checked
from ispom.types import Rig


@dataclass(frozen=True)
class FusedStereoConfig(FusedConfig):
    """Settings of `fused.stereo`."""

    scale_percent: Annotated[float, Range(0.001, 20)] = 0.001
    """Change of the images' scale within a second (1 sigma), in percent; it grows with the square root of the time. The
    unit of a pair is constant; only its calibration can make it wrong."""

    def build(self, rig: Rig) -> Fused:
        """Returns the estimator. Raises InputError without a sensor of the scheme, or without gtsam."""
        return Fused(rig, checked(self), "fused.stereo", "stereo")


METHOD = partial(
    method_of, "fused.stereo", STEREO, FusedStereoConfig, "stereo", "Table 2: stereo images and other sensors"
)
