"""Forking a run, and what can be done with its branches."""

from __future__ import annotations

from ispom.methods import Config

from ...session.commands import Command, PageCommand
from ...session.controller import Controller
from ...session.registry import handles
from .service import BranchService


class Fork(Command, frozen=True):
    """At the frame that is shown: run on from that exact state with these methods and settings, as a branch; the run
    itself is kept."""

    methods: tuple[str, ...]
    config: Config
    name: str = ""
    """Of the branch; empty for a made-up one."""


class ShowBranch(PageCommand, frozen=True):
    """Show another branch, at the same frame."""

    number: int


class RenameBranch(Command, frozen=True):
    number: int
    name: str


class HideBranch(Command, frozen=True):
    """Draw a branch together with the shown one, or not."""

    number: int
    hidden: bool


class DeleteBranch(Command, frozen=True):
    """Discard a branch that is not shown. Those forked from it stay."""

    number: int


@handles(Fork)
def fork(session: Controller, command: Fork) -> None:
    session.service(BranchService).fork(command.methods, command.config, command.name)
    session.store.set(playing=True)


@handles(ShowBranch)
def show_branch(session: Controller, command: ShowBranch) -> None:
    session.service(BranchService).show(command.number)


@handles(RenameBranch)
def rename_branch(session: Controller, command: RenameBranch) -> None:
    session.service(BranchService).rename(command.number, command.name)


@handles(HideBranch)
def hide_branch(session: Controller, command: HideBranch) -> None:
    session.service(BranchService).hide(command.number, command.hidden)


@handles(DeleteBranch)
def delete_branch(session: Controller, command: DeleteBranch) -> None:
    session.service(BranchService).delete(command.number)
