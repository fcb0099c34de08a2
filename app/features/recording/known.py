"""The runs that may be named: those that were opened before, and those beside the recordings."""

from __future__ import annotations

from pathlib import Path

from ispom.errors import InputError

from ...engine.run_folder.run_folder import RUN
from ...session.sources.names import run_name
from ...session.state import State
from .listing import list_recordings


class Known:
    """`recordings` is their folder."""

    def __init__(self, recordings: Path) -> None:
        self._recordings = recordings

    def source(self, name: str, state: State) -> str:
        """The source of a name, as the list of recordings has it or `run_name` gives it.

        InputError if nothing is known by it.
        """
        runs = [str(path.parent) for path in sorted(self._recordings.glob(f"*/{RUN}"))]
        listed = [kept.name for kept in list_recordings(self._recordings)]  # another process may have finished a run
        recorded = [str(self._recordings / kept) for kept in listed]
        if name in listed:
            return str(self._recordings / name)
        for source in (state.source, *state.recent, *runs, *recorded):
            if run_name(source) == name:
                return source
        raise InputError(f"there is no run called {name[:60]!r} here: open its source, or correct the address")
