"""Poses of other programs: each dialect's example is read right, by it alone, and damaged files are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialects import dialects, modules, recognised
from ispom.io.poses.recognised import read_trajectory
from tests.io.dialect_examples import mutations
from tests.io.pose_examples import (
    EXAMPLES,
    POSES,
    REFUSED,
    TIMES,
    Example,
    colmap_binary,
    colmap_text,
    flat,
    json_lines,
    lines,
    objects,
    poses_of,
    trajectory,
    transforms,
    xyz,
    xyzw,
)

IDS = [f"{each.dialect}-{each.name}" for each in EXAMPLES]
DAMAGED = 30
ON_GLOBE = {"geographic", "dji_subtitles"}
WITHOUT_EXAMPLE = {"ros_bag"}
"""Its test writes a bag."""


def written(folder: Path, name: str, content: bytes) -> Path:
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_an_example_is_read_right(example: Example, tmp_path: Path) -> None:
    found = read_trajectory(written(tmp_path, example.name, example.content))
    expected = trajectory(example)
    assert found.timed == (example.times_ns is not None) and found.images == example.images
    assert found.has_rotations == example.has_rotations and bool(found.notes) == example.noted
    rounding_ns = 200 if example.dialect == "json_objects" else 0  # of a float
    assert abs(found.trajectory.times_ns - expected.times_ns).max() <= rounding_ns
    tolerance = 1e-2 if example.dialect in ON_GLOBE else 1e-9
    np.testing.assert_allclose(found.trajectory.translations, expected.translations, atol=tolerance)
    if example.has_rotations:
        np.testing.assert_allclose(found.trajectory.rotations, expected.rotations, atol=1e-9)


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_an_example_is_recognised_by_its_dialect_alone(example: Example, tmp_path: Path) -> None:
    content = PoseContent(written(tmp_path, example.name, example.content))
    found = recognised(content)
    assert found is not None
    assert [each.name for each in dialects() if each.recognises(content)] == [example.dialect]


def test_each_dialect_has_an_example_and_says_its_conventions() -> None:
    assert {each.dialect for each in EXAMPLES} | WITHOUT_EXAMPLE == {each.name for each in dialects()}
    for name, module in modules().items():
        words = " ".join((module.__doc__ or "").split())
        assert "world_from" in words or name in {*ON_GLOBE, "positions"}, name
        assert "Source: " in words, name


@pytest.mark.parametrize(("dialect", "name", "content", "choice"), REFUSED, ids=[each[0] for each in REFUSED])
def test_what_is_ambiguous_is_refused_with_the_choice(
    dialect: str, name: str, content: bytes, choice: str, tmp_path: Path
) -> None:
    path = written(tmp_path, name, content)
    found = recognised(PoseContent(path))
    assert found is not None and found.name == dialect
    with pytest.raises(InputError) as caught:
        read_trajectory(path)
    assert choice in str(caught.value) and str(path) in str(caught.value)


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(example: Example, tmp_path: Path) -> None:
    for n, content in enumerate(mutations(example.content, DAMAGED, seed=len(example.name))):
        path = written(tmp_path, example.name, content)
        try:
            assert np.isfinite(read_trajectory(path).trajectory.translations).all()
        except InputError as fault:
            assert "\n" not in str(fault) and str(path) in str(fault), n


def test_the_number_of_an_image_finds_its_time(tmp_path: Path) -> None:
    path = written(tmp_path, "poses.txt", lines(POSES, lambda i, p: [2 * i, *flat(p)]))
    found = read_trajectory(path, np.arange(9) * 7)
    assert found.timed and found.trajectory.times_ns.tolist() == [0, 14, 28, 42, 56]
    with pytest.raises(InputError, match="image 8 "):
        read_trajectory(path, np.arange(8) * 7)


def test_jumps_of_two_pi_show_radians(tmp_path: Path) -> None:
    rows = [f"{i}.5,0,0,{i},0,0,{yaw}\n" for i, yaw in enumerate((3.0, 3.1, -3.1, -3.0))]
    path = written(tmp_path, "a.csv", ("time,x,y,z,roll,pitch,yaw\n" + "".join(rows)).encode())
    found = read_trajectory(path)
    assert found.notes
    np.testing.assert_allclose(found.trajectory.rotations[0, :2, 0], [np.cos(3), np.sin(3)])


@st.composite
def any_poses(draw: st.DrawFn) -> list[Pose]:
    turn = np.array(draw(st.lists(st.floats(-3, 3), min_size=3, max_size=3)))
    place = np.array(draw(st.lists(st.floats(-1000, 1000), min_size=3, max_size=3)))
    return poses_of(Pose.from_rotvec(turn, place))


@settings(max_examples=15, deadline=None)
@given(poses=any_poses())
def test_any_poses_are_read_as_they_were_written(poses: list[Pose], tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("poses")
    files = {
        "a.tum": lines(poses, lambda i, p: [TIMES[i] / 1e9, *xyz(p), *xyzw(p)]),
        "traj.txt": lines(poses, lambda _, p: flat(p, 4)),
        "poses.txt": lines(poses, lambda i, p: [i, *flat(p)]),
        "images.txt": colmap_text(poses),
        "images.bin": colmap_binary(poses),
        "transforms.json": transforms(poses),
        "a.jsonl": json_lines(objects(poses)),
        "a.g2o": lines(poses, lambda i, p: ["VERTEX_SE3:QUAT", i, *xyz(p), *xyzw(p)]),
    }
    for name, content in files.items():
        found = read_trajectory(written(folder, name, content)).trajectory
        np.testing.assert_allclose(found.translations, [p.translation for p in poses], atol=1e-6)
        np.testing.assert_allclose(found.rotations, [p.rotation for p in poses], atol=1e-8)


def test_what_pycolmap_reads_is_read_alike(tmp_path: Path) -> None:
    """Its poses of an images.txt, and of the images.bin that it writes."""
    pycolmap = pytest.importorskip("pycolmap")
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 320 240 226 226 160 120\n")
    (tmp_path / "points3D.txt").write_text("")
    lines = colmap_text(POSES).decode().replace("a folder", "a_folder").splitlines()
    text = "\n".join(line if ".jpg" in line else "" for line in lines)
    (tmp_path / "images.txt").write_text(text.lstrip() + "\n")
    model = pycolmap.Reconstruction(str(tmp_path))
    (tmp_path / "binary").mkdir()
    model.write_binary(str(tmp_path / "binary"))
    for path in (tmp_path / "images.txt", tmp_path / "binary"):
        found = read_trajectory(path)
        for i, name in enumerate(found.images):
            image = next(each for each in model.images.values() if each.name == name)
            theirs: Any = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
            np.testing.assert_allclose(found.trajectory.pose(i).inverse().matrix[:3], theirs.matrix(), atol=1e-9)


def pose_bag(path: Path, topics: dict[str, str]) -> Path:
    """A bag of ROS 1 with POSES on topics of these types (PoseStamped, Odometry, Path, tf)."""
    pytest.importorskip("rosbags", reason="the extra `bags` is not installed")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", KINDS["/tf"]))
    types = store.types

    def header(i: int, name: str = "world") -> Any:
        return types["std_msgs/msg/Header"](i, types["builtin_interfaces/msg/Time"](*divmod(TIMES[i], 10**9)), name)

    def message(kind: str, i: int, pose: Pose) -> Any:
        turn = types["geometry_msgs/msg/Quaternion"](*xyzw(pose))
        if kind.startswith("tf"):
            move = types["geometry_msgs/msg/Transform"](types["geometry_msgs/msg/Vector3"](*xyz(pose)), turn)
            transform = types["geometry_msgs/msg/TransformStamped"](header(i), "body", move)
            other = types["geometry_msgs/msg/TransformStamped"](header(i), "wheel", move)
            return types["tf2_msgs/msg/TFMessage"]([transform, other])
        place = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](*xyz(pose)), turn)
        stamped = types["geometry_msgs/msg/PoseStamped"](header(i), place)
        if kind.startswith("nav_msgs/msg/Path"):
            every = [message("geometry_msgs/msg/PoseStamped", n, POSES[n]) for n in range(i + 1)]
            return types["nav_msgs/msg/Path"](header(i), every)
        if kind.startswith("nav_msgs"):
            moves = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            twist = types["geometry_msgs/msg/Twist"](moves, moves)
            return types["nav_msgs/msg/Odometry"](
                header(i),
                "base",
                types["geometry_msgs/msg/PoseWithCovariance"](place, np.zeros(36)),
                types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
            )
        return stamped

    with Writer(path) as writer:
        for topic, kind in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for i, pose in enumerate(POSES):
                writer.write(connection, TIMES[i] + 5, bytes(store.serialize_ros1(message(kind, i, pose), kind)))
    return path


KINDS = {
    "/vicon/rig": "geometry_msgs/msg/PoseStamped",
    "/odom": "nav_msgs/msg/Odometry",
    "/path": "nav_msgs/msg/Path",
    "/tf": "tf2_msgs/msg/TFMessage",
}


@pytest.mark.parametrize("topic", KINDS)
def test_the_topic_of_a_bag_is_read(topic: str, tmp_path: Path) -> None:
    path = pose_bag(tmp_path / "a.bag", {topic: KINDS[topic]})
    found = read_trajectory(Path(f"{path}:/tf:body") if topic == "/tf" else path)
    assert found.timed and any(topic in note for note in found.notes)
    assert found.trajectory.times_ns.tolist() == list(TIMES)
    np.testing.assert_allclose(found.trajectory.translations, [p.translation for p in POSES])
    np.testing.assert_allclose(found.trajectory.rotations, [p.rotation for p in POSES], atol=1e-12)


def test_of_several_topics_and_frames_the_choice_is_named(tmp_path: Path) -> None:
    path = pose_bag(tmp_path / "a.bag", KINDS)
    for name, choice in (("", ":/odom"), (":/tf", "body, wheel"), (":/nothing", "/vicon/rig"), (":/tf:arm", "body")):
        with pytest.raises(InputError) as caught:
            read_trajectory(Path(f"{path}{name}"))
        assert choice in str(caught.value)
    assert len(read_trajectory(Path(f"{path}:/vicon/rig")).trajectory) == len(POSES)


def test_zeros_instead_of_poses_are_ignored_and_named(tmp_path: Path) -> None:
    """As motion capture writes where it does not see its body."""
    path = tmp_path / "truth.tum"
    lines = [f"{i / 10:.6f} {i} 0 1 0 0 0 1" for i in range(1, 41)]
    lines[9:12] = [" ".join([line.split()[0], *"0000000"]) for line in lines[9:12]]
    lines[20] = f"{lines[20].split()[0]} 0 0 0 0 0 0 0"
    path.write_text("# a header\n" + "\n".join(lines) + "\n")
    found = read_trajectory(path)
    assert len(found.trajectory) == 36 and found.trajectory.translations[:, 2].min() == 1
    (note,) = found.notes
    assert "lines 11 to 13 (times 1.000000 to 1.200000)" in note and "line 22 (time 2.100000)" in note
    path.write_text("\n".join(f"{i} 0 0 0 0 0 0 0" for i in range(5)))
    with pytest.raises(InputError):
        read_trajectory(path)
