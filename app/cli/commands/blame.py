"""`ispom blame`."""

from __future__ import annotations

from ...features.blame.options import Blame as Options
from ..call import Call

PLACE = 95


def execute(options: Options, call: Call) -> int:
    from ...features.blame.command import blame

    return blame(options, call.builder)
