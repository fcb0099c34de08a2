"""`ispom hello`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from ispom_app.cli.call import Call

PLACE = 999


@dataclass(frozen=True)
class Options:
    """Says hello."""

    name: str = "world"


def execute(options: Options, call: Call) -> int:
    sys.stdout.write(f"hello {options.name}\n")
    return 3
