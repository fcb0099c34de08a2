"""Small JSON files that keep settings of the user between starts."""

from __future__ import annotations

import json
import logging
import os
import tempfile
from pathlib import Path
from typing import Any

log = logging.getLogger(__name__)


def read_json(path: Path | None) -> Any:
    """Returns the content of the file; None where the path is None, or the file is missing or damaged."""
    try:
        return json.loads(path.read_text("utf-8")) if path else None
    except (OSError, ValueError):
        return None


def write_json(path: Path | None, value: Any, what: str) -> None:
    """Writes the file atomically, because another app may write it, too. If that fails, `what` is only logged as not
    kept."""
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
            json.dump(value, file)
        os.replace(file.name, path)
    except OSError as fault:
        log.warning("%s cannot be written (%s): %s not kept", path, fault, what)
