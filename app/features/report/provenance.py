"""What was run: source, options, versions, settings and hashes, a column per run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from .blocks import Block, Details, Paragraph, Table
from .folder import Run


def provenance(runs: list[Run]) -> list[Block]:
    """What tells the runs apart first; all options, versions, settings and hashes to be opened."""
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
