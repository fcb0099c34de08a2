"""`ispom target`."""

from __future__ import annotations

from ...features.calibration.options import PrintTarget as Options
from ..call import Call

PLACE = 100


def execute(options: Options, call: Call) -> int:
    from ...features.calibration.target import print_target

    return print_target(options)
