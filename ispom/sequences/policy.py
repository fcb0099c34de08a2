"""Which sources somebody may open who is not at the command line: whoever types one into the page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import bounded, expanded, inside
from ispom.sequences.address import is_address, is_device, without_secrets


@dataclass(frozen=True)
class SourcePolicy:
    """Simulations are always allowed, but for files that their words name. What is not allowed is refused without a
    look at whether it is there."""

    root: Path | None = None
    """Only what is inside of this folder is opened, links followed: the source, and all files that belong to it. None:
    anything."""
    devices: bool = True
    """Whether cameras of this machine may be opened."""
    network: bool = True
    """Whether addresses may be opened."""
    named: tuple[Path, ...] = ()
    """Files outside of the root that are allowed as well: those that the command line names."""

    @property
    def places(self) -> tuple[Path, ...] | None:
        """What `bounded` takes."""
        return None if self.root is None else (self.root, *self.named)

    def check(self, source: str) -> None:
        """InputError where the source may not be opened."""
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
"""For what the command line itself names."""
