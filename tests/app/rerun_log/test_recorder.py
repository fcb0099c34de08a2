"""Events -> entities, read back from a recording: what is there, when, and where."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pyarrow
import pytest
import rerun as rr
import rerun.blueprint as rrb
from ispom_app.engine.events import Finished, Stepped
from ispom_app.engine.history.encoding import decode, encode
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.model.true_path import FIRST
from ispom_app.engine.playback import Playback
from ispom_app.presentation import colours
from ispom_app.session.branches.branches import COLOURS as BRANCHES
from ispom_app.views.rerun import entities
from ispom_app.views.rerun.batch import Entry
from ispom_app.views.rerun.blueprint import blueprint
from ispom_app.views.rerun.file_recording import FileRecording
from ispom_app.views.rerun.recorder import Recorder
from numpy.testing import assert_allclose, assert_array_equal
from rerun.blueprint.api import View
from rerun.chunk import RrdReader

from ispom.evaluation.trajectory_error import error_against_truth
from ispom.geometry import Pose, Similarity
from ispom.methods import BUILT_IN, SURVEY
from ispom.types import Camera, ImageLines, Rig, Tracks, TrackStatus, WorldLines, is_stereo, is_video
from tests import doubles
from tests.alone import METHODS, PAPER
from tests.app import helpers

rr.set_strict_mode(True)


def events(run: Playback) -> list[Stepped]:
    return [run.step() for _ in range(len(run.sequence))]


def read(path: Path) -> dict[str, list[dict]]:
    """By entity: its rows as dictionaries, of the recording alone (the layout is stored as a second one)."""
    rows = defaultdict(list)
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        entity = batch.schema.metadata[b"rerun:entity_path"].decode()
        for at, name in enumerate(batch.schema.names):  # Python's times have no nanoseconds
            if pyarrow.types.is_temporal(batch.schema.field(at).type):
                batch = batch.set_column(at, name, batch.column(at).cast("int64"))
        rows[entity.lstrip("/")] += batch.to_pylist()
    return rows


def column(rows: list[dict], ending: str) -> list:
    return [value for row in rows for key, value in row.items() if key.endswith(ending) and value is not None]


@pytest.fixture
def recorded(run: Playback, tmp_path: Path) -> tuple[dict[str, list[dict]], list, Finished]:
    with FileRecording(tmp_path / "run.rrd", run.opened) as file:
        stepped = events(run)
        for event in stepped:
            file.write(event)
        finished = run.finish()
        file.write(finished)
    return read(tmp_path / "run.rrd"), stepped, finished


def test_every_thing_that_the_page_shows_is_there(recorded):
    rows, stepped, _ = recorded
    wanted = ["world", "world/truth/path", "world/truth/rig", "decisions", "log", "video/image", "left/image"]
    wanted += [f"{c}/{kind}" for c in ("video", "left") for kind in ("tracks", "trails", "legend")] + ["left/disparity"]
    wanted += [f"world/{m}{kind}" for m in METHODS for kind in ("/camera", "/path/0", "/key_frames/0", "/cloud/0")]
    wanted.append("world/monocular")
    wanted += [f"plots/{kind}/{m}" for m in METHODS for kind in ("error", "inliers", "residual", "ms")]
    wanted += [f"plots/scale/{m}/transferred" for m in METHODS]
    assert not set(wanted) - set(rows)
    videos = [event for event in stepped if is_video(event.exposure)]
    assert len(column(rows["video/image"], "blob")) == len(videos)
    assert len(column(rows["left/image"], "blob")) == len(stepped) - len(videos)


def test_both_timelines_carry_the_exposure(recorded):
    rows, stepped, _ = recorded
    assert [row["exposure"] for row in rows["decisions"]] == [e.index for e in stepped]
    assert [row["time"] for row in rows["decisions"]] == [
        e.exposure.time_ns - stepped[0].exposure.time_ns for e in stepped
    ]


@pytest.mark.parametrize("method", METHODS)
def test_the_final_trajectory_reads_back(recorded, method):
    rows, stepped, finished = recorded
    wanted = finished.trajectories[method]
    found = sorted(rows[f"world/{method}/final"], key=lambda row: row["exposure"])
    first = stepped[0].exposure.time_ns
    assert_array_equal([row["time"] + first for row in found], wanted.times_ns)
    assert_allclose(np.squeeze(column(found, "translation")), wanted.translations, rtol=1e-6, atol=1e-6)
    assert_allclose(np.squeeze(column(found, "quaternion")), wanted.xyzw, atol=1e-6)
    line = np.squeeze(column(rows[f"world/{method}/path/final"], "strips"))
    assert_allclose(line, wanted.translations, rtol=1e-6, atol=1e-6)


def test_truth_is_never_ahead_of_the_cursor(recorded):
    rows, stepped, _ = recorded
    moving = [row for row in rows["world/truth/rig"] if row.get("exposure") is not None]
    assert [row["exposure"] for row in moving] == [e.index for e in stepped]
    for row, event in zip(moving, stepped, strict=True):
        found = next(v for k, v in row.items() if k.endswith("translation"))
        assert_allclose(found[0], stepped_truth(event, stepped), atol=1e-6)


def stepped_truth(event, stepped):
    stereo = next(e for e in stepped if is_stereo(e.exposure))
    start = doubles.pose_at(stereo.exposure.time_ns)
    return (start.inverse() @ doubles.pose_at(event.exposure.time_ns)).translation


def test_images_are_jpeg_in_true_colours(recorded):
    rows, stepped, _ = recorded
    data = np.frombuffer(bytes(column(rows["video/image"], "blob")[0][0]), np.uint8)
    shown = cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    image = next(e.exposure.image for e in stepped if is_video(e.exposure))
    assert shown.shape == image.shape
    assert_allclose(shown.mean((0, 1)), image.mean((0, 1)), atol=4)


def test_what_is_shown_of_a_large_image_shrinks_with_its_points():
    camera = Camera(1280, 960, 700, 700, 639.5, 479.5)
    data = entities.jpeg(np.zeros((960, 1280), np.uint8)).blob.as_arrow_array().to_pylist()[0]
    assert cv2.imdecode(np.frombuffer(bytes(data), np.uint8), cv2.IMREAD_GRAYSCALE).shape == (480, 640)
    assert_allclose(entities.shown_uv(np.array([[-0.5, -0.5], [1279.5, 959.5]]), camera), [[0, 0], [640, 480]])


def test_trails_follow_ids_and_stop_at_birth():
    camera = Camera(100, 100, 50, 50, 49.5, 49.5)
    one = Tracks.of(np.array([5, 3]), np.array([[10, 10], [20, 20]]))
    two = Tracks.of(np.array([3, 5, 9]), np.array([[21, 20], [11, 10], [1, 1]]), uv_prev=np.zeros((3, 2)))
    strips = np.array(entities.trails([one, two], camera).strips.as_arrow_array().to_pylist())
    assert_allclose(strips - 0.5, [[[21, 20], [20, 20]], [[11, 10], [10, 10]], [[1, 1], [1, 1]]])


def test_what_moves_by_itself_is_drawn_while_it_is_reported(run):
    recorder, first, second, third = Recorder(run.opened), run.step(), run.step(), run.step()
    at = next(i for i, step in enumerate(first.steps) if "video" in step.tracks)
    video = {"exposure": first.exposure, "index": first.index}
    some = Tracks.of(np.arange(3), np.array([[10, 10], [20, 20], [30, 5]]))

    def told(event: Stepped, moved: dict[str, Tracks]) -> Stepped:
        steps = tuple(replace(s, other_motion=moved if i == at else {}) for i, s in enumerate(first.steps))
        return replace(event, steps=steps, **video)

    assert is_video(first.exposure)
    batches = [recorder.batch(told(e, m)) for e, m in ((first, {}), (second, {"video": some}), (third, {}))]
    drawn = [[e.value for e in batch.entries if e.path == "video/moving"] for batch in batches]  # type: ignore[union-attr]
    assert [len(values) for values in drawn] == [0, 1, 1] and isinstance(drawn[2][0], rr.Clear)
    points = np.array(drawn[1][0].positions.as_arrow_array().to_pylist())
    assert_allclose(points - 0.5, some.uv)
    legends = [e.value for e in batches[1].entries if e.path == "video/legend"]  # type: ignore[union-attr]
    assert "3 move alone" in legends[0].labels.as_arrow_array().to_pylist()


def test_lines_are_drawn_on_their_image_and_in_the_scene_while_a_method_has_them(run):
    recorder, first, second = Recorder(run.opened), run.step(), run.step()
    at = next(i for i, step in enumerate(first.steps) if "video" in step.tracks)
    on_image = ImageLines.of(np.array([[[1.0, 2.0], [11.0, 2.0]], [[5.0, 5.0], [5.0, 9.0]]]), np.array([0, -1]))
    in_scene = WorldLines(np.array([[[0.0, 0.0, 0.0], [0.0, 2.0, 4.0]]]), np.array([1]))
    found = replace(first.steps[at], lines={"video": on_image}, world_lines=in_scene)
    with_lines = replace(first, steps=(found,))
    without = replace(second, steps=(first.steps[at],), exposure=first.exposure)
    kept = decode(*encode(ExposureRecord.of(with_lines, None))).stepped(first.exposure)
    drawn = [recorder.batch(event).entries for event in (kept, without)]
    of_method = f"world/{found.method}/lines"
    for path, expected in (("video/lines", on_image.uv + 0.5), (of_method, in_scene.xyz_in_world)):
        (there,), (gone,) = ([e.value for e in entries if e.path == path] for entries in drawn)  # type: ignore[union-attr]
        assert_allclose(there.strips.as_arrow_array().to_pylist(), expected)
        assert isinstance(gone, rr.Clear)
    assert len(set(map(tuple, colours.of_groups(on_image.group).tolist()))) == 2


def test_a_frustum_sees_the_image_corners():
    camera = Camera(80, 60, 60.0, 60.0, 39.5, 29.5, (-0.05, 0.01, 0.0, 0.0))
    outline = entities.frustum(camera, Pose(), 2.0)
    corners = outline[np.abs(outline[:, 2] - 2) < 1e-9]
    assert_allclose(camera.project(corners)[:2], [[79.5, -0.5], [-0.5, -0.5]], atol=1e-3)


def test_a_new_placement_redraws_the_monocular_world(run):
    recorder, event = Recorder(run.opened), run.step()
    recorder.batch(event)
    moved = replace(run.step(), placements={"monocular": Similarity(2.5, Pose(translation=np.array([1.0, 0, 0])))})
    entry = next(e for e in recorder.batch(moved).entries if e.path == "world/monocular")
    assert isinstance(entry, Entry) and isinstance(entry.value, rr.Transform3D)
    assert entry.value.mat3x3 is not None
    assert_allclose(entry.value.mat3x3.as_arrow_array().to_pylist()[0], 2.5 * np.eye(3).ravel())


def test_without_a_pose_no_camera_is_left_standing(run):
    recorder, first, second, third = Recorder(run.opened), run.step(), run.step(), run.step()
    lost = replace(second, steps=tuple(replace(s, world_from_frame=None) for s in first.steps))
    found = replace(third, steps=first.steps)
    shown = [
        [type(e.value) for e in recorder.batch(event).entries if e.path == f"world/{first.steps[0].method}/camera"]  # type: ignore[union-attr]
        for event in (first, lost, found)
    ]
    assert shown == [[rr.Transform3D, rr.LineStrips3D], [rr.Clear], [rr.Transform3D, rr.LineStrips3D]]


def test_what_is_logged_per_exposure_does_not_grow(run):
    recorder = Recorder(run.opened)
    counts = [len(recorder.batch(event).entries) for event in events(run)]
    assert max(counts[10:]) <= max(counts[:10]) <= 45


def test_a_thinned_exposure_is_drawn_without_its_points(run):
    """What a history beyond its budget of disk gives to a recording that begins late."""
    recorder = Recorder(run.opened)
    while not run.done:
        event = run.step()
        record = decode(encode(ExposureRecord.of(event, None))[0], None)
        paths = [entry.path for entry in recorder.batch(record.stepped(event.exposure)).entries]
        assert any(path.endswith("/image") for path in paths) and "decisions" in paths
        assert not any("/cloud/" in path for path in paths)


def test_every_status_has_a_colour_and_methods_read_in_both_themes():
    assert set(colours.TRACK) == set(TrackStatus) and set(colours.METHOD) == {*METHODS, *PAPER}
    every = [*colours.METHOD.values(), *colours.OTHERS, colours.TRUTH]
    assert min(np.abs(np.subtract(a, b)).sum() for i, a in enumerate(every) for b in every[:i]) >= 50
    for colour in every:
        assert _contrast(colour, (255, 255, 255)) >= 3 and _contrast(colour, (13, 16, 17)) >= 3


def test_amber_is_a_warnings_and_no_methods_or_branchs():
    style = files("ispom_app").joinpath("views/web/static/app.css").read_text()
    ambers = [tuple(bytes.fromhex(found)) for found in re.findall(r"--caution: #(\w{6})", style)]
    assert len(ambers) == 2
    for colour in [*colours.METHOD.values(), *colours.OTHERS, *BRANCHES]:
        assert min(np.linalg.norm(_lab(colour) - _lab(amber)) for amber in ambers) > 25, colour


def _lab(colour) -> np.ndarray:
    """CIE 1976."""
    return cv2.cvtColor(np.array([[colour]], np.float32) / 255, cv2.COLOR_RGB2LAB)[0, 0]


def test_no_two_methods_of_this_package_share_a_colour():
    methods = [*BUILT_IN, *SURVEY]
    assert len({colours.of(name) for name in methods}) == len(methods)


def _contrast(a, b) -> float:
    """WCAG 2.1, relative luminance and contrast ratio."""
    linear = [[c / 3294.6 if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in colour] for colour in (a, b)]
    dark, light = sorted(float(np.dot([0.2126, 0.7152, 0.0722], rgb)) for rgb in linear)
    return (light + 0.05) / (dark + 0.05)


def single_camera(truth: bool = True) -> Playback:
    pair = doubles.sequence()
    assert pair.rig.video is not None
    video = [i for i, kind in enumerate(pair.kinds) if kind == "video"]
    alone = replace(
        pair,
        rig=Rig.single(pair.rig.video),
        times_ns=pair.times_ns[video],
        kinds=("video",) * len(video),
        load=lambda i: pair.load(video[i]),
        truth=pair.truth if truth else None,
    )
    return Playback(alone, ("monocular",), builder=helpers.build)


def test_a_single_camera_has_the_true_path_and_its_error_after_an_alignment(tmp_path):
    run = single_camera()
    names = {view.name for view in views(blueprint(run.opened, is_alone=True).root_container)}
    assert any("own unit, not metres; true path aligned by Sim(3)" in name for name in names) and "error [m]" in names
    with FileRecording(tmp_path / "run.rrd", run.opened) as file:
        for event in events(run):
            file.write(event)
        finished = run.finish()
        file.write(finished)
    rows = read(tmp_path / "run.rrd")
    assert "plots/error/none" not in rows and len(column(rows["world/truth/path"], "strips")) == 1
    assert len(column(rows["world/truth"], "mat3x3")) > 1, "aligned again as the path grew, and at the end"
    assert run.truth is not None
    found = error_against_truth(finished.trajectories["monocular"], run.truth, run.sequence.rig, "sim3")
    assert found is not None
    curve = [row[0] for row in column(rows["plots/error/monocular/aligned"], "scalars")]
    assert np.allclose(curve, found.position_errors_m) and len(curve) == len(found.estimate)
    newest = column(rows["plots/error/monocular/sim3"], "scalars")
    assert len(newest) == len(curve) - FIRST + 1


@pytest.mark.parametrize(
    ("methods", "first"), [(("stereo",), 1), (("fused.stereo",), 1), (("monocular",), 0), (("monocular", "stereo"), 0)]
)
def test_the_first_image_is_one_that_a_method_uses(methods: tuple[str, ...], first: int):
    layout = blueprint(Playback(doubles.sequence(), methods, builder=helpers.build).opened)
    (tabs,) = [part for part in layout.root_container.contents if isinstance(part, rrb.Tabs)]
    assert int(tabs.active_tab or 0) == first


@pytest.mark.parametrize(("start", "first"), [(0, "/video"), (1, "/left")])
def test_alone_a_viewer_begins_with_an_image_that_the_first_frame_has(start: int, first: str):
    sequence = doubles.sequence()
    later = replace(sequence, kinds=sequence.kinds[start:], times_ns=sequence.times_ns[start:])
    opened = replace(Playback(sequence, METHODS, builder=helpers.build).opened, sequence=later)
    layout = blueprint(opened, is_alone=True)
    (tabs,) = [part for part in layout.root_container.contents[0].contents if isinstance(part, rrb.Tabs)]
    assert str(tabs.contents[int(tabs.active_tab or 0)].origin) == first


@pytest.mark.parametrize("others", [0, 3])
def test_alone_a_viewer_begins_at_the_first_frame_with_an_image(others: int):
    """It is at the first frame, unless it plays in a selection that begins elsewhere."""
    sequence = doubles.sequence()
    kinds = ("imu",) * others + sequence.kinds
    later = replace(
        sequence, kinds=kinds, times_ns=np.concatenate([sequence.times_ns[:1]] * others + [sequence.times_ns])
    )
    opened = replace(Playback(sequence, METHODS, builder=helpers.build).opened, sequence=later)
    layout = blueprint(opened, is_alone=True)
    (tabs,) = [part for part in layout.root_container.contents[0].contents if isinstance(part, rrb.Tabs)]
    assert str(tabs.contents[int(tabs.active_tab or 0)].origin) == "/video"
    time = layout.time_panel
    if not others:
        assert (time.play_state, time.time_selection) == ("paused", None)
        return
    assert (time.play_state, time.loop_mode) == ("playing", "selection") and time.time_selection is not None
    assert (time.time_selection.min.value, time.time_selection.max.value) == (others, len(kinds) - 1)


def test_names_stand_at_the_ends_of_their_lines(recorded):
    """One for each line, in its colour, and no two in one place."""
    rows, _, _ = recorded
    at_end = {method: column(rows[f"world/{method}/name"], "positions")[-1][0] for method in METHODS}
    labels = {method: column(rows[f"world/{method}/name"], ":labels")[-1] for method in METHODS}
    assert labels == {method: [colours.label(method)] for method in METHODS}
    placed = [tuple(np.round(place, 6)) for place in at_end.values()]
    assert len(set(placed)) == len(METHODS)
    assert column(rows["world/truth/name"], ":labels")


def test_without_ground_truth_it_says_why_there_is_no_error(tmp_path):
    run, reason = single_camera(truth=False), "has no ground truth"
    names = {view.name for view in views(blueprint(run.opened, is_alone=True).root_container)}
    assert any("[own unit, not metres]" in name for name in names) and "error [m]" in names
    with FileRecording(tmp_path / "run.rrd", run.opened) as file:
        for event in events(run):
            file.write(event)
    rows = read(tmp_path / "run.rrd")
    (text,) = column(rows["plots/error/none"], "text")
    assert reason in text[0] and "world/truth/path" not in rows


def views(part):
    for each in part.contents:
        yield from views(each) if hasattr(each, "contents") and not isinstance(each, View) else (each,)


def test_metric_runs_are_shown_in_metres_and_have_no_excuse(recorded, run: Playback):
    assert "3-D [m], grid 0.2 m" in {view.name for view in views(blueprint(run.opened, is_alone=True).root_container)}
    assert "plots/error/none" not in recorded[0]


def test_key_frames_of_a_single_camera_do_not_overlap(tmp_path):
    run = single_camera()
    with FileRecording(tmp_path / "run.rrd", run.opened) as file:
        stepped = events(run)
        for event in stepped:
            file.write(event)
    strips = column(read(tmp_path / "run.rrd")["world/monocular/key_frames/0"], "strips")[-1]
    keys = np.array([s.world_from_frame.translation for e in stepped for s in e.steps if s.key_frame])
    spacing = np.median(np.linalg.norm(np.diff(keys, axis=0), axis=1))
    depth = max(np.linalg.norm(np.ptp(np.array(strip), axis=0)) for strip in strips)
    assert depth < 1.5 * spacing


def test_the_image_in_the_frustum_is_where_the_camera_is_and_has_no_size_without_a_pose() -> None:
    """Its pinhole is below no change of scale, which the viewer refuses, and is never without values."""
    run = Playback(doubles.sequence(), ("monocular",), builder=helpers.build)
    placement = Similarity(2.5, Pose(translation=np.array([1.0, 0, 0])))
    recorder, rig = Recorder(run.opened), run.sequence.rig
    scaled: set[str] = set()
    found: list[tuple[bool, float, bool]] = []
    for event in events(run):
        lost = 5 <= event.index < 8
        steps = tuple(replace(s, world_from_frame=None if lost else s.world_from_frame) for s in event.steps)
        entries = recorder.batch(replace(event, steps=steps, placements={"monocular": placement})).entries
        of = {(e.path, type(e.value)): e.value for e in entries if isinstance(e, Entry)}
        for (path, kind), value in of.items():
            if kind is rr.Transform3D and not np.isclose(np.linalg.det(matrix(value)), 1):
                scaled.add(path)
        pinhole = of["world/view/monocular", rr.Pinhole]
        depth = pinhole.image_plane_distance.as_arrow_array()[0].as_py()
        pictured = ("world/view/monocular/video", rr.EncodedImage) in of
        found.append((is_video(event.exposure), depth, pictured))
        if pictured:
            (own,) = (s.world_from_frame for s in steps if s.method == "monocular")
            moved = of["world/view/monocular", rr.Transform3D].translation.as_arrow_array().to_pylist()[0]
            assert own is not None
            expected = placement.apply_pose(own @ rig.rig_from("video").inverse() @ rig.rig_from_video).translation
            assert_allclose(moved, expected, atol=1e-6)
    assert "world/monocular" in scaled and not scaled & {"world", "world/view", "world/view/monocular"}
    assert all((depth > 0) == pictured for is_video, depth, pictured in found if is_video)
    assert {depth > 0 for _, depth, _ in found} == {True, False}


def matrix(value: rr.Transform3D) -> np.ndarray:
    assert value.mat3x3 is not None
    return np.array(value.mat3x3.as_arrow_array().to_pylist()[0]).reshape(3, 3)
