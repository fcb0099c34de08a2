"""Bags of ROS 1 and ROS 2, and MCAP files: topics of PoseStamped, PoseWithCovarianceStamped, Odometry,
TransformStamped, Path and tf; w last in messages, metres, times of the headers.

Poses are world_from_FRAME: of `header.frame_id` from the body that the topic is about (`child_frame_id`). One topic
is read: that which `FILE:TOPIC` names, or the only one; of tf, `FILE:/tf:CHILD` names the child frame, which need not
be named where there is one. A Path is that of the topic's last message. A topic of odometry may be an estimate, so
that bags with images never use it as ground truth unasked. Needs the extra `bags`. Source: ROS, geometry_msgs,
nav_msgs and tf2_msgs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, counted
from ispom.io.bag_file import METADATA, BagFile
from ispom.io.files import exists
from ispom.io.poses.content import PoseContent
from ispom.io.poses.dialect import PoseDialect, TrajectoryFile, of_quaternions

TITLE = "ROS bag"
STAMPED = {
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/TransformStamped": lambda message: message.transform,
}
PATH, TF = "nav_msgs/msg/Path", ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
MAGIC = (b"#ROSBAG V", b"\x89MCAP0", b"SQLite format 3\0")
SUFFIXES = (".bag", ".mcap", ".db3")


def pose_topics(bag: BagFile) -> dict[str, str]:
    """Returns types of the topics that have poses, of bodies first, tf_static never."""
    kinds = (*STAMPED, PATH, *TF)
    found = [(topic, kind) for topic, kind in bag.types.items() if kind in kinds and "tf_static" not in topic]
    return dict(sorted(found, key=lambda each: (kinds.index(each[1]) >= len(STAMPED), each[0])))


def _recognises(content: PoseContent) -> bool:
    if content.is_folder:
        return exists(content.path / METADATA)
    return content.suffix in SUFFIXES or content.head.startswith(MAGIC)


def _read(content: PoseContent, times_ns: NDArray[np.int64] | None) -> TrajectoryFile:
    path, (topic, _, child) = content.path, content.topic.partition(":")
    bag = BagFile(path)
    topics = {name: kind for name, kind in pose_topics(bag).items() if bag.holds(name)}
    if not topics:
        raise InputError(f"{path} has no topic with poses (PoseStamped, Odometry, TransformStamped, Path or tf)")
    if topic and topic not in topics:
        raise InputError(f"{path} has no topic {topic[:80]} with poses: give one of {', '.join(topics)}")
    bodies = [name for name, kind in topics.items() if kind in STAMPED] or [n for n in topics if topics[n] == PATH]
    candidates = [topic] if topic else bodies or list(topics)
    if len(candidates) > 1:
        raise InputError(
            f"{path} has poses in {counted(len(candidates), 'topic')}: name one, such as {path}:{candidates[0]} "
            f"({', '.join(candidates)})"
        )
    topic = candidates[0]
    note = f"{path}: poses are those of {topic} ({topics[topic].rsplit('/', 1)[-1]})"
    if topics[topic] in STAMPED:
        pose_of = STAMPED[topics[topic]]
        poses = [_values(each.header.stamp, pose_of(each)) for each in bag.all_messages(topic)]
    elif topics[topic] == PATH:
        last = next(iter(deque(bag.all_messages(topic), maxlen=1)), None)
        poses = [_values(each.header.stamp, each.pose) for each in getattr(last, "poses", [])]
    else:
        poses, child = _of_tf(content, bag.all_messages(topic), topic, child)
        note = f"{path}: poses are those of {child} in {topic}"
    if not poses:
        raise InputError(f"{path}: {topic} holds no pose: give another topic")
    poses.sort(key=lambda pose: pose[0])
    values = np.array([pose[1] for pose in poses])
    bad = ~np.isfinite(values).all(axis=1) | (abs(np.linalg.norm(values[:, 3:], axis=1) - 1) > 0.01)
    notes = (note,)
    if bad.any():
        notes += (f"{path}: {int(bad.sum())} of {counted(len(bad), 'pose')} of {topic} skipped: they are no poses",)
    times = np.array([pose[0] for pose in poses], np.int64)[~bad]
    if not len(times):
        raise InputError(f"{path}: {topic} has no valid pose: give another topic")
    rows = [(n, [str(t)]) for n, t in enumerate(times.tolist(), 1)]
    trajectory = of_quaternions(content, rows, times, values[~bad, :3], values[~bad, 3:])
    return TrajectoryFile(path, TITLE, trajectory, notes=notes)


def _values(stamp: Any, pose: Any) -> tuple[int, list[float]]:
    """Returns the time [ns], and position and quaternion of a pose or a transform."""
    place = pose.position if hasattr(pose, "position") else pose.translation
    turn = pose.orientation if hasattr(pose, "orientation") else pose.rotation
    return stamp.sec * 10**9 + stamp.nanosec, [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def _of_tf(
    content: PoseContent, messages: Iterable[Any], topic: str, child: str
) -> tuple[list[tuple[int, list[float]]], str]:
    """Returns the poses of a child frame in its parent, and its name."""
    poses: dict[str, list[tuple[int, list[float]]]] = {}
    for message in messages:
        for each in message.transforms:
            poses.setdefault(each.child_frame_id, []).append(_values(each.header.stamp, each.transform))
    if child not in poses and (child or len(poses) > 1):
        names = ", ".join(sorted(poses)[:10])
        raise InputError(
            f"{content.path}: {topic} has {counted(len(poses), 'frame')}: name one as {content.path}:{topic}:CHILD "
            f"({names})"
        )
    child = child or next(iter(poses), "")
    return poses.get(child, []), child


DIALECT = PoseDialect(
    "ros_bag",
    TITLE,
    "*.bag, *.mcap, *.db3",
    "bag",
    "a bag of ROS 1 or ROS 2, or an MCAP file, with a topic of poses",
    _recognises,
    _read,
)
