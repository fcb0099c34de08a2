"""`python -m tests.accuracy budget`: whether `ispom budget` gives causes their shares, where these are known.

Causes are planted in sim:tiny, alone and in pairs. The true share of one is by how much the squared error falls in a
run in which exactly this one is not planted, with everything else the same.
`python -m tests.accuracy.budget '{...}'` prints the shares of one case as one line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ispom_app.features.budget.bench import Bench
from ispom_app.features.budget.split import budgets
from rich.console import Console

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.methods import Config, with_dependencies
from ispom.sequences import open_sequence
from ispom.simulation.scenario.scenario import fault_of_words
from ispom.types import Sequence

REPEATS = 3
NOTICED = 0.05
"""A planted cause counts where its true share is at least this part of the squared error: a cause that a method hardly
feels is found by any interval around nothing."""
ONE, PAIR, BOTH = ("monocular",), ("stereo",), ("integrated",)
ALONE = (*ONE, *PAIR)
CASES: tuple[tuple[int, tuple[str, ...], Mapping[str, str]], ...] = (
    (20, PAIR, {"calibration": "wrong-baseline:percent=2"}),
    (21, PAIR, {"calibration": "wrong-baseline:percent=-4"}),
    (22, ONE, {"calibration": "wrong-lens:focal_percent=2"}),
    (23, ONE, {"calibration": "wrong-lens:focal_percent=-3"}),
    (24, PAIR, {"calibration": "wrong-pair:yaw_deg=0.2"}),
    (25, BOTH, {"calibration": "wrong-mount:yaw_deg=2"}),
    (20, BOTH, {"clock": "clock:late_s=0.02"}),
    (21, BOTH, {"clock": "clock:late_s=-0.03"}),
    (22, ALONE, {"noise": "noise:sigma=8"}),
    (23, ALONE, {"noise": "noise:sigma=15"}),
    (24, ALONE, {"outliers": "object"}),
    (25, ALONE, {"outliers": "object:width_percent=40,height_percent=50"}),
    (20, ONE, {"initial map": "noise:sigma=30,until_s=0.3"}),
    (21, ONE, {"initial map": "motion-blur:until_s=0.3"}),
    (22, BOTH, {"calibration": "wrong-baseline:percent=3", "clock": "clock:late_s=0.02"}),
    (23, PAIR, {"calibration": "wrong-lens:camera=stereo,focal_percent=2", "noise": "noise:sigma=10"}),
    (24, BOTH, {"clock": "clock:late_s=0.03", "noise": "noise:sigma=8"}),
    (25, ONE, {"calibration": "wrong-lens:focal_percent=2", "outliers": "object"}),
    (20, PAIR, {"calibration": "wrong-baseline:percent=-2", "outliers": "object"}),
    (21, BOTH, {"calibration": "wrong-mount:yaw_deg=1.5", "clock": "clock:late_s=0.02"}),
)
"""The seed of the simulation, the methods, and the fault of each planted cause."""


@dataclass(frozen=True)
class Found:
    """A planted cause, as one method feels it."""

    case: int
    method: str
    cause: str
    fault: str
    ate_m: float
    true_m2: float | None
    """None where a run has too few poses."""
    share_m2: float | None
    """None where the budget cannot tell."""
    low_m2: float | None = None
    high_m2: float | None = None

    @property
    def noticed(self) -> bool:
        """Whether the method feels it."""
        return self.true_m2 is not None and abs(self.true_m2) >= NOTICED * self.ate_m**2

    @property
    def contained(self) -> bool | None:
        """Whether the interval contains the true share; None where there is none."""
        if self.true_m2 is None or self.low_m2 is None or self.high_m2 is None:
            return None
        return self.low_m2 <= self.true_m2 <= self.high_m2


def planted(seed: int, faults: Mapping[str, str], but: str = "") -> Sequence:
    """Returns the simulation with these faults but one; what the rig states of its accuracy is that with all."""
    sequence = open_sequence("sim:tiny", seed=seed)
    for cause, words in faults.items():
        sequence = fault_of_words(words).on(sequence, seed) if cause != but else sequence
    if not but:
        return sequence
    stated = planted(seed, faults).rig
    return replace(sequence, rig=sequence.rig.changed(pair_sigma=stated.pair_sigma, video_sigma=stated.video_sigma))


def tried(case: int, repeats: int = REPEATS) -> Iterator[Found]:
    """Yields the planted causes of a case by method."""
    seed, methods, faults = CASES[case]
    bench = Bench(planted(seed, faults), with_dependencies(methods), Config(), build, lambda: None)
    unchanged = bench.errors(bench.sequence)
    exact = {cause: bench.errors(planted(seed, faults, cause)) for cause in faults}
    for budget in budgets(bench, repeats, methods):
        for cause, fault in faults.items():
            share = next(each.share for each in budget.causes if each.name == cause)
            without = exact[cause].get(budget.method)
            true = None if without is None else unchanged[budget.method].ate_m ** 2 - without.ate_m**2
            limits = (None, None, None) if share is None else (share.value_m2, share.low_m2, share.high_m2)
            yield Found(case, budget.method, cause, fault, budget.ate_m, true, *limits)


def print_budgets(console: Console, found: list[Found]) -> None:
    """How often intervals contain the true share, by cause, and each that does not."""
    console.print(markdown(found))


def markdown(found: list[Found]) -> str:
    """Returns the table of the documentation, and a line for each interval that misses."""
    felt = [each for each in found if each.noticed]
    lines = [
        "| planted cause | intervals with the true share | half width, median | cannot tell |",
        "| --- | --- | --- | --- |",
    ]
    for cause in dict.fromkeys(each.cause for each in found):
        lines.append(_row(cause, [each for each in felt if each.cause == cause]))
    lines += [_row("all", felt), ""]
    lines += [
        f"- case {each.case}, {each.method}, {each.cause} ({each.fault}): {_percent(each.share_m2, each)} % of the "
        f"squared error ({_percent(each.low_m2, each)} to {_percent(each.high_m2, each)}); true are "
        f"{_percent(each.true_m2, each)} %"
        for each in felt
        if each.contained is False
    ]
    return "\n".join(lines).rstrip()


def _row(name: str, found: list[Found]) -> str:
    known = [each for each in found if each.contained is not None]
    widths = sorted((each.high_m2 - each.low_m2) / 2 / each.ate_m**2 for each in known)  # type: ignore[operator]
    middle = f"{100 * widths[len(widths) // 2]:.0f} % of the squared error" if widths else ""
    held = sum(each.contained is True for each in known)
    return f"| {name} | {held} of {len(known)} | {middle} | {len(found) - len(known)} |"


def _percent(value_m2: float | None, found: Found) -> str:
    return "-" if value_m2 is None else f"{100 * value_m2 / found.ate_m**2:.0f}"


BEGIN, END = "<!-- python -m tests.accuracy budget: begin -->", "<!-- python -m tests.accuracy budget: end -->"


def write_budgets(page: Path, found: list[Found]) -> None:
    """Replaces what stands between the marks of a page of the documentation."""
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"{page} has no lines '{BEGIN}' and '{END}'")
    page.write_text(f"{before}{BEGIN}\n\n{markdown(found)}\n\n{END}{after}", encoding="utf-8")


def budgets_found(rows: list[dict[str, Any]]) -> list[Found]:
    """What a process printed."""
    return [Found(**row) for row in rows]


def main(argument: str) -> None:
    task = json.loads(argument)
    sys.stdout.write(json.dumps([asdict(each) for each in tried(task["case"])]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
