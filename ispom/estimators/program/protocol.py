"""The protocol of programs (docs/reference/external_programs.md): the requests, and checks of each answer.

A request is one line of JSON, followed by as many bytes as it states. No field of an answer is trusted unchecked.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import yaml

from ispom.estimators.program import validate
from ispom.estimators.program.pipe import Pipe, ProgramFault
from ispom.geometry import Pose
from ispom.io.rig import rig_text
from ispom.types import (
    Camera,
    Check,
    Decision,
    DecisionKind,
    Frame,
    Measurement,
    Rig,
    Status,
    Step,
    Tracks,
    TrackStatus,
    as_grey,
    images_of,
)

VERSION = 1
HELLO = json.dumps({"type": "hello", "version": VERSION}).encode() + b"\n"
MAX_CHECKS = 200
KEY = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_NAMES = ("version", "saves", "frame", "unit", "grey", "source", "checks")


@dataclass(frozen=True)
class Description:
    """The answer to `hello`; docs/reference/external_programs.md explains each field."""

    saves: bool
    frame: Frame
    unit: Literal["metric", "own"]
    grey: bool
    source: str
    checks: Mapping[str, Check]


def greet(pipe: Pipe) -> Description:
    """Makes the first exchange with a program. Raises ProgramFault where its answer is invalid."""
    answer = pipe.request(HELLO)
    validate.known(answer, _NAMES, "the answer to hello")
    if answer.get("version") != VERSION:
        raise ProgramFault(f"speaks version {str(answer.get('version'))[:20]} of the protocol, not {VERSION}")
    return Description(
        saves=validate.boolean(answer.get("saves", False), "saves"),
        frame=validate.choice(answer.get("frame"), "frame", ("rig", "video", "left")),
        unit=validate.choice(answer.get("unit"), "unit", ("metric", "own")),
        grey=validate.boolean(answer.get("grey", False), "grey"),
        source=validate.text(answer.get("source", "a program of its own"), "source"),
        checks=_checks(validate.items(answer.get("checks", []), "checks", MAX_CHECKS)),
    )


def _checks(entries: list[Any]) -> dict[str, Check]:
    checks: dict[str, Check] = {}
    for entry in entries:
        check = _check(validate.mapping(entry, "a check"))
        if check.key in checks:
            raise ProgramFault(f"describes two checks {check.key!r}")
        checks[check.key] = check
    return checks


def _check(entry: dict[str, Any]) -> Check:
    validate.known(entry, ("key", "name", "kind", "question", "relation", "unit"), "a check's description")
    key = validate.text(entry.get("key"), "a check's key")
    if not KEY.fullmatch(key):
        raise validate.wrong("a check's key", key, "small letters, digits and single underscores")
    kind = validate.choice(entry.get("kind", "requirement"), "a check's kind", get_args(DecisionKind))
    question = validate.text(entry.get("question", ""), "a check's question")
    if (question and not question.endswith("?")) or (kind == "trigger" and not question):
        raise validate.wrong("a check's question", question, "a question, as every trigger has one")
    name = validate.text(entry.get("name"), "a check's name")
    if not name:
        raise validate.wrong("a check's name", name, "words")
    relation = validate.choice(entry.get("relation", ">="), "a check's relation", (">=", "<=", ">", "<"))
    return Check(key, name, kind, question, relation, validate.text(entry.get("unit", ""), "a check's unit"))


# Requests


def start_request(rig: Rig, settings: Mapping[str, Any]) -> bytes:
    """Returns the request that starts the program with a rig and its settings."""
    return _line({"type": "start", "rig": yaml.safe_load(rig_text(rig)), "settings": dict(settings)})


def restore_request(saved: bytes) -> bytes:
    """Returns the request that restores a saved state."""
    return _line({"type": "restore", "state_bytes": len(saved)}) + saved


def step_request(index: int, frame: Measurement, grey: bool) -> bytes:
    """Returns the request for one frame; `index` counts the frames that this method received, from 0."""
    images = {name: as_grey(image) if grey else image for name, image in images_of(frame).items()}
    raw = [np.ascontiguousarray(image).tobytes() for image in images.values()]
    listed = [
        {
            "camera": name,
            "width": image.shape[1],
            "height": image.shape[0],
            "channels": 1 if image.ndim == 2 else image.shape[2],
            "bytes": image.nbytes,
        }
        for name, image in images.items()
    ]
    return b"".join([_line({"type": "step", "index": index, "time_ns": frame.time_ns, "images": listed}), *raw])


def _line(request: Mapping[str, Any]) -> bytes:
    return json.dumps(request, allow_nan=False).encode() + b"\n"


# The answer about one frame


MAX_TRACKS, MAX_DECISIONS = 20_000, 500
NAMES = ("status", "pose", "key_frame", "tracks", "checks", "state_bytes")
MAX_DISTANCE_M = 1e9
ENDINGS = {status.name.lower(): status for status in TrackStatus if status.dropped}
"""Reasons for the end of a track, by name."""


def read_step(
    answer: dict[str, Any],
    time_ns: int,
    checks: Mapping[str, Check],
    cameras: Mapping[str, Camera],
    before: Mapping[str, Tracks],
    ids: Mapping[str, int],
) -> Step:
    """Returns the Step, without frame and times. Raises ProgramFault for what the protocol does not allow.

    `cameras` are those of the frame. By camera, `before` has the tracks alive in the frame before it, and `ids` the
    first id that no track had.
    """
    validate.known(answer, NAMES, "an answer")
    status = Status(validate.choice(answer.get("status"), "status", tuple(Status)))
    pose = answer.get("pose")
    if pose is None and status is Status.TRACKING:
        raise ProgramFault("answers that it tracks, but with no pose")
    entries = validate.mapping(answer.get("tracks", {}), "tracks")
    validate.known(entries, cameras, "the frame")
    tracks = {
        name: _tracks(
            validate.mapping(entries.get(name, {}), "tracks"), name, camera, before.get(name), ids.get(name, 0)
        )
        for name, camera in cameras.items()
        if name in entries or name in before
    }
    return Step(
        time_ns,
        status,
        world_from_frame=None if pose is None else _pose(validate.mapping(pose, "pose")),
        key_frame=validate.boolean(answer.get("key_frame", False), "key_frame"),
        tracks=tracks,
        decisions=_decisions(validate.items(answer.get("checks", []), "checks", MAX_DECISIONS), checks),
    )


def _pose(entry: dict[str, Any]) -> Pose:
    validate.known(entry, ("translation", "rotation_xyzw"), "a pose")
    translation = _numbers(entry.get("translation"), "pose.translation", 3)
    xyzw = _numbers(entry.get("rotation_xyzw"), "pose.rotation_xyzw", 4)
    if max(map(abs, translation)) > MAX_DISTANCE_M:
        raise validate.wrong("pose.translation", translation, f"within {MAX_DISTANCE_M:g}")
    if abs(math.hypot(*xyzw) - 1) > 0.01:
        raise validate.wrong("pose.rotation_xyzw", xyzw, "of length 1")
    return Pose.from_xyzw(np.array(xyzw), np.array(translation))


def _tracks(entry: dict[str, Any], name: str, camera: Camera, before: Tracks | None, first_new: int) -> Tracks:
    """Returns the tracks of the frame, and those that ended in it, at their last positions."""
    where = f"tracks.{name}"
    validate.known(entry, ("ids", "uv", "ended"), where)
    listed = validate.items(entry.get("ids", []), f"{where}.ids", MAX_TRACKS)
    ids = [validate.count(i, f"{where}.ids", validate.LARGEST_ID) for i in listed]
    pairs = validate.items(entry.get("uv", []), f"{where}.uv", MAX_TRACKS, len(ids))
    with np.errstate(over="ignore"):  # infinite is outside of the image
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
    ended = validate.mapping(entry.get("ended", {}), f"{where}.ended")
    reasons = {key: ENDINGS[validate.choice(word, f"{where}.ended", ENDINGS)] for key, word in ended.items()}
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
    decisions: dict[tuple[str, str], Decision] = {}
    for entry in entries:
        decision = _decision(validate.mapping(entry, "a check"), checks)
        if (decision.key, decision.about) in decisions:
            raise ProgramFault(f"answers with the check {decision.key!r} twice: distinguish them by about")
        decisions[decision.key, decision.about] = decision
    return tuple(decisions.values())


def _decision(entry: dict[str, Any], checks: Mapping[str, Check]) -> Decision:
    validate.known(entry, ("key", "value", "threshold", "passed", "consequence", "about"), "a check")
    check = checks[validate.choice(entry.get("key"), "a check's key", checks)]
    value, threshold = (validate.number(entry.get(name), f"{check.key}'s {name}") for name in ("value", "threshold"))
    passed = None if "passed" not in entry else validate.boolean(entry["passed"], f"{check.key}'s passed")
    consequence = validate.text(entry.get("consequence", ""), f"{check.key}'s consequence")
    decision = check.of(value, threshold, consequence, passed)
    return replace(decision, about=validate.text(entry.get("about", ""), f"{check.key}'s about"))


def _numbers(value: Any, where: str, size: int) -> list[float]:
    return [validate.number(v, where) for v in validate.items(value, where, size, size)]
