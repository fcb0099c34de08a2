"""Runs, for agents: which there are, what the open one is, computing it, and its images."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any

from ispom.errors import InputError
from ispom.methods import method as registered

from ...session.branches.accuracy import measured
from ...session.branches.state import Branches
from ..agents.agent_session import AgentSession
from ..agents.tool import Picture, Tool, brief, page_of
from .folder import RecordedRuns
from .frame_picture import frame_picture
from .table import Row, arranged

WIDEST = 640
"""Pixels of a picture."""
LONGEST_S = 600.0
"""Longest time of one call of `compute`."""


def list_runs(
    agents: AgentSession,
    start: Annotated[int, "First row of the answer, for paging."] = 0,
    limit: Annotated[int, "Number of rows, at most 200."] = 20,
) -> dict[str, Any]:
    """Lists what can be opened: the sources that were named at the start (`named`), and the runs, recordings, sweeps
    and experiments in the folder of runs. A row has key (for open_run and diff), kind, source, parent (the run that
    it was forked from), differs (settings that are not the defaults), ate_m by method (absolute trajectory error [m],
    only with ground truth), located (share of frames with a pose, by method), and events (number of warnings and
    losses)."""
    rows = [_row(row) for row, _ in arranged(RecordedRuns(agents.runs).rows())]
    return {"named": list(agents.sources), "open": agents.state.source, **page_of(rows, start, limit)}


def _row(row: Row) -> dict[str, Any]:
    return {
        "key": row.key,
        "kind": row.kind,
        "source": row.source,
        "name": row.name,
        "parent": row.parent,
        "differs": list(row.differs),
        "ate_m": {error.method: brief(error.metres) for error in row.errors},
        "located": {name: brief(share) for name, share in (row.located or {}).items()},
        "events": None if row.events is None else {str(kind): n for kind, n in row.events.items()},
        "note": row.note or "",
    }


def open_run(
    agents: AgentSession,
    source: Annotated[
        str, "A key of list_runs, a source that was named at the start, or a simulation such as sim:city."
    ],
    discard: Annotated[bool, "Close forks of the open run that nothing keeps."] = False,
) -> dict[str, Any]:
    """Opens a run, a recording or a source in place of the one that is open, and gives its summary. A run is there at
    once; the frames of a source are computed by `compute`."""
    agents.open(source, discard=discard)
    return summary(agents)


def summary(agents: AgentSession) -> dict[str, Any]:
    """Says what is open: source, notes, number of frames, how many are computed and which is shown, cameras, whether
    there is ground truth, branches (the run and its forks), and for each method its unit, the number of frames at
    which it was tracked and lost, its status at the last computed frame, and the number of its events by kind."""
    run, state = agents.run, agents.state
    sequence = run.opened.sequence
    events = Counter((event.method, event.kind) for event in run.events.events)
    last = run.history[len(run.history) - 1] if len(run.history) else None
    return {
        "source": state.source,
        "name": state.name,
        "notes": list(state.notes),
        "frames": run.last + 1,
        "computed": len(run.series),
        "shown": state.index,
        "computing": state.target is not None or state.playing,
        "stored_run": run.stored is not None,
        "unavailable": "" if run.stored is None else run.stored.unavailable,
        "cameras": [name for name in ("video", "left", "right") if getattr(sequence.rig, name) is not None],
        "ground_truth": run.opened.truth is not None,
        "branches": [
            {"number": b.number, "name": b.name, "parent": b.parent, "at": b.at, "changes": list(b.changes),
             "computed": b.computed, "shown": b.number == state[Branches].shown}
            for b in state[Branches].all
        ],
        "methods": {
            name: {
                "unit": "m" if registered(name).unit == "metric" else "own unit",
                "status": str(last.statuses[name].status) if last is not None and name in last.statuses else None,
                "statuses": _statuses(agents, name),
                "events": {kind: count for (method, kind), count in events.items() if method == name},
            }
            for name in run.opened.methods
        },
    }  # fmt: skip


def _statuses(agents: AgentSession, method: str) -> dict[str, int]:
    """At how many frames a method had each status."""
    series = agents.run.series
    quantity = series.quantities[f"{method}.status"]
    frames, _ = series.values_of(quantity.name, len(series))
    return dict(Counter(str(series.value(quantity, int(i))) for i in frames))


def compute(
    agents: AgentSession,
    frame: Annotated[int | None, "Frame up to which to compute; null for the last one."] = None,
    seconds: Annotated[float, "Time after which the call returns; the computation goes on."] = 30.0,
) -> dict[str, Any]:
    """Computes the frames of the open source up to one of them, and says how far that came. Where `done` is false,
    call it again; a call with a frame that is computed stops it. Nothing is written. The first computation of a program
    version also compiles code, for up to a minute."""
    if not 0 < seconds <= LONGEST_S:
        raise InputError(f"seconds is {seconds:g}: give a number up to {LONGEST_S:.0f}")
    agents.compute(frame, seconds)
    run, state = agents.run, agents.state
    goal = run.last if frame is None else min(frame, run.last)
    found = {"computed": len(run.series), "frames": run.last + 1, "done": len(run.series) > goal}
    return found | {"doing": state.compiling or (state.activity.text if state.activity is not None else "")}


def trajectory_errors(agents: AgentSession) -> dict[str, Any]:
    """Gives the absolute trajectory error of each method over the computed frames, against the ground truth: ate_m
    (root mean square [m]), largest_m and the frame of it, alignment (se3 or sim3), poses. Only for sources with
    ground truth."""
    run = agents.run
    if run.opened.truth is None:
        raise InputError("this source has no ground truth, so that no error is known: compare runs by diff")
    errors = agents.carry_out(lambda controller: measured(run)).errors
    times = run.playback.sequence.times_ns
    found = {}
    for method, error in errors.items():
        worst = int(error.position_errors_m.argmax())
        found[method] = {
            "ate_m": brief(error.ate_m),
            "largest_m": brief(float(error.position_errors_m[worst])),
            "largest_at": int(times.searchsorted(error.estimate.times_ns[worst])),
            "alignment": error.alignment,
            "poses": len(error.estimate),
        }
    return {"computed": len(run.series), "errors": found}


def picture(
    agents: AgentSession,
    frame: Annotated[int, "Frame, from 0."],
    method: Annotated[str, "Whose tracks are drawn; empty for the image alone."] = "",
    width: Annotated[int, "Width of the picture in pixels, 64 to 640."] = 640,
) -> Picture:
    """Gives the image of a frame with the tracks of a method. Blue tracks go on, green ones are
    new, and crosses of other colours are tracks that were dropped."""
    if not 64 <= width <= WIDEST:
        raise InputError(f"width is {width}: give 64 to {WIDEST}")
    run = agents.run
    if method:
        agents.method(method)
    found = frame_picture(run, agents.frame(frame), method, width)
    if found is None:
        raise InputError(f"the image of frame {frame} cannot be read: {summary(agents)['unavailable'] or 'see events'}")
    return Picture(found, "jpeg")


LOOKS = tuple(map(Tool, (list_runs, summary, trajectory_errors, picture)))
TOOLS = (*LOOKS, Tool(open_run, moves=True), Tool(compute, moves=True))
