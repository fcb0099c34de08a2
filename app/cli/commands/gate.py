"""`ispom gate`."""

from __future__ import annotations

from ...features.gate.options import Gate as Options
from ..call import Call

PLACE = 75


def execute(options: Options, call: Call) -> int:
    from ...features.gate.command import gate

    return gate(options, call.builder)
