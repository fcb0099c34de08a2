"""Several people at one session: one of them drives, the others follow, or look around on their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

LOOKING = frozenset({"ViewerCameraMessage"})
"""viser's messages that change nothing for others."""


@dataclass(frozen=True)
class Person:
    """One browser, whatever number of pages it has open."""

    key: str
    """What the browser's cookie says; empty for whoever keeps no cookie."""
    may_drive: bool = True


class People:
    """Who has a page open, and who drives. Used in the loop of the server alone.

    The first one drives, until they hand over, or another who may drive takes over. Somebody whose pages are all closed
    drives on when they come back (a reload), unless another gave a command meanwhile. Meanwhile the only one who is
    left of those who may, drives.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        """`changed` is called when what `seen_by` says may have changed."""
        self._changed = changed
        self._numbers: dict[str, int] = {}
        self._pages: Counter[Person] = Counter()
        self._driver: Person | None = None

    def join(self, person: Person) -> None:
        """A page of theirs was opened."""
        self._numbers.setdefault(person.key, len(self._numbers) + 1)
        self._pages[person] += 1
        if self._driver is None and person.may_drive:
            self._driver = person
        self._changed()

    def leave(self, person: Person) -> None:
        """A page of theirs was closed."""
        self._pages[person] -= 1
        self._pages += Counter()  # drops those without a page
        self._changed()

    def drives(self, person: Person) -> bool:
        """Whether they may give a command now; they drive from now on where the one who did has no page open."""
        if person != self._driver and person.may_drive and (self._driver is None or self._driver not in self._pages):
            self.take_over(person)
        return person == self._driver

    def take_over(self, person: Person) -> None:
        """They drive from now on, if they may."""
        if person.may_drive:
            self._driver = person
            self._changed()

    def hand_over(self, person: Person, number: int) -> None:
        """Person `number` drives from now on, where `person` does, and that one is there and may."""
        heir = next((p for p in self._pages if self._numbers[p.key] == number and p.may_drive), None)
        if heir is not None and person == self._at_the_wheel:
            self.take_over(heir)

    def seen_by(self, person: Person) -> dict[str, Any]:
        """What a page of theirs shows: numbers of people from 1 on."""
        others = {self._numbers[p.key]: p.may_drive for p in self._pages if p.key != person.key}
        driver = self._at_the_wheel
        return {
            "you": self._numbers[person.key],
            "may_drive": person.may_drive,
            "driving": person == driver,
            "driver": None if driver is None else self._numbers[driver.key],
            "others": [{"number": number, "may_drive": may} for number, may in sorted(others.items())],
        }

    @property
    def _at_the_wheel(self) -> Person | None:
        """Who drives of those who have a page open; None where nobody does, and several may."""
        if self._driver in self._pages:
            return self._driver
        able = [person for person in self._pages if person.may_drive]
        return able[0] if len(able) == 1 else None

    def refusal(self, person: Person) -> str:
        """The notice to somebody whose command would change what others see."""
        driver = self._at_the_wheel
        who = "Nobody" if driver is None else f"Person {self._numbers[driver.key]}"
        cure = "; take over to change it" if person.may_drive else ""
        return f"{who} is in control of this session{cure}. You can look around: play, step, loop, and the time axis."

    def passes(self, person: Person, viser_message: bytes) -> bool:
        """Whether a message of their page may reach viser: of one who does not drive, only where they look from."""
        if person == self._driver:
            return True
        try:
            kind = msgspec.msgpack.decode(viser_message)["type"]
        except (msgspec.DecodeError, KeyError, TypeError, UnicodeDecodeError):
            return False
        return (isinstance(kind, str) and kind in LOOKING) or self.drives(person)
