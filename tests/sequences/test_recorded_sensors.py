"""Sensors that lie in or beside a recording join its stream without a file: exact poses, noise and values."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.imu import camera_from_imu, imu_noise
from ispom.sequences import open_sequence
from ispom.sequences.recorded_sensors import NONE, RecordedSensor, with_recorded_sensors
from ispom.sequences.sensor_doubts import Readings, readings_of
from ispom.types import Found, Imu, Sequence
from tests import doubles
from tests.sequences import recorded_bag
from tests.sequences.bag_folders import make_bag
from tests.sequences.folders import START_NS, STEP_NS, make_euroc, make_kitti_raw, make_tum
from tests.sequences.own_folders import make_images
from tests.sequences.recorded_bag import write_bag, write_tables
from tests.sequences.recorded_kitti import write_drive

BODY_FROM_IMU = Pose.from_rotvec(np.array([0.3, -0.2, 0.5]), np.array([0.05, -0.02, 0.01]))
CAMERA_FROM_IMU = Pose.from_rotvec(np.array([1.2, 0.1, -0.4]), np.array([-0.03, 0.07, 0.02]))
BODY_FROM_CAMERA = Pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([-0.02, -0.06, 0.01]))
"""Of make_euroc."""
NOISE = "gyroscope_noise_density: 1.7e-4\ngyroscope_random_walk: 1.9e-5\naccelerometer_noise_density: 2.0e-3\n"
NOISE += "accelerometer_random_walk: 3.0e-3\n"
STATED = (1.7e-4, 2.0e-3, 1.9e-5, 3.0e-3)
HEADER = "#timestamp [ns]," + ",".join(f"w_RS_S_{a} [rad s^-1]" for a in "xyz")
HEADER += "," + ",".join(f"a_RS_S_{a} [m s^-2]" for a in "xyz")
SAMPLES = 60
MOUNT = "{translation_m: [1, 2, 3], rotation_xyzw: [0, 0, 0, 1]}"


def noise_of(sequence: Sequence) -> tuple[float, ...]:
    imu = sequence.rig.sensors["imu"]
    assert isinstance(imu, Imu)
    return imu.gyroscope_noise, imu.accelerometer_noise, imu.gyroscope_walk, imu.accelerometer_walk


def row_of(sequence: Sequence, what: str) -> Found:
    (found,) = (each for each in sequence.found if each.what == what)
    return found


def samples(step_ns: int = 5_000_000) -> str:
    rows = [f"{START_NS + k * step_ns},0.01,{0.001 * k:.3f},-0.02,0.1,-9.8,{0.01 * k:.2f}" for k in range(SAMPLES)]
    return "\n".join([HEADER, *rows]) + "\n"


def matrix(pose: Pose) -> str:
    return json.dumps(pose.matrix.ravel().tolist())


def with_imu(folder: Path, sensor: str | None = None) -> Path:
    """EuRoC's imu0, with these contents of its sensor.yaml."""
    imu0 = folder / "mav0" / "imu0"
    imu0.mkdir()
    (imu0 / "data.csv").write_text(samples())
    if sensor is not None:
        (imu0 / "sensor.yaml").write_text(f"%YAML:1.0\nsensor_type: imu\n{sensor}")
    return folder


def euroc_sensor(pose: Pose = BODY_FROM_IMU) -> str:
    return f"T_BS:\n  cols: 4\n  rows: 4\n  data: {matrix(pose)}\nrate_hz: 200\n{NOISE}"


