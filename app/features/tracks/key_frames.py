"""Keyframes: which saw the same tracks, and what the selected one saw."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ispom.types import TrackStatus

from ...engine.inspection.covisibility import Covisibility, around, covisibility, key_frames, seen_at
from ...engine.inspection.looked import Looked
from ...engine.inspection.selection import Selection
from ...engine.inspection.sightings import Seen, seen_by
from ...presentation import colours
from ...views.viser.panels import renderer

render = renderer(__package__)

CELL = 13
MOST_NEIGHBOURS = 8


def key_frames_report(looked: Looked) -> str:
    """The keyframes around the selected one, or up to the frame shown, as HTML."""
    method = _method(looked)
    keys = [] if method is None else key_frames(looked.series, method, looked.record.index)
    if method is None or not keys:
        return render("key_frames.html", note="No keyframes so far.")
    selection = looked.selection if looked.selection and looked.selection.kind == "key_frame" else None
    picked = selection.number if selection is not None and selection.number in keys else None
    views = seen_at(looked.records, method, around(keys, keys[-1] if picked is None else picked))
    found = covisibility(views)
    known = {
        "label": colours.label(method),
        "cell": CELL,
        "size": CELL * len(views),
        "cells": list(_cells(found, method)),
    }
    known |= {"names": [_name(found, method, i, picked) for i in range(len(views))]}
    return render("key_frames.html", note="", **known, picked=_picked(looked, found, method, picked), count=len(keys))


def _method(looked: Looked) -> str | None:
    """The selection's, or else that of the picture's tracks."""
    if looked.selection is not None and looked.selection.method:
        return looked.selection.method
    return looked.seen.step.method if looked.seen is not None else None


def _cells(found: Covisibility, method: str) -> Iterator[dict[str, Any]]:
    """Below the diagonal: darker for fewer shared tracks."""
    seen = np.maximum(np.diag(found.shared), 1)
    for row, a in enumerate(found.indices):
        for column, b in enumerate(found.indices[:row]):
            shared = int(found.shared[row, column])
            if shared:
                yield {
                    "x": column * CELL,
                    "y": row * CELL,
                    "opacity": round(0.1 + 0.9 * shared / min(seen[row], seen[column]), 2),
                    "hint": f"{b} and {a}: {shared} shared tracks",
                    "what": str(Selection("key_frame", method, a)),
                }


def _name(found: Covisibility, method: str, i: int, picked: int | None) -> dict[str, Any]:
    index = found.indices[i]
    return {"index": index, "at": i * CELL, "what": str(Selection("key_frame", method, index)), "bold": index == picked}


def _picked(looked: Looked, found: Covisibility, method: str, picked: int | None) -> dict[str, Any] | None:
    if picked is None or (seen := seen_by(looked.records[picked], method)) is None or picked not in found.indices:
        return None
    neighbours = [
        {"index": i, "shared": n, "what": str(Selection("key_frame", method, i))}
        for i, n in found.neighbours(picked)[:MOST_NEIGHBOURS]
    ]
    return {"index": picked, "facts": list(_facts(seen)), "neighbours": neighbours}


def _facts(seen: Seen) -> Iterator[tuple[str, str]]:
    tracks, step = seen.tracks, seen.step
    counts = np.bincount(tracks.status, minlength=len(TrackStatus))
    yield "saw", f"{counts[TrackStatus.ALIVE]} tracks from before, {counts[TrackStatus.NEW]} new"
    yield "ended", f"{int((tracks.status >= TrackStatus.LOST).sum())} tracks"
    yield "landmarks", f"{len(step.landmarks)} found or revised, {len(step.revised)} poses revised"
    if len(step.residuals_px):
        yield "residual", f"median {np.median(step.residuals_px):.2f} px of {len(step.residuals_px)} inliers"
