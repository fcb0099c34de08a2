"""`ispom publish`."""

from __future__ import annotations

from ...features.publish.options import Publish as Options
from ..call import Call

PLACE = 135


def execute(options: Options, call: Call) -> int:
    from ...features.publish.command import publish

    return publish(options)
