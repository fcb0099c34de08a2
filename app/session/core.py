"""What the commands of the core do."""

from __future__ import annotations

from ispom.sequences.address import without_secrets

from . import commands as do
from . import moves
from .controller import Controller
from .registry import handles
from .state import NoticeAdded, changed


@handles(do.Play)
def play(session: Controller, command: do.Play) -> None:
    session.player.move(*moves.play(session.state, session.run, command.on))


@handles(do.StepBy)
def step_by(session: Controller, command: do.StepBy) -> None:
    session.player.move(*moves.step(session.state, session.run, command.count))


@handles(do.StepTo)
def step_to(session: Controller, command: do.StepTo) -> None:
    session.player.move(*moves.step_to(session.state, session.run, command.kind, forwards=command.forwards))


@handles(do.Seek)
def seek(session: Controller, command: do.Seek) -> None:
    session.player.move(*moves.seek(session.run, command.index))


@handles(do.GoToEnd)
def go_to_end(session: Controller, command: do.GoToEnd) -> None:
    session.player.move(*moves.to_end(session.run))


@handles(do.LoopEdge)
def set_loop_edge(session: Controller, command: do.LoopEdge) -> None:
    session.store.emit(*moves.loop_edge(session.state, command.edge))


@handles(do.NoLoop)
def end_loop(session: Controller, command: do.NoLoop) -> None:
    session.store.set(loop=None)


@handles(do.Speed)
def set_speed(session: Controller, command: do.Speed) -> None:
    session.player.move(changed(speed=command.factor))


@handles(do.Restart, closing=lambda session, command: "Starting again from the first frame")
def restart(session: Controller, command: do.Restart) -> None:
    session.restart(command.methods, command.config)


@handles(do.Open, closing=lambda session, command: f"Opening {without_secrets(command.source)}")
def open_source(session: Controller, command: do.Open) -> None:
    if session.open(command.source, command.options):
        session.play_on()


@handles(do.Notify)
def notify(session: Controller, command: do.Notify) -> None:
    session.store.emit(NoticeAdded(command.text))
