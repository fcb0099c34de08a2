"""`ispom mcp`."""

from __future__ import annotations

from ...features.agents.options import Mcp as Options
from ..call import Call

PLACE = 75


def execute(options: Options, call: Call) -> int:
    from ...features.agents.command import serve

    return serve(options, call.builder)
