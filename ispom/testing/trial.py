"""A method under test, stepped frame by frame; failures are sentences about the method."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NoReturn

from ispom.ensemble import Member
from ispom.estimator import Method
from ispom.methods import method as registered
from ispom.methods import with_dependencies
from ispom.testing.flight import flight, flight_rig
from ispom.testing.values import digest
from ispom.types import Measurement, Rig, Sequence, Step, Trajectory, images_of
from ispom.types.measurements import CAMERAS


@dataclass(frozen=True, eq=False)
class Numbered:
    """A frame, and its name in messages."""

    frame: Measurement
    place: str
    """Such as "frame 12", "frame 12 without texture"."""

    def like(self, exposure: Measurement, how: str) -> Numbered:
        """Returns another frame instead of this one."""
        return Numbered(exposure, f"{self.place} {how}")


@dataclass(frozen=True, eq=False)
class Trial:
    """The method, its settings, and the frames of the test."""

    method: Method
    settings: Any
    rig: Rig
    frames: tuple[Numbered, ...]
    """The frames that the method uses."""

    @staticmethod
    def of(method: Method, settings: Any, sequence: Sequence | None) -> Trial:
        """Takes the frames of a sequence, or of a simulated flight past balls."""
        at_once = CAMERAS in method.sensors
        rig = flight_rig(at_once) if sequence is None else sequence.rig
        measurements = flight(rig, at_once) if sequence is None else (sequence[i] for i in range(len(sequence)))
        used = tuple(Numbered(e, f"frame {i}") for i, e in enumerate(measurements) if method.uses(e))
        with failing_as(method, "cannot make its default settings"):
            chosen = method.config() if settings is None else settings
        return Trial(method, chosen, rig, used)

    def build(self, settings: Any = None, rig: Rig | None = None) -> Built:
        """Builds an estimator with these settings, and those that it depends on with their defaults."""
        rig = rig or self.rig
        members = {
            n: Member(m := registered(n), m.config().build(rig)) for n in with_dependencies(self.method.asks.values())
        }
        with failing_as(self.method, "cannot be built"):
            members[self.method.name] = Member(self.method, (settings or self.settings).build(rig))
        return Built(self.method, members)

    def fail(self, what: str, place: str = "") -> NoReturn:
        fail(self.method, what, place)

    def require(self, condition: object, what: str, place: str = "") -> None:
        """Raises AssertionError with a sentence about the method unless the contract is kept."""
        if not condition:
            self.fail(what, place)


@dataclass(frozen=True, eq=False)
class Built:
    """An estimator and those that it depends on, stepped together; the state holds all States by name."""

    method: Method
    members: Mapping[str, Member]

    def start(self) -> dict[str, Any]:
        return {name: member.estimator.start() for name, member in self.members.items()}

    def step(self, state: Mapping[str, Any], numbered: Numbered) -> tuple[dict[str, Any], Step]:
        after, steps, measurement = dict(state), dict[str, Step](), numbered.frame
        images, before = _images(measurement), [image.copy() for image in _images(measurement)]
        for name, member in self.members.items():
            if member.method.uses(measurement):
                with failing_as(self.method, "cannot step", numbered.place):
                    after[name], step = member.estimator.step(after[name], measurement, *member.inputs(steps))
                    steps[name] = replace(step, method=name)
        if any((now != then).any() for now, then in zip(images, before, strict=True)):
            fail(self.method, "writes into the images that it is given", numbered.place)
        return after, steps[self.method.name]

    def finish(self, state: Mapping[str, Any], place: str) -> Trajectory:
        trajectories = dict[str, Trajectory]()
        for name, member in self.members.items():
            with failing_as(self.method, "cannot finish after", place):
                trajectories[name] = member.estimator.finish(state[name], *member.inputs(trajectories))
        return trajectories[self.method.name]


@dataclass(frozen=True, eq=False)
class Walk:
    """A whole run, with all intermediate States."""

    built: Built
    states: tuple[dict[str, Any], ...]
    """One more than there are frames."""
    digests: tuple[bytes, ...]
    """Digests of the states when they were made."""
    steps: tuple[Step, ...]


def walked(built: Built, frames: Iterable[Numbered], state: Mapping[str, Any] | None = None) -> Walk:
    """Steps through all frames, from the start or from a state."""
    states, steps = [dict(built.start() if state is None else state)], list[Step]()
    digests = [_digest(built, states[0], "the start")]
    for numbered in frames:
        after, step = built.step(states[-1], numbered)
        states.append(after)
        steps.append(step)
        digests.append(_digest(built, after, numbered.place))
    return Walk(built, tuple(states), tuple(digests), tuple(steps))


@contextmanager
def failing_as(method: Method, what: str, place: str = "") -> Iterator[None]:
    """Turns any exception into a failure of the method."""
    try:
        yield
    except Exception as fault:
        raise AssertionError(_sentence(method, f"{what} ({type(fault).__name__}: {fault})", place)) from fault


def fail(method: Method, what: str, place: str = "") -> NoReturn:
    """Raises AssertionError with a sentence about the method."""
    raise AssertionError(_sentence(method, what, place))


def _sentence(method: Method, what: str, place: str) -> str:
    return f"{method.name} {what}, at {place}" if place else f"{method.name} {what}"


def _digest(built: Built, state: Any, place: str) -> bytes:
    with failing_as(built.method, "has a State that is not made of plain values", place):
        return digest(state)


def _images(measurement: Measurement) -> list[Any]:
    return list(images_of(measurement).values())
