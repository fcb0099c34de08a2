"""The mode Compare, of two runs of the session: errors, first differences, and distances of their positions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.methods import method as registered
from ispom.methods import names
from ispom.types import Trajectory

from ...engine.differences.compare import DIGEST, POSITION, Difference, Divergence
from ...engine.history.series import Series
from ...presentation import colours
from ...presentation.texts import ALIGNED, length
from ...session.current_run import CurrentRun
from ...session.state import State
from ..branches.accuracy import over_common_frames
from ..branches.branches import Branch
from ..branches.comparison import Comparison
from ..branches.state import Branches
from ..diff.text import distinct
from .table import Row, table_message

WORDS = {"new": "new tracks", "alive": "tracks that go on", "revised": "revised poses", "seconds": "computing time"}
"""What quantities are called, where their key says too little."""
MOST_LINES = 4
"""Differences that are listed of one frame."""
MOST_POINTS = 600
"""Of a curve; of more frames each point is the largest of several."""


def comparison_message(
    state: State, comparison: Comparison, rows: Mapping[int, Row], run_of: Callable[[int], CurrentRun | None]
) -> dict[str, Any]:
    """`rows` has the rows of the session's runs by the number of their branch."""
    numbers = (comparison.shown, comparison.other)
    runs = [run_of(number) for number in numbers]
    branches = [b for number in numbers for b in state[Branches].all if b.number == number]
    common = over_common_frames(branches)
    found = [{"label": colours.label(m), "a": _text(common, numbers[0], m), "b": _text(common, numbers[1], m)}
             for m in comparison.methods if (numbers[0], m) in common]  # fmt: skip
    there = [run for run in runs if run is not None]
    curves = (
        list(distances(branches[0], branches[1], there, comparison.methods)) if len(branches) == len(there) == 2 else []
    )
    return table_message(list(rows.values())) | {
        "branches": {number: row.key for number, row in rows.items()},
        "numbers": numbers,
        "common": found,
        "first": [divergence_message(each) for each in comparison.first if plain(each)],
        "frames": [comparison.start, comparison.stop - 1],
        "done": comparison.done - comparison.start,
        "finished": comparison.finished,
        "apart": comparison.differing_frames,
        "thinned": comparison.thinned,
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
        distance = length(difference.by) if registered(method).unit == "metric" else f"{difference.by:.3g} (own unit)"
        return f"{colours.label(method)} position: {distance} apart"
    method = next((m for m in _prefixes(difference.name) if m in names()), difference.name.partition(".")[0])
    key = difference.name.removeprefix(f"{method}.")
    key = WORDS.get(key, key.replace("_", " ").replace(".", " "))
    a, b = distinct(difference.a, difference.b)
    by = "" if difference.by is None else f" (Δ {difference.by:.3g})"
    return f"{colours.label(method)} {key}: {a} vs {b}{by}"


def _prefixes(name: str) -> Iterator[str]:
    """Of `a.b.c`: `a.b`, `a`."""
    while "." in name:
        name = name.rpartition(".")[0]
        yield name


def distances(a: Branch, b: Branch, runs: Sequence[CurrentRun], methods: Iterable[str]) -> Iterator[dict[str, Any]]:
    """By method, the distance between the positions of the two runs [m] over the frames at which both have one.

    Where there is ground truth, both trajectories are aligned to it, as for the ATE. Without it, positions are compared
    as they were given, and those of methods without a metric unit are not.
    """
    for method in methods:
        errors = [branch.measured.errors.get(method) for branch in (a, b)]
        if errors[0] is not None and errors[1] is not None:
            frames, distances_m = _between(errors[0].aligned, errors[1].aligned, runs[0].playback.sequence.times_ns)
            how = ALIGNED[errors[0].alignment]
        elif registered(method).unit == "metric":
            count = min(len(run.series) for run in runs)
            xyz = [_positions(run.series, method, count) for run in runs]
            distances_m = np.linalg.norm(xyz[0] - xyz[1], axis=1)
            frames, how = np.flatnonzero(np.isfinite(distances_m)), ALIGNED["none"]
            distances_m = distances_m[frames]
        else:
            continue
        if len(frames):
            width = -(-len(frames) // MOST_POINTS)
            starts = np.arange(0, len(frames), width)
            yield {
                "label": colours.label(method),
                "colour": colours.css(colours.of(method)),
                "how": how,
                "frames": frames[starts].tolist(),
                "values": [float(f"{value:.6g}") for value in np.maximum.reduceat(distances_m, starts).tolist()],
            }


def _between(a: Trajectory, b: Trajectory, times_ns: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """(N,) the frames at which both have a pose, and (N,) the distances between them."""
    common, in_a, in_b = np.intersect1d(a.times_ns, b.times_ns, return_indices=True)
    distances_m = np.linalg.norm(a.translations[in_a] - b.translations[in_b], axis=1)
    known = np.isin(common, times_ns)
    return np.searchsorted(times_ns, common[known]), distances_m[known]


def _positions(series: Series, method: str, count: int) -> Array:
    """(N, 3) at the frames at which the method stepped, else NaN."""
    found = np.full((count, 3), np.nan)
    for i, key in enumerate("xyz"):
        if f"{method}.{key}" in series.quantities:
            frames, values = series.values_of(f"{method}.{key}", count)
            found[frames, i] = values
    return found
