"""`ispom run`."""

from __future__ import annotations

from ...features.headless.options import Run as Options
from ..call import Call

PLACE = 40


def execute(options: Options, call: Call) -> int:
    from ...features.headless.command import run

    return run(options, call.builder)
