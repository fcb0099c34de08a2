"""`ispom grade`."""

from __future__ import annotations

from ...features.grading.options import Grade as Options
from ..call import Call

PLACE = 190


def execute(options: Options, call: Call) -> int:
    from ...features.grading.command import grade

    return grade(options)
