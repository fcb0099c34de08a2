"""Small things that are kept for the user between starts: JSON, in files of the user's own."""

from __future__ import annotations

import json
import logging
import os
import tempfile
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)


def read_json(path: Path | None) -> Any:
    """What the file has; None where it is missing or damaged, or there is none."""
    try:
        return json.loads(path.read_text("utf-8")) if path else None
    except (OSError, ValueError):
        return None


def write_json(path: Path | None, value: Any, what: str) -> None:
    """In one move, for another app may do the same; where it cannot be written, `what` is only not kept."""
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
            json.dump(value, file)
        os.replace(file.name, path)
    except OSError as fault:
        log.warning("%s cannot be written (%s): %s not kept", path, fault, what)
