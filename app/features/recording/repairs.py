"""Recordings that an app which was stopped left unfinished: found, and repaired beside the run."""

from __future__ import annotations

import logging
from pathlib import Path
from threading import Thread

from ispom.errors import InputError
from ispom.io.whole import whole_of

from ...engine.run_folder.run_folder import is_locked
from ...views.rerun.repair import finish, unfinished

log = logging.getLogger(__name__)


class Repairs:
    """Of one folder. Used by one thread; the work is done in another."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._thread: Thread | None = None
        self._problems: list[str] = []

    def found(self) -> tuple[str, ...]:
        """Names of the unfinished recordings that nobody is writing; none where the folder cannot be read."""
        try:
            return tuple(path.name for path in self._left())
        except OSError as fault:
            log.warning("unfinished recordings cannot be listed: %s", fault)
            return ()

    @property
    def busy(self) -> bool:
        return self._thread is not None

    def start(self) -> None:
        """Begins to repair all of them; nothing where that goes on already."""
        if self._thread is None:
            self._problems = []
            self._thread = Thread(target=self._run, name="repair", daemon=True)
            self._thread.start()

    def ended(self) -> list[str] | None:
        """Once, when it is over: what could not be repaired, a sentence each."""
        if self._thread is None or self._thread.is_alive():
            return None
        self._thread = None
        return self._problems

    def _left(self) -> list[Path]:
        if not self._folder.is_dir():
            return []
        hidden = [path for path in unfinished(self._folder) if path != whole_of(path)]
        return [path for path in hidden if not is_locked(whole_of(path))]

    def _run(self) -> None:
        try:
            for path in self._left():
                try:
                    finish(path)
                except InputError as problem:
                    self._problems.append(str(problem))
        except Exception as fault:
            log.exception("repairing recordings failed")
            self._problems.append(f"internal fault, please report it: {type(fault).__name__}: {fault}")
