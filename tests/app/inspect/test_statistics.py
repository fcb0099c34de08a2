"""Lifetimes, shared tracks, residuals and colours, against counts made by hand."""

from __future__ import annotations

import numpy as np
from ispom_app.engine.history.series import Series
from ispom_app.engine.inspection.colouring import BINS, COLOURINGS, SCALES, palette
from ispom_app.engine.inspection.covisibility import around, covisibility, key_frames, seen_at
from ispom_app.engine.inspection.knowledge import known_from
from ispom_app.engine.inspection.residuals import CELLS, Residuals, against_radius, histogram, over_image, residuals_of
from ispom_app.engine.inspection.sightings import seen_before
from ispom_app.features.tracks.tracks import endings, lifetimes

from ispom.types import TrackStatus
from tests.app.inspect.scene import CAMERA, COUNT, POINTS, RIG, pose, records, seen_from

RECORDS = records()
VIEWS = list(reversed(list(seen_before(RECORDS, COUNT - 1))))
INSIDE = np.isfinite([seen_from(i)[:, 0] for i in range(COUNT)])
"""(COUNT, 60) which frame has which point in its image."""


def test_lifetimes_go_from_the_first_exposure_to_the_last():
    found = lifetimes(VIEWS)
    assert found.indices.tolist() == list(range(COUNT)) and len(set(found.ids.tolist())) == len(found.ids)
    for number, first, last in zip(found.ids, found.first, found.last, strict=True):
        inside = np.flatnonzero(INSIDE[:, number])
        assert (first, last) == (inside[0], min(inside[-1] + 1, COUNT - 1))
    assert np.all(np.diff(found.first) >= 0)
    assert set(endings(found)) == {TrackStatus.OUT_OF_IMAGE}
    assert endings(found)[TrackStatus.OUT_OF_IMAGE] == int((~INSIDE[-1] & INSIDE.any(0)).sum())


def test_key_frames_that_saw_the_same_tracks_are_neighbours():
    series = Series(("monocular",))
    for record in RECORDS:
        series.append(record)
    keys = key_frames(series, "monocular", 7)
    assert keys == [0, 3, 6]
    found = covisibility(seen_at(RECORDS, "monocular", keys))
    for i, a in enumerate(keys):
        for j, b in enumerate(keys):
            assert found.shared[i, j] == (INSIDE[a] & INSIDE[b]).sum()
    nearest = found.neighbours(0)
    assert [n for n, _ in nearest] == [3, 6] and nearest[0][1] >= nearest[1][1]


def test_of_many_key_frames_those_around_the_picked_one_count():
    keys = list(range(0, 300, 3))
    assert around(keys, 150, 5) == [144, 147, 150, 153, 156]
    assert around(keys, 0, 5) == [0, 3, 6, 9, 12] and around(keys, 297, 5) == [285, 288, 291, 294, 297]
    assert around([4, 9], 9, 5) == [4, 9]


def test_residuals_are_those_of_tracks_that_took_part():
    found = residuals_of(VIEWS)
    expected = np.concatenate([v.tracks.residual_px[v.tracks.status == TrackStatus.ALIVE] for v in VIEWS])
    np.testing.assert_allclose(found.residual_px, expected)
    edges, counts = histogram(found)
    assert counts.sum() == len(expected) and edges[0] == 0


def test_a_lens_that_is_wrong_at_the_rim_shows_against_the_radius():
    rng = np.random.default_rng(0)
    uv = rng.uniform((0, 0), (CAMERA.width - 1, CAMERA.height - 1), (4000, 2))
    radius = np.linalg.norm(uv - (CAMERA.cx, CAMERA.cy), axis=1)
    of = Residuals(uv, radius / 100)
    edges, found = against_radius(of, CAMERA)
    known = np.isfinite(found[:, 0])
    assert known.sum() >= 7 and np.all(np.diff(found[known, 0]) > 0)
    middle = (edges[:-1] + edges[1:])[known] / 200
    np.testing.assert_allclose(found[known, 0], middle, atol=0.2)
    cells = over_image(of, CAMERA)
    assert cells.shape == CELLS[::-1] and cells[0, 0] > 2 * cells[CELLS[1] // 2, CELLS[0] // 2]


def test_ages_count_the_cameras_exposures_and_depths_are_those_of_the_camera():
    known, now = known_from(VIEWS, RIG), VIEWS[-1]
    for number, age, depth in zip(known.ids, known.ages, known.depths, strict=True):
        assert age == COUNT - 1 - np.flatnonzero(INSIDE[:, number])[0]
        assert np.isclose(depth, pose(COUNT - 1).inverse().apply(POINTS[number])[2])
    values = known.values(now.tracks, "age")
    np.testing.assert_array_equal(values, known.ages[np.searchsorted(known.ids, now.tracks.ids)] + 1)


def test_each_value_has_a_colour_with_a_label():
    assert COLOURINGS[0] == "state" and len(palette()) == BINS + 1
    for scale in SCALES.values():
        assert len(scale.labels()) == BINS + 1
        assert scale.bins(np.array([-1.0, scale.low, scale.high, 1e9, np.nan])).tolist() == [
            0,
            0,
            BINS - 1,
            BINS - 1,
            BINS,
        ]
