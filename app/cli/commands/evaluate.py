"""`ispom evaluate`."""

from __future__ import annotations

from ...features.evaluation.options import Evaluate as Options
from ..call import Call

PLACE = 110


def execute(options: Options, call: Call) -> int:
    from ...features.evaluation.command import evaluate

    return evaluate(options)
