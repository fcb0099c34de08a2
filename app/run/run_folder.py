"""A folder that is complete or says that it is not."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from ispom.errors import InputError

MARKER = "INCOMPLETE"
"""The file that says so, and why."""


class RunFolder:
    """Where a run is written to. Every file appears whole or not at all; the marker goes last."""

    def __init__(self, path: Path) -> None:
        """InputError where the folder cannot be written to, or holds a complete run, which is never overwritten."""
        self.path = path
        if (path / "run.yaml").exists() and not (path / MARKER).exists():
            raise InputError(f"{path} holds a complete run: give another --out, or remove it first")
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{path} cannot be made ({error.strerror}): give another --out") from None
        self.write(MARKER, "This run has not ended, or was killed.\n")

    def remove(self, names: list[str]) -> None:
        """Takes away what an earlier, incomplete run left."""
        for name in names:
            (self.path / name).unlink(missing_ok=True)

    def write(self, name: str, content: str | bytes) -> None:
        """InputError where the disk does not take it; a file of that name stays as it was then."""
        part = self.part(name)
        try:
            part.write_bytes(content.encode() if isinstance(content, str) else content)
            os.replace(part, self.path / name)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise InputError(
                f"{self.path / name} cannot be written ({error.strerror}): make room, or give another --out"
            ) from None

    def part(self, name: str) -> Path:
        """Where a file is while it grows; `keep` gives it its name."""
        return self.path / f".part-{name}"

    def keep(self, name: str) -> None:
        """Gives a grown file its name, if there is one."""
        if self.part(name).exists():
            os.replace(self.part(name), self.path / name)

    def failed(self, reason: str) -> None:
        """Says why the run is not complete; where even that cannot be written, the marker stays as it was."""
        with suppress(InputError):
            self.write(MARKER, f"{reason}\n")

    def complete(self) -> None:
        (self.path / MARKER).unlink()
