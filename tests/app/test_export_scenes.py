"""`ispom export` of cameras, images and points: what is written is read back equal, by us and by the other program."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.bag_file import BagFile
from ispom.io.calibrations.recognised import one_camera, one_rig
from ispom.io.maps import read_maps
from ispom.io.mcap import mcap_bytes
from ispom.io.nerfstudio import transforms_text
from ispom.io.orbslam import orbslam_text
from ispom.io.poses.recognised import read_trajectory
from ispom.io.rig import read_rig
from ispom.sequences import open_sequence
from ispom.types import Camera, Landmarks, Rig, Trajectory
from tests.app import helpers
from tests.app.helpers import ran
from tests.io.test_dialects import CAMERAS, assert_alike
from tests.sequences.kitti_folder import make_drive

POSES = Trajectory.of(
    [
        (10**18 + n * 10**8, Pose.from_rotvec(np.array([0.1 * n, -0.2, 0.3]), np.array([n, 0.5, -2.0])))
        for n in range(5)
    ],
    "video",
)
FIVE = Camera(640, 480, 500.0, 501.0, 320.25, 240.75, (-0.2, 0.06, 0.0006, -0.0004, 0.01))
LENSES = {
    "pinhole": replace(FIVE, distortion=()),
    "radtan": replace(FIVE, distortion=FIVE.distortion[:4]),
    "five": FIVE,
    "rational": replace(FIVE, distortion=(*FIVE.distortion, 0.1, 0.02, 0.003)),
    "fisheye": replace(FIVE, distortion=(0.01, 0.02, -0.003, 0.0004), lens="fisheye"),
}
POINTS = Landmarks(np.arange(3), np.array([[0.5, 1, 2], [3, 4, 5], [-1, 0, 7.0]]), np.array([[1, 2, 3]] * 3, np.uint8))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a pair in a simulation."""
    out = tmp_path_factory.mktemp("export") / "run"
    return ran("sim:tiny", out, "--methods", "stereo", "--no-recording")


def exported(run: Path, form: str, out: Path, method: str = "stereo") -> Path:
    words = ["--format", form, "--methods", method, "--out", str(out), "--max-error-px", "1e6"]
    assert main(["export", str(run), *words]) == 0
    return out


def assert_same_poses(found: Trajectory, expected: Trajectory, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(found.translations, expected.translations, atol=atol)
    np.testing.assert_allclose(found.rotations, expected.rotations, atol=atol)


def test_colmap_in_binary_is_the_text_model(run: Path, tmp_path: Path) -> None:
    text = exported(run, "colmap", tmp_path / "text") / "stereo"
    binary = exported(run, "colmap-binary", tmp_path / "binary") / "stereo"
    assert_alike(one_camera(binary)[0], one_camera(text / "cameras.txt")[0])
    own, other = (read_trajectory(each) for each in (binary / "images.bin", text / "images.txt"))
    assert own.images == other.images and len(own.images)
    assert_same_poses(own.trajectory, other.trajectory)
    pycolmap = pytest.importorskip("pycolmap")
    models = [pycolmap.Reconstruction(str(each)) for each in (binary, text)]
    assert models[0].num_points3D() == models[1].num_points3D() > 0
    assert models[0].compute_num_observations() == models[1].compute_num_observations() > 0
    for number, image in models[1].images.items():
        same = models[0].images[number]
        assert same.name == image.name
        np.testing.assert_array_equal(same.cam_from_world().matrix(), image.cam_from_world().matrix())
    for number, point in models[1].points3D.items():
        np.testing.assert_array_equal(models[0].points3D[number].xyz, point.xyz)
        assert models[0].points3D[number].color.tolist() == point.color.tolist()


def test_nerfstudio_has_the_keyframes_and_their_images(run: Path, tmp_path: Path) -> None:
    folder = exported(run, "nerfstudio", tmp_path / "out") / "stereo"
    keys = read_maps(run / "landmarks.npz")["stereo"].key_frames
    found = read_trajectory(folder / "transforms.json")
    assert found.images == tuple(f"images/{time_ns}.png" for time_ns in keys.times_ns.tolist())
    assert_same_poses(found.trajectory, keys)
    assert_alike(one_camera(folder / "transforms.json")[0], read_rig(run / "rig.yaml").camera("left"))
    assert len(list((folder / "images").iterdir())) == len(keys)
    opened = open_sequence(str(folder))
    assert opened.truth is not None and len(opened.truth) == len(keys) and opened.guess is None


def test_an_mcap_file_has_poses_points_and_images(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    path = exported(run, "mcap", tmp_path / "out") / "stereo.mcap"
    scene, rig = read_maps(run / "landmarks.npz")["stereo"], read_rig(run / "rig.yaml")
    for topic in ("/pose", "/path", "/tf"):
        found = read_trajectory(Path(f"{path}:{topic}")).trajectory
        at = np.searchsorted(found.times_ns, scene.key_frames.times_ns)
        assert found.times_ns[at].tolist() == scene.key_frames.times_ns.tolist()
    opened = open_sequence(str(path))
    assert opened.times_ns.tolist() == scene.key_frames.times_ns.tolist()
    assert_alike(opened.rig.video, rig.camera("left"))
    assert opened[0].images["video"].shape[:2] == (rig.camera("left").height, rig.camera("left").width)
    cloud = BagFile(path).message("/points")
    xyz = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 4)[:, :3]
    np.testing.assert_allclose(xyz, scene.landmarks.xyz_in_world, rtol=1e-6)


@pytest.mark.parametrize("lens", LENSES)
def test_the_poses_and_the_lens_of_an_mcap_file_are_exact(lens: str, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    camera = LENSES[lens]
    images = [(t, np.full((480, 640), 40, np.uint8)) for t in POSES.times_ns.tolist()]
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap_bytes(camera, POSES, POINTS, images))
    for topic in ("/pose", "/path", "/tf"):
        found = read_trajectory(Path(f"{path}:{topic}")).trajectory
        assert found.times_ns.tolist() == POSES.times_ns.tolist()
        assert_same_poses(found, POSES, 1e-12)
    assert_alike(open_sequence(str(path)).rig.video, camera)


def test_the_mcap_package_reads_the_file(tmp_path: Path) -> None:
    """As Foxglove does: with a schema for each topic."""
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap_bytes(FIVE, POSES, POINTS, [(int(POSES.times_ns[0]), np.full((480, 640), 40, np.uint8))]))
    with path.open("rb") as file:
        found = [*reader.make_reader(file, validate_crcs=True).iter_messages()]
    kinds = {channel.topic: schema.name for schema, channel, _ in found}
    assert kinds == {
        "/pose": "geometry_msgs/msg/PoseStamped",
        "/path": "nav_msgs/msg/Path",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/points": "sensor_msgs/msg/PointCloud2",
        "/camera/image/compressed": "sensor_msgs/msg/CompressedImage",
        "/camera/camera_info": "sensor_msgs/msg/CameraInfo",
    }
    assert all(schema.encoding == "ros2msg" and channel.message_encoding == "cdr" for schema, channel, _ in found)
    assert [message.log_time for _, channel, message in found if channel.topic == "/pose"] == POSES.times_ns.tolist()


