"""What the session is asked for while runs are published; no page may send it."""

from __future__ import annotations

from ispom.errors import InputError

from ...session.branches.service import BranchService
from ...session.commands import Command
from ...session.controller import Controller


class AddRun(Command, frozen=True):
    """Add a finished run on the same source as a branch of the one that is shown, and compare the two."""

    path: str
    """Of its folder."""
    name: str

    def execute(self, session: Controller) -> None:
        found = session.screen.opener.stored(self.path, session.setup.history_bytes)
        if found is None:
            raise InputError(f"{self.path} holds no run: give a folder that `ispom run` wrote")
        branches = session.service(BranchService)
        branches.compare(branches.add(found, self.name, 0, (), reproducible=True, show=False))
