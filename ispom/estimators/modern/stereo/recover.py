"""A pair that was not located: the last located one is kept for the next; after some failures a new start."""

from __future__ import annotations

from dataclasses import replace

from ispom.estimators.modern.places import Places
from ispom.estimators.modern.stereo import checks
from ispom.estimators.modern.stereo.pair import PairPoints, Sighting
from ispom.estimators.modern.stereo.setup import Setup
from ispom.estimators.modern.stereo.state import ModernStereoState
from ispom.estimators.modern.stereo.window import emptied
from ispom.types import Decision


def recover(
    setup: Setup, state: ModernStereoState, sighting: Sighting
) -> tuple[ModernStereoState, Sighting, tuple[Decision, ...]]:
    """The state with one more lost pair; after too many of them without a map, and why: a start from the prediction."""
    state = replace(state, lost_pairs=state.lost_pairs + 1)
    if state.lost_pairs <= setup.max_lost_pairs:
        return state, sighting, ()
    settled = state.settled.extended((k.time_ns, k.left_from_world) for k in state.map.keys)
    last = replace(state.last, points=PairPoints())
    state = replace(state, last=last, map=emptied(state.map), settled=settled, places=Places())
    restart = checks.LOST_PAIRS.of(state.lost_pairs, setup.max_lost_pairs, "a new segment starts at the prediction")
    return state, Sighting.nothing(), (restart,)
