"""Tags: exact corners first, then rendered ones, then real images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ispom.errors import InputError
from ispom.estimators.survey.tags import UNIT_CORNERS, Memory, TagPoses, TagsConfig, View
from ispom.geometry import Pose, rotation_angle_rad
from ispom.types import Camera, Frame, Rig, Status, Step
from tests.alone import stepped_through
from tests.tag_scene import CAMERA, SIDE_M, WORLD_FROM_TAG, corners_in_world, rendered, tag_sequence, world_from_camera

REAL = Path(__file__).parents[4] / "shared" / "data" / "sensors" / "tags"


def view(pose: Pose, tags: list[int]) -> View:
    """Exact corners of tags."""
    uv = np.stack([CAMERA.project(pose.inverse().apply(corners_in_world(tag))) for tag in tags])
    x = CAMERA.normalise(uv.reshape(-1, 2)).reshape(-1, 4, 2)
    return View(np.array(tags, np.int64), uv.astype(np.float32), x)


def steps_of(estimator: TagPoses, frames: list[Frame]) -> tuple[Memory, list[Step]]:
    state, steps = stepped_through(estimator, frames)
    return state.memory, steps


def degrees(a: Pose, b: Pose) -> float:
    return float(np.degrees(rotation_angle_rad(a.rotation.T @ b.rotation)))


def test_exact_corners_give_the_exact_map() -> None:
    estimator = TagsConfig(side_m=SIDE_M).build(Rig.single(CAMERA))
    memory = Memory()
    for i in range(0, 40, 4):
        seen = view(world_from_camera(i), sorted(WORLD_FROM_TAG))
        if not memory.tags:
            memory = Memory(estimator._first_tag(seen))
        pose, errors, decisions = estimator._locate(memory, seen)
        assert pose is not None
        assert errors.max() < 1e-3
        exact = View(seen.ids, seen.uv, seen.x, pose)
        memory, _, _ = estimator._extend(memory, exact, decisions[-1].passed)
    origin = WORLD_FROM_TAG[memory.tags[0].id]
    assert {tag.id for tag in memory.tags} == WORLD_FROM_TAG.keys()
    for tag in memory.tags:
        off = (origin.inverse() @ WORLD_FROM_TAG[tag.id]).inverse() @ tag.world_from_tag
        assert np.linalg.norm(off.log()) < 1e-5


@pytest.fixture(scope="module")
def run() -> tuple[Memory, list[Step]]:
    sequence = tag_sequence()
    estimator = TagsConfig(side_m=SIDE_M).build(sequence.rig)
    frames = [sequence[i] for i in range(len(sequence))]
    return steps_of(estimator, [f for f in frames if isinstance(f, Frame)])


def test_rendered_tags_give_orientation_within_three_tenths_of_a_degree(run: tuple[Memory, list[Step]]) -> None:
    memory, steps = run
    assert all(step.status is Status.TRACKING for step in steps)
    origin = WORLD_FROM_TAG[memory.tags[0].id]
    poses = [(origin @ s.world_from_frame, world_from_camera(i)) for i, s in enumerate(steps) if s.world_from_frame]
    # The world is a tag, whose tilt is known once a second view has it: from then on all frames agree.
    since = [i for i, step in enumerate(steps) if step.key_frame][1]
    offsets = [true @ found.inverse() for found, true in poses[since:]]
    turn = Rotation.from_matrix([offset.rotation for offset in offsets]).mean().as_matrix()
    shift = np.mean([true.translation - turn @ found.translation for found, true in poses[since:]], axis=0)
    world = Pose(turn, shift)
    turned = [degrees(world @ found, true) for found, true in poses[since:]]
    shifted = [np.linalg.norm((world @ found).translation - true.translation) for found, true in poses[since:]]
    assert since < 10
    assert max(turned) < 0.3
    assert max(shifted) < 0.01  # of a path of 0.8 m


def test_the_side_is_the_scale(run: tuple[Memory, list[Step]]) -> None:
    memory, _ = run
    place = {tag.id: tag.world_from_tag.translation for tag in memory.tags}
    for a, b in ((0, 1), (0, 2), (1, 3)):
        true = np.linalg.norm(WORLD_FROM_TAG[a].translation - WORLD_FROM_TAG[b].translation)
        assert np.linalg.norm(place[a] - place[b]) == pytest.approx(true, rel=0.01)


def test_outlines_have_their_tag_as_group(run: tuple[Memory, list[Step]]) -> None:
    memory, steps = run
    last = steps[-1]
    assert set(last.world_lines.group.tolist()) == {tag.id for tag in memory.tags}
    sides = np.linalg.norm(last.world_lines.xyz_in_world[:, 1] - last.world_lines.xyz_in_world[:, 0], axis=1)
    assert np.allclose(sides, SIDE_M)
    assert len(last.lines["video"]) == len(last.tracks["video"])


def test_a_known_map_gives_poses_in_its_world() -> None:
    from ispom.estimators.survey.tags import Tag

    known = tuple(Tag(i, pose) for i, pose in WORLD_FROM_TAG.items())
    estimator = TagPoses(Rig.single(CAMERA), TagsConfig(side_m=SIDE_M), known)
    true = world_from_camera(12)
    _, (step,) = steps_of(estimator, [Frame.video(0, rendered(true))])
    assert step.world_from_frame is not None
    assert degrees(step.world_from_frame, true) < 0.3
    assert np.linalg.norm(step.world_from_frame.translation - true.translation) < 0.005


def map_file(folder: Path, poses: dict[int, Pose], corners: bool = False) -> str:
    """Writes a map of tags: their poses, or their corners."""
    lines = ["tags:"]
    for tag, pose in poses.items():
        if corners:
            lines.append(f"  {tag}: {{corners: {pose.apply(SIDE_M * UNIT_CORNERS).tolist()}}}")
        else:
            lines.append(f"  {tag}: {{position: {pose.translation.tolist()}, xyzw: {pose.xyzw.tolist()}}}")
    path = folder / "tags.yaml"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


SURVEY_FROM_WORLD = Pose.from_rotvec(np.array([1.1, 0.4, -0.7]), np.array([12.0, -3.0, 50.0]))
"""The survey's world is not the scene's."""
SURVEYED = {tag: SURVEY_FROM_WORLD @ WORLD_FROM_TAG[tag] for tag in (0, 1)}


@pytest.mark.parametrize("corners", [False, True])
def test_exact_corners_and_some_surveyed_tags_give_all_in_the_world_of_the_survey(
    tmp_path: Path, corners: bool
) -> None:
    estimator = TagsConfig(side_m=SIDE_M, map=map_file(tmp_path, SURVEYED, corners)).build(Rig.single(CAMERA))
    memory = estimator.begin()
    for i in range(0, 40, 4):
        seen = view(world_from_camera(i), sorted(WORLD_FROM_TAG))
        pose, _, decisions = estimator._locate(memory, seen)
        assert pose is not None
        off = pose @ SURVEY_FROM_WORLD @ world_from_camera(i)
        assert np.linalg.norm(off.log()) < 1e-4
        memory, _, _ = estimator._extend(memory, replace(seen, camera_from_world=pose), decisions[-1].passed)
    assert {tag.id for tag in memory.tags} == WORLD_FROM_TAG.keys()
    for tag in memory.tags:
        off = (SURVEY_FROM_WORLD @ WORLD_FROM_TAG[tag.id]).inverse() @ tag.world_from_tag
        assert np.linalg.norm(off.log()) < 1e-5


def test_rendered_frames_have_absolute_poses(tmp_path: Path) -> None:
    sequence = tag_sequence()
    estimator = TagsConfig(side_m=SIDE_M, map=map_file(tmp_path, SURVEYED)).build(sequence.rig)
    memory, steps = steps_of(estimator, [f for i in range(len(sequence)) if isinstance(f := sequence[i], Frame)])
    for i, step in enumerate(steps):
        assert step.world_from_frame is not None
        true = SURVEY_FROM_WORLD @ world_from_camera(i)
        assert np.linalg.norm(step.world_from_frame.translation - true.translation) < 0.02, i
        assert degrees(step.world_from_frame, true) < 0.6, i
    places = {tag.id: tag.world_from_tag for tag in memory.tags}
    assert places.keys() == WORLD_FROM_TAG.keys()
    assert all(np.allclose(places[tag].matrix, SURVEYED[tag].matrix, rtol=0, atol=1e-12) for tag in SURVEYED)


def test_no_frame_before_the_first_surveyed_tag_has_a_pose(tmp_path: Path) -> None:
    """Tag 3 comes into view after half a second; the others then become known by it."""
    known = {3: SURVEY_FROM_WORLD @ WORLD_FROM_TAG[3]}
    estimator = TagsConfig(side_m=SIDE_M, map=map_file(tmp_path, known)).build(Rig.single(CAMERA))
    frames = [Frame.video(i * 33_000_000, rendered(world_from_camera(i))) for i in range(12, 40)]
    memory, steps = steps_of(estimator, frames)
    begun = next(i for i, step in enumerate(steps) if step.status is Status.TRACKING)
    assert begun > 2 and all(s.status is Status.INITIALISING and s.world_from_frame is None for s in steps[:begun])
    assert memory.tags[0].id == 3 and len(memory.tags) > 2
    assert all(step.status is Status.TRACKING for step in steps[begun:])


def test_a_fork_with_another_map_begins_again_in_its_world(tmp_path: Path) -> None:
    frames = [Frame.video(i * 10**8, rendered(world_from_camera(i))) for i in range(12, 16)]
    own = TagsConfig(side_m=SIDE_M).build(Rig.single(CAMERA))
    config = TagsConfig(side_m=SIDE_M, map=map_file(tmp_path, SURVEYED))
    state, _ = own.step(own.start(), frames[0])
    state, step = config.build(Rig.single(CAMERA)).step(state, frames[1])
    assert step.restarted and step.world_from_frame is not None
    assert degrees(step.world_from_frame, SURVEY_FROM_WORLD @ world_from_camera(13)) < 1.0
    state, step = config.build(Rig.single(CAMERA)).step(state, frames[2])
    assert not step.restarted and step.status is Status.TRACKING
    _, step = own.step(state, frames[3])
    assert step.restarted


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("tags: {}", "tags"),
        ("0: {position: [0, 0, 0], xyzw: [0, 0, 0, 1]}", "tags"),
        ("tags: {0: {position: [0, 0, 0]}}", "tag 0"),
        ("tags: {0: {position: [0, 0, .nan], xyzw: [0, 0, 0, 1]}}", "position"),
        ("tags: {0: {position: [0, 0, 0], xyzw: [0, 0, 0, 2]}}", "norm"),
        ("tags: {one: {position: [0, 0, 0], xyzw: [0, 0, 0, 1]}}", "one"),
        ("tags: {587: {position: [0, 0, 0], xyzw: [0, 0, 0, 1]}}", "587"),
        ("tags: {3: {corners: [[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0]]}}", "side"),
        ("tags: {3: {corners: [[0, 0, 0], [0.16, 0.16, 0], [0.16, 0, 0], [0, 0.16, 0]]}}", "side"),
        ("tags: {3: {corners: [[0, 0, 0], [0.16, 0, 0], [0.16, 0.16, 0]]}}", "4 corners"),
        ("!!python/object/apply:os.system [echo]", "YAML"),
    ],
)
def test_what_is_no_map_is_refused(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "tags.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=word):
        TagsConfig(map=str(path)).build(Rig.single(CAMERA))
    with pytest.raises(InputError, match="nowhere"):
        TagsConfig(map=str(tmp_path / "nowhere.yaml")).build(Rig.single(CAMERA))


def test_without_a_tag_the_frame_is_lost() -> None:
    estimator = TagsConfig(side_m=SIDE_M).build(Rig.single(CAMERA))
    blank = np.full((CAMERA.height, CAMERA.width), 110, np.uint8)
    _, steps = steps_of(estimator, [Frame.video(0, rendered(world_from_camera(0))), Frame.video(1, blank)])
    assert [s.status for s in steps] == [Status.TRACKING, Status.LOST]


@pytest.mark.skipif(not REAL.exists(), reason="needs the images of real tags")
def test_real_tags_fit_within_a_pixel() -> None:
    camera = Camera(1920, 1080, 1366.43, 1365.85, 961.648, 533.627)
    estimator = TagsConfig(dictionary="aruco_original", side_m=0.03).build(Rig.single(camera))
    grey = [cv2.imread(str(REAL / f"image_{i}.jpg"), cv2.IMREAD_GRAYSCALE) for i in range(15)]
    frames = [Frame.video(10**9 * i, np.asarray(g, np.uint8)) for i, g in enumerate(grey)]
    memory, steps = steps_of(estimator, frames)
    located = [s for s in steps if s.status is Status.TRACKING]
    assert len(located) == 15
    assert np.median(np.concatenate([s.residuals_px for s in located])) < 1.0
    # a row of tags lies on a table: they are in one plane, to some mm
    places = np.stack([tag.world_from_tag.translation for tag in memory.tags])
    flat = np.linalg.svd(places - places.mean(axis=0))[1][2] / np.sqrt(len(places))
    assert flat < 0.01
