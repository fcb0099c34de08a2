"""The same five poses as each dialect's program writes them."""

# ruff: noqa: E501 - files as they are have long lines
from __future__ import annotations

import json
import struct
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ispom.geometry import Pose
from ispom.types import Trajectory

START_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000
FLIP = np.diag([1.0, -1, -1])


def poses_of(first: Pose, count: int = 5) -> list[Pose]:
    """Poses that move and turn, after a first one."""
    step = Pose.from_rotvec(np.array([0.12, -0.3, 0.2]), np.array([0.4, -0.1, 1.3]))
    poses = [first]
    while len(poses) < count:
        poses.append(poses[-1] @ step)
    return poses


POSES = poses_of(Pose.from_rotvec(np.array([0.1, -0.2, 1.0]), np.array([3.0, 0.5, -2.0])))
FROM_IDENTITY = poses_of(Pose())
"""As odometry starts."""


@dataclass(frozen=True)
class Example:
    """A file's name and content, and what must be read of it."""

    dialect: str
    name: str
    content: bytes
    poses: list[Pose]
    times_ns: tuple[int, ...] | None = None
    """None: the file has none."""
    has_rotations: bool = True
    images: tuple[str, ...] = ()
    noted: bool = False
    """Something was decided that the file does not say."""


def times(count: int) -> list[int]:
    return [START_NS + i * STEP_NS for i in range(count)]


def seconds(time_ns: int) -> str:
    return f"{time_ns // 10**9}.{time_ns % 10**9:09d}"


def lines(poses: list[Pose], row, head: str = "", separator: str = " ") -> bytes:
    """A line for each pose, of the words that `row` gives for its number and pose."""
    text = "".join(separator.join(map(str, row(i, pose))) + "\n" for i, pose in enumerate(poses))
    return (head + text).encode()


def xyz(pose: Pose) -> list[float]:
    return pose.translation.tolist()


def xyzw(pose: Pose) -> list[float]:
    return pose.xyzw.tolist()


def wxyz(pose: Pose) -> list[float]:
    return pose.wxyz.tolist()


def angles(pose: Pose, degrees: bool = False) -> list[float]:
    """Roll, pitch, yaw."""
    return Rotation.from_matrix(pose.rotation).as_euler("ZYX", degrees=degrees)[::-1].tolist()


def at(i: int) -> str:
    return seconds(START_NS + i * STEP_NS)


def flat(pose: Pose, rows: int = 3) -> list[float]:
    return pose.matrix[:rows].ravel().tolist()


def colmap_text(poses: list[Pose]) -> bytes:
    text = "# Image list\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
    for i, pose in reversed(list(enumerate(poses))):
        inverse = pose.inverse()
        words = [i + 1, *wxyz(inverse), *xyz(inverse), 1, f"a folder/frame_{i + 8}.jpg"]
        text += " ".join(map(str, words)) + "\n" + ("" if i == 2 else "10.5 20.5 -1 30.5 40.5 7") + "\n"
    return text.encode()


def colmap_binary(poses: list[Pose]) -> bytes:
    data = struct.pack("<Q", len(poses))
    for i, pose in reversed(list(enumerate(poses))):
        inverse = pose.inverse()
        data += struct.pack("<I7dI", i + 1, *wxyz(inverse), *xyz(inverse), 1)
        data += f"a folder/frame_{i + 8}.jpg".encode() + b"\0" + struct.pack("<Qddq", 1, 3.5, 4.5, -1)
    return data


def transforms(poses: list[Pose]) -> bytes:
    frames = [
        {
            "file_path": f"images/frame_{i + 8}.jpg",
            "transform_matrix": Pose(p.rotation @ FLIP, p.translation).matrix.tolist(),
        }
        for i, p in enumerate(poses)
    ]
    return json.dumps({"fl_x": 226.0, "w": 320, "h": 240, "frames": frames[::-1]}).encode()


def objects(poses: list[Pose]) -> list[dict[str, object]]:
    found = []
    for i, pose in enumerate(poses):
        place, turn = dict(zip("xyz", xyz(pose), strict=True)), dict(zip("xyzw", xyzw(pose), strict=True))
        found.append({"time": (START_NS + i * STEP_NS) / 1e9, "pose": {"position": place, "orientation": turn}})
    return found