@pytest.mark.parametrize("right", [True, False])
def test_the_imu_of_a_drone_has_its_pose_its_noise_and_its_samples(right: bool, tmp_path: Path) -> None:
    sequence = open_sequence(str(with_imu(make_euroc(tmp_path, right=right), euroc_sensor())))
    camera_from_rig = Pose(translation=np.array([0.055 * right, 0, 0]))  # the rig is in the middle of the baseline
    expected = (BODY_FROM_CAMERA @ camera_from_rig).inverse() @ BODY_FROM_IMU
    np.testing.assert_allclose(sequence.rig.rig_from("imu").matrix, expected.matrix, atol=1e-9)
    assert noise_of(sequence) == STATED
    readings = readings_of(sequence)["imu"]
    inside = START_NS + 5_000_000 * np.arange(51)  # up to the last image
    assert readings.times_ns.tolist() == inside.tolist()
    np.testing.assert_allclose(readings.values["rates"][:, 1], 0.001 * np.arange(51))
    np.testing.assert_allclose(readings.values["forces"][:, 1], -9.8)
    row = row_of(sequence, "imu")
    assert row.used and row.where.endswith("imu0/data.csv") and "sensor.yaml" in row.why


def test_without_its_pose_an_imu_is_named_with_the_entry_that_makes_it_usable(tmp_path: Path) -> None:
    folder = with_imu(make_euroc(tmp_path), NOISE)
    sequence = open_sequence(str(folder))
    row = row_of(sequence, "imu")
    assert not row.used and "imu" not in sequence.kinds and row.note in sequence.notes
    assert "T_BS" in row.why and "rig_from_imu: {translation_m" in row.why and "--sensors" in row.why
    (tmp_path / "sensors.yaml").write_text(f"imu: {{rig_from_imu: {MOUNT}}}")
    completed = open_sequence(str(folder), sensors=tmp_path / "sensors.yaml")
    assert completed.rig.rig_from("imu").translation.tolist() == [1, 2, 3]
    assert noise_of(completed) == STATED and completed.kinds.count("imu") == 6


def test_a_file_overrides_what_lies_there(tmp_path: Path) -> None:
    folder = with_imu(make_euroc(tmp_path), euroc_sensor())
    (tmp_path / "noise.yaml").write_text("imu: {gyroscope_noise: 0.5, clock_offset_s: 0.005}")
    own, changed = open_sequence(str(folder)), open_sequence(str(folder), sensors=tmp_path / "noise.yaml")
    assert noise_of(changed) == (0.5, *STATED[1:])
    np.testing.assert_array_equal(changed.rig.rig_from("imu").matrix, own.rig.rig_from("imu").matrix)
    first = [readings_of(each)["imu"].times_ns[0] for each in (changed, own)]
    assert first[0] - first[1] == 5_000_000
    (tmp_path / "other.yaml").write_text(f"gnss: {{file: gnss.csv, rig_from_gnss: {MOUNT}}}")
    rows = "\n".join(f"{START_NS + k * STEP_NS},{k},0,0,0.5" for k in range(5))
    (tmp_path / "gnss.csv").write_text(f"time_ns,x,y,z,sigma\n{rows}\n")
    other = open_sequence(str(folder), sensors=tmp_path / "other.yaml")
    assert "imu" not in other.kinds and other.kinds.count("gnss") == 5
    assert row_of(other, "gnss").used and not row_of(other, "imu").used


@pytest.mark.parametrize("choice", ["none", NONE, None])
def test_they_can_be_left_out(choice: str | Path | None, tmp_path: Path) -> None:
    sequence = open_sequence(str(with_imu(make_euroc(tmp_path), euroc_sensor())), sensors=choice)
    assert set(sequence.kinds) == {"video", "stereo"} and "imu" not in sequence.rig.sensors
    assert not row_of(sequence, "imu").used and "--sensors" in row_of(sequence, "imu").why


def test_images_and_their_times_are_the_same_with_and_without(tmp_path: Path) -> None:
    folder = str(with_imu(make_euroc(tmp_path), euroc_sensor()))
    with_it, without = open_sequence(folder, max_exposures=5), open_sequence(folder, max_exposures=5, sensors=None)
    frames = [i for i, kind in enumerate(with_it.kinds) if kind != "imu"]
    assert len(frames) == len(without) == 5
    assert with_it.times_ns[frames].tolist() == without.times_ns.tolist()
    for i, k in zip(frames, range(5), strict=True):
        assert with_it[i].kind == without[k].kind
    assert with_it.truth is not None and without.truth is not None
    assert with_it.truth.times_ns.tolist() == without.truth.times_ns.tolist()


