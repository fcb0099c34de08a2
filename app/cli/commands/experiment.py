"""`ispom experiment`."""

from __future__ import annotations

from ...features.experiments.options import Experiment as Options
from ..call import Call

PLACE = 50


def execute(options: Options, call: Call) -> int:
    from ...features.experiments.command import experiment

    return experiment(options, call.builder)
