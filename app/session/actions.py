"""Actions: each has a key, an entry of the command palette, and a line in the list of keys, defined here once."""

from __future__ import annotations

from dataclasses import dataclass

from . import commands as do
from .commands import PageCommand


@dataclass(frozen=True)
class Action:
    place: int
    """Its order in the list of keys."""
    name: str
    """Name that the page's scripts use."""
    key: str
    """The key in the notation of the page's keyboard.js: the browser's name of the key, letters in lower case, and
    "Shift+" before it."""
    label: str
    hint: str
    """What it does, in one sentence."""
    command: PageCommand


_ACTIONS: dict[str, Action] = {}


def offer(action: Action) -> None:
    """Adds an action to the keys, the palette and the list."""
    _ACTIONS[action.name] = action


def actions() -> tuple[Action, ...]:
    return tuple(sorted(_ACTIONS.values(), key=lambda action: action.place))


KEYFRAME = "at which any of the running methods made a keyframe"
for _each in (
    Action(10, "play", "Space", "Play / pause", "Plays or pauses, at the chosen speed.", do.Play()),
    Action(20, "forward", "ArrowRight", "Step", "One frame on.", do.StepBy(1)),
    Action(30, "back", "ArrowLeft", "Step back", "One frame back.", do.StepBy(-1)),
    Action(40, "stereo", "Shift+ArrowRight", "Next stereo frame", "On to a stereo frame.", do.StepTo("stereo")),
    Action(
        50,
        "stereo_back",
        "Shift+ArrowLeft",
        "Previous stereo frame",
        "Back to a stereo frame.",
        do.StepTo("stereo", False),
    ),
    Action(60, "key_frame", "k", "Next keyframe", f"On to a frame {KEYFRAME}.", do.StepTo("key_frame")),
    Action(
        70,
        "key_frame_back",
        "Shift+k",
        "Previous keyframe",
        f"Back to a frame {KEYFRAME}.",
        do.StepTo("key_frame", False),
    ),
    Action(100, "start", "Home", "Go to the start", "The first frame.", do.Seek(0)),
    Action(110, "end", "End", "Go to the end", "The newest computed frame.", do.GoToEnd()),
    Action(
        120, "loop_start", "i", "Loop from here", "Playing goes round from the frame shown on.", do.LoopEdge("start")
    ),
    Action(130, "loop_end", "o", "Loop to here", "Playing goes round up to the frame shown.", do.LoopEdge("end")),
    Action(140, "no_loop", "l", "No loop", "Playing goes on to the end again.", do.NoLoop()),
):
    offer(_each)
