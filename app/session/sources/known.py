"""The runs that a page's address may name: those that were opened before, and those beside the recordings."""

from __future__ import annotations

from pathlib import Path, PurePath

from ispom.errors import InputError
from ispom.sequences.address import is_address, is_device

from ...engine.run_folder.run_folder import RUN
from ..state import State


def run_name(source: str) -> str:
    """What an address calls a source: of a path the last part."""
    if source.startswith("sim:") or is_device(source) or is_address(source):
        return source
    return PurePath(source).name or source


class Known:
    """`recordings` is their folder."""

    def __init__(self, recordings: Path) -> None:
        self.folder = recordings

    def source(self, name: str, state: State) -> str:
        """The source of a name, as the list of recordings has it or `run_name` gives it.

        InputError where nothing is known by it.
        """
        runs = [str(path.parent) for path in sorted(self.folder.glob(f"*/{RUN}"))]
        recorded = [str(self.folder / kept.name) for kept in state.recordings]
        if name in {kept.name for kept in state.recordings}:
            return str(self.folder / name)
        for source in (state.source, *state.recent, *runs, *recorded):
            if run_name(source) == name:
                return source
        raise InputError(f"there is no run called {name[:60]!r} here: open its source, or correct the address")
