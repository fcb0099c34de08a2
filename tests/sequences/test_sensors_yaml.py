"""Other sensors by `--sensors FILE.yaml`: tables, NMEA and KITTI's oxts join the stream of a sequence."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.io.sensor_tables import read_table
from ispom.sensors.gnss import local_of
from ispom.sequences.sensors_yaml import with_sensors
from ispom.types import GnssFix, ImuSamples, Sequence, WheelIncrement
from tests import doubles
from tests.io.test_nmea import sentence

POSE = "{translation_m: [0, -1, 0.5], rotation_xyzw: [0, 0, 0, 1]}"


@pytest.fixture
def plain() -> Sequence:
    return doubles.sequence()


def write(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text)
    return folder / "sensors.yaml"


def test_tables_join_the_stream_in_order(tmp_path: Path, plain: Sequence) -> None:
    imu = "\n".join(["T gx gy gz ax ay az", *(f"{10 + k / 100:.2f} 0 0 {k} 0 0 9.81" for k in range(50))])
    gnss = "\n".join(["time_ns,x,y,z,sigma", *(f"{k * 200_000_000},{k},2,3,0.5" for k in range(5))])
    wheel = "\n".join(["time_s,distance,turn", *(f"{k / 10},0.25,0.01" for k in range(7))])
    path = write(
        tmp_path,
        imu_csv=imu,
        gnss_csv=gnss,
        wheel_csv=wheel,
        sensors_yaml=f"""
imu: {{file: imu.csv, columns: {{time_s: T}}, clock_offset_s: -10, rig_from_imu: {POSE}, gyroscope_noise: 0.002}}
antenna: {{sensor: gnss, file: gnss.csv, rig_from_antenna: {POSE}}}
wheel: {{file: wheel.csv, rig_from_wheel: {POSE}}}
""",
    )
    found = with_sensors(plain, path)
    assert (np.diff(found.times_ns) >= 0).all()
    assert found.rig.rig_from("antenna").translation.tolist() == [0, -1, 0.5]
    assert found.rig.sensors["imu"].gyroscope_noise == 0.002  # type: ignore[attr-defined]
    measured = [found[i] for i in range(len(found))]
    samples = [m for m in measured if isinstance(m, ImuSamples)]
    assert np.array_equal(np.concatenate([m.angular_velocity_rad_s for m in samples])[:, 2], np.arange(50))
    assert sum(isinstance(m, WheelIncrement) for m in measured) == 6
    fixes = [m for m in measured if isinstance(m, GnssFix)]
    assert [f.xyz_in_local[0] for f in fixes] == [0, 1, 2, 3]
    assert np.allclose(fixes[0].covariance, 0.25 * np.eye(3))
    assert sum(m.kind in ("video", "stereo") for m in measured) == len(plain)


def test_nmea_and_geodetic_positions_are_local(tmp_path: Path, plain: Sequence) -> None:
    lines = [sentence(f"00000{k}.00", 49 + 1e-5 * k, 8.4, 100, 4) for k in range(2)]
    path = write(tmp_path, a_nmea="\n".join(lines), sensors_yaml=f"gnss: {{file: a.nmea, rig_from_gnss: {POSE}}}")
    found = with_sensors(plain, path)
    first = next(m for m in (found[i] for i in range(len(found))) if isinstance(m, GnssFix))
    assert np.allclose(first.xyz_in_local, 0)
    assert np.allclose(
        local_of(np.array([[49.001, 8.4, 100.0]]), np.array([49.0, 8.4, 100.0])), [[0, 111.2, 0]], atol=0.1
    )


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("gnss: {rig_from_gnss: POSE}", "gnss.file is missing"),
        ("radar: {file: x.csv}", "radar is no sensor of the kinds imu, gnss, wheel"),
        ("gnss: {file: x.csv, rig_from_gnss: POSE}", "no column sigma"),
        ("gnss: {file: x.csv, rig_from_gnss: POSE, sigma_m: 1, clock_offset_s: 99}", "its file or its clock_offset_s"),
        ("imu: {file: x.csv, rig_from_imu: POSE}", "has no column gx"),
        ("imu: {file: x.csv}", "rig_from_imu is missing"),
        ("gnss: {file: absent.csv, rig_from_gnss: POSE}", "absent.csv"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path: Path, plain: Sequence, text: str, why: str) -> None:
    path = write(tmp_path, x_csv="time_s,x,y,z\n0,1,2,3\n", sensors_yaml=text.replace("POSE", POSE))
    with pytest.raises(InputError, match=why):
        with_sensors(plain, path)


@pytest.mark.parametrize("word", ["1e9999999", "-1e999999999999", "nan", "1e18"])
@pytest.mark.parametrize("clock", ["time_s", "time_ns"])
def test_a_time_beyond_all_numbers_is_one_sentence(tmp_path: Path, clock: str, word: str) -> None:
    (tmp_path / "x.csv").write_text(f"{clock},x\n0,1\n{word}{'0' * 9 if clock == 'time_ns' else ''},1\n")
    with pytest.raises(InputError, match="line 3"):
        read_table(tmp_path / "x.csv")


@given(st.text(max_size=200))
def test_any_table_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("table") / "x.csv"
    path.write_text(f"time_s,x\n{text}", encoding="utf-8")
    with contextlib.suppress(InputError):
        assert (np.diff(read_table(path).times_ns) > 0).all()


@given(st.lists(st.tuples(st.integers(1, 10**12), st.floats(-1e9, 1e9)), min_size=1, max_size=20))
def test_what_is_written_is_read(tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, float]]) -> None:
    path = tmp_path_factory.mktemp("table") / "x.csv"
    times = np.cumsum([gap for gap, _ in rows])
    lines = [f"{t},{value!r}" for t, (_, value) in zip(times, rows, strict=True)]
    path.write_text("\n".join(["time_ns,x", *lines]))
    found = read_table(path)
    assert np.array_equal(found.times_ns, times)
    assert found.columns["x"].tolist() == [value for _, value in rows]
