"""What budget.json holds."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from ispom.evaluation.budget.budget import LEVEL, Budget, Share


class ShareRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of the squared error, with its interval."""

    m2: float
    low_m2: float
    high_m2: float
    percent: float
    """Of the squared error; over 100 or negative where causes make up for each other."""


class CauseRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One cause."""

    name: str
    removed: str
    """How it was removed."""
    share: ShareRow | None
    """null where it could not be tested."""
    cannot_tell: str
    """Why it could not be tested; empty where it was."""


class BudgetRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The error of one method: the shares of all causes and the rest make ate_m squared."""

    method: str
    aligned: str
    ate_m: float
    poses: int
    causes: list[CauseRow]
    rest: ShareRow


class BudgetFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What budget.json holds."""

    level: float
    """Probability with which an interval contains the true share."""
    methods: list[BudgetRow]


def written(found: Iterable[Budget]) -> BudgetFile:
    """Returns what budget.json holds."""
    return BudgetFile(
        LEVEL,
        [
            BudgetRow(
                each.method,
                each.alignment,
                each.ate_m,
                each.poses,
                [CauseRow(c.name, c.removed, _share(each, c.share), c.unknown) for c in each.causes],
                _row(each, each.rest),
            )
            for each in found
        ],
    )


def _share(found: Budget, share: Share | None) -> ShareRow | None:
    return None if share is None else _row(found, share)


def _row(found: Budget, share: Share) -> ShareRow:
    return ShareRow(share.value_m2, share.low_m2, share.high_m2, percent_of(found, share.value_m2))


def percent_of(found: Budget, value_m2: float) -> float:
    """Returns the percentage of the squared error."""
    return 100 * value_m2 / found.ate_m**2 if found.ate_m > 0 else 0.0
