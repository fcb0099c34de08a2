"""Finds the camera topics of a bag: by their names, by their camera_info, or by the user's choice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ispom.errors import InputError
from ispom.io.bag_file import BagFile
from ispom.sequences.formats.bag_calibration import TopicInfo, fault_of_pair

SIDES = (
    ("left", "right"),
    ("cam0", "cam1"),
    ("camera0", "camera1"),
    ("infra1", "infra2"),
    ("Infrared_1", "Infrared_2"),
)
"""Names of the topics of a pair."""
CHOICES = (("left", "right"), ("video",))
"""Names that --topics may use."""
Infos = dict[str, TopicInfo | InputError | None]


def rank(topic: str) -> tuple[bool, bool, bool, str]:
    """Returns the sort key of a topic: cameras before depth images, rectified before raw, raw before compressed."""
    return is_depth(topic), not is_rectified(topic), topic.endswith("/compressed"), topic


def is_depth(topic: str) -> bool:
    return "depth" in topic.lower()


def is_rectified(topic: str) -> bool:
    return "rect" in topic.removesuffix("/compressed").rsplit("/", 1)[-1]


def by_role(bag: BagFile, topics: list[str], chosen: Sequence[str]) -> dict[str, str]:
    """Returns the topics by left and right, or by video. Raises InputError for words that do not name such ones."""
    words = [word.partition("=") for word in chosen]
    named = {role: topic for role, _, topic in words}
    if chosen and (tuple(sorted(named)) not in CHOICES or len(named) != len(chosen)):
        raise InputError(f"--topics is {' '.join(chosen)[:200]}: give left=TOPIC right=TOPIC, or video=TOPIC")
    if unknown := [topic for topic in named.values() if topic not in topics]:
        raise InputError(
            f"{bag.path} has no images in {unknown[0] or '(nothing)'}: --topics can name {', '.join(topics)}"
        )
    if len(set(named.values())) < len(named):
        raise InputError(f"--topics names {chosen[0].partition('=')[2]} twice: give two topics of {bag.path}")
    return named


def pairs_by_baseline(topics: list[str], infos: Infos) -> Iterator[tuple[str, str, TopicInfo, TopicInfo]]:
    """Yields the pairs of topics by their baseline: those with the same last name before others of the same kind."""
    for same in (_last_name, _kind_of):
        for left in topics:
            for right in topics:
                first, second = infos[left], infos[right]
                if left == right or same(left) != same(right):
                    continue
                if isinstance(first, TopicInfo) and isinstance(second, TopicInfo) and not fault_of_pair(first, second):
                    yield left, right, first, second


def _last_name(topic: str) -> str:
    return topic.rsplit("/", 1)[-1]


def _kind_of(topic: str) -> tuple[bool, bool, bool]:
    return rank(topic)[:3]
