"""Tables of poses: the header decides which column is what, and what unit the times have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.poses.recognised import read_trajectory
from ispom.io.trajectories import euroc_text, read_euroc, read_tum, trajectory_csv, tum_text
from ispom.types import Trajectory

DATA = Path(__file__).parents[3] / "shared" / "data"
START_NS = 1_700_000_000_000_000_000
TIMES_NS = [i * 50_000_000 for i in range(5)]
POSES = [Pose.from_rotvec(np.array([0.1, -0.2 * i, 1.0]), np.array([i, 0.5, -2.0 * i])) for i in range(5)]
HEADERS = {
    "timestamp,tx,ty,tz,qx,qy,qz,qw": "t x y z qx qy qz qw",
    "#timestamp,tx,ty,tz,qw,qx,qy,qz": "t x y z qw qx qy qz",
    "TIMESTAMP,QW,QX,QY,QZ,X,Y,Z": "t qw qx qy qz x y z",
    '"id","pos_x","pos_y","pos_z","quat_x","quat_y","quat_z","quat_w","time"': "0 x y z qx qy qz qw t",
    "%time,field.header.seq,field.header.stamp,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
    "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w":
        "0 0 t x y z qx qy qz qw",
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x []":
        "t x y z qw qx qy qz 0",
    "# time w x y z tx ty tz": "t qw qx qy qz x y z",
}  # fmt: skip


def table(header: str, columns: str, times: list[str], separator: str, scale: float = 1.0) -> str:
    lines = [header.replace(",", separator) if separator == ";" else header]
    for time, pose in zip(times, POSES, strict=True):
        x, y, z, w = pose.xyzw
        values = dict(zip(("qx", "qy", "qz", "qw"), (x, y, z, w), strict=True))
        values |= dict(zip("xyz", pose.translation / scale, strict=True))
        words = [time if c == "t" else f"{values[c]:.9f}" if c in values else c for c in columns.split()]
        lines.append(separator.join(words))
    return "\n".join(lines) + "\n"


def check(found: Trajectory, times_ns: list[int]) -> None:
    assert found.times_ns.tolist() == times_ns
    np.testing.assert_allclose(found.rotations, [pose.rotation for pose in POSES], atol=1e-8)
    np.testing.assert_allclose(found.translations, [pose.translation for pose in POSES], atol=1e-8)


@pytest.mark.parametrize("separator", [",", ";"])
@pytest.mark.parametrize("header", HEADERS)
def test_the_header_decides(header: str, separator: str, tmp_path: Path) -> None:
    if "," not in header and separator == ";":
        separator = " "
    if "," not in header:
        separator = " "
    times = [str(START_NS + t) for t in TIMES_NS]
    (tmp_path / "a.csv").write_text(table(header, HEADERS[header], times, separator))
    check(read_trajectory(tmp_path / "a.csv").trajectory, [START_NS + t for t in TIMES_NS])


@pytest.mark.parametrize("first", [0, START_NS])
@pytest.mark.parametrize("unit_ns", [10**9, 10**6, 10**3, 1])
def test_the_unit_of_times_is_seen_in_them(first: int, unit_ns: int, tmp_path: Path) -> None:
    times = [f"{(first + t) / 1e9:.2f}" if unit_ns == 10**9 else str((first + t) // unit_ns) for t in TIMES_NS]
    (tmp_path / "a.csv").write_text(table("time,x,y,z,qx,qy,qz,qw", "t x y z qx qy qz qw", times, ","))
    found = read_trajectory(tmp_path / "a.csv")
    check(found.trajectory, [first + t for t in TIMES_NS])
    assert found.format == "CSV" and found.unit == {10**9: "s", 10**6: "ms", 10**3: "us", 1: "ns"}[unit_ns]


@pytest.mark.parametrize(
    ("name", "unit_ns"),
    [("time_ms", 10**6), ("timestamp [us]", 10**3), ("Time (s)", 10**9), ("t_ns", 1), ("milliseconds", 10**6)],
)
def test_the_header_s_unit_counts(name: str, unit_ns: int, tmp_path: Path) -> None:
    times = [str(1000 + i) for i in range(5)]
    (tmp_path / "a.csv").write_text(table(f"{name},x,y,z,qx,qy,qz,qw", "t x y z qx qy qz qw", times, ","))
    found = read_trajectory(tmp_path / "a.csv")
    check(found.trajectory, [(1000 + i) * unit_ns for i in range(5)])
    assert found.unit == ""


def test_seconds_and_nanoseconds_may_have_a_column_each(tmp_path: Path) -> None:
    times = [f"1700000000,{t}" for t in TIMES_NS]
    header = "header.stamp.sec,header.stamp.nanosec,x,y,z,qx,qy,qz,qw"
    (tmp_path / "a.csv").write_text(table(header, "t x y z qx qy qz qw", times, ","))
    check(read_trajectory(tmp_path / "a.csv").trajectory, [START_NS + t for t in TIMES_NS])


def test_decimal_commas_between_semicolons(tmp_path: Path) -> None:
    times = [f"{t / 1e9:.2f}" for t in TIMES_NS]
    text = table("time;x;y;z;qx;qy;qz;qw", "t x y z qx qy qz qw", times, ";")
    (tmp_path / "a.csv").write_text(text.replace(".", ","))
    check(read_trajectory(tmp_path / "a.csv").trajectory, TIMES_NS)


def test_positions_in_millimetres(tmp_path: Path) -> None:
    text = table("time_ns,x [mm],y [mm],z [mm],qx,qy,qz,qw", "t x y z qx qy qz qw", list(map(str, TIMES_NS)), ",", 1e-3)
    (tmp_path / "a.csv").write_text(text)
    check(read_trajectory(tmp_path / "a.csv").trajectory, TIMES_NS)


@pytest.mark.parametrize("header", ["#t,x,y,z,q1,q2,q3,q4", "time,x,y,z,a,b,c,score", "a;b;c;d;e;f;g;h"])
def test_a_header_that_names_no_quaternion_is_refused(header: str, tmp_path: Path) -> None:
    text = table(header, "t x y z qx qy qz qw", list(map(str, TIMES_NS)), ";" if ";" in header else ",")
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match="line 1"):
        read_trajectory(tmp_path / "a.csv")


def test_every_table_that_is_written_is_read_back(tmp_path: Path) -> None:
    own = Trajectory.of([(START_NS + t, pose) for t, pose in zip(TIMES_NS, POSES, strict=True)])
    for write, form in ((trajectory_csv, "CSV"), (euroc_text, "EuRoC"), (tum_text, "TUM")):
        (tmp_path / "a.txt").write_text(write(own))
        found = read_trajectory(tmp_path / "a.txt")
        assert found.format == form and found.unit == ""
        check(found.trajectory, [START_NS + t for t in TIMES_NS])


def test_the_truth_of_a_recording_is_read_by_its_header_too(tmp_path: Path) -> None:
    for header in ("# timestamp tx ty tz qx qy qz qw", "timestamp tx ty tz qx qy qz qw"):
        (tmp_path / "a.txt").write_text(table(header, "t x y z qx qy qz qw", [f"{t / 1e9}" for t in TIMES_NS], " "))
        check(read_tum(tmp_path / "a.txt"), TIMES_NS)
    (tmp_path / "a.txt").write_text(
        table("# timestamp tx ty tz qw qx qy qz", "t x y z qw qx qy qz", [f"{t / 1e9}" for t in TIMES_NS], " ")
    )
    check(read_tum(tmp_path / "a.txt"), TIMES_NS)
    (tmp_path / "data.csv").write_text(
        table("#timestamp,x,y,z,qx,qy,qz,qw", "t x y z qx qy qz qw", list(map(str, TIMES_NS)), ",")
    )
    check(read_euroc(tmp_path / "data.csv"), TIMES_NS)


def test_a_file_that_somebody_reported() -> None:
    folder = DATA / "reports" / "07_csv_header_xyzw"
    if not folder.is_dir():
        pytest.skip("../shared/data/reports is absent")
    table, same = (read_trajectory(folder / name).trajectory for name in ("est_comma_ns_xyzw.csv", "est.tum"))
    assert table.times_ns.tolist() == same.times_ns.tolist()
    np.testing.assert_allclose(table.rotations, same.rotations, atol=1e-6)
