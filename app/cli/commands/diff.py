"""`ispom diff`."""

from __future__ import annotations

from ...features.diff.options import Diff as Options
from ..call import Call

PLACE = 70


def execute(options: Options, call: Call) -> int:
    from ...features.diff.command import diff

    return diff(options)
