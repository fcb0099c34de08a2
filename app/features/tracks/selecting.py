"""What becomes of a click: the name of what was picked."""

from __future__ import annotations

import numpy as np

from ispom.errors import InputError

from ...engine.inspection.selection import Selection, parsed
from ...engine.inspection.sightings import missing_tracks, nearest, seen_by
from ...session.current_run import CurrentRun


def selected(what: str) -> str:
    """As it is written; InputError where that says nothing that could be selected."""
    return str(parsed(what) or "")


def picked(run: CurrentRun | None, camera: str, index: int, u: float, v: float) -> str:
    """The track nearest to a pixel of a camera's image. InputError if the frame has no tracks of that camera."""
    seen = None
    if run is not None and 0 <= index < len(run.history):
        record = run.history[index]
        seen = seen_by(record, camera=camera)
        unavailable = run.stored.unavailable if run.stored is not None else ""
        if (seen is None or not len(seen.tracks)) and (missing := missing_tracks(record, unavailable)):
            raise InputError(missing)
    number = None if seen is None else nearest(seen, np.array([u, v]))
    if seen is None or number is None:
        raise InputError(f"frame {index} has no tracks of the {camera[:20]} camera: pick at another one")
    return str(Selection("track", seen.step.method, number))
