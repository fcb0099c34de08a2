"""Forking a run, and what can be done with its branches."""

from __future__ import annotations

from ispom.methods import Config

from ...session.branches.service import BranchService
from ...session.commands import Command, PageCommand
from ...session.controller import Controller


class Fork(Command, frozen=True):
    """At the frame that is shown: run on from that exact state with these methods and settings, as a branch; the run
    itself is kept."""

    methods: tuple[str, ...]
    config: Config
    name: str = ""
    """Of the branch; empty for a made-up one."""

    def execute(self, session: Controller) -> None:
        session.service(BranchService).fork(self.methods, self.config, self.name)
        session.store.set(playing=True)


class ShowBranch(PageCommand, frozen=True):
    """Show another branch, at the same frame."""

    number: int

    def execute(self, session: Controller) -> None:
        session.service(BranchService).show(self.number)


class RenameBranch(Command, frozen=True):
    number: int
    name: str

    def execute(self, session: Controller) -> None:
        session.service(BranchService).rename(self.number, self.name)


class HideBranch(Command, frozen=True):
    """Draw a branch together with the shown one, or not."""

    number: int
    hidden: bool

    def execute(self, session: Controller) -> None:
        session.service(BranchService).hide(self.number, self.hidden)


class DeleteBranch(Command, frozen=True):
    """Discard a branch that is not shown. Those forked from it stay."""

    number: int

    def execute(self, session: Controller) -> None:
        session.service(BranchService).delete(self.number)
