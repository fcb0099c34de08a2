"""Runs up to the frame shown once more, from the nearest state that is kept, and asks what was solved there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from ispom.errors import InputError
from ispom.stop import check_stop

from ...engine.model.drawn_size import unit_in_metres
from ...engine.playback import Playback
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.service import Service
from .found import PoseBlame, pose_blame, pose_blames
from .state import Blames


class BlameService(Service):
    """Answers for one frame at a time; the run itself stays where it is."""

    place = 21

    def ask(self) -> None:
        """Of the newest pose of each method of the run up to the frame shown. InputError as `at`, or where no frame is
        shown."""
        shown, run = self.state.displayed, self._run()
        if shown is None:
            raise InputError("no frame is shown yet: step to one first")
        asked = Blames(self.state.run, shown.index)

        def report(doing: str) -> None:
            self.store.put(replace(asked, doing=doing))

        methods = run.playback.methods
        newest = {method: run.series.last_step(method, shown.index) for method in methods}
        answers = {m: f"{m} has not used a frame yet" for m, index in newest.items() if index is None}
        try:
            places = {m: index for m, index in newest.items() if index is not None}
            answers |= self._answers(run, places, report)
            found = tuple(each for m in methods if isinstance(each := answers[m], PoseBlame))
            asked = replace(asked, silent=tuple((m, each) for m in methods if isinstance(each := answers[m], str)))
            asked = replace(asked, found=found)
        finally:
            self.store.put(asked)
            self.store.set(activity=None)

    def at(self, index: int) -> tuple[PoseBlame, ...]:
        """Returns what moved the pose of each method at a frame that is computed. InputError where there is no pose, or
        nothing can be computed again."""
        run = self._run()
        self.store.busy(BUSY)
        try:
            playback = _playback(run, index, index)
            _play(playback, index, lambda doing: None)
            return tuple(pose_blames(playback, run.playback.methods, _units_m(run, index)))
        finally:
            self.store.set(activity=None)

    def _run(self) -> CurrentRun:
        if self.run is None:
            raise InputError("there is no run yet: open a source first")
        self.run.require_source()
        return self.run

    def _answers(
        self, run: CurrentRun, places: Mapping[str, int], report: Callable[[str], None]
    ) -> dict[str, PoseBlame | str]:
        """By method: its answer at its frame, or why there is none."""
        if not places:
            return {}
        self.store.busy(BUSY)
        found: dict[str, PoseBlame | str] = {}
        playback = _playback(run, min(places.values()), max(places.values()))
        for index in sorted(set(places.values())):
            _play(playback, index, report)
            reported, units_m = playback.reported_problems(), _units_m(run, index)
            for method in [m for m, at in places.items() if at == index]:
                check_stop()
                report(f"leaving parts out of what {colours.label(method)} solved at frame {index}")
                found[method] = pose_blame(playback, reported, method, units_m)
        return found


BUSY = "finding what decided this pose"


def _playback(run: CurrentRun, first: int, last: int) -> Playback:
    """The run again up to the last of these frames, from the nearest state before the first of them."""
    nearest, before = run.checkpoints.nearest(first), run.playback
    return before.forked(last, before.methods, before.config, None if nearest is None else nearest.snapshot)


def _play(playback: Playback, index: int, report: Callable[[str], None]) -> None:
    while playback.position < index:
        check_stop()
        report(f"computing frame {playback.position} of {index} again")
        playback.step()


def _units_m(run: CurrentRun, index: int) -> dict[str, float]:
    """By method: the unit of its world [m], where it is known."""
    units = {m: unit_in_metres(m, placement.scale) for m, placement in run.history[index].placements.items()}
    return {m: unit for m, unit in units.items() if unit is not None}
