"""`ispom report`."""

from __future__ import annotations

from ...features.report.options import Report as Options
from ..call import Call

PLACE = 130


def execute(options: Options, call: Call) -> int:
    from ...features.report.command import report

    return report(options)
