"""The rows of a run's folder, read while they are compared."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...engine.differences.compare import MethodRow
from ...engine.differences.order import in_order, stored_pose
from ...engine.run_folder.step_reader import StoredStep, stored_steps


@contextmanager
def run_rows(folder: Path) -> Iterator[Iterator[MethodRow]]:
    """Of a run's folder, in order; InputError, also while they are read, where there are none, or not as written."""
    with stored_steps(folder) as steps:
        yield map(_row, steps)


def _row(step: StoredStep) -> MethodRow:
    values = in_order(step.said, step.decisions, stored_pose(step.said))
    return MethodRow(step.exposure, step.time_ns, step.method, values)
