"""What our page and the server say to each other: the state as JSON, and commands."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from .. import colours
from ..session import commands as do
from ..session.state import State


@dataclass(frozen=True)
class Pane:
    """How a page has its left pane."""

    wide: bool
    """Whether viser's scene can be seen beside its panel."""


def message_of(state: State) -> dict[str, Any]:
    """What the status bar shows."""
    recording = state.recording
    return {
        "source": state.source,
        "name": state.name or state.source,
        "notes": state.notes,
        "phase": state.phase,
        "run": state.run,
        "total": state.total,
        "computed": state.computed,
        "index": state.index,
        "time_s": round(state.time_s, 3),
        "playing": state.playing,
        "target": state.target,
        "ended": state.ended,
        "activity": state.activity.text if state.activity else None,
        "methods": [
            {
                "name": method,
                "colour": colours.css(colours.METHOD[method]),
                "status": str(now.status) if (now := state.statuses.get(method)) else None,
                "error_m": now.error_m if now else None,
            }
            for method in state.methods
        ],
        "recording": {"name": recording.name, "size_bytes": recording.size_bytes, "closing": recording.closing}
        if recording
        else None,
        "notices": [{"number": n.number, "text": n.text, "kind": n.kind} for n in state.notices],
    }


def command_of(text: str) -> do.Command | Pane | None:
    """What a page's message says; None for anything that is not understood."""
    try:
        message = json.loads(text)
        match message["do"]:
            case "play":
                return do.Play()
            case "step":
                return do.StepBy(int(message["by"]))
            case "seek":
                return do.Seek(int(message["index"]))
            case "record":
                return do.Record("")
            case "pane":
                return Pane(bool(message["wide"]))
    except (ValueError, TypeError, KeyError):
        pass
    return None