def test_tum_vi_has_pose_and_noise_in_dso(tmp_path: Path) -> None:
    folder = with_imu(make_euroc(tmp_path))
    (folder / "dso").mkdir()
    (folder / "dso" / "imu_config.yaml").write_text(f"{NOISE}rostopic: /imu0\nupdate_rate: 200\n")
    rows = CAMERA_FROM_IMU.matrix.tolist()
    (folder / "dso" / "camchain.yaml").write_text(f"cam0:\n  T_cam_imu: {rows}\n  timeshift_cam_imu: -0.005\n")
    sequence = open_sequence(str(folder))
    left_from_imu = sequence.rig.rig_from_left.inverse() @ sequence.rig.rig_from("imu")
    np.testing.assert_allclose(left_from_imu.matrix, CAMERA_FROM_IMU.matrix, atol=1e-6)
    assert noise_of(sequence) == STATED
    assert readings_of(sequence)["imu"].times_ns[0] == START_NS + 5_000_000  # t_imu = t_cam + shift
    assert "timeshift_cam_imu" in row_of(sequence, "imu").why


def test_images_have_an_imu_by_files_of_kalibr(tmp_path: Path) -> None:
    source = make_tum(tmp_path / "drive")
    rows = "".join(f"{k / 200:.3f} 0 {0.1 * (k % 2)} 0.2 0 -9.8 0.1\n" for k in range(40))
    (source / "imu.csv").write_text(f"time_s gx gy gz ax ay az\n{rows}")
    named = open_sequence(str(source))
    assert not row_of(named, "imu").used and "T_cam_imu" in row_of(named, "imu").why
    (source / "kalibr_imucam_chain.yaml").write_text(
        f"cam0:\n  T_imu_cam: {CAMERA_FROM_IMU.inverse().matrix.tolist()}\n"
    )
    usual = open_sequence(str(source))
    assert noise_of(usual) == noise_of_usual() and "usual" in row_of(usual, "imu").why
    (source / "kalibr_imu_chain.yaml").write_text("imu0:\n" + "".join(f"  {line}\n" for line in NOISE.splitlines()))
    sequence = open_sequence(str(source))
    np.testing.assert_allclose(sequence.rig.rig_from("imu").matrix, CAMERA_FROM_IMU.matrix, atol=1e-6)
    assert noise_of(sequence) == STATED and len(readings_of(sequence)["imu"]) == 34


def noise_of_usual() -> tuple[float, ...]:
    usual = Imu()
    return usual.gyroscope_noise, usual.accelerometer_noise, usual.gyroscope_walk, usual.accelerometer_walk


def test_fixes_beside_images_are_named(tmp_path: Path) -> None:
    source = make_images(tmp_path / "drive")
    (source / "gps.csv").write_text("time_s,lat,lon,height,sigma\n0,49,8.4,100,1\n0.1,49,8.4001,100,1\n")
    sequence = open_sequence(str(source))
    row = row_of(sequence, "gnss")
    assert not row.used and "rig_from_gnss" in row.why
    (tmp_path / "sensors.yaml").write_text(f"gnss: {{rig_from_gnss: {MOUNT}, sigma_m: 2}}")
    pytest.importorskip("pymap3d", reason="the extra `fusion` is not installed")
    completed = open_sequence(str(source), sensors=tmp_path / "sensors.yaml")
    assert completed.kinds.count("gnss") == 2
    assert readings_of(completed)["gnss"].values["sigma"].tolist() == [[2.0] * 3] * 2


