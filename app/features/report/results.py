"""The table of results: a group of columns per kind of method, the runs side by side in it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ...presentation.texts import Unit, length_unit
from .blocks import Block, Compared, Details, Group, MethodName, Paragraph, Table
from .folder import Run


@dataclass(frozen=True)
class Score:
    """A row."""

    path: tuple[str, ...]
    """Where the value is in a method's part of metrics.json."""
    title: str
    metres: bool = False
    """Whether it is a length, whose unit is that of the row."""


SCORES = (
    Score(("poses",), "poses"),
    Score(("located",), "frames located"),
    Score(("lost",), "frames lost"),
    Score(("aligned",), "aligned by"),
    Score(("ate_m",), "ATE (RMS)", metres=True),
    Score(("rpe_m",), "RPE, pose to pose", metres=True),
    Score(("rpe_deg",), "RPE, pose to pose [deg]"),
    Score(("t_err_percent",), "KITTI drift [%]"),
    Score(("r_err_deg_per_100m",), "KITTI drift [deg / 100 m]"),
    Score(("between_stereo_rmse_m",), "between stereo poses, RMS", metres=True),
    Score(("spline_between_stereo_rmse_m",), "– of a spline through them", metres=True),
    Score(("step_scale_end_over_start",), "step scale, end / start [1]"),
    Score(("ms_per_exposure", "median"), "time per frame, median [ms]"),
    Score(("ms_per_exposure", "p95"), "time per frame, 95th percentile [ms]"),
)


def results(runs: list[Run]) -> list[Block]:
    """A column per run and method; with several runs, differences to the first of a kind."""
    columns = list(_columns(runs))
    rows: list[list[Any]] = []
    for score in SCORES:
        values = [_value(run.metrics[method], score.path) for _, run, method in columns]
        if any(value is not None for value in values):
            unit = length_unit(values) if score.metres else None
            values = [v if unit is None or v is None else v / unit.size for v in values]
            rows.append([_title(score, unit), *_compared(values, [kind for kind, _, _ in columns])])
    if len(runs) == 1:
        return [Table(["", *(MethodName(method) for _, _, method in columns)], rows)]
    kinds = dict.fromkeys(kind for kind, _, _ in columns)
    groups = [Group("", 1), *(Group(_head(columns, kind), sum(c[0] == kind for c in columns)) for kind in kinds)]
    head = ["", *(run.label if _alone(columns, kind) else f"{run.label}: {m}" for kind, run, m in columns)]
    legend = (
        "Small figures: difference to the first column of the same kind of method. Times differ from run to run of the "
        "same. Errors compare only between runs over the same images."
    )
    return [Table(head, rows, groups=groups), Paragraph(legend, "quiet")]


def _columns(runs: list[Run]) -> Iterator[tuple[str, Run, str]]:
    """Kind of method (stereo of stereo.paper), run and method, so that columns of one kind stand together."""
    found = [(method.partition(".")[0], run, method) for run in runs for method in run.metrics]
    for kind in dict.fromkeys(kind for kind, _, _ in found):
        yield from (column for column in found if column[0] == kind)


def _alone(columns: list[tuple[str, Run, str]], kind: str) -> bool:
    """Whether the columns of the kind are all of one method."""
    return len({method for other, _, method in columns if other == kind}) == 1


def _head(columns: list[tuple[str, Run, str]], kind: str) -> Any:
    return MethodName(next(m for k, _, m in columns if k == kind)) if _alone(columns, kind) else kind


def _value(entry: Mapping[str, Any], path: tuple[str, ...]) -> Any:
    found: Any = entry
    for name in path:
        found = found.get(name) if isinstance(found, Mapping) else None
    return found if isinstance(found, int | float | str) else None


def _title(score: Score, unit: Unit | None) -> str:
    return score.title if unit is None else f"{score.title} [{unit.name}]"


def _compared(values: list[Any], kinds: list[str]) -> Iterator[Any]:
    """Numbers with their difference to the first of their kind, where a kind has several."""
    for i, (value, kind) in enumerate(zip(values, kinds, strict=True)):
        if not _number(value) or sum(k == kind and _number(v) for v, k in zip(values, kinds, strict=True)) < 2:
            yield value
            continue
        first = values[kinds.index(kind)]
        yield Compared(value, value - first if i != kinds.index(kind) and _number(first) else None)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def provenance(runs: list[Run]) -> list[Block]:
    """The differences of the runs first; all options, versions, settings and hashes to be opened."""
    head = ["", *(run.label for run in runs)]
    rows: list[list[Any]] = [
        ["folder", *(str(run.path) for run in runs)],
        ["source", *(run.manifest["source"] for run in runs)],
        ["sequence", *(run.manifest["sequence"] for run in runs)],
        ["notes", *(run.manifest["notes"] for run in runs)],
        ["true path length [m]", *(run.path_length_m for run in runs)],
        ["exposures", *(_counts(run.manifest.get("exposures")) for run in runs)],
        ["platform", *(run.manifest.get("platform") for run in runs)],
        ["SHA-256 of the images and their times", *(_images_sha256(run) for run in runs)],
        ["SHA-256 of the settings", *(_settings_sha256(run)[:16] for run in runs)],
    ]
    options = _rows([run.manifest["options"] for run in runs])
    versions = _rows([run.manifest["versions"] for run in runs])
    stated = {row[0] for row in options}
    settings = [row for row in _rows([_flat(run.manifest["config"]) for run in runs]) if row[0] not in stated]
    found: list[Block] = [Table(head, rows, numeric=False)]
    if len(runs) > 1:
        differing = [row for row in [*options, *settings, *versions] if len({str(value) for value in row[1:]}) > 1]
        found.append(Paragraph("Differences" if differing else "All runs have the same settings and versions."))
        found += [Table(head, differing, numeric=False)] if differing else []
    files = sorted({name for run in runs for name in run.sha256})
    hashes = [[name, *(run.sha256.get(name) for run in runs)] for name in files]
    return [
        *found,
        Details("Options and versions", [Table(head, [*options, *versions], numeric=False)]),
        Details("All settings of the methods", [Table(head, settings, numeric=False)]),
        Details("SHA-256 of the files", [Table(head, hashes, numeric=False)]),
    ]


def _counts(value: Any) -> str | None:
    return ", ".join(f"{count} {kind}" for kind, count in value.items()) if isinstance(value, dict) else None


def _flat(config: Mapping[str, Any]) -> dict[str, Any]:
    """method.setting: value."""
    found: dict[str, Any] = {}
    for name, value in config.items():
        found |= {f"{name}.{k}": v for k, v in _flat(value).items()} if isinstance(value, dict) else {str(name): value}
    return found


def _rows(columns: list[dict[str, Any]]) -> list[list[Any]]:
    names = dict.fromkeys(name for column in columns for name in column)
    return [[name, *(column.get(name) for column in columns)] for name in names]


def _images_sha256(run: Run) -> str | None:
    """Equal for runs over the same images; None of a run that did not finish reading them."""
    digest = run.manifest.get("images_sha256")
    return digest[:16] if isinstance(digest, str) else None


def _settings_sha256(run: Run) -> str:
    """Equal for runs with the same options and settings."""
    text = json.dumps([run.manifest["options"], run.manifest["config"]], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