def json_lines(values: list[dict[str, object]]) -> bytes:
    return "".join(json.dumps(value) + "\n" for value in values).encode()


def places(poses: list[Pose]) -> bytes:
    """Latitude and longitude north-east of a place, of east and north of the poses, to a good approximation."""
    head, north_m = "timestamp,latitude,longitude,altitude,yaw\n", 111_200.9
    east_m = 74_403.9  # of a degree, at 48 degrees north

    def row(i: int, pose: Pose) -> list[object]:
        x, y, z = pose.translation
        return [at(i), f"{48.1 + y / north_m:.10f}", f"{11.5 + x / east_m:.10f}", f"{500 + z:.6f}", 12.0]

    return lines(poses, row, head, ",")


def subtitles(poses: list[Pose]) -> bytes:
    """As `places`, of times from 0."""
    text = ""
    for i, line in enumerate(places(poses).decode().splitlines()[1:]):
        _, latitude, longitude, height, _ = line.split(",")
        place = f"[latitude: {latitude}] [longitude: {longitude}] [rel_alt: 1.000 abs_alt: {height}]"
        text += (
            f"{i + 1}\n00:00:00,{50 * i:03d} --> 00:00:00,{50 * i + 50:03d}\n[iso: 100] [focal_len: 24.00] {place}\n\n"
        )
    return text.encode()


