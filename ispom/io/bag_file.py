"""ROS 1 bags, ROS 2 bags and MCAP files through `rosbags` (the optional extra `bags`): messages by topic and time."""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, counted
from ispom.io.files import is_folder, require_file
from ispom.io.mapping import read_mapping

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
METADATA = "metadata.yaml"
"""Name of the file by which a folder is a bag of ROS 2."""
_STAMP_END = 12
"""Number of bytes of a message up to the end of its header's time stamp (CDR: 4 bytes; ROS 1: a counter; then 8)."""
INFO_TYPE = "sensor_msgs/msg/CameraInfo"


@dataclass(frozen=True, eq=False)
class Index:
    """The times of the messages of one topic, and how to find each message."""

    stamps_ns: NDArray[np.int64]
    """(N,) increasing: times of the headers; times of writing where the former are 0 or repeat."""
    places: list[tuple[int, int]]
    """Of each message: its time of writing [ns], and the number of earlier messages of the topic with the same time."""
    own_clock: bool = False
    """Whether the times are those of writing."""
    notes: tuple[str, ...] = ()
    """Sentences about skipped messages and repeated times."""


class BagFile:
    """One bag, open once per thread that reads it: a database connection must not change threads."""

    def __init__(self, path: Path) -> None:
        """Raises InputError where rosbags is not installed, and for a damaged bag."""
        if not _installed():
            raise InputError(f"{path} is a bag, which takes the extra `bags` to read: pip install 'ispom[bags]'")
        _require_files(path)
        self.path = path
        self._own = threading.local()
        with self._reading() as reader:
            self.types: dict[str, str] = dict(sorted((c.topic, c.msgtype) for c in reader.connections))
        """Message type by topic."""

    def holds(self, topic: str) -> bool:
        """Checks that the topic has a message."""
        with self._reading() as reader:
            return next(iter(reader.messages(_connections(reader, topic))), None) is not None

    def index(self, topic: str, own_clock: bool | None = None) -> Index:
        """Reads the topic's messages once, without decoding them. Their times are those of their headers or, with
        `own_clock`, those of the bag; by default the latter where the former repeat."""
        stamps, written, places, same, copies, last = [], [], [], (0, -1), 0, b""
        with self._reading() as reader:
            for _, time_ns, raw in reader.messages(_connections(reader, topic)):
                same = (time_ns, same[1] + 1 if same[0] == time_ns else 0)
                stamp = _stamp_ns(raw, reader.is2) or time_ns
                content, last = last, raw
                if stamps and stamps[-1] == stamp and content[_STAMP_END:] == raw[_STAMP_END:]:
                    copies += 1  # recorded twice
                    continue
                stamps.append(stamp)
                written.append(time_ns)
                places.append(same)
        repeated = [len(times) - len(set(times)) for times in (stamps, written)]
        if own_clock is None:
            own_clock = repeated[1] < repeated[0]
        times_ns, first = np.unique(np.array(written if own_clock else stamps, np.int64), return_index=True)
        left_out = copies + len(places) - len(first)
        notes = []
        if own_clock and repeated[0]:
            which = f"{repeated[0]} of {counted(len(stamps), 'image')} of {topic}"
            repeat = "repeats" if repeated[0] == 1 else "repeat"
            notes.append(f"{which} {repeat} the time stamp of another: the times of the bag are used")
        if left_out:
            notes.append(
                f"{left_out} of {counted(len(stamps) + copies, 'image')} of {topic} skipped: of one time with another"
            )
        return Index(times_ns, [places[i] for i in first], own_clock, tuple(notes))

    def message(self, topic: str, place: tuple[int, int] | None = None) -> Any:
        """Returns the message at a place of its index, or the topic's first one; None where there is none."""
        time_ns, skip = place or (None, 0)
        with self._reading() as reader:
            stop = None if time_ns is None else time_ns + 1
            for i, (connection, _, raw) in enumerate(reader.messages(_connections(reader, topic), time_ns, stop)):
                if i == skip:
                    return reader.deserialize(raw, connection.msgtype)
        return None

    def all_messages(self, topic: str, most: int = 5_000_000) -> Iterator[Any]:
        """Yields the topic's messages, decoded, in the order in which they were written. Raises InputError for more
        than `most`."""
        return (message for _, message in self.timed_messages(topic, most))

    def timed_messages(self, topic: str, most: int = 5_000_000) -> Iterator[tuple[int, Any]]:
        """Yields the same messages, each with its time of writing [ns]."""
        with self._reading() as reader:
            for n, (connection, time_ns, raw) in enumerate(reader.messages(_connections(reader, topic))):
                if n == most:
                    raise InputError(f"{self.path}: {topic} has more than {most} messages: give a shorter bag")
                yield time_ns, reader.deserialize(raw, connection.msgtype)

    @contextmanager
    def _reading(self) -> Iterator[AnyReader]:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        try:
            if not hasattr(self._own, "reader"):
                reader = AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
                reader.open()
                self._own.reader = reader
            yield self._own.reader
        except InputError:
            raise
        except Exception as error:  # a damaged bag may fail anywhere in rosbags or in its decompressors
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{self.path} is not a whole bag ({reason}): restore or reindex it") from None


def _installed() -> bool:
    try:
        return find_spec("rosbags") is not None
    except ValueError:
        return False


def _require_files(path: Path) -> None:
    """Raises InputError where rosbags would open a pipe or a device, or a file outside of the allowed folders."""
    if not is_folder(path):
        require_file(path)
        return
    information = read_mapping(path / METADATA).get("rosbag2_bagfile_information")
    listed = information.get("relative_file_paths") if isinstance(information, dict) else None
    if not isinstance(listed, list) or not listed or not all(isinstance(name, str) for name in listed):
        raise InputError(f"{path / METADATA} lists no files (relative_file_paths): restore or reindex the bag")
    for name in listed:
        require_file(path / name)


def _connections(reader: AnyReader, topic: str) -> list:
    return [c for c in reader.connections if c.topic == topic]


def _stamp_ns(raw: bytes, cdr: bool) -> int:
    """Returns the time of a message's header, with which it begins: after CDR's own four bytes, or ROS 1's counter."""
    big = cdr and raw[1] == 0
    seconds, nanoseconds = struct.unpack_from(">iI" if big else "<iI", raw, 4)
    return seconds * 10**9 + nanoseconds