def test_values_that_no_method_can_use_are_not_used(tmp_path: Path) -> None:
    folder = with_imu(make_euroc(tmp_path), euroc_sensor())
    path = folder / "mav0" / "imu0" / "data.csv"
    path.write_text(path.read_text().replace(",-9.8,", ",-1.0,"))  # in units of g
    row = row_of(open_sequence(str(folder)), "imu")
    assert not row.used and "units of g" in row.why
    path.write_text(samples().replace("140371527", "140371529"))  # of another time
    row = row_of(open_sequence(str(folder)), "imu")
    assert not row.used and "nothing within" in row.why
    path.write_text("#timestamp [ns]\n")
    row = row_of(open_sequence(str(folder)), "imu")
    assert not row.used and str(path) in row.why


def test_one_of_each_kind_is_used_and_the_other_is_named() -> None:
    plain = doubles.sequence()
    times_ns = plain.times_ns[0] + 10_000_000 * np.arange(50)
    calls: list[str] = []

    def own(name: str, unit: float) -> RecordedSensor:
        def read() -> Readings:
            calls.append(name)
            forces = np.tile([0.0, -9.81 * unit, 0.1], (50, 1))
            return Readings("imu", times_ns, {"rates": np.full((50, 3), 0.01), "forces": forces})

        return RecordedSensor(name, f"/{name}", Imu(rig_from_sensor=CAMERA_FROM_IMU), read, "said")

    found = with_recorded_sensors(plain, (own("imu", 1 / 9.81), own("imu_2", 1), own("imu_3", 1)))
    assert [each.used for each in found.found] == [False, True, False]
    assert "units of g" in found.found[0].why and found.found[1].why == "said"
    assert "/imu_2" in found.found[2].why and "`imu_3: {sensor: imu}`" in found.found[2].why
    assert set(found.rig.sensors) - set(plain.rig.sensors) == {"imu_2"} and calls == ["imu", "imu_2"]


# KITTI raw.


def oxts(frame: int) -> str:
    """A car that drives east, 1 m per image, and turns to the left by 0.1 rad/s."""
    east_deg = np.degrees(frame / 6_378_137.0)
    values = [0.0] * 30
    values[1], values[2], values[23] = 8 + east_deg, 100.0, 0.5
    values[11:14], values[17:20] = [0.2, 0.0, 9.81], [0.0, 0.0, 0.1]
    return " ".join(repr(float(v)) for v in values) + "\n"


def kitti_drive(root: Path, frames: int = 6) -> Path:
    drive = make_kitti_raw(root, frames)
    for frame in range(frames):
        (drive / "oxts" / "data" / f"{frame:010d}.txt").write_text(oxts(frame))
    return drive


def test_the_unit_of_kitti_is_an_imu_and_a_receiver(tmp_path: Path) -> None:
    pytest.importorskip("pymap3d", reason="the extra `fusion` is not installed")
    sequence = open_sequence(str(kitti_drive(tmp_path)))
    # The unit is 0.5 m ahead of the laser's axes' origin reversed, 0.8 m below it: velo_from_imu T = -0.5 0 -0.8.
    velo_from_imu = Pose(translation=np.array([-0.5, 0, -0.8]))
    camera_from_velo = Pose(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0, -0.1, -0.3]))
    shift = Pose(translation=np.array([2 / 80, 0, 0]))  # P_rect_00's fourth column, in metres
    expected = sequence.rig.rig_from_left @ shift @ camera_from_velo @ velo_from_imu
    for name in ("imu", "gnss"):
        np.testing.assert_allclose(sequence.rig.rig_from(name).matrix, expected.matrix, atol=1e-9)
        assert row_of(sequence, name).used
    readings = readings_of(sequence)
    np.testing.assert_allclose(readings["imu"].values["rates"], [[0, 0, 0.1]] * 6)
    np.testing.assert_allclose(readings["imu"].values["forces"], [[0.2, 0, 9.81]] * 6)
    np.testing.assert_allclose(readings["gnss"].values["xyz"][:, 0], np.arange(6), atol=1e-3)
    np.testing.assert_allclose(readings["gnss"].values["sigma"], 0.5)
    assert any("not meaningful" in note for note in sequence.notes)


