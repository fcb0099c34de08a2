"""A run as the functions of `facts` see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ispom.errors import InputError
from ispom.evaluation.trajectory_error import associate
from ispom.types import Sequence, Trajectory

from ...engine.events import Finished, Opened
from ...engine.history.history import Records
from ...engine.history.series import Series


@dataclass(frozen=True, eq=False)
class Ran:
    """As far as it is computed."""

    opened: Opened
    records: Records
    series: Series
    finished: Finished

    @property
    def sequence(self) -> Sequence:
        return self.opened.sequence

    def path(self, method: str) -> Trajectory:
        """world_from_FRAME of a method. InputError where it has none."""
        found = self.finished.trajectories.get(method)
        if found is None or not len(found):
            raise InputError(f"{method} has no pose in this run: there is nothing to compare")
        return found

    def truth(self, frame: str) -> Trajectory:
        """world_from_FRAME as it truly is. InputError where nobody knows."""
        if self.opened.truth is None:
            raise InputError("this source has no ground truth: a lesson that compares with it needs a simulation")
        return self.opened.truth.moved(right=self.sequence.rig.rig_from(frame), frame=frame)  # type: ignore[arg-type]

    def compared(self, method: str) -> tuple[Trajectory, Trajectory]:
        """The method's poses and the true ones of the same frame and times; each in its own world."""
        own = self.path(method)
        return associate(own, self.truth(own.frame))

    @cached_property
    def count(self) -> int:
        """Frames that were computed."""
        return len(self.series)
