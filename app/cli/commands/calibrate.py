"""`ispom calibrate`."""

from __future__ import annotations

from ...features.calibration.options import Calibrate as Options
from ..call import Call

PLACE = 90


def execute(options: Options, call: Call) -> int:
    from ...features.calibration.command import calibrate

    return calibrate(options)
