"""`ispom bench`: every row in a process of its own, one after the other, one thread each."""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console

from ispom.errors import InputError
from ispom.methods import names

from ..outputs import require_own, write_file
from .cameras import CAMERA_METHODS, CAMERAS, COSTLY, SEEDS, cameras_found, print_cameras
from .consistency import FLIGHTS, print_consistency
from .flights import FILMED_METHODS
from .gaps import GAP_SEEDS, gaps_found, print_gaps
from .loops import loops_found, print_loops
from .options import Bench
from .page.measure import ATTENDANCES, answered, attended, print_answered, print_attended
from .page.served import Served
from .plan import CASES, Case, found_below
from .row import Row
from .soak import MIN_EXPOSURES, print_soak, scenarios
from .starts import EVERY, print_starts, starts_found
from .tables import print_blocks, print_case, print_unit

ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""For numerical libraries; OpenCV is told in the process itself. The estimators compile nothing parallel."""
JSON_HEAD = '"versions": {'
"""How the JSON begins: by this it is known as ours."""
ATTENDED, MIN_PAGE = 120, 100
"""Exposures of each run that is looked at, and the fewest of the long one."""
PACKAGES = ("ispom", "numpy", "scipy", "opencv-python-headless", "numba")


def bench(options: Bench) -> int:
    """Measures, prints and writes what is asked; a source that is absent is one line. InputError for wrong options."""
    if not 1 <= options.runs <= 100:
        raise InputError(f"--runs is {options.runs}, give a value from 1 to 100")
    if options.json is not None and not options.json.parent.is_dir():
        raise InputError(f"{options.json.parent} is no folder: make it, or give another --json")
    if not 2 <= options.seeds <= 1000:
        raise InputError(f"--seeds is {options.seeds}, give a value from 2 to 1000")
    if not MIN_EXPOSURES <= options.soak_exposures <= 10_000_000:
        raise InputError(f"--soak-exposures is {options.soak_exposures}, give a value from {MIN_EXPOSURES} to 10000000")
    if not MIN_PAGE <= options.page_exposures <= 100_000:
        raise InputError(f"--page-exposures is {options.page_exposures}, give a value from {MIN_PAGE} to 100000")
    if options.json is not None:
        require_own(options.json, JSON_HEAD)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    chosen, report = _chosen(options), _about(options)
    if options.consistency:
        report["consistency"] = _consistency(console, options)
    elif options.gaps:
        report["gaps"] = _gaps(console, options)
    elif options.loops:
        report["loops"] = _loops(console, options)
    elif options.starts:
        report["starts"] = _starts(console, options)
    elif options.cameras:
        report["cameras"] = _cameras(console, options)
    elif options.page:
        report["page"] = _page(console, options)
    elif options.soak:
        report["soak"] = _soak(console, options)
    else:
        _rows_and_blocks(console, chosen, options, report)
    if options.json is not None:
        write_file(options.json, json.dumps(_plain(report), indent=2, allow_nan=False) + "\n", JSON_HEAD)
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
        with _progress("building blocks"):
            blocks = _child("blocks", {"pair": _texts(pair)})
        print_blocks(console, blocks)
        report["blocks"] = blocks
    print_unit(console, report["rows"])


def _consistency(console: Console, options: Bench) -> list[dict[str, Any]]:
    measured = []
    # Not the user's cache: so many flights would push out the ones that are really used.
    with tempfile.TemporaryDirectory() as folder:
        for method in (m for m in names() if not options.methods or m in options.methods):
            by_scene = dict[str, dict[str, Any]]()
            for scene in FLIGHTS:
                task = {"method": method, "scene": scene, "seeds": options.seeds, "folder": folder}
                with _progress(f"{method}: {options.seeds} seeds of {scene}"):
                    by_scene[scene] = _child("consistency", task)
                if not by_scene[scene] or "error" in by_scene[scene]:  # it is the same elsewhere
                    break
            print_consistency(console, method, by_scene)
            measured += [{"method": method, "scene": scene, **found} for scene, found in by_scene.items()]
    return measured


def _gaps(console: Console, options: Bench) -> list[dict[str, Any]]:
    drive, measured = next(found_below(c, options.data) for c in CASES if c.key == "kitti-06"), []
    for method in _filmed(options):
        tasks: list[dict[str, Any]] = [{"method": method, "seed": seed} for seed in range(GAP_SEEDS)]
        tasks += [{"method": method, "folder": drive.source}] if drive is not None else []
        for task in tasks:
            rows = _told(console, f"{method}: gaps in {task.get('folder') or 'sim:city'}", "gaps", task)
            if rows:
                print_gaps(console, gaps_found(rows))
                measured += rows
    return measured


def _loops(console: Console, options: Bench) -> list[dict[str, Any]]:
    methods, measured = _filmed(options), []
    for seed in range(options.seeds) if methods else ():
        for returns in (True, False):
            task = {"seed": seed, "returns": returns, "methods": methods}
            what = "sim:town" if returns else "equal houses"
            measured += _told(console, f"loops in {what}, seed {seed} of {options.seeds}", "loops", task) or []
    for method in methods if measured else ():
        print_loops(console, [d for d in loops_found(measured) if d.method == method])
    return measured


def _filmed(options: Bench) -> list[str]:
    """The methods wanted of those whose flights are filmed for them."""
    return [m for m in FILMED_METHODS if not options.methods or m in options.methods]


def _starts(console: Console, options: Bench) -> list[dict[str, Any]]:
    measured, cases = [], {c.key: c for c in CASES}
    for key, every in EVERY.items():
        found = found_below(cases[key], options.data) if key in cases else None
        if key in cases and found is None:
            console.print(f"{cases[key].title}: skipped, it is not in {options.data} (see --data)")
            continue
        source, last = (key, None) if found is None else (found.source, found.frames)
        task = {"source": source, "last": last, "every": every}
        rows = _told(console, f"monocular: started in {source}", "starts", task)
        if rows is None:
            continue
        if not rows:
            console.print(f"{source}: skipped, it has too few frames")
            continue
        print_starts(console, starts_found(rows))
        measured += rows
    return measured


def _told(console: Console, what: str, module: str, task: dict[str, Any]) -> list[dict[str, Any]] | None:
    """The rows that another process found; None, and said so, where it could not."""
    with _progress(what):
        rows = _child(module, task)
    if isinstance(rows, dict):
        console.print(f"{what}: {rows['error']}")
        return None
    return rows


def _cameras(console: Console, options: Bench) -> list[dict[str, Any]]:
    measured = []
    methods = [m for m in CAMERA_METHODS if not options.methods or m in options.methods]
    for seed, cameras in ((seed, name) for seed in range(SEEDS) for name in CAMERAS if seed == 0 or name not in COSTLY):
        task = {"seed": seed, "cameras": cameras, "methods": methods}
        measured += _told(console, f"sim:city seed {seed}: {cameras}", "cameras", task) or []
    print_cameras(console, cameras_found(measured))
    return measured


def _soak(console: Console, options: Bench) -> list[dict[str, Any]]:
    found = []
    for method in (m for m in names() if not options.methods or m in options.methods):
        rows = {}
        for scenario in scenarios(method):
            with _progress(f"{method}, {scenario.name}: {options.soak_exposures} exposures"):
                task = {"method": method, "scenario": scenario.name, "exposures": options.soak_exposures}
                rows[scenario.name] = _child("soak", task)
            found.append({"method": method, "scenario": scenario.name, **rows[scenario.name]})
        print_soak(console, method, rows)
    return found


def _page(console: Console, options: Bench) -> dict[str, Any]:
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
        with _progress(f"{ATTENDED} exposures, looked at by {attendance.name}"):
            rows.append(attended(served, attendance))
    print_attended(console, rows)
    count = options.page_exposures
    with _progress(f"{count} exposures, a branch, and moves in both"):
        found = answered(replace(served, exposures=count, headless=False, branch_at=count * 4 // 5))
    print_answered(console, found)
    return {"source": case.key, "attended": rows, "answered": found}


def _chosen(options: Bench) -> list[Case]:
    unknown = [key for key in options.sources if key not in {case.key for case in CASES}]
    if unknown:
        raise InputError(f"there is no source {unknown[0]}: give --sources of {', '.join(c.key for c in CASES)}")
    return [case for case in CASES if not options.sources or case.key in options.sources]


def _rows(case: Case, methods: list[str], options: Bench, pair: tuple[Path, ...]) -> Iterator[Row]:
    task: dict[str, Any] = {"case": case.key, "source": case.source, "pair": _texts(pair), "runs": options.runs}
    if case.simulated:
        with _progress(f"{case.title}: rendering, where that was not done before"):
            _child("measure", task | {"method": None}, one_thread=False)
    for method in methods:
        with _progress(f"{case.title}: {method}, {options.runs} runs"):
            yield Row(case.key, method, _child("measure", task | {"method": method}))


def _child(module: str, task: dict[str, Any], one_thread: bool = True) -> Any:
    """What another process found out; {"error": ...} where it could not."""
    command = [sys.executable, "-m", f"{__package__}.{module}", json.dumps(task)]
    environment = {**os.environ, **(ONE_THREAD if one_thread else {})}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"it ended with code {done.returncode}"])[-1]
        return {"error": f"failed, please report it: {last}"}
    return json.loads(done.stdout.splitlines()[-1])


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
        "consistency": [],
        "gaps": [],
        "loops": [],
        "starts": [],
        "cameras": [],
        "soak": [],
        "page": {},
        "skipped": [],
    }


def _plain(value: Any) -> Any:
    """With null for what is no number: JSON has no word for that."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def _progress(what: str) -> Iterator[None]:
    """Shows on a terminal what is measured."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    with console.status(what):
        yield
