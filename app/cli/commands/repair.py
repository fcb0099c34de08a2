"""`ispom repair`."""

from __future__ import annotations

from ...features.recording.options import Repair as Options
from ..call import Call

PLACE = 160


def execute(options: Options, call: Call) -> int:
    from ...features.recording.repair_command import repair

    return repair(options)
