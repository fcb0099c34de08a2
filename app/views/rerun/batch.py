"""The entries that one event adds to a recording, as values. This module uses no stream."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

from ispom.types import Trajectory


@dataclass(frozen=True, eq=False)
class Entry:
    """One value of one entity."""

    path: str
    value: rr.AsComponents
    static: bool = False


@dataclass(frozen=True, eq=False)
class Columns:
    """A whole final trajectory: world_from_frame at many frames; or a curve with `values` at these frames."""

    path: str
    trajectory: Trajectory
    indices: np.ndarray
    """(N,) of its frames in the sequence."""
    first_ns: int
    values: np.ndarray | None = None
    """(N,) numbers of a curve, which are sent instead of the poses."""


@dataclass(frozen=True, eq=False)
class Batch:
    """The entries that one event adds, at one time of both timelines."""

    index: int
    since_start_ns: int
    entries: tuple[Entry | Columns, ...]
