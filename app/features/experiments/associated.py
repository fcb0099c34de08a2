"""A run's path beside the ground truth, read from its folder."""

from __future__ import annotations

from pathlib import Path

from ispom.evaluation.association import associate
from ispom.evaluation.trajectory_error import MIN_POSES
from ispom.io.files import exists
from ispom.io.tum import read_tum
from ispom.types import Trajectory

from ...engine.run_folder.run_folder import TRUTH, trajectory_file
from .plan import Run


def paths_of(run: Run, folder: Path) -> tuple[Trajectory, Trajectory] | None:
    """The method's poses and the true ones; None without truth."""
    if not exists(folder / TRUTH):
        return None
    return read_tum(folder / trajectory_file(run.line.method)), read_tum(folder / TRUTH)


def compared(run: Run, folder: Path) -> tuple[Trajectory, Trajectory] | None:
    """Those of the same times; None without truth, or with too few."""
    paths = paths_of(run, folder)
    pairs = associate(*paths) if paths is not None else None
    return pairs if pairs is not None and len(pairs[0]) >= MIN_POSES else None
