"""A click in a view: which track or frame it means."""

from __future__ import annotations

import numpy as np
import pytest
from ispom_app.engine.inspection.selection import Selection
from ispom_app.engine.inspection.sightings import camera_pose, seen_by
from ispom_app.engine.playback import Playback
from ispom_app.features.stage.picking import meaning
from ispom_app.session.current_run import CurrentRun
from ispom_app.views.rerun import entities

from ispom.errors import InputError
from ispom.geometry import Similarity
from ispom.sequences.formats.simulated import open_simulated
from tests.app.helpers import run_to_end

AWAY = (float("nan"),) * 3


def latest(run: CurrentRun, kind: str) -> int:
    return max(record.index for record in run.history if record.kind == kind)


@pytest.mark.parametrize(("camera", "kind"), [("video", "video"), ("left", "stereo"), ("right", "stereo")])
def test_a_click_on_a_track_selects_it_in_the_cameras_frame(run: CurrentRun, camera: str, kind: str):
    index, name = latest(run, kind), "video" if camera == "video" else "left"
    step = next(step for step in run.history[index].steps if name in step.tracks)
    tracks = entities.in_right(step.tracks[name]) if camera == "right" else step.tracks[name]  # type: ignore[index]
    shape = run.opened.sequence.rig.camera(name)  # type: ignore[arg-type]
    for row in range(0, len(tracks), 7):
        u, v = entities.shown_uv(tracks.uv[row], shape).tolist()
        found = meaning(run, f"/{camera}/image", len(run.history) - 1, (u, v, None), None)
        assert isinstance(found, Selection) and found.method == step.method
        at = tracks.uv[tracks.ids == found.number][0]
        assert np.allclose(at, tracks.uv[row]), "there, whichever of several"


def test_a_click_on_a_point_selects_its_track(run: CurrentRun):
    index = len(run.history) - 1
    block = run.known_at(index).methods["monocular"].points.blocks[0]
    for instance in (0, 5, len(block.ids) - 1):
        found = meaning(run, "/world/monocular/cloud/0", index, (0.0, 0.0, 0.0), instance)
        assert found == Selection("track", "monocular", int(block.ids[instance]))
    assert meaning(run, "/world/monocular/cloud/0", index, (0.0, 0.0, 0.0), 10**6) is None


def test_a_click_elsewhere_in_the_world_selects_the_nearest_landmark(run: CurrentRun):
    index = len(run.history) - 1
    block = run.known_at(index).methods["stereo"].points.blocks[0]
    placement = run.history[index].placements.get("stereo", Similarity())
    at = tuple(placement.apply(block.xyz[3].astype(float)).tolist())
    found = meaning(run, "/world/look/track/rays", index, at, None)
    assert isinstance(found, Selection) and found.kind == "track"
    if found.method == "stereo":
        (row,) = np.flatnonzero(block.ids == found.number)
        assert np.allclose(block.xyz[row], block.xyz[3])


@pytest.mark.parametrize("kind", ["path", "key_frames"])
def test_a_click_on_a_pose_shows_its_frame(run: CurrentRun, kind: str):
    index = len(run.history) - 1
    keys = [r.index for r in run.history for s in r.steps if s.method == "stereo" and s.key_frame]
    model = run.known_at(index)
    placement = run.history[index].placements.get("stereo", Similarity())
    for frame in keys[::3]:
        row = int(model.times.rows(np.array([run.history[frame].time_ns]))[0])
        at = placement.apply(model.methods["stereo"].poses.position(row))
        assert meaning(run, f"/world/stereo/{kind}/0", index, tuple(at.tolist()), 0) == frame


@pytest.mark.parametrize(
    ("path", "position"),
    [
        ("/world/nobody/path/0", (0.0, 0.0, 0.0)),
        ("/world/stereo/path/0", (None, None, None)),
        ("/video/image", (None, 3.0, None)),
        ("/decisions", (1.0, 2.0, None)),
        ("", (1.0, 2.0, 3.0)),
    ],
)
def test_what_means_nothing_selects_nothing(run: CurrentRun, path: str, position):
    assert meaning(run, path, 20, position, None) is None
    assert meaning(run, "/video/image", 10**6, (1.0, 1.0, None), None) is None


def test_before_a_camera_has_a_frame_it_says_so(run: CurrentRun):
    kinds = run.opened.sequence.kinds
    camera = "left" if kinds[0] == "video" else "video"
    with pytest.raises(InputError, match=camera):
        meaning(run, f"/{camera}/image", 0, (1.0, 1.0, None), None)


def test_a_point_of_a_method_without_tracks_of_its_own_selects_the_track_that_sees_it(tiny: CurrentRun):
    """The integrated method alone: its tracks are those of the methods inside it."""
    index = len(tiny.history) - 1
    placement = tiny.history[index].placements.get("integrated", Similarity())
    latest = {seen.camera: seen for i in range(index + 1) if (seen := seen_by(tiny.history[i])) is not None}
    found, pixels = [], []
    for block in tiny.known_at(index).methods["integrated"].points.blocks:
        for instance, xyz in enumerate(placement.apply(block.xyz.astype(float))):
            what = meaning(tiny, "/world/integrated/cloud/0", index, tuple(xyz.tolist()), instance)
            if isinstance(what, Selection):
                seen = next(s for s in latest.values() if s.step.method == what.method)
                pose = camera_pose(tiny.history[seen.index].steps[0], tiny.opened.sequence.rig, seen.camera)
                assert pose is not None
                uv = tiny.opened.sequence.rig.camera(seen.camera).project(pose.inverse().apply(xyz[None]))[0]
                found.append(what)
                pixels.append(np.linalg.norm(seen.tracks.uv[seen.tracks.ids == what.number][0] - uv))
    assert len(found) > 100 and np.median(pixels) < 1


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> CurrentRun:
    flight = open_simulated("tiny", seed=0, cache_dir=tmp_path_factory.mktemp("rendered"), duration_s=1.0)
    return run_to_end(Playback(flight, ("integrated",)))
