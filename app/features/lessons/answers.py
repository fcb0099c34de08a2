"""What people answer to the question of a lesson: each for themselves, whoever drives.

Used in the loop of the server alone.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from .reveal import Answer, accepted, is_right
from .state import Learning


class Answers:
    """Of the latest question only."""

    def __init__(self) -> None:
        self._question: tuple[str, int] | None = None
        self._answers: dict[str, Answer] = {}
        self.version = 0
        """Counts the answers so far."""

    def put(self, person: str, learning: Learning | None, content: Any) -> bool:
        """By the key of a person. Returns whether there is another answer now: not where the question is not open, or
        that is no answer to it."""
        if learning is None or learning.phase != "asking":
            return False
        tracks = learning.pictured[1].ids.tolist() if learning.pictured is not None else ()
        answer = accepted(learning.step.ask, content, tracks)
        if answer is not None:
            self._answers = {**self._of(learning), person: answer}
            self._question = _question(learning)
            self.version += 1
        return answer is not None

    def seen_by(self, person: str, learning: Learning) -> dict[str, Any]:
        """Their own answer, and how many there are; once the answer is revealed, how many are right, and of a choice
        how many chose which."""
        answers, found = self._of(learning), learning.revealed
        yours = answers.get(person)
        seen: dict[str, Any] = {"yours": yours, "answered": len(answers), "right": None, "verdict": None, "chosen": {}}
        if found is not None:
            ask = learning.step.ask
            seen["right"] = sum(is_right(ask, found, answer) for answer in answers.values())
            seen["verdict"] = None if yours is None else is_right(ask, found, yours)
            seen["chosen"] = Counter(answer for answer in answers.values() if isinstance(answer, int))
        return seen

    def _of(self, learning: Learning) -> dict[str, Answer]:
        return self._answers if self._question == _question(learning) else {}


def _question(learning: Learning) -> tuple[str, int]:
    return learning.lesson.name, learning.place
