"""A/B flicker: a frame with what one side says of it, and at a key press with what the other one says."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from ispom.errors import InputError

from ..branches.branches import Branch


@dataclass(frozen=True)
class Side:
    """A method in a branch."""

    branch: int
    method: str


@dataclass(frozen=True)
class Flicker:
    """Two of them, of which one is drawn."""

    a: Side
    b: Side
    on_b: bool = False

    @property
    def shown(self) -> Side:
        return self.b if self.on_b else self.a

    @property
    def turned(self) -> Flicker:
        """With the other side drawn."""
        return replace(self, on_b=not self.on_b)


def sides(branches: Iterable[Branch], methods_of: Callable[[int], tuple[str, ...]]) -> tuple[Side, ...]:
    """All that there are."""
    return tuple(Side(branch.number, method) for branch in branches for method in methods_of(branch.number))


def usual(found: tuple[Side, ...], shown: int) -> Flicker:
    """The first method of the shown branch with itself in the newest other branch, or else with the next method.

    InputError where there is only one.
    """
    own = [side for side in found if side.branch == shown]
    same = [(a, b) for a in own for b in found if b.branch != shown and b.method == a.method]
    if same:
        newest = max(b.branch for _, b in same)
        return Flicker(*next((a, b) for a, b in same if b.branch == newest))
    if len(own) < 2:
        raise InputError("there is nothing to flicker between: run two methods, or fork a branch")
    return Flicker(own[0], own[1])


def between(found: tuple[Side, ...], a: Side, b: Side) -> Flicker:
    """InputError where it is one side, or one of them is not there."""
    if a == b:
        raise InputError("both sides are the same: choose another method or branch for one of them")
    if missing := next((side for side in (a, b) if side not in found), None):
        raise InputError(f"branch {missing.branch} has no {missing.method}: choose another side")
    return Flicker(a, b)
