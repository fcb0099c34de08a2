"""Checks that a run can start, by reading its first images when the source is opened."""

from __future__ import annotations

from ispom.errors import InputError, UnreadableImage
from ispom.types import Sequence

MAX_UNREADABLE_SHARE = 0.01
"""Largest share of unreadable frames of a run, which are skipped."""


def require_readable(sequence: Sequence) -> None:
    """Raises InputError where a run would end before the first image of each kind.

    The reason is an unusable image, as one with an unknown encoding, or more unreadable images than a run skips.
    """
    skipped: set[int] = set()
    for kind in sorted(set(sequence.kinds)):
        for i in (i for i, each in enumerate(sequence.kinds) if each == kind):
            try:
                sequence.load(i)
                break
            except UnreadableImage as fault:
                skipped.add(i)
                if len(skipped) > MAX_UNREADABLE_SHARE * len(sequence):
                    raise InputError(fault.args[0]) from None
