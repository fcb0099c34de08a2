"""A track's life, read from records."""

from __future__ import annotations

import numpy as np
import pytest
from ispom_app.engine.inspection.selection import Selection, parsed
from ispom_app.engine.inspection.sightings import life, nearest, seen_by

from ispom.errors import InputError
from ispom.types import Landmarks, TrackStatus
from tests.app.inspect.scene import COUNT, RIG, pose, records, seen_from

RECORDS = records()
STAYS = int(np.flatnonzero(np.isfinite([seen_from(i)[:, 0] for i in range(COUNT)]).all(0))[0])
LEAVES = next(
    n for n in range(60) if np.isfinite(seen_from(0)[n, 0]) and np.isnan([seen_from(i)[n, 0] for i in (8, 9)]).all()
)


def track(number: int) -> Selection:
    return Selection("track", "monocular", number)


def test_a_track_is_followed_back_to_where_it_began():
    found = life(RECORDS, COUNT - 1, track(STAYS), RIG)
    assert found is not None and found.whole and [s.index for s in found.observations] == list(range(COUNT))
    assert found.observations[0].status == TrackStatus.NEW and found.camera == "video"
    np.testing.assert_allclose(
        [s.uv for s in found.observations], [seen_from(i)[STAYS] for i in range(COUNT)], atol=1e-3
    )
    assert np.array_equal(found.last.world_from_camera.matrix, pose(COUNT - 1).matrix)


def test_nothing_after_the_exposure_shown_is_known():
    found = life(RECORDS, 4, track(STAYS), RIG)
    assert found is not None and found.last.index == 4


def test_a_track_that_ended_keeps_its_reason():
    found = life(RECORDS, COUNT - 1, track(LEAVES), RIG)
    assert found is not None and found.last.status == TrackStatus.OUT_OF_IMAGE
    assert len(found.seen) == len(found.observations) - 1
    np.testing.assert_allclose(found.last.uv, found.seen[-1].uv)


def test_a_track_that_nobody_saw_has_no_life():
    assert life(RECORDS, COUNT - 1, track(999), RIG) is None


def test_without_a_method_the_first_that_has_the_track_is_meant():
    found = life(RECORDS, 5, Selection("track", "", STAYS), RIG)
    assert found is not None and found.method == "monocular"


def test_a_new_world_ends_what_the_poses_before_say():
    restarted = [*RECORDS[:5], *records(restarted=True, landmarks=Landmarks.empty())[5:6], *RECORDS[6:]]
    found = life(restarted, COUNT - 1, track(STAYS), RIG)
    assert found is not None and [s.world_from_camera is None for s in found.observations] == [True] * 5 + [False] * 5


def test_a_click_picks_the_nearest_track():
    seen = seen_by(RECORDS[3])
    assert seen is not None and nearest(seen, seen_from(3)[STAYS] + (0.3, -0.2)) == STAYS


@pytest.mark.parametrize("text", ["track:181", "track:monocular.paper:181", "key_frame:stereo:40"])
def test_a_selection_is_read_as_it_is_written(text: str):
    assert str(parsed(text)) == text


@pytest.mark.parametrize("text", ["track", "track:", "track:-1", "point:3", "track:a b:3", "track:3\n", "x" * 900])
def test_what_is_no_selection_is_reported_in_one_sentence(text: str):
    with pytest.raises(InputError, match="cannot be selected") as said:
        parsed(text)
    assert len(str(said.value)) < 160


def test_nothing_selected_is_no_mistake():
    assert parsed("") is None
