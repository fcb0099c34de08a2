"""Runs up to the frame shown once more, from the nearest state that is kept, and asks what was solved there."""

from __future__ import annotations

from ispom.errors import InputError
from ispom.stop import check_stop

from ...engine.model.drawn_size import unit_in_metres
from ...session.service import Service
from .found import pose_blames
from .state import Blames


class BlameService(Service):
    """Answers for one frame at a time; the run itself stays where it is."""

    place = 21

    def ask(self) -> None:
        """Of all methods of the run. InputError where there is no pose, or nothing can be computed again."""
        run, shown = self.run, self.state.displayed
        if run is None or shown is None:
            raise InputError("no frame is shown yet: step to one first")
        run.require_source()
        self.store.busy("finding what moved this pose")
        try:
            nearest = run.checkpoints.nearest(shown.index)
            before = run.playback
            snapshot = None if nearest is None else nearest.snapshot
            playback = before.forked(shown.index, before.methods, before.config, snapshot)
            while playback.position < shown.index:
                check_stop()
                playback.step()
            units = {m: unit_in_metres(m, placement.scale) for m, placement in shown.placements.items()}
            known = {m: unit for m, unit in units.items() if unit is not None}
            found = tuple(pose_blames(playback, before.methods, known))
        finally:
            self.store.set(activity=None)
        self.store.put(Blames(self.state.run, found))
