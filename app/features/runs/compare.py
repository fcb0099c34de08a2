"""What the mode Compare shows of two runs of the session: errors, the first differences, and how far they are apart."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ispom.geometry import Array
from ispom.methods import method as registered
from ispom.methods import names

from ...engine.history.series import Series
from ...presentation import colours
from ...presentation.texts import length
from ...session.accuracy import over_common_frames
from ...session.current_run import CurrentRun
from ...session.state import State
from ..branches.comparison import Comparison
from ..diff.compare import DIGEST, POSITION, Difference, Divergence
from ..diff.text import distinct
from .table import Row, table_message

MOST_LINES = 4
"""Differences that are listed of one frame."""
MOST_POINTS = 600
"""Of a curve; of more frames each point is the largest of several."""


def comparison_message(
    state: State, comparison: Comparison, rows: Mapping[int, Row], run_of: Callable[[int], CurrentRun | None]
) -> dict[str, Any]:
    """`rows` has the rows of the session's runs by the number of their branch. The curves are in the methods' units."""
    numbers = (comparison.shown, comparison.other)
    runs = [run_of(number) for number in numbers]
    branches = [b for number in numbers for b in state.branches if b.number == number]
    common = over_common_frames(branches)
    found = [{"label": colours.label(m), "a": _text(common, numbers[0], m), "b": _text(common, numbers[1], m)}
             for m in comparison.methods if (numbers[0], m) in common]  # fmt: skip
    a, b = runs
    curves = [] if a is None or b is None else list(distances(a.series, b.series, comparison.methods))
    return table_message(list(rows.values())) | {
        "branches": {number: row.key for number, row in rows.items()},
        "numbers": numbers,
        "common": found,
        "first": [divergence_message(each) for each in comparison.first if plain(each)],
        "frames": [comparison.start, comparison.stop - 1],
        "done": comparison.done - comparison.start,
        "finished": comparison.finished,
        "apart": comparison.apart,
        "curves": curves,
        "total": state.total,
    }


def _text(common: Any, number: int, method: str) -> str:
    return length(common[number, method].ate_m)


def plain(divergence: Divergence) -> list[Difference]:
    """The differences that a person can read: no digests."""
    return [each for each in divergence.differences if not each.name.endswith(DIGEST)]


def divergence_message(divergence: Divergence) -> dict[str, Any]:
    """The frame, its time, and a line for each of the first differences."""
    found = plain(divergence)
    lines = [_line(each) for each in found[:MOST_LINES]]
    return {"frame": divergence.exposure, "lines": lines, "more": len(found) - len(lines)}


def _line(difference: Difference) -> str:
    """`Monocular new tracks: 0 vs 147 (Δ 147)`."""
    if difference.name.endswith(POSITION) and difference.by is not None:
        method = difference.name.removesuffix(f".{POSITION}")
        apart = length(difference.by) if registered(method).unit == "metric" else f"{difference.by:.3g} (own unit)"
        return f"{colours.label(method)} position: {apart} apart"
    method = next((m for m in _prefixes(difference.name) if m in names()), difference.name.partition(".")[0])
    key = difference.name.removeprefix(f"{method}.").replace("_", " ").replace(".", " ")
    a, b = distinct(difference.a, difference.b)
    by = "" if difference.by is None else f" (Δ {difference.by:.3g})"
    return f"{colours.label(method)} {key}: {a} vs {b}{by}"


def _prefixes(name: str) -> Iterator[str]:
    """Of `a.b.c`: `a.b`, `a`."""
    while "." in name:
        name = name.rpartition(".")[0]
        yield name


def distances(a: Series, b: Series, methods: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    """By method, the distance between the positions that the two runs gave at each frame, as given then."""
    count = min(len(a), len(b))
    for method in methods:
        xyz = [_positions(series, method, count) for series in (a, b)]
        apart = np.linalg.norm(xyz[0] - xyz[1], axis=1)
        if not np.isfinite(apart).any():
            continue
        width = -(-count // MOST_POINTS)
        filled = np.concatenate([apart, np.full(-count % width, np.nan)]).reshape(-1, width)
        values = np.fmax.reduce(filled, axis=1)
        yield {
            "label": colours.label(method),
            "colour": colours.css(colours.of(method)),
            "unit": "m" if registered(method).unit == "metric" else "",
            "step": width,
            "values": [None if np.isnan(value) else float(f"{value:.6g}") for value in values.tolist()],
        }


def _positions(series: Series, method: str, count: int) -> Array:
    """(N, 3) at the frames at which the method stepped, else NaN."""
    found = np.full((count, 3), np.nan)
    for i, key in enumerate("xyz"):
        if f"{method}.{key}" in series.quantities:
            frames, values = series.said(f"{method}.{key}", count)
            found[frames, i] = values
    return found
