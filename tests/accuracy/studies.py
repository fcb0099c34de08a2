"""What the accuracy studies measure. Each one prints what it found, and returns it as rows for JSON."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
from rich.console import Console

from ispom.methods import names

from . import child
from .audit import audits_found, pairs_in, print_audit, write_audits
from .benchmark import commit, load, machine, record, row_text, unit_pair
from .blocks import print_blocks
from .budget import CASES, budgets_found, print_budgets, write_budgets
from .cameras import CAMERA_METHODS, CAMERAS, COSTLY, SEEDS, cameras_found, print_cameras
from .consistency import FLIGHTS, KNOWN, print_consistency
from .figures import FILE, Figures, methods_for, opened, print_figures, read_figures, recordings, write_figures
from .flights import FILMED_METHODS
from .gaps import GAP_SEEDS, gaps_found, print_gaps
from .honest_scale import print_scales
from .judge import judge_found, print_judge, recordings_in, write_judge
from .loops import loops_found, print_loops
from .page import write_between
from .records import FOLDER, PAGE, STUDY, Row, append_record, read_records
from .records import markdown as markdown_of_records
from .sensors import print_sensors, scenes_in, sensors_found, write_sensors
from .soak import print_soak, scenarios
from .starts import EVERY, print_starts, starts_found
from .uncertainty import FILE as UNCERTAINTY
from .uncertainty import Stated, markdown, means, read_table, write_table

ROOT = Path(__file__).parents[2]
CLIPS = {
    "kitti-06": ("kitti/sequences/06", 51),
    "kitti-00": ("kitti/sequences/00", 200),
    "handheld": ("handheld_board", 250),
}
"""Of recordings: the folder below --data, and how many of the first video frames are used."""


@dataclass(frozen=True)
class Options:
    """What a study is made of."""

    data: Path
    """The folder of recordings."""
    methods: tuple[str, ...] = ()
    """Empty for all."""
    seeds: int = 20
    frames: int = 20_000
    """Of each run of soak."""
    only: tuple[str, ...] = ()
    """Recordings of figures; empty for all."""
    file: Path = FILE
    """Where figures are written to."""
    table: Path | None = None
    """The page of the documentation whose table audit, benchmark, budget, judge or sensors writes."""
    release: str = ""
    """The version whose record benchmark writes; empty for none."""


def consistency(console: Console, options: Options) -> list[dict[str, Any]]:
    """Covariances against errors."""
    measured = []
    # Not the user's cache: the flights of a study would push out the ones that are really used.
    with tempfile.TemporaryDirectory() as folder:
        methods = [m for m in names() if not options.methods or m in options.methods]
        for method, cameras in itertools.product(methods, KNOWN):
            by_scene = dict[str, dict[str, Any]]()
            for scene in FLIGHTS:
                task = {"method": method, "scene": scene, "cameras": cameras, "seeds": options.seeds, "folder": folder}
                with child.progress(f"{method}, {KNOWN[cameras]}: {options.seeds} seeds of {scene}"):
                    by_scene[scene] = found("consistency", task)
                if not by_scene[scene] or "error" in by_scene[scene]:  # it is the same elsewhere
                    break
            print_consistency(console, method, cameras, by_scene)
            about = {"method": method, "cameras": cameras}
            measured += [{**about, "scene": scene, **found} for scene, found in by_scene.items()]
    return measured


def uncertainty(console: Console, options: Options) -> list[dict[str, Any]]:
    """Covariances of every method that states them; those that are not measured stay as they are in the file."""
    measured = list[dict[str, Any]]()
    with tempfile.TemporaryDirectory() as folder:
        for method in [m for m in names() if not options.methods or m in options.methods]:
            rows = list[dict[str, Any]]()
            for seed in range(options.seeds):
                task = {"method": method, "seed": seed, "folder": folder}
                rows += rows_of(console, f"{method}: seed {seed} of {options.seeds}", "uncertainty", task) or []
                if all(row["nees"] is None for row in rows):
                    break
            measured += rows
            # Written after each method: a measurement of everything takes long, and may be interrupted.
            if rows:
                found = means(Stated(**row) for row in rows)
                write_table({**read_table(UNCERTAINTY), method: found}, UNCERTAINTY)
    console.print(markdown(read_table(UNCERTAINTY)))
    return measured


def gaps(console: Console, options: Options) -> list[dict[str, Any]]:
    """Images cut out."""
    drive, measured = options.data / CLIPS["kitti-06"][0], list[dict[str, Any]]()
    for method in _filmed(options):
        tasks: list[dict[str, Any]] = [
            {"method": method, "place": place, "seed": seed}
            for place, seeds in GAP_SEEDS.items()
            for seed in range(seeds)
        ]
        tasks += [{"method": method, "folder": str(drive)}] if drive.is_dir() else []
        for task in tasks:
            where = task.get("folder") or f"sim:{task['place']} seed {task['seed']}"
            rows = rows_of(console, f"{method}: gaps in {where}", "gaps", task)
            if rows:
                print_gaps(console, gaps_found(rows))
                measured += rows
    return measured


def loops(console: Console, options: Options) -> list[dict[str, Any]]:
    """Ways that return, and some that only look so."""
    methods, measured = _filmed(options), []
    for seed in range(options.seeds) if methods else ():
        for returns in (True, False):
            task = {"seed": seed, "returns": returns, "methods": methods}
            what = "sim:town" if returns else "equal houses"
            measured += rows_of(console, f"loops in {what}, seed {seed} of {options.seeds}", "loops", task) or []
    for method in methods if measured else ():
        print_loops(console, [d for d in loops_found(measured) if d.method == method])
    return measured


def starts(console: Console, options: Options) -> list[dict[str, Any]]:
    """First maps at many places."""
    measured = []
    for key, every in EVERY.items():
        place, last = CLIPS.get(key, (key, None))
        source = place if last is None else str(options.data / place)
        if last is not None and not Path(source).is_dir():
            console.print(f"{place}: skipped, it is not in {options.data} (see --data)")
            continue
        task = {"source": source, "last": last, "every": every}
        rows = rows_of(console, f"monocular: started in {source}", "starts", task)
        if rows is None:
            continue
        if not rows:
            console.print(f"{source}: skipped, it has too few frames")
            continue
        print_starts(console, starts_found(rows))
        measured += rows
    return measured


def cameras(console: Console, options: Options) -> list[dict[str, Any]]:
    """One flight by cameras of many kinds."""
    measured = []
    methods = [m for m in CAMERA_METHODS if not options.methods or m in options.methods]
    for seed, cameras in ((seed, name) for seed in range(SEEDS) for name in CAMERAS if seed == 0 or name not in COSTLY):
        task = {"seed": seed, "cameras": cameras, "methods": methods}
        measured += rows_of(console, f"sim:city seed {seed}: {cameras}", "cameras", task) or []
    print_cameras(console, cameras_found(measured))
    return measured


def soak(console: Console, options: Options) -> list[dict[str, Any]]:
    """Time and memory of long runs over small made images."""
    measured = []
    for method in (m for m in names() if not options.methods or m in options.methods):
        rows = {}
        for scenario in scenarios(method):
            task = {"method": method, "scenario": scenario.name, "exposures": options.frames}
            with child.progress(f"{method}, {scenario.name}: {options.frames} frames"):
                rows[scenario.name] = found("soak", task)
            measured.append({"method": method, "scenario": scenario.name, **rows[scenario.name]})
        print_soak(console, method, rows)
    return measured


def figures(console: Console, options: Options) -> list[dict[str, Any]]:
    """The figures of the ratchet; those that are not measured stay as they are in its file."""
    measured = []
    for task in _runs(console, options):
        name, method = task["name"], task["method"]
        with child.progress(f"{name}: {method}"):
            row = found("figures", task)
        if "error" in row:
            console.print(f"{name}, {method}: {row['error']}")
            continue
        # Written after each run: a measurement of everything takes long, and may be interrupted.
        table = read_figures(options.file)
        table.setdefault(name, {})[method] = Figures(**row)
        write_figures(table, options.file)
        print_figures(console, name, method, table[name][method])
        measured.append({"recording": name, "method": method, **row})
    return measured


def _runs(console: Console, options: Options) -> Iterator[dict[str, str]]:
    """Yields the runs wanted: name and source of the recording, and the method."""
    sources = recordings(options.data)
    for unknown in [name for name in options.only if name not in sources]:
        console.print(f"{unknown}: skipped, it is none of {', '.join(sources)}")
    for name in [name for name in sources if not options.only or name in options.only]:
        for method in methods_for(name, opened(name, sources[name])):
            if not options.methods or method in options.methods:
                yield {"name": name, "source": sources[name], "method": method}


def benchmark(console: Console, options: Options) -> list[dict[str, Any]]:
    """The record of a release, and the page of all records; without a release the page, or else the figures only."""
    page = options.table or PAGE
    rows = list[Row]()
    if options.release or options.table is None:
        code, loads = commit(), [load()]
        for task in _runs(console, options):
            with child.progress(f"{task['name']}: {task['method']}"):
                row = found("benchmark", task)
            if "error" in row:
                row = {"recording": task["name"], "method": task["method"], "failed": row["error"]}
            rows.append(msgspec.convert(row, Row))
            loads.append(load())
            console.print(row_text(rows[-1]))
        if options.release:
            unit = found("benchmark", {"unit": unit_pair(options.data)})
            left_out = set(read_figures()) - {row.recording for row in rows}
            append_record(record(options.release, code, machine(unit, loads), rows, left_out), page.parent / FOLDER)
    if options.release or options.table is not None:
        write_between(page, STUDY, markdown_of_records(read_records(page.parent / FOLDER)))
    return [msgspec.to_builtins(row) for row in rows]


def scale(console: Console, options: Options) -> list[dict[str, Any]]:
    """The unit of monocular segments, where there is a truth to compare with."""
    measured = []
    for name, source in recordings(options.data).items():
        if options.only and name not in options.only:
            continue
        task = {"name": name, "source": source}
        measured += rows_of(console, f"monocular: scale of the segments of {name}", "honest_scale", task) or []
    print_scales(console, measured)
    return measured


def audit(console: Console, options: Options) -> list[dict[str, Any]]:
    """Mistakes planted in pairs of trajectories."""
    measured, pairs = list[dict[str, Any]](), pairs_in(options.data)
    for name in [name for name in pairs if not options.only or name in options.only]:
        task = {"pair": name, "data": str(options.data.absolute())}
        measured += rows_of(console, f"mistakes planted in {name}", "audit", task) or []
    if measured:
        print_audit(console, audits_found(measured))
        if options.table is not None:
            write_audits(options.table, audits_found(measured))
    return measured


def budget(console: Console, options: Options) -> list[dict[str, Any]]:
    """Shares of planted causes against what `ispom budget` says."""
    measured = list[dict[str, Any]]()
    for case in range(len(CASES)):
        measured += rows_of(console, f"budget: case {case} of {len(CASES)}", "budget", {"case": case}) or []
    if measured:
        print_budgets(console, budgets_found(measured))
        if options.table is not None:
            write_budgets(options.table, budgets_found(measured))
    return measured


def sensors(console: Console, options: Options) -> list[dict[str, Any]]:
    """Mistakes planted in sensors."""
    measured, scenes = list[dict[str, Any]](), scenes_in(options.data)
    for name in [name for name in scenes if not options.only or name in options.only]:
        task = {"recording": name, "data": str(options.data.absolute())}
        measured += rows_of(console, f"mistakes planted in the sensors of {name}", "sensors", task) or []
    if measured:
        print_sensors(console, sensors_found(measured))
        if options.table is not None:
            write_sensors(options.table, sensors_found(measured))
    return measured


def judge(console: Console, options: Options) -> list[dict[str, Any]]:
    """Mistakes planted in the true poses of recordings."""
    measured = list[dict[str, Any]]()
    for name, source in recordings_in(options.data.absolute()).items():
        if not options.only or name in options.only:
            task = {"name": name, "source": source}
            measured += rows_of(console, f"mistakes planted in the truth of {name}", "judge", task) or []
    if measured:
        print_judge(console, judge_found(measured))
        if options.table is not None:
            write_judge(options.table, judge_found(measured))
    return measured


def blocks(console: Console, options: Options) -> list[dict[str, Any]]:
    """Times of the building blocks, and the unit in which machines compare."""
    with child.progress("building blocks"):
        rows = found("blocks", {"drive": str(options.data / CLIPS["kitti-06"][0])})
    if isinstance(rows, dict):
        console.print(f"building blocks: {rows['error']}")
        return []
    print_blocks(console, rows)
    return rows


def _filmed(options: Options) -> list[str]:
    """The methods wanted of those whose flights are filmed for them."""
    return [m for m in FILMED_METHODS if not options.methods or m in options.methods]


def found(module: str, task: dict[str, Any]) -> Any:
    """What a module of this folder finds in a process of its own; {"error": ...} if it fails."""
    return child.found(f"{__package__}.{module}", task, path=ROOT)


def rows_of(console: Console, what: str, module: str, task: dict[str, Any]) -> list[dict[str, Any]] | None:
    """The rows that another process finds; None, with its error printed, if it fails."""
    with child.progress(what):
        rows = found(module, task)
    if isinstance(rows, dict):
        console.print(f"{what}: {rows['error']}")
        return None
    return rows


STUDIES: Mapping[str, Callable[[Console, Options], list[dict[str, Any]]]] = MappingProxyType(
    {
        "figures": figures,
        "benchmark": benchmark,
        "consistency": consistency,
        "uncertainty": uncertainty,
        "gaps": gaps,
        "loops": loops,
        "starts": starts,
        "cameras": cameras,
        "scale": scale,
        "soak": soak,
        "audit": audit,
        "budget": budget,
        "sensors": sensors,
        "judge": judge,
        "blocks": blocks,
    }
)
