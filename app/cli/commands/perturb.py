"""`ispom perturb`."""

from __future__ import annotations

from ...features.sensitivity.options import Perturb as Options
from ..call import Call

PLACE = 150


def execute(options: Options, call: Call) -> int:
    from ...features.sensitivity.perturb import perturb

    return perturb(options, call.builder)
