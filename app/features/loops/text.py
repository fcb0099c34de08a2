"""Candidates and answers for people."""

from __future__ import annotations

from collections.abc import Sequence

from ispom.errors import counted
from ispom.methods import method as registered

from .candidate import Candidate, Side, WhatIf
from .docket import Docket


def lines(shown: Sequence[Candidate], what_if: Sequence[WhatIf], docket: Docket, has_truth: bool) -> list[str]:
    """What the command prints: how many there are, those with images, and what if."""
    found = [summary(docket), *(f"  {decided}" for decided in refusals(docket))]
    found += [one for each in shown for one in _candidate(each, has_truth)]
    return found + [one for each in what_if for one in answer_lines(each)]


def summary(docket: Docket) -> str:
    """How many candidates there were of each kind, in one line."""
    counts = [f"{number} {key.replace('.', ' ')}" for key, number in sorted(docket.counts.items())]
    return f"{counted(docket.counts.total(), 'candidate')}: {', '.join(counts) or 'nothing was compared'}"


def refusals(docket: Docket) -> list[str]:
    """Which rules decided, the most frequent one first."""
    return [f"{number} decided by {key}" for key, number in docket.decided_by.most_common()]


def _candidate(each: Candidate, has_truth: bool) -> list[str]:
    asked = " as asked" if each.as_asked else ""
    return [
        f"{each.kind} {each.pair} of {each.method}: {each.verdict}{asked}: {each.decision}"
        + (f" {truth_text(each)}" if has_truth and each.pose is not None else "")
    ]


def truth_text(each: Candidate) -> str:
    """Whether its relative pose is right; empty where nobody knows."""
    if each.truth is None:
        return ""
    t = each.truth
    verdict = "Its relative pose is right" if t.right else "Its relative pose is wrong"
    return f"{verdict}: off by {t.position_error_m:.3g} m and {t.turn_error_deg:.2g}°."


def answer_lines(each: WhatIf) -> list[str]:
    """What would have come of the opposite decision."""
    unit = "m" if registered(each.method).unit == "metric" else "units"
    verb = {"refuse": "refused", "accept": "accepted"}[each.asked]
    head = f"What if {', '.join(each.pairs)} were {verb} ({each.setting}):"
    if not each.carried_out:
        why = "it has no relative pose" if each.asked == "accept" else "nothing was proposed then"
        return [head, f"  This cannot be: {why}."]
    if each.first_different_frame is None:
        return [head, "  Nothing differs."]
    return [
        head,
        f"  The runs differ from frame {each.first_different_frame} on (fork after frame {each.from_frame - 1}).",
        f"  The final paths are up to {each.largest_shift:.3g} {unit} apart, at frame {each.shift_at_frame}.",
        f"  as it was: {side_text(each.as_it_was, unit)}",
        f"  otherwise: {side_text(each.otherwise, unit)}",
    ]


def side_text(side: Side, unit: str) -> str:
    """The end of one run; `unit` is that of the method's world."""
    found = [f"ATE {side.ate_m:.4g} m"] if side.ate_m is not None else []
    if side.closing_distance is not None:
        found.append(
            f"off the candidate's pose by {side.closing_distance:.3g} {unit} and {side.closing_turn_deg or 0:.2g}°"
        )
    return "; ".join([*found, f"accepted from there on: {', '.join(side.closed) or 'none'}"])
