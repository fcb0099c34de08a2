"""What the session is asked for while runs are published; no page may send it."""

from __future__ import annotations

from ispom.errors import InputError

from ...session.branches.service import BranchService
from ...session.commands import Command
from ...session.controller import Controller


class AddRun(Command, frozen=True):
    """Add a finished run as a branch of the one that is shown."""

    path: str
    """Of its folder."""
    name: str
    compares: bool = True
    """Whether the two are compared: they are on the same source."""

    def execute(self, session: Controller) -> None:
        found = session.screen.opener.stored(self.path, session.setup.history_bytes)
        if found is None:
            raise InputError(f"{self.path} holds no run: give a folder that `ispom run` wrote")
        branches = session.service(BranchService)
        number = branches.add(found, self.name, 0, (), reproducible=True, show=False)
        if self.compares:
            branches.compare(number)