def test_without_what_takes_latitudes_fixes_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ispom.sensors.gnss.find_spec", lambda name: None)
    sequence = open_sequence(str(kitti_drive(tmp_path)))
    assert row_of(sequence, "imu").used and not row_of(sequence, "gnss").used
    assert "ispom[fusion]" in row_of(sequence, "gnss").why


def test_without_the_calibration_of_the_unit_it_is_named(tmp_path: Path) -> None:
    drive = kitti_drive(tmp_path)
    (drive.parent / "calib_velo_to_cam.txt").unlink()
    sequence = open_sequence(str(drive))
    assert set(sequence.kinds) == {"video", "stereo"}
    for name in ("imu", "gnss"):
        assert not row_of(sequence, name).used and "calib_velo_to_cam.txt" in row_of(sequence, name).why


# Bags.


@pytest.fixture(scope="module")
def simulated() -> Sequence:
    return open_sequence("sim:tiny?motion=drive&sensor=imu&sensor=gnss&sensor=wheel")


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_a_bag_has_its_sensors_where_tf_static_puts_them(kind: str, simulated: Sequence, tmp_path: Path) -> None:
    path = write_bag(tmp_path / ("drive.bag" if kind == "ros1" else "drive"), simulated, kind=kind, extra=True)
    sequence = open_sequence(str(path))
    own, theirs = readings_of(sequence), readings_of(simulated)
    for name in ("imu", "gnss", "wheel"):
        assert row_of(sequence, name).used
        poses = [each.rig.rig_from_left.inverse() @ each.rig.rig_from(name) for each in (sequence, simulated)]
        np.testing.assert_allclose(poses[0].matrix, poses[1].matrix, atol=1e-9)
    last = int(sequence.times_ns[np.array(sequence.kinds) == "stereo"][-1]) - recorded_bag.START_NS
    inside = theirs["imu"].times_ns <= last
    assert (own["imu"].times_ns - recorded_bag.START_NS).tolist() == theirs["imu"].times_ns[inside].tolist()
    for value in ("rates", "forces"):
        np.testing.assert_array_equal(own["imu"].values[value], theirs["imu"].values[value][inside])
    count = len(own["gnss"])
    steps = [np.diff(each["gnss"].values["xyz"][:count], axis=0) for each in (own, theirs)]
    np.testing.assert_allclose(steps[0], steps[1], atol=1e-4)  # from the first fix
    np.testing.assert_allclose(own["gnss"].values["sigma"], theirs["gnss"].values["sigma"][:count], rtol=1e-9)
    count = len(own["wheel"])
    for value in ("distances", "turns"):
        np.testing.assert_allclose(own["wheel"].values[value], theirs["wheel"].values[value][:count], atol=1e-9)
    not_used = {each.where.rpartition(":")[2]: each for each in sequence.found if not each.used}
    assert set(not_used) == {"/scan", "/warm"} and not_used["/scan"].what == "laser"


