"""`ispom doctor`."""

from __future__ import annotations

from ...features.doctor.options import Doctor as Options
from ..call import Call

PLACE = 155


def execute(options: Options, call: Call) -> int:
    from ...features.doctor.command import doctor

    return doctor(options, call.builder)
