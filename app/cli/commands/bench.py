"""`ispom bench`."""

from __future__ import annotations

from ...features.benchmark.options import Bench as Options
from ..call import Call

PLACE = 170


def execute(options: Options, call: Call) -> int:
    from ...features.benchmark.command import bench

    return bench(options)
