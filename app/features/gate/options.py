"""The options of `ispom gate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..experiments.options import Runs


@dataclass(frozen=True, kw_only=True)
class Gate(Runs):
    """Runs a plan with the code as it is now, as `ispom experiment` does, and compares each run with the same run of
    the code before: better, worse, the same, or cannot tell. For pull requests: the exit code is 0 for better or the
    same, 1 for worse, 2 for a mistake in what you gave, and 3 for cannot tell, with the number of runs that would
    decide."""

    baseline: Path
    """Folder that `ispom experiment PLAN --out FOLDER` wrote with the code before the change."""
    out: Path
    """New or empty folder for the page, the numbers and the runs."""
    candidate: Path | None = None
    """Compute nothing: judge the runs of this folder, which `ispom experiment` wrote with the code after the change."""
    quantities: tuple[str, ...] = ()
    """Errors that decide, such as ate_m rpe_deg. Default: the first error among the plan's quantities."""
    effect: float = 1.0
    """The margin: changes of an error up to this are of no interest, and "the same" means no change beyond it [%]."""
    level: float = 1.0
    """Probability of a false alarm where nothing got worse, over all lines and quantities together, and of "the same"
    for a line that changed by more than the margin [%]."""
    located: float = 1.0
    """The margin of the share of localised frames: a line is worse where it fell by more [percentage points]."""
    time: float | None = None
    """A line is worse, too, whose time per frame grew by more than this [%]. Default: time is shown only."""
