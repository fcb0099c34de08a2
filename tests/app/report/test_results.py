"""The table of results: one kind of method side by side, with differences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from ispom_app.features.report.blocks import Compared, MethodName, Table
from ispom_app.features.report.folder import Run
from ispom_app.features.report.results import results

from ispom.types import Rig


def run(label: str, **metrics: dict[str, Any]) -> Run:
    return Run(Path(label), label, {}, metrics, None, Rig(), {}, None, {}, (), {})


def entry(ate_m: float | None, poses: int = 10, scale: float = 1.0, aligned: str = "se3") -> dict[str, Any]:
    times = {"median": 5.0, "p95": 9.0}
    found = {"poses": poses, "aligned": aligned, "ate_m": ate_m, "ms_per_exposure": times}
    return found | {"step_scale_end_over_start": scale}


def table(*runs: Run) -> tuple[Table, dict[str, list[Any]]]:
    found = results(list(runs))[0]
    assert isinstance(found, Table)
    return found, {str(row[0]).partition(" – ")[0]: list(row[1:]) for row in found.rows}


def test_the_columns_of_one_method_stand_together_with_differences_to_the_first_run() -> None:
    a = run("a", monocular=entry(0.5), stereo=entry(0.2))
    b = run("b", monocular=entry(0.4), stereo=entry(0.25))
    found, rows = table(a, b)
    assert [(group.head, group.span) for group in found.groups] == [
        ("", 1),
        (MethodName("monocular"), 2),
        (MethodName("stereo"), 2),
    ]
    assert list(found.head) == ["", "a", "b", "a", "b"] and found.starts == {0, 1, 3}
    ate = rows["ATE (RMS) [mm]"]
    assert [cell.value for cell in ate] == [500, 400, 200, 250], "all of a row in the unit that suits it"
    assert [None if cell.difference is None else round(cell.difference, 9) for cell in ate] == [None, -100, None, 50]


def test_words_and_single_values_have_no_difference() -> None:
    _, rows = table(run("a", stereo=entry(0.2)), run("b", stereo=entry(0.3)), run("c", monocular=entry(0.2)))
    assert rows["aligned by"] == ["se3"] * 3
    assert rows["ATE (RMS) [mm]"] == [Compared(200), Compared(300, 100), 200]


def test_times_have_a_difference() -> None:
    slow = entry(0.2) | {"ms_per_exposure": {"median": 875.0, "p95": 900.0}}
    fast = entry(0.2) | {"ms_per_exposure": {"median": 699.0, "p95": 910.0}}
    _, rows = table(run("a", stereo=slow), run("b", stereo=fast))
    assert [rows[f"time per frame, {word} [ms]"][1].difference for word in ("median", "95th percentile")] == [-176, 10]


def test_a_method_and_the_papers_are_of_one_kind() -> None:
    found, rows = table(run("a", stereo=entry(0.1)), run("b", **{"stereo.paper": entry(0.3)}))
    assert [(group.head, group.span) for group in found.groups] == [("", 1), ("stereo", 2)]
    assert list(found.head) == ["", "a: stereo", "b: stereo.paper"]
    assert rows["ATE (RMS) [mm]"][1].difference == pytest.approx(200)


def test_a_single_run_is_compared_with_nothing() -> None:
    found, rows = table(run("a", stereo=entry(None), integrated=entry(0.2)))
    assert not found.groups and list(found.head) == ["", MethodName("stereo"), MethodName("integrated")]
    assert rows["ATE (RMS) [mm]"] == [None, 200]
