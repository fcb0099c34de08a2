"""Numbers that are finite but impossible, and names with another meaning, are one sentence, never a traceback."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.io.poses.recognised import read_trajectory
from ispom.io.rig import read_rig, rig_text
from ispom.io.timed_points import read_timed_points
from ispom.io.values import LARGEST, NAME, RESERVED, is_sensor_name, number
from ispom.plausibility.cameras import camera_doubts
from ispom.plausibility.gnss import geodetic_doubts, gnss_doubts, mirrored_doubts
from ispom.plausibility.imu import imu_doubts
from ispom.plausibility.mounts import far_doubts, order_doubts
from ispom.plausibility.times import time_doubts
from ispom.plausibility.wheel import still_doubts, wheel_doubts
from ispom.sensors import SENSOR_KINDS
from ispom.sequences import open_sequence
from ispom.sequences.formats.feature_table import open_feature_table
from ispom.sequences.sensor_doubts import file_kinds
from ispom.sequences.sensors_yaml import with_sensors
from ispom.types import Camera, Imu
from tests import doubles
from tests.io.test_nmea import sentence
from tests.sequences.folders import make_euroc, make_vslam_lab

POSE = {"translation_m": [0, 0, 0], "rotation_xyzw": [0, 0, 0, 1]}
FIXES = "time_s,x,y,z\n0,0,0,0\n0.2,1,0,0\n0.4,2,0,0\n"
PLACES = "time_s,lat,lon,height\n0,49,8,0\n0.2,49,8.00001,0\n"
WHEELS = "time_s,distance,turn\n0,1,0\n0.2,1,0\n0.4,1,0\n"
IMPOSSIBLE = (1e300, -1e300, 1e308, -1e308, 1e15, 1e-320, -1e-320, 5e-324, 1e16, 0.0, -1.0)
NOISES = ("gyroscope_noise", "accelerometer_walk")
ENTRIES = ("clock_offset_s", "sigma_m", "origin", *NOISES, "distance_noise", "x", "pose")


def described(folder: Path, name: str, table: str, entry: dict) -> Path:
    (folder / "table.csv").write_text(table)
    path = folder / "sensors.yaml"
    path.write_text(yaml.safe_dump({name: {f"rig_from_{name}": POSE, "file": "table.csv", **entry}}))
    return path


@pytest.mark.parametrize(
    ("entry", "value"),
    [("clock_offset_s", 1e300), ("clock_offset_s", -1e15), ("sigma_m", 1e-320), ("sigma_m", 1e300), ("sigma_m", 0.0)],
)
def test_an_impossible_number_is_one_sentence(entry: str, value: float, tmp_path: Path) -> None:
    path = described(tmp_path, "gnss", FIXES, {"sigma_m": 1.0, entry: value})
    with pytest.raises(InputError, match=entry):
        with_sensors(doubles.sequence(), path)


@pytest.mark.parametrize("sigma", ["1e-320", "1e300", "0", "-1"])
def test_an_impossible_deviation_of_a_table_is_one_sentence(sigma: str, tmp_path: Path) -> None:
    table = "time_s,x,y,z,sigma\n" + "".join(f"{k / 5},0,0,0,{sigma}\n" for k in range(3))
    with pytest.raises(InputError, match=r"table\.csv"):
        with_sensors(doubles.sequence(), described(tmp_path, "gnss", table, {}))


def test_a_dilution_that_no_receiver_has_is_one_sentence(tmp_path: Path) -> None:
    good = sentence("000000.00", 49.0, 8.4, 100, 4)
    words = good.strip()[1:].split("*")[0].split(",")
    for value in ("1e308", "1e300", "-1", "nan"):
        words[8] = value
        (tmp_path / "a.nmea").write_text(f"${','.join(words)}\n")
        with pytest.raises(InputError, match="HDOP"):
            with_sensors(doubles.sequence(), described(tmp_path, "gnss", "", {"file": "a.nmea"}))


BAD_NAMES = ["self", "pair_sigma", "left", "right", "rig", "video", "world", "body", "board", "truth", "video_sigma",
             "rig_from_imu", "a_sigma", "IMU", "imu 2", "ä", "", "x" * 40, "laser", "gnss", "wheel"]  # fmt: skip


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_name_with_another_meaning_is_one_sentence(name: str, tmp_path: Path) -> None:
    path = described(tmp_path, name, "time_s,gx,gy,gz,ax,ay,az\n0,0,0,0,0,0,9.8\n", {"sensor": "imu"})
    with pytest.raises(InputError, match=r"sensors\.yaml"):
        with_sensors(doubles.sequence(), path)
    (tmp_path / "rig.yaml").write_text(
        yaml.safe_dump({**yaml.safe_load(rig_text(doubles.rig())), name: {"sensor": "imu", f"rig_from_{name}": POSE}})
    )
    with pytest.raises(InputError, match=r"rig\.yaml"):
        read_rig(tmp_path / "rig.yaml")


@given(st.from_regex(NAME, fullmatch=True) | st.sampled_from(BAD_NAMES))
def test_a_name_that_is_taken_can_be_written_and_read(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    if not is_sensor_name(name) or name in ("laser", "gnss", "wheel"):
        return
    path = tmp_path_factory.mktemp("rig") / "rig.yaml"
    path.write_text(rig_text(doubles.rig().changed(**{name: Imu()})))
    assert isinstance(read_rig(path).sensors[name], Imu) and name not in RESERVED


def test_a_sensor_of_the_source_is_not_replaced(tmp_path: Path) -> None:
    table = "time_s,gx,gy,gz,ax,ay,az\n0,0,0,0,0,0,9.8\n0.1,0,0,0,0,0,9.8\n"
    path = described(tmp_path, "imu", table, {})
    once = with_sensors(doubles.sequence(), path)
    with pytest.raises(InputError, match="already"):
        with_sensors(once, path)


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(ENTRIES), st.sampled_from(IMPOSSIBLE) | st.floats(allow_nan=True), st.booleans())
def test_any_number_is_taken_or_refused(
    tmp_path_factory: pytest.TempPathFactory, entry: str, value: float, geodetic: bool
) -> None:
    given_value = [value, value, value] if entry == "origin" else value
    own = {"sigma_m": 1.0, entry: given_value}
    name, table = "gnss", PLACES if geodetic else FIXES
    if entry in NOISES:
        name, table, own = "imu", "time_s,gx,gy,gz,ax,ay,az\n0,0,0,0,0,0,9.8\n", {entry: value}
    if entry == "distance_noise":
        name, table, own = "wheel", WHEELS, {entry: value}
    if entry == "x":
        own, table = {"sigma_m": 1.0}, FIXES + f"0.5,{value!r},0,0\n"
    if entry == "pose":
        own = {"sigma_m": 1.0, "rig_from_gnss": {**POSE, "translation_m": [value, 0.0, value]}}
    path = described(tmp_path_factory.mktemp("bounds"), name, table, own)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = with_sensors(doubles.sequence(), path)
        except InputError as fault:
            assert "\n" not in str(fault)
            return
        for i in range(len(found)):
            found.load(i)
        read_back = path.with_name("rig.yaml")
        read_back.write_text(rig_text(found.rig))
        read_rig(read_back)


@given(st.floats(allow_nan=True) | st.text(max_size=30) | st.booleans() | st.none() | st.integers())
def test_a_number_is_finite_and_within_its_bounds(value: object) -> None:
    try:
        found = number("here", value, -5.0, 1e6)
    except InputError as fault:
        assert str(fault).startswith("here")
    else:
        assert -5 <= found <= 1e6


EXTREME = st.floats(-LARGEST, LARGEST) | st.sampled_from([0.0, 5e-324, -5e-324, LARGEST, -LARGEST])


@settings(deadline=None, max_examples=60)
@given(
    arrays(float, (16, 3), elements=EXTREME),
    arrays(float, (16, 3), elements=EXTREME),
    st.lists(st.integers(1, 10**18), min_size=16, max_size=16),
)
def test_no_values_are_too_much_for_the_doubts(a: np.ndarray, b: np.ndarray, steps: list[int]) -> None:
    """Times within 64 bits: their sum is below 2^63."""
    times_ns = np.cumsum([min(step, 10**17) for step in steps])
    sigma = np.abs(b) + 1e-12
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        imu_doubts("x", times_ns, a, b)
        gnss_doubts("x", times_ns, a, sigma)
        geodetic_doubts("x", a)
        wheel_doubts("x", times_ns, a[1:, 0], b[1:, 0])
        still_doubts("x", 0 * a[:, 0], a, sigma)
        mirrored_doubts("x", times_ns, a, sigma, (times_ns, a, b))
        for kind in file_kinds():
            time_doubts("x", SENSOR_KINDS.get(kind).rates, times_ns, times_ns[:2] + 5)
        pose = doubles.pose_at(0)
        far_doubts("x", "imu", pose)
        order_doubts("x", "imu", pose)


@settings(deadline=None, max_examples=80)
@given(
    st.lists(st.floats(-1e4, 1e4), min_size=8, max_size=8).filter(lambda v: len(v) == 8),
    st.sampled_from([4, 5, 8]),
    st.floats(0.01, 1000),
    st.floats(-9, 9),
)
def test_no_camera_is_too_much_for_the_doubts(values: list[float], count: int, focal: float, off: float) -> None:
    camera = Camera(64, 48, 64 * focal, 64 * focal, 32 + 64 * off, 24 - 64 * off, tuple(values[:count]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        camera_doubts(camera, "x")


META = {"camera_fx": 450.0, "camera_fy": 450.0, "camera_cx": 320.0, "camera_cy": 240.0, "T_ci_tx": 0.0, "T_ci_ty": 0.0,
        "T_ci_tz": 0.0, "T_ci_qx": 0.0, "T_ci_qy": 0.0, "T_ci_qz": 0.0, "T_ci_qw": 1.0,
        "eqf.input_var_gyr": 1e-6}  # fmt: skip


def feature_table(folder: Path, meta: dict, u: float = 0.1, more: str = "") -> Path:
    lines = ["row_type,t_abs,landmark_id,gx,gy,gz,ax,ay,az,u_norm,v_norm,key,value"]
    lines += [f"meta,,,,,,,,,,,{key},{value!r}" for key, value in (META | meta).items()]
    for k in range(6):
        lines += [f"imu,{k / 10},,0,0,0.01,0,0,9.81,,,,", f"vision_feature,{k / 10},{k},,,,,,,{u},{u / 2},,"]
    (folder / "imu_and_features.csv").write_text("\n".join([*lines, more]))
    return folder


def test_a_healthy_table_of_features_is_opened(tmp_path: Path) -> None:
    assert len(open_feature_table(feature_table(tmp_path, {}))) == 12


@pytest.mark.parametrize(
    ("meta", "u", "more", "why"),
    [
        ({}, 376.0, "", "not pixels"),
        ({}, 1e14, "", "not pixels"),
        ({}, 0.1, "x" * 131_073, "line"),
        ({}, 0.1, "meta" + "," * 11 + "key," + "1" * 140_000, "line"),
        ({"eqf.input_var_gyr": -1e-6}, 0.1, "", "line"),
        ({"eqf.input_var_gyr": 1e-320}, 0.1, "", "line"),
        ({"eqf.input_var_gyr": 1e14}, 0.1, "", "line"),
        ({"camera_fx": 1e-300}, 0.1, "", "fx"),
        ({"camera_fx": 1e14}, 0.1, "", "u_norm"),
    ],
    ids=["pixels", "far", "long field", "long number", "negative", "tiny", "huge", "fx tiny", "fx huge"],
)
def test_a_wrong_table_of_features_is_one_sentence(meta: dict, u: float, more: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=why):
        open_feature_table(feature_table(tmp_path, meta, u, more))


@pytest.mark.parametrize(
    ("name", "entry"), [("left", {}), ("gnss", {"clock_offset_s": 1e300}), ("gnss", {"sigma_m": 1e-320})]
)
def test_the_command_says_so_and_ends_with_2(
    name: str, entry: dict, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = described(tmp_path, name, FIXES, {"sensor": "gnss", "sigma_m": 1.0, **entry})
    assert main(["sources", str(make_euroc(tmp_path)), "--sensors", str(path)]) == 2
    printed = capsys.readouterr().err.strip()
    assert "\n" not in printed and "sensors.yaml" in printed


def test_the_times_of_a_sensor_stay_within_64_bits(tmp_path: Path) -> None:
    table = FIXES.replace("0.4", "4500000000")
    with pytest.raises(InputError, match="clock_offset_s"):
        with_sensors(doubles.sequence(), described(tmp_path, "gnss", table, {"sigma_m": 1, "clock_offset_s": 4.5e9}))


POSES = "timestamp,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n1,{},0,0,0,0,0,1\n"
READERS = {
    "TUM's time": (read_trajectory, "0 0 0 0 0 0 0 1\n{} 0 0 0 0 0 0 1\n"),
    "TUM's position": (read_trajectory, "0 0 0 0 0 0 0 1\n1 0 {} 0 0 0 0 1\n"),
    "TUM's rotation": (read_trajectory, "0 0 0 0 0 0 0 1\n1 0 0 0 {} 0 0 1\n"),
    "KITTI's position": (read_trajectory, "1 0 0 {} 0 1 0 0 0 0 1 0\n"),
    "KITTI's rotation": (read_trajectory, "1 0 0 0 0 {} 0 0 0 0 1 0\n"),
    "EuRoC's time": (read_trajectory, "1,0,0,0,1,0,0,0\n{},0,0,0,1,0,0,0\n"),
    "a table's position": (read_trajectory, POSES),
    **{
        f"a table's {name}": (read_trajectory, POSES.replace("timestamp", name).replace("1,{}", "{},0"))
        for name in ("timestamp", "time_ns", "time [ms]", "time [us]")
    },
    "a table's seconds": (read_trajectory, "sec,nsec,x,y,z,qx,qy,qz,qw\n{},0,0,0,0,0,0,0,1\n"),
    "a table's nanoseconds": (read_trajectory, "sec,nsec,x,y,z,qx,qy,qz,qw\n0,{},0,0,0,0,0,0,1\n"),
    "a point's seconds": (read_timed_points, "time_s,x,y,z\n{},0,0,0\n"),
    "a point's nanoseconds": (read_timed_points, "time_ns,x,y,z\n{},0,0,0\n"),
    "a point's place": (read_timed_points, "time_ns,x,y,z\n0,0,{},0\n"),
}
"""What reads a file, and its content with a place for a number."""
WORDS = ("1e300", "-1e300", "1e308", "nan", "inf", "-inf", "1e400", "9" * 400, "-" + "9" * 400, "9" * 5000)


@pytest.mark.parametrize("word", WORDS, ids=lambda word: word[:6] + str(len(word)))
@pytest.mark.parametrize("reader", READERS)
def test_an_impossible_number_of_a_file_is_one_sentence(reader: str, word: str, tmp_path: Path) -> None:
    read, content = READERS[reader]
    (tmp_path / "file.txt").write_text(content.format(word))
    with warnings.catch_warnings(), pytest.raises(InputError, match=r"file\.txt") as caught:
        warnings.simplefilter("error")
        read(tmp_path / "file.txt")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300 + len(str(tmp_path))


@pytest.mark.parametrize("word", [*WORDS, "-1", "1e-320", "9223372036854775807", "1.5"], ids=lambda word: word[:6])
def test_an_impossible_time_of_an_image_is_one_sentence(word: str, tmp_path: Path) -> None:
    euroc, lab = make_euroc(tmp_path / "euroc"), make_vslam_lab(tmp_path / "lab")
    for folder, listing in ((euroc, euroc / "mav0/cam0/data.csv"), (lab, lab / "rgb.csv")):
        lines = listing.read_text().splitlines()
        lines[-1] = ",".join([word, *lines[-1].split(",")[1:]])
        listing.write_text("\n".join(lines))
        with pytest.raises(InputError, match="nanoseconds") as caught:
            open_sequence(str(folder))
        assert str(listing) in str(caught.value) and "\n" not in str(caught.value)
