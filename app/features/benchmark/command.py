"""`ispom bench`: every row in a process of its own, one after the other, one thread each."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console

from ispom.errors import InputError
from ispom.methods import Config

from ...engine.outputs import json_text, require_own, write_file
from ...engine.signals import terminable
from ..headless.console import compile_first
from . import child
from .options import Bench
from .plan import CASES, Case, found_below
from .tables import Row, print_blocks, print_case, print_unit

JSON_HEAD = '"versions": {'
"""How the JSON begins: by this it is known as ours."""
PACKAGES = ("ispom", "numpy", "scipy", "opencv-python-headless", "numba")


def bench(options: Bench) -> int:
    """Measures, prints and writes the figures; an absent source is one line. Raises InputError for wrong options."""
    if not 1 <= options.runs <= 100:
        raise InputError(f"--runs is {options.runs}, give a value from 1 to 100")
    if options.json is not None and not options.json.parent.is_dir():
        raise InputError(f"{options.json.parent} is no folder: make it, or give another --json")
    if options.json is not None:
        require_own(options.json, JSON_HEAD)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    chosen, report = _chosen(options), _about(options)
    with terminable():
        _rows_and_blocks(console, chosen, options, report)
    if options.json is not None:
        write_file(options.json, json_text(report, 2), JSON_HEAD)
    return 0


def _rows_and_blocks(console: Console, chosen: list[Case], options: Bench, report: dict[str, Any]) -> None:
    pair = _unit_pair(options.data)
    for case in chosen:
        found = found_below(case, options.data)
        methods: list[str] = [m for m in case.methods if not options.methods or m in options.methods]
        if found is None:
            console.print(f"{case.title}: skipped, there is no {case.places[0]} in {options.data} (see --data)")
            report["skipped"].append(case.key)
        elif methods:
            rows = list(_rows(found, methods, options, pair))
            print_case(console, found, rows)
            report["rows"] += [asdict(row) for row in rows]
    if options.blocks:
        with child.progress("building blocks"):
            blocks = child.found(f"{__package__}.blocks", {"pair": _texts(pair)})
        print_blocks(console, blocks)
        report["blocks"] = blocks
    print_unit(console, report["rows"])


def _chosen(options: Bench) -> list[Case]:
    unknown = [key for key in options.sources if key not in {case.key for case in CASES}]
    if unknown:
        raise InputError(f"there is no source {unknown[0]}: give --sources of {', '.join(c.key for c in CASES)}")
    return [case for case in CASES if not options.sources or case.key in options.sources]


def _rows(case: Case, methods: list[str], options: Bench, pair: tuple[Path, ...]) -> Iterator[Row]:
    compile_first(methods, Config())
    task: dict[str, Any] = {"case": case.key, "source": case.source, "pair": _texts(pair), "runs": options.runs}
    if case.simulated:
        with child.progress(f"{case.title}: rendering, where that was not done before"):
            child.found(f"{__package__}.measure", task | {"method": None}, one_thread=False)
    for method in methods:
        with child.progress(f"{case.title}: {method}, {options.runs} runs"):
            yield Row(case.key, method, child.found(f"{__package__}.measure", task | {"method": method}))


def _unit_pair(data: Path) -> tuple[Path, ...]:
    """The first two left images of KITTI 06; empty where they are not there."""
    case = next(found_below(c, data) for c in CASES if c.key == "kitti-06")
    images = sorted((Path(case.source) / "image_0").glob("*.png"))[:2] if case else []
    return tuple(images) if len(images) == 2 else ()


def _texts(paths: tuple[Path, ...]) -> list[str]:
    return [str(path) for path in paths]


def _about(options: Bench) -> dict[str, Any]:
    return {
        "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "runs": options.runs,
        "rows": [],
        "blocks": [],
        "skipped": [],
    }
