"""`ispom learn`."""

from __future__ import annotations

from ...views.web.options import Learn as Options
from ..call import Call

PLACE = 30


def execute(options: Options, call: Call) -> int:
    from ...views.web.command import open_page

    return open_page(options, call.builder)