TIMES = tuple(times(5))
FROM_ZERO = tuple(t - START_NS for t in TIMES)
IMAGES = tuple(f"frame_{i + 8}.jpg" for i in range(5))
EXAMPLES = (
    Example("tum", "a.tum", lines(POSES, lambda i, p: [at(i), *xyz(p), *xyzw(p)]), POSES, TIMES),
    Example(
        "tum", "ns.txt", lines(POSES, lambda i, p: [f"{TIMES[i]}.000000", *xyz(p), *xyzw(p)]), POSES, TIMES
    ),
    Example("tum", "ms.txt", lines(POSES, lambda i, p: [TIMES[i] // 10**6, *xyz(p), *xyzw(p)]), POSES, TIMES),
    Example("euroc", "data.csv", lines(POSES, lambda i, p: [TIMES[i], *xyz(p), *wxyz(p), 0.1], "", ","), POSES, TIMES),
    Example(
        "table", "odometry.csv",
        lines(POSES, lambda i, p: [at(i), f"{i:06d}", *xyz(p), *xyzw(p)], "timestamp, frame, x, y, z, qx, qy, qz, qw\n", ", "),
        POSES, TIMES,
    ),
    Example("kitti", "00.txt", lines(POSES, lambda _, p: flat(p)), POSES),
    Example("matrices", "traj.txt", lines(POSES, lambda _, p: flat(p, 4)), POSES),
    Example("matrices", "columns.txt", lines(POSES, lambda _, p: p.matrix.T.ravel().tolist()), POSES),
    Example(
        "matrices", "pose.txt", "\n".join("\n".join(" ".join(map(str, r)) for r in p.matrix.tolist()) for p in POSES).encode(),
        POSES,
    ),
    Example("numbered_matrices", "poses.txt", lines(POSES, lambda i, p: [i, *flat(p)]), POSES),
    Example("numbered_matrices", "cam0_to_world.txt", lines(POSES, lambda i, p: [i, *flat(p, 4)]), POSES),
    Example("numbered_matrices", "timed.txt", lines(POSES, lambda i, p: [at(i), *flat(p)]), POSES, TIMES),
    Example("seven_columns", "first.txt", lines(FROM_IDENTITY, lambda _, p: [*xyz(p), *wxyz(p)]), FROM_IDENTITY, noted=True),
    Example("seven_columns", "last.txt", lines(FROM_IDENTITY, lambda _, p: [*xyzw(p), *xyz(p)]), FROM_IDENTITY, noted=True),
    Example("seven_columns", "head.txt", lines(POSES, lambda _, p: [*wxyz(p), *xyz(p)], "# qw qx qy qz x y z\n"), POSES),
    Example(
        "rows_of_quaternions", "a.csv", lines(FROM_IDENTITY, lambda i, p: [at(i), *xyz(p), *wxyz(p)], "", ","),
        FROM_IDENTITY, TIMES, noted=True,
    ),
    Example(
        "rows_of_quaternions", "two.txt",
        lines(FROM_IDENTITY, lambda i, p: [TIMES[i] // 10**9, TIMES[i] % 10**9, *xyz(p), *xyzw(p)]),
        FROM_IDENTITY, TIMES, noted=True,
    ),
    Example(
        "openvins", "state.txt",
        lines(POSES, lambda i, p: [at(i), *xyzw(p), *xyz(p), *[0.1] * 9], "# timestamp(s) q p v bg ba\n"), POSES, TIMES,
    ),
    Example(
        "openvins", "rows.txt", lines(FROM_IDENTITY, lambda i, p: [at(i), *xyzw(p), *xyz(p)]), FROM_IDENTITY, TIMES,
        noted=True,
    ),
    Example(
        "angles", "rad.csv",
        lines(POSES, lambda i, p: [at(i), *xyz(p), *angles(p)], "t,x,y,z,roll_rad,pitch_rad,yaw_rad\n", ","), POSES, TIMES,
    ),
    Example(
        "angles", "deg.csv",
        lines(POSES, lambda i, p: [at(i), *xyz(p), *angles(p, True)], "timestamp x y z roll pitch yaw\n"), POSES, TIMES,
        noted=True,
    ),
    Example("geographic", "gps.csv", places(FROM_IDENTITY), FROM_IDENTITY, TIMES, has_rotations=False, noted=True),
    Example("dji_subtitles", "DJI_0007.SRT", subtitles(FROM_IDENTITY), FROM_IDENTITY, FROM_ZERO, has_rotations=False, noted=True),
    Example("positions", "leica.txt", lines(POSES, lambda i, p: [at(i), *xyz(p)]), POSES, TIMES, has_rotations=False),
    Example(
        "positions", "leica.csv", lines(POSES, lambda i, p: [TIMES[i], *xyz(p)], "#timestamp [ns],x,y,z\n", ","), POSES, TIMES,
        has_rotations=False,
    ),
    Example(
        "g2o", "graph.g2o",
        lines(POSES, lambda i, p: ["VERTEX_SE3:QUAT", i, *xyz(p), *xyzw(p)]) + b"EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1\n", POSES,
    ),
    Example(
        "redwood", "traj.log",
        lines(POSES, lambda i, p: [i, i, i + 1, "\n" + "\n".join(" ".join(map(str, r)) for r in p.matrix.tolist())]), POSES,
    ),
    Example("colmap", "images.txt", colmap_text(POSES), POSES, images=tuple(f"a folder/{name}" for name in IMAGES)),
    Example("colmap", "images.bin", colmap_binary(POSES), POSES, images=tuple(f"a folder/{name}" for name in IMAGES)),
    Example("nerfstudio", "transforms.json", transforms(POSES), POSES, images=tuple(f"images/{name}" for name in IMAGES)),
    Example("json_objects", "lines.jsonl", json_lines(objects(POSES)), POSES, TIMES),
    Example("json_objects", "list.json", json.dumps({"poses": objects(POSES)}).encode(), POSES, TIMES),
    Example(
        "json_objects", "w2c.jsonl",
        json_lines([{"timestamp": t / 1e9, "w2c": p.inverse().matrix.tolist()} for t, p in zip(TIMES, POSES, strict=True)]),
        POSES, TIMES,
    ),
)  # fmt: skip
REFUSED = (
    ("seven_columns", "a.txt", lines(POSES, lambda _, p: [*xyz(p), *xyzw(p)]), "x y z qw qx qy qz"),
    ("rows_of_quaternions", "a.csv", lines(POSES, lambda i, p: [at(i), *xyz(p), *wxyz(p)], "", ","), "timestamp,x,y,z,qw"),
    ("openvins", "a.txt", lines(POSES, lambda i, p: [at(i), *xyzw(p), *xyz(p)]), "timestamp qx qy qz qw x y z"),
    (
        "angles", "a.csv", lines(POSES[:2], lambda i, p: [at(i), *xyz(p), *angles(p)], "t,x,y,z,roll,pitch,yaw\n", ","),
        "roll_deg",
    ),
)  # fmt: skip
"""Dialect, name and content of files that are ambiguous, and a part of the choice."""


def trajectory(example: Example) -> Trajectory:
    """What is to be read."""
    known = example.times_ns or tuple(i * 10**9 for i in range(len(example.poses)))
    return Trajectory.of(list(zip(known, example.poses, strict=True)))
