"""What our page and the server say to each other: the state as JSON, and commands."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

from ispom.errors import is_text
from ispom.methods import method as registered
from ispom.methods import names

from ...features.lessons.commands import EndLesson, Learn, Reveal, TurnTo
from ...features.lessons.learning import covered
from ...features.plots.plotting import DEFAULT_PLOTS
from ...features.sweep.values import shown
from ...presentation import colours
from ...presentation.texts import ALIGNED, PROVISIONAL, length, size
from ...session import commands as do
from ...session.actions import ACTIONS, BY_NAME
from ...session.sources.known import run_name
from ...session.state import State
from ..rerun.blueprint import hidden_paths
from ..rerun.layers import LAYERS, MEASURES

STATUS = {
    "waiting": "no exposure for this method yet",
    "initialising": "no pose yet",
    "tracking": "it has a pose at this exposure, which says nothing about accuracy",
    "lost": "no pose at this exposure",
}
NO_PLOTS = "none"
"""In an address: nothing is plotted."""
OWN_UNIT = "A single camera has no metric scale: its path is scaled by the first segment between stereo poses."


KEYS = [{"name": action.name, "key": action.key, "label": action.label, "hint": action.hint} for action in ACTIONS]
"""Of the page: what it listens to, and lists."""


@dataclass(frozen=True)
class Pane:
    """How a page has its left pane."""

    wide: bool
    """Whether viser's scene can be seen beside its panel."""
    tab: str = ""
    """Which of the panel's tabs is open."""


@dataclass(frozen=True)
class Given:
    """An answer to the question of a lesson, from whomever it comes."""

    answer: Any
    """As it was sent."""


@dataclass(frozen=True)
class FollowAgain:
    """The page shows again what the session shows, and nothing of its own."""


@dataclass(frozen=True)
class Wheel:
    """Who drives from now on."""

    to: int | None = None
    """The number of a person; None for the one who asks."""


def message_of(state: State) -> dict[str, Any]:
    """What the status bar shows, and what the Rerun viewer is to show."""
    covers = state.lesson is not None and state.lesson.covers
    state, recording = covered(state), state.recording
    compared = None if covers else state.comparison
    return {
        "source": state.source,
        "name": state.name or state.source,
        "address": {
            "lesson": f"{state.lesson.lesson.name}:{state.lesson.place + 1}" if state.lesson else "",
            "run": run_name(state.source),
            "branch": state.branch,
            "hidden": sorted(state.hidden),
            "plots": "" if state.plots == DEFAULT_PLOTS else ",".join(state.plots) or NO_PLOTS,
        },
        "branches": [branch.number for branch in state.branches],
        "compared": compared and [compared.shown, compared.other, compared.done, compared.finished],
        "notes": state.notes,
        "guess": None if state.guess is None else round(100 * state.guess.sigma, 1),
        "phase": state.phase,
        "run": state.run,
        "recording_id": state.recording_id,
        "total": state.total,
        "computed": state.computed,
        "index": state.index,
        "time_s": round(state.time_s, 3),
        "playing": state.playing,
        "speed": state.speed,
        "selected": state.selected,
        "colour_by": state.colour_by,
        "camera": state.camera,
        "look": state.look,
        "flicker": _flicker(state),
        "integration": [state.integration.method, state.integration.stage] if state.integration else None,
        "effect": _effect(state),
        "sweep": _sweep(state),
        "loop": [state.loop.start, state.loop.end] if state.loop else None,
        "target": state.target,
        "ended": state.ended,
        "activity": state.activity.text if state.activity else None,
        "compiling": state.compiling,
        "methods": [] if covers else [_method(method, state) for method in state.methods],
        "hidden": hidden_paths(state.methods, state.hidden | ({MEASURES} if covers else set()), state.colour_by),
        "recording": {"name": recording.name, "size": size(recording.size_bytes), "closing": recording.closing}
        if recording
        else None,
        "question": None
        if state.question is None
        else {"number": state.question.number, "text": state.question.text, "yes": state.question.yes},
        "notices": [{"number": n.number, "text": n.text, "kind": n.kind} for n in state.notices],
    }


def own_view(local: State, state: State) -> dict[str, Any] | None:
    """What a page that looks around by itself shows otherwise than the session; None where it follows."""
    if local is state:
        return None
    shared = message_of(state)
    return {name: value for name, value in message_of(local).items() if value != shared[name]}


