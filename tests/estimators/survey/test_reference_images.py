"""Frames found in images captured before: exact points first, then a folder of images of a textured plane, a panorama,
and folders that are no reference."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.estimators.survey.panorama import Matches, Panorama, PanoramaConfig, Registration
from ispom.estimators.survey.reference_images import View
from ispom.features.interfaces import Features
from ispom.geometry import Pose, rotation_angle_rad, so3_exp
from ispom.io.trajectories import tum_text
from ispom.types import Camera, Frame, Image, Rig, Status, Step, Trajectory
from tests.estimators.survey.scenes import CAMERA, seen
from tests.estimators.survey.test_panorama import image as of_sphere
from tests.estimators.survey.test_panorama import orientation

WORLD_FROM_START = Pose.from_rotvec(np.array([0.3, -1.2, 0.7]), np.array([40.0, -7.0, 3.0]))
"""A world that begins nowhere near the camera: what is absolute must be in it."""


def reference_pose(k: int) -> Pose:
    """Returns start_from_camera of reference image k: five places along an arc, two heights."""
    return Pose.from_rotvec(
        np.array([0.02 * (-1) ** k, 0.25 - 0.05 * k, 0.0]), np.array([-1.5 + 0.3 * k, 0.2 * (-1) ** k, 0.1 * k])
    )


def frame_pose(k: int) -> Pose:
    """Returns start_from_camera of frame k, at none of these places."""
    return Pose.from_rotvec(np.array([0.03, 0.2 - 0.06 * k, 0.05]), np.array([-1.2 + 0.3 * k, 0.05, 0.3]))


def write_folder(folder: Path, images: list[Image], world_from_camera: list[Pose], camera: Camera = CAMERA) -> Path:
    """Writes a reference as TUM's format has it."""
    folder.mkdir()
    lines = []
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"{k}.png"), image)
        lines.append(f"{k}.0 {k}.png\n")
    (folder / "rgb.txt").write_text("".join(lines))
    poses = [(k * 10**9, pose) for k, pose in enumerate(world_from_camera)]
    (folder / "groundtruth.txt").write_text(tum_text(Trajectory.of(poses)))
    values = f"fx: {camera.fx}\nfy: {camera.fy}\ncx: {camera.cx}\ncy: {camera.cy}\n"
    (folder / "camera.yaml").write_text(f"width: {camera.width}\nheight: {camera.height}\n{values}")
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    poses = [reference_pose(k) for k in range(10)]
    images = [seen(pose)[0] for pose in poses]
    return write_folder(tmp_path_factory.mktemp("plane") / "reference", images, [WORLD_FROM_START @ p for p in poses])


def built(folder: Path, camera: Camera = CAMERA) -> Registration:
    estimator = PanoramaConfig(reference=str(folder)).build(Rig.single(camera))
    assert isinstance(estimator, Registration)
    return estimator


def run(estimator: Registration | Panorama, images: list[Image], state=None, first: int = 0):
    state, steps = estimator.start() if state is None else state, list[Step]()
    for k, grey in enumerate(images, first):
        state, step = estimator.step(state, Frame.video((k + 1) * 10**8, grey))
        steps.append(step)
    return state, steps


def test_exact_points_give_the_exact_pose_in_their_world(folder: Path) -> None:
    estimator, rng = built(folder), np.random.default_rng(2)
    true = Pose.from_rotvec(np.array([1.0, 0.4, -0.3]), np.array([100.0, 20.0, -5.0]))
    near = np.column_stack([rng.uniform(-1, 1, (80, 2)), rng.uniform(2, 9, 80)])
    targets, rays = true.apply(near), near / np.linalg.norm(near, axis=1, keepdims=True)
    view, every = View(Features(np.zeros((80, 2), np.float32), np.zeros((80, 0))), rays), np.arange(80)
    found, decisions = estimator._located(view, Matches(every, every, targets, 0 * every), None)
    assert found is not None and all(d.passed for d in decisions)
    assert np.linalg.norm((found.world_from_camera.inverse() @ true).log()) < 1e-6
    targets[:20] = targets[rng.permutation(20)]  # wrong matches
    found, decisions = estimator._located(view, Matches(every, every, targets, 0 * every), None)
    assert found is not None and all(d.passed for d in decisions)
    assert np.linalg.norm((found.world_from_camera.inverse() @ true).log()) < 1e-3
    assert set(range(20, 80)) <= set(found.ids.tolist()) and len(found.ids) < 64


def test_frames_have_absolute_poses_of_the_folders_world(folder: Path) -> None:
    rng = np.random.default_rng(1)
    images = [np.clip(seen(frame_pose(k))[0] + rng.normal(0, 2, (240, 320)), 0, 255).astype(np.uint8) for k in range(6)]
    estimator = built(folder)
    state, steps = run(estimator, images)
    for k, step in enumerate(steps):
        assert step.status is Status.TRACKING and step.world_from_frame is not None
        off = step.world_from_frame.inverse() @ WORLD_FROM_START @ frame_pose(k)
        assert np.linalg.norm(off.translation) < 0.03, k  # of a distance of 5
        assert np.degrees(rotation_angle_rad(off.rotation)) < 0.3
    assert len(estimator.finish(state)) == 6
    plane = WORLD_FROM_START.inverse().apply(steps[0].landmarks.xyz_in_world) @ (0.1, -0.2, 1.0)
    assert len(plane) > 300 and np.median(np.abs(plane - 5)) < 0.05
    assert not len(steps[1].landmarks)


