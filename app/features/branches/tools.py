"""Forks, for agents."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from ispom.errors import InputError
from ispom.methods import Config, method
from ispom.settings import check, from_plain

from ...session import moves
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.controller import Controller
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool
from .commands import ShowBranch

Value = bool | int | float | str


def with_settings(config: Config, values: dict[str, Value]) -> Config:
    """The config with these settings, by METHOD.SETTING as flags have them. InputError for what is none, or no value of
    it."""
    for key, value in values.items():
        name, _, setting = key.rpartition(".")
        setting = setting.replace("-", "_")
        try:
            kind = method(name).config
        except (KeyError, InputError):
            raise InputError(f"{key[:60]!r} is no setting: give METHOD.SETTING, such as stereo.max-tracks") from None
        given = from_plain(kind, {setting: value}, name)
        changed = replace(config.of(name), **{setting: getattr(given, setting)})  # type: ignore[type-var]
        check(changed, f"{name}.")
        config = config.with_settings(name, changed)
    return config


def fork(
    agents: AgentSession,
    frame: Annotated[int, "The last frame that the fork shares with the run; the next one has the new settings."],
    settings: Annotated[dict[str, Value], 'By METHOD.SETTING, such as {"stereo.max-tracks": 300}; others stay.'],
    methods: Annotated[list[str], "Methods from there on; empty for those of the run."] = [],  # noqa: B006
    name: Annotated[str, "Of the branch; empty for a made-up one."] = "",
) -> dict[str, Any]:
    """Forks the open run from its exact state after a frame, with other settings, as a branch that is open then. Call
    compute to run it, and diff with branch:NUMBER to compare. The run itself is kept, and open_branch goes back to
    it."""
    index = agents.frame(frame)

    def work(controller: Controller) -> int:
        controller.player.move(*moves.seek(controller.run, index))
        run = controller.run
        if run is None:
            raise InputError("no run is open: call list_runs, then open_run")
        before = run.playback
        config = with_settings(before.config, settings)
        controller.service(BranchService).fork(tuple(methods) or before.methods, config, name)
        return controller.state[Branches].shown

    number = agents.carry_out(work)
    branch = next(b for b in agents.state[Branches].all if b.number == number)
    return {"branch": number, "name": branch.name, "first_frame": branch.at, "changes": list(branch.changes)}


def open_branch(
    agents: AgentSession, number: Annotated[int, "Of a branch, as in `summary`; 0 is the run itself."]
) -> dict[str, Any]:
    """Opens another branch of the run: the other tools are about it from then on."""
    agents.branch(number)
    agents.carry_out(lambda controller: ShowBranch(number).execute(controller))
    return {"branch": number, "computed": len(agents.run.series)}


TOOLS = (Tool(fork, changes=True, moves=True), Tool(open_branch, moves=True))
