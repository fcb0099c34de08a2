"""`ispom hello`, as a package adds it."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from ispom_app.cli.commands import Command


@dataclass(frozen=True)
class Hello:
    """Says hello."""

    name: str = "world"


def hello(options: Hello) -> int:
    sys.stdout.write(f"hello {options.name}\n")
    return 3


HELLO = Command("hello", Hello, hello)
