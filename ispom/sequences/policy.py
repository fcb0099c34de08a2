"""The sources that users of the page may open, who are not at the command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import bounded, expanded, inside
from ispom.sequences.address import is_address, is_device, without_secrets


@dataclass(frozen=True)
class SourcePolicy:
    """The allowed sources. Simulations are always allowed, but the files that they name are checked. A forbidden path
    is refused without a check of its existence."""

    root: Path | None = None
    """Folder that must contain the source and all files that belong to it, links followed; None for any folder."""
    devices: bool = True
    """Whether cameras of this machine may be opened."""
    network: bool = True
    """Whether addresses may be opened."""
    named: tuple[Path, ...] = ()
    """Files outside of the root that are also allowed: those of the command line."""

    @property
    def places(self) -> tuple[Path, ...] | None:
        """The argument of `bounded`."""
        return None if self.root is None else (self.root, *self.named)

    def check(self, source: str) -> None:
        """Raises InputError where the source may not be opened."""
        if source.startswith("sim:"):
            return
        if is_device(source):
            if not self.devices:
                raise InputError(f"{source} is a camera of the machine: start the app with --allow-devices to open it")
        elif is_address(source):
            if not self.network:
                name = without_secrets(source)
                raise InputError(f"{name} is on the network: start the app with --allow-network to open it")
        else:
            with bounded(self.places):
                if not inside(expanded(source)):
                    raise InputError(f"{source} is outside of {self.root}: give a path inside of that folder")


ANY_SOURCE = SourcePolicy()
"""The policy for the command line."""
