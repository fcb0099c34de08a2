"""360-degree images: a face shows what lies in its direction, and methods find the motion of the rig."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.cameras import Equirectangular
from ispom.errors import InputError
from ispom.evaluation.trajectory_error import alignment
from ispom.geometry import Pose, rotation_angle_rad
from ispom.methods import possible_methods
from ispom.sequences import open_sequence
from ispom.sequences.panoramic import FACES, with_faces
from ispom.simulation.motions import Flight
from ispom.simulation.places.city import build_city
from ispom.simulation.rendering.renderer import Renderer
from ispom.types import Frame, Image, Rig, Sequence, Status, Trajectory
from tests.alone import alone, run
from tests.panorama_scene import panorama

WIDTH = 640
RNG = np.random.default_rng(4)
STEP_NS, COUNT = 100_000_000, 14


def filmed(images: list[Image], rig_from_video: Pose | None = None) -> Sequence:
    camera = Equirectangular.camera(images[0].shape[1], images[0].shape[0])
    rig = Rig.of(video=camera, rig_from_video=rig_from_video or Pose())
    times_ns = STEP_NS * np.arange(len(images), dtype=np.int64)
    return Sequence("360", rig, times_ns, ("video",) * len(images), lambda i: Frame.video(STEP_NS * i, images[i]))


def of_directions(width: int) -> Image:
    """An image whose colour is its direction."""
    camera = Equirectangular.camera(width, width // 2)
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    rays, _ = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    return np.rint(127.5 + 127.5 * rays).astype(np.uint8).reshape(camera.height, camera.width, 3)


def test_each_pixel_of_a_face_shows_its_direction_also_across_the_seam() -> None:
    sequence = with_faces(filmed([of_directions(WIDTH)], Pose(translation=np.array([0.0, -1.0, 0.0]))))
    frame, front = sequence[0], sequence[1]
    assert isinstance(frame, Frame) and isinstance(front, Frame)
    assert frame.kind == "cameras" and set(frame.images) == set(FACES) and front.kind == "video"
    assert np.array_equal(front.image, frame.images["front"])
    for name, image in frame.images.items():
        camera = sequence.rig.camera(name)
        u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
        rays, valid = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
        expected = 127.5 + 127.5 * rays @ sequence.rig.rig_from(name).rotation.T
        assert valid.all() and np.abs(image.reshape(-1, 3) - expected).max() <= 1.5, name
        np.testing.assert_allclose(sequence.rig.rig_from(name).translation, [0.0, -1.0, 0.0])


def test_other_cameras_are_left_as_they_are() -> None:
    sequence = filmed([of_directions(WIDTH)])
    pinhole = with_faces(sequence)
    assert with_faces(pinhole) is pinhole
    assert {"monocular", "multicamera"} <= set(possible_methods(pinhole.rig))


@pytest.fixture(scope="module")
def flown() -> tuple[Sequence, list[Pose]]:
    renderer, motion = Renderer(build_city(0)), Flight.seeded(0)
    poses = [motion.pose_at(9_000_000_000 + k * STEP_NS) for k in range(COUNT)]
    noise = [RNG.normal(0, 1.6, (WIDTH // 2, WIDTH, 3)) for _ in poses]
    clean = [panorama(renderer, pose, WIDTH) for pose in poses]
    images = [np.clip(image + n, 0, 255).astype(np.uint8) for image, n in zip(clean, noise, strict=True)]
    return with_faces(filmed(images)), poses


def test_multicamera_finds_the_motion_of_a_360_degree_camera(flown: tuple[Sequence, list[Pose]]) -> None:
    sequence, true = flown
    frames = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "cameras"]
    steps = list(run(alone("multicamera", sequence.rig), frames))
    found = [(s.time_ns, s.world_from_frame) for s in steps if s.status is Status.TRACKING and s.world_from_frame]
    first = found[0][0] // STEP_NS
    assert first <= 4 and [t // STEP_NS for t, _ in found] == [*range(first, COUNT)]
    estimate = Trajectory.of(found, "rig")
    reference = Trajectory.of([(t, true[t // STEP_NS]) for t, _ in found], "rig")
    placed = alignment(estimate, reference, "sim3")
    off = np.linalg.norm(placed.apply(estimate.translations) - reference.translations, axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.02 * reference.length
    turned = placed.pose.rotation @ estimate.rotations
    assert np.degrees(rotation_angle_rad(turned.transpose(0, 2, 1) @ reference.rotations)).max() < 0.5


def test_one_centre_never_shows_the_scale(flown: tuple[Sequence, list[Pose]]) -> None:
    sequence, _ = flown
    frames = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "cameras"]
    decisions = [d for s in run(alone("multicamera", sequence.rig), frames) for d in s.decisions]
    scales = [d for d in decisions if d.key == "relative_scale_sigma"]
    assert scales and not any(d.passed for d in scales)


def test_a_folder_with_its_camera_file_is_opened(tmp_path: Path) -> None:
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i:03d}.png"), of_directions(256))
    (tmp_path / "camera.yaml").write_text("model: spherical\nwidth: 256\nheight: 128\n")
    sequence = open_sequence(str(tmp_path))
    assert sequence.kinds == ("cameras", "video") * 3
    assert set(sequence.rig.cameras) == {"video", *FACES}
    assert any("360-degree" in note for note in sequence.notes)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("model: equirectangular\nwidth: 256\nheight: 192\n", "twice as wide as high"),
        ("model: equirectangular\nwidth: 256\nheight: 128\nfx: 300\n", "leave it out"),
        ("model: equirectangular\nwidth: 256\n", "height"),
    ],
)
def test_a_wrong_camera_file_is_one_sentence(text: str, said: str, tmp_path: Path) -> None:
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i:03d}.png"), of_directions(256))
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.raises(InputError, match=said):
        open_sequence(str(tmp_path))