@pytest.mark.parametrize(("form", "name"), [("kalibr", "camchain.yaml"), ("orbslam", "orbslam3.yaml")])
def test_the_rig_of_a_run_as_settings_is_read_back(form: str, name: str, run: Path, tmp_path: Path) -> None:
    expected, found = read_rig(run / "rig.yaml"), one_rig((exported(run, form, tmp_path / "out") / name,))[0]
    assert_alike(found.left, expected.camera("left"))
    assert_alike(found.right, expected.camera("right"))
    assert found.baseline_m == pytest.approx(expected.baseline_m, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(camera=CAMERAS)
def test_cameras_and_poses_are_read_back_by_hypothesis(
    camera: Camera, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("settings")
    (folder / "transforms.json").write_text(transforms_text(camera, POSES, lambda time_ns: f"{time_ns}.png"))
    assert_alike(one_camera(folder / "transforms.json")[0], camera)
    assert_same_poses(read_trajectory(folder / "transforms.json").trajectory, POSES)
    (folder / "orb.yaml").write_text(orbslam_text(Rig.single(camera), 20.0))
    assert_alike(one_camera(folder / "orb.yaml")[0], camera)
    flat = replace(camera, distortion=(), lens="opencv")
    rig = Rig.of(left=flat, right=flat, rig_from_right=Pose(translation=np.array([0.3, 0.0, 0.0])))
    (folder / "pair.yaml").write_text(orbslam_text(rig, 20.0))
    found = one_rig((folder / "pair.yaml",))[0]
    assert_alike(found.left, flat)
    assert found.baseline_m == pytest.approx(0.3, abs=1e-12)


def test_a_lens_that_a_program_does_not_have_is_refused() -> None:
    with pytest.raises(InputError, match="rational"):
        transforms_text(LENSES["rational"], POSES, str)
    with pytest.raises(InputError, match="rational"):
        orbslam_text(Rig.single(LENSES["rational"]), 20.0)


def test_without_its_images_a_run_is_exported_nevertheless(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive, out = make_drive(tmp_path / "kitti"), tmp_path / "run"
    ran(drive, out, "--no-recording", builder=helpers.build)
    (tmp_path / "kitti").rename(tmp_path / "moved")
    folder = exported(out, "nerfstudio", tmp_path / "out") / "stereo"
    assert (folder / "transforms.json").exists() and not (folder / "images").exists()
    assert "no images" in capsys.readouterr().out
