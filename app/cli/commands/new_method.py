"""`ispom new-method`."""

from __future__ import annotations

from ...features.grading.options import NewMethod as Options
from ..call import Call

PLACE = 180


def execute(options: Options, call: Call) -> int:
    from ...features.grading.scaffold import new_method

    return new_method(options)