def test_without_tf_static_a_bag_says_what_is_missing(simulated: Sequence, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive", simulated, tf=False)
    sequence = open_sequence(str(path))
    assert set(sequence.kinds) == {"video", "stereo"}
    for name in ("imu", "gnss", "wheel"):
        why = row_of(sequence, name).why
        assert "tf_static" in why and f"rig_from_{name}" in why
    (tmp_path / "camchain.yaml").write_text(f"cam0: {{T_cam_imu: {CAMERA_FROM_IMU.matrix.tolist()}}}")
    (tmp_path / "imu.yaml").write_text(NOISE)
    chained = open_sequence(str(path))
    left_from_imu = chained.rig.rig_from_left.inverse() @ chained.rig.rig_from("imu")
    np.testing.assert_allclose(left_from_imu.matrix, CAMERA_FROM_IMU.matrix, atol=1e-6)
    assert noise_of(chained) == STATED


def test_a_bag_with_a_camchain_of_all_has_the_imu_in_the_rectified_camera(simulated: Sequence, tmp_path: Path) -> None:
    """The right camera is turned by two degrees, so that rectification turns the left one."""
    path, lens = write_bag(tmp_path / "drive", simulated, tf=False, info=False), simulated.rig.camera("left")
    right_from_left = Pose.from_rotvec(np.array([0.01, 0.035, -0.005]), np.array([-0.4, 0.01, 0.02]))
    chain = {
        f"cam{k}": {
            "camera_model": "pinhole",
            "intrinsics": [lens.fx, lens.fy, lens.cx, lens.cy],
            "distortion_model": "radtan",
            "distortion_coeffs": [0.0] * 4,
            "resolution": [lens.width, lens.height],
            "rostopic": f"/{side}/image_raw",
            "T_cam_imu": (each @ CAMERA_FROM_IMU).matrix.tolist(),
            **({"T_cn_cnm1": right_from_left.matrix.tolist()} if k else {}),
        }
        for k, (side, each) in enumerate((("left", Pose()), ("right", right_from_left)))
    }
    (tmp_path / "camchain.yaml").write_text(json.dumps(chain))
    sequence = open_sequence(str(path))
    none, k = np.zeros(5), lens.matrix
    turn = cv2.stereoRectify(
        k,
        none,
        k,
        none,
        (lens.width, lens.height),
        right_from_left.rotation,
        right_from_left.translation[:, None],
        alpha=0,
    )[0]
    left_from_imu = sequence.rig.rig_from_left.inverse() @ sequence.rig.rig_from("imu")
    np.testing.assert_allclose(
        left_from_imu.matrix, (Pose(np.asarray(turn, float)) @ CAMERA_FROM_IMU).matrix, atol=1e-5
    )
    assert abs(turn - np.eye(3)).max() > 0.01


def test_images_in_the_frame_of_a_body_say_nothing_of_the_cameras_axes(simulated: Sequence, tmp_path: Path) -> None:
    sequence = open_sequence(str(write_bag(tmp_path / "drive", simulated, optical="link")))
    assert set(sequence.kinds) == {"video", "stereo"}
    for name in ("imu", "gnss", "wheel"):
        assert "left_link" in row_of(sequence, name).why and f"rig_from_{name}" in row_of(sequence, name).why


@pytest.mark.parametrize(
    ("topic", "used"),
    [
        ("/odom", True),
        ("/husky_velocity_controller/odom", True),
        ("/wheel_encoders", True),
        ("/robot/pose", False),
        ("/zed/odom", False),
        ("/ground_truth/odom", False),
        ("/odometry/filtered", False),
    ],
)
def test_odometry_is_of_wheels_where_it_says_so(topic: str, used: bool, simulated: Sequence, tmp_path: Path) -> None:
    sequence = open_sequence(str(write_bag(tmp_path / "drive", simulated, topics={"wheel": topic})))
    row = row_of(sequence, "wheel")
    assert row.used == used
    if not used:
        assert "`wheel: {}`" in row.why
        (tmp_path / "sensors.yaml").write_text("wheel: {}")
        named = open_sequence(str(tmp_path / "drive"), sensors=tmp_path / "sensors.yaml")
        assert "wheel" in named.kinds and "imu" not in named.kinds


def test_a_bag_of_a_camera_alone_still_opens(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_bag(tmp_path, "sqlite3", ("camera",))))
    assert sequence.kinds == ("video",) * 6 and all(each.used for each in sequence.found)


def ran(source: Path, sensors: str, out: Path) -> dict[str, str]:
    """What `ispom run` writes: the trajectories."""
    pytest.importorskip("gtsam", reason="the extra `fusion` is not installed")
    methods = ["--methods", "stereo", "fused.stereo", "--fused.stereo.scheme", "6"]
    assert main(["run", str(source), *methods, "--sensors", sensors, "--no-recording", "--out", str(out)]) == 0
    return {name: (out / f"{name}.tum").read_text() for name in ("stereo", "fused.stereo")}


