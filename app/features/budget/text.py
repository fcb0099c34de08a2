"""A budget in words, as JSON, and the schema of that."""

from __future__ import annotations

import json
from collections.abc import Iterable

import msgspec

from ispom.evaluation.budget.budget import LEVEL, Budget, Share

from ...presentation.texts import length, length_unit


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


def plain(found: Iterable[Budget]) -> BudgetFile:
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


def json_of(found: Iterable[Budget]) -> str:
    """Returns the text of budget.json."""
    return json.dumps(msgspec.to_builtins(plain(found)), indent=2, allow_nan=False) + "\n"


def schema() -> str:
    """Returns the JSON schema of budget.json."""
    return json.dumps(msgspec.json.schema(BudgetFile), indent=2) + "\n"


def title(found: Budget) -> str:
    """Returns the heading of a method's budget."""
    ate = length(found.ate_m, length_unit([found.ate_m]))
    return f"{found.method}: ATE {ate} ({found.alignment}, {found.poses} poses); shares of its square"


def rows(found: Budget) -> list[tuple[str, str, str, str]]:
    """Returns cause, share, interval, and how it was removed: the largest first, then what cannot be told, and the
    rest."""
    tested = [cause for cause in found.causes if cause.share is not None]
    tested.sort(key=lambda cause: -cause.share.value_m2 if cause.share is not None else 0.0)
    table = [(c.name, *_cells(found, c.share), c.removed) for c in tested if c.share is not None]
    table += [(c.name, "cannot tell", "", c.unknown) for c in found.causes if c.share is None]
    return [*table, ("rest", *_cells(found, found.rest), "what no cause explains, and what causes do to each other")]


def _cells(found: Budget, share: Share) -> tuple[str, str]:
    row = _row(found, share)
    limits = [_percent(found, limit) for limit in (share.low_m2, share.high_m2)]
    return f"{row.percent:.0f} %", f"{limits[0]:.0f} to {limits[1]:.0f} %"


def _share(found: Budget, share: Share | None) -> ShareRow | None:
    return None if share is None else _row(found, share)


def _row(found: Budget, share: Share) -> ShareRow:
    return ShareRow(share.value_m2, share.low_m2, share.high_m2, _percent(found, share.value_m2))


def _percent(found: Budget, value_m2: float) -> float:
    return 100 * value_m2 / found.ate_m**2 if found.ate_m > 0 else 0.0
