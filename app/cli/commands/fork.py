"""`ispom fork`."""

from __future__ import annotations

from ...features.headless.options import Fork as Options
from ..call import Call

PLACE = 60


def execute(options: Options, call: Call) -> int:
    from ...features.headless.fork import fork

    return fork(options, call.words, call.builder)