def assert_same(one: dict[str, str], other: dict[str, str]) -> None:
    """Poses of sensors differ by the rounding of quaternions."""
    assert one["stereo"] == other["stereo"]
    tracks = [np.array([line.split() for line in each["fused.stereo"].splitlines()], float) for each in (one, other)]
    assert len(tracks[0]) >= 5 and tracks[0].shape == tracks[1].shape
    np.testing.assert_allclose(tracks[0], tracks[1], atol=1e-5)


def test_a_bag_by_itself_gives_what_it_gives_by_a_file(simulated: Sequence, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive", simulated)
    tables = write_tables(tmp_path, simulated, open_sequence(str(path)))
    assert_same(ran(path, "auto", tmp_path / "one"), ran(path, str(tables), tmp_path / "two"))


def test_a_drive_of_kitti_by_itself_gives_what_it_gives_by_a_file(simulated: Sequence, tmp_path: Path) -> None:
    drive = write_drive(tmp_path, simulated)
    opened = open_sequence(str(drive))
    assert opened.truth is not None and simulated.truth is not None
    for name in ("imu", "gnss"):
        np.testing.assert_allclose(opened.rig.rig_from(name).matrix, simulated.rig.rig_from("imu").matrix, atol=1e-9)
    pairs = simulated.times_ns[np.array(simulated.kinds) == "stereo"].tolist()
    ways = [np.linalg.norm(np.ptp(opened.truth.translations[[0, -1]], axis=0))]
    there = [simulated.truth.at(t) for t in (pairs[0], pairs[-1])]
    ways += [np.linalg.norm(there[1].translation - there[0].translation)]  # type: ignore[union-attr]
    assert ways[0] == pytest.approx(ways[1], rel=5e-3)  # KITTI measures on a sphere
    pose = simulated.rig.rig_from("imu")
    where = f"{{translation_m: {pose.translation.tolist()}, rotation_xyzw: {pose.xyzw.tolist()}}}"
    lines = [f"{name}: {{file: {drive / 'oxts'}, rig_from_{name}: {where}}}\n" for name in ("imu", "gnss")]
    (tmp_path / "sensors.yaml").write_text("".join(lines))
    assert_same(ran(drive, "auto", tmp_path / "one"), ran(drive, str(tmp_path / "sensors.yaml"), tmp_path / "two"))


# Files.


def test_noise_and_poses_that_are_wrong_are_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "imu.yaml").write_text("gyroscope_noise_density: -1\n")
    with pytest.raises(InputError, match="gyroscope_noise_density"):
        imu_noise(tmp_path / "imu.yaml")
    (tmp_path / "camchain.yaml").write_text(
        "cam0: {T_cam_imu: [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}"
    )
    with pytest.raises(InputError, match="T_cam_imu"):
        camera_from_imu(tmp_path / "camchain.yaml")
    (tmp_path / "camchain.yaml").write_text("cam0: {camera_model: pinhole}")
    assert camera_from_imu(tmp_path / "camchain.yaml") is None


def test_sources_prints_what_is_used_and_what_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = with_imu(make_euroc(tmp_path), euroc_sensor())
    (folder / "mav0" / "leica0").mkdir()
    (folder / "mav0" / "leica0" / "data.csv").write_text("#timestamp\n")
    assert main(["sources", str(folder)]) == 0
    lines = [line.removeprefix("  found").strip() for line in capsys.readouterr().out.splitlines()]
    rows = [line.split() for line in lines if line.startswith(("used ", "not used "))]
    held = [row[1] for row in rows if row[0] == "used"]
    assert held == ["lens", "lens", "times", "times", "truth", "imu"]
    assert next(row for row in rows if row[0] == "not")[3].endswith("leica0")
    assert sum("leica0" in line for line in lines) == 1
