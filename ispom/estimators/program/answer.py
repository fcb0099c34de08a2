"""A program's answer about one frame, looked at before it is trusted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ispom.estimators.program import plain
from ispom.estimators.program.pipe import ProgramFault
from ispom.geometry import Pose
from ispom.types import Camera, Check, Decision, Status, Step, Tracks, TrackStatus

MOST_TRACKS, MOST_DECISIONS = 20_000, 500
NAMES = ("status", "pose", "key_frame", "tracks", "checks", "state_bytes")
LONGEST_M = 1e9
ENDINGS = {status.name.lower(): status for status in TrackStatus if status.dropped}
"""Why a track ended, by its word."""


def read_step(
    answer: dict[str, Any],
    time_ns: int,
    checks: Mapping[str, Check],
    cameras: Mapping[str, Camera],
    before: Mapping[str, Tracks],
    ids: Mapping[str, int],
) -> Step:
    """Its Step, without frame and times; ProgramFault for what is not as the protocol says.

    `cameras` are those of the frame. By camera, `before` has the tracks of the frame before it, without those
    that had ended, and `ids` the first id that no track had.
    """
    plain.known(answer, NAMES, "an answer")
    status = Status(plain.choice(answer.get("status"), "status", tuple(Status)))
    pose = answer.get("pose")
    if pose is None and status is Status.TRACKING:
        raise ProgramFault("answers that it tracks, but with no pose")
    said = plain.mapping(answer.get("tracks", {}), "tracks")
    plain.known(said, cameras, "the frame")
    tracks = {
        name: _tracks(plain.mapping(said.get(name, {}), "tracks"), name, camera, before.get(name), ids.get(name, 0))
        for name, camera in cameras.items()
        if name in said or name in before
    }
    made = plain.items(answer.get("checks", []), "checks", MOST_DECISIONS)
    return Step(
        time_ns,
        status,
        world_from_frame=None if pose is None else _pose(plain.mapping(pose, "pose")),
        key_frame=plain.boolean(answer.get("key_frame", False), "key_frame"),
        tracks=tracks,
        decisions=_decisions(made, checks),
    )


def _pose(entry: dict[str, Any]) -> Pose:
    plain.known(entry, ("translation", "rotation_xyzw"), "a pose")
    translation = _numbers(entry.get("translation"), "pose.translation", 3)
    xyzw = _numbers(entry.get("rotation_xyzw"), "pose.rotation_xyzw", 4)
    if max(map(abs, translation)) > LONGEST_M:
        raise plain.wrong("pose.translation", translation, f"within {LONGEST_M:g}")
    if abs(np.linalg.norm(xyzw) - 1) > 0.01:
        raise plain.wrong("pose.rotation_xyzw", xyzw, "of length 1")
    return Pose.from_xyzw(np.array(xyzw), np.array(translation))


def _tracks(entry: dict[str, Any], name: str, camera: Camera, before: Tracks | None, first_new: int) -> Tracks:
    """Those of the frame, and after them those of the frame before that have ended, where they were then."""
    where = f"tracks.{name}"
    plain.known(entry, ("ids", "uv", "ended"), where)
    listed = plain.items(entry.get("ids", []), f"{where}.ids", MOST_TRACKS)
    ids = [plain.count(i, f"{where}.ids", plain.LARGEST_ID) for i in listed]
    pairs = plain.items(entry.get("uv", []), f"{where}.uv", MOST_TRACKS, len(ids))
    uv = np.array([_numbers(pair, f"{where}.uv", 2) for pair in pairs], np.float32).reshape(-1, 2)
    if len(set(ids)) != len(ids):
        raise ProgramFault(f"answers with {where}.ids that are not unique")
    if not ((uv > -1) & (uv < (camera.width, camera.height))).all():
        raise ProgramFault(f"answers with {where}.uv outside of its image")
    last = {} if before is None else dict(zip(before.ids.tolist(), before.uv, strict=True))
    if again := [i for i in ids if i not in last and i < first_new]:
        raise ProgramFault(
            f"answers with the track {again[0]} in {where}, which ended before, or whose id is too small"
        )
    ended = plain.mapping(entry.get("ended", {}), f"{where}.ended")
    reasons = {key: ENDINGS[plain.choice(word, f"{where}.ended", ENDINGS)] for key, word in ended.items()}
    gone = [i for i in last if i not in set(ids)]
    if unknown := sorted(reasons.keys() - {str(i) for i in gone}):
        raise ProgramFault(f"answers with {where}.ended of {unknown[0][:20]!r}, which is no track that ends here")
    none = np.full(2, np.nan, np.float32)
    status = [TrackStatus.ALIVE if i in last else TrackStatus.NEW for i in ids]
    return Tracks.of(
        np.array([*ids, *gone], np.int64),
        np.concatenate([uv, _rows(last[i] for i in gone)]),
        uv_prev=np.concatenate([_rows(last.get(i, none) for i in ids), _rows(last[i] for i in gone)]),
        status=np.array([*status, *(reasons.get(str(i), TrackStatus.LOST) for i in gone)]),
    )


def _rows(pairs: Iterable[Any]) -> Any:
    return np.array(list(pairs), np.float32).reshape(-1, 2)


def _decisions(entries: list[Any], checks: Mapping[str, Check]) -> tuple[Decision, ...]:
    found: dict[tuple[str, str], Decision] = {}
    for entry in entries:
        decision = _decision(plain.mapping(entry, "a check"), checks)
        if (decision.key, decision.about) in found:
            raise ProgramFault(f"answers with the check {decision.key!r} twice: tell them apart by about")
        found[decision.key, decision.about] = decision
    return tuple(found.values())


def _decision(entry: dict[str, Any], checks: Mapping[str, Check]) -> Decision:
    plain.known(entry, ("key", "value", "threshold", "passed", "consequence", "about"), "a check")
    check = checks[plain.choice(entry.get("key"), "a check's key", checks)]
    value, threshold = (plain.number(entry.get(name), f"{check.key}'s {name}") for name in ("value", "threshold"))
    passed = None if "passed" not in entry else plain.boolean(entry["passed"], f"{check.key}'s passed")
    consequence = plain.text(entry.get("consequence", ""), f"{check.key}'s consequence")
    decision = check.of(value, threshold, consequence, passed)
    return replace(decision, about=plain.text(entry.get("about", ""), f"{check.key}'s about"))


def _numbers(value: Any, where: str, size: int) -> list[float]:
    return [plain.number(v, where) for v in plain.items(value, where, size, size)]
