"""What `ispom bench` measures instead of its rows: each study prints what it found, and returns it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from rich.console import Console

from ispom.methods import names

from . import child
from .options import Bench
from .page.measure import ATTENDANCES, answered, attended, print_answered, print_attended
from .page.served import Served
from .plan import CASES, found_below
from .soak import print_soak, scenarios

ATTENDED = 120
"""Frames of each run that pages look at."""


def soak(console: Console, options: Bench) -> list[dict[str, Any]]:
    """Long runs."""
    found = []
    for method in (m for m in names() if not options.methods or m in options.methods):
        rows = {}
        for scenario in scenarios(method):
            with child.progress(f"{method}, {scenario.name}: {options.soak_exposures} exposures"):
                task = {"method": method, "scenario": scenario.name, "exposures": options.soak_exposures}
                rows[scenario.name] = child.found(f"{__package__}.soak", task)
            found.append({"method": method, "scenario": scenario.name, **rows[scenario.name]})
        print_soak(console, method, rows)
    return found


def page(console: Console, options: Bench) -> dict[str, Any]:
    """Pages that look at a run."""
    kitti, simulated = (next(c for c in CASES if c.key == key) for key in ("kitti-06-two-rate", "sim-tiny"))
    case = found_below(kitti, options.data) or simulated
    served = Served(
        source=case.source,
        stereo_every=case.stereo_every,
        video_scale=case.video_scale,
        exposures=ATTENDED,
        methods=options.methods,
        headless=True,
    )
    console.print(f"{case.title}, to and fro")
    rows = []
    for attendance in ATTENDANCES:
        with child.progress(f"{ATTENDED} exposures, looked at by {attendance.name}"):
            rows.append(attended(served, attendance))
    print_attended(console, rows)
    count = options.page_exposures
    with child.progress(f"{count} exposures, a branch, and moves in both"):
        found = answered(replace(served, exposures=count, headless=False, branch_at=count * 4 // 5))
    print_answered(console, found)
    return {"source": case.key, "attended": rows, "answered": found}


STUDIES: Mapping[str, Callable[[Console, Bench], Any]] = MappingProxyType({"page": page, "soak": soak})
"""By the name of their option, which is their name in the JSON too; if several are given, the first is made."""
