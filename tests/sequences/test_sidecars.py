"""What lies beside images, films and bags: calibrations, times and poses of other programs are used, or named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.sequences import open_sequence
from ispom.sequences.named import named
from ispom.sequences.sidecars import image_times
from ispom.types import Sequence
from tests.io.pose_examples import colmap_binary, flat, lines, poses_of, transforms, xyz, xyzw
from tests.io.test_pose_dialects import pose_bag
from tests.sequences.bag_folders import make_bag
from tests.sequences.folders import HEIGHT, WIDTH, images, make_euroc, make_tum
from tests.sequences.own_folders import make_images, pair_folder, write_images, write_video

COUNT = 6
POSES = poses_of(Pose.from_rotvec(np.array([0.1, -0.2, 1.0]), np.array([3.0, 0.5, -2.0])), COUNT)
CAMERA_MATRIX = "80.0, 0, 47.5\n0, 80, 31.5\n0, 0, 1\n"


def made(folder: Path, name: str = "frame_{}.jpg", first: int = 8) -> Path:
    """Images with the names that the examples of poses have, 2 before 10."""
    write_images(folder, images(COUNT, 0))
    for i, path in enumerate(sorted(folder.iterdir())):
        path.rename(folder / name.format(i + first).replace(".jpg", path.suffix))
    return folder


def assert_truth(opened: Sequence, name: str) -> None:
    """The poses are the truth, and a note says from which file."""
    truth = opened.truth
    assert truth is not None and any(name in note and "ground truth" in note for note in opened.notes)
    np.testing.assert_allclose(truth.translations, [pose.translation for pose in POSES], atol=1e-6)
    np.testing.assert_allclose(truth.rotations, [pose.rotation for pose in POSES], atol=1e-6)


def test_a_transforms_json_gives_lens_and_truth(tmp_path: Path) -> None:
    made(tmp_path / "images")
    lens = f'"fl_x": 80, "fl_y": 80, "cx": 48, "cy": 32, "w": {WIDTH}, "h": {HEIGHT}'
    content = transforms(POSES).decode().replace('"fl_x": 226.0, "w": 320, "h": 240', lens)
    (tmp_path / "transforms.json").write_text(content)
    for source in (tmp_path, tmp_path / "images"):
        opened = open_sequence(str(source))
        assert opened.guess is None and opened.rig.video is not None and opened.rig.video.fx == 80
        assert_truth(opened, "transforms.json")


def test_a_model_of_colmap_gives_lens_and_truth(tmp_path: Path) -> None:
    made(tmp_path / "images")
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    (tmp_path / "sparse" / "0" / "cameras.txt").write_text(f"1 PINHOLE {WIDTH} {HEIGHT} 80 80 48 32\n")
    (tmp_path / "sparse" / "0" / "images.bin").write_bytes(colmap_binary(POSES))
    opened = open_sequence(str(tmp_path))
    assert opened.rig.video is not None and opened.rig.video.cx == 47.5
    assert_truth(opened, "images.bin")


def test_images_without_a_pose_have_no_truth(tmp_path: Path) -> None:
    made(tmp_path / "images")
    (tmp_path / "sparse").mkdir()
    (tmp_path / "sparse" / "images.bin").write_bytes(colmap_binary(POSES[:4]))
    opened = open_sequence(str(tmp_path))
    assert opened.truth is not None and len(opened.truth) == 4 and opened.guess is not None


def test_layouts_of_scannet_and_replica_have_poses(tmp_path: Path) -> None:
    scannet, replica = tmp_path / "scannet", tmp_path / "replica"
    made(scannet / "color", "{}.jpg", 0)
    (scannet / "intrinsic").mkdir()
    (scannet / "intrinsic" / "intrinsic_color.txt").write_text("80 0 47.5 0\n0 80 31.5 0\n0 0 1 0\n0 0 0 1\n")
    (scannet / "pose").mkdir()
    for i, pose in enumerate(POSES):
        np.savetxt(scannet / "pose" / f"{i}.txt", pose.matrix)
    opened = open_sequence(str(scannet))
    assert opened.rig.video is not None and opened.rig.video.fx == 80
    assert_truth(opened, "pose")
    made(replica / "results", "frame{:06d}.jpg", 0)
    for path in list((replica / "results").iterdir()):
        (replica / "results" / path.name.replace("frame", "depth")).write_bytes(path.read_bytes())
    (replica / "traj.txt").write_bytes(lines(POSES, lambda _, p: flat(p, 4)))
    assert_truth(open_sequence(str(replica)), "traj.txt")


def test_a_film_of_a_scanner_has_its_lens_and_poses(tmp_path: Path) -> None:
    write_video(tmp_path / "rgb.avi", images(COUNT, 0))
    (tmp_path / "camera_matrix.csv").write_text(CAMERA_MATRIX)
    head = "timestamp, frame, x, y, z, qx, qy, qz, qw\n"
    rows = lines(POSES, lambda i, p: [7731.5 + i / 30, f"{i:06d}", *xyz(p), *xyzw(p)], head, ", ")
    (tmp_path / "odometry.csv").write_bytes(rows)
    opened = open_sequence(str(tmp_path))
    assert opened.rig.video is not None and opened.rig.video.fx == 80 and opened.guess is None
    assert_truth(opened, "odometry.csv")
    (tmp_path / "another.avi").write_bytes((tmp_path / "rgb.avi").read_bytes())
    alone = open_sequence(str(tmp_path / "rgb.avi"))
    assert alone.truth is None and alone.guess is not None, "files beside two films may belong to either"


def test_what_is_no_calibration_and_what_is_not_used_is_named(tmp_path: Path) -> None:
    folder = made(tmp_path / "images")
    (tmp_path / "K.txt").write_text("1 2 3\n")
    (tmp_path / "imu.csv").write_text("t,x\n")
    (tmp_path / "poses.txt").write_bytes(lines(POSES[:3], lambda _, p: flat(p)))
    opened = open_sequence(str(folder))
    assert opened.guess is not None and opened.truth is None
    for name in ("K.txt", "imu.csv", "poses.txt"):
        assert any(str(tmp_path / name) in note for note in opened.notes), name


TIMES_NS = [1_660_000_100_000_000_000 + i * 100_000_000 for i in range(COUNT)]
FORMS = {
    "seconds": lambda i, t: f"{t // 10**9}.{t % 10**9:09d}",
    "nanoseconds": lambda i, t: f"{t}",
    "milliseconds": lambda i, t: f"{t // 10**6}",
    "index, time, exposure": lambda i, t: f"{i:05d} {t // 10**9}.{t % 10**9:09d} 5.0",
    "time and name": lambda i, t: f"{t},a/{i:06d}.png",
    "name and time": lambda i, t: f"{i:06d}.png;{t}",
}


@pytest.mark.parametrize("form", FORMS)
def test_times_of_images_are_read(form: str, tmp_path: Path) -> None:
    rows = [FORMS[form](i, t) for i, t in enumerate(TIMES_NS)]
    (tmp_path / "timestamps.txt").write_text("# header\n" + "\n".join(rows) + "\n")
    times, note = image_times(tmp_path / "timestamps.txt", COUNT, [f"{i:06d}.png" for i in range(COUNT)])
    assert times.tolist() == TIMES_NS and bool(note) == ("10" in rows[0] and "." not in rows[0].replace(".png", ""))


def test_times_beside_images_are_used(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    (folder / "camera.yaml").write_text((folder / "camera.yaml").read_text().replace("rate_hz: 20\n", ""))
    (folder / "timestamps.txt").write_text("\n".join(map(str, TIMES_NS)))
    assert open_sequence(str(folder)).times_ns.tolist() == TIMES_NS
    (folder / "timestamps.txt").write_text("\n".join(map(str, TIMES_NS[:4])))
    with pytest.raises(InputError, match=r"4 times for 6 images"):
        open_sequence(str(folder))


def test_lists_of_tum_may_have_commas_backslashes_and_nanoseconds(tmp_path: Path) -> None:
    folder = make_tum(tmp_path)
    usual = open_sequence(str(folder)).times_ns
    for separator, slash, unit in ((",", "/", 0), (" ", "\\", 0), (" ", "/", 1_700_000_000_000_000_000)):
        rows = [f"{i / 30:.6f}" if not unit else str(unit + int(usual[i])) for i in range(COUNT)]
        text = "".join(f"{time}{separator}rgb{slash}{i}.jpg\n" for i, time in enumerate(rows))
        (folder / "rgb.txt").write_text(text)
        assert (open_sequence(str(folder)).times_ns - unit).tolist() == usual.tolist()


def test_names_may_be_seconds_and_nanoseconds_without_zeros() -> None:
    expected = [1_660_000_100 * 10**9 + i * 33_333_333 for i in range(40)]
    for separator in "._":
        found = named([f"{t // 10**9}{separator}{t % 10**9}.jpg" for t in sorted(expected, key=str)])
        assert found.stamps_ns is not None and found.stamps_ns.tolist() == expected and found.notes
    decimal = [f"{1_660_000_100 + i / 40:.9f}".rstrip("0") + ".jpg" for i in range(1, 39)]
    found = named(decimal)
    assert found.stamps_ns is not None
    assert (abs(np.diff(found.stamps_ns) - 25_000_000) < 500).all(), "decimals stay decimals"


def test_a_pair_may_be_called_otherwise(tmp_path: Path) -> None:
    usual = pair_folder(tmp_path / "a")
    expected = open_sequence(str(usual))
    for side in ("left", "right"):
        (usual / side).rename(usual / side[0].upper())
    found = open_sequence(str(usual))
    assert found.kinds == expected.kinds and found.rig.baseline_m == expected.rig.baseline_m


def test_the_truth_of_a_sequence_may_be_of_any_program(tmp_path: Path) -> None:
    folder = pair_folder(tmp_path)
    write_video(folder / "film.avi", images(COUNT, 0))
    (folder / "sequence.yaml").write_text("left: left\nright: right\ntruth: poses.txt\n")
    (folder / "poses.txt").write_bytes(lines(POSES, lambda _, p: flat(p)))
    truth = open_sequence(str(folder)).truth
    assert truth is not None and len(truth) == COUNT
    (folder / "poses.txt").write_bytes(lines(POSES[:3], lambda _, p: flat(p)))
    with pytest.raises(InputError, match="3 poses without times"):
        open_sequence(str(folder))


def test_a_pair_in_a_bag_is_known_by_its_baseline_or_by_the_file_beside(tmp_path: Path) -> None:
    by_baseline = open_sequence(str(make_bag(tmp_path / "a", "ros1", ("l_cam", "r_cam"))))
    assert by_baseline.rig.baseline_m == pytest.approx(0.5) and any("/l_cam" in note for note in by_baseline.notes)
    path = make_bag(tmp_path / "b", "ros1", ("cam0", "cam1"), info=False)
    camera = "  camera_model: pinhole\n  intrinsics: [80, 80, 47.5, 31.5]\n  distortion_model: radtan\n"
    camera += f"  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [{WIDTH}, {HEIGHT}]\n"
    chain = f"cam0:\n{camera}  rostopic: /cam0/image_raw\ncam1:\n{camera}  rostopic: /cam1/image_raw\n"
    chain += "  T_cn_cnm1: [[1, 0, 0, -0.4], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
    (path.parent / "camchain.yaml").write_text(chain)
    for given in (None, path.parent / "camchain.yaml"):
        opened = open_sequence(str(path), camera=given)
        assert opened.rig.baseline_m == pytest.approx(0.4) and opened.kinds.count("stereo") == 6


def test_tartanair_has_a_pair_and_poses_with_x_ahead(tmp_path: Path) -> None:
    """A camera that moves ahead in its own axes, along a turned x axis of the file's poses."""
    grey = np.random.default_rng(3).integers(0, 256, (480, 640), np.uint8)
    for side in ("left", "right"):
        write_images(tmp_path / f"image_{side}", [grey, grey.T.reshape(480, 640), grey])
    turn = Pose.from_rotvec(np.array([0.2, -0.3, 0.9]), np.zeros(3))
    ahead = [Pose(turn.rotation, turn.rotation @ np.array([0.5 * i, 0, 0])) for i in range(3)]
    (tmp_path / "pose_left.txt").write_bytes(lines(ahead, lambda _, p: [*xyz(p), *xyzw(p)]))
    opened = open_sequence(str(tmp_path))
    assert opened.rig.baseline_m == pytest.approx(0.25) and opened.rig.camera("left").fx == 320
    assert opened.truth is not None
    truth = opened.truth.moved(right=opened.rig.rig_from_left, frame="left")
    moved = [truth.pose(0).inverse() @ truth.pose(i) for i in range(3)]
    np.testing.assert_allclose([pose.translation for pose in moved], [[0, 0, 0.5 * i] for i in range(3)], atol=1e-9)
    (tmp_path / "pose_left.txt").write_text("0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match="1 poses for 3 images"):
        open_sequence(str(tmp_path))


def test_chapters_of_one_film_are_named_with_the_line_that_joins_them(tmp_path: Path) -> None:
    for names in (("GX010042.avi", "GX020042.avi"), ("GOPR0042.avi", "GP010042.avi")):
        folder = tmp_path / names[0][:2]
        for name in reversed(names):
            write_video(folder / name, images(3, 0))
        with pytest.raises(InputError, match="2 chapters") as caught:
            open_sequence(str(folder))
        assert str(caught.value).index(names[0]) < str(caught.value).index(names[1])


def test_poses_in_a_bag_without_images_are_no_recording(tmp_path: Path) -> None:
    path = pose_bag(tmp_path / "a.bag", {"/odom": "nav_msgs/msg/Odometry"})
    with pytest.raises(InputError, match="no image topic"):
        open_sequence(str(path))


def test_positions_in_photos_are_named(tmp_path: Path) -> None:
    from PIL import Image

    exif = Image.Exif()
    exif.get_ifd(0x8825).update({1: "N", 2: (49.0, 0.0, 30.0), 3: "E", 4: (8.0, 24.0, 0.0)})
    for i, image in enumerate(images(COUNT, 0)):
        Image.fromarray(image).save(tmp_path / f"{i:04d}.jpg", exif=exif if i == 0 else Image.Exif())
    assert any("0000.jpg" in note and "EXIF" in note for note in open_sequence(str(tmp_path)).notes)
    Image.fromarray(images(1, 0)[0]).save(tmp_path / "0000.jpg")
    assert not any("EXIF" in note for note in open_sequence(str(tmp_path)).notes)


def test_the_imu_of_a_drone_is_named(tmp_path: Path) -> None:
    folder = make_euroc(tmp_path)
    assert not any("--sensors" in note for note in open_sequence(str(folder)).notes)
    table = (folder if folder.name == "mav0" else folder / "mav0") / "imu0" / "data.csv"
    table.parent.mkdir(exist_ok=True)
    table.write_text("#timestamp [ns]\n")
    assert any("imu0" in note and "--sensors" in note for note in open_sequence(str(folder)).notes)
