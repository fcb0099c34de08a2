"""`ispom sources`."""

from __future__ import annotations

from ...features.sources.description import Sources as Options
from ..call import Call

PLACE = 80


def execute(options: Options, call: Call) -> int:
    from ...features.sources.description import print_description

    return print_description(options.open(options.source))
