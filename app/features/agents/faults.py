"""What the libraries of the protocol log about requests of others: a line each, without traceback, and not too many."""

from __future__ import annotations

import logging
from collections.abc import Callable

from ispom.errors import printable

LOGGERS = ("mcp", "uvicorn", "sse_starlette")
MOST, WITHIN_S = 10, 60.0
"""Most lines that are logged within this time; further ones are only counted."""


class OneLine(logging.Handler):
    """Writes each record as one line: what happened, and the exception's name and words where there is one."""

    def __init__(self, write: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._write, self._since_s, self._count = write, float("-inf"), 0

    def emit(self, record: logging.LogRecord) -> None:
        if record.created - self._since_s >= WITHIN_S:
            if self._count > MOST:
                self._write(f"agents: {self._count - MOST} more such lines are left out")
            self._since_s, self._count = record.created, 0
        self._count += 1
        if self._count <= MOST:
            self._write(printable(" ".join(_text(record).split())))


def _text(record: logging.LogRecord) -> str:
    text = f"agents: {record.getMessage()}"
    fault = record.exc_info[1] if record.exc_info else None
    return text if fault is None else f"{text}: {type(fault).__name__} {fault}"


def in_one_line(write: Callable[[str], None]) -> None:
    """From now on these libraries log to `write`, and nowhere else."""
    handler = OneLine(write)
    for name in LOGGERS:
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
