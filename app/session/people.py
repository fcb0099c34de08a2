"""Several people at one session. One of them controls it; the others follow, or look around by themselves."""

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
    """The value of the browser's cookie; empty for a browser without cookies."""
    may_drive: bool = True


class People:
    """The people who have a page open, and who of them controls the session (drives). Used in the server's loop only.

    The first person drives until they hand over, or another who is allowed to drive takes over. A driver who closes all
    pages still drives on return (a reload), unless another person gave a command meanwhile. Meanwhile, if only one
    person who is allowed to drive has a page open, this person drives.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        """`changed` is called when the result of `seen_by` may have changed."""
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
        """Returns whether a person may give a command now. If the driver has no page open, this person becomes the
        driver."""
        if person != self._driver and person.may_drive and (self._driver is None or self._driver not in self._pages):
            self.take_over(person)
        return person == self._driver

    def take_over(self, person: Person) -> None:
        """Makes a person the driver, if that is allowed."""
        if person.may_drive:
            self._driver = person
            self._changed()

    def hand_over(self, person: Person, number: int) -> None:
        """Makes person `number` the driver, if `person` drives now, and the other is present and allowed to."""
        heir = next((p for p in self._pages if self._numbers[p.key] == number and p.may_drive), None)
        if heir is not None and person == self._at_the_wheel:
            self.take_over(heir)

    def seen_by(self, person: Person) -> dict[str, Any]:
        """Returns what a page of this person shows about the others. People have numbers from 1 on."""
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
        """Returns the driver among the people with a page open. None if the driver has none, and not exactly one other
        person is allowed to drive."""
        if self._driver in self._pages:
            return self._driver
        able = [person for person in self._pages if person.may_drive]
        return able[0] if len(able) == 1 else None

    def refusal(self, person: Person) -> str:
        """Returns the notice to a person whose command was refused, because it would change what others see."""
        driver = self._at_the_wheel
        who = "Nobody" if driver is None else f"Person {self._numbers[driver.key]}"
        cure = "; take over to change it" if person.may_drive else ""
        return f"{who} is in control of this session{cure}. You can look around: play, step, loop, and the time axis."

    def passes(self, person: Person, viser_message: bytes) -> bool:
        """Returns whether a message of a person's page may reach viser. For others than the driver, only the viewpoint
        may."""
        if person == self._driver:
            return True
        try:
            kind = msgspec.msgpack.decode(viser_message)["type"]
        except (msgspec.DecodeError, KeyError, TypeError, UnicodeDecodeError):
            return False
        return (isinstance(kind, str) and kind in LOOKING) or self.drives(person)
