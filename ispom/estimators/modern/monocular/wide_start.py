"""Initialisation with steps too wide for a tracker: features matched between two images become tracks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.estimators.modern.monocular.setup import Setup
from ispom.estimators.modern.monocular.start import MIN_POINTS
from ispom.estimators.modern.monocular.state import ModernMonocularState, NewImage
from ispom.estimators.modern.monocular.tracks import MIN_FEATURES, Followed
from ispom.features.images import has_contrast
from ispom.types import TrackStatus

FEATURES = 2000
"""Largest number of features described in each of the two images."""


def with_matched_features(
    setup: Setup, state: ModernMonocularState, new: NewImage
) -> tuple[ModernMonocularState, NewImage]:
    """Adds tracks from matched features if the tracker lost most of those that began in the last image; otherwise
    returns both arguments unchanged.

    The tracks start in the last image, which is the reference of the initialisation. Wrong matches agree with no camera
    motion, and do not enter the first map. Not used with a rolling shutter, which requires the velocity of each track.
    """
    start, live, alive = state.start, state.live, int(np.count_nonzero(new.followed.status == TrackStatus.ALIVE))
    if start is None or live.grey is None or live.grey.shape != new.grey.shape or setup.camera.line_delay_s:
        return state, new
    at_reference = len(start.frames) == 1 and start.frames[0].time_ns == live.time_ns
    enough = max(setup.min_share * len(live.ids), MIN_POINTS)
    if not at_reference or alive >= enough or not has_contrast(new.grey, live.grey):
        return state, new
    before, now = (setup.front_end.descriptor.detect_and_describe(image, FEATURES) for image in (live.grey, new.grey))
    pairs = setup.front_end.matcher.match(before, now)
    if len(pairs) < max(MIN_FEATURES, alive):
        return state, new
    count, here = len(pairs), before.uv[pairs[:, 0]].astype(np.float32)
    grown = live.with_new(here, live.time_ns)
    followed = new.followed
    followed = Followed(
        np.concatenate([followed.uv, now.uv[pairs[:, 1]].astype(np.float32)]),
        np.concatenate([followed.status, np.full(count, TrackStatus.ALIVE, np.uint8)]),
        np.concatenate([followed.speed, np.zeros((count, 2), np.float32)]),
        bright=followed.bright,
    )
    start = start.with_new_tracks(grown.ids[-count:], setup.camera.normalise(here))
    scene = np.concatenate([new.scene, np.full((count, 3), np.nan)])
    return replace(state, live=grown, start=start), replace(new, followed=followed, scene=scene)
