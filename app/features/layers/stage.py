"""Dense depth on the stage."""

from __future__ import annotations

from collections.abc import Iterable

from ispom.errors import UnreadableImage
from ispom.types import is_stereo

from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.rerun.batch import Entry
from ...views.rerun.depth import depth_entries
from ...views.rerun.parts import latest_of_each_camera
from .state import Layers


def pair_shown(state: State, run: CurrentRun) -> int | None:
    """The latest stereo frame, where its depth is to be drawn."""
    if "depth" in state[Layers].undrawn or not run.opened.sequence.rig.has_stereo:
        return None
    return latest_of_each_camera(run.opened.sequence.kinds, state.index).get("left")


def depth_of(pair: int, state: State, run: CurrentRun) -> Iterable[Entry]:
    try:
        exposure = run.opened.sequence[pair]
    except UnreadableImage:
        return ()
    if not is_stereo(exposure):
        raise ValueError(f"frame {pair} is no stereo pair: it has no depth")
    return depth_entries(exposure, run.history[pair].steps, run.opened.sequence.rig, state[Layers].hidden)
