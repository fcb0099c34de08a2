"""`ispom export`."""

from __future__ import annotations

from ...features.export.options import Export as Options
from ..call import Call

PLACE = 120


def execute(options: Options, call: Call) -> int:
    from ...features.export.export import export

    return export(options)
