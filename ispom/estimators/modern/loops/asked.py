"""Loops that a person refuses or accepts by hand, to see the effect."""

from __future__ import annotations

from dataclasses import dataclass

from ispom.errors import InputError

Pair = tuple[int, int]
"""Times [ns] of the earlier keyframe and of the later one."""


@dataclass(frozen=True)
class Asked:
    """Loops, and joins of segments, that are decided by the settings."""

    refused: frozenset[Pair] = frozenset()
    accepted: frozenset[Pair] = frozenset()

    @staticmethod
    def of(refused: str, accepted: str) -> Asked:
        """Raises InputError for texts that are no lists of pairs of times, or that have one pair in common."""
        found = Asked(_pairs(refused, "refuse_loops"), _pairs(accepted, "accept_loops"))
        if both := found.refused & found.accepted:
            raise InputError(f"refuse_loops and accept_loops both have {pair_text(min(both))}: give it once")
        return found

    def accepted_with(self, then_ns: int) -> tuple[int, ...]:
        """Returns the times of the earlier keyframes with which a keyframe is to close a loop."""
        return tuple(sorted(first for first, then in self.accepted if then == then_ns))


NOTHING_ASKED = Asked()


def pair_text(pair: Pair) -> str:
    """Returns a pair as the settings have it: EARLIER-LATER [ns]."""
    return f"{pair[0]}-{pair[1]}"


def _pairs(text: str, name: str) -> frozenset[Pair]:
    found = set[Pair]()
    for part in filter(None, (each.strip() for each in text.split(","))):
        first, _, then = part.partition("-")
        if not (first.isdecimal() and then.isdecimal() and int(first) < int(then)):
            raise InputError(
                f"{name} has {part[:60]!r}: give pairs of times in nanoseconds, the earlier one first, as in "
                "1200000000-34000000000"
            )
        found.add((int(first), int(then)))
    return frozenset(found)
