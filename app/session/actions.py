"""What a key, an entry of the command palette, and a line of the list of keys stand for: said once for all three."""

from __future__ import annotations

from dataclasses import dataclass

from . import commands as do

ANY_KEY_FRAME = "at which any of the running methods made a key frame"


@dataclass(frozen=True)
class Action:
    name: str
    """By which the page asks for it."""
    key: str
    """As the page's keyboard.js writes it: a browser's name of the key, letters in lower case, "Shift+" before it."""
    label: str
    hint: str
    """What it does, in one sentence."""
    command: do.Moves | do.OfViews | do.ToggleBookmark


ACTIONS = (
    Action("play", "Space", "Play / pause", "Plays or pauses, at the chosen speed.", do.Play()),
    Action("forward", "ArrowRight", "Step", "One exposure on.", do.StepBy(1)),
    Action("back", "ArrowLeft", "Step back", "One exposure back.", do.StepBy(-1)),
    Action("stereo", "Shift+ArrowRight", "Next stereo exposure", "On to a stereo exposure.", do.StepTo("stereo")),
    Action(
        "stereo_back",
        "Shift+ArrowLeft",
        "Previous stereo exposure",
        "Back to a stereo exposure.",
        do.StepTo("stereo", forwards=False),
    ),
    Action("key_frame", "k", "Next key frame", f"On to an exposure {ANY_KEY_FRAME}.", do.StepTo("key_frame")),
    Action(
        "key_frame_back",
        "Shift+k",
        "Previous key frame",
        f"Back to an exposure {ANY_KEY_FRAME}.",
        do.StepTo("key_frame", forwards=False),
    ),
    Action("event", "n", "Next event", "On to a frame with an event, such as a loss or a warning.", do.StepToEvent()),
    Action(
        "event_back",
        "Shift+n",
        "Previous event",
        "Back to a frame with an event, such as a loss or a warning.",
        do.StepToEvent(forwards=False),
    ),
    Action("start", "Home", "Go to the start", "The first exposure.", do.Seek(0)),
    Action("end", "End", "Go to the end", "The newest computed exposure.", do.GoToEnd()),
    Action("loop_start", "a", "Loop from here", "Playing goes round from the exposure shown on.", do.LoopEdge("start")),
    Action("loop_end", "b", "Loop to here", "Playing goes round up to the exposure shown.", do.LoopEdge("end")),
    Action("no_loop", "l", "No loop", "Playing goes on to the end again.", do.NoLoop()),
    Action(
        "bookmark",
        "m",
        "Bookmark",
        "Marks the exposure shown; again: removes a mark without a note.",
        do.ToggleBookmark(),
    ),
    Action("flick", "x", "Flicker", "Draws the other of two methods or branches, see Flicker.", do.Flick()),
)
BY_NAME = {action.name: action for action in ACTIONS}
