"""Triple, pair and rays in the scene, against a camera whose place is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.history.series import Series
from ispom_app.engine.inspection.geometry import MOST_POINTS, pair, track_rays, triple
from ispom_app.engine.inspection.looked import Looked
from ispom_app.engine.inspection.sightings import life
from ispom_app.engine.model.run_model import RunModel

from ispom.types import Camera, Rig, Status, Step, Tracks
from tests import doubles
from tests.app.inspect.scene import COUNT, POINTS, RIG, pose, records
from tests.app.inspect.test_sightings import STAYS, track

RECORDS = records()
MODEL, SERIES = RunModel.start(("monocular",)), Series(("monocular",))
for each in RECORDS:
    MODEL = MODEL.after(each.index, each.time_ns, each.steps)
    SERIES.append(each)
KINDS = ("video",) * COUNT


def looked(index: int = COUNT - 1) -> Looked:
    sequence = replace(doubles.sequence(COUNT).truncated(COUNT), rig=RIG, kinds=KINDS)
    return Looked(sequence, RECORDS, SERIES, lambda i: MODEL, RECORDS[index], None, "", "state")


def test_the_triple_is_the_last_three_key_frames_and_what_all_of_them_saw():
    found = triple(looked(), MODEL)
    assert found is not None and found.method == "monocular"
    np.testing.assert_allclose(found.centres, [pose(i).translation for i in (3, 6, 9)])
    np.testing.assert_array_equal(found.between[:, 0], found.centres[[0, 0, 1]])
    np.testing.assert_array_equal(found.between[:, 1], found.centres[[1, 2, 2]])
    assert found.indices == (3, 6, 9)
    first, last = (found.points[0] - found.centres[i] for i in (0, 2))
    angle = np.degrees(np.arccos(first @ last / np.linalg.norm(first) / np.linalg.norm(last)))
    assert np.isclose(found.parallax_deg()[0], angle)
    assert 0 < len(found.points) <= MOST_POINTS and found.to_points.shape == (3 * len(found.points), 2, 3)
    assert {tuple(p) for p in found.points.tolist()} <= {tuple(p) for p in POINTS.tolist()}


def test_before_three_key_frames_there_is_no_triple():
    assert triple(looked(5), MODEL) is None


def test_rays_of_a_track_meet_in_its_point():
    found = life(RECORDS, COUNT - 1, track(STAYS), RIG)
    assert found is not None
    rays = track_rays(found, POINTS[STAYS])
    assert len(rays.to_points) == COUNT and np.array_equal(rays.to_points[:, 1], np.tile(POINTS[STAYS], (COUNT, 1)))


def test_the_pair_sees_its_points_where_they_are():
    camera, world_from_rig = Camera(640, 480, 450.0, 450.0, 319.5, 239.5), pose(4)
    rig = Rig.stereo(camera, 0.4)
    in_left = (world_from_rig @ rig.rig_from_left).inverse().apply(POINTS)
    uv, disparity = camera.project(in_left), 450.0 * 0.4 / in_left[:, 2]
    tracks = Tracks.of(np.arange(60), uv, disparity_px=disparity)
    step = Step(0, Status.TRACKING, "rig", world_from_rig, tracks={"left": tracks}, method="stereo")
    record = ExposureRecord(0, 0, "stereo", (step,), {}, {}, {})
    sequence = replace(doubles.sequence(COUNT), rig=rig)
    found = pair(Looked(sequence, [record], SERIES, lambda i: MODEL, record, None, "", "state"))
    assert found is not None and len(found.points) == MOST_POINTS
    np.testing.assert_allclose(np.linalg.norm(found.between[0, 1] - found.between[0, 0]), 0.4)
    assert min(np.linalg.norm(POINTS - p, axis=1).min() for p in found.points) < 1e-4
    assert max(np.linalg.norm(POINTS - p, axis=1).min() for p in found.points) < 1e-3