def test_the_cameras_may_differ(folder: Path) -> None:
    camera = Camera(400, 300, 380.0, 380.0, 199.5, 149.5)
    _, (step,) = run(built(folder, camera), [seen(frame_pose(2), camera)[0]])
    assert step.world_from_frame is not None
    off = step.world_from_frame.inverse() @ WORLD_FROM_START @ frame_pose(2)
    assert np.linalg.norm(off.translation) < 0.03


def test_what_the_reference_does_not_show_is_lost_and_found_again(folder: Path) -> None:
    strange = of_sphere(np.eye(3))
    _, steps = run(built(folder), [strange, seen(frame_pose(1))[0], strange, seen(frame_pose(4))[0]])
    assert [step.status for step in steps] == [Status.INITIALISING, Status.TRACKING, Status.LOST, Status.TRACKING]
    assert all(step.world_from_frame is None for step in (steps[0], steps[2]))
    assert not steps[2].decisions[0].passed


def test_a_panorama_captured_before_gives_absolute_orientations(tmp_path: Path) -> None:
    world, place = so3_exp(np.array([0.5, 2.0, -1.0])), np.array([3.0, 4.0, 5.0])
    folder = write_folder(
        tmp_path / "pan", [of_sphere(orientation(k)) for k in range(6)],
        [Pose(world @ orientation(k), place) for k in range(6)],
    )  # fmt: skip
    estimator = built(folder)
    _, steps = run(estimator, [of_sphere(orientation(k)) for k in (0.5, 2.5, 4.4)])  # type: ignore[arg-type]
    for k, step in zip((0.5, 2.5, 4.4), steps, strict=True):
        assert step.world_from_frame is not None
        assert np.allclose(step.world_from_frame.translation, place)
        error = rotation_angle_rad(step.world_from_frame.rotation.T @ world @ orientation(k))  # type: ignore[arg-type]
        assert np.degrees(error) < 0.1


def test_a_run_may_go_on_with_and_without_a_reference(folder: Path) -> None:
    """A fork changes the setting: neither frames nor times are lost."""
    images = [seen(frame_pose(k))[0] for k in range(6)]
    own = PanoramaConfig().build(Rig.single(CAMERA))
    state, _ = run(own, images[:2])
    state, steps = run(built(folder), images[2:4], state, 2)
    assert all(step.status is Status.TRACKING for step in steps) and [s.restarted for s in steps] == [True, False]
    state, steps = run(own, images[4:], state, 4)
    assert steps[0].restarted and steps[0].status is Status.TRACKING
    assert len(own.finish(state)) >= 5


def test_folders_that_are_no_reference_are_refused(folder: Path, tmp_path: Path) -> None:
    def fault(place: Path | str) -> str:
        with pytest.raises(InputError) as found:
            PanoramaConfig(reference=str(place)).build(Rig.single(CAMERA))
        return str(found.value)

    def copied(name: str) -> Path:
        images = [seen(reference_pose(k))[0] for k in range(4)]
        return write_folder(tmp_path / name, images, [reference_pose(k) for k in range(4)])

    assert "nowhere" in fault(tmp_path / "nowhere")
    assert "folder" in fault("sim:tiny") and "folder" in fault(folder / "rgb.txt")
    (poseless := copied("poseless")).joinpath("groundtruth.txt").unlink()
    assert "pose" in fault(poseless)
    (lensless := copied("lensless")).joinpath("camera.yaml").unlink()
    assert "camera.yaml" in fault(lensless)
    wrong = [reference_pose(k).inverse() @ Pose.from_rotvec(np.array([0.0, 0.0, k]), np.zeros(3)) for k in range(4)]
    (contrary := copied("contrary")).joinpath("groundtruth.txt").write_text(
        tum_text(Trajectory.of([(k * 10**9, pose) for k, pose in enumerate(wrong)]))
    )
    assert "do not fit" in fault(contrary)


def test_nothing_outside_of_the_folder_is_read(folder: Path, tmp_path: Path) -> None:
    linked = tmp_path / "linked"
    linked.mkdir()
    for file in folder.iterdir():
        if file.name != "3.png":
            (linked / file.name).write_bytes(file.read_bytes())
    (linked / "3.png").symlink_to(folder / "3.png")
    with pytest.raises(InputError, match=r"3\.png"):
        PanoramaConfig(reference=str(linked)).build(Rig.single(CAMERA))


def test_the_name_of_the_folder_is_text(folder: Path) -> None:
    with pytest.raises(InputError, match="reference"):
        PanoramaConfig(reference=folder).build(Rig.single(CAMERA))  # type: ignore[arg-type]
