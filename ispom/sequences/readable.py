"""Whether a run can begin: the images that it would read first are read when its source is opened."""

from __future__ import annotations

from ispom.errors import InputError, UnreadableImage
from ispom.types import Sequence

UNREADABLE_SHARE = 0.01
"""Of the frames of a run, so many may be unreadable; they are skipped."""


def require_readable(sequence: Sequence) -> None:
    """InputError where a run would end before the first image of each kind.

    That is by one that cannot be used, such as of an unknown encoding, or by more unreadable ones than a run skips.
    """
    skipped: set[int] = set()
    for kind in sorted(set(sequence.kinds)):
        for i in (i for i, each in enumerate(sequence.kinds) if each == kind):
            try:
                sequence.load(i)
                break
            except UnreadableImage as fault:
                skipped.add(i)
                if len(skipped) > UNREADABLE_SHARE * len(sequence):
                    raise InputError(fault.args[0]) from None
