"""What becomes of a click: the name of what was picked."""

from __future__ import annotations

import numpy as np

from ispom.errors import InputError

from ...engine.inspection.selection import Selection, parsed
from ...engine.inspection.sightings import missing_tracks, nearest, seen_by
from ...session import commands as do
from ...session.current_run import CurrentRun


def selected(what: str) -> str:
    """As it is written; InputError where that says nothing that could be selected."""
    return str(parsed(what) or "")


def picked(run: CurrentRun | None, pick: do.Pick) -> str:
    """The track nearest to the pixel. InputError where the exposure has no tracks of that camera."""
    seen = None
    if run is not None and 0 <= pick.index < len(run.history):
        record = run.history[pick.index]
        seen = seen_by(record, camera=pick.camera)
        unavailable = run.stored.unavailable if run.stored is not None else ""
        if (seen is None or not len(seen.tracks)) and (missing := missing_tracks(record, unavailable)):
            raise InputError(missing)
    number = None if seen is None else nearest(seen, np.array([pick.u, pick.v]))
    if seen is None or number is None:
        raise InputError(f"exposure {pick.index} has no tracks of the {pick.camera[:20]} camera: pick at another one")
    return str(Selection("track", seen.step.method, number))