def _flicker(state: State) -> list[Any] | None:
    """Which side is drawn ("a" or "b"), its branch and its method."""
    if state.flicker is None:
        return None
    return ["b" if state.flicker.on_b else "a", state.flicker.shown.branch, state.flicker.shown.method]


def _effect(state: State) -> dict[str, Any] | None:
    """What is wrong with the calibration, and how far that moves each method: as predicted, and in the rerun [m]."""
    if state.effect is None:
        return None
    predicted = {each.method: each.shift_m for each in state.effect.predictions}
    found = {each.prediction.method: each.shift_m for each in state.effect.outcomes}
    return {"wrong": state.effect.wrong.said, "predicted": predicted, "rerun": found}


def _sweep(state: State) -> dict[str, Any] | None:
    """Its folder, how far it is, and the errors of the runs that are over, by value."""
    sweep = state.sweep
    if sweep is None:
        return None
    found = {shown(o.value): (o.values or {}).get("ate_m") for o in sweep.outcomes.values()}
    return {"name": sweep.name, "share": round(sweep.share, 3), "ended": sweep.ended, "ate_m": found}


def _method(method: str, state: State) -> dict[str, Any]:
    """Whether it tracks, and (another thing) its error: the ATE of the table of branches, where there is a truth."""
    now, label = state.statuses.get(method), colours.label(method)
    status = str(now.status) if now else "waiting"
    hint, error = [f"{label}: {STATUS[status]}."], ""
    shown = next((b for b in state.branches if b.number == state.branch), None)
    if shown is not None and (known := shown.measured.errors.get(method)) is not None:
        error, how = length(known.ate_m), ALIGNED[known.alignment]
        hint.append(f"ATE: {error} from the ground truth over {len(known.estimate)} poses, as known now, {how}.")
    if now is not None and now.provisional:
        error = error or PROVISIONAL
        hint.append("Its pose at this exposure is provisional: the first fit replaces it.")
    if now is not None and now.error_m is not None:
        hint.append(f"Live error at this exposure: {length(now.error_m)}, by the pose as given then, not aligned.")
        hint += [OWN_UNIT] if registered(method).unit == "own" else []
    return {
        "name": method,
        "label": label,
        "colour": colours.css(colours.of(method)),
        "status": status,
        "error": error,
        "hint": "\n".join(hint),
    }


def command_of(text: str) -> do.Command | Pane | Wheel | FollowAgain | Given | None:
    """What a page's message says; None for anything that is not understood."""
    try:
        message = json.loads(text)
        match message["do"]:
            case "seek":
                return do.Seek(int(message["index"]))
            case "plot":
                return do.Plot(str(message["name"]))
            case "plots":
                plots = str(message["names"])
                return do.SetPlots(None if not plots else () if plots == NO_PLOTS else tuple(plots.split(",")))
            case "speed":
                factor = message["factor"]
                return do.Speed(None if factor is None else min(max(float(factor), 0.01), 100.0))
            case "record":
                return do.Record("")
            case "confirm":
                return do.Confirm(int(message["number"]), message["yes"] is True)
            case "open_named":
                return do.OpenNamed(str(message["run"]))
            case "show_branch":
                return do.ShowBranch(int(message["number"]))
            case "open" if is_text(str(message["source"])):
                return do.Open(str(message["source"]).strip())
            case "compare_runs":
                return do.CompareRuns(str(message["a"]), str(message["b"]))
            case "note" if is_text(str(message["note"])):
                return do.PutNote(str(message["name"]), str(message["note"]))
            case "hide":
                return do.Hide(frozenset(map(str, message["names"])) & {*LAYERS, *names()})
            case "pane":
                return Pane(bool(message["wide"]), str(message.get("tab", "")))
            case "follow":
                return FollowAgain()
            case "take_over":
                return Wheel()
            case "hand_over":
                return Wheel(int(message["to"]))
            case "answer":
                return Given(message["given"])
            case "learn":
                name, _, step = str(message["lesson"]).partition(":")
                return Learn(name, int(step) - 1 if step else None)
            case "turn_to":
                return TurnTo(int(message["place"]))
            case "reveal":
                return Reveal()
            case "end_lesson":
                return EndLesson()
            case "select":
                return do.Select(str(message["what"]))
            case "pick":
                at = int(message["index"]), float(message["u"]), float(message["v"])
                return do.Pick(str(message["camera"]), *at) if all(map(math.isfinite, at)) else None
            case str(name) if name in BY_NAME:
                return BY_NAME[name].command
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
        pass
    return None
