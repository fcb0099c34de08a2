"""What a program says about itself when it is greeted."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from ispom.estimators.program import plain
from ispom.estimators.program.pipe import Pipe, ProgramFault
from ispom.types import Check, DecisionKind, FrameName

VERSION = 1
HELLO = json.dumps({"type": "hello", "version": VERSION}).encode() + b"\n"
MOST_CHECKS = 200
KEY = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_NAMES = ("version", "saves", "frame", "unit", "grey", "source", "checks")


@dataclass(frozen=True)
class Description:
    """See examples/external_program/README.md for each."""

    saves: bool
    frame: FrameName
    unit: Literal["metric", "own"]
    grey: bool
    source: str
    checks: Mapping[str, Check]


def greeted(pipe: Pipe) -> Description:
    """The first exchange with a program; ProgramFault where its answer is none."""
    answer = pipe.ask(HELLO)
    plain.known(answer, _NAMES, "the answer to hello")
    if answer.get("version") != VERSION:
        raise ProgramFault(f"speaks version {str(answer.get('version'))[:20]} of the protocol, not {VERSION}")
    return Description(
        saves=plain.boolean(answer.get("saves", False), "saves"),
        frame=plain.choice(answer.get("frame"), "frame", ("rig", "video", "left")),
        unit=plain.choice(answer.get("unit"), "unit", ("metric", "own")),
        grey=plain.boolean(answer.get("grey", False), "grey"),
        source=plain.text(answer.get("source", "a program of its own"), "source"),
        checks=_checks(plain.items(answer.get("checks", []), "checks", MOST_CHECKS)),
    )


def _checks(entries: list[Any]) -> dict[str, Check]:
    found: dict[str, Check] = {}
    for entry in entries:
        check = _check(plain.mapping(entry, "a check"))
        if check.key in found:
            raise ProgramFault(f"describes two checks {check.key!r}")
        found[check.key] = check
    return found


def _check(entry: dict[str, Any]) -> Check:
    plain.known(entry, ("key", "name", "kind", "question", "relation", "unit"), "a check's description")
    key = plain.text(entry.get("key"), "a check's key")
    if not KEY.fullmatch(key):
        raise plain.wrong("a check's key", key, "small letters, digits and single underscores")
    kind = plain.choice(entry.get("kind", "requirement"), "a check's kind", get_args(DecisionKind))
    question = plain.text(entry.get("question", ""), "a check's question")
    if (question and not question.endswith("?")) or (kind == "trigger" and not question):
        raise plain.wrong("a check's question", question, "a question, as every trigger has one")
    name = plain.text(entry.get("name"), "a check's name")
    if not name:
        raise plain.wrong("a check's name", name, "words")
    relation = plain.choice(entry.get("relation", ">="), "a check's relation", (">=", "<=", ">", "<"))
    return Check(key, name, kind, question, relation, plain.text(entry.get("unit", ""), "a check's unit"))
