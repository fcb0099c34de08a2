"""`ispom map`."""

from __future__ import annotations

from ...features.mapping.options import Map as Options
from ..call import Call

PLACE = 140


def execute(options: Options, call: Call) -> int:
    from ...features.mapping.command import make_map

    return make_map(options)
