"""What a submission's process does: it loads the package, checks the contract, and steps the method."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from typing import Any

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.methods import Config, method
from ispom.testing import check_estimator

from .load import methods_of
from .messages import HEAD, Listed, merged, step_answer, trajectory_answer


def serve(requests: int, answers: int) -> None:
    """Answers requests until there are no more."""
    submission = Submission()
    while head := _read(requests, HEAD.size):
        name, arguments = pickle.loads(_read(requests, HEAD.unpack(head)[0]))  # noqa: S301 (of the grader alone)
        os.set_inheritable(answers, False)
        _write(answers, merged(_answer(getattr(submission, name), arguments)))


class Submission:
    """The method that is graded, and its state."""

    def __init__(self) -> None:
        self._ensemble: Any = None
        self._state: Any = None
        self._name = ""

    def load(self, package: str, chosen: tuple[str, ...]) -> dict[str, Any]:
        return {"methods": [Listed(name, method(name).unit) for name in methods_of(package, chosen)]}

    def contract(self, name: str) -> dict[str, Any]:
        try:
            check_estimator(name)
        except AssertionError as violation:
            return {"failure": str(violation)}
        return {}

    def start(self, name: str, rig: Any) -> dict[str, Any]:
        self._ensemble, self._name = build(Config(), (name,), rig), name
        self._state = self._ensemble.start()
        return {}

    def step(self, measurement: Any) -> dict[str, Any]:
        self._state, steps = self._ensemble.step(self._state, measurement)
        return {"steps": [step_answer(step) for step in steps]}

    def finish(self) -> dict[str, Any]:
        return {"trajectory": trajectory_answer(self._ensemble.finish(self._state)[self._name])}


def _answer(request: Callable[..., dict[str, Any]], arguments: tuple[Any, ...]) -> dict[str, Any]:
    try:
        return request(*arguments)
    except InputError as mistake:
        return {"mistake": str(mistake)}
    except Exception as fault:
        return {"failure": f"{type(fault).__name__}: {fault}"}


def _read(file: int, count: int) -> bytes:
    """Returns the next `count` bytes; fewer at the end of the file."""
    parts, left = [], count
    while left and (some := os.read(file, min(left, 1 << 20))):
        parts.append(some)
        left -= len(some)
    return b"".join(parts)


def _write(file: int, content: bytes) -> None:
    view = memoryview(content)
    while view:
        view = view[os.write(file, view) :]
