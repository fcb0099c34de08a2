"""Runs up to the frame shown once more, from the nearest state that is kept, and asks what was solved there."""

from __future__ import annotations

from ispom.errors import InputError
from ispom.stop import check_stop

from ...engine.model.drawn_size import unit_in_metres
from ...session.service import Service
from .found import PoseBlame, pose_blames
from .state import Blames


class BlameService(Service):
    """Answers for one frame at a time; the run itself stays where it is."""

    place = 21

    def ask(self) -> None:
        """Of all methods of the run at the frame shown. InputError as `at`, or where no frame is shown."""
        shown = self.state.displayed
        if shown is None:
            raise InputError("no frame is shown yet: step to one first")
        self.store.put(Blames(self.state.run, self.at(shown.index)))

    def at(self, index: int) -> tuple[PoseBlame, ...]:
        """Returns what moved the pose of each method at a frame that is computed. InputError where there is no pose, or
        nothing can be computed again."""
        run = self.run
        if run is None:
            raise InputError("there is no run yet: open a source first")
        run.require_source()
        self.store.busy("finding what moved this pose")
        try:
            nearest = run.checkpoints.nearest(index)
            before = run.playback
            snapshot = None if nearest is None else nearest.snapshot
            playback = before.forked(index, before.methods, before.config, snapshot)
            while playback.position < index:
                check_stop()
                playback.step()
            placements = run.history[index].placements
            units = {m: unit_in_metres(m, placement.scale) for m, placement in placements.items()}
            known = {m: unit for m, unit in units.items() if unit is not None}
            return tuple(pose_blames(playback, before.methods, known))
        finally:
            self.store.set(activity=None)
