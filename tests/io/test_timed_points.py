"""A laser's points as files: read back to the nanosecond, and mistakes named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.io.meshes import open3d
from ispom.io.timed_points import read_timed_points, timed_points_csv
from ispom.types import TimedPoints

START_NS = 1_700_000_000_123_456_789


def test_csv_is_read_back(tmp_path: Path) -> None:
    given = TimedPoints(START_NS + np.arange(5) * 33_333, np.round(np.random.default_rng(0).normal(0, 9, (5, 3)), 4))
    (tmp_path / "points.csv").write_text(timed_points_csv(given))
    found = read_timed_points(tmp_path / "points.csv")
    np.testing.assert_array_equal(found.times_ns, given.times_ns)
    np.testing.assert_allclose(found.xyz_in_laser, given.xyz_in_laser, atol=1e-9)


def test_other_columns_are_ignored_and_seconds_understood(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("intensity, Time_s ,x,y,z\n9,1.25,1,2,3\n8,1.250033,4,5,6\n")
    found = read_timed_points(path)
    assert found.times_ns.tolist() == [1_250_000_000, 1_250_033_000]
    assert found.xyz_in_laser.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,2,3\n", "has no time_s of its points"),
        ("time_s,x,y\n1,2,3\n", "has no z of its points"),
        ("time_s,x,y,z\n1,2,3,4\n1,2,three,4\n", "line 3: its values are no numbers"),
        ("time_s,x,y,z\n1,2\n", "line 2: its values are no numbers"),
        ("time_s,x,y,z\n1,2,nan,4\n", "point 1 has no finite coordinates"),
        ("time_s,x,y,z\nnan,2,3,4\n", "the time of point 1 is no time"),
        ("time_ns,x,y,z\n0,2,3,4\n9223372036854775807,2,3,4\n", "the time of point 2 is no time"),
        ("time_ns,x,y,z\n-9223372036854775808,2,3,4\n", "the time of point 1 is no time"),
        (f"time_ns,x,y,z\n{'9' * 400},2,3,4\n", "line 2: its values are no numbers"),
        ("time_s,x,y,z\n1e300,2,3,4\n", "the time of point 1 is no time"),
        ("time_s,x,y,z\n1,2,-1e308,4\n", "point 1 has no finite coordinates"),
        ("time_s,x,y,z\n", "holds no point"),
        ("", "has no x of its points"),
    ],
)
def test_a_mistake_is_named(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_timed_points(path)


@pytest.mark.parametrize("binary", [True, False])
def test_ply_has_times_with_the_coordinates(binary: bool, tmp_path: Path) -> None:
    try:
        open3d()
    except InputError as error:
        pytest.skip(str(error))
    path, kind = tmp_path / "points.ply", np.dtype([("xyz", "<f4", 3), ("time", "<f8"), ("intensity", "<f4")])
    rows = np.array([((1, 2, 3), 7.000033333, 0.5), ((4, 5, 6), 7.000066667, 0.25)], kind)
    form = "binary_little_endian" if binary else "ascii"
    header = ["ply", f"format {form} 1.0", "element vertex 2", *(f"property float {a}" for a in "xyz")]
    header += ["property double time", "property float intensity", "end_header", ""]
    lines = "".join(f"{x} {y} {z} {t:.9f} {i}\n" for (x, y, z), t, i in rows.tolist())
    path.write_bytes("\n".join(header).encode() + (rows.tobytes() if binary else lines.encode()))
    found = read_timed_points(path)
    assert found.times_ns.tolist() == [7_000_033_333, 7_000_066_667]
    np.testing.assert_allclose(found.xyz_in_laser, [[1, 2, 3], [4, 5, 6]])


def test_a_damaged_ply_is_a_sentence(tmp_path: Path) -> None:
    try:
        open3d()
    except InputError as error:
        pytest.skip(str(error))
    (tmp_path / "points.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vert")
    with pytest.raises(InputError, match="damaged"):
        read_timed_points(tmp_path / "points.ply")
